"""A regular prism rolls on its edges: it loses energy at every one, and hops where it is fast.

In a plane: a disc of mass 1 with corners on a circle R, k the radius of gyration, inelastic corners with friction mu. Slow, it
turns about one corner after the other, and keeps (k^2 + R^2 cos(2 pi / n)) / (k^2 + R^2) of its spin at each. Fast
(w^2 R > g), it flies from corner to corner. `planar` covers both by Moreau's time stepping, which converges to the exact motion
with the step. `over_corner` has the closed form of one that does not hop.
"""

from functools import partial
from math import cos, pi, radians, sin, sqrt

import numpy as np

from tools.bench.rigid.answers.case import Case, Figure
from tools.bench.rigid.answers.rolling import named
from tools.bench.rigid.answers.shapes import SIDE, floor, prism
from tools.bench.rigid.answers.stage import RATES, G, Stage
from wsim.scene.bodies import DefaultCount

R = 0.3


def gyration(sides: int, r: float) -> float:
    """k^2 [m^2] of a solid regular prism about its axis: r^2 (2 + cos(2 pi / n)) / 6."""
    return r * r * (2.0 + cos(2.0 * pi / sides)) / 6.0


def planar(sides: int, v: float, seconds: float, mu: float = 0.5, r: float = R, h: float = 2e-5,
           lean: float = 0.0) -> tuple[float, float, float]:
    """Speed and place of the centre after a time, and how high it was. It starts on a flat side, rolling: w = v / r. lean
    [rad]: slope down along x."""
    k2, step = gyration(sides, r), 2.0 * pi / sides
    x, z, angle = 0.0, r * cos(0.5 * step), 0.0               # corners at -pi/2 + (j + 1/2) step - angle
    vx, vz, w, top = v, 0.0, v / r, 0.0
    down, along = h * G * cos(lean), h * G * sin(lean)
    for _ in range(round(seconds / h)):
        x, z, angle, vx, vz = x + h * vx, z + h * vz, angle + h * w, vx + along, vz - down
        top = max(top, z)
        near = int(angle // step)
        touching = []
        for j in (near - 1, near, near + 1):
            a = -0.5 * pi + (j + 0.5) * step - angle
            cx, cz = r * cos(a), r * sin(a)
            if z + cz <= 0.0:
                touching.append([cx, cz, 0.0, 0.0])
        for _ in range(30 if len(touching) > 1 else 1):
            for each in touching:
                cx, cz, n, t = each                             # clockwise spin w: velocity of a corner (vx + w cz, vz - w cx)
                push = max(n - (vz - w * cx) / (1.0 + cx * cx / k2), 0.0)
                vz, w = vz + push - n, w - (push - n) * cx / k2
                rub = t - (vx + w * cz) / (1.0 + cz * cz / k2)
                rub = min(max(rub, -mu * push), mu * push)
                vx, w = vx + rub - t, w + (rub - t) * cz / k2
                each[2:] = push, rub
    return vx, x, top


def over_corner(sides: int, v: float, edges: int, r: float = R) -> float:
    """Speed r w upright on a corner after so many edges, where it does not hop: of a prism that starts as in `planar`."""
    k2, step = gyration(sides, r), 2.0 * pi / sides
    start = (r * cos(0.5 * step) * v + k2 * v / r) / (k2 + r * r) * r                # about the first corner
    flat = start * ((k2 + r * r * cos(step)) / (k2 + r * r))**edges
    return sqrt(flat**2 - 2.0 * G * r * (1.0 - cos(0.5 * step)) * r * r / (k2 + r * r))


def reference(precision: str) -> tuple[list[Figure], float]:
    """Three steps that halve; an octagon that does not hop, slowest over its third corner, beside its closed form."""
    found = [planar(64, 5.0, 2.0, h=h)[0] for h in (8e-5, 4e-5, 2e-5)]
    eight = planar(8, 1.6, 0.5)[0]
    return [Figure("64 sides, 5 m/s: speed after 2 s, from 4.6", abs(found[-1] - 4.6), 0.1, "m/s"),
            Figure("octagon: speed over its third corner", abs(eight - over_corner(8, 1.6, 2)), 5e-3, "m/s"),
            Figure("change with the last halving of the step", abs(found[-1] - found[-2]), 0.05, "m/s")], 0.0


def on_side(sides: int) -> np.ndarray:
    """Rotation of a prism that lies on a flat side, its axle across the way."""
    a = pi / sides
    return SIDE @ np.array([[cos(a), -sin(a), 0.0], [sin(a), cos(a), 0.0], [0.0, 0.0, 1.0]])


def roll(precision: str, sides: int, v: float, rate, ground: str = "plane", seconds: float = 2.0) -> tuple[list[Figure], float]:
    stage = Stage(*rate)
    floor(stage, ground, 90.0 * R)
    height = R * cos(pi / sides)
    stage.body("/prism", prism(sides, R, 0.1), (-5.0, 0.0, height), on_side(sides), (v, 0.0, 0.0), (0.0, v / R, 0.0))
    track = stage.run(seconds, precision)
    speed, way, top = planar(sides, v, seconds)
    return [Figure(f"speed after {seconds:g} s, from {speed:.2f}", abs(track.v[-1, 0, 0] - speed), max(0.02 * v, 0.02), "m/s"),
            Figure(f"way, from {way:.2f} m", abs(track.x[-1, 0, 0] - track.x[0, 0, 0] - way), 0.02 * v * seconds, "m"),
            Figure("sideways", abs(track.x[-1, 0, 1]), 0.02 * v * seconds, "m"),
            Figure(f"higher than {1e3 * (top - height):.1f} mm", float(track.x[:, 0, 2].max() - top), 0.02 * R, "m")], track.cpu


def chosen(precision: str, lean: float) -> tuple[list[Figure], float]:
    """A prism of 64 sides, with substeps of `auto`: on the level from 5 m/s for 2 s; down a slope from rest for 4 s, where they
    come once MANY facets pass, late by as much as a level prism loses at that rate (2 %)."""
    stage = Stage(24.0, DefaultCount(10), lean=lean)
    floor(stage, "plane", 90.0 * R)
    v, seconds = (0.0, 4.0) if lean else (5.0, 2.0)
    stage.body("/prism", prism(64, R, 0.1), (-20.0, 0.0, R * cos(pi / 64)), on_side(64), (v, 0.0, 0.0), (0.0, v / R, 0.0))
    track = stage.run(seconds, precision)
    speed = planar(64, v, seconds, lean=radians(lean))[0]
    off, allowed = abs(track.v[-1, 0, 0] - speed), 0.04 * speed if lean else 0.1
    return [Figure(f"speed after {seconds:g} s, from {speed:.2f}", off, allowed, "m/s"),
            Figure("warnings", len(track.warnings), 0)], track.cpu


def cases() -> list[Case]:
    some = RATES[:2]
    rows = ((64, 5.0, "plane", RATES), (32, 5.0, "plane", some), (64, 1.0, "plane", some), (32, 2.0, "plane", some),
            (16, 5.0, "plane", some), (64, 5.0, "mesh", some))
    return [Case("prism/reference", reference)] + [
        Case(f"prism/auto/{lean:g}", partial(chosen, lean=lean)) for lean in (0.0, 25.0)] + [
        Case(f"prism/{sides}/{v:g}/{ground}/{named(rate)}", partial(roll, sides=sides, v=v, rate=rate, ground=ground))
        for sides, v, ground, rates in rows for rate in rates]
