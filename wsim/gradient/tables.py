"""What of a plan's tables has gradients on the device; what a scene says of it: `wsim.gradient.gradient`."""

from typing import Any

import numpy as np
import warp as wp

NAMES = ("stiffness", "tau", "mu", "lam", "alpha", "pressure", "rest", "edge")        # in tables of elements


class GradientTables:
    """The arrays of a plan that have gradients, by what they mean."""

    def __init__(self, plan):
        self.plan, self.model = plan, plan.model
        self.pull: Any = plan.ports.force_gather
        self.batches = plan.ports.xpbd_batches                               # of XPBD
        self.springs = self.pull.springs if self.pull else []                      # rows, of the other solvers
        self.flat = [e for e in self.pull.elements if hasattr(e, "kind")] if self.pull else []       # hinges and triangles
        self.tables = self.pull.tables if self.pull else []                        # tets
        self.points, contacts = plan.ports.constants, plan.ports.contacts
        self.muscles, self.loads, self.pins = plan.ports.muscles, plan.ports.loads, plan.ports.pins
        self.air, self.bounce = plan.ports.air, plan.ports.restitution
        self.contact = contacts.adjoint if contacts else None
        self.bodies = plan.ports.recorded_bodies

    def arrays(self) -> list[wp.array]:
        """Arrays that are differentiated by, of one kind each."""
        c = self.points
        found = [c.w, c.gravity, c.decay] if c else []
        found += [*self.net().values(), *(b.lengths for b in self.batches if b.lengths)]
        found += self.bodies.tables() if self.bodies else []
        found += [e.curvature.data.value for e in (*self.flat, *self.batches) if e.curvature]
        for data in (source.data for source in (*self.flat, *self.tables, *self.batches)):
            found += [getattr(data, name) for name in NAMES if getattr(data, name, None)]
        for flow in (t.plastic for t in self.tables if t.plastic):
            found += [flow.data.limit, flow.data.edge]
        if self.loads:
            found.append(self.loads.own)
        if self.air:
            found += [self.air.wind, self.air.drag, self.air.lift, self.air.normal_drag]
        if self.pins and self.pins.groups["soft"]:
            found += [self.pins.soft.alpha, self.pins.soft.damping]
        if self.bounce:
            found.append(self.bounce.restitution)
        return found + self.targets()

    def rows(self, body) -> list:
        """Constraints of a body."""
        return [r for r in (*self.springs, *(r for table in (*self.flat, *self.batches) for r in table.rows)) if r.body is body]

    def names(self, body) -> list[str]:
        """Values of a body's material that are there, and have derivatives."""
        rows, values = self.rows(body), [part.values for t in self.tables for part in t.parts if part.body is body]
        damped = any(r.tau > 0.0 for r in rows) or any(v["damping"].any() for v in values)
        pressed = any(b is body for t in self.tables for b in getattr(t, "bodies", ()))
        flows = any(part.body is body for t in self.tables if t.plastic for part in t.parts)
        return sorted({name for d in (*(r.stiffness for r in rows), *values) for name in d} - {"damping"}
                      | set(["damping"] * damped + ["pressure"] * pressed + ["yield_strain"] * flows))

    def net(self) -> dict[str, wp.array]:
        """Tables of the entries of springs."""
        found = {name: getattr(self.pull.net, name) for name in ("k", "rest", "damping")
                 if name != "damping" or self.pull.damped} if self.springs else {}
        return found | ({"rest": self.pull.lengths} if self.springs and self.pull.lengths else {})

    def targets(self) -> list[wp.array]:
        """Targets of pins, factors of muscles and values of loads, of a frame."""
        return [*(self.pins.target.values() if self.pins else ()), *([self.muscles.factor] if self.muscles else ()),
                *([self.loads.value] if self.loads else ())]

    def zero(self) -> None:
        for array in self.arrays():
            array.grad.zero_()
        if self.contact:
            self.contact.zero()

    def take_targets(self, first: bool) -> list:
        """Gradients of the pins' targets of a frame, on the device (to wait for them would cost a tenth of small runs), and by
        the keys of muscles, then of loads, from those of their tables, which are zeros then. Of pins that stand still the first
        frame, which comes last, has the sum, and others nothing."""
        keys = [method.by_keys() for method in (self.muscles, self.loads) if method]
        if self.pins and not (first or keys or self.pins.moves):
            return []
        targets = list(self.pins.target.values()) if self.pins else []
        found: list = [wp.clone(array.grad) for array in targets]
        for array in targets:
            array.grad.zero_()
        return found + keys

    def take_motions(self) -> wp.array | list[wp.array] | None:
        """Takes the motions of colliders, as `wsim.physics.contact.contacts_adjoint.ContactAdjoint.take_motion`."""
        return self.contact.take_motion() if self.contact else None

    def ends(self, grad: np.ndarray) -> np.ndarray:
        return sum_over_spring_ends(self.pull, grad)


def sum_over_spring_ends(pull, grad: np.ndarray) -> np.ndarray:
    """Sums over the two ends of each spring of a `wsim.physics.motion.forces.ForceGather`, from a gradient of the entries."""
    entry = pull.entry
    grad = grad[:len(entry)]
    return np.bincount(entry[entry >= 0], grad[entry >= 0], pull.count)
