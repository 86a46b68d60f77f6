"""Implicit steps of the material point method, as long as particles take to cross some cells."""
