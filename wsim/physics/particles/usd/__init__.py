"""What files say of particles, whatever method moves them."""
