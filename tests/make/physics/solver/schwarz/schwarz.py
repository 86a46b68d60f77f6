"""What tests/physics/solver/schwarz/test_schwarz.py shares with other tests: sheet."""

from wsim.scene import Scene, shapes
from wsim.scene.fabric import Fabric


def sheet(cells: int = 9, stretch: float = 1e4, **more) -> Scene:
    scene = Scene(**{"solver": "implicit", "integrator": "backward_euler", "fps": 24.0, "substeps": 2, "iterations": 2} | more)
    cloth = scene.cloth("/cloth", *shapes.sheet(1.0, 1.0, cells, cells), model="membrane",
                        material=Fabric(stretch=stretch, shear=0.3 * stretch, bend=1e-4))
    scene.pin("/pin", cloth, [0, cells])
    return scene
