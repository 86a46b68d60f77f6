"""What tests/physics/cloth/test_air.py shares with other tests: sheet."""

import numpy as np

from wsim.scene import Scene, shapes
from wsim.scene.fabric import Fabric

RHO, SIDE = 1.2, 0.8                          # [kg/m^3], [m]


def sheet(wind=(0.0, 0.0, 0.0), *, area_density: float = 0.1, velocity=(0.0, 0.0, 0.0), tilt: float = 0.0, cells: int = 4,
          drag: float = 0.0, lift: float = 0.0, **more) -> Scene:
    """A horizontal square cloth, normal +y; `tilt` [rad] turns its normal towards +x: (sin, cos, 0)."""
    settings = {"gravity": (0.0, 0.0, 0.0), "fps": 60.0, "substeps": 10, "solver": "xpbd"} | more
    scene = Scene(wind=wind, air_density=RHO, **settings)
    points, counts, indices = shapes.sheet(SIDE, SIDE, cells, cells, horizontal=True)
    c, s = np.cos(tilt), np.sin(tilt)
    points = points @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]).T
    scene.cloth("/cloth", points, counts, indices, velocities=np.tile(velocity, (len(points), 1)), drag=drag, lift=lift,
                material=Fabric(density=area_density / 1e-3, thickness=1e-3))
    return scene
