"""The doctor: what a bench really does, measured, against what its file says."""
