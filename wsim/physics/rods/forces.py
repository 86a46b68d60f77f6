"""Forces from outside on strands: loads on their points, and the reactions of pins.

    reaction     R = m (a + k v - g) - f - F,  a = (X(t + dt) - 2 X(t) + X(t - dt)) / dt^2,  dt a frame

as `wsim.simulation.measure.reaction` has it: X where the pin puts the point, f what edges and bends put on it
(kernels/rods/forces.py), F loads, k the decay by air. Contacts take no part. A clamp bears a moment too, which its two points
share as a couple; its moment about the edge itself is not in R.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from wsim.kernels.rods.forces import strand_force_kernel
from wsim.model import kernel_cache
from wsim.physics.rods.tables import StrandTable
from wsim.scene import Problem, Scene, SceneError
from wsim.scene.attachments import body_ties
from wsim.scene.nodal.loads import given_curve

if TYPE_CHECKING:
    from wsim.physics.rods.method import RodMethod


class StrandLoads:
    """Loads on points of strands: `borne`, of each load and world its curve, the flat rows of its points and their parts."""

    def __init__(self, scene: Scene, table: StrandTable, strands: Any, substeps: int):
        self.table = table
        self.borne: list[list[Any]] = [
            [load, load.curve, table.place[k][load.points], load.parts, world]
            for k, (rods, world) in enumerate(table.pairs) for load in scene.loads if load.body == rods.path]
        self.rows = np.unique(np.concatenate([each[2] for each in self.borne])) if self.borne else np.zeros(0, np.int64)
        self.put_tables(strands, substeps)

    def put_tables(self, strands: Any, substeps: int) -> None:
        """Makes the tables of a frame of so many substeps; none without loads."""
        self.changed = True
        if not self.borne:
            return
        device, row = strands.points.device, np.full(self.table.longest * self.table.strands, -1, np.int32)
        row[self.rows] = np.arange(len(self.rows))
        strands.load_row = wp.array(row.reshape(self.table.longest, -1), dtype=int, device=device)
        strands.load_force = wp.zeros((substeps, len(self.rows)), dtype=wp.vec3d, device=device)

    def upload(self, strands: Any, times: np.ndarray) -> None:
        """Uploads forces at the ends of substeps [s], where some have changed."""
        if self.borne and (self.changed or any(curve.moves for _, curve, *_ in self.borne)):
            self.changed = False
            strands.load_force.assign(np.stack([self.forces(t)[self.rows] for t in times.tolist()]))

    def forces(self, time: float) -> np.ndarray:
        """Force on each flat row [N], (rows, 3), at a time [s]."""
        found = np.zeros((self.table.longest * self.table.strands, 3))
        for _, curve, rows, parts, _ in self.borne:
            np.add.at(found, rows, parts[:, None] * curve.at(time))
        return found

    def set_value(self, path: str, name: str, value, world: int | None) -> bool:
        """Takes a force [N] of a load, as `wsim.scene.nodal.loads.given_curve` does."""
        hit = [each for each in self.borne if each[0].path == path and each[0].name == name and world in (None, each[4])]
        for each in hit:
            each[1] = given_curve(each[0], each[1], value)
        self.changed |= bool(hit)
        return bool(hit)


class StrandReactions:
    """Reactions of the pins of strands; its kernel is compiled when first asked for."""

    def __init__(self, strands: RodMethod):
        self.strands = strands
        self.kernel: Any = None

    def paths(self) -> list[str]:
        return list(dict.fromkeys(pin.path for pin in self.strands.table.pins))

    def takes(self, path: str | None) -> bool:
        """True if a path is that of a pin of strands, or of a tie of theirs to a rigid body."""
        return path in self.paths() or any(tie.path == path for rods, _ in self.strands.table.pairs
                                           for tie in body_ties(self.strands.model.scene, rods.path))

    def _tie_forces(self, path: str, world: int) -> np.ndarray | None:
        """Forces of a rigid body on the points of a tie, as the last substep had them [N]; None: it is no tie."""
        s, t = self.strands, self.strands.table
        for (rods, of), place in zip(t.pairs, t.place, strict=True):
            for tie in body_ties(s.model.scene, rods.path):
                if tie.path == path and of == world:
                    return np.asarray(s.part.arrays["tie"].numpy()[place[tie.points]])
        return None

    def of(self, path: str, world: int, time: float) -> np.ndarray:
        """Reaction forces of a pin at `time` [s], or those of a tie, in the order of its points [N], (points, 3)."""
        s, t = self.strands, self.strands.table
        if (tied := self._tie_forces(path, world)) is not None:
            return tied
        found = [(rods, place) for (rods, of), place in zip(t.pairs, t.place, strict=True) if of == world
                 for pin in rods.pins if pin.path == path]
        if not found:
            raise SceneError(Problem(path, f"is no pin of world {world}; strands have {', '.join(self.paths()) or 'none'}"))
        rods, place = found[0]
        pin = next(pin for pin in rods.pins if pin.path == path)
        rows, dt = place[pin.points], s.clock.dt
        after, now, before = (self._targets(rows, time + step * dt) for step in (1.0, 0.0, -1.0))
        a = ((after - now) - (now - before)) / dt**2
        a -= s.strands.gravity.numpy()[rows % t.strands]
        if s.airy:
            a += s.strands.decay.numpy()[rows % t.strands, None] * s.part.arrays["v"].numpy()[rows]
        return t.masses[rows, None] * a - self._elastic_strand_forces()[rows] - s.loads.forces(time)[rows]

    def _targets(self, rows: np.ndarray, time: float) -> np.ndarray:
        """Where pins put points at a time [m], (points, 3)."""
        t = self.strands.table
        held = [t.held[t.hold.ravel()[row]] for row in rows]
        frames = t.frames(np.array([time]))[0]
        return np.stack([frames[k][:3, :3] @ place + frames[k][:3, 3] for k, place, _ in held])

    def _elastic_strand_forces(self) -> np.ndarray:
        s, t = self.strands, self.strands.table
        if self.kernel is None:
            self.kernel = strand_force_kernel(s.airy, f"wsim_rods_reactions{'_air' * s.airy}")
            kernel_cache.load_kernel_module(self.kernel.module, s.model.device)
        out = wp.zeros((t.longest, t.strands), dtype=wp.vec3d, device=s.model.device)
        wp.launch(self.kernel, t.strands, [s.strands, s.moving()], [out], device=s.model.device)
        return out.numpy().reshape(-1, 3)

