"""Who may use the server: its password, the browsers that are logged in, the tokens of programs."""
