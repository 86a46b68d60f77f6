"""Contact of a sheet's edges and triangles with sharp edges and corners of colliders."""
