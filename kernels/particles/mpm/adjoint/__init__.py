"""Adjoints of the kernels of the material point method, file by file; compiled where gradients are asked for."""
