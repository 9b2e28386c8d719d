"""From points with normals to triangles."""
