"""The explicit material point method on threads of a CPU."""
