"""What contacts do in each substep of a recording, solved to a residual, and its adjoint (contact_formulas.py beside this).

Manifolds are made anew in each substep; how they change with the poses of their bodies (normals, places, gaps) is found by
differences of order 4 of the narrow phase itself, pair by pair: 1e-10 of a size.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import warp as wp

from wsim.geometry.rotation import quat_conjugate, quat_product, quat_rotate, unit_quat
from wsim.kernels.math.real import types
from wsim.kernels.rigid.lists.slopes import SAMPLES, pose_slope_kernel
from wsim.model.stage import Clock
from wsim.physics.rigid.recorded import contact_formulas
from wsim.physics.rigid.recorded.joints import half_kick_difference
from wsim.physics.rigid.recorded.local import Values, complex_derivatives, residual_values
from wsim.physics.rigid.recorded.substep import BodyCotangents, CouplingElements, RecordedBodyValues, substep_vjp, velocity_vjp
from wsim.scene.values.coverage import gradient_refusal

STEP = 1.0e-4              # of sizes, of differences
MOST = 64                  # rounds of impacts
LIST = ("n", "skin", "core_a", "core_b", "first_a", "first_b", "gap", "from_a", "from_b", "rim")
FOUR = np.array([1.0, -8.0, 8.0, -1.0]) / 12.0              # weights of -2, -1, 1, 2 steps


def turn_between(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Rotation vectors (n, 3) from one orientation to another."""
    q = quat_product(unit_quat(after), quat_conjugate(unit_quat(before)))
    q = q * np.where(q[:, 3:] < 0.0, -1.0, 1.0)
    sine = np.linalg.norm(q[:, :3], axis=1, keepdims=True)
    return 2.0 * q[:, :3] * np.where(sine > 0.0, np.arctan2(sine, q[:, 3:]) / np.where(sine > 0.0, sine, 1.0), 1.0)


@dataclass
class RecordedManifolds:
    """Points of a list: rows (points,) of it and places of four in each, frames (points, 2); geo (points, 24)."""

    at: np.ndarray
    frames: np.ndarray
    shapes: np.ndarray
    surface: contact_formulas.ContactShapes
    geo: np.ndarray
    k: int
    x: np.ndarray                                  # of bodies where it was made
    q: np.ndarray
    arrays: dict[str, np.ndarray] = field(default_factory=dict)          # a, b, count, key of the list


class RecordedContacts:
    def __init__(self, recorded):
        self.recorded, self.contacts = recorded, recorded.method.contacts
        self.form = self.contacts.form
        self.n = recorded.method.part.count
        self.kernels = self.form.kernels["parts"]
        model, c = recorded.model, self.contacts
        self.slopes = pose_slope_kernel(c.pairs, model.real, model.module)

    # forward

    def launch(self, which: int, clock: Clock) -> None:
        given = [wp.vec3i(clock.k, clock.k + 1, 0), clock.h, self.form.threads, self.form.tolerance, self.contacts.rig()]
        self.form.launch(self.kernels[which], given, [])

    def step(self, clock: Clock, kept: dict | None) -> None:
        """A substep; kept: what its adjoint asks for, or None."""
        c = self.contacts
        if clock.k == 0:
            c.work.residual.zero_()
        c.renew(clock, clock.k)
        if kept is None:
            for part in (0, *[1] * (MOST * c.bouncing), 2, 3):
                self.launch(part, clock)
        else:
            kept |= {"made": self.listed(clock.k), "k": clock.k, "still": (self.still(clock.k), self.still(clock.k + 1))}
            self.step_in_parts(clock, kept)
        if clock.k + 1 == clock.substeps:
            c.keep()

    def step_in_parts(self, clock: Clock, kept: dict) -> None:
        """The parts of a substep, and what stands between them."""
        c, state, made_ = self.contacts, self.recorded.state, kept["made"]
        kept["rounds"], after = [], state()
        self.launch(0, clock)
        for _round in range(MOST * c.bouncing):
            before = after
            self.launch(1, clock)
            if not (hit := c.work.goal.numpy()[made_.at] >= 0.0).any():
                break
            after = state()
            kept["rounds"].append((before, after, self.impulses(c.work.hit, c.work.scrape, made_), hit))
        kept["start"] = after
        self.launch(2, clock)
        kept["momentum"], kept["touched"] = state().momentum, c.work.touched.numpy()[:self.n].copy()
        kept["held"] = self.impulses(c.list.push, c.list.rub, made_)
        self.launch(3, clock)
        kept["loosed"] = self.impulses(c.list.push, c.list.rub, made_)

    def impulses(self, push: wp.array, rub: wp.array, m: RecordedManifolds) -> np.ndarray:
        """(points, 3), along n and its tangents."""
        r = rub.numpy().astype(np.float64)[m.at]
        t1, t2 = contact_formulas.contact_tangents(m.geo[:, :3])
        return np.stack([push.numpy().astype(np.float64)[m.at], (t1 * r).sum(1), (t2 * r).sum(1)], axis=1)

    def still(self, k: int) -> dict[str, np.ndarray]:
        """Poses of colliders where substep k begins."""
        s = self.contacts.still
        return {name: getattr(s, name).numpy()[min(k, len(s.x) - 1) * s.moving].astype(np.float64)
                for name in ("x", "q", "v", "omega")}

    def listed(self, k: int) -> RecordedManifolds:
        c, state = self.contacts, self.recorded.state()
        arrays = {name: getattr(c.list, name).numpy().copy() for name in ("a", "b", "count", "key")}
        rows = np.flatnonzero((arrays["a"] >= 0) & (arrays["count"] > 0))
        at = np.concatenate([np.zeros(0, int), *(4 * m + np.arange(arrays["count"][m]) for m in rows)])
        shapes = np.stack([arrays["a"][at // 4], arrays["b"][at // 4]], axis=1)
        own = {name: getattr(c.list, name).numpy().astype(np.float64) for name in LIST}
        frames = c.table.frame.numpy()[shapes]
        geo = np.concatenate([own["n"][at // 4], *(own[name][at] for name in LIST[2:6]), own["gap"][at][:, None],
                              own["from_a"][at // 4], own["from_b"][at // 4], own["rim"][at]], axis=1)
        place = c.table.place.numpy().astype(np.float64)[shapes]
        z = quat_rotate(place[..., 3:], np.broadcast_to([0.0, 0.0, 1.0], place[..., :3].shape))
        ball = c.table.ball.numpy().astype(np.float64)[shapes]
        fall = c.work.g.numpy()[c.table.world.numpy()[shapes[:, 0]]]
        fastest = np.sqrt(2.0 * fall * np.where(ball < 0.0, np.inf, ball).min(axis=1))
        surface = contact_formulas.ContactShapes(own["skin"][at // 4], z, place[..., :3], fastest)
        return RecordedManifolds(at, frames, shapes, surface, geo, k, state.x, state.q, arrays)

    # backward

    def sides(self, bodies: np.ndarray, still: np.ndarray, m: RecordedManifolds) -> list[np.ndarray]:
        """Values of a and of b, of numbers of bodies and of colliders behind them."""
        every = np.concatenate([bodies, still])
        return [every[m.frames[:, s]] for s in (0, 1)]

    def pose(self, x: np.ndarray, still: dict, m: RecordedManifolds) -> np.ndarray:
        a, b = self.sides(x, still["x"], m)
        return np.concatenate([a, 0.0 * a, b, 0.0 * b], axis=1)

    def both(self, values: np.ndarray, m: RecordedManifolds, width: int = 12) -> np.ndarray:
        none = np.zeros((len(self.contacts.colliders), values.shape[1]))
        return np.concatenate(self.sides(values, none, m), axis=1)

    def shared(self, m: RecordedManifolds, b: RecordedBodyValues) -> Values:
        """Values that all parts of a substep read."""
        mu = self.contacts.table.friction.numpy()[:, 1].astype(np.float64)[m.shapes].mean(axis=1)
        return {"geo": m.geo, "mass": self.both(np.concatenate([b.w[:, None], b.inverse], axis=1), m), "mu": mu[:, None]}

    def constants(self, h: float, kept: dict, f: np.ndarray, pushes: np.ndarray,
                  way: np.ndarray) -> contact_formulas.ContactFormulas:
        m, (first, last) = kept["made"], kept["still"]
        q, Q = self.sides(kept["begin"].q, first["q"], m), self.sides(kept["end"].q, last["q"], m)
        zero = np.zeros((self.n, 6))
        given = np.concatenate(self.sides(zero, np.concatenate([first["v"], first["omega"]], axis=1), m), axis=1)
        return contact_formulas.ContactFormulas(h, (q[0], q[1]), (Q[0], Q[1]), m.surface, given, pushes, way)

    def elements(self, name: str, h: float, kept: dict, f: np.ndarray, values: Values, some: np.ndarray) -> CouplingElements:
        """Elements of a part of a substep; some (points,): those that may act."""
        m, pushes = kept["made"], some & (f[:, 0] > 0.0)
        each = [self.constants(h, kept, f, pushes, np.full(len(f), way))
                for way in (contact_formulas.STICKS, contact_formulas.SLIPS)]
        sticks, slips = (np.linalg.norm(residual_values(getattr(one, name), values)[:, 1:], axis=1) for one in each)
        w = values["mass"][:, 0] + values["mass"][:, 4]
        most = values["mu"][:, 0] * f[:, 0]
        inside = np.linalg.norm(f[:, 1:], axis=1) < (1.0 - 1.0e-7) * most
        way = np.where(pushes & (most > 0.0), np.where(inside | (sticks < w * slips), contact_formulas.STICKS,
                                                       contact_formulas.SLIPS), contact_formulas.NONE)
        one = self.constants(h, kept, f, pushes, way)
        self.look(residual_values(getattr(one, name), values), way, w)
        bodies = np.where(m.frames < self.n, m.frames, -1)
        return CouplingElements(bodies, complex_derivatives(getattr(one, name), values))

    def look(self, rest: np.ndarray, way: np.ndarray, w: np.ndarray) -> None:
        """Notes the largest residual [m/s]."""
        r = self.recorded
        along = np.abs(rest[:, 0]) * np.where(way == contact_formulas.NONE, 0.0, 1.0)
        across = np.linalg.norm(rest[:, 1:], axis=1) * np.where(way == contact_formulas.STICKS, 1.0,
                                                                np.where(way == contact_formulas.SLIPS, w, 0.0))
        r.left = max(r.left, float(np.maximum(along, across).max(initial=0.0)))

    def back(self, h: float, kept: dict, cot: BodyCotangents) -> None:
        r, m = self.recorded, kept["made"]
        b = r.bodies(kept["start"], kept["end"], kept["momentum"], (kept["touched"] == 0).astype(float))
        b.placing = kept["momentum"] + half_kick_difference(b, h)
        some, shared = np.ones(len(m.at), bool), self.shared(m, b)
        poses = [self.pose(s.x, still, m) for s, still in zip((kept["begin"], kept["end"]), kept["still"], strict=True)]
        values = {"then": poses[1], "momentum": self.both(kept["end"].momentum, m), "f": kept["loosed"],
                  "before": kept["held"], **shared}
        f = velocity_vjp({"loosed": self.elements("loosed", h, kept, kept["loosed"], values, some)}, self.n, cot)["loosed"]
        values = {"pose": poses[0], "momentum": self.both(kept["momentum"], m), "f": kept["held"], **shared}
        first = substep_vjp({"held": self.elements("held", h, kept, kept["held"], values, some)}, b, h, cot, {"held": f})
        for before, after, f, hit in reversed(kept["rounds"]):
            values = {"pose": poses[0], "entering": self.both(before.momentum, m), "f": f, **shared,
                      "momentum": self.both(after.momentum, m), "force": self.both(b.push, m), "e": self.restitution(m)}
            thrown = {"thrown": self.elements("thrown", h, kept, f, values, hit)}
            velocity_vjp(thrown, self.n, cot, "pose", turn_between(before.q, after.q), first)
        cot.pose += first
        self.take(kept, cot)

    def restitution(self, m: RecordedManifolds) -> np.ndarray:
        e = self.contacts.table.restitution.numpy().astype(np.float64)
        return e[m.shapes].max(axis=1, keepdims=True)

    def take(self, kept: dict, cot: BodyCotangents) -> None:
        """The cotangents of points, as they were made, go to the poses of then."""
        m = kept["made"]
        found = np.zeros_like(m.geo)
        for name in ("held", "loosed", "thrown"):
            found = found + cot.by.pop((name, "geo"), 0.0)
            for part in ("mass", "mu", "force", "e"):
                if (name, part) in cot.by:
                    self.shares(name, part, cot.by.pop((name, part)), m, cot)
        if len(m.at):
            by = np.einsum("eoi,eo->ei", self.moved(m, kept), found)
            for s in (0, 1):
                on = m.frames[:, s] < self.n
                np.add.at(cot.pose, m.frames[on, s], by[on, 6 * s:6 * s + 6])

    def shares(self, name: str, part: str, by: np.ndarray, m: RecordedManifolds, cot: BodyCotangents) -> None:
        """Cotangents of points by what bodies and shapes have."""
        if part in ("mass", "force"):
            for s in (0, 1):
                on = m.frames[:, s] < self.n
                for table, columns in ({"w": [4 * s], "inverse": range(4 * s + 1, 4 * s + 4)} if part == "mass" else
                                       {"push": range(3 * s, 3 * s + 3)}).items():
                    into = np.zeros((self.n, len(columns)))
                    np.add.at(into, m.frames[on, s], by[on][:, list(columns)])
                    cot.add(table, into)
            return
        shapes = np.zeros(self.contacts.shapes)
        if part == "mu":
            np.add.at(shapes, m.shapes, 0.5 * by)
            cot.add("dynamic_friction", shapes)
            return
        e = self.contacts.table.restitution.numpy()[m.shapes]
        np.add.at(shapes, m.shapes[np.arange(len(by)), e.argmax(axis=1)], by[:, 0])
        cot.add("restitution", shapes)

    def moved(self, m: RecordedManifolds, kept: dict) -> np.ndarray:
        """Derivatives (points, 24, 12) of geo by the poses of both bodies where manifolds were made."""
        c, real = self.contacts, self.recorded.model.real
        t, device, room = types(real), c.device, c.room
        q = self.sides(m.q, kept["still"][0]["q"], m)
        origin = c.table.origin.numpy()[m.frames]
        x = self.sides(m.x, kept["still"][0]["x"], m)
        apart = origin[:, 1] + x[1] - origin[:, 0] - x[0]
        mid = m.geo[:, GEO_FIRST_A] - (0.5 * m.geo[:, 15:16] + m.surface.skin[:, :1]) * m.geo[:, :3]
        levers = np.maximum(np.linalg.norm(mid, axis=1), np.linalg.norm(mid - apart, axis=1))
        narrow = self.sampled(m, levers, room, t, real, device)
        d = narrow.reshape(len(m.at), 7, 12)
        values = {"n": m.geo[:, :3], "x": mid, "gap": m.geo[:, 15:16], "pose": np.zeros((len(m.at), 12))}
        J = complex_derivatives(lambda v: contact_formulas.manifold_geometry(v, (q[0], q[1]), m.surface, m.geo[:, 22:24] > 0.0,
                                                                             apart), values)
        own = np.concatenate([J["geo", "n"], J["geo", "x"], J["geo", "gap"]], axis=2)
        return J["geo", "pose"] + own @ d

    def sampled(self, m: RecordedManifolds, levers: np.ndarray, room: int, t: Any, real, device) -> np.ndarray:
        """Derivatives (points, 7, 12) of n, x, gap by the poses. levers: of points about frames [m]. Raises SceneError for a
        point that is lost."""
        c, method = self.contacts, self.recorded.method
        part = method.part.arrays
        now = {name: part[name].numpy() for name in ("x", "q")}
        before = {name: getattr(c.list, name).numpy() for name in ("a", "b", "count", "key")}
        part["x"].assign(m.x.astype(method.model.dtype))
        part["q"].assign(m.q.astype(method.model.dtype))
        for name, values in m.arrays.items():
            getattr(c.list, name).assign(values)
        ball = c.table.ball.numpy()
        pair = np.stack([ball[np.maximum(m.arrays[s], 0)] for s in "ab"])
        size = np.where(pair > 0.0, pair, np.inf).min(axis=0)
        size = np.where(np.isfinite(size), size, 1.0)
        near = np.full(room, -np.inf)
        np.maximum.at(near, m.at // 4, m.geo[:, 15])
        far = size.copy()
        np.maximum.at(far, m.at // 4, levers)
        turn = size / far                              # far from a frame, a turn moves points no more than a shift does
        limits = np.stack([size, near + 8.0 * STEP * size, turn], axis=1).astype(method.model.dtype)
        sizes = wp.array(limits, dtype=t.vec3, device=device)
        n, x = (wp.zeros((4 * room, int(SAMPLES)), dtype=t.vec3, device=device) for _ in range(2))
        gap = wp.zeros((4 * room, int(SAMPLES)), dtype=t.vec2, device=device)
        wp.launch(self.slopes, (room, int(SAMPLES)), [c.rig(), c.hulls, m.k, STEP, sizes], [n, x, gap], device=device)
        for name, values in now.items():
            part[name].assign(values)
        for name, values in before.items():
            getattr(c.list, name).assign(values)
        gaps = gap.numpy()[m.at]
        if (lost := gaps[..., 1] == 0.0).any():
            k = m.frames[np.argwhere(lost)[0, 0]].min()
            raise gradient_refusal("features", method.bodies[k][0].path)
        steps = STEP * np.where(np.arange(12) % 6 < 3, size[m.at // 4][:, None], turn[m.at // 4][:, None])
        every = np.concatenate([n.numpy()[m.at], x.numpy()[m.at], gaps[..., :1]], axis=2)
        return np.einsum("pdso,s->pod", every.reshape(len(m.at), 12, 4, 7), FOUR) / steps[:, None, :]

    def collected(self, total: BodyCotangents) -> dict[str, np.ndarray]:
        return dict(total.bodies)


GEO_FIRST_A = slice(9, 12)
