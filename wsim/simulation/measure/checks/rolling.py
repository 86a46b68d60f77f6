"""Bodies that roll or spin too fast for the substeps: hulls on their facets, coins on their rims (kernels/rigid/checks.py).

If the scene names no substeps, such a frame is repeated with enough of them. Otherwise the run warns, with the number that is
enough."""

from __future__ import annotations

from math import ceil

import numpy as np
import warp as wp

from wsim.kernels.rigid import checks
from wsim.kernels.rigid.narrow.shape import KINDS
from wsim.model.stage import Clock, Remedy
from wsim.model.status import FrameStatus
from wsim.simulation.measure.checks.lost import TOLD
from wsim.simulation.predicted.rolling import FEW, ROLLS

WORD = "bodies that roll too fast"
SAID = 1.1             # ratio to the figure in a warning before the run, up to which the warning is not repeated
ROLLED = {KINDS["hull"]: "hull", KINDS["cylinder"]: "rim", KINDS["cone"]: "rim"}


def kinds_of_rigid_shapes(contacts) -> np.ndarray:
    """Kind of each shape that belongs to a rigid body."""
    return contacts.table.kind.numpy()[:contacts.table.still]


class RollingCheck:
    """lasted: facets or radians that have passed in successive frames so far, (worlds,); a part of the state."""

    def __init__(self, b, rigid, lasted: wp.array):
        self.model, self.rigid, self.status, self.lasted = b.model, rigid, b.status, lasted
        b.status.reserve(WORD, b.model.worlds)
        self.found, self.last = (wp.zeros(b.model.worlds, dtype=wp.int64, device=b.model.device) for _ in range(2))
        self.check = checks.rolling_check_kernel(b.model.real)
        self.kernels = [self.check, checks.close_rolling]
        self.worst: dict[str, tuple[float, str]] = {}         # of each path: most that passed in a substep, and its message
        self.told = b.choice.need.roll                        # before the run

    @staticmethod
    def wanted(rigid) -> bool:
        """True if a body has a hull, a cylinder or a cone for a shape."""
        return rigid.contacts is not None and bool(np.isin(kinds_of_rigid_shapes(rigid.contacts), list(ROLLED)).any())

    def launch(self, clock: Clock) -> None:
        contacts, k = self.rigid.contacts, clock.substeps - 1
        self.model.launch(self.check, contacts.room, [contacts.rig(), contacts.hulls, k, clock.h], [self.found])
        self.model.launch(checks.close_rolling, self.model.worlds, [self.found, clock.substeps], [self.lasted, self.last,
                                                                                                 self.status.word(WORD)])

    def passed(self, world: int | None = None) -> tuple[float, int]:
        """Most facets or radians that pass in a substep of the last frame, of a world or of all, and the index of the shape."""
        most = int(self.last.numpy()[slice(None) if world is None else world].max())
        return 1e-3 * (most >> 32), most & 0xFFFFFFFF

    def find_remedies(self, status: FrameStatus, substeps: int) -> list[Remedy]:
        if not status.said(WORD).any():
            return []
        return [Remedy("check", why=WORD, steps=ceil(substeps * self.passed()[0] / FEW), worlds=status.worlds_that_said(WORD))]

    def frame_warnings(self, status: FrameStatus, substeps: int) -> list[tuple[tuple, float, str]]:
        return [said for world in status.worlds_that_said(WORD)[:TOLD] for said in self._warning_of_world(world, substeps)]

    def _warning_of_world(self, world: int, substeps: int) -> list[tuple[tuple, float, str]]:
        passed, shape = self.passed(world)
        (path, _), what = self.rigid.contacts.named[shape], ROLLS[ROLLED[kinds_of_rigid_shapes(self.rigid.contacts)[shape]]]
        if path == self.told.path and passed < SAID * self.told.rate / self.model.scene.fps / substeps:
            return []
        where = path + self.model.of_world(world)
        if passed > self.worst.get(where, (0.0, ""))[0]:
            self.worst[where] = passed, (f"{where} {what.format('{worst}')} in a substep, and loses too much speed; "
                                        f"give --substeps {ceil(substeps * passed / FEW)} (now {substeps})")
        return [((WORD, where), passed, self.worst[where][1])]
