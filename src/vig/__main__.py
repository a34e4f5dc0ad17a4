"""`python -m vig` is the command `vig`."""

from importlib.metadata import entry_points

if __name__ == "__main__":
    (command,) = entry_points(group="console_scripts", name="vig")
    command.load()()
