"""Momentum of bodies that nothing holds, in the steps of `wsim.physics.solver.newton`. Equations:
kernels/solver/rigid_translation.py."""

import numpy as np
import warp as wp

from wsim.kernels.solver import rigid_translation as kernels
from wsim.model.model import Model
from wsim.model.ports import NewtonTerm
from wsim.physics.solver.assembly import Assembly
from wsim.scene.nodal.touching import collides_with_surfaces


def sharing_groups(model: Model) -> np.ndarray:
    """Number of the group of each body, (bodies,), ascending by the first of each: bodies that share points are one."""
    of = np.arange(len(model.bodies))
    number = np.repeat(of, [b.count for b in model.bodies])
    pairs = np.stack([number[model.gone], number[model.shared(model.gone)]], axis=1)
    for a, b in np.unique(pairs, axis=0):
        one, other = sorted((of[a], of[b]))
        of[of == other] = one
    return np.unique(of, return_inverse=True)[1]


def free_groups(assembly: Assembly, group: np.ndarray) -> np.ndarray:
    """1 for each group of bodies no point of which is held, else 0; points that nothing is made of, or that another stands for,
    have no mass and count for neither."""
    w, found = assembly.rows.w.numpy(), np.ones(group.max(initial=-1) + 1, np.int32)
    for body, k in zip(assembly.model.bodies, group, strict=True):
        moved = np.setdiff1d(np.arange(body.first, body.last), body.idle)
        found[k] &= int(w[moved].all())
    return found


def momentum_term(assembly: Assembly, lanes: int) -> "Momentum | Joined | None":
    """The term of a system; None where all bodies are held. lanes: threads that sum over a body."""
    def group_momentum_term(group: np.ndarray) -> Momentum | None:
        loose = free_groups(assembly, group)
        return Momentum(assembly, lanes, group, loose) if loose.any() else None
    group = sharing_groups(assembly.model)
    alone, joined = group_momentum_term(group), touching_groups(assembly.model, group)
    return Joined(assembly, alone, group_momentum_term(joined)) if alone and joined is not group else alone


def touching_groups(model: Model, group: np.ndarray) -> np.ndarray:
    """Groups where bodies of a world whose surfaces touch are one."""
    found = group
    for world in range(model.worlds):
        touch = [b.number for b in model.bodies if b.world == world and collides_with_surfaces(b.source, model.scene)]
        if touch:
            mine = np.unique(group[touch])
            found = np.where(np.isin(group, mine), mine[0], found)
    return found if found is group else np.unique(found, return_inverse=True)[1]


class Joined(NewtonTerm):
    """Momentum of bodies that push each other where they are near: each by itself elsewhere."""

    def __init__(self, assembly: Assembly, alone: "Momentum", joined: "Momentum | None"):
        self.assembly, self.alone, self.joined = assembly, alone, joined

    def complete_step(self) -> None:
        """Adds it to y."""
        y = self.assembly.v.y
        self.add(y, y)

    def add(self, y: wp.array, to: wp.array) -> None:
        """Adds the translations of y to `to`, as `Momentum.add` does."""
        def add_joined_translations() -> None:
            if self.joined:
                self.joined.add(y, to)
        self.assembly.system.joined.when_near(add_joined_translations, lambda: self.alone.add(y, to))


class Momentum(NewtonTerm):
    """The momentum of translation that a Newton step lacks, of each group of bodies by itself."""

    def __init__(self, assembly: Assembly, lanes: int, group: np.ndarray, free: np.ndarray):
        """group: of each body, (bodies,); free: 1 for each group that nothing holds."""
        self.assembly, self.lanes, model = assembly, lanes, assembly.model
        self.amount, self.mean = (kernels.momentum_part_kernel(model.real, model.module),
                                  kernels.mean_translation_kernel(model.real, model.sweep_module))
        self.translate, self.free = kernels.group_translation_kernel(model.real, model.module), model.upload(free, int)
        order, counts = np.argsort(group, kind="stable"), [b.count for b in model.bodies]
        spans = np.array([(model.bodies[k].first, model.bodies[k].last) for k in order], np.int32)
        self.spans = model.upload(spans, wp.vec2i)                    # those of a group in a row
        self.first = model.upload(np.searchsorted(group[order], np.arange(len(free) + 1)).astype(np.int32), int)
        self.of = model.upload(np.repeat(group, counts).astype(np.int32), int)
        self.part = wp.zeros(len(group) * lanes, dtype=wp.vec4d, device=model.device)
        self.shift = wp.zeros(len(free), dtype=wp.vec3d, device=model.device)

    def complete_step(self) -> None:
        """Adds it to y."""
        y = self.assembly.v.y
        self.add(y, y)

    def add(self, y: wp.array, to: wp.array) -> None:
        """Adds the translations that a step y lacks to displacements of all points, `to`."""
        own, m = self.assembly, self.assembly.model
        m.launch(self.amount, self.part.size, [self.spans, self.lanes, own.A, own.state.d, own.b, y], [self.part])
        own.system.launch(self.mean, [self.first, self.lanes, self.free, self.part], [self.shift], self.shift.size)
        m.launch(self.translate, m.points, [self.of, self.shift, to], [to])
