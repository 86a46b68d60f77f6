"""Bodies and points of a world by one block of threads: lists of contacts, and all rounds of a substep in one launch.
Equations: kernels/rigid/touch/rounds.py."""

from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.rigid.touch import rounds
from wsim.model.stage import Clock
from wsim.model.structs import fill_struct

THREADS = 256                # of a block
FEW = 32                     # bodies of a world that one block solves, at most: a block each solves more of them


def few_bodies(model, rigid) -> bool:
    """Whether a block of threads solves a world; worlds of trees always."""
    return len(rigid.bodies) <= FEW * model.worlds or rigid.joints is not None and rigid.joints.reduced


class WorldBlocks:
    """touch: `wsim.physics.rigid.touch.points.BodyPointContacts`, whose form is made."""

    def __init__(self, touch):
        self.touch, self.model, form = touch, touch.model, touch.form
        cuda = self.model.device.is_cuda
        self.threads = THREADS if cuda else 1
        module = self.model.shared_module("touch_rounds", form.coloured, form.tolerance > 0.0, *["rolling"] * touch.rolling,
                                          threads=THREADS * cuda)
        self.list_kernel = rounds.touch_list_kernel(touch.real, self.threads, module, touch.rolling)
        self.make_rounds(form)

    def make_rounds(self, form) -> None:
        """Kernel of all rounds."""
        kinds, real, module = tuple(form.kinds), self.touch.real, self.list_kernel.module
        self.rounds_kernel = rounds.touch_round_kernel(kinds, real, self.threads, module, self.touch.rolling)

    @property
    def launches(self) -> tuple[int, int]:
        """Of a search, and of an iteration."""
        return 1 + (self.model.worlds > 1), self.touch.rounds if self.touch.joints else 1

    def room(self) -> None:
        """Arrays of worlds, and those of their bodies and contacts."""
        touch, model = self.touch, self.model
        n, worlds = len(touch.rigid.bodies), model.worlds
        first = np.searchsorted([world for _, world in touch.rigid.bodies], np.arange(worlds + 1)).astype(np.int32)

        def zeros_for_worlds(length: int, dtype):
            return wp.zeros(length, dtype=dtype, device=model.device)
        self.table: Any = fill_struct(
            rounds.world_type(touch.real), rows=touch.rows, hubs=touch.hubs, found=touch.found, shapes=touch.shapes,
            first=wp.array(first, dtype=int, device=model.device), points=model.points // worlds,
            many=zeros_for_worlds(worlds, int),
            point=zeros_for_worlds(model.points, int), count=zeros_for_worlds(n, int), going=zeros_for_worlds(worlds, int),
            V=touch.V, aim=zeros_for_worlds(2 * n, wp.vec3d), was=zeros_for_worlds(2 * n, wp.vec3d), left=touch.left)

    def list(self, clock: Clock) -> None:
        """Lists points that touch something, and contacts in the order of bodies, behind a search."""
        touch = self.touch
        for phase in ((1, 2) if self.model.worlds > 1 else (0,)):
            touch.blocks(self.list_kernel, [self.table, touch.rigid.contacts.rig(), touch.contacts.slots, touch.points(clock),
                                            phase], [], self.model.worlds, self.threads)

    def solve(self, clock: Clock) -> None:
        """All rounds of an iteration; in a launch each where joints have their passes between them."""
        touch, own, c = self.touch, self.touch.rigid.contacts, self.touch.contacts
        each = 1 if touch.joints else touch.rounds
        for k in range(0, touch.rounds, each):
            steps = wp.vec4i(clock.k, 0 if touch.alone else own.sweeps, each, int(k == 0))
            given = [c.table, c.points, c.slots, touch.points(clock), self.table, steps, own.rig()]
            touch.blocks(self.rounds_kernel, given, [], self.model.worlds, self.threads)
            touch.joined(clock)
