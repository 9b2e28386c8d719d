"""One kind of camera a file; each registers itself with `CAMERAS`."""
