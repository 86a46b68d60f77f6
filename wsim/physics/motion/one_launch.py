"""Whole frames of explicit steps in one launch: of a cluster of blocks on a GPU, or of CPU threads abreast."""

from wsim.model.stage import Clock


class OneLaunch:
    """method: `wsim.physics.motion.explicit.Explicit`; kernel: of kernels/motion/cluster.py or march_cpu.py."""

    def __init__(self, method, kernel):
        self.method, self.kernel, self.model = method, kernel, method.model

    def whole(self, clock: Clock):
        """All substeps of a frame, and leapfrog's last half kick."""
        clock.k, half = 0, len(self.method.integrator.steps) == 2
        step = self.method.step(clock, 0.5 if half else 1.0, 1.0, 0)
        step.close = 0.5 * clock.h if half else 0.0
        return step

    def by_cluster(self, clock: Clock) -> None:
        m, s = self.method, self.method.state
        plan = m.pull.cluster
        self.model.launch_blocks(self.kernel, plan.size, plan.threads, [m.net, m.pull.shares, s.x, self.whole(clock)],
                                 [s.x, s.e, s.v, s.r])

    def by_march(self, clock: Clock) -> None:
        """Of one CPU thread, which others join."""
        self.walk(clock, self.method.pull.abreast.lead(self.key(clock)))

    def send(self, clock: Clock) -> None:
        """Before a frame: what the others will run."""
        self.method.pull.abreast.send(self.key(clock), lambda team: self.walk(clock, team))

    def walk(self, clock: Clock, team) -> None:
        """As one of the team."""
        m = self.method
        self.model.launch(self.kernel, 1, [m.net, m.pull.table, self.whole(clock), team], [m.moving, m.pull.space])

    def key(self, clock: Clock) -> tuple:
        """Of what the arguments of `walk` are made."""
        return clock.substeps, clock.h, self.method.stride, 0 if self.method.target is None else self.method.target.ptr
