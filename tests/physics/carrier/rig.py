"""Points and bodies on a CPU in float64 that exchange impulses, each side with an integrator of its own."""

from types import SimpleNamespace

import numpy as np
import warp as wp

from wsim.kernels.carrier import colour, exchange, warm
from wsim.kernels.carrier.body import body, kinematic
from wsim.kernels.carrier.points import points
from wsim.kernels.math.real import types
from wsim.kernels.motion import points as kernels
from wsim.model.stage import Clock
from wsim.model.state import State
from wsim.model.status import Status
from wsim.physics.carrier.carriers import BodyCarrier, KinematicCarrier, PointCarrier
from wsim.physics.carrier.pairs import Pairs
from wsim.scene.integrator import TABLE

REAL, MODULE, H = wp.float64, "test_carriers_f64", 0.01
T = types(REAL)
for both in ((points, points), (points, body), (body, body), (points, kinematic), (body, kinematic)):
    for make in (exchange.project, exchange.aim, exchange.settle, exchange.remember, colour.vertices, warm.give):
        make(*both, REAL, MODULE)                        # all in the module before it is compiled, once
for make in (kernels.predict_euler, kernels.predict_bdf2, kernels.finish_euler, kernels.finish_bdf2, kernels.finish_beyond):
    make(REAL, MODULE)
INTEGRATORS = {"backward_euler": (False, False), "bdf2": (True, False), "implicit_midpoint": (False, True)}


def array(values, dtype=T.vec3) -> wp.array:
    return wp.array(np.ascontiguousarray(values), dtype=dtype, device="cpu")


def rotation(rng) -> np.ndarray:
    """A random unit quaternion (x, y, z, w)."""
    q = rng.normal(size=4)
    return q / np.linalg.norm(q)


def matrix(q: np.ndarray) -> np.ndarray:
    x, y, z, w = q
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])


def model() -> SimpleNamespace:
    return SimpleNamespace(real=REAL, device=wp.get_device("cpu"), module=MODULE, points=0,
                           launch=lambda kernel, dim, inputs, outputs: wp.launch(kernel, dim, inputs, outputs, device="cpu"))


class Points(PointCarrier):
    """Points of these masses, places and velocities under a gravity; integrated as `wsim.physics.motion.points` does."""

    def __init__(self, masses, x, v, integrator="backward_euler", gravity=(0.0, 0.0, 0.0)):
        n = len(masses)
        self.masses, self.first = np.asarray(masses, float), True
        self.multistep, self.beyond = INTEGRATORS[integrator]
        self.row = TABLE[integrator]
        self.gravity = np.asarray(gravity, float)
        c = kernels.constants(REAL)()
        with np.errstate(divide="ignore"):
            c.w = array(np.where(np.isfinite(self.masses), 1.0 / self.masses, 0.0), REAL)
        c.object, c.gravity, c.decay = array(np.zeros(n), int), array([self.gravity]), array([0.0], REAL)
        v = np.broadcast_to(np.asarray(v, float), (n, 3))
        s = SimpleNamespace(x=array(x), v=array(v), s=array(H * v), u=array(v - H * self.gravity),
                            **{name: array(np.zeros((n, 3))) for name in "eda"})
        s.s = array(H * v - 0.5 * H * H * self.gravity)
        owner = SimpleNamespace(constants=c, anchor=s.a)
        shell = model()
        shell.points = n
        super().__init__(shell, s, owner)

    def clock(self) -> Clock:
        return Clock(H, 1, 1, self.row, starting=False)

    def at(self, clock, base):
        return super().at(self.clock(), base)

    def remembers(self, clock) -> bool:
        return self.multistep

    def predict(self) -> None:
        s, c, g = self.state, self.owner.constants, self.clock().g
        if self.multistep:
            wp.launch(kernels.predict_bdf2(REAL, MODULE), len(s.x), [c, s.e, s.v, s.s, s.u, g], [s.a, s.d], device="cpu")
        else:
            wp.launch(kernels.predict_euler(REAL, MODULE), len(s.x), [c, s.e, s.v, g], [s.a, s.d], device="cpu")

    def finish(self) -> None:
        s, clock, n = self.state, self.clock(), len(self.state.x)
        if self.multistep:
            at = kernels.states(REAL)()
            at.x, at.e, at.v, at.d, at.a = s.x, s.e, s.v, s.d, s.a
            wp.launch(kernels.finish_bdf2(REAL, MODULE), n, [at, clock.h, clock.g], [s.x, s.e, s.v, s.s, s.u], device="cpu")
        elif self.beyond:
            wp.launch(kernels.finish_beyond(REAL, MODULE), n, [s.e, s.d, s.x, s.v, clock.g], [s.x, s.e, s.v], device="cpu")
        else:
            wp.launch(kernels.finish_euler(REAL, MODULE), n, [s.a, s.d, s.x, clock.g], [s.x, s.e, s.v], device="cpu")

    def place(self) -> np.ndarray:
        return self.state.x.numpy() + self.state.e.numpy()

    def velocity(self) -> np.ndarray:
        return self.state.v.numpy()

    def momentum(self, about: np.ndarray) -> np.ndarray:
        """Linear and angular, (6,), about places of one's choice; of points that move."""
        free = np.isfinite(self.masses)
        p = self.masses[free, None] * self.velocity()[free]
        return np.concatenate([p.sum(axis=0), np.cross(about[free], p).sum(axis=0)])

    def energy(self) -> float:
        free = np.isfinite(self.masses)
        return float(0.5 * (self.masses[free, None] * self.velocity()[free]**2).sum())


class Bodies(BodyCarrier):
    """Rigid bodies of these masses and principal moments [kg m^2], without forces; one substep at a time."""

    def __init__(self, masses, moments, x, v, omega, q):
        n = len(masses)
        self.masses, self.moments, self.q = np.asarray(masses, float), np.asarray(moments, float), np.asarray(q, float)
        self.x, self.v, self.omega = (np.array(values, float) for values in (x, v, omega))
        zeros = {name: array(np.zeros((n, 3))) for name in ("d", "a", "turn", "twist")}
        super().__init__(REAL, {
            "w": array(1.0 / self.masses, REAL), "inverse": array([np.diag(1.0 / m) for m in self.moments], T.mat33),
            "x": array(self.x), "q": array(self.q, T.quat), **zeros})

    def predict(self) -> None:
        self.arrays["d"].assign(H * self.v)
        self.arrays["turn"].assign(H * self.omega)

    def finish(self) -> None:
        a = {name: value.numpy() for name, value in self.arrays.items()}
        self.v, self.omega = (a["d"] - a["a"]) / H, (a["turn"] - a["twist"]) / H
        self.x = self.x + a["d"]

    def place(self) -> np.ndarray:
        return self.x

    def momentum(self, about: np.ndarray) -> np.ndarray:
        p = self.masses[:, None] * self.v
        spin = [matrix(q) @ np.diag(m) @ matrix(q).T @ w for q, m, w in zip(self.q, self.moments, self.omega, strict=True)]
        return np.concatenate([p.sum(axis=0), (np.cross(about, p) + spin).sum(axis=0)])

    def energy(self) -> float:
        spin = [w @ matrix(q) @ np.diag(m) @ matrix(q).T @ w for q, m, w in
                zip(self.q, self.moments, self.omega, strict=True)]
        return float(0.5 * ((self.masses[:, None] * self.v**2).sum() + sum(spin)))


class Walls(KinematicCarrier):
    """Kinematic bodies that go at these velocities from their places [m], without turning."""

    masses = np.array([np.inf])

    def __init__(self, x, v):
        pose = np.zeros((2, len(x), 7))
        pose[..., 6], pose[0, :, :3], pose[1, :, :3] = 1.0, x, np.asarray(x) + H * np.asarray(v, float)
        step = np.zeros((1, len(x), 7))
        step[..., 6], step[0, :, :3] = 1.0, H * np.asarray(v, float)
        table = SimpleNamespace(pose=array(pose, T.transform), step=array(step, T.transform))
        super().__init__(SimpleNamespace(real=REAL, table=table))

    def predict(self) -> None: ...

    def finish(self) -> None: ...

    def place(self) -> np.ndarray:
        return np.zeros((1, 3))

    def momentum(self, about: np.ndarray) -> np.ndarray:
        return np.zeros(6)


def feature(ids, at=()) -> tuple[np.ndarray, np.ndarray]:
    """(id, at) of corners and the weights of all but the first, or of a body and its arm."""
    ids = np.atleast_1d(ids)
    return np.resize(ids, 4), np.concatenate([np.asarray(at, float), np.zeros(3 - len(at))])


class Rig:
    """sides: carriers above; pairs: rows (kind, feature a, feature b, n, gap, more) put into the list."""

    def __init__(self, *combinations, capacity: int = 64, colours: int = 4, sweeps: int = 4,
                 warm: State | None = None):
        self.status = Status("cpu")
        self.pairs = Pairs(model(), self.status, list(combinations), capacity=capacity, colours=colours, sweeps=sweeps,
                           warm=warm)
        self.sides = list({id(c): c for both in combinations for c in both}.values())
        self.clock = Clock(H, 1, 1, TABLE["backward_euler"], starting=False)

    def put(self, rows: list[dict]) -> None:
        """kind, a, b (see `feature`), n, gap, friction (static, dynamic), bounce (restitution, approach), keys."""
        found = self.pairs.found
        self.pairs.begin()
        found.count.fill_(len(rows))
        room = self.pairs.capacity
        for name, dtype, pick in (
                ("kind", int, lambda r: r.get("kind", 0)), ("id_a", wp.vec4i, lambda r: r["a"][0]),
                ("id_b", wp.vec4i, lambda r: r["b"][0]), ("at_a", T.vec3, lambda r: r["a"][1]),
                ("at_b", T.vec3, lambda r: r["b"][1]), ("n", T.vec3, lambda r: r["n"]), ("gap", REAL, lambda r: r["gap"]),
                ("friction", T.vec2, lambda r: r.get("friction", (0.0, 0.0))),
                ("bounce", T.vec2, lambda r: r.get("bounce", (0.0, 0.0))),
                ("key_a", wp.int64, lambda r: r.get("keys", (r["a"][0][0], 0))[0]),
                ("key_b", wp.int64, lambda r: r.get("keys", (0, r["b"][0][0]))[1])):
            values = np.array([pick(r) for r in rows[:room]])
            wp.copy(getattr(found, name), array(values, dtype), count=len(values))

    def substep(self, rows: list[dict], sweeps: int = 1) -> None:
        for side in self.sides:
            side.predict()
        self.status.begin()
        self.put(rows)
        self.pairs.order(self.clock)
        for _ in range(sweeps):
            self.pairs.project(self.clock)
        self.pairs.settle(self.clock)
        for side in self.sides:
            side.finish()

    def momentum(self, about: list[np.ndarray]) -> np.ndarray:
        return np.sum([side.momentum(x) for side, x in zip(self.sides, about, strict=True)], axis=0)

    def push(self) -> np.ndarray:
        return self.pairs.list.push.numpy()[:int(self.pairs.list.count.numpy()[0])]

    def total(self) -> np.ndarray:
        return self.pairs.list.total.numpy()[:int(self.pairs.list.count.numpy()[0])]
