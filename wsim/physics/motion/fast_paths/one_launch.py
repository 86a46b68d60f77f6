"""Whole frames of explicit steps in one launch: of a cluster of blocks on a GPU, or of CPU threads abreast; and the frames
without contacts of a scene that has colliders."""

from __future__ import annotations

from typing import Any

from wsim.kernels.motion.fast_paths import cluster
from wsim.kernels.motion.fast_paths.march_cpu import march_set
from wsim.model.stage import FREE, MET, Clock, Stage
from wsim.model.structs import fill_struct, struct_values
from wsim.physics.motion.forces import ForceGather

LARGEST = 8192         # points of a world that a cluster takes at most, see `wsim.physics.motion.fast_paths.cluster`


class OneLaunch:
    """method: `wsim.physics.motion.explicit.Explicit`; kernel: of kernels/motion/fast_paths/cluster.py or march_cpu.py; pull:
    forces, if not those of the method."""

    def __init__(self, method, kernel, pull=None):
        self.method, self.kernel, self.model, self.pull = method, kernel, method.model, pull or method.pull
        self.shares: Any = None          # of a cluster, and
        self.moving: Any = None          # what a march works on: if not those of the method

    def whole(self, clock: Clock):
        """All substeps of a frame, and leapfrog's last half kick."""
        clock.k, half = 0, len(self.method.integrator.steps) == 2
        step = self.method.step(clock, 0.5 if half else 1.0, 1.0, 0)
        step.close = 0.5 * clock.h if half else 0.0
        return step

    def by_cluster(self, clock: Clock) -> None:
        pull, s = self.pull, self.method.state
        plan = pull.cluster
        if pull.domains:
            pull.domains.begin()
        self.model.launch_blocks(self.kernel, plan.size * self.model.worlds, plan.threads,
                                 [pull.net, self.shares or pull.shares, s.x, self.whole(clock)], [s.x, s.e, s.v, s.r])

    def by_march(self, clock: Clock) -> None:
        """Launch of one CPU thread, which others join."""
        self.walk(clock, self.pull.abreast.lead(self.key(clock)))

    def send(self, clock: Clock) -> None:
        """Sends what the others will run, before a frame."""
        if not self.method.marches:
            return
        self.pull.abreast.send(self.key(clock), lambda team: self.walk(clock, team))

    def walk(self, clock: Clock, team) -> None:
        """Runs a frame as one of the team."""
        moving = self.moving or self.method.moving
        self.model.launch(self.kernel, 1, [self.pull.net, self.pull.table, self.whole(clock), team], [moving, self.pull.space])

    def key(self, clock: Clock) -> tuple:
        """Key of what the arguments of `walk` are made of."""
        return clock.substeps, clock.h, self.method.stride, 0 if self.method.target is None else self.method.target.ptr


def whole_frames(method, size: int, what: str) -> tuple[Any, list[Stage]]:
    """Form of a method whose frames a launch takes, and of others' what that takes along. size: bytes of a frame."""
    pull, s = method.pull, method.state
    if pull.cluster:
        method.model.fuser = None                # of which nothing is left
        one: Any = OneLaunch(method, None)
        if method.taken <= {"aero", "loads"}:
            one.kernel = pull.frames()
        else:
            from wsim.physics.motion.fused.acted import ActedFrames
            kinds = {"limit": "strain limits", "tether": "tethers"}
            hard = ", ".join(sorted({kinds[r.kind] for r in method.model.constraints if r.hard}))
            one, what = ActedFrames(one), f"{what}, with {', '.join(sorted(method.taken)).replace('xpbd', hard)}"
        return one, [Stage(method.integrator.name, "predict", one.by_cluster, 1, size, "frame", what)]
    one = OneLaunch(method, method.march)
    method.move(s.e, s.v, s.r, None)
    what += f", {pull.abreast.count} threads" * (pull.abreast.count > 1)
    return one, [Stage(method.integrator.name, "predict", one.by_march, 1, size, "frame", what)]


class FreeFrames:
    """Frames of explicit steps in which no point goes so far that it could meet a collider: the launches of the same scene
    without colliders, and so its bits. They watch how far points go (kernels/motion/free_flight_test.py).

    `b`, the velocity half a step before, is left as the last frame with contacts had it: the next of those begins from v with
    half a kick, which is the same but for rounding. The remainder of v that such a frame hands over is that of its half step:
    an error of half an ulp of v, once.
    """

    def __init__(self, method, clock: Clock):
        """Adds a stage to those of the method, which are of frames with contacts then; a march looks at its edges itself."""
        m, model = self.method, self.model = method, method.model
        self.pull, few = m.pull, model.points <= LARGEST * model.worlds
        sheets = False
        if model.device.is_cuda:
            from wsim.physics.motion.fused.domain_decomposition import cluster_cannot_take
            sheets = bool(self.pull.elements) and not cluster_cannot_take(self.pull)
        if not m.taken and m.acts == 0 and m.field is None and (self.pull.only or sheets) and model.device.is_cuda and few:
            own = ForceGather(model, m.points.constants, m.rows, m.columns, alone=True)
            self.pull = own if own.cluster else self.pull
        self.at_once: Any = None         # `OneLaunch`
        self.bounds: Any = None
        self.kernel: Any = None
        self.look: Any = None            # at displacements of an integrator in stages
        for stage in m.stages:
            stage.frames = MET if stage.name != "watch" or m.marches else ""
        (predict,) = (s for s in m.stages if s.phase == "predict")
        m.stages.append(self.stage(predict.bytes, clock.substeps, predict.launches - 1, predict.what))

    def stage(self, size: int, count: int, launches: int, what: str) -> Stage:
        """size: bytes of a substep; launches: of a substep that is launched by itself."""
        m, real, name = self.method, self.model.real, self.method.integrator.name
        if self.pull.cluster:
            self.at_once = OneLaunch(m, self.pull.frames(bounded=True), self.pull)
            return Stage(name, "predict", self.at_once.by_cluster, 1, size * count, "frame", what, FREE)
        if m.marches:
            self.at_once = OneLaunch(m, m.march)
            what += f", {self.pull.abreast.count} threads" * (self.pull.abreast.count > 1)
            return Stage(name, "predict", self.at_once.by_march, 1, size * count, "frame", what, FREE)
        if not m.integrator.stages:
            from wsim.kernels.motion.free_flight_test import bounded_leap_kernel
            self.kernel = bounded_leap_kernel(real, self.model.module, self.pull.flags(), m.field)
            self.kernel.own = self.pull.lanes * (not self.pull.springs)
        return Stage(name, "predict", m.frame, 3 + count * (launches + bool(m.integrator.stages)), size * count, "frame",
                     what, FREE)

    def meet(self, clearance) -> None:
        """clearance: `wsim.physics.contact.free_flight_test.FreeFlightTest`."""
        from wsim.kernels.motion.free_flight_test import flight_bounds
        real, limits = self.model.real, {"room": clearance.room, "met": clearance.word}
        self.bounds = fill_struct(flight_bounds(real), **limits)
        self.look = clearance.look_at
        if self.pull.domains:
            tets = {table.material: table.data for table in self.method.solids}      # whose live values are set
            for name, value in {**limits, **tets}.items():
                setattr(self.pull.shares, name, value)
        elif self.pull.cluster:
            self.at_once.shares = fill_struct(cluster.bounded_shares(real), **struct_values(self.pull.shares), **limits)
        elif self.method.marches:
            s, now = self.method.state, self.method.moving
            self.at_once.moving = fill_struct(march_set(real), x=s.x, d=s.e, q=s.v, v=s.v, carry=s.r, status=now.status,
                                              frame=1, least=self.model.upload([0.0] * self.pull.blocks, real), **limits)

    def send(self, clock: Clock) -> None:
        """Sends as `OneLaunch` does."""
        if self.method.target is not None:
            self.pull.net.target = self.method.target
        if self.at_once and clock.free:
            self.at_once.send(clock)
