"""What a person sees of the camera while it works: pictures for each viewer, made only while somebody looks."""
