"""Position-based particles: grains and fluids by constraints, in the XPBD iterations of cloth and nets."""
