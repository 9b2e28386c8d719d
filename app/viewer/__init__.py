"""The 3D view: the scanner and its growing cloud, drawn by viser."""
