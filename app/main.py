"""The server: everything it is made of, entered in order and left in reverse."""
