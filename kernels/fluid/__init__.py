"""Fluids on a staggered grid: advection, pressure, viscosity, forces, sources, obstacles."""
