"""Passes of a step over the whole grid: reflection, scalars by tiles, what they sum to and where they are."""
