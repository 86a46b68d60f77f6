"""Contacts with meshes by lists of faces, in frames: those of a search of the whole mesh in every substep.

Points go on their own, at up to 15 m/s, through colliders that stand, turn or deform, and the slots of both are compared.
Bodies: a blob (closed, 320 faces), one with all of its faces within a list's reach, an open sheet, a plate of 2 mm.
"""

from functools import partial
from typing import Any

import numpy as np
import pytest
import warp as wp

from wsim.kernels.math.real import types
from wsim.physics.contact import broad
from wsim.physics.contact.contacts import CollidablePoints, ColliderContacts
from wsim.scene import Collider, Scene, Surface, shapes
from wsim.scene.curve import Curve, Motion
from wsim.simulation.simulation import Simulation

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


CASES = [(shape, how, wp.float32) for shape in SHAPES for how in ("stands", "moves", "deforms")]
CASES += [("blob", "moves", wp.float64), ("sheet", "deforms", wp.float64)]


@pytest.mark.parametrize("shape, how, real", CASES)
def test_lists_find_what_a_search_of_the_whole_mesh_finds(shape, how, real):
    pair = Pair(np.random.default_rng(3), shape, how, real=real)
    met, differ = np.sum([apart(*found) for found in pair.substeps()], axis=0)
    assert met > 150 and differ == 0


@pytest.mark.parametrize("shape, how", [("blob", "stands"), ("blob", "moves"), ("slab", "moves"), ("blob", "deforms")])
def test_points_that_begin_inside_are_on_the_side_that_the_winding_number_says(shape, how):
    pair = Pair(np.random.default_rng(7), shape, how, deep=True, speed=0.3)
    met, differ = np.sum([apart(*found) for found in pair.substeps()], axis=0)
    assert met > 1000 * (shape == "blob") and differ == 0


def test_lists_that_have_no_room_ask_for_it_and_change_nothing():
    """By then most lists of a fine mesh are whole."""
    pair, whole, wanted = Pair(np.random.default_rng(3), "fine", "moves"), [], 0
    contacts = pair.of[1]
    for room in (2, None):
        if room:
            contacts.points.room = room                           # of more in its arrays
        else:
            contacts.points.wanted.zero_()
            assert broad.grow_face_lists(contacts.points, wanted) and contacts.points.room == min(wanted, broad.MOST)
        found = np.sum([apart(*found) for found in pair.substeps()], axis=0)
        wanted, lists = int(contacts.points.wanted.numpy()[0]), contacts.points.radius.numpy() > 0
        whole.append((contacts.points.count.numpy()[lists] <= contacts.points.room).mean())
        assert found[0] > 100 and found[1] == 0 and (wanted > 2 if room else True)
    assert whole[0] < 0.5 and whole[1] > 0.9


def fallen(rng) -> Scene:
    """A net thrown onto a plate that turns, a still sheet that is open, and a blob of many faces that breathes."""
    scene = Scene(fps=60.0, solver="explicit", gravity=(0.0, 0.0, -9.81), up="Z")
    scene.net("/net", *shapes.spring_sheet(0.3, 8, stretch=200.0, up="Z"), velocities=[(0.3, 0.0, -1.5)] * 64)
    tilt = np.array([np.sin(0.3), 0.0, 0.0, np.cos(0.3)])
    rises = Motion.through([0.0, 0.1], [(0.2, 0, -0.16), (0.2, 0, -0.1)], [(0, 0, 0, 1), tilt])
    scene.collider("/plate", surface(*slab(rng)), motion=rises)
    scene.collider("/sheet", surface(*sheet(rng)), at=(0.0, 0.0, -0.19))
    p, f = blob(rng, 0.05, 0.05)
    scene.collider("/blob", surface(p, f, Curve([0.0, 0.1], np.stack([p, 1.3 * p]))), at=(0.0, 0.0, -0.17))
    return scene


def test_a_run_is_that_of_searches_in_every_substep(monkeypatch):
    """Of two worlds, and once more after a reset, when lists are those of another time; room grows on the way."""
    def run() -> Simulation:
        sim = Simulation(fallen(np.random.default_rng(5)), device="cpu", precision="float64", worlds=2)
        sim.run(6)
        return sim
    sim = run()
    x, v, lists = sim.state.x.numpy(), sim.state.v.numpy(), sim.plan.ports.contacts.points
    assert lists.every > 0 and lists.room > 2 and np.abs(v - v.mean(axis=0)).max() > 0.5
    assert np.array_equal(x[:64], x[64:])
    sim.reset()
    sim.run(6)
    assert np.array_equal(sim.state.x.numpy(), x)
    with monkeypatch.context() as m:
        m.setattr(broad, "use_face_lists", lambda *_: None)
        whole = run()
    assert whole.plan.ports.contacts.points.every == 0
    np.testing.assert_allclose(whole.state.x.numpy(), x, rtol=0.0, atol=1e-6)
    monkeypatch.setattr(broad, "ROOM", 2)
    small = run()
    assert small.plan.ports.contacts.points.room > 2 and np.array_equal(small.state.x.numpy(), x)
