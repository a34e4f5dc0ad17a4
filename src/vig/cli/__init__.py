"""The command line: a face of vig, which imports the core and is imported by nothing."""
