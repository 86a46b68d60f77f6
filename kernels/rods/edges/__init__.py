"""Contact of the edges of strands: with each other, and with colliders between their points."""
