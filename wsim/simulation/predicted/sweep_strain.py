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

A load that lies on a cloth or net which is held around it pulls across it: W = m g on a width L pulls by T = W / (4 s L) on
each metre around, where s is the slope, which the strain itself makes: s^2 = 2 strain. With a load on 0.35 of the width that is

    strain = (LYING g h^2 q / M)^(2/3),    LYING = 1 / (4 sqrt(2) 0.35)

Measured over this at rest, of cloths and nets in `tools/results/position_based.md`: 0.6 to 1.4; as grains land, twice as much.
Measured over that of hanging cloths: 0.74 in a seam below a pinned edge (membranes, one sweep; four 0.6; springs, which several
constraints hold, 0.25); 0.7 to 1 in the collar of a shirt of 6436 points, 96 to 384 substeps x 1, where fewer edges carry more.
"""

from collections.abc import Iterator

import numpy as np

from wsim.geometry import topology
from wsim.model.model import Model, PointBody, hard_places
from wsim.physics.cloth.constraints import of_body
from wsim.scene.integrator import TABLE, Integrator
from wsim.scene.methods import has_tets

LOADED = 0.1           # strain that sweeps may leave in a cloth under particles, by the estimate
OPENED = 0.06          # the same of a net: at 0.085 two nets let their grains through, at 0.06 they held
LYING = 0.5            # pull across a cloth that is held around a load, see above
DOUBLED = 10           # times that substeps are doubled in a warning, at most
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


def strain_under_particles(model: Model, h: float = 0.0, iterations: int = 0) -> tuple[str, float]:
    """(path, strain) of the cloth in which sweeps leave most with all particles on it: see above, with their mass in q, times
    what damping slows sweeps by, 1 + tau / h. h, iterations: of the scene where they are 0. ("", 0) where there is no cloth."""
    scene, pinned = model.scene, hard_places(model)
    h, iterations = h or 1.0 / (scene.fps * scene.substeps), iterations or scene.iterations
    return max(((body.path, strain) for body, strain in _loaded_strains(model, h, iterations, pinned) if body.source.is_sheet),
               key=lambda found: found[1], default=("", 0.0))


def _loaded_strains(model: Model, h: float, iterations: int, pinned: np.ndarray) -> Iterator[tuple[PointBody, float]]:
    """Bodies of the first world that have triangles or springs, each with the strain that sweeps leave under all particles."""
    own = [b for b in model.bodies if b.world == 0]
    load, g = sum(float(b.masses.sum()) for b in own if b.source.is_particles), float(np.linalg.norm(model.scene.gravity))
    taus: dict[str, float] = {}
    for r in model.constraints:
        if r.body is not None:
            taus[r.body.path] = max(taus.get(r.body.path, 0.0), r.tau)
    for body in own:
        if load > 0.0 and (body.source.is_sheet and len(body.triangles) or body.source.is_net and len(body.edges)):
            size = float(np.ptp(body.rest, axis=0).max())
            q = slenderness_of_cloth(body, pinned, size) if body.source.is_sheet else slenderness_of_net(body, pinned, size)
            q *= 1.0 + load / float(body.masses.sum())
            hangs = g * q * h * h / iterations * (1.0 + taus.get(body.path, 0.0) / h)
            yield body, max(hangs, (LYING * hangs) ** (2 / 3))


def slenderness_of_net(body: PointBody, pinned: np.ndarray, size: float) -> float:
    """q [1/m] of a net whose springs share a square of its size L evenly: a spring of length l carries the width
    2 L^2 / sum(l) of a cut through it, L at most."""
    w = np.divide(1.0, body.masses, out=np.zeros(body.count), where=body.masses > 0.0)
    w[pinned[(pinned >= body.first) & (pinned < body.last)] - body.first] = 0.0
    a, b = (body.edges - body.first).T
    length = np.linalg.norm(body.rest[b] - body.rest[a], axis=1)
    width = min(2.0 * size * size / max(float(length.sum()), 1e-30), size)
    found = (w[a] + w[b]) * np.divide(width, length, out=np.zeros(len(length)), where=length > 0.0)
    return float(body.masses.sum()) / size * float(found.max(initial=0.0))


def warn_of_loaded_strain(model: Model, choice) -> list[str]:
    """A warning for each cloth or net that the sweeps of a `wsim.simulation.choice.SchemeChoice` leave strained by more than
    LOADED under all particles, (of a net: OPENED), with the substeps that leave that."""
    if choice.solver != "xpbd" or not any(b.source.is_particles for b in model.bodies):
        return []
    fps, pinned, found = model.scene.fps, hard_places(model), []
    strains = {n: {b.path: (b, strain) for b, strain in _loaded_strains(model, 1.0 / (fps * n), choice.iterations, pinned)}
               for n in (choice.substeps * 2**k for k in range(DOUBLED))}
    for path, (body, strain) in strains[choice.substeps].items():
        most = LOADED if body.source.is_sheet else OPENED
        if strain > most:
            enough = next((n for n, of in strains.items() if of[path][1] <= most), 0)
            fixes = ['solver="implicit" (in USD wsim:solver)'] * body.source.is_sheet + [f"{enough} substeps"] * bool(enough)
            found.append(f"warning: {path}: {choice.substeps} substeps of {choice.iterations} iterations leave it strained by "
                         f"about {strain:.2g} with all particles at rest on it; expected: {most:g} or less; fix: give "
                         f"{' or '.join([*fixes, 'lighter particles'])}")
    return found
