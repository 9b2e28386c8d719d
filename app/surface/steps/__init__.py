"""One file for each way of changing a cloud."""
