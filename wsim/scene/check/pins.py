"""Points that are held hard at two places at once: no position is right for them. And what keys should move, and no pin holds.
NumPy only."""

from collections.abc import Iterator

import numpy as np

from wsim.scene import Deformable, Pin, Problem, Scene
from wsim.scene.check.objects import object_warning, thing_error

APART = 1e-4       # of the body's size, by which two places of one point may differ
TIMES = 64         # at which places are compared, at most
STILL = 1e-9       # of its numbers, or of 1: a frame that differs by less does not move


def check_conflicting_pins(body: Deformable, pins: list[Pin]) -> Iterator[Problem]:
    """One error a pair of its hard pins, or of places of one, that disagree. All are sound here. (A soft pin pulls, and a point
    may have several.)"""
    points = np.concatenate([p.points for p in pins])
    owner = np.repeat(np.arange(len(pins)), [len(p.points) for p in pins])
    order = np.argsort(points, kind="stable")
    again = np.flatnonzero(points[order][1:] == points[order][:-1])
    a, b = order[again], order[again + 1]
    size, said = float(np.ptp(body.motion.points(body.points), axis=0).max()), set()
    for t in _pin_check_times(pins):
        places = np.concatenate([_pinned_positions(body, p, t) for p in pins])
        away = np.linalg.norm(places[a] - places[b], axis=1)
        for k in np.flatnonzero(away > APART * size).tolist():
            one, two = pins[owner[a[k]]], pins[owner[b[k]]]
            if (one.path, two.path) not in said:
                said.add((one.path, two.path))
                other = "once more by itself" if one is two else f"by {one.path} too"
                yield thing_error(two.path,
                                   f"it holds point {points[a[k]]} of {body.path}, which is held {other}, {away[k]:.3g} m "
                                   f"away at t = {t:g} s", "one place a point",
                                   "take the point out of one of them, or give both the "
                                   "same place, or one a finite stiffness")


def check_distant_pin_targets(body: Deformable, pins: list[Pin]) -> Iterator[Problem]:
    """Warns of each hard pin whose target for a point is farther from the start of the point than the body is large."""
    size = float(np.ptp(body.motion.points(body.points), axis=0).max())
    for pin in pins:
        away = np.linalg.norm(_pinned_positions(body, pin, 0.0) - body.motion.points(body.points[pin.points]), axis=1)
        if away.max(initial=0.0) > size:
            k = int(np.argmax(away))
            far = f"it holds point {pin.points[k]} of {body.path} {away[k]:.3g} m from where it starts"
            yield object_warning(pin.path, f"{far}, and the body is {size:.3g} m large: the point jumps there at once",
                                 "targets at or near the points' starts",
                                 "author physics:coords1 in the frame of physics:src1, in units of the stage")


def check_animated_starts(scene: Scene) -> Iterator[Problem]:
    """Warns of points whose frame moves by keys, where neither a pin nor a tie lets them follow it: only its start counts."""
    follow = {pin.body for pin in scene.all_pins()} | {path for tie in scene.ties for path in (tie.body, tie.other)}
    for thing in [*scene.bodies(), *scene.things("Rods"), *scene.things("MaterialPoints")]:
        if thing.path in follow or getattr(thing, "pour", None) or not thing.motion.moves:
            continue
        end = scene.frames / scene.fps if scene.fps > 0.0 else 0.0
        times = np.concatenate([np.linspace(0.0, end, 9), [t for t in thing.motion.times if 0.0 < t < end]])
        poses = np.array([thing.motion.at(float(t)) for t in times])
        if np.ptp(poses, axis=0).max() > STILL * max(1.0, float(np.abs(poses).max())):
            yield object_warning(thing.path, "its transform is animated, and nothing pins it: it begins where the animation "
                                 "starts, and then forces move it", "a transform that stays",
                                 "give velocities at the start, or a collider or pin that moves")


def _pin_check_times(pins: list[Pin]) -> list[float]:
    """Keys of their motions and the middles between [s], some of them where there are many."""
    keys = np.unique(np.concatenate([p.follows.skin.times if p.follows else p.motion.times for p in pins]))
    times = np.concatenate([keys, 0.5 * (keys[1:] + keys[:-1])])
    return times[:: -(-len(times) // TIMES)].tolist()


def _pinned_positions(body: Deformable, pin: Pin, t: float) -> np.ndarray:
    """Where a pin puts its points at a time [m], world, (k, 3)."""
    if pin.follows is not None:
        return pin.follows.over(np.array([t]))[0]
    if pin.places is not None:
        return pin.motion.points(pin.places, t)
    start, M = body.motion.points(body.points[pin.points]), pin.motion.at(0.0)
    return pin.motion.points(np.linalg.solve(M[:3, :3], (start - M[:3, 3]).T).T, t)
