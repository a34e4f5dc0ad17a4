"""`python -m vig` is `vig`."""

if __name__ == "__main__":
    from vig_app.cli.main import main

    main()
