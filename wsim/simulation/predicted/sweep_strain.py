"""Strain that unfinished XPBD sweeps leave in the edges of a cloth that hangs from a line through it.

A sweep takes back all that one edge is too long by, C [m]; the pull at its two points brings it back until the next. So M
sweeps of a step h carry a force F along an edge of length l once (first line of kernels/solver/xpbd.py, without compliance)

    C = F h^2 (w0 + w1) / M

and the lag strains the edge by C / l, besides what the material gives. A cloth of mass m and extent L that a line holds, by
pins or by friction along a collar, pulls there with m g / L on each metre; an edge carries A / l metres of it, A the area of
its two triangles:

    strain = g h^2 q / M,    q = m / L max (w0 + w1) A / l^2   [1/m]

Square cells of a side L / N: q = 2 N^2 / L (up to 3.5 near corners, whose masses are small), the displacement of
`wsim.simulation.predicted.errors.slack_of_sweeps` spread over the rows. Edges much shorter than their triangles are wide, as in
the seams of a garment, lag far more than any displacement tells: l is small, and the masses are those of wide triangles.

Measured over this: 0.74 in a seam below a pinned edge (membranes, one sweep; four 0.6; springs, which several constraints
hold, 0.25); 0.7 to 1 in the collar of a shirt of 6436 points, 96 to 384 substeps x 1, where fewer edges carry more.
"""

import numpy as np

from wsim.geometry import topology
from wsim.model.model import Model, PointBody, hard_places
from wsim.physics.cloth.constraints import of_body
from wsim.scene.integrator import TABLE, Integrator
from wsim.scene.methods import has_tets

LOADED = 0.1           # strain that sweeps may leave in a cloth under particles, by the estimate; measured: 2 times as much
UNEVEN = 1e3           # ratio of two masses that hold each other, from which sweeps stall


def sweep_lag(model: Model, falls: list) -> float:
    """Strain over h^2 / M, g q [1/s^2], largest of all cloths. falls: `wsim.simulation.predicted.errors.falling_bodies`."""
    bodies, pinned = [b for b in model.bodies if b.world == 0 and len(b.edges)], hard_places(model)
    return max((f.g * slenderness_of_cloth(b, pinned, f.size) for b, f in zip(bodies, falls, strict=True)
                if b.source.is_sheet),
               default=0.0)


def slenderness_of_cloth(body: PointBody, pinned: np.ndarray, size: float) -> float:
    """q [1/m] of a cloth; 0 without an edge between two triangles. pinned: places in the arrays, which do not move; size: L."""
    hinges = topology.hinges_of_triangles(body.triangles - body.first)
    p, w = body.rest, np.divide(1.0, body.masses, out=np.zeros(body.count), where=body.masses > 0.0)
    w[pinned[(pinned >= body.first) & (pinned < body.last)] - body.first] = 0.0
    area = topology.triangle_areas(p, hinges[:, [0, 1, 2]]) + topology.triangle_areas(p, hinges[:, [0, 1, 3]])
    square = ((p[hinges[:, 1]] - p[hinges[:, 0]])**2).sum(axis=1)
    found = (w[hinges[:, 0]] + w[hinges[:, 1]]) * np.divide(area, square, out=np.zeros(len(area)), where=square > 0.0)
    return float(body.masses.sum()) / size * float(found.max(initial=0.0))


def strain_left(model: Model, falls: list, choice) -> float:
    """Strain that the sweeps of a `wsim.simulation.choice.SchemeChoice` leave; 0 of other solvers."""
    if choice.solver != "xpbd":
        return 0.0
    return sweep_lag(model, falls) / (model.scene.fps * choice.substeps)**2 / choice.iterations


def masses_are_uneven(model: Model) -> bool:
    """True if free masses that hold each other differ by more than UNEVEN."""
    pinned = hard_places(model)
    for body in (b for b in model.bodies if b.world == 0):
        masses = body.masses.copy()
        masses[pinned[(pinned >= body.first) & (pinned < body.last)] - body.first] = np.nan
        for r in of_body(model, body):
            held = masses[r.ids - body.first]
            if np.any(np.nanmax(held, axis=1, initial=0.0) > UNEVEN * np.nanmin(held, axis=1, initial=np.inf)):
                return True
    return False


def solver_for_particles(model: Model) -> tuple[str, Integrator, str]:
    """Solver, integrator and reason for a scene with particles: Newton steps take turns with their constraints where there are
    soft bodies, and where sweeps would leave a cloth strained under all of them."""
    scene, euler = model.scene, TABLE["backward_euler"]
    if has_tets(scene):
        return "implicit", euler, "Newton steps of soft bodies take turns with constraints that move particles"
    path, left = strain_under_particles(model)
    if scene.solver == "auto" and left > LOADED:
        return "implicit", euler, f"sweeps would leave {path} strained by {left:.2g} under particles: Newton steps bear them"
    return ("implicit" if scene.solver == "implicit" else "xpbd"), euler, "constraints move particles"


def strain_under_particles(model: Model) -> tuple[str, float]:
    """(path, strain) of the cloth in which the scene's sweeps leave most, if all particles lie on it: g q h^2 / iterations,
    with their mass in q. ("", 0) where there is none."""
    scene, pinned, found = model.scene, hard_places(model), ("", 0.0)
    own = [b for b in model.bodies if b.world == 0]
    load = sum(float(b.masses.sum()) for b in own if b.source.is_particles)
    h = 1.0 / (scene.fps * scene.substeps)
    for body in (b for b in own if b.source.is_sheet and len(b.triangles)):
        size = float(np.ptp(body.rest, axis=0).max())
        q = slenderness_of_cloth(body, pinned, size) * (1.0 + load / float(body.masses.sum()))
        found = max(found, (body.path, float(np.linalg.norm(scene.gravity)) * q * h * h / scene.iterations), key=lambda f: f[1])
    return found
