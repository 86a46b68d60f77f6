"""Meshes of tetrahedra: making, mending, and carrying finer surfaces. NumPy only."""
