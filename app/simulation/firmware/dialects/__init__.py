"""One simulated board a file; each registers itself with `FIRMWARES`."""
