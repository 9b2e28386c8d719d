"""One file per kind of board."""
