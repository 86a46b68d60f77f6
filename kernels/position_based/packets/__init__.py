"""Eight particles of a CPU together."""

LANES = 8              # particles of a packet; 1: one by one
