"""Gradients by what elements are made of and where they are at rest, from those of their tables: the half of
`wsim.gradient.gradient.Gradient` that knows constraints and tets."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import warp as wp

from wsim.gradient.rest_shape import RestShape, by_masses
from wsim.gradient.tables import GradientTables
from wsim.physics.cloth.constraints import Constraints
from wsim.scene.values.coverage import gradient_refusal


class ElementGradient:
    """The gradient with respect to lengths, rest shapes and materials."""

    parameters: GradientTables
    model: Any
    plan: Any
    grads: dict[int, np.ndarray]          # by the address of an array
    entries: dict[str, np.ndarray]        # of springs

    def of(self, array: wp.array) -> np.ndarray:
        return self.grads[array.ptr]

    def by_mass(self) -> np.ndarray:
        """Gradient with respect to the masses of the particles [1/kg], (points,); of pinned ones 0."""
        w = self.parameters.points.w
        return -self.of(w) * w.numpy().astype(np.float64)**2

    def lengths(self, path: str | None = None, world: int = 0) -> np.ndarray:
        """Gradient with respect to the rest lengths of a spring net [1/m], (edges,), in the author's order."""
        body = self.model.body(path, world)
        if not body.source.is_net:
            raise gradient_refusal("lengths", body.path)
        found = [self.entries["rest"][part] for r, part in _parts_of_table(self.parameters.springs) if r.body is body]
        for batch in self.parameters.batches:
            rest = batch.lengths or batch.data.rest
            found += [self.by_rows(batch, rest)[part] for r, part in _parts_of_table(batch.rows) if r.body is body]
        return np.concatenate(found)

    def material(self, name: str, path: str | None = None, world: int = 0, elements: bool = False):
        """Gradient with respect to stretch, weft, shear [N/m], bend [N m], strain_limit, and poisson of a membrane, of a
        cloth, stiffness of springs [N/m], young [Pa], poisson, pressure [Pa], yield_strain of a soft body, or damping [s].
        elements: of each element by
        itself, in the order of the solver (strain_limit: of each edge); else the sum."""
        body = self.model.body(path, world)
        found = [f(name, body) for f in (self.rows, self.flat, self.projected, self.solid)]
        parts = [each for some in found for each in some]
        if not parts:
            raise gradient_refusal("material", body.path, name=name, names=", ".join(self.names(body)))
        every = np.concatenate(parts)
        return every if elements else float(every.sum())

    def names(self, body) -> list[str]:
        """Names of a body that `material` knows."""
        return self.parameters.names(body)

    def rest_shape(self, path: str | None = None, world: int = 0) -> np.ndarray:
        """Gradient with respect to the places of its points at rest [1/m], (n, 3), by all that follows from it: lengths,
        angles, areas, volumes, and masses where those follow a density. In world space; of a weld its first point says where
        it is at rest."""
        body = self.model.body(path, world)
        shape = RestShape(body)
        for each in self.at_rest(body):
            shape.rows(*each)
        for table in self.parameters.tables:
            for p, part in _parts_of_table(table.parts):
                if p.body is body:
                    shape.tets(p.rows, self.of((table.plastic or table).data.edge)[part])
        by = self.by_mass()[np.concatenate([body.index, body.middles])]
        return shape.points() + by_masses(body, by, self.plan.ports.densities.get(body.number))

    def at_rest(self, body) -> Iterator[tuple]:
        """Constraints of a body, and gradients by their rest values, shapes and, of hinges, curvatures."""
        for r, part in _parts_of_table(self.parameters.springs):
            if r.body is body:
                yield r, self.entries["rest"][part], -self.by_spring_stiffness(r, part) / (r.alpha * r.shape)
        for e in self.parameters.flat:
            by = self.of(e.data.stiffness) * e.stiffness()
            for r, part in _parts_of_table(e.rows):
                if r.body is body:
                    yield (r, self.of(e.data.rest)[part], -by[part].reshape(len(r.ids), -1).sum(axis=1) / r.shape,
                           self.by_curvature(e, r))
        for batch in self.parameters.batches:
            by, rest = (self.by_rows(batch, a) for a in (batch.data.alpha, batch.lengths or batch.data.rest))
            by = by * batch.values()[0]
            for r, part in _parts_of_table(batch.rows):
                if r.body is body:
                    shape = np.where(r.shape > 0.0, r.shape, 1.0)
                    yield r, rest[part], by[part].reshape(len(r.ids), -1).sum(axis=1) / shape, self.by_curvature(batch, r)

    def by_curvature(self, table, r: Constraints) -> np.ndarray | None:
        """Gradient with respect to `Coupling.value` of the rows r of a table of hinges."""
        cur = table.curvature
        return cur.by_rows(self.of(cur.data.value))[[row is r for row in table.rows].index(True)] if cur else None

    def by_spring_stiffness(self, r: Constraints, part: slice) -> np.ndarray:
        """Gradient with respect to the stiffness of springs, with their damping."""
        return self.entries["k"][part] + (r.tau * self.entries["damping"][part] if "damping" in self.entries else 0.0)

    def rows(self, name: str, body) -> list[np.ndarray]:
        """Gradients of springs."""
        found = []
        for r, part, damping in _rows_having_stiffness(name, body, self.parameters.springs):
            k = np.broadcast_to(1.0 / r.alpha, len(r.ids))
            found.append(self.entries["damping"][part] * k if damping else self.by_spring_stiffness(r, part) / r.shape)
        return found

    def flat(self, name: str, body) -> list[np.ndarray]:
        """Gradients of hinges and triangles."""
        found = []
        for e in self.parameters.flat:
            for r, part, damping in _rows_having_stiffness(name, body, e.rows):
                by = self.of(e.data.tau if damping else e.data.stiffness)[part]
                found.append(by if damping else r.row.by_stiffness(r, name, by, e.stiffness()[part]))
        return found

    def projected(self, name: str, body) -> list[np.ndarray]:
        """Gradients of constraints of XPBD, whose compliances are inverse stiffnesses, and of the longest lengths."""
        found = []
        for b in self.parameters.batches:
            for r, part, damping in _rows_having_stiffness(name, body, b.rows):
                by = self.by_rows(b, b.data.tau if damping else b.data.rest if r.row.by_longest else b.data.alpha)[part]
                if r.row.by_longest and not damping:
                    by = r.row.by_longest(r, name, by)
                elif not damping:
                    by = r.row.by_compliance(r, name, by, b.values()[0][part])
                found.append(by)
        return found

    def by_rows(self, batch, array: wp.array) -> np.ndarray:
        """A gradient of a batch's table in the order of its rows."""
        by = np.empty(self.of(array).shape)
        by[batch.order] = self.of(array)
        return by

    def solid(self, name: str, body) -> list[np.ndarray]:
        """Gradients of tets, with respect to Hooke's constants of each, and of the triangles of a pressure."""
        found = []
        for table in self.parameters.tables:
            first = 0
            for b, weights in zip(getattr(table, "bodies", ()), getattr(table, "weights", ()), strict=True):
                part = slice(first, first + len(weights))
                first = part.stop
                if b is body and name == "pressure":
                    found.append(self.of(table.data.pressure)[part] * weights)
            for p in table.parts:
                part = slice(first, first + len(p.rows))
                first = part.stop
                if p.body is body and name == "yield_strain" and table.plastic:
                    found.append(self.of(table.plastic.data.limit)[part])
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


def _parts_of_table(rows: list) -> list[tuple[Any, slice]]:
    """Where each, of constraints or tets, stands in a table of all."""
    ends = np.cumsum([0, *(len(r.ids if isinstance(r, Constraints) else r.rows) for r in rows)])
    return [(r, slice(*ends[k:k + 2])) for k, r in enumerate(rows)]


def _rows_having_stiffness(name: str, body, rows: list[Constraints]) -> Iterator[tuple[Constraints, slice, bool]]:
    """Constraints of a body that have a stiffness of that name, where they stand in a table of `rows`, and False; of "damping"
    those that are damped, and True."""
    for r, part in _parts_of_table(rows):
        damping = name == "damping" and r.tau > 0.0
        if r.body is body and (damping or name in r.stiffness):
            yield r, part, damping
