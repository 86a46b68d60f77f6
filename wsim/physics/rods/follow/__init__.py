"""Hairs that follow guides: curves that are not simulated, carried by rods near them."""
