"""Surfaces that may touch each other and themselves, as tables on a device (kernels/contact/selfcontact/pairs.py)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from wsim.geometry import topology
from wsim.kernels.contact.selfcontact import obstacles as company
from wsim.kernels.contact.selfcontact import pairs as kernels
from wsim.kernels.contact.selfcontact.motion_bounds import LONG
from wsim.kernels.math.real import types
from wsim.kernels.motion.points import point_states
from wsim.model.structs import fill_struct
from wsim.physics.contact.selfcontact import obstacles
from wsim.physics.contact.selfcontact.obstacles import SurfaceObstacles
from wsim.scene import Problem, SceneError
from wsim.scene.nodal.touching import collides_with_surfaces

if TYPE_CHECKING:
    from wsim.model.model import Model, PointBody
    from wsim.physics.contact.contacts import ColliderContacts

OWN, MET, BALL = kernels.OWN, kernels.MET, kernels.BALL
SOFT = 0.1             # thickness of the skin of a soft body over its mean edge: none is authored
TUBE = 0.65            # radius of tubes over the largest thickness; smaller: more searches, larger: more pairs
TUBE_EDGE = 0.1        # and over the mean edge, if that is more
WRITTEN = 1.05 * 2.0 ** -24              # bound of the rounding of a vector to float32 over its length, and a margin
ULP = {np.float32: 2.0 ** -24, np.float64: 2.0 ** -53}


def self_colliding_bodies(model: Model) -> list[PointBody]:
    """Bodies of all worlds that touch themselves and each other, and those whose points are balls that they meet."""
    return [b for b in model.bodies if collides_with_surfaces(b.source, model.scene)]


def contact_role(body: PointBody) -> int:
    """OWN, MET or BALL, in the order of the tables."""
    return BALL if body.source.meets_as_balls else OWN if body.source.self_collision else MET


class ContactSurfaces:
    """data: struct of the tables. triangles, edges, points: places, those of bodies first, then those of strands, those of
    colliders last; own: how many of each are bodies', free: no collider's; world: of each point; strands: of rods
    (`wsim.physics.rods.with_surfaces.StrandSurfaceContacts`), obstacles: colliders, or None; total: number of places, with
    theirs; state: of all of them, or None where bodies are all there is. active: bodies that touch themselves and each other,
    whose triangles are the first; looking: how many points of theirs are the first; behind these balls, and points of surfaces
    that balls alone meet; ball_margin: how much more than `thickness` a pair with a ball keeps at most [m]; ball_edges: stretch
    of `edges`."""

    def __init__(self, model: Model, w: wp.array, contacts: ColliderContacts | None = None, strands: Any = None):
        """w: inverse masses [1/kg] of all points of bodies. Raises SceneError for a body without a triangle."""
        self.bodies = sorted(self_colliding_bodies(model), key=contact_role)
        roles = np.array([contact_role(b) for b in self.bodies])
        split = {role: [b for b, own in zip(self.bodies, roles, strict=True) if own == role] for role in (OWN, MET, BALL)}
        self.active, no_points = split[OWN], np.zeros(0, np.int32)
        own, others = (model.shared(np.concatenate([np.zeros((0, 3), int), *(b.triangles for b in split[role])]))
                       .astype(np.int32) for role in (OWN, MET))
        self.triangles, self.active_triangles = np.concatenate([own, others]), len(own)
        if none := [b.path for b in self.bodies if not (len(b.triangles) or b.source.meets_as_balls)]:
            raise SceneError([Problem(path, "none of its faces has an area that rounding leaves; a surface that touches needs "
                                            "at least one triangle") for path in none])
        self.edges = topology.edges_of_triangles(own).astype(np.int32)
        self.balls = np.concatenate([no_points, *(np.arange(b.first, b.last, dtype=np.int32) for b in split[BALL])])
        looking = np.unique(own)
        self.met = np.setdiff1d(others, looking)
        self.points = np.concatenate([looking, self.balls, self.met]).astype(np.int32)
        self.looking = len(looking)
        self.role = np.repeat([contact_role(b) for b in model.bodies], [b.count for b in model.bodies])
        self.own = self._element_counts()
        self.base, self.total, self.state = self.bodies[0].origin, model.points, None     # type: Any, int, Any
        self.world = np.repeat([b.world for b in model.bodies], [b.count for b in model.bodies]).astype(np.int32)
        self.reach, self.edge = self._half_thicknesses(model)
        thick, balls = self.reach[np.concatenate([looking, self.met])], self.reach[self.balls]
        self.thickness = 2.0 * float(thick.max(initial=0.0)) or 2.0 * float(balls.max())
        self.ball_margin = max(float(balls.max(initial=0.0)) - 0.5 * self.thickness, 0.0)
        self.beta = max(TUBE * self.thickness, TUBE_EDGE * self.edge)       # thick ropes are few: theirs widen
        self.w, self.strands = w, strands
        if strands:
            self._append_strands(strands)
        self.free = self._element_counts()
        met = obstacles.colliders_with_edges(model, contacts)
        self.obstacles = SurfaceObstacles(model, contacts, met, self.bodies, self.total) if contacts and met else None
        if self.obstacles:
            self._meet(self.obstacles)
        if self.total > model.points:
            self._allocate_joined_state(model)
        self.ball_edges = slice(len(self.edges), None)
        if strands and len(self.balls):                  # a ball is an edge without length for strands, which have no triangles
            self.edges = np.concatenate([self.edges, np.stack([self.balls, self.balls], axis=1)])
        self.data = self._upload(model)

    def _element_counts(self) -> dict[str, int]:
        return {"triangles": len(self.triangles), "edges": len(self.edges), "points": len(self.points)}

    def _append_strands(self, strands: Any) -> None:
        """Appends what strands have: no triangles."""
        strands.join(self, self.total)
        self.points = np.concatenate([self.points, self.total + np.arange(strands.points, dtype=np.int32)])
        self.edges = np.concatenate([self.edges, self.total + strands.edges])
        self.total += strands.points
        self.world, self.reach = np.concatenate([self.world, strands.world]), np.concatenate([self.reach, strands.reach])
        self.thickness = max(self.thickness, 2.0 * float(strands.reach.max()))

    def _allocate_joined_state(self, model: Model) -> None:
        """Arrays of bodies' points and those behind them."""
        real, device, first = model.real, model.device, model.points
        w = np.zeros(self.total)
        if self.strands:
            w[first:first + self.strands.points] = self.strands.w
        self.w = model.upload(w.astype(model.dtype), real)
        self.state = fill_struct(point_states(real),
                                 **{k: wp.zeros(self.total, dtype=types(real).vec3, device=device) for k in "xeda"})
        self.lend = company.free_state_copy_kernel(real, model.module)
        if self.obstacles:
            self.obstacles.state = self.state

    def borrow(self, model: Model, at: Any) -> Any:
        """State of all, of that of the bodies' points."""
        model.launch(self.lend, model.points, [at], [self.state])
        return self.state

    def _meet(self, o: SurfaceObstacles) -> None:
        """Appends what colliders have."""
        self.total = o.total
        self.triangles = np.concatenate([self.triangles, o.triangles])
        self.edges = np.concatenate([self.edges, topology.edges_of_triangles(o.triangles).astype(np.int32)])
        self.points = np.concatenate([self.points, o.points])
        self.world = np.concatenate([self.world, o.world])
        self.thickness = max(self.thickness, 0.5 * self.thickness + float(o.reach.max()))
        self.reach = np.concatenate([self.reach, o.reach])

    def rub(self, path: str, column: int, value: float, world: int | None) -> bool:
        """Friction of a body or a collider, static (column 0) or dynamic, in one world or all; False if neither is among these;
        not captured."""
        rows = [slice(b.first, b.last) for b in self.bodies if b.path == path and world in (None, b.world)]
        met = self.obstacles
        for o in met.each if met else ():
            if met and met.contacts.rows.colliders[o.number].path == path:
                rows += [slice(s, s + len(o.own)) for w, s in enumerate(met.places[id(o)]) if world in (None, w)]
        values = self.data.friction.numpy()
        for each in rows:
            values[each, column] = value
        self.data.friction.assign(values)
        return bool(rows)

    def weigh(self, w: wp.array) -> None:
        """Inverse masses as they are now; not captured."""
        if self.state:
            wp.copy(self.w, w, count=len(w))

    def _half_thicknesses(self, model: Model) -> tuple[np.ndarray, float]:
        """Half thickness of every point [m], and the mean edge at rest [m]."""
        reach, lengths = np.zeros(model.points), []
        for b in self.bodies:
            if b.source.meets_as_balls:
                reach[b.first:b.last] = b.reach
                continue
            ends = b.rest[topology.edges_of_triangles(b.triangles) - b.first]
            lengths.append(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1))
            reach[b.first:b.last] = np.where(b.reach > 0.0, b.reach, 0.5 * SOFT * lengths[-1].mean())
        np.maximum.at(reach, model.shared(model.gone), reach[model.gone])      # of a body, perhaps, that is not among these
        return reach, float(np.concatenate(lengths).mean()) if lengths else 2.0 * float(reach.max())

    def _surface_point_columns(self, model: Model) -> dict[str, np.ndarray]:
        """Tables by point, in float64."""
        each = [b.count for b in model.bodies]
        frames = [b.source.motion.at(0.0) for b in model.bodies]
        tied = model.alias is not None
        rest = np.concatenate([b.places + b.origin - self.base if tied else b.rest for b in model.bodies])
        found = {"rest": rest, **{name: np.repeat(np.array(values), each, axis=0) for name, values in (
            ("shift", [b.origin - self.base for b in model.bodies]),
            ("far", [b.origin - m[:3, 3] for b, m in zip(model.bodies, frames, strict=True)]),
            ("unit", [WRITTEN * np.linalg.cond(m[:3, :3]) for m in frames]),
            ("friction", [b.friction for b in model.bodies]))}}
        if self.strands:
            r, zero = self.strands, np.zeros((self.strands.points, 3))
            more = {"rest": r.start() if tied else r.rest, "shift": zero, "far": zero, "friction": r.friction, "unit": r.unit}
            found = {name: np.concatenate([values, more[name]]) for name, values in found.items()}
        if self.obstacles:
            o, n = self.obstacles, self.total - self.obstacles.first
            more = {"rest": o.start(), "shift": np.zeros((n, 3)), "far": np.zeros((n, 3)), "friction": o.friction,
                    "unit": np.full(n, obstacles.STEPS * WRITTEN)}
            found = {name: np.concatenate([values, more[name]]) for name, values in found.items()}
        return found

    def _upload(self, model: Model) -> Any:
        t = types(model.real)
        role = np.concatenate([self.role, np.full(self.total - len(self.role), OWN)]).astype(np.int32)
        dtypes = {"rest": t.vec3, "shift": t.vec3, "far": t.vec3, "friction": t.vec2, "unit": t.scalar}
        body = np.repeat([b.number for b in model.bodies], [b.count for b in model.bodies]).astype(np.int32)
        body = np.concatenate([body, *(kernels.STRANDS + s.strand for s in [self.strands] if s),
                               *(o.body for o in [self.obstacles] if o)]).astype(np.int32)
        return fill_struct(
            kernels.surface_type(model.real), w=self.w, point=model.upload(self.points, int),
            triangle=model.upload(self.triangles, wp.vec3i), edge=model.upload(self.edges, wp.vec2i),
            reach=model.upload(self.reach.astype(model.dtype), t.scalar), body=model.upload(body, int),
            world=model.upload(self.world, int), role=model.upload(role, int), beta=self.beta, longest=LONG * self.edge,
            tied=int(model.alias is not None), ulp=ULP[model.dtype],
            **{name: model.upload(values.astype(model.dtype), dtypes[name])
               for name, values in self._surface_point_columns(model).items()})

    def flatten(self, model: Model, crossed: np.ndarray, reach: float) -> None:
        """Triangles of the first world, (k, 3), and all around them, get a half thickness [m], in every world."""
        near = self.triangles[:self.active_triangles]
        lost = np.unique(near[np.isin(near, crossed).any(axis=1)])
        self.reach[lost + np.arange(model.worlds)[:, None] * (model.points // model.worlds)] = reach
        self.data.reach.assign(self.reach.astype(self.data.reach.numpy().dtype))

    def start(self, model: Model) -> np.ndarray:
        """Where all points begin, from the origin that surfaces share [m], (total, 3)."""
        own = np.concatenate([b.places + (b.origin - self.base) for b in model.bodies])
        return np.concatenate([own, *(each.start() for each in (self.strands, self.obstacles) if each)])
