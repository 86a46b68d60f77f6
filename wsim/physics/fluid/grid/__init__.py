"""A fluid on its grid, on the device: fields, shapes, transport, pressure, viscosity."""
