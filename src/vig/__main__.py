"""`python -m vig` is `vig`."""

from vig.cli.main import main

if __name__ == "__main__":
    main()
