"""Momenta of bodies as they are read beside points of leapfrog. Equations: kernels/rigid/touch/half_step.py."""

import warp as wp

from wsim.kernels.rigid.touch import half_step
from wsim.model.stage import Clock
from wsim.model.state import StateField
from wsim.model.structs import fill_struct

HALVES = (StateField("ph", "kg m/s", True, "what momentum is read with besides p, at the end of a frame"),
          StateField("Lh", "kg m^2/s", True, "what angular momentum is read with besides L"))


def half_step_fields(choice) -> tuple[StateField, ...]:
    """Fields of bodies that points touch besides those of all bodies, by what steps the points."""
    if choice.solver == "implicit":
        from wsim.physics.rigid.touch.newton import KEPT
        return KEPT
    return HALVES if len(choice.integrator.steps) == 2 else ()


class HalfStepMomenta:
    """The last half of a substep, of bodies (`wsim.physics.rigid.touch.points.BodyPointContacts`) whose points have it too."""

    def __init__(self, touch):
        self.touch, model = touch, touch.model
        self.kernels = [make(model.real, model.module) for make in (half_step.half_impulse_kernel, half_step.half_kick_kernel)]
        self.bare = wp.zeros_like(touch.state.v)

    def before(self, _change: wp.array) -> None:
        """Velocities of points behind their last half kick, of which nothing is left out yet."""
        self.touch.model.copy(self.bare, self.touch.state.v)

    def read(self, clock: Clock) -> None:
        t = self.touch
        part, rig, n = t.rigid.part.arrays, t.rigid.contacts.rig(), len(t.rigid.bodies)
        if t.trees:                                      # a prediction reads what others do where the substep ends
            for array in (part["ph"], part["Lh"], t.found.total):
                array.zero_()
        else:
            t.model.launch(self.kernels[0], n, [rig, t.found], [part["ph"], part["Lh"]])
        t.model.launch(self.kernels[1], t.room_for, [t.contacts.slots, t.points(clock), self.bare, n], [t.rows, t.aside])
        moving = t.rigid.moving()
        rig.now = fill_struct(t.rigid.Moving, p=part["ph"], L=part["Lh"], **{name: getattr(moving, name) for name in "xeqo"})
        t.blocks(t.kernels["take"], [t.rows, t.aside, t.found, 0, t.lanes], [rig])
