"""Meshes and clouds as other programs want them."""
