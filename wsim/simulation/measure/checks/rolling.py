"""Bodies that roll or spin on others faster than substeps follow: hulls on facets, coins on rims (kernels/rigid/checks.py).

Where nobody named the substeps, a frame in which that is so is repeated with as many as are enough. Else the run says how many
are."""

from __future__ import annotations

from math import ceil

import numpy as np
import warp as wp

from wsim.kernels.rigid import checks
from wsim.kernels.rigid.narrow.shape import KINDS
from wsim.model.stage import Clock, Remedy
from wsim.model.status import Status
from wsim.simulation.predicted.rolling import FEW, ROLLS

WORD = "bodies that roll too fast"
SAID = 1.1             # of what was said before the run, up to which it is not said again
ROLLED = {KINDS["hull"]: "hull", KINDS["cylinder"]: "rim", KINDS["cone"]: "rim"}


def kinds(contacts) -> np.ndarray:
    """Kinds of the shapes of bodies."""
    return contacts.table.kind.numpy()[:contacts.table.still]


class Rolling:
    """lasted: (worlds,) facets or radians in frames on end so far, a part of the state."""

    def __init__(self, b, rigid, lasted: wp.array):
        self.model, self.rigid, self.status, self.lasted = b.model, rigid, b.status, lasted
        b.status.reserve(WORD, b.model.worlds)
        self.found, self.last = (wp.zeros(b.model.worlds, dtype=wp.int64, device=b.model.device) for _ in range(2))
        self.check = checks.check_rolling(b.model.real)
        self.kernels = [self.check, checks.close_rolling]
        self.worst: dict[str, tuple[float, str]] = {}         # of each path: what passed at most, and the words of it
        self.told = b.choice.need.roll                        # before the run

    @staticmethod
    def wanted(rigid) -> bool:
        """True if a body has a shape that may roll so."""
        return rigid.contacts is not None and bool(np.isin(kinds(rigid.contacts), list(ROLLED)).any())

    def launch(self, clock: Clock) -> None:
        contacts, k = self.rigid.contacts, clock.substeps - 1
        self.model.launch(self.check, contacts.room, [contacts.rig(), contacts.hulls, k, clock.h], [self.found])
        self.model.launch(checks.close_rolling, self.model.worlds, [self.found, clock.substeps], [self.lasted, self.last,
                                                                                                 self.status.word(WORD)])

    def passed(self) -> tuple[float, int]:
        """What passes in a substep of the last frame, at most, and the shape that it is of."""
        most = int(self.last.numpy().max())
        return 1e-3 * (most >> 32), most & 0xFFFFFFFF

    def retry(self, status: Status, substeps: int) -> list[Remedy]:
        if not status.said(WORD).any():
            return []
        return [Remedy("check", why=WORD, steps=ceil(substeps * self.passed()[0] / FEW))]

    def notes(self, status: Status, substeps: int) -> list[tuple[tuple, float, str]]:
        if not status.said(WORD).any():
            return []
        passed, shape = self.passed()
        (path, _), what = self.rigid.contacts.named[shape], ROLLS[ROLLED[kinds(self.rigid.contacts)[shape]]]
        if path == self.told.path and passed < SAID * self.told.rate / self.model.scene.fps / substeps:
            return []
        if passed > self.worst.get(path, (0.0, ""))[0]:
            self.worst[path] = passed, (f"{path} {what.format('{worst}')} in a substep, which loses speed that it should keep; "
                                        f"give --substeps {ceil(substeps * passed / FEW)} (now {substeps})")
        return [((WORD, path), passed, self.worst[path][1])]
