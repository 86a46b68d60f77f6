"""Targets and speeds of drives that vary in time, at the start of a frame and the end of each substep: between these a target
goes evenly (kernels/rigid/joint/drives.py), so that what it drives converges with order 2."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from wsim.model.stage import Clock

AIMS = ("target", "speed")


def varying_drive_targets(scene) -> list:
    """The `Varying` of a scene that are targets or speeds of drives."""
    paths = {joint.path for joint in scene.things("Joint") if joint.enabled and joint.drives}
    return [thing for thing in scene.varying if thing.name in AIMS and thing.path in paths]


class DriveTargets:
    """Tables `aim` and `pace` of joints, (substeps + 1, joints, 6): rows of drives that follow a curve, and the
    others as they are."""

    def __init__(self, joints, things: list):
        """joints: `wsim.physics.rigid.joints.tables.DeviceJoints`; things: of `varying_drive_targets`."""
        self.joints, self.last = joints, dict[str, np.ndarray]()
        # (path, name, world) -> curve and (joint, row) of its drives; what a user sets by hand leaves it
        self.ways: dict[tuple[str, str, int], tuple[Any, np.ndarray]] = {
            (thing.path, thing.name, world): (thing.curve, np.array(joints.drives(thing.path, world)[0]).T)
            for thing in things for world in range(joints.model.worlds)}
        self.names = {(thing.path, thing.name) for thing in things}

    def leave(self, path: str, name: str, world: int | None) -> None:
        """A value that was set by hand stays as it was set."""
        for key in [key for key in self.ways if key[:2] == (path, name) and world in (None, key[2])]:
            del self.ways[key]

    def before_frame(self, time: float, clock: Clock) -> None:
        linked, times = self.joints.linked, time + clock.h * np.arange(clock.substeps + 1)
        t = linked.t
        for name, field in zip(AIMS, ("aim", "pace"), strict=True):
            still = np.array(getattr(t, name).numpy())
            rows = np.tile(still, (clock.substeps + 1, 1, 1))
            for (_, which, _), (curve, at) in self.ways.items():
                if which == name:
                    rows[:, at[0], at[1]] = curve.sampled(times).reshape(clock.substeps + 1, -1)
            self.stir(name, rows)
            if t.aiming == 0 or getattr(t, field).shape != rows.shape:
                setattr(t, field, wp.zeros(rows.shape, dtype=wp.float64, device=self.joints.device))
            getattr(t, field).assign(rows)
        t.aiming = 1
        linked.t = t

    def stir(self, name: str, rows: np.ndarray) -> None:
        """Wakes the bodies of joints that are asked for something else than at the end of the frame before."""
        before, self.last[name] = self.last.get(name, rows[0]), rows[-1]
        if self.joints.method.sleep:
            self.joints.method.sleep.drive(before, before + (rows != before).any(axis=0))

