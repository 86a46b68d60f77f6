"""What is right and has to stay so: stacks, restitution, the limit of friction, and a pile of 1000 boxes that collapses.

Scenes and judges are those of rigid/problems.py. What is allowed of a stack is a tenth more than it sinks at b85f344d.
"""

from functools import partial

import numpy as np

from tools.bench.rigid import judges
from tools.bench.rigid.answers.case import Case, Figure
from tools.bench.rigid.answers.rolling import named
from tools.bench.rigid.answers.stage import RATES, G, Stage, turned
from tools.bench.rigid.overlap import overlaps
from tools.bench.rigid.problems import PROBLEMS
from wsim.geometry.rotation import matrix_quat
from wsim.scene import Box, Plane


def stack(precision: str, name: str, sag: float) -> tuple[list[Figure], float]:
    """sag: what is allowed [mm]."""
    data, track = played(name, precision)
    found = judges.stack(data, states(track))
    return [Figure("sinks", found["sag"], sag, "mm"), Figure("speed at the end", found["speed"], 1e-3, "m/s"),
            Figure("slid", found["slid"], 2.0, "mm"), Figure("fallen", float(found["fallen"]), 0.0)], track.cpu


def played(name: str, precision: str):
    """The data of a problem, and the track of its bodies."""
    from tools.bench.rigid.run_wsim import scene_of
    data = PROBLEMS[name].make()
    stage = Stage()
    stage.scene = scene_of(data, {"substeps": 8})
    return data, stage.run(data["frames"] / data["fps"], precision)


def states(track) -> dict[str, np.ndarray]:
    return {"x": track.x[1:], "q": matrix_quat(track.R[1:]), "v": track.v[1:], "w": track.w[1:]}


def bounces(precision: str) -> tuple[list[Figure], float]:
    data, track = played("three bounces", precision)
    return [Figure("heights of three bounces", judges.bounces(data, states(track))["height"], 0.5, "%")], track.cpu


def sliding(precision: str) -> tuple[list[Figure], float]:
    data, track = played("sliding box", precision)
    return [Figure("distance", judges.sliding(data, states(track))["distance"], 1.0, "%")], track.cpu


def threshold(precision: str, rate) -> tuple[list[Figure], float]:
    """A box half a degree under the critical angle, and half a degree over it."""
    found, cpu = [], 0.0
    for more in (-0.5, 0.5):
        angle = float(np.degrees(np.arctan(0.5))) + more
        stage = Stage(*rate, lean=angle)
        stage.collider("/floor", Plane())
        stage.body("/box", Box((0.5, 0.5, 0.5)), (0.0, 0.0, 0.5))
        track = stage.run(3.0, precision)
        one = int(np.searchsorted(track.t, 1.0))
        if more < 0.0:
            found.append(Figure("creep below the limit, in 2 s", float(track.x[-1, 0, 0] - track.x[one, 0, 0]), 2e-5, "m"))
        else:
            pull = G * (np.sin(np.radians(angle)) - 0.5 * np.cos(np.radians(angle)))
            found.append(Figure("acceleration above it", float(abs(track.v[-1, 0, 0] / (pull * track.t[-1]) - 1.0)), 2e-2))
        cpu += track.cpu
    return found, cpu


def pile(precision: str, rate, gap: float, lean: float, half: float = 0.2, seconds: float = 4.0) -> tuple[list[Figure], float]:
    """1000 boxes of 400 mm from a loose lattice, each out of place and turned by up to `lean` [rad], fall on each other.
    gap: of the lattice over the width of a box."""
    columns, layers = 10, 10
    stage, rng = Stage(*rate), np.random.default_rng(5)
    stage.collider("/floor", Plane())
    for k in range(columns * columns * layers):
        place = np.array([k % columns, k // columns % columns, k // columns**2]) * 2.0 * half * gap
        turn = turned(rng.normal(size=3), np.degrees(rng.uniform(0.0, lean)))
        stage.body(f"/box{k}", Box((half,) * 3), place + rng.uniform(-0.1, 0.1, 3) * half + (0.0, 0.0, 2.0 * half), turn)
    track = stage.run(seconds, precision)
    deep = [overlaps(track.x[f], matrix_quat(track.R[f]), np.full((track.x.shape[1], 3), half)).max(initial=0.0)
            for f in range(0, len(track.t), 2)]
    return [Figure(f"worst overlap, at {2.0 * np.argmax(deep) / rate[0]:.2f} s", 1e3 * float(max(deep)), 10.0, "mm"),
            Figure("worst overlap at the end", 1e3 * float(deep[-1]), 10.0, "mm"),
            Figure("fastest at the end", float(np.linalg.norm(track.v[-1], axis=1).max()), 1.0, "m/s"),
            Figure("below the floor", float((track.x[-1, :, 2] < 0.0).sum()), 0.0)], track.cpu


def cases() -> list[Case]:
    found = [Case(f"unchanged/{name}", partial(stack, name=name, sag=sag))
             for name, sag in (("column of ten", 1.91), ("100 kg on nine", 35.8), ("pyramid of 10 rows", 0.58))]
    found += [Case("unchanged/three bounces", bounces), Case("unchanged/sliding box", sliding)]
    found += [Case(f"unchanged/threshold/{named(rate)}", partial(threshold, rate=rate)) for rate in RATES[:2]]
    return found + [Case(f"unchanged/{name}/{named(rate)}", partial(pile, rate=rate, gap=gap, lean=lean))
                    for name, gap, lean in (("pile", 1.2, 0.1), ("heap", 1.4, 0.3)) for rate in RATES[:2]]
