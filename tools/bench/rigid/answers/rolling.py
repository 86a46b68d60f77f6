"""Round bodies that roll without slip over a flat floor keep their speed, their height and their way.

Speeds are of a wheel of radius 0.3 m; a body of radius r goes sqrt(r / 0.3) times as fast, for as long, so that it does the
same in its own measure. Height is beside that of the same body at rest in the same run, frame by frame: the floor is soft.
A cone on its side rolls about its apex: the axis goes round by Omega, and the angular velocity is Omega cot(a) along the line
of contact.
"""

from functools import partial
from math import atan, cos, sin, sqrt, tan

import numpy as np

from tools.bench.rigid.answers.case import Case, Figure
from tools.bench.rigid.answers.shapes import ROUND, SIDE, floor
from tools.bench.rigid.answers.stage import NONE, RATES, Stage, turned
from wsim.scene import Cone, Plane

SIZE = 0.3                                       # [m] radius that the figures are given for
SPEEDS = (0.01, 0.2, 1.0, 5.0, 20.0)             # [m/s]
TILTS = {"level": NONE, "tilted": turned((1.0, 2.0, 0.5), 40.0)}


def roll(precision: str, shape: str, ground: str, rate, heading: float = 0.0, r: float = SIZE, tilt: str = "level",
         speeds=SPEEDS) -> tuple[list[Figure], float]:
    """Lanes, one for each speed and one at rest."""
    scale, stage = sqrt(r / SIZE), Stage(*rate, turn=TILTS[tilt])
    floor(stage, ground, 90.0 * r)
    turn = turned((0.0, 0.0, 1.0), heading)
    made, lanes = ROUND[shape](r), (0.0, *(v * scale for v in speeds))
    for k, v in enumerate(lanes):
        at = turn @ (-17.0 * r, 9.0 * r * (k - 2.5), r)
        stage.body(f"/lane{k}", made, at, turn @ SIDE, turn @ (v, 0.0, 0.0), turn @ (0.0, v / r, 0.0))
    track = stage.run(min(10.0 * scale, 10.0 * r / SIZE / lanes[1]), precision)
    figures, near = [], 1e-4 * r / SIZE
    for k, v in enumerate(lanes[1:], 1):
        now = track.until(min(10.0 * scale, 10.0 * r / SIZE / v))
        ways = (track.x[now, k] - track.x[0, k]) @ turn
        speed = (track.v[now, k] @ turn)[:, 0]
        said = f"at {v / scale:g} m/s" + ("" if r == SIZE else " of 0.3 m")
        figures += [Figure(f"speed {said}", float(np.abs(speed / v - 1.0).max()), 1e-3),
                    Figure(f"height {said}", float(np.abs(track.x[now, k, 2] - track.x[now, 0, 2]).max()), near, "m"),
                    Figure(f"sideways {said}", float(np.abs(ways[:, 1]).max()), near, "m")]
    return figures, track.cpu


def cone_steady(r: float, height: float, v: float) -> dict[str, np.ndarray | float]:
    """A cone on its side, apex at 0, its centre of mass at speed v: rate Omega about z, place, axis and angular velocity."""
    a = atan(r / height)                                       # half the angle at the apex
    axis = np.array([cos(a), 0.0, sin(a)])                     # from the apex to the base
    rho = 0.75 * height * cos(a)
    rate = v / rho
    return {"rate": rate, "axis": axis, "rho": rho, "spin": np.array([-rate / tan(a), 0.0, 0.0])}


def cone(precision: str, rate, r: float = SIZE, speeds=(0.01, 0.2, 1.0)) -> tuple[list[Figure], float]:
    scale, height, stage = sqrt(r / SIZE), 2.0 * r, Stage(*rate)
    stage.collider("/floor", Plane())
    for k, v in enumerate((0.0, *speeds)):
        known = cone_steady(r, height, v * scale)
        z = -known["axis"]                                     # own z runs to the apex
        turn = np.stack([np.cross((0.0, 1.0, 0.0), z), (0.0, 1.0, 0.0), z], axis=1)
        apex = np.array([0.0, 10.0 * r * k, 0.0])
        stage.body(f"/lane{k}", Cone(r, 0.5 * height), apex + 0.5 * height * known["axis"], turn, (0.0, v * scale, 0.0),
                   known["spin"])
    track = stage.run(10.0 * scale, precision)
    figures, near = [], 1e-4 * r / SIZE
    for k, v in enumerate(speeds, 1):
        known = cone_steady(r, height, v * scale)
        now = track.until(min(10.0 * scale, 10.0 * r / SIZE / (v * scale)))
        x, apex = track.x[now, k], track.x[now, k] + 0.75 * height * track.R[now, k, :, 2]
        angle = np.unwrap(np.arctan2(x[:, 1] - apex[0, 1], x[:, 0] - apex[0, 0]))
        went = (angle[-1] - angle[0]) / track.t[now][-1]
        figures += [Figure(f"rate of turning at {v:g} m/s", abs(went / known["rate"] - 1.0), 1e-3),
                    Figure(f"height at {v:g} m/s", float(np.abs(x[:, 2] - track.x[now, 0, 2]).max()), near, "m"),
                    Figure(f"apex wanders at {v:g} m/s", float(np.linalg.norm(apex - apex[0], axis=1).max()), 10.0 * near, "m")]
    return figures, track.cpu


def named(rate) -> str:
    return f"{rate[0]:g}x{rate[1]}"


def cases() -> list[Case]:
    found = []

    def add(shape: str, ground: str, rate, heading=0.0, r=SIZE, tilt="level") -> None:
        words = ["roll", shape, ground, named(rate), f"{heading:g}"] + [f"r{r:g}"] * (r != SIZE) + [tilt] * (tilt != "level")
        how = {"shape": shape, "ground": ground, "rate": rate, "heading": heading, "r": r, "tilt": tilt}
        found.append(Case("/".join(words), partial(roll, **how)))
    for heading in (0.0, 37.0):
        for rate in RATES:
            add("wheel", "plane", rate, heading)
    for shape in ROUND:
        for rate in RATES[:2]:
            if shape != "wheel":
                add(shape, "plane", rate, 37.0)
    for ground in ("box", "mesh"):
        for shape in ("wheel", "coin", "ball"):
            for rate in RATES[:2]:
                add(shape, ground, rate, 37.0)
    for ground in ("plane", "box", "mesh"):
        add("wheel", ground, RATES[0], 37.0, tilt="tilted")
    for r in (1e-3, 0.012, 100.0):
        scaled = (60.0 * sqrt(SIZE / r), 8)
        for shape in ("wheel", "coin"):
            add(shape, "plane", RATES[0], 37.0, r)
            add(shape, "plane", scaled, 37.0, r)
    for rate in RATES:
        found.append(Case(f"roll/cone/plane/{named(rate)}", partial(cone, rate=rate)))
    return found
