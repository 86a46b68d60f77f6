"""What tests/physics/contact/test_candidate_lists.py shares with other tests: Pair, apart, blob, sheet, surface."""

from functools import partial
from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.math.real import types
from wsim.physics.contact import broad
from wsim.physics.contact.contacts import CollidablePoints, ColliderContacts
from wsim.scene import Collider, Surface
from wsim.scene.curve import Curve, Motion

SUBSTEPS, DT, N = 40, 1 / 60, 400


def blob(rng, radius=0.3, rough=0.15):
    """A rough ball, closed."""
    t = (1 + 5**0.5) / 2
    p = np.array([(-1, t, 0), (1, t, 0), (-1, -t, 0), (1, -t, 0), (0, -1, t), (0, 1, t), (0, -1, -t), (0, 1, -t),
                  (t, 0, -1), (t, 0, 1), (-t, 0, -1), (-t, 0, 1)])
    f = np.array([(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2), (10, 7, 6),
                  (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10),
                  (8, 6, 7), (9, 8, 1)])
    for _ in range(2):
        edges = np.sort(f[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        unique, at = np.unique(edges, axis=0, return_inverse=True)
        m = len(p) + at.reshape(-1, 3)
        p = np.concatenate([p, p[unique].mean(axis=1)])
        f = np.concatenate([np.stack([f[:, 0], m[:, 0], m[:, 2]], 1), np.stack([m[:, 0], f[:, 1], m[:, 1]], 1),
                            np.stack([m[:, 2], m[:, 1], f[:, 2]], 1), m])
    p = p / np.linalg.norm(p, axis=1, keepdims=True) * radius * (1 + rough * rng.uniform(-1, 1, (len(p), 1)))
    return p, f


def sheet(rng, n=8, size=0.8):
    """An uneven open sheet."""
    s = np.linspace(-0.5, 0.5, n + 1) * size
    p = np.stack(np.meshgrid(s, s, indexing="ij"), -1).reshape(-1, 2)
    p = np.column_stack([p + rng.uniform(-0.3, 0.3, p.shape) * size / n, 0.03 * rng.normal(size=len(p))])
    k = np.arange(n * (n + 1)).reshape(n, n + 1)[:, :n].ravel()
    return p, np.concatenate([np.stack([k, k + n + 1, k + 1], 1), np.stack([k + 1, k + n + 1, k + n + 2], 1)])


def slab(rng, thickness=0.002):
    """A closed plate of 2 mm."""
    p = np.array([(x, y, z) for x in (-0.3, 0.3) for y in (-0.3, 0.3) for z in (-thickness / 2, thickness / 2)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return p, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])


SHAPES = {"blob": blob, "sheet": sheet, "slab": slab, "fine": partial(blob, radius=0.02)}


def surface(points, faces, poses=None) -> Surface:
    return Surface(points, np.full(len(faces), 3), faces.ravel(), **({"poses": poses} if poses is not None else {}))


def collider(rng, shape: str, how: str) -> Collider:
    p, f = SHAPES[shape](rng)
    if how == "deforms":
        wave = 0.05 * np.sin(8 * p[:, [1, 2, 0]])
        return Collider("/mesh", surface(p, f, Curve([0.0, 0.5 * DT, DT, 2 * DT], np.stack([p, p + wave, 1.1 * p - wave, p]))))
    motion = Motion.still()
    if how == "moves":
        times, turns = np.linspace(0.0, 2 * DT, 5), np.array([[0, 0, 0, 1], *rng.normal(size=(4, 4)) * 0.1 + [0, 0, 0, 1]])
        motion = Motion.through(times, rng.uniform(-0.04, 0.04, (5, 3)), turns / np.linalg.norm(turns, axis=1, keepdims=True))
    return Collider("/mesh", surface(p, f), motion)


class Pair:
    """Points on their ways, and the contacts that are found by lists and without. `real`: float32 or float64."""

    def __init__(self, rng, shape: str, how: str, *, real=wp.float32, speed=2.0, device="cpu", deep=False):
        self.t, self.real, self.device, self.rng, self.deep = types(real), real, device, rng, deep
        self.x = rng.uniform(-0.5, 0.5, (N, 3)) * {"fine": 0.15, "sheet": (1.0, 1.0, 0.2)}.get(shape, 1.0)
        self.v = speed * rng.normal(size=(N, 3)) * rng.uniform(0.0, 1.0, (N, 1))**2
        body = collider(rng, shape, how)
        module = f"test_lists_{'sheet' if shape == 'sheet' else 'solid'}_{self.t.name}"
        self.of = [ColliderContacts(self.bodies(body), device=device, real=real, module=module, substeps=SUBSTEPS, dt=DT)
                   for _ in range(2)]
        self.of[0].make_search_kernel()                  # both, before the module is compiled
        broad.use_face_lists(self.of[1])

    def bodies(self, body: Collider) -> CollidablePoints:
        mu = np.tile((0.3, 0.3), (N, 1))
        return CollidablePoints([[body]], np.zeros((1, 3)), np.zeros(N, np.int32), np.ones(N), np.full(N, 0.001), mu,
                                np.zeros((0, 3)), np.zeros(1), np.full(1, 0.001))

    def substeps(self):
        """Slots of both after each substep of two frames."""
        h = DT / SUBSTEPS
        for frame in range(2):
            for c in self.of:
                c.prepare(frame * DT, deep=frame == 0 and self.deep)
            for k in range(SUBSTEPS):
                step = h * self.v + 2e-5 * self.rng.normal(size=(N, 3))
                yield [self.found(c, k, step) for c in self.of]
                self.x += step
                if k % 13 == 5:
                    self.v = self.v[self.rng.permutation(N)]

    def found(self, c: ColliderContacts, k: int, step: np.ndarray) -> dict[str, Any]:
        x, d, a = (wp.array(v, dtype=self.t.vec3, device=self.device) for v in (self.x, step, 0.0 * step))
        c.search(k, x, d, a)
        s = c.slots
        return {name: getattr(s, name).numpy()[:N] for name in ("count", "mark", "n", "b", "u")} | {"d": d.numpy()}


def apart(whole: dict, listed: dict) -> tuple[int, int]:
    """Contacts, and points whose contacts differ. Faces equally near have planes that differ by rounding, float32's in both
    precisions, as Warp's search is."""
    at = whole["count"] > 0
    off = np.abs(whole["b"] - listed["b"]) > 2e-5
    off |= np.einsum("ij,ij->i", whole["n"], listed["n"]) < 1.0 - 1e-3
    off |= np.abs(whole["u"] - listed["u"]).max(axis=1) > 1e-2
    return int(at.sum()), int(((at & off) | (whole["count"] != listed["count"]) | (whole["mark"] != listed["mark"])).sum())
