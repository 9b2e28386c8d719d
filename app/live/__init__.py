"""What a person sees of the camera while it works: pictures for each viewer, made while somebody looks."""
