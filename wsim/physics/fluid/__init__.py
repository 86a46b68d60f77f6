"""Grid fluids: smoke and air on a staggered grid, in two and three dimensions; sources, walls, obstacles."""
