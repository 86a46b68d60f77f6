"""Adjoints of the kernels of fluids, file by file; compiled where gradients are asked for."""
