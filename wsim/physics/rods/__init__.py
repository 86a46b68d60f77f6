"""Rods: ropes, hair and wires that stretch, bend and twist."""
