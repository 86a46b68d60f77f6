"""Strands that are solved together, for all of a world at once (kernels/rods/coupled_newton/coupled.py), substep by substep:
what rigid bodies are pushed by (bodies.py), and, with the contacts of edges and the proof, what touches itself (touch.py). Else
strands march by themselves (method.py)."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from wsim.kernels.rods import tables
from wsim.kernels.rods.coupled_newton import conjugate, coupled, nodes, team
from wsim.kernels.rods.coupled_newton.closed import ROWS
from wsim.kernels.rods.coupled_newton.ends import coupled_begin_kernels, coupled_end_kernels
from wsim.kernels.rods.coupled_newton.reduced import COLUMNS, PAIRS
from wsim.kernels.rods.coupled_newton.reduction import MATRICES, SIZE
from wsim.kernels.rods.tables import RodStep
from wsim.model.launches import KernelLaunches
from wsim.model.stage import Clock, Remedy
from wsim.model.structs import fill_struct
from wsim.scene import Problem, SceneError

if TYPE_CHECKING:
    from wsim.model.status import FrameStatus
    from wsim.physics.rods.bodies import StrandBodyContacts
    from wsim.physics.rods.method import RodMethod


class CoupledGround(KernelLaunches):
    """The part of a model that search and proof ask for: float64, in a module of its own. points: flat rows of the tables;
    modules: those that the model loads."""

    recorder = tape = fuser = None
    real, dtype = wp.float64, np.float64

    def __init__(self, module: str, strands: RodMethod, points: int, worlds: int):
        self.module, self.modules, self.device = module, strands.model.modules, strands.model.device
        self.points, self.worlds, self.threads = points, worlds, strands.threads

    @property
    def block(self) -> int:
        return self.threads

    def upload(self, values, dtype):
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device=self.device)


TEAM: bool | None = None      # a block of threads a world; None: on a GPU, of fewer than FEW strands
ROOM = 1 << 28                # bytes for what presses among the unknowns of worlds; else rounds are of all points
FEW = 512                     # strands: with as many, a thread each costs no more than a block for all


def uses_thread_teams(table, worlds: int, device) -> bool:
    """True if a block of threads a world solves its strands, False: a thread a strand."""
    return device.is_cuda and table.strands < FEW * worlds if TEAM is None else TEAM


class CoupledStrands:
    """bodies: the rigid ones that its strands meet, None where there are none. carries: what moves them at the end of a substep
    has told them how they go on."""

    carries = False
    memory: Any = None           # of pairs of edges, where there are some

    def __init__(self, strands: RodMethod, module: str, status: FrameStatus, device, bodies: bool = False):
        self.strands, self.table, self.status = strands, strands.table, status
        self.bodies: StrandBodyContacts | None = None
        t, worlds = self.table, strands.model.worlds
        self.ground = CoupledGround(module, strands, t.longest * t.strands, worlds)
        names = strands.obstacles.kinds
        self.begin, self.begin_worlds, self.displace = coupled_begin_kernels(module)
        self.settle_edges, self.settle, self.end, self.remember = coupled_end_kernels(names, module)
        self.zeros = partial(wp.zeros, device=device)
        self.words, self.d = self.zeros(coupled.WORDS, dtype=int), self.zeros(self.ground.points, dtype=wp.vec3d)
        self.pressed: Any = tables.EdgePairs()
        self.corners: Any = None
        self.borne: Any = tables.RodContacts()
        self.often, self.fresh = False, True
        self._allocate_coupled_system(worlds)
        self.team: Any = None
        if uses_thread_teams(t, worlds, device):
            self._make_world_teams(names, module, device, bodies)
            return
        self.assemble, self.measure, self.judge, self.take = coupled.coupled_newton_kernels(names, strands.airy, module,
                                                                                              t.closed)
        (self.carry, self.start, self.apply, self.length, self.step, self.turn, self.aim,
         self.finish) = conjugate.conjugate_gradient_kernels(module, t.closed)

    def _make_world_teams(self, names: tuple[str, ...], module: str, device, bodies: bool) -> None:
        """Tables of blocks of threads that solve a world each."""
        t, zeros, worlds = self.table, self.zeros, self.ground.worlds
        self.threads = team.BLOCK if device.is_cuda else 1
        self.part = nodes.part_point_kernel(names, self.strands.airy, module)
        self.correct, self.conclude = team.correction_kernels(self.threads, bodies, self.ground.module_of(self.threads, "team"),
                                                                t.closed)
        two, size = (t.longest, t.strands), SIZE * ((t.longest + 1) // 2) * t.strands
        most = np.zeros(worlds, np.int32)
        np.maximum.at(most, self.worlds_of, ((t.counts + 1) // 2).astype(np.int32))
        self.team = fill_struct(
            nodes.RodTeam, parts=zeros((6, *two), dtype=wp.mat44d), sides=zeros((3, *two), dtype=wp.vec4d),
            nodes=zeros((MATRICES, SIZE, size), dtype=wp.float64), work=zeros(2 * size, dtype=wp.float64),
            most=self.ground.upload(most, int), sums=zeros(worlds, dtype=wp.vec3d), before=zeros(two, dtype=wp.vec3d))
        steps = int(most.max() - 1).bit_length() + 1
        presses = any(rods.self_collision for rods in self.strands.model.scene.things("Rods")) and not bodies
        if t.closed:
            self.team.slack, self.team.lam = zeros((ROWS, *two), dtype=wp.vec4d), zeros((t.strands, 2), dtype=wp.vec4d)
        elif presses and 8 * worlds * COLUMNS * (COLUMNS + 16 * steps) <= ROOM:
            self.team.chosen, self.team.where = zeros((worlds, PAIRS), dtype=int), zeros((worlds, steps, COLUMNS), dtype=int)
            self.team.path = zeros((worlds, 16 * steps, COLUMNS), dtype=wp.float64)
            self.team.compliance = zeros((worlds, COLUMNS, COLUMNS), dtype=wp.float64)

    def _allocate_coupled_system(self, worlds: int) -> None:
        t, zeros = self.table, self.zeros
        self.worlds_of = of = np.repeat([world for _, world in t.pairs], [own.stop - own.start for own in t.own])
        first = np.searchsorted(of, np.arange(worlds + 1)).astype(np.int32)
        two = (t.longest, t.strands)
        self.group = fill_struct(
            coupled.CoupledRods, first=self.ground.upload(first, int), world=self.ground.upload(of.astype(np.int32), int),
            least=self.ground.upload(np.where(t.values["length"] > 0.0, t.values["length"], np.inf).min(axis=0), wp.float64),
            **{k: zeros(t.strands, dtype=wp.float64) for k in ("sum", "left", "ahead", "gain")},
            **{k: zeros(worlds, dtype=int) for k in ("on", "turn", "count", "rounds", "touched", "back", "rough", "above")},
            **{k: zeros(worlds, dtype=wp.float64) for k in ("scale", "slope", "part", "body", "rho", "rho0", "alpha", "beta")},
            **{k: zeros(worlds, dtype=wp.vec2d) for k in ("low", "high")},
            **{k: zeros(two, dtype=wp.vec4d) for k in ("x", "r", "p", "w", "q", "force", "last")})
        types = {"pivot": wp.mat44d, "b": wp.vec4d, "press": wp.vec3d, "stiff": wp.mat33d, "along": wp.mat33d}
        for name, kind in types.items():
            if getattr(self.strands.trial, name) is None:
                setattr(self.strands.trial, name, zeros(two, dtype=kind))

    def join(self, bodies: StrandBodyContacts) -> None:
        """Takes the rigid bodies that strands meet."""
        self.bodies, self.borne = bodies, bodies.borne

    def weigh(self, gravity: np.ndarray) -> None:
        """Sets gravity [m/s^2], (strands, 3)."""

    # substeps

    def advance(self, clock: Clock) -> None:
        """A frame."""
        self.begin_frame(clock)
        for k in range(self.strands.substeps):
            self.solve(k)
            self.close(k)

    def substep(self, clock: Clock) -> None:
        """A substep among those of rigid bodies."""
        if clock.k == 0:
            self.begin_frame(clock)
        self.solve(clock.k)
        self.close(clock.k)

    def begin_frame(self, clock: Clock) -> None:
        """What all substeps of a frame read."""
        s = self.strands
        s.said.zero_()
        self.h, self.motion = clock.dt / s.substeps, s.moving()

    def each(self, kernel, inputs: list, outputs: list) -> None:
        """Launches a kernel over all strands."""
        self.ground.launch(kernel, self.table.strands, inputs, outputs)

    def points(self, kernel, inputs: list, outputs: list) -> None:
        """Launches a kernel over all points."""
        self.ground.launch(kernel, self.ground.points, inputs, outputs)

    def word(self, k: int) -> wp.array:
        """One word, as conditions of a graph take it."""
        return self.words[k:k + 1]

    def solve(self, k: int) -> None:
        """Displacements of a substep."""
        s, G, T, Q = self.strands, self.group, self.strands.trial, self.motion
        self.points(self.begin, [s.strands, s.holds, Q, T, self.h, k], [])
        self.points(self.displace, [s.strands, Q, T], [self.d.reshape(T.x.shape)])
        self.look()
        if self.bodies:
            self.bodies.begin()
        self.ground.launch(self.begin_worlds, self.ground.worlds, [G, self.words], [])
        newton = self.newton_of_teams if self.team else self.newton
        wp.capture_while(self.word(coupled.GOING), lambda: newton(k))
        if self.bodies:
            self.bodies.give()
        self.points(self.displace, [s.strands, Q, T], [self.d.reshape(T.x.shape)])

    def look(self) -> None:
        """What strands themselves touch, where a substep begins."""

    def lean(self) -> None:
        """Forces of what strands themselves touch, in an iteration."""

    def cross(self) -> None:
        """Those that corrections G.p have, of what strands themselves touch."""

    def hold(self) -> None:
        """What strands themselves touch remembers of a substep."""

    def close(self, k: int) -> None:
        """The end of a substep, by displacements d."""
        s, G, T, Q, d = self.strands, self.group, self.strands.trial, self.motion, self.d.reshape(self.strands.trial.x.shape)
        self.points(self.settle_edges, [s.strands, Q, d, int(not self.carries)], [T, G])
        self.points(self.settle, [s.strands, Q, d], [T])
        self.hold()
        if self.bodies:
            self.bodies.hold()
        self.points(self.end, [s.strands, s.obstacles.table, Q, T, self.pressed, G, fill_struct(RodStep, h=self.h, at=k)],
                    [s.said])
        self.points(self.remember, [s.strands, G], [Q, self.words])

    def newton_of_teams(self, k: int) -> None:
        """One iteration, a block of threads a world."""
        s, G, T, launch = self.strands, self.group, self.strands.trial, self.ground.launch_blocks
        self.lean()
        if self.bodies:
            self.bodies.meet()
        self.points(self.part,
                    [s.strands, s.obstacles.table, self.motion, T, G, self.team, fill_struct(RodStep, h=self.h, at=k)],
                    [self.words])
        if self.bodies:
            self.bodies.lean()
        launch(self.correct, self.ground.worlds, self.threads, [s.strands, T, G, self.pressed, self.team, self.borne],
               [self.words])
        if self.bodies:
            self.bodies.measure()
            launch(self.conclude, self.ground.worlds, self.threads, [s.strands, T, G, self.team, self.borne], [self.words])
            self.bodies.take()

    def newton(self, k: int) -> None:
        """One iteration."""
        s, G, T = self.strands, self.group, self.strands.trial
        self.lean()
        if self.bodies:
            self.bodies.meet()
        self.each(self.assemble, [s.strands, s.obstacles.table, self.motion, T, G, self.h, k], [])
        if self.bodies:
            self.bodies.lean()
        wp.capture_if(self.word(coupled.ACTIVE), self.couple)
        self.each(self.measure, [s.strands, T], [G])
        if self.bodies:
            self.bodies.measure()
        self.ground.launch(self.judge, 1, [G, self.borne, self.words], [])
        self.each(self.take, [s.strands, T, G], [])
        if self.bodies:
            self.bodies.take()

    def couple(self) -> None:
        """The correction of all strands together."""
        s, G, T = self.strands.strands, self.group, self.strands.trial
        if self.bodies:
            self.each(self.carry, [s, T, self.borne, G], [])
        self.ground.launch(self.start, 1, [G, self.words], [])
        wp.capture_while(self.word(coupled.TURNING), self.round)
        self.each(self.finish, [s, T, G], [])

    def round(self) -> None:
        """One round of conjugate gradients."""
        s, G, T, launch = self.strands.strands, self.group, self.strands.trial, self.ground.launch
        self.cross()
        if self.bodies:
            self.bodies.cross()
        self.each(self.apply, [s, self.pressed, self.corners, self.borne, G], [])
        launch(self.length, self.ground.worlds, [G], [])
        self.each(self.step, [s, T, G], [])
        launch(self.turn, 1, [G, self.words], [])
        self.each(self.aim, [s, T, G], [])

    # around a frame

    def before_frame(self) -> None:
        self.words.zero_()                               # they are set before they are read
        self.fresh = False

    def forget_worlds(self) -> None:
        """Raises SceneError where pairs of all worlds are remembered together."""
        if self.memory:
            raise SceneError(Problem(self.table.pairs[0][0].path, "rods that touch themselves remember pairs of all worlds, so "
                                     "that no world is reset alone; fix: reset all"))

    def find_remedies(self) -> list[Remedy]:
        return self.bodies.find_remedies() if self.bodies else []

    def frame_warnings(self) -> list[tuple[tuple, float, str]]:
        return []

    def indicators(self) -> dict[str, float]:
        return self.bodies.indicators() if self.bodies else {}
