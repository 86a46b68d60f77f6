"""Random draws of surfaces that collide, reproducible by their number: `python -m tools.draws --help`."""
