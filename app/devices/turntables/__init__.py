"""One controller board a file; each registers itself with `TURNTABLES`."""
