"""The command line: imports the core and is imported by nothing in it."""
