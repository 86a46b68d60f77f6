"""Gradients of the material point method: a recorded frame, and the adjoint of its steps."""
