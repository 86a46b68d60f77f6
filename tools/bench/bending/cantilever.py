"""How far strips of one material sink under their weight on six kinds of mesh, over what beam theory says.

    python -m tools.bench.bending.cantilever [--json tools/results/data/bending.json]

A strip of 1 x 0.25 m, clamped at one end, bend 1, w L^4 / (8 B) at its tip; small angles, NumPy on the engine's coefficients.
Two rows a mesh: the curvatures of `wsim.physics.cloth.bending`, and each hinge by itself (bend l^2 / A), as wsim had it before.
"""

import argparse
import json

import numpy as np

from tools.bench.bending.strips import LENGTH, MESHES, strip
from wsim.geometry import topology
from wsim.model.model import make_body
from wsim.physics.cloth.constraints import Constraints, constraints_of_body
from wsim.physics.cloth.objects import Cloth
from wsim.physics.motion import frequency
from wsim.scene.fabric import Fabric

CELLS = (10, 20, 40)


def stiffness(points: np.ndarray, triangles: np.ndarray, pinned: np.ndarray, alone: bool = False) -> np.ndarray:
    """Second derivatives of the energy at bend 1 by heights over the plane, (n, n). alone: of hinges by themselves."""
    cloth = Cloth("/strip", points, np.full(len(triangles), 3), triangles.ravel(), material=Fabric(bend=1.0))
    body = make_body(cloth, 0, 0, 0)
    own = np.empty(len(points), int)
    own[body.index] = np.arange(len(points))
    (hinges,) = [r for r in constraints_of_body(body, body.index[pinned]) if r.kind == "dihedral"]
    if alone:
        p = body.rest[hinges.ids]
        area = topology.triangle_areas(body.rest, hinges.ids[:, [0, 1, 2]]) + topology.triangle_areas(body.rest,
                                                                                                      hinges.ids[:, [1, 0, 3]])
        hinges = Constraints("dihedral", hinges.ids, hinges.rest, area / ((p[:, 1] - p[:, 0])**2).sum(1), hinges.stiffness)
    K = np.zeros((len(points), len(points)))
    for s in frequency.constraint_stiffness([hinges], body):
        rows = s.J.shape[1]
        J, at = np.zeros((rows * len(s.ids), len(points))), np.arange(rows * len(s.ids)).reshape(-1, rows, 1)
        np.add.at(J, (at, own[s.ids][:, None, :]), s.J[..., 2])
        K += J.T @ J
    return K


def drop(mesh: str, cells: int, alone: bool = False, flip: bool = False) -> float:
    """How far the tip of a strip sinks under its weight, over w L^4 / (8 B). flip: every third triangle wound the other way."""
    points, triangles, pinned = strip(mesh, cells)
    if flip:
        triangles[::3] = triangles[::3][:, [0, 2, 1]]
    f, free = np.zeros(len(points)), ~pinned
    np.add.at(f, triangles.ravel(), np.repeat(topology.triangle_areas(points, triangles) / 3.0, 3))
    u = np.linalg.solve(stiffness(points, triangles, pinned, alone)[np.ix_(free, free)], f[free])
    tip = points[free, 0] > points[:, 0].max() - 0.2 * LENGTH / cells
    return float(u[tip].mean() / (LENGTH**4 / 8.0))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--json")
    args, rows = parser.parse_args(), []
    print(f"{'mesh':12} {'energy':12} " + "  ".join(f"{n:>2} cells" for n in CELLS))
    for mesh in MESHES:
        for alone in (False, True):
            found = [drop(mesh, n, alone) for n in CELLS]
            rows.append({"mesh": mesh, "energy": "hinges alone" if alone else "curvatures", "cells": list(CELLS),
                         "drop": [round(value, 5) for value in found]})
            print(f"{mesh:12} {rows[-1]['energy']:12} " + "  ".join(f"{value:8.4f}" for value in found))
    if args.json:
        with open(args.json, "w", encoding="utf-8") as file:
            json.dump(rows, file, indent=1)


if __name__ == "__main__":
    main()
