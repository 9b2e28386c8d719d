"""Sizes, fits and differences of clouds and meshes: values in, values out."""
