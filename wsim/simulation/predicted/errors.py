"""RMS error [m] that each solver is predicted to leave after a fall through a body's size L, T = sqrt(2 L / g), before any is
run: with steps h, tau = sqrt(L / g), omega the highest frequency of the scene,

    leapfrog           LEAP g h^2, of what the air moves LEAP (g + a) (1 + c T) h^2 (`acceleration_by_air`), and what float32
    rounds; on
                       colliders HIT h sqrt(g L), met at some time of a step; SLIVERS L where slivers have more mass
    backward Euler     DRIFT h sqrt(g L) on what falls and swings, EULER on colliders
    XPBD               that of backward Euler, and what M sweeps over N springs in a row leave: `swept_error`
    BDF2, one Newton   SECOND g h^2 and TURNED (omega h)^2 h sqrt(g L): an edge that turns in a step strains by the square
    step               of its turn, which the next step takes back; drag of the air and colliders leave order 1
    sdirk3             of soft bodies, two Newton steps: THIRD g h^2

Measured over this, where nothing is hit and it is below 0.1 L (tools/results/data/choice_newton_cpu.json, newton_h100.json):
leapfrog 0.02 to 1.7, XPBD 0.2 to 1.03, BDF2 0.2 to 1.3. More err sheets that wrinkle on a collider, BDF2 that gives way as its
residual is missed (3.8 times, 48 points a side, 5 kN/m), and a cube on a stretched sheet whose points it shares (7 times).
What flutters is not predicted.
"""

from dataclasses import dataclass

import numpy as np

from wsim.geometry.topology import triangle_areas
from wsim.model.model import Model, PointBody, edge_lengths
from wsim.scene.methods import has_collisions, has_self_collision, has_tets, method_colliders

DRIFT = 2.0            # RMS error of converged backward Euler over h sqrt(g L). 1 m cloth at 0.5 s, h of 1/240 to 1/960 s: 1.5
                       # to 2.1 (at 0.25 s 0.26: it grows with time)
HIT = 1.0              # as DRIFT, of leapfrog on colliders: cubes that fall on a floor 0.1 to 1.4, a cloth on a ball 0.8
SWEPT = 0.084          # error over L (h / tau)^1.5 N^2 / M, tau = sqrt(L / g), that M sweeps leave to a cloth that swings, N
                       # springs a side: 16 and 32, 1 kN/m and 100 kN/m, 10 x 4 to 40 x 4: within 15 % of it at 0.5 s
ONE = 1.5              # times that where one sweep is all, which is not over-relaxed
SOFT = 0.4             # a sweep moves a mass by half of what a spring lacks: N springs in a row lack 2 N g h^2 / M at the top,
                       # N^2 g h^2 / M in all. Chains of 20 and 40 springs, M 4 and 8: 0.30 to 0.36 of that, M 1 0.50; cloths
                       # of 32 and 64 points a side 0.24 to 0.40 (over-relaxed sweeps)
FALL = 9.81            # [m/s^2] where a scene has no gravity: something else moves it, of which nothing is known
EULER = 4.0            # as DRIFT, of backward Euler on colliders: a soft cloth on a ball 1, a soft cube that falls on a floor
                       # 4; a stiff one, which it does not let rebound, and a cloth that wrinkles 13 to 20, whatever the step
SLOWED = 2.0           # a square metre of cotton by two corners, tau 0.3 ms, h 0.5 ms: 2.5 times what is said without it
DRAGGED = 0.5          # error over c L h of BDF2 in air that slows by c [1/s]: that cloth, 40 steps: below 0.6
LEAP = 1.5             # nets and sheets of 16 to 40 points a side, 18 to 60 substeps of 1/24 s: 1.2 to 1.5
ROUNDED = 1e-5         # error over L that float32 leaves: 2e-6 to 1e-5 where leapfrog's own is less
SLIVERS = 2e-3         # error over L that mass at slivers adds: the shirt, hung, after three frames, beside what float32 leaves
SECOND, TURNED = 18.0, 2e-4
THIRD = 0.6            # bars of 2 to 8 cells across, 5 and 10 steps: 0.26 to 0.65


@dataclass(frozen=True)
class FallingBody:
    """A body that falls and swings."""

    size: float                              # L, its largest extent [m]
    row: float                               # N, springs one behind the other through it
    g: float                                 # [m/s^2]
    tau: float = 0.0                         # longest relaxation time of what holds it [s]


def falling_bodies(model: Model) -> list[FallingBody]:
    """Fall heights of every body with edges."""
    found, taus = [], dict[str, float]()
    for r in model.constraints:
        if r.body is not None:
            taus[r.body.path] = max(taus.get(r.body.path, 0.0), r.tau)
    for body in (b for b in model.bodies if b.world == 0 and len(b.edges)):
        g = float(np.linalg.norm(model.scene.gravity)) + _acceleration_by_loads(model, body) or FALL
        size = max(extent_of_body(body), 1e-9)
        found.append(FallingBody(size, size / max(float(edge_lengths(body).mean()), 1e-9), g, taus.get(body.path, 0.0)))
    return found


def drift_error(bodies: list[FallingBody], h: float, factor: float = DRIFT) -> float:
    """RMS error [m] of steps h [s] of a method of order 1, after T: see DRIFT, EULER and HIT."""
    return max((factor * h * (b.g * b.size)**0.5 for b in bodies), default=0.0)


def swept_error(bodies: list[FallingBody], h: float, iterations: int) -> float:
    """Error that unfinished sweeps add [m]: bodies that hang longer than they are, and swing slower. Damping slows sweeps by
    1 + tau / h, of which SLOWED at most is looked for in more substeps, which it slows the more."""
    factor = SWEPT * (ONE if iterations == 1 else 1.0)
    swings = (factor * b.size * (h * (b.g / b.size)**0.5)**1.5 * b.row**2 / iterations * min(1.0 + b.tau / h, SLOWED)
              for b in bodies)
    return max(slack_of_sweeps(bodies, h, iterations), *swings, 0.0)


def slack_of_sweeps(bodies: list[FallingBody], h: float, iterations: int) -> float:
    """Length [m] by which so many sweeps of a step h [s] leave hanging bodies longer than they are: see SOFT."""
    return max((SOFT * b.g * h * h * b.row**2 / iterations for b in bodies), default=0.0)


def _acceleration_by_loads(model: Model, body) -> float:
    """Largest acceleration [m/s^2] that loads give a body as a whole."""
    if not model.scene.loads:
        return 0.0
    from wsim.scene.nodal.loads import nodal_load_shares
    return sum(float(np.linalg.norm(load.curve.values, axis=1).max() * np.abs(nodal_load_shares(load, body)[1]).sum())
               for load in model.scene.loads if load.body == body.path) / float(body.masses.sum())


def size_of_model(model: Model) -> float:
    """Largest extent of a body [m]; at least 1 mm."""
    return max(1e-3, *map(extent_of_body, model.bodies))


def extent_of_body(body: PointBody) -> float:
    """Largest extent [m] of the points that are not idle."""
    moved = np.delete(body.places, body.idle - body.first, axis=0)
    return float(np.ptp(moved, axis=0).max()) if len(moved) else 0.0


def leapfrog_error(model: Model, bodies: list[FallingBody], h: float) -> float:
    """Error of leapfrog where it is stable [m]."""
    hit = drift_error(bodies, h, HIT) if has_collisions(model.scene) else 0.0
    own = max((LEAP * (b.g + a) * (1.0 + c * (2.0 * b.size / b.g)**0.5) * h * h
               for b, (a, c) in zip(bodies, acceleration_by_air(model), strict=True)), default=0.0)
    return own + ROUNDED * size_of_model(model) + hit


def drag_error(model: Model, bodies: list[FallingBody], h: float, more: float = 0.0) -> float:
    """Error [m] of the drag that fabrics have of their own, and of further drag [1/s], which are of order 1."""
    rate = more + max((normal_decay(b) for b in model.bodies if b.world == 0), default=0.0)
    return DRAGGED * rate * h * max((b.size for b in bodies), default=0.0)


def acceleration_by_air(model: Model) -> list[tuple[float, float]]:
    """Acceleration a [m/s^2] that the wind gives each body of `falling_bodies`, and the rate c [1/s] at which the air takes the
    body with it, of quadratic drag 2 a / speed: what sways in it errs by 1 + c T of what hangs."""
    found, scene = [], model.scene
    speed = float(np.linalg.norm(scene.wind))
    for body in (b for b in model.bodies if b.world == 0 and len(b.edges)):
        air = body.source.air
        c = scene.air_density * speed * (air["drag"] + air["lift"]) * _area_by_mass(body) if body.source.is_sheet else 0.0
        own = normal_decay(body)
        found.append(((0.5 * c + own) * speed, c + own))
    return found


def normal_decay(body: PointBody) -> float:
    """Rate [1/s] at which the normal drag of its material slows a body."""
    c = body.source.air["normal_drag"]
    return c * _area_by_mass(body) if c else 0.0


def _area_by_mass(body: PointBody) -> float:
    """[m^2/kg]."""
    return float(triangle_areas(body.rest, body.triangles - body.first).sum()) / float(body.masses.sum())


def backward_euler_error(model: Model, bodies: list[FallingBody], h: float, sweeps: int = 0) -> float:
    """Error of backward Euler [m]; sweeps: of XPBD, 0 where it is solved."""
    return drift_error(bodies, h,
                       EULER if has_collisions(model.scene) else DRIFT) + (swept_error(bodies, h, sweeps) if sweeps else 0.0)


def newton_error(model: Model, bodies: list[FallingBody], h: float, name: str, omega: float) -> float:
    """Error of Newton's method with that integrator [m], of sheets one Newton step a system. h: of a step."""
    if name not in ("bdf2", "sdirk3"):
        return backward_euler_error(model, bodies, h)
    scene = model.scene
    flown = any(body.drag or body.lift for body in scene.bodies())
    first = drift_error(bodies, h, EULER) if has_collisions(scene) else drift_error(bodies, h) if flown else \
        drag_error(model, bodies, h, scene.air_drag)
    own = max(((THIRD if name == "sdirk3" else SECOND) * b.g * h * h for b in bodies), default=0.0)
    turned = 0.0 if has_tets(scene) else TURNED * (omega * h)**2 * drift_error(bodies, h, 1.0)
    return own + first + turned


def newton_known(model: Model) -> bool:
    """False where the table does not know Newton's method of sheets: limits and tethers, surfaces that meet themselves, rigid
    bodies that points touch; and where edges of a cloth meet sharp colliders, which that method leaves out."""
    scene = model.scene
    if any(r.hard for r in model.constraints) or method_colliders(scene) or has_self_collision(scene):
        return False
    if not scene.colliders:
        return True
    from wsim.scene.check.sharp import has_edge_contacts
    return not has_edge_contacts(scene)
