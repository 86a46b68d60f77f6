"""Boxes on supports that turn, tilt and go to and fro: below the limit of friction they stay where they are on the support."""

from collections.abc import Callable
from functools import partial
from math import cos, pi, sin

import numpy as np

from tools.bench.rigid.answers.case import Case, Figure
from tools.bench.rigid.answers.rolling import TILTS, named
from tools.bench.rigid.answers.shapes import grid
from tools.bench.rigid.answers.stage import RATES, G, Stage, Track, framed, turned
from wsim.scene import Box, Cylinder, Plane

MU, PART = 0.5, 0.6                       # friction, and the part of it that the motion asks for
HALF = 0.04                               # [m] of a box
TURNS = (0.5, 1.0, 2.0)                   # [1/s]
CREEP, SWING, SECONDS = 1e-4, 0.1, 10.0   # [m], [degrees] that are allowed over 10 s; the first half second is left out
ANGLE = 23.0                              # [degrees] of boxes to the way outward


def figures(name: str, track: Track, k: int, frame: Callable[[float], np.ndarray]) -> list[Figure]:
    """How far body k goes and turns on a support that is at frame(t) (4, 4)."""
    M = np.array([frame(t) for t in track.t])
    own = np.einsum("tji,tj->ti", M[:, :3, :3], track.x[:, k] - M[:, :3, 3])
    R = np.einsum("tji,tjk->tik", M[:, :3, :3], track.R[:, k])
    first = int(np.searchsorted(track.t, 0.5))
    turn = np.degrees(np.arctan2(R[:, 1, 0], R[:, 0, 0]))
    return [Figure(f"{name}: creep", float(np.linalg.norm((own - own[first])[first:, :2], axis=1).max()), CREEP, "m"),
            Figure(f"{name}: turn", float(np.abs(turn - turn[first])[first:].max()), SWING, "deg")]


def spun(place, turns: float) -> Callable[[float], np.ndarray]:
    return lambda t: framed(place, turned((0.0, 0.0, 1.0), 360.0 * turns * t))


TABLES = {"box": (Box((1.0, 1.0, 0.1)), 0.1), "cylinder": (Cylinder(1.0, 0.1), 0.1), "mesh": (grid(7, 2.0, jitter=0.2), 0.0)}


def tables(precision: str, kind: str, rate, tilt: str = "level", part: float = PART) -> tuple[list[Figure], float]:
    """Tables that turn, a lane for each rate; the box where it asks for `part` of the friction there is."""
    shape, depth = TABLES[kind]
    stage, seconds = Stage(*rate, turn=TILTS[tilt]), SECONDS
    for k, turns in enumerate(TURNS):
        place, W = np.array([0.0, 4.0 * k, -depth]), 2.0 * pi * turns
        times = np.arange(0.0, seconds + 1.0, 1.0 / (12.0 * turns))
        stage.carrier(f"/table{k}", shape, times, [spun(place, turns)(t) for t in times], MU)
        rho = part * MU * G / W**2
        stage.body(f"/box{k}", Box((HALF,) * 3), place + (rho, 0.0, depth + HALF), turned((0.0, 0.0, 1.0), ANGLE),
                   (0.0, W * rho, 0.0), (0.0, 0.0, W), rub=MU)
    track, found = stage.run(seconds if part < 1.0 else 1.0, precision), []
    for k, turns in enumerate(TURNS):
        if part < 1.0:
            found += figures(f"{turns:g} turns/s", track, k, spun((0.0, 4.0 * k, -depth), turns))
        else:
            out = np.linalg.norm(track.x[:, k, :2] - (0.0, 4.0 * k), axis=1)
            found.append(Figure(f"{turns:g} turns/s: first over last distance", float(out[0] / out[-1]), 0.5))
    return found, track.cpu


MOTIONS: dict[str, tuple[Callable[[float], np.ndarray], tuple]] = {
    "to and fro": (lambda t: framed((PART * MU * G / 4.0**2 * (1.0 - cos(4.0 * t)), 0.0, 0.0)), (0.0, 0.0, 0.0)),
    "on a circle": (lambda t: framed((PART * MU * G / 5.0**2 * cos(5.0 * t), PART * MU * G / 5.0**2 * sin(5.0 * t), 0.0)),
                    (0.0, PART * MU * G / 5.0, 0.0)),
    "tilts": (lambda t: framed((0.0, 0.0, 0.0), turned((1.0, 2.0, 0.0), 6.0 * (1.0 - cos(3.0 * t)))), (0.0, 0.0, 0.0)),
    "lifts": (lambda t: framed((0.0, 0.0, 0.05 * (1.0 - cos(6.0 * t)))), (0.0, 0.0, 0.0)),
}


def shaken(precision: str, rate) -> tuple[list[Figure], float]:
    stage, known = Stage(*rate), {}
    times = np.arange(0.0, SECONDS + 0.1, 1.0 / (rate[0] * rate[1]))          # a key a substep: no jump of speed within one
    for k, (name, (move, velocity)) in enumerate(MOTIONS.items()):
        place = np.array([0.0, 5.0 * k, 0.0])
        known[name] = lambda t, move=move, place=place: framed(place) @ move(t)
        frames = [known[name](t) @ framed((0.0, 0.0, -0.1)) for t in times]
        stage.carrier(f"/table{k}", Box((1.5, 1.5, 0.1)), times, frames, MU)
        start = known[name](0.0) @ framed((0.2, 0.1, HALF), turned((0.0, 0.0, 1.0), ANGLE))
        stage.body(f"/box{k}", Box((HALF,) * 3), start[:3, 3], start[:3, :3], velocity, rub=MU)
    track = stage.run(SECONDS, precision)
    return [f for k, name in enumerate(MOTIONS) for f in figures(name, track, k, known[name])], track.cpu


def platter(precision: str, rate, heavy: float = 200.0, turns: float = 0.5) -> tuple[list[Figure], float]:
    """A free platter turns on a floor without friction, a box on it; both about their common centre, which stays."""
    stage, W = Stage(*rate), 2.0 * pi * turns
    stage.collider("/floor", Plane(), rub=0.0)
    rho = PART * MU * G / W**2
    one, other = rho * heavy / (heavy + 1.0), -rho / (heavy + 1.0)
    stage.body("/platter", Box((1.0, 1.0, 0.1)), (other, 0.0, 0.1), velocity=(0.0, W * other, 0.0), spin=(0.0, 0.0, W), rub=0.0,
               mass=heavy)
    stage.body("/box", Box((HALF,) * 3), (one, 0.0, 0.2 + HALF), turned((0.0, 0.0, 1.0), ANGLE), (0.0, W * one, 0.0),
               (0.0, 0.0, W), rub=2.0 * MU, mass=1.0)
    track = stage.run(SECONDS, precision)
    M = [framed(track.x[f, 0], track.R[f, 0]) for f in range(len(track.t))]
    at = {t: m for t, m in zip(track.t.tolist(), M, strict=True)}
    speed = np.abs(track.w[:, 0, 2] / W - 1.0).max()
    return [*figures("box", track, 1, lambda t: at[float(t)]), Figure("spin of the platter", float(speed), 1e-3)], track.cpu


def cases() -> list[Case]:
    found = [Case(f"carried/{kind}/{named(rate)}", partial(tables, kind=kind, rate=rate)) for kind in TABLES
             for rate in RATES[:3 if kind == "box" else 2]]
    found.append(Case("carried/box/24x10/tilted", partial(tables, kind="box", rate=RATES[0], tilt="tilted")))
    found.append(Case("carried/over the limit/60x8", partial(tables, kind="box", rate=RATES[1], part=1.3)))
    return found + [Case(f"carried/{name}/{named(rate)}", partial(run, rate=rate))
                    for name, run in (("shaken", shaken), ("platter", platter)) for rate in RATES[:2]]
