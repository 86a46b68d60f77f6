"""How the passes of rigid contact are launched, by a rule of sizes and devices (RULE), never by timing.

    listed      one thread, manifold by manifold, all substeps in a launch (CPU)
    coloured    one thread, colour by colour: the bits of the forms below (CPU, asked for by name)
    block       a block, colour by colour, whose threads meet after each; all substeps in a launch
    cluster     a cluster of blocks, as a block
"""

from dataclasses import dataclass, field
from typing import Any

import warp as wp

from wsim.kernels.math import block
from wsim.kernels.rigid import colours, passes, soft_step
from wsim.physics.motion.cluster import LARGE, MANY

RULE = 1                  # of the choice below; a change of it changes which form a scene takes
CLUSTERS = 90             # compute capability that has clusters
THREADS = 256             # of a block, for which there are 255 registers each
SMALL = 256               # shapes up to which a block has a thread for each manifold of a colour
TITLES = {"listed": "one thread, manifold by manifold", "coloured": "one thread, colour by colour",
          "block": f"a block of {THREADS} threads, colour by colour"}


@dataclass
class Form:
    """name: of the table above; blocks: of a cluster, else 1. Raises ValueError for another name."""

    name: str
    blocks: int = 1
    kernels: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self):
        if self.name not in (*TITLES, "cluster"):
            raise ValueError(f"form is {self.name!r}; there are {', '.join((*TITLES, 'cluster'))}")

    @property
    def coloured(self) -> bool:
        return self.name != "listed"

    @property
    def threads(self) -> int:
        return THREADS * self.blocks if self.name in ("block", "cluster") else 1

    @property
    def what(self) -> str:
        return TITLES.get(self.name, f"a cluster of {self.blocks} blocks of {THREADS} threads, colour by colour")

    def make(self, model, bouncing: bool, linked: bool = False) -> None:
        """Its kernels, in the model's modules; linked: there are joints."""
        real, wide = model.real, self.threads > 1
        meet = block.meet_cluster if self.blocks > 1 else block.meet if wide else block.alone
        sizes = {"threads": THREADS, "cluster": self.blocks if self.blocks > 1 else 0} if wide else {}
        module = model.module_of(THREADS) if wide else model.module
        kinds = [soft_step.contact_kind(real, self.coloured)]
        steps = passes.substeps
        if linked:
            from wsim.kernels.rigid.joint.passes import linked as steps
        self.kernels["substeps"] = steps(kinds, real, module, meet, bouncing=bouncing, **sizes)
        if self.coloured:
            self.kernels["colours"] = colours.colours(real, module, meet, **sizes)

    def launch(self, model, name: str, inputs: list, outputs: list) -> None:
        if self.threads > 1:
            model.launch_blocks(self.kernels[name], self.blocks, THREADS, inputs, outputs)
        else:
            model.launch(self.kernels[name], 1, inputs, outputs)

    def colour(self, model, rig, serial: wp.array) -> None:
        """Colours of the manifolds that there are; serial: a word, how many found none."""
        if self.coloured:
            self.launch(model, "colours", [self.threads, rig], [serial])

    def advance(self, model, steps: tuple[int, int, int], h: float, *rig) -> None:
        """Substeps steps[0] .. steps[1] of h [s], of steps[2] sweeps."""
        self.launch(model, "substeps", [wp.vec3i(*steps), h, self.threads, *rig], [])


def chosen(device, shapes: int) -> Form:
    """By the rule."""
    if not device.is_cuda:
        return Form("listed")
    if shapes <= SMALL or device.arch < CLUSTERS:
        return Form("block")
    return Form("cluster", 16 if device.arch == LARGE and device.sm_count >= MANY else 8)
