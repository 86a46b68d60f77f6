"""Sinks that have taken nothing by the scene's last frame."""

import numpy as np

from wsim.scene import Surface
from wsim.scene.samples import ParticleSample
from wsim.scene.solids import shape_row

TAKEN = 2              # of `there`: sink k has taken it at TAKEN + k


def idle_sink_warnings(sim) -> list[str]:
    """A line for each sink that has taken nothing in any world, with the distance of the nearest particle now."""
    sinks = sim.scene.things("MaterialSink")
    there = [part.arrays["there"].numpy() for part in sim.state.parts.values() if "there" in part.arrays]
    taken = sum((np.bincount(each[each >= TAKEN] - TAKEN, minlength=len(sinks)) for each in there), np.zeros(len(sinks), int))
    if taken.all():
        return []
    found = [s.positions for world in range(sim.worlds) for s in sim.samples(world) if isinstance(s, ParticleSample)]
    x = np.concatenate([*found, np.zeros((0, 3))])
    return [f"{sinks[k].path}: it has taken nothing in {sim.frame} frames{_nearest_place(sinks[k], x, sim.time)}; expected: "
            "particles that come into its shape; fix: move it, make it larger, or give more frames"
            for k in np.flatnonzero(taken == 0)]


def _nearest_place(sink, x: np.ndarray, time: float) -> str:
    """How far the nearest particle is from a sink at a time, in words; nothing of a mesh, whose distance is not asked for."""
    if not len(x):
        return ", and no particle is there"
    if isinstance(sink.shape, Surface):
        return ""
    M = sink.motion.at(time)
    nearest = float(shape_row(sink.shape).distance(sink.shape, (x - M[:3, 3]) @ M[:3, :3]).min())
    return f", and the nearest particle is {nearest:.3g} m away now" if nearest > 0.0 else ""
