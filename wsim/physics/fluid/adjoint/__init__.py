"""Gradients of fluids: imported where a simulation has them."""
