"""Carriers of contacts on a device: what a method offers to those that push (`Method.carriers`). Formulas: kernels/carrier/.

A carrier hands a launch its arrays with the coefficients of the integrator that moves it in that substep. A method of another
room, or of a scene's own, makes its own by the formulas that kernels/carrier/response.py lists and a class as those below.
"""

from collections.abc import Callable
from typing import Any

from wsim.kernels.carrier.body import body, kinematic
from wsim.kernels.carrier.body import structs as of_bodies
from wsim.kernels.carrier.points import points
from wsim.kernels.carrier.points import structs as of_points
from wsim.kernels.carrier.response import response
from wsim.model.stage import Clock
from wsim.model.structs import filled
from wsim.scene import Problem, SceneError

# Kinds of features, the first part of a key (kernels/carrier/pairs.py); below OWN they are wsim's
POINT, EDGE, TRIANGLE, TET, BODY, KINEMATIC = range(1, 7)
OWN = 64


def answer(real, clock: Clock):
    """The coefficients of a substep, as kernels/carrier/response.py has them. Raises SceneError for sdirk3, whose stages end at
    times of their own."""
    if clock.integrator.solves > 1:
        raise SceneError(Problem("/", "sdirk3 has stages at times of its own, and what contacts push must stand at the ends of "
                                 "substeps; take wsim:integrator = bdf2, implicit_midpoint or backward_euler"))
    memory = clock.integrator.memory > 0.0
    c = clock.g if memory else clock.g * clock.g / clock.h
    return filled(response(real), h=clock.h, g=clock.g, c=c, ahead=1.0 / clock.part, memory=int(memory))


class Carrier:
    """formulas: function of the precision, see kernels/carrier/response.py. vertices: things that an impulse moves."""

    formulas: Callable
    vertices: int = 0

    def at(self, clock: Clock, base: int) -> tuple[Any, Any]:
        """(Data, Pushed) of a launch in this substep; base: number of its first vertex among those of all carriers."""
        raise TypeError(f"{type(self).__name__} has no arrays")

    def remembers(self, clock: Clock) -> bool:
        """True if its integrator has a memory."""
        return False


class PointCarrier(Carrier):
    """Points of all objects, and edges, triangles and tets between them. The explicit integrators, backward Euler, BDF2 and the
    implicit midpoint."""

    formulas = staticmethod(points)

    def __init__(self, model, state, owner):
        """owner: the method of the points (`constants`, `anchor`)."""
        self.real, self.state, self.owner, self.vertices = model.real, state, owner, model.points

    def at(self, clock: Clock, base: int) -> tuple[Any, Any]:
        s, kinds = self.state, of_points(self.real)
        moved = {"d": s.d, "a": self.owner.anchor, "e": s.e, "v": s.v}
        return (filled(kinds.Data, w=self.owner.constants.w, x=s.x, by=answer(self.real, clock), base=base, **moved),
                filled(kinds.Pushed, **moved))

    def remembers(self, clock: Clock) -> bool:
        return clock.integrator.memory > 0.0


class BodyCarrier(Carrier):
    """Rigid bodies whose integrator solves for the end of a substep: v = (d - a) / h, omega = (turn - twist) / h."""

    formulas = staticmethod(body)

    def __init__(self, real, arrays: dict[str, Any]):
        """arrays: w, inverse, x, q, d, a, turn, twist as kernels/carrier/body.py has them, (bodies,)."""
        self.real, self.arrays, self.vertices = real, arrays, len(arrays["w"])

    def at(self, clock: Clock, base: int) -> tuple[Any, Any]:
        kinds, h = of_bodies(self.real), clock.h
        by = filled(response(self.real), h=h, g=h, c=h, ahead=1.0, memory=0)
        return (filled(kinds.Data, by=by, base=base, **self.arrays),
                filled(kinds.Pushed, **{name: self.arrays[name] for name in ("d", "a", "turn", "twist")}))


class KinematicCarrier(Carrier):
    """Colliders: they push and are not pushed. `id` of a feature is a row of their table."""

    formulas = staticmethod(kinematic)

    def __init__(self, contacts):
        """contacts: `wsim.physics.contact.contacts.Contacts`, whose poses are those of the substeps of a frame."""
        self.contacts = contacts

    def at(self, clock: Clock, base: int) -> tuple[Any, Any]:
        kinds, table = of_bodies(self.contacts.real), self.contacts.table
        return filled(kinds.Poses, pose=table.pose, step=table.step, k=clock.k, h=clock.h), kinds.Still()
