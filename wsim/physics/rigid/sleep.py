"""Sleep of rigid bodies (kernels/rigid/graph/sleep.py), where a scene asks for it by `sleep_speed` or has some that start so.

A frame in which everything sleeps and no collider moves is not stepped on a CPU; on a GPU its lists are made, and its passes
have nothing to do. Bodies that joints hold, and scenes with points, do not sleep: what wakes them is not known here.
"""

from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.rigid.graph import sleep
from wsim.model.state import Field, Part

FIELDS = (Field("calm", "s", True, "how long the body has been slow, at most what sleep takes", "scalar"),
          Field("asleep", "", True, "1: it sleeps", "int"))
AWAKE = (Field("awake", "", True, "0 while every body sleeps", "int"),)


class Sleep:
    """Sleep of the bodies of a method; `awake`: a word on the device, 0 while everything sleeps."""

    def __init__(self, b, method):
        self.model, self.part, self.speed = b.model, method.part, b.scene.sleep_speed
        begins = np.array([body.asleep for body, _ in method.bodies])
        values = (begins * float(sleep.CALM), begins)
        for what, value in zip(FIELDS, values, strict=True):
            kind = b.model.dtype if what.type == "scalar" else np.int32
            method.part.take(what, wp.array(value.astype(kind), dtype=what.dtype(b.model.real), device=b.model.device))
        for array, aside in method.part.saved.values():
            wp.copy(aside, array)
        word = Part.allocate("rigid sleep", AWAKE, 1, b.model.real, b.model.device)      # a repeated frame starts from it
        b.state.add(word)
        self.awake = word.arrays["awake"]
        self.awake.fill_(1)
        self.kernel: Any = None
        self.counted: Any = None

    def make(self, form) -> None:
        """Makes its kernels, as the passes of this form are launched."""
        self.form = form
        self.kernel = sleep.sleep(self.model.real, form.module, form.meet, **form.sizes)
        self.counted = sleep.counted(self.model.real, self.model.module)

    def arrays(self, bodies: int) -> dict[str, wp.array]:
        """Arrays that the kernels work on."""
        own = {name: wp.zeros(bodies, dtype=int, device=self.model.device) for name in ("label", "roused")}
        return own | {"calm": self.part.arrays["calm"], "asleep": self.part.arrays["asleep"], "awake": self.awake}

    def settle(self, k: int, time: float, rig) -> None:
        """Settles what sleeps, behind the making of manifolds for `time` [s] from substep k on."""
        self.form.launch(self.kernel, [self.form.threads, k, time, self.speed, rig], [])

    def end(self, room: int, rig) -> None:
        """Ends a frame, behind the substeps."""
        self.model.launch(self.counted, room, [rig], [])

    def wake(self, rows: np.ndarray | None = None) -> None:
        """Bodies of these rows (None: all) are not calm, and their islands wake."""
        for name in ("calm", "asleep"):
            array = self.part.arrays[name]
            values = array.numpy()
            values[slice(None) if rows is None else rows] = 0
            array.assign(values)
        self.awake.fill_(1)
