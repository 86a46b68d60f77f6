"""Abuse by skeletons and curves, as rows.py has that of cloth: what a sheet hangs on, and what it meets, whirls and jumps."""

from math import pi

import numpy as np

from tools.stress.rows import DEFORMED, Row
from tools.stress.scenes import CELLS, MASS, SIDE, STRETCH, TOP, hung, static
from wsim.physics.animation.objects import DUAL, LINEAR, Follow, Skeleton, Skinned
from wsim.scene import Scene, Surface, shapes
from wsim.scene.curve import Motion

FPS, TURNS, ANGLE = 60.0, 58, 3.0                 # frames a second, turns of a bone, [rad] each, one a frame
WHIRLED = ANGLE * 0.5 * SIDE * FPS                # [m/s] of the ends of what it carries
REBOUNDS = {("sdirk3", "refusal"): "the check says that it rebounds from colliders"}


def bone(times, places, angles=None) -> Skeleton:
    """One joint that goes through places (keys, 3) [m] and turns by angles (keys,) [rad] about y."""
    half = 0.5 * (np.zeros(len(times)) if angles is None else np.asarray(angles))
    Q = np.stack([0.0 * half, np.sin(half), 0.0 * half, np.cos(half)], axis=1)
    return Skeleton("/man/bones", ("a",), np.eye(4)[None], times=times, translations=np.asarray(places, float)[:, None],
                    rotations=Q[:, None])


def whirled() -> Scene:
    """A sheet whose upper row follows a bone that turns to and fro by 3 rad in every frame of a second."""
    scene = hung()
    scene.pins.clear()
    k = np.arange(TURNS + 1)
    skeleton = scene.add(bone(k / FPS, np.zeros((len(k), 3)), ANGLE * (k % 2)))
    x = scene.cloths[0].motion.points(scene.cloths[0].points)[TOP]
    skin = Skinned(skeleton, x, np.zeros((len(x), 1)), np.ones((len(x), 1)))
    scene.pin("/pin", scene.cloths[0], TOP, follows=Follow.at_points(skin, np.arange(len(x))))
    return scene


def met(method: str) -> Scene:
    """A ball that two joints move, an end each, jumps through a sheet every 5 frames and is wrung by half a turn on its way."""
    scene = hung()
    points, counts, indices = shapes.sphere(0.12, 16)
    k = np.arange(13)
    side = np.where(k % 2, -0.15, 0.15)
    times = np.sort(np.concatenate([5 * k / FPS, (5 * k[1:] - 1) / FPS]))
    z = np.repeat(side, 2)[:-1]                                    # stands for four frames, goes in the fifth
    joint = bone(times, np.stack([0.0 * z, np.full(len(z), -0.25), z], axis=1))
    turns = bone(times, np.zeros((len(z), 3)), np.where(z > 0.0, 0.0, 0.9 * pi))
    skeleton = scene.add(Skeleton("/man/bones", ("a", "a/b"), np.tile(np.eye(4), (2, 1, 1)), times=times,
                                  translations=np.concatenate([joint.translations, turns.translations], axis=1),
                                  rotations=np.concatenate([joint.rotations, turns.rotations], axis=1)))
    part = np.clip(points[:, 1] / 0.24 + 0.5, 0.0, 1.0)
    skin = Skinned(skeleton, points, np.tile([0, 1], (len(points), 1)), np.stack([part, 1.0 - part], axis=1), method=method)
    scene.collider("/man/body", Surface(skin.at(0.0), counts, indices, poses=skin))
    return scene


def swung() -> Scene:
    """Pins on a spline whose keys are 1 m apart every tenth of a second, until the first second is over."""
    scene = hung()
    scene.pins.clear()
    t = np.arange(11) / 10.0
    places = np.stack([np.where(np.arange(11) % 2, 1.0, 0.0), 0.0 * t, 0.0 * t], axis=1)
    motion = Motion.through(t, places, kind="catmull_rom")
    scene.pin("/pin", scene.cloths[0], TOP, motion=motion)
    return scene


def _rows() -> list[Row]:
    weight = {"static": static(STRETCH)}
    apart = "a carrier that moves at V and stops or turns round: in its frame nothing is added but 1/2 M (2 V)^2 each time"
    pushed = 12.0 * (0.5 * STRETCH * 2.0 * SIDE**2 + 2.0 * MASS * (0.3 * FPS)**2)
    out = ("a ball pushes points out by at most its diameter, half the sheet: 1/2 stretch 2 side^2, and gives them at most "
           "twice its speed of a frame, 2 M V^2; 12 times")
    return [
        Row("whirled bone", "pins on a bone that turns by 3 rad to and fro in every frame", whirled, apart,
            TURNS * 2.0 * MASS * WHIRLED**2, settle=300, edges=CELLS, listed=DEFORMED, **weight),
        *(Row(f"wrung ball, {method}", "a skinned ball that jumps through the sheet, wrung on its way", lambda m=method: met(m),
              out, pushed, frames=66, settle=300, listed=DEFORMED | REBOUNDS, **weight) for method in (LINEAR, DUAL)),
        Row("swung on a spline", "pins on a spline with keys 1 m apart every 0.1 s", swung, apart,
            10.0 * 2.0 * MASS * 15.0**2, frames=66, settle=300, listed=DEFORMED, **weight),
    ]


ROWS: list[Row] = _rows()
