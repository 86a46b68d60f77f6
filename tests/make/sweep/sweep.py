"""What tests/sweep/test_sweep.py shares with other tests: CPU, hung, lasting, table."""

import csv

import wsim
from tests.conftest import grid
from wsim.scene import Scene, Sphere
from wsim.scene.fabric import Fabric
from wsim.sweep.folder import CIRCUMSTANCES, csv_cell
from wsim.sweep.job import Settings

CPU = Settings(device="cpu")


def hung(path, **more) -> str:
    """A file of a cloth of 16 points that is held at two of them, above a ball."""
    scene = Scene(**{"frames": 3, "substeps": 4, "iterations": 3, "solver": "xpbd", "integrator": "backward_euler"} | more)
    cloth = scene.cloth("/World/Cloth", *grid(), material=Fabric(stretch=300.0, bend=1e-4, damping=1e-3), model="springs",
                        drag=1.0)
    scene.pin("/World/Pin", cloth, points=[0, 3])
    scene.collider("/World/Ball", Sphere(0.2), at=(0.5, -0.5, 0.5))
    wsim.save(scene, str(path))
    return str(path)


def table(folder) -> list[dict]:
    with open(folder / "runs.csv", newline="") as text:
        return list(csv.DictReader(text))


def lasting(rows) -> list[dict]:
    """Rows without what a machine and its clock decide."""
    return [{k: csv_cell(v) for k, v in row.items() if k not in CIRCUMSTANCES} for row in rows]
