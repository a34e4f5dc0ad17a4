"""The one exception that the command line shows to its user."""

from collections.abc import Iterator
from contextlib import contextmanager


class UserError(Exception):
    """A mistake that the user can mend: bad input, a missing file, a full disk.

    Its message is one line that says what was expected, what came, and what to do. The command line
    prints it and exits with code 2, without a traceback. Errors of the program itself are other types.
    """

    def __init__(self, message: str) -> None:
        super().__init__(" ".join(message.split()))


@contextmanager
def optional_import(extra: str) -> Iterator[None]:
    """Turn a missing package in the imports of the `with` block into a `UserError`.

    Args:
        extra: The extra of vig that brings the package, such as "world".
    """
    try:
        yield
    except ModuleNotFoundError as error:
        raise UserError(
            f"expected the package {error.name}, which is not installed; install it with"
            f" `pip install 'vig[{extra}]'`."
        ) from error
