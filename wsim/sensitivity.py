"""From gradients of what kernels read to those of what a scene says: the chain rule of parameters, in float64.

Kernels read a number for each spring, hinge, triangle, tet and point, and each has a gradient of its own: sums over many
elements are taken here and not by atomics in float32 (a parameter that 2e7 threads share would be 2.6 % off). Gravity and drag
of the air stand once a point for the same reason.
"""

import numpy as np
import warp as wp

from wsim.cloth import LEAST, Rows
from wsim.masses import density_of
from wsim.scene import Problem, SceneError, Springs


class Parameters:
    """The arrays of a plan that have gradients, by what they mean."""

    def __init__(self, plan):
        self.plan, self.model = plan, plan.model
        explicit, implicit = plan.method("explicit"), plan.method("implicit")
        self.pull = explicit.pull if explicit else implicit.adjoint.pull
        self.points = plan.method("points").constants
        self.pins = plan.method("pins")

    def arrays(self) -> list[wp.array]:
        """Everything that is differentiated by, of one kind each."""
        pull, c = self.pull, self.points
        found = [c.w, c.gravity, c.decay]
        if pull.springs:
            found += [pull.net.k, pull.net.rest] + [pull.net.damping] * pull.damped
        for e in pull.elements:
            data = e.table.data if hasattr(e, "table") else e.data
            found += [getattr(data, name) for name in ("stiffness", "tau", "mu", "lam") if hasattr(data, name)]
        return found + self.targets()

    def targets(self) -> list[wp.array]:
        return list(self.pins.target.values()) if self.pins else []

    def zero(self) -> None:
        for array in self.arrays():
            array.grad.zero_()

    def take_targets(self) -> list[np.ndarray]:
        """Gradients of the pins' targets of a frame, which are zeros then."""
        found = [array.grad.numpy().astype(np.float64) for array in self.targets()]
        for array in self.targets():
            array.grad.zero_()
        return found

    def springs(self, array: wp.array) -> np.ndarray:
        """Sums over the two ends of each spring, from a gradient of the entries."""
        entry = self.pull.entry
        grad = array.grad.numpy().astype(np.float64)[:len(entry)]
        return np.bincount(entry[entry >= 0], grad[entry >= 0], self.pull.count)


class Gradient:
    """Derivatives of a loss, in SI units, by what a scene says.

    Bodies by path, None: the only one; worlds as ever. Arrays over points are float64, (n, 3) or (n,), in the author's order;
    where an author's points are one particle (a weld), each has the sum. Raises SceneError where a path or name is none, or has
    no derivative.
    """

    def __init__(self, parameters: Parameters, states: dict[int, np.ndarray], targets: list):
        self.parameters, self.model, self.plan = parameters, parameters.model, parameters.plan
        self.states, self._targets = states, targets
        self.grads = {array.ptr: array.grad.numpy().astype(np.float64) for array in parameters.arrays()}
        pull = parameters.pull
        self.entries = {name: parameters.springs(getattr(pull.net, name)) for name in ("k", "rest", *["damping"] * pull.damped)
                        } if pull.springs else {}

    def of(self, array: wp.array) -> np.ndarray:
        return self.grads[array.ptr]

    # points

    def positions(self, path: str | None = None, world: int = 0) -> np.ndarray:
        """By the positions at the start [1/m], (n, 3)."""
        return self.by_point(self.plan.state.x, path, world)

    def velocities(self, path: str | None = None, world: int = 0) -> np.ndarray:
        """By the velocities at the start [s/m], (n, 3)."""
        return self.by_point(self.plan.state.v, path, world)

    def by_point(self, array: wp.array, path: str | None, world: int) -> np.ndarray:
        return self.states[array.ptr].astype(np.float64)[self.model.body(path, world).index]

    def masses(self, path: str | None = None, world: int = 0) -> np.ndarray:
        """By the masses of the points [1/kg], (n,); 0 of pinned ones."""
        w = self.parameters.points.w
        return (-self.of(w) * w.numpy().astype(np.float64)**2)[self.model.body(path, world).index]

    def density(self, path: str | None = None, world: int = 0) -> float:
        """By the density that all masses of a body follow [m^3/kg]."""
        b = self.model.body(path, world)
        density = self.plan.method("points").densities.get(b.number) or density_of(b.source)
        if density is None:
            raise SceneError(Problem(b.path, "its masses follow no single density; take masses()"))
        w = self.parameters.points.w
        return float(-(self.of(w) * w.numpy().astype(np.float64))[b.first:b.last].sum()) / density

    def gravity(self, world: int = 0) -> np.ndarray:
        """[s^2/m], (3,)."""
        return self.of(self.parameters.points.gravity)[self.places(world)].sum(axis=0)

    def air_drag(self, world: int = 0) -> float:
        """[s]."""
        return float(self.of(self.parameters.points.decay)[self.places(world)].sum())

    def places(self, world: int) -> np.ndarray:
        return np.concatenate([np.arange(b.first, b.last) for b in self.model.bodies if b.world == world])

    def targets(self, path: str) -> np.ndarray:
        """By where a hard pin puts its points [1/m]: (frames, substeps, points, 3) of a moving one, (points, 3) of one that
        stands still."""
        pins = self.parameters.pins
        for number, kind in enumerate(pins.target if pins else ()):
            at = 0
            for p in pins.groups[kind]:
                if p.pin.path == path:
                    each = np.stack([frame[number][:, at:at + len(p.places)] for frame in self._targets])
                    return each if pins.moves else each.sum(axis=(0, 1))
                at += len(p.places)
        every = ", ".join(p.path for p in self.model.scene.pins)
        raise SceneError(Problem(path, f"is no hard pin; there are {every or 'none'}"))

    # materials

    def lengths(self, path: str | None = None, world: int = 0) -> np.ndarray:
        """By the rest lengths of a spring net [1/m], (edges,), in the author's order."""
        body = self.model.body(path, world)
        if not isinstance(body.source, Springs):
            raise SceneError(Problem(body.path, "is no spring net: it has no rest lengths of its own"))
        return np.concatenate([self.entries["rest"][part] for r, part in self.parts() if r.body is body])

    def material(self, name: str, path: str | None = None, world: int = 0, elements: bool = False):
        """By stretch, weft, shear [N/m], bend [N m] of a cloth, stiffness of springs [N/m], young [Pa], poisson of a soft body,
        or damping [s]. elements: of each element by itself, in the order of the solver; else the sum."""
        body = self.model.body(path, world)
        found = [self.rows(name, body), self.flat(name, body), self.solid(name, body)]
        parts = [each for some in found for each in some]
        if not parts:
            raise SceneError(Problem(body.path, f"has no {name!r} with a derivative; there are {', '.join(self.names(body))}"))
        every = np.concatenate(parts)
        return every if elements else float(every.sum())

    def names(self, body) -> list[str]:
        """What `material` knows of a body."""
        pull = self.parameters.pull
        rows = [r for rows in (pull.springs, *(getattr(e, "rows", []) for e in pull.elements)) for r in rows if r.body is body]
        values = [p.values for t in pull.tables for p in t.parts if p.body is body]
        damped = any(r.tau > 0.0 for r in rows) or any(v["damping"].any() for v in values)
        return sorted({name for d in (*(r.stiffness for r in rows), *values) for name in d} - {"damping"}
                      | set(["damping"] * damped))

    def parts(self) -> list[tuple[Rows, slice]]:
        """Springs of each body, and where they stand in `entries`."""
        rows = self.parameters.pull.springs
        ends = np.cumsum([0, *(len(r.ids) for r in rows)])
        return [(r, slice(*ends[k:k + 2])) for k, r in enumerate(rows)]

    def rows(self, name: str, body) -> list[np.ndarray]:
        """Of springs."""
        found = []
        for r, part in self.parts():
            if r.body is not body:
                continue
            k = np.broadcast_to(1.0 / r.alpha, len(r.ids))
            by_k = self.entries["k"][part] + (r.tau * self.entries["damping"][part] if "damping" in self.entries else 0.0)
            if name in r.stiffness:
                found.append(by_k * k / r.stiffness[name])
            elif name == "damping" and r.tau > 0.0:
                found.append(self.entries["damping"][part] * k)
        return found

    def flat(self, name: str, body) -> list[np.ndarray]:
        """Of hinges and triangles."""
        found = []
        for e in self.parameters.pull.elements:
            if not hasattr(e, "kind"):
                continue
            first = 0
            for r in e.rows:
                part = slice(first, first + len(r.ids))
                first = part.stop
                if r.body is not body:
                    continue
                if name == "damping" and r.tau > 0.0:
                    found.append(self.of(e.data.tau)[part])
                elif name in r.stiffness:
                    found.append(_by_stiffness(r, name, e.kind, self.of(e.data.stiffness)[part], e.stiffness()[part]))
        return found

    def solid(self, name: str, body) -> list[np.ndarray]:
        """Of tets, by Hooke's constants of each."""
        found = []
        for table in self.parameters.pull.tables:
            first = 0
            for p in getattr(table, "parts", ()):
                part = slice(first, first + len(p.rows))
                first = part.stop
                if p.body is not body or name not in p.values:
                    continue
                by_mu, by_lam, by_tau = (self.of(a)[part] for a in (table.data.mu, table.data.lam, table.data.tau))
                young, nu = p.values["young"], p.values["poisson"]
                mu, lam, _ = p.lame()
                if name == "young":
                    found.append((by_mu * mu + by_lam * lam) / young)
                elif name == "poisson":
                    found.append((2.0 * by_lam * (1.0 + 2.0 * nu**2) / (1.0 - 2.0 * nu)**2 - by_mu) * mu / (1.0 + nu))
                elif table.damped:
                    found.append(by_tau)
        return found


def _by_stiffness(r: Rows, name: str, kind: str, by: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
    """Of each element by one of its stiffnesses. The table of a membrane is (uu, uv, shear, vv); uu is in proportion to
    stretch, vv to weft, uv to the root of both; a weft of 0 stands for stretch."""
    parts, value = by * stiffness, r.stiffness[name]
    assert r.body is not None
    if kind != "membrane":
        return parts / value
    same = r.stiffness["weft"] <= 0.0
    if name == "weft" and same.any():
        raise SceneError(Problem(r.body.path, "its weft is 0 and follows stretch: it has no derivative of its own"))
    clamped = r.stiffness["shear"] < LEAST * r.stiffness["stretch"]
    if name == "shear" and clamped.any():
        raise SceneError(Problem(r.body.path, f"its shear is below {LEAST:g} of stretch, and taken as that: no derivative"))
    powers = np.array({"shear": (0.0, 0.0, 1.0, 0.0), "weft": (0.0, 0.5, 0.0, 1.0), "stretch": (1.0, 0.5, 0.0, 0.0)}[name])
    if name == "stretch":
        powers = np.where(same[:, None], (1.0, 1.0, 0.0, 1.0), powers) + (0.0, 0.0, 1.0, 0.0) * clamped[:, None]
    return (parts * powers).sum(axis=1) / value
