"""Several scans of one thing become one cloud."""
