"""Liquids with a free surface: particles on the grid of a fluid."""
