"""The command line: the same use-cases, no server."""
