"""Sums over the neighbours of a fluid's particles: eight at a time on a CPU are those of one after the other, to rounding."""

from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp

import wsim
from wsim.kernels.math.real import types
from wsim.kernels.position_based import packets, pair_sums
from wsim.kernels.position_based.neighbours import list_kernel, neighbour_structs
from wsim.kernels.position_based.packets import sums as packet_sums
from wsim.kernels.position_based.packets.lists import cell_list_kernel
from wsim.model.structs import fill_struct
from wsim.physics.position_based.objects import ConstraintFluid

D = 0.02


def crowd(real):
    """75 particles in disorder, three of them in one place, with lists of what is within 2.2 D; random numbers."""
    rng = np.random.default_rng(3)
    x = rng.uniform(0, 4.5 * D, (75, 3))
    x[[20, 40, 70]] = x[40]
    near = np.linalg.norm(x[:, None] - x[None], axis=-1) < 2.2 * D
    np.fill_diagonal(near, False)
    rows = [np.flatnonzero(row) for row in near]
    room = max(map(len, rows))
    other = np.zeros((room, len(x)), np.int32)
    for k, row in enumerate(rows):
        other[:len(row), k] = row
    t, S = types(real), neighbour_structs(real)
    lists = fill_struct(S.PairLists, room=room, size=len(x), count=wp.array(near.sum(1), dtype=int, device="cpu"),
                        other=wp.array(other.ravel(), dtype=int, device="cpu"), wanted=wp.zeros(1, dtype=int, device="cpu"))
    y, v = np.c_[x, rng.uniform(0, 1e-3, len(x))], rng.uniform(0, 1, (len(x), 4))
    return SimpleNamespace(n=len(x), lists=lists, lists_type=S.PairLists, vec=t.vec4,
                           y=wp.array(y, dtype=t.vec4, device="cpu"), v=wp.array(v, dtype=t.vec4, device="cpu"))


def all_sums(lanes, real):
    """(particles, 3, 8): density, push and flow of each."""
    at, sums = crowd(real), packet_sums.row_sums(lanes, real)
    Lists, vec = at.lists_type, at.vec

    @wp.kernel(module="unique", enable_backward=False)
    def every(lists: Lists, y: wp.array(dtype=vec), v: wp.array(dtype=vec), out: wp.array(dtype=real, ndim=3)):
        first = wp.static(lanes) * wp.tid()
        density = sums.density(y, lists, first, real(D))
        push = sums.push(y, lists, first, real(D))
        flow = sums.flow(y, v, lists, first, real(D), real(0.002))
        for m in range(wp.static(lanes)):
            if first + m < lists.size:
                for c in range(7):
                    out[first + m, 0, c] = density[m, c]
                    out[first + m, 1, c] = push[m, c]
                    out[first + m, 2, c] = flow[m, c]
    out = wp.zeros((at.n, 3, 8), dtype=real, device="cpu")
    wp.launch(every, -(-at.n // lanes), [at.lists, at.y, at.v], [out], device="cpu")
    return out.numpy().astype(float)


@pytest.mark.parametrize("real, most", [(wp.float32, 2e-6), (wp.float64, 1e-14)])
def test_eight_particles_together_have_the_sums_of_one_after_the_other(real, most):
    """With a remainder of three, lists of other lengths, and particles in one place."""
    one, eight = all_sums(1, real), all_sums(8, real)
    scale = np.abs(one).max(axis=0)
    assert (scale[0, :5] > 0).all() and (scale[1, :6] > 0).all() and (scale[2, :3] > 0).all()
    assert (np.abs(eight - one) <= most * np.maximum(scale, 1e-30)).all()


def test_sums_are_those_of_the_formulas():
    """Density, its slope and a push, by NumPy, of particles that share no place."""
    found, at = all_sums(8, wp.float64), crowd(wp.float64)
    x, c = at.y.numpy()[:, :3], at.y.numpy()[:, 3]
    way = x[:, None] - x[None]
    r, H = np.linalg.norm(way, axis=-1), 2 * D
    e = way / np.where(r > 0, r, 1.0)[..., None]
    a, q = 15 / (8 * np.pi * pair_sums.LATTICE), np.maximum(1 - r / H, 0)
    slope = np.where(r > 0, -3 * a / H * q**2, 0.0)
    alone = np.delete(np.arange(at.n), [20, 40, 70])
    assert np.allclose(found[:, 0, 0], (a * q**3).sum(1), rtol=1e-12)
    assert np.allclose(found[alone, 0, 1:4], (slope[..., None] * e).sum(1)[alone], rtol=1e-9, atol=1e-9)
    assert np.allclose(found[alone, 0, 4], (slope**2).sum(1)[alone], rtol=1e-12)
    pushed = ((c[:, None] + c[None]) * slope)[..., None] * e
    assert np.allclose(found[alone, 1, :3], pushed.sum(1)[alone], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("real", [wp.float32, wp.float64])
@pytest.mark.parametrize("material", ["fluid", "grains"])
def test_lists_by_eights_are_those_of_one_by_one(real, material):
    """After a fall, with two sizes of grains, and a group of which no two are wanted: entry by entry, in the same order."""
    scene = wsim.Scene(fps=60, substeps=4, iterations=2)
    scene.collider("/floor", wsim.Plane())
    scene.particles("/some", wsim.Box((0.06, 0.06, 0.06)), at=(0, 0.061, 0), radius=D / 2, material=material)
    if material == "grains":
        scene.particles("/more", wsim.Box((0.03, 0.03, 0.03)), at=(0, 0.16, 0), radius=D / 5, material=material)
    simulation = wsim.Simulation(scene, device="cpu", precision="float32" if real is wp.float32 else "float64")
    simulation.run(3)
    search = simulation.plan.method("density" if material == "fluid" else "grains").search
    cells, first, found = search.cells, search.lists, []
    cells.flag.fill_(1)
    search.rows.group.assign(np.where(np.arange(search.count) % 3, -1, 7).astype(np.int32))
    for make in (list_kernel, cell_list_kernel):
        kernel = make(real, f"test_lists_{real.__name__}")
        search.make_room(first.room)
        wp.launch(kernel, search.count, [search.rows, cells, search.lists], device="cpu")
        found.append((search.lists.count.numpy(), search.lists.other.numpy()))
    assert found[0][0].sum() > 5 * search.count
    assert np.array_equal(found[0][0], found[1][0]) and np.array_equal(found[0][1], found[1][1])


def test_a_fluid_moves_by_eights_as_one_by_one(monkeypatch):
    """A splash of 216 particles for eight substeps; roundings have not grown yet."""
    def places(lanes):
        monkeypatch.setattr(packets, "LANES", lanes)
        scene = wsim.Scene(fps=60, substeps=4, iterations=3)
        scene.collider("/floor", wsim.Plane())
        scene.particles("/water", wsim.Box((0.06, 0.06, 0.06)), at=(0, 0.061, 0), radius=D / 2,
                        material=ConstraintFluid(viscosity=0.1))
        simulation = wsim.Simulation(scene, device="cpu")
        simulation.run(2)
        return simulation.positions().astype(float)
    eight = places(8)
    monkeypatch.undo()
    assert np.abs(places(1) - eight).max() < 1e-6
