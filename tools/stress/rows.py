"""The abuse, one row each: a scene, what is done to it, and the bounds that follow. See judge.py for what is held.

`energy` says why the work done from outside is at most `work` [J]; what acts change at one state is measured (run.py).
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from math import exp, pi, sqrt

from tools.stress import acts, judge, scenes
from tools.stress.acts import away, ball, once, placed, thrown
from tools.stress.scenes import CELLS, DENSITY, EDGE, MASS, SIDE, STRETCH, G, hung, sheet, static, with_ball
from wsim.scene import Scene

BENDING = 3.5 * sqrt(1e-5 / DENSITY) / SIDE**2        # [rad/s] of a clamped strip (Timoshenko); a bent free sheet stays bent
CLOSED = "closed system: friction, air and implicit steps only take energy away"
UNEVEN = "sweeps carry a weight only by stretch: C >= (M / m) g h^2 / iterations, see judge.sweeps_leave"
FAR = ("the step of an explicit solver is chosen at rest: a spring far from it pulls across, too, with k (1 - L / l), up to k "
       "when long and -k L / l when short, which that step does not resolve")
DEFORMED = {("explicit", kind): FAR for kind in ("energy", "strain", "refusal")}
COLLAPSED = ("the angle of a hinge jumps by pi where a triangle collapses to a line: scattered, a way on costs 1/2 bend pi^2,"
             " 5 kJ and more, and Newton steps never go uphill: they stay where they are (in float64 too)")
SHORT = ("sweeps carry a load F over an edge of length l by a strain F h^2 (w0 + w1) / l / iterations, see "
         "wsim.simulation.predicted.sweep_strain: 0.6 in the edges of 1 mm, at most, by 15 substeps of one sweep")
ROUND = ("sweeps may end in a cycle of crumpled states, where single hinges hold more than the sheet: 6 of 24 scatters, at 0.1 "
         "to 0.16, and SDIRK3, which damps it less, leaves 0.005 in 5. Where hinges share angles as they are it is 5 of 16 "
         "and 8 of 16: rounding decides which")
WALK = ("the midpoint damps nothing by itself: what float32 rounds off each step, 4e-9 m, walks up until the drag of the row "
        "takes as much away, to 3e-4 m/s (float64: 7e-7 m/s); places do not drift")
SLOW = "beyond the explicit limit: damping by tau omega^2 = 7e6 / s of the fastest mode asks for steps of 1.3e-7 s"
SWING = sqrt(G / SIDE)                # [rad/s] slowest motion of a hanging sheet, that of a pendulum of its height


@dataclass(frozen=True)
class Row:
    name: str
    what: str                                    # the abuse
    scene: Callable[[], Scene]
    energy: str = CLOSED                         # why `work` bounds what comes from outside
    work: float = 0.0                            # [J]
    act: Callable | None = None                  # act(run, frame) before each abused frame; whether it changed anything
    frames: int = 60                             # abused
    settle: int = 180                            # then, with `drag`
    rest: int = 0                                # and then watched for drift and jitter
    drag: float = 10.0                           # [1/s] decay of velocities while settling, twice SWING
    static: float = 0.0                          # strain under its own weight
    frequency: float = SWING                     # [rad/s] slowest motion that strains; 0: a free net stays bent
    edges: int = CELLS                           # from the pins down, for what sweeps leave
    edge: float = EDGE                           # [m]
    level: tuple = (0.0, -2.0, 0.0)              # [m] where gravity's energy is zero: below everything
    momentum: float = 0.0                        # bound on its relative change; 0: forces act from outside
    recovers: bool = True                        # False: there is no rest length to come back to
    seconds: float = 60.0                        # limit on the time of all frames
    soft: bool = False                           # a soft body: strain of tets by volume, nothing is promised to be left
    solvers: tuple[str, ...] = ()                # those that have what it takes; (): all
    creep: float = 0.0                           # [s] relaxation time of stresses, where the material damps
    listed: dict = field(default_factory=dict)   # (solver, integrator, both or "*"; kind of fault) -> reason, beforehand

    def faded(self, seconds: float) -> float:
        """What is left of a strain after settling for so long."""
        return max(judge.decay(self.frequency, self.drag, seconds), exp(-seconds / self.creep) if self.creep else 0.0)

    def reasons(self, solver: str, integrator: str) -> dict[str, str]:
        """Of all, of this solver or of this integrator: kind of fault -> reason."""
        return {kind: why for (name, kind), why in self.listed.items()
                if name in ("*", solver, integrator, f"{solver}/{integrator}")}


def elastic(stretch: float) -> float:
    """Lowest frequency [rad/s] of a sheet along itself, held at its top: (pi / 2) sqrt(stretch / density) / height."""
    return 0.5 * pi * sqrt(stretch / DENSITY) / SIDE


# the table

def _stiffness() -> list[Row]:
    rows = []
    for decade in range(-3, 10):
        k = 10.0**decade
        weight = static(k) if static(k) < 0.05 else 0.0
        for kind in ("springs", "membrane"):
            rows.append(Row(f"{kind} 1e{decade}", f"{kind} of 1e{decade} N/m, stretched by a tenth and let go",
                            partial(hung, kind, k), static=weight, act=partial(once, partial(placed, acts.stretched)),
                            frequency=min(SWING, elastic(k)) if weight else elastic(k)))
    return rows


def _masses() -> list[Row]:
    rows = []
    for ratio in (1e2, 1e4, 1e6):
        common = {"static": 0.01, "frequency": sqrt(G / 1.0), "edges": 10, "edge": 0.1}
        rows.append(Row(f"heavy last {ratio:.0e}", f"{ratio:g} times the mass at the lower end of a chain",
                        partial(scenes.heavy, ratio, True), listed={("xpbd", "strain"): UNEVEN},
                        **common))
        rows.append(Row(f"heavy first {ratio:.0e}", f"light points hanging on {ratio:g} times their mass",
                        partial(scenes.heavy, ratio, False), **common))
    return rows


def _times() -> list[Row]:
    rows = []
    for fps, substeps, frames, settle in ((10, 10, 20, 40), (10, 1, 20, 40), (100, 10, 100, 300), (1000, 1, 500, 2000),
                                          (10000, 1, 1000, 2000)):
        rows.append(Row(f"dt 1/{fps} x {substeps}", f"frames of 1/{fps} s of {substeps} substeps",
                        partial(hung, fps=fps, substeps=substeps), static=static(STRETCH), frames=frames, settle=settle))
    return rows


def _shapes() -> list[Row]:
    weight = {"static": static(STRETCH)}
    rows = []
    scatters = (("one place", acts.one_place), ("nearly one place", acts.nearly_one_place), ("scrambled", acts.scrambled),
                ("shuffled", acts.shuffled), ("folded", acts.folded), ("folded four times", acts.crumpled))
    for name, where in scatters:
        for kind in ("springs", "membrane"):
            rows.append(Row(f"{name}, {kind}", f"free points of a hanging sheet: {name}", partial(hung, kind),
                            act=partial(once, partial(placed, where)), settle=300,
                            listed={} if name == "folded" else DEFORMED, **weight))
    none = "a spring without length has no strain; the check asks for the two points to be made one"
    rows.append(Row("coincident, rest 0", "springs of rest length 0 between points at one place",
                    partial(scenes.doubled_points, 0.0), edges=8, listed={("*", "refusal"): none},
                    static=MASS * G / (STRETCH * 0.1)))
    rows.append(Row("coincident, rest > 0", "springs of 5 cm between points at one place", partial(scenes.doubled_points, 0.05),
                    edges=8, static=MASS * G / (STRETCH * 0.05)))
    rows.append(Row("flat triangles", "a column of cells without area", scenes.flat_triangles, static=2.0 * static(STRETCH)))
    return rows


def _colliders() -> list[Row]:
    common = {"static": static(STRETCH), "listed": {("sdirk3", "refusal"): "the check says that it rebounds from colliders"}}
    there, back, onto, gone = (0.0, -0.05, 0.15), (0.0, -0.05, -0.15), (0.0, -0.05, 0.01), (0.0, 0.0, 5.0)
    pushed = 12.0 * 0.5 * STRETCH * 2.0 * SIDE**2
    out = ("a ball pushes points out by at most its diameter, half the sheet: no edge strains by more than 1, so stored is "
           "at most 1/2 stretch 2 side^2; it lets go 12 times")
    squeezed = 2.0 * MASS * 1.0**2 + 0.5 * STRETCH * 0.64 * SIDE**2
    carried = ("walls give their speed, under 1 m/s, at most twice, 1/2 M (2 V)^2; buckling costs the sheet no more than "
               "being pressed straight, 1/2 stretch 0.8^2 side^2")
    drawn = 3.0 * 2.0 * MASS * 2.4**2 + 4.0 * 0.5 * STRETCH * (0.5 / EDGE)**2 * EDGE * SIDE
    caught = ("pins turn three times at 2.4 m/s, 2 M V^2 each; what stays above the box while they pass it by 0.5 m pulls the "
              "one row of cells between, four times 1/2 stretch (0.5 / edge)^2 edge side, as for 10x")
    return [
        Row("through the sheet", "a ball jumps from one side to the other every 5 frames",
            partial(with_ball, there), out, pushed, partial(away, then=partial(ball, (back, there))), **common),
        Row("onto the sheet", "a ball appears in the middle of the sheet and is gone again", partial(with_ball, gone),
            out, pushed, partial(away, then=partial(ball, (onto, gone))), **common),
        Row("inside a mesh", "a closed mesh jumps onto the sheet and away", partial(scenes.dummy, onto),
            out, pushed, partial(away, then=partial(ball, (onto, gone))), **common),
        Row("walls", "walls close on the sheet to 1 cm", scenes.between_walls, carried, squeezed, frames=66, **common),
        Row("crushed", "walls close along the sheet, to a fifth of its width", scenes.crushed, carried, squeezed, frames=66,
            **(common | {"static": CELLS * static(STRETCH)})),
        Row("dragged", "pins pull the sheet into a box and out", scenes.dragged, caught, drawn, frames=66, **common),
    ]


def _motions() -> list[Row]:
    weight, wind = {"static": static(STRETCH)}, 100.0
    galilei = "a carrier that moves at V and stops: in its frame nothing is added, so speeds grow by 2 V: 1/2 M (2 V)^2"
    apart = ("a linear sheet pulled suddenly overshoots to twice the static strain, four times 1/2 stretch 9^2 side^2 (of a "
             "net three times: both diagonals); twice: there and back")
    tenfold = 8.0 * 0.5 * STRETCH * 81.0 * SIDE**2
    blown = ("in the frame of the air drag only takes: speeds below 2 W; a whip of its pins stores at most what the load "
             "1/2 rho c W^2 side^2 does along twice the height")
    load = 0.5 * 1.2 * 2.2 * wind**2 * SIDE**2
    return [
        Row("contested", "two soft pins of 1e5 N/m pull a corner to two places", scenes.contested, recovers=False,
            energy="two springs of 1e5 N/m stretched by 0.1 m", work=2.0 * 0.5 * 1e5 * 0.1**2),
        Row("yanked", "pins jump to 100 m/s for 0.1 s and stop", partial(scenes.yanked, 100.0, 0.1), galilei,
            2.0 * MASS * 100.0**2, settle=300, listed=DEFORMED, **weight),
        Row("10x, springs", "pins pulled apart to ten times the width and let back", partial(scenes.pulled, "springs"), apart,
            3.0 * tenfold, frames=66, frequency=elastic(STRETCH), listed=DEFORMED),
        Row("10x, membrane", "pins pulled apart to ten times the width and let back", partial(scenes.pulled, "membrane"), apart,
            tenfold, frames=66, frequency=elastic(STRETCH), listed=DEFORMED),
        Row("gravity", "gravity turns round each frame", hung, act=acts.upside_down, **weight),
        Row("wind", "104 m/s, with drag 1.2 and lift 1", partial(hung, wind=(30.0, 0.0, wind), drag=1.2, lift=1.0), blown,
            2.0 * MASS * 1.1 * wind**2 + load * 2.0 * SIDE, recovers=False),
        Row("1 km/s", "every point of a hanging sheet thrown at 1 km/s", hung,
            act=partial(once, partial(thrown, 1e3)), settle=300, listed=DEFORMED, **weight),
        Row("1 km/s, free", "every point of a free sheet thrown at 1 km/s", partial(sheet, pins=[], gravity=0.0),
            act=partial(once, partial(thrown, 1e3)), settle=300, momentum=1e-4, frequency=BENDING, listed=DEFORMED),
    ]


def _materials() -> list[Row]:
    weight, scramble = {"static": static(STRETCH)}, partial(once, partial(placed, acts.scrambled))
    rows = []
    for name, fabric, more in (("bend 1e3", {"bend": 1e3}, {}), ("damping 1 s", {"damping": 1.0}, {}),
                               ("poisson 0.49", {"poisson": 0.49}, {}), ("poisson -0.9", {"poisson": -0.9}, {}),
                               ("no shear", {"shear": 0.0}, {}), ("shear 1e6", {"shear": 1e6}, {}),
                               ("strain limit 1 %", {"strain_limit": 0.01}, {}), ("tethers", {}, {"tethers": True}),
                               ("springs model", {}, {"model": "springs"})):
        slow = fabric.get("damping", 0.0)
        rows.append(Row(f"scrambled, {name}", f"points scattered over the sheet's size; {name}",
                        partial(hung, fabric=fabric, **more), act=scramble, settle=300, creep=slow,
                        listed=DEFORMED | ({("explicit", "refusal"): SLOW} if slow else {})
                        | ({("implicit", "strain"): COLLAPSED, ("xpbd", "strain"): ROUND} if "bend" in fabric else {}),
                        **weight))
    rows += [
        Row("uneven", "masses of 1 mg to 1 g side by side, scattered", scenes.uneven, act=scramble, settle=300,
            listed={("xpbd", "strain"): UNEVEN} | DEFORMED, **weight),
        Row("needles 1:10", "triangles of 1 to 10, scattered by their short edge", partial(scenes.needles, 10.0), settle=300,
            act=partial(once, partial(placed, acts.shaken)), listed=DEFORMED, **weight),
        Row("needles 1:100", "triangles of 1 to 100 hanging at rest", partial(scenes.needles, 100.0), **weight),
        *(Row(f"slivers 1:{ratio:g}", f"points 1/{ratio:g} of a triangle's height off its edge, thrown at 1 m/s",
              partial(scenes.slivers, 1.0 / ratio), act=partial(once, partial(thrown, 1.0)), seconds=120.0, **weight)
          for ratio in (100, 100_000)),
        Row("buttons", "stiff squares of 1 mm in a metre of cloth, thrown at 1 m/s", partial(scenes.buttons, 1e-3),
            act=partial(once, partial(thrown, 1.0)), settle=300, seconds=120.0, frequency=sqrt(G / (2.0 * SIDE)),
            edge=2.0 * EDGE, level=(0.0, -4.0, 0.0), static=2.0 * static(STRETCH), listed={("xpbd", "strain"): SHORT}),
        Row("twelve decades", "faces of 1e-3 to 1e9 N/m in one sheet, stretched by a tenth and let go", scenes.decades,
            act=partial(once, partial(placed, acts.stretched)), settle=300, frequency=elastic(1e-3)),
    ]
    return rows


def _quiet() -> list[Row]:
    weight = {"static": static(STRETCH)}
    far, walk = (1000.0, 300.0, -700.0), {("implicit/implicit_midpoint", "jitter"): WALK}
    return [
        Row("float", "a free sheet, every point thrown at 1 m/s: momentum stays", partial(sheet, pins=[], gravity=0.0),
            act=partial(once, partial(thrown, 1.0)), frames=300, momentum=1e-5, frequency=BENDING),
        Row("float, springs", "the same of a net", partial(sheet, "springs", pins=[], gravity=0.0),
            act=partial(once, partial(thrown, 1.0)), frames=300, momentum=1e-5, frequency=0.0),

        Row("far", "a hanging sheet 1.3 km from the origin, thrown at 1 m/s", partial(hung, at=far),
            act=partial(once, partial(thrown, 1.0)), level=(far[0], far[1] - 2.0, far[2]), **weight),
        Row("rest", "a hanging sheet at rest", hung, settle=400, rest=2000, seconds=120.0, listed=walk, **weight),
        Row("rest, far", "a hanging sheet at rest 1.3 km from the origin", partial(hung, at=far), settle=400, rest=500,
            listed=walk, level=(far[0], far[1] - 2.0, far[2]), **weight),
    ]


ROWS: list[Row] = [*_stiffness(), *_masses(), *_times(), *_shapes(), *_colliders(), *_motions(), *_materials(), *_quiet()]
