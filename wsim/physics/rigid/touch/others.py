"""Substeps of bodies by what pushes them: points, or strands alone."""

from wsim.model.stage import Clock
from wsim.physics.rigid.touch.substeps import RigidSubsteps


class StrandPushedSubsteps(RigidSubsteps):
    """Bodies that strands push, and no points: sweeps go before them, so that what rests is seen at rest, and behind."""

    def begin(self, clock: Clock) -> None:
        super().begin(clock)
        self.sweep(clock)

    def end(self, clock: Clock) -> None:
        self.sweep(clock)
        super().end(clock)


def make_pushed_substeps(b, rigid, points: bool) -> RigidSubsteps:
    """Substeps of bodies that points push, or strands alone."""
    if not points:
        return StrandPushedSubsteps(b, rigid)
    from wsim.physics.rigid.touch.points import BodyPointContacts
    return BodyPointContacts(b, rigid)
