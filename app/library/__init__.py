"""Scans as they are kept: one folder each, which can be copied to another machine."""
