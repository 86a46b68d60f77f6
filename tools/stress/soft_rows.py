"""Abuse of soft bodies, as rows.py has that of cloth. A bar of 4 x 2 x 2 cells hangs along y from its upper face.

What has more than 5 % static strain hangs without weight, as cloth does; its drag is what its slowest motion calls for. The
bounds count tets by volume, and strain is that of `tools.stress.solids`.
"""

from functools import partial
from math import sqrt

import numpy as np

from tools.stress import acts
from tools.stress.acts import away, ball, once, placed, thrown
from tools.stress.rows import DEFORMED, Row
from tools.stress.scenes import G, moving
from wsim.scene import Plane, Scene, Sphere, shapes
from wsim.scene.curve import Motion
from wsim.scene.solid import Bulk

SIDE, HEIGHT, CELLS = 0.2, 0.4, (2, 4, 2)         # [m], [m], of the bar
DENSITY, YOUNG = 1e3, 1e6                         # [kg/m^3], [Pa] where a row does not say
MASS, VOLUME = DENSITY * SIDE * SIDE * HEIGHT, SIDE * SIDE * HEIGHT
SOLVERS = ("auto", "implicit", "explicit")        # XPBD has no tetrahedra
UPRIGHT = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
MODELS = ("corotational", "neo_hookean")
HEAPS = ("nearly one place", "scrambled", "scrambled wide", "shuffled")      # without any orientation of their own
ELSEWHERE = {("*", "strain"): "the corotational energy has other minima, and 3 of 32 heaps end in one (Neo-Hookean: none of "
             "32): there its forces vanish (1e-5 of the weight), its stiffness is positive, and no tet is inverted (least "
             "det F 0.29), by NumPy"}


def bar(young: float = YOUNG, nu: float = 0.3, model: str = "corotational", *, gravity: float = G, held: bool = True,
        at=(0.0, 0.0, 0.0), flat: float = 1.0, **more) -> Scene:
    """flat: its size along z over SIDE."""
    scene = Scene(gravity=(0.0, -gravity, 0.0), **({"fps": 60.0} | more))
    points, tets = shapes.block((SIDE, HEIGHT, SIDE * flat), CELLS)
    body = scene.soft("/bar", points, tets, material=Bulk(young, nu, DENSITY, model), motion=Motion.at_place(at))
    if held:
        scene.pin("/pin", body, np.flatnonzero(points[:, 1] > 0.49999 * HEIGHT))
    return scene


def static(young: float) -> float:
    """Strain at its upper face under its own weight; 0 for what hangs without."""
    strain = DENSITY * G * HEIGHT / young
    return strain if strain < 0.05 else 0.0


def hung(young: float = YOUNG, nu: float = 0.3, model: str = "corotational", **more) -> Scene:
    return bar(young, nu, model, gravity=G if static(young) else 0.0, **more)


def frequency(young: float, width: float = SIDE) -> float:
    """Lowest [rad/s]: bending of a clamped beam, 3.52 sqrt(E I / rho A) / L^2 (Timoshenko); a coarse mesh has no lower one."""
    return 3.52 * sqrt(young / DENSITY / 12.0) * width / HEIGHT**2


def fading(young: float) -> dict:
    """Drag and frames by which the slowest motion fades to (1 + 10) exp(-10) and less, in two thirds of the time."""
    w = frequency(young)
    drag = min(10.0, 2.0 * w)
    return {"drag": drag, "frequency": w, "settle": round(60.0 * 15.0 / (0.5 * drag)), "solvers": SOLVERS, "soft": True,
            "static": static(young)}


# where points go

def inside_out(x, rng):
    """Mirrored at the held face: every tet has the volume -V."""
    top = x[:, 1].max()
    return x * (1.0, -1.0, 1.0) + (0.0, 2.0 * top, 0.0)


def turned(x, rng):
    """Mirrored across itself."""
    return x * (-1.0, 1.0, 1.0)


def to_plane(x, rng):
    return x * (1.0, 1.0, 0.0)


def wide(x, rng):
    """Twice its height at random."""
    return x.mean(axis=0) + 2.0 * HEIGHT * rng.uniform(-0.5, 0.5, x.shape)


SCATTERS = (("one place", acts.one_place), ("nearly one place", acts.nearly_one_place), ("to a plane", to_plane),
            ("scrambled", acts.scrambled), ("scrambled wide", wide), ("shuffled", acts.shuffled), ("inside out", turned),
            ("pulled through", inside_out))


# scenes

def uneven() -> Scene:
    """Masses between 1 mg and 1 kg side by side."""
    scene = bar(gravity=0.0)
    scene.softs[0].masses = (10.0 ** np.random.default_rng(3).uniform(-6.0, 0.0, len(scene.softs[0].points))).astype(np.float32)
    return scene


def loaded(ratio: float, last: bool) -> Scene:
    """The lowest points (or those below the pin) are so many times as heavy as the others; the load strains the bar by 1 %."""
    scene = bar()
    soft = scene.softs[0]
    row = -0.5 * HEIGHT if last else 0.25 * HEIGHT
    heavy = np.abs(soft.points[:, 1] - row) < 1e-6
    share = 0.01 * YOUNG * SIDE * SIDE / G / heavy.sum()
    soft.masses = np.where(heavy, share, share / ratio).astype(np.float32)
    return scene


def with_ball(at) -> Scene:
    scene = bar()
    scene.collider("/ball", Sphere(0.12), at=at)
    return scene


def with_plane(height: float) -> Scene:
    scene = bar()
    scene.collider("/ball", Plane(), motion=placed_plane(height))
    return scene


def placed_plane(height: float) -> Motion:
    """A ground at this height [m]."""
    M = UPRIGHT.copy()
    M[1, 3] = height
    return Motion.still(M)


def plane(heights, run, frame: int) -> bool:
    """The ground is at one height, then at the other, five frames each."""
    if frame % 5:
        return False
    run.set("/ball", "motion", placed_plane(heights[frame // 5 % len(heights)]))
    return True


def lowered(run, frame: int, then) -> bool:
    if frame == acts.LAST:
        run.set("/ball", "motion", placed_plane(-5.0))
        return True
    return then(run, frame)


def yanked(speed: float, seconds: float) -> Scene:
    """The held face goes sideways at `speed` [m/s] for so long, and stops dead."""
    scene = bar()
    scene.pins[0].motion = moving([(0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, speed * seconds)], [0.0, 0.2, 0.2 + seconds])
    return scene


# the table

def _stiffness() -> list[Row]:
    rows = []
    for decade in range(2, 12):
        E = 10.0**decade
        rows.append(Row(f"soft 1e{decade}", f"a bar of 1e{decade} Pa, stretched by a tenth and let go", partial(hung, E),
                        act=partial(once, partial(placed, acts.stretched)), **fading(E)))
    for model in MODELS:
        rows.append(Row(f"soft nu 0.49, {model}", "nearly incompressible, stretched by a tenth and let go",
                        partial(hung, nu=0.49, model=model), act=partial(once, partial(placed, acts.stretched)),
                        **fading(YOUNG)))
    return rows


def _masses() -> list[Row]:
    common = fading(YOUNG) | {"static": 0.01}
    rows = [Row("soft uneven", "masses of 1 mg to 1 kg side by side, stretched", uneven,
                act=partial(once, partial(placed, acts.stretched)), **common | {"static": 0.0})]
    for ratio in (1e3, 1e6):
        rows += [Row(f"soft heavy {name} {ratio:.0e}", f"{ratio:g} times the mass at {where} of the bar",
                     partial(loaded, ratio, name == "last"), **common | {"settle": 600})
                 for name, where in (("last", "the lower end"), ("first", "the top"))]
    return rows


def _times() -> list[Row]:
    rows = []
    for fps, substeps, frames, settle in ((10, 10, 20, 40), (10, 1, 20, 40), (100, 10, 100, 300), (1000, 1, 200, 800),
                                          (10000, 1, 300, 700)):
        rows.append(Row(f"soft dt 1/{fps} x {substeps}", f"frames of 1/{fps} s of {substeps} substeps",
                        partial(hung, fps=fps, substeps=substeps), frames=frames,
                        act=partial(once, partial(placed, acts.stretched)), **fading(YOUNG) | {"settle": settle}))
    return rows


def _shapes() -> list[Row]:
    rows = []
    for name, where in SCATTERS:
        for model in MODELS:
            rows.append(Row(f"soft {name}, {model}", f"free points of a hanging bar: {name}", partial(hung, model=model),
                            act=partial(once, partial(placed, where)), **fading(YOUNG) | {"settle": 300},
                            listed=DEFORMED | (ELSEWHERE if model == "corotational" and name in HEAPS else {})))
    rows.append(Row("soft scrambled, nu 0.49", "scattered over 0.5 m, nearly incompressible", partial(hung, nu=0.49),
                    act=partial(once, partial(placed, acts.scrambled)), listed=DEFORMED, **fading(YOUNG) | {"settle": 300}))
    # a plate of 0.2 mm bends as slowly as it is thin; what hangs straight swings as a pendulum
    thin = fading(YOUNG) | {"frequency": sqrt(G / HEIGHT), "settle": 300, "static": static(YOUNG)}
    rows += [
        Row("soft slivers 1:1000", "a bar pressed to 0.2 mm: tets of 1 to 1000, at rest", partial(bar, flat=1e-3), **thin),
        Row("soft slivers 1:1000, stretched", "the same, stretched by a tenth and let go", partial(bar, flat=1e-3),
            act=partial(once, partial(placed, acts.stretched)), **thin),
    ]
    return rows


def _colliders() -> list[Row]:
    common = fading(YOUNG) | {"listed": {("sdirk3", "refusal"): "the check says that it rebounds from colliders"}}
    pushed = 12.0 * 1.35 * 0.5 * YOUNG * VOLUME * 3.0
    out = ("what comes out of a solid is moved by 0.24 m at most, a bar's thickness: no direction strains by more than 1, so "
           "stored is at most 1/2 (lam + 2 mu) V 3, lam + 2 mu = 1.35 E; it lets go 12 times")
    there, back, inside, gone = (0.0, -0.1, 0.3), (0.0, -0.1, -0.3), (0.0, -0.1, 0.02), (0.0, 0.0, 5.0)
    return [
        Row("soft through", "a ball jumps from one side of the bar to the other every 5 frames", partial(with_ball, there), out,
            pushed, partial(away, then=partial(ball, (back, there))), **common),
        Row("soft ball inside", "a ball appears in the bar and is gone again", partial(with_ball, gone), out, pushed,
            partial(away, then=partial(ball, (inside, gone))), **common),
        Row("soft ground inside", "the ground jumps to the middle of the bar and away", partial(with_plane, -5.0), out, pushed,
            partial(lowered, then=partial(plane, (0.0, -5.0))), **common),
    ]


def _motions() -> list[Row]:
    galilei = "a carrier that moves at V and stops: in its frame nothing is added, so speeds grow by 2 V: 1/2 M (2 V)^2"
    free = fading(YOUNG) | {"static": 0.0, "settle": 300}
    far = (1000.0, 300.0, -700.0)
    rows = [
        Row("soft yanked", "the held face jumps to 100 m/s for 0.1 s and stops", partial(yanked, 100.0, 0.1), galilei,
            2.0 * MASS * 100.0**2, listed=DEFORMED, **fading(YOUNG) | {"settle": 300}),
        Row("soft gravity", "gravity turns round each frame", hung, act=acts.upside_down, **fading(YOUNG)),
        Row("soft 1 km/s, free", "every point of a free bar thrown at 1 km/s", partial(bar, gravity=0.0, held=False),
            act=partial(once, partial(thrown, 1e3)), momentum=1e-4, listed=DEFORMED, **free),
        Row("soft float", "every point of a free bar thrown at 1 m/s: momentum stays", partial(bar, gravity=0.0, held=False),
            act=partial(once, partial(thrown, 1.0)), frames=300, momentum=2e-5, **free),
        Row("soft far", "a hanging bar 1.3 km from the origin, thrown at 1 m/s", partial(hung, at=far),
            act=partial(once, partial(thrown, 1.0)), level=(far[0], far[1] - 2.0, far[2]), **fading(YOUNG)),
    ]
    rest = fading(YOUNG) | {"settle": 400}
    rows += [Row("soft rest", "a hanging bar at rest", hung, rest=2000, seconds=120.0, **rest),
             Row("soft rest, far", "a hanging bar at rest 1.3 km from the origin", partial(hung, at=far), rest=500,
                 level=(far[0], far[1] - 2.0, far[2]), **rest),
             Row("soft rest, 1e11", "a bar of 1e11 Pa at rest, by Newton steps", partial(hung, 1e11), rest=300,
                 **fading(1e11) | {"settle": 200})]
    return rows


ROWS: list[Row] = [*_stiffness(), *_masses(), *_times(), *_shapes(), *_colliders(), *_motions()]
