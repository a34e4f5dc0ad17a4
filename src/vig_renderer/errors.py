"""The one exception that the command line shows to its user."""


class UserError(ValueError):
    """A mistake that the user can mend: bad input, a missing file, a full disk.

    Its message is one line that states the expectation, the argument, and the remedy. The command line
    prints it and exits with code 2, without a traceback. Errors of the program itself are other types.
    """

    def __init__(self, message: str) -> None:
        super().__init__(" ".join(message.split()))
