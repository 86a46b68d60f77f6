"""What tests/physics/fluid/liquid/test_flow.py shares with other tests: tap."""

from tests.physics.fluid.liquid.tanks import tank, water
from wsim.scene import Scene

CELL = 1.0 / 16.0


def tap(frames: int = 24, **more) -> Scene:
    """A flat box without gravity, open at +x, into which a slab gives liquid of 1 m/s, half as high."""
    sides = ("closed", "open", *["closed"] * 4)
    scene = tank((16, 8), [(0, 0), (1, 1)], cell=CELL, gravity=(0, 0, 0), sides=sides, frames=frames)
    slab = water((2 * CELL, 0, 0), (4 * CELL, 4 * CELL, CELL), path="/tap", role="source", velocity=(1.0, 0.0, 0.0), **more)
    scene.objects["LiquidSource"] = [slab]
    return scene
