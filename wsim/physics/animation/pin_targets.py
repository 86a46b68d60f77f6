"""Targets of pins that the device evaluates, for all moments of a frame before it begins: of pins whose prims move by keys, and
of those that follow a skinned mesh; how fast these pins go; and velocities of what goes by smooth curves. Motions of other
kinds are evaluated on the host (`wsim.physics.motion.pins`)."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.animation import pinned
from wsim.kernels.math.real import types
from wsim.model import kernel_cache
from wsim.model.launches import LaunchList
from wsim.model.midnodes import with_midnode_values
from wsim.physics.contact.poses.sampled import SampledMotions


class FollowedPlaces:
    """Places of a pin's points on a mesh that joints move, used like a `Motion`."""

    def __init__(self, follow, ends: np.ndarray):
        """follow: a `wsim.physics.animation.objects.Follow`; ends: points that each of those between is the middle
        of."""
        self.follow, self.ends, self.plain = follow, ends, True

    moves = property(lambda self: self.follow.moves)

    @property
    def by_keys(self) -> bool:
        """As `Motion.by_keys`."""
        bones = self.follow.skin.skeleton
        return not bones.bodies and bones.motion.by_keys

    def points(self, local: np.ndarray, time: float) -> np.ndarray:
        """World places [m] at `time` [s]."""
        return self.over(np.array([time]))[0]

    def over(self, times: np.ndarray) -> np.ndarray:
        """World places [m] at some times [s], (times, points, 3)."""
        return with_midnode_values(self.follow.over(times).swapaxes(0, 1), self.ends).swapaxes(0, 1)


class PinTargets:
    """Keys and points of the pins of a group, and what is made of them."""

    def __init__(self, device, real):
        self.device, self.real, self.module = device, real, f"wsim_pins_{types(real).name}"
        self.place, self.pull = pinned.pin_target_kernel(real, self.module), pinned.pin_pull_kernel(self.module)
        self.keyed = SampledMotions(device, self.module)
        self.followers: Any = None                       # `wsim.physics.animation.hung.FollowingPins`
        self.sequence: Any = None
        kernel_cache.load_kernel_module(self.module, device)

    def take(self, group: list, own: list[bool], moments: np.ndarray, dt: float, target: wp.array,
             speed: wp.array | None = None) -> None:
        """Uploads those of the pins of a group that are `own`, whose targets are wanted at moments [s] of a frame of dt [s].
        speed: their greatest ones go there, by the number in the group."""
        first = np.cumsum([0, *(len(p.places) for p in group)]).tolist()
        mine = [(k, group[k]) for k in np.flatnonzero(own).tolist()]
        self.speed = speed
        moments = np.concatenate([moments, [0.0, 0.5 * dt, dt]])
        keyed = [row for row in mine if not hasattr(row[1].motion, "follow")]
        hung = [row for row in mine if hasattr(row[1].motion, "follow")]
        self.with_keys, self.followers = bool(keyed), None
        launches = self._keyed_target_launches(keyed, first, moments, dt, target) if keyed else []
        if hung:
            from wsim.physics.animation.hung import FollowingPins
            self.followers = FollowingPins([(p, first[k], k) for k, p in hung], moments, self.device)
            launches += self.followers.launches(dt, target, speed)
        self.sequence = LaunchList(self.device, launches)

    def _keyed_target_launches(self, mine: list, first: list[int], moments: np.ndarray, dt: float,
                               target: wp.array) -> list[tuple]:
        """Launches of pins whose prims move by keys."""
        c, each = pinned_point_table(self.device, [(p, first[k]) for k, p in mine]), [len(p.places) for _, p in mine]
        self.keyed.take([p.motion for _, p in mine], moments)
        c.motion = wp.array(np.repeat(self.keyed.row, each), dtype=int, device=self.device)
        c.pin = wp.array(np.repeat(np.array([k for k, _ in mine], np.int32), each), dtype=int, device=self.device)
        of, n = self.keyed, sum(each)
        pull = [(self.pull, n, [c, of.A, of.p, dt], [self.speed])] * (self.speed is not None)
        return [*of.launches(), (self.place, (target.shape[0], n), [c, of.A, of.p], [target]), *pull]

    def launch(self, time: float) -> None:
        """Targets and greatest speeds of the frame that starts at a time [s]."""
        if self.with_keys:
            self.keyed.begin(time)
        if self.followers:
            self.followers.begin(time)
        self.sequence.launch()


class PinVelocities:
    """Velocities of the points of pins where frames end."""

    def __init__(self, pins: list, dt: float, out: wp.array, real):
        from wsim.physics.contact.poses.tracks import MotionTracks
        self.motions, device = [p.motion for p in pins], out.device
        module = f"wsim_pin_speeds_{types(real).name}"
        place = pinned.pin_speed_kernel(real, module)
        kernel_cache.load_kernel_module(module, device)
        tracks, n, each = MotionTracks(device), len(pins), [len(p.places) for p in pins]
        tracks.take(self.motions)
        first = np.cumsum([0, *each]).tolist()
        c = pinned_point_table(device, list(zip(pins, first, strict=False)))
        c.motion = wp.array(np.repeat(np.arange(n, dtype=np.int32), each), dtype=int, device=device)
        self.start, moment = wp.zeros(1, dtype=wp.float64, device=device), wp.full(1, dt, dtype=wp.float64, device=device)
        A, p = wp.zeros(n, dtype=wp.mat33d, device=device), wp.zeros(n, dtype=wp.vec3d, device=device)
        self.sequence = LaunchList(device, [(tracks.rates(), n, [*tracks.tables(), self.start, moment], [A, p]),
                                          (place, sum(each), [c, A, p], [out])])

    def launch(self, time: float) -> None:
        """Of the frame that starts at a time [s]."""
        self.start.fill_(time)
        self.sequence.launch()


def pinned_point_table(device, pins: list[tuple]) -> Any:
    """Points of pins, each with the column of its first: a `wsim.kernels.animation.pinned.PinnedPoints` without motions."""
    c = pinned.PinnedPoints()
    each = [len(p.places) for p, _ in pins]

    def upload_pin_points(values, dtype) -> wp.array:
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device=device)
    c.column = upload_pin_points(np.concatenate([first + np.arange(len(p.places)) for p, first in pins]).astype(np.int32), int)
    c.local = upload_pin_points(np.concatenate([p.locals for p, _ in pins]), wp.vec3d)
    c.origin = upload_pin_points(np.repeat([p.body.origin for p, _ in pins], each, axis=0), wp.vec3d)
    return c
