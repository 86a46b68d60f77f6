"""Substeps of bodies by what pushes them: points, or strands alone."""

from wsim.model.stage import Clock
from wsim.physics.rigid.touch.substeps import Substeps


class Alone(Substeps):
    """Bodies that strands push, and no points: sweeps go before them, so that what rests is seen at rest, and behind."""

    def begin(self, clock: Clock) -> None:
        super().begin(clock)
        self.sweep(clock)

    def end(self, clock: Clock) -> None:
        self.sweep(clock)
        super().end(clock)


def pushed(b, rigid, points: bool) -> Substeps:
    """Substeps of bodies that points push, or strands alone."""
    if not points:
        return Alone(b, rigid)
    from wsim.physics.rigid.touch.points import Touch
    return Touch(b, rigid)
