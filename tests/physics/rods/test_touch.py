"""Rods against rods and themselves: they never pass through each other, keep momentum, stick and slip, and stay knotted."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

import wsim
from tests.make.physics.rods.touch import THICK, N, linked, thrown
from tests.physics.rods.knots import determinant, linking
from tests.physics.rods.rig import simulated
from wsim.kernels.rods.coupled_newton import reduction
from wsim.physics.rods import coupled_newton, shape
from wsim.physics.rods.objects import Rods
from wsim.scene import Motion, Scene
from wsim.simulation.simulation import Simulation


@wp.kernel(module="reduced", enable_backward=False)
def reduced(points: wp.array(dtype=int), nodes: wp.array3d(dtype=wp.float64), work: wp.array(dtype=wp.float64),
            r: wp.array2d(dtype=wp.vec4d), most: int, z_out: wp.array2d(dtype=wp.vec4d)):
    reduction.factor_cyclic_reduction(points, nodes, 0, points.shape[0], most)
    reduction.solve_cyclic_reduction(points, nodes, work, r, z_out, 0, points.shape[0], most)


def test_the_judges_know_links_and_knots():
    t = 2.0 * np.pi * np.arange(40) / 40
    ring, other = np.stack([np.cos(t), np.sin(t), 0.0 * t], 1), np.stack([1.0 + np.cos(t), 0.0 * t, np.sin(t)], 1)
    assert abs(linking(ring, other)) == pytest.approx(1.0, abs=1e-9)
    assert linking(ring, other + (3.0, 0.0, 0.0)) == pytest.approx(0.0, abs=1e-9)
    assert [determinant(curve, seed) for curve in (overhand(0.01), overhand(0.01)[:60]) for seed in range(2)] == [3, 3, 1, 1]


@pytest.mark.parametrize("seed", range(4))
def test_ropes_that_are_thrown_at_each_other_never_pass(seed):
    """At 10 m/s each, held by their ends: 0 is the linking number of every substep; without contact they pass, and it is 1."""
    made, rods = thrown(seed)
    made.fps, made.substeps = 240.0, 1                       # every substep is seen
    simulation, method = simulated(made)
    for _ in range(120):
        simulation.step()
        assert linked(method.points(0)[0]) == pytest.approx(0.0, abs=1e-6)
    found = method.indicators(None, None)
    assert found["rod_cut"] == found["rod_held"] == 0
    free, without = simulated(thrown(seed, on=False)[0])
    free.run(1)
    assert abs(linked(without.points(0)[0])) == pytest.approx(1.0, abs=1e-6)


def test_ropes_that_collide_keep_their_momentum():
    """Sum of m v, to 1e-6 of the sum of m |v|."""
    made, rods = thrown(3, held=False)
    simulation, method = simulated(made)
    m = method.table.values["m"].T.ravel()
    first = m @ method.points(0)[1]
    simulation.run(12)
    v = method.points(0)[1]
    assert np.abs(m @ v - first).max() < 1e-6 * 10.0 * m.sum()
    assert v[:N, 2].mean() > -3.0 and v[N:, 2].mean() < 3.0              # they met


def lying(degrees: float, frames: int) -> float:
    """Speed [m/s] of a rod that lies across two held ones which are tilted, friction 0.5, after so many frames."""
    a, t = np.radians(degrees), np.linspace(-0.2, 0.2, 7)
    rail = np.stack([4.0 * t, 0.0 * t, 0.0 * t], axis=1)
    over = np.stack([0.0 * t, 0.0 * t + THICK, t], axis=1)
    x = np.concatenate([rail - (0.0, 0.0, 0.15), rail + (0.0, 0.0, 0.15), over])
    scene = Scene(gravity=(9.81 * np.sin(a), -9.81 * np.cos(a), 0.0), fps=60.0, substeps=4)
    rods = scene.add(Rods("/rods", x, [7, 7, 7], THICK, young=1e9, self_collision=True))
    rods.pin("/rails", np.arange(14))
    simulation, method = simulated(scene)
    simulation.run(frames)
    return float(method.points(0)[1][14:, 0].mean())


def test_a_rod_on_rods_sticks_and_slips_at_the_critical_angle():
    critical = np.degrees(np.arctan(0.5))
    assert abs(lying(critical - 1.0, 40)) < 1e-6
    a = np.radians(critical + 1.0)
    gain = lying(critical + 1.0, 40) - lying(critical + 1.0, 25)
    assert gain == pytest.approx(0.25 * 9.81 * (np.sin(a) - 0.5 * np.cos(a)), rel=0.01)


def test_results_are_the_same_from_run_to_run_and_in_worlds():
    found = []
    for worlds in (1, 1, 2):
        simulation, method = simulated(thrown(2, held=False)[0], worlds=worlds)
        simulation.run(6)
        found += [method.points(k)[0] for k in range(worlds)]
    assert all(np.array_equal(found[0], each) for each in found[1:])


@pytest.mark.parametrize("worlds", [1, 2])
def test_a_run_that_goes_on_is_the_unbroken_one_to_the_bit_while_ropes_touch(worlds):
    """What pairs kept and what friction held was not written: ropes that had just met were 5 mm away a frame later, as what
    pressed them counted as a start that overlaps."""
    (whole, method), thick = simulated(thrown(2, 4.0)[0]), []
    written, ends = [], []
    for _ in range(4):
        written.append({path: whole.fields(path) for path in whole.state.paths()})
        whole.step()
        ends.append(method.points(0)[0].copy())
        thick.append(method.touching.indicators().get("rod_pressed", 0.0))
    for k in (1, 2):
        again, own = simulated(thrown(2, 4.0)[0], worlds=worlds)
        again.restart(k, written[k])
        assert {path: again.fields(path) for path in again.state.paths()}["/ropes"]["pair0"].tolist() == (
            written[k]["/ropes"]["pair0"].tolist())
        for end in ends[k:]:
            again.step()
            assert np.array_equal(own.points(0)[0], end)
    assert thick[0] > 0.0 and len(written[1]["/ropes"]["pair0"]) > 1


def test_nothing_of_it_is_built_where_it_is_not_asked_for(tmp_path):
    made, rods = thrown(on=False)
    simulation, method = simulated(made)
    assert method.touching is None and "wsim_rods_touch" not in simulation.model.modules
    path = str(tmp_path / "ropes.usda")
    wsim.save(replace(made), path)
    assert not wsim.load(path).things("Rods")[0].self_collision
    rods.self_collision = True
    wsim.save(made, path)
    assert wsim.load(path).things("Rods")[0] == rods


def overhand(edge: float) -> np.ndarray:
    """An open overhand knot in edges of that length [m], 1.7 m long, with its ends apart along x."""
    from tools.scenes.rods import overhand
    return overhand(edge)


@pytest.mark.slow
def test_a_knot_that_is_pulled_tight_stays_and_tightens():
    x = overhand(0.01)
    n, times = len(x), np.linspace(0.0, 2.5, 41)
    straight, director = np.zeros_like(x), shape.director_frames(x[None])[0]
    straight[:, 0] = np.arange(n) * np.linalg.norm(x[1] - x[0])
    scene = Scene(gravity=(0.0, 0.0, 0.0), fps=24.0, substeps=8)
    rods = scene.add(Rods("/rope", x, [n], 0.01, young=1e7, bend=3e-4, twist=3e-4, rest_points=straight, self_collision=True,
                          directors=np.concatenate([director, director[-1:]]), static_friction=0.1, dynamic_friction=0.1))
    for name, points, side in (("/left", [0, 1], -1.0), ("/right", [n - 2, n - 1], 1.0)):
        frames = np.tile(np.eye(4), (41, 1, 1))
        frames[:, 0, 3] = side * 0.28 * (1.0 - np.cos(np.pi * times / 2.5))
        rods.pin(name, points, motion=Motion(times, frames))
    simulation, method = simulated(scene)
    sizes = []
    for _ in range(60):
        simulation.step()
        written = method.points(0)[0].astype(np.float32)
        assert determinant(written) == 3
        sizes.append(np.ptp(written[20:-20, 1]))
    assert sizes[0] > 0.2 and sizes[-1] < 0.03
    assert method.indicators(None, None)["rod_gap"] > 0.008


@pytest.mark.parametrize("n", [1, 2, 7, 40])
def test_odd_even_reduction_errs_by_rounding_alone(n):
    """Springs 1e8 times as stiff along as across, strands of n, n - 1 .. points side by side: residuals are those of a backward
    stable elimination, a few eps |A| |z| an unknown, which dense elimination of the same strands has as well."""
    rng, m, most = np.random.default_rng(n), 3, (n + 1) // 2
    counts = np.maximum(n - np.arange(m), 1)
    nodes, r, dense = np.zeros((reduction.MATRICES, 8, most, m, 8)), rng.normal(size=(n, m, 4)), []
    for k, count in enumerate(counts):
        size = 8 * ((count + 1) // 2)
        A = np.zeros((size, size))
        for i in range(0, size - 4, 4):
            t = np.linalg.qr(rng.normal(size=(4, 4)))[0]
            K = t @ np.diag([1e8, 1.0, 1.0, 1e-2]) @ t.T
            A[i:i + 8, i:i + 8] += np.block([[K, -K], [-K, K]])
        A[4 * count:], A[:, 4 * count:] = 0.0, 0.0
        A += np.diag(np.where(np.arange(size) < 4 * count, 1e-2, 1.0))
        for J in range(size // 8):
            own = slice(8 * J, 8 * J + 8)
            nodes[reduction.OWN, :, J, k] = A[own, own].T
            if size > 8 * J + 8:
                nodes[reduction.NEXT, :, J, k] = A[own, 8 * J + 8:8 * J + 16].T
        dense.append(A[:4 * count, :4 * count])
    given = [wp.array(counts.astype(np.int32), dtype=int, device="cpu"),
             wp.array(nodes.reshape(reduction.MATRICES, 8, -1), dtype=wp.float64, device="cpu"),
             wp.zeros(16 * most * m, dtype=wp.float64, device="cpu"), wp.array(r, dtype=wp.vec4d, device="cpu")]
    z = wp.zeros((n, m), dtype=wp.vec4d, device="cpu")
    wp.launch(reduced, 1, [*given, most], [z], device="cpu")
    for k, (count, A) in enumerate(zip(counts, dense, strict=True)):
        found, side = z.numpy()[:count, k].ravel(), r[:count, k].ravel()
        for x in (found, np.linalg.solve(A, side)):
            scale = np.abs(A).sum(axis=1).max() * np.abs(x).max() + np.abs(side).max()
            assert np.abs(side - A @ x).max() < 4 * count * np.finfo(float).eps * scale


@pytest.mark.slow
@pytest.mark.parametrize("far", [0, 14])
def test_a_block_of_threads_finds_what_a_thread_a_strand_does(far, monkeypatch):
    """Two ropes that are thrown at each other, a short one between them, in two worlds: iterations end at 1e-6 of an edge, 12
    substeps. far: ropes that meet nothing, with which vectors have no room in shared memory. Gradients in the motions of pairs
    that press are those in all points."""
    def places(team: bool, room: int = coupled_newton.ROOM) -> tuple[np.ndarray, np.ndarray, float]:
        monkeypatch.setattr(coupled_newton, "TEAM", team)
        monkeypatch.setattr(coupled_newton, "ROOM", room)
        made, rods = thrown(1, speed=4.0)
        t = np.linspace(0.02, 0.2, 6)
        made.add(Rods("/short", np.stack([t, 0.3 * t, 0.0 * t], axis=1), [6], THICK, young=1e7, self_collision=True))
        if far:
            apart = np.tile(np.stack([np.linspace(0.0, 1.0, N), *np.zeros((2, N))], axis=1), (far, 1))
            apart[:, 1] += 5.0 + np.repeat(np.arange(far), N)
            made.add(Rods("/zfar", apart, [N] * far, THICK, young=1e7, self_collision=True))
        simulation = Simulation(made, device="cpu", worlds=2)
        method, pressed = simulation.plan.method("rods"), 0.0
        assert not team or bool(method.touching.team.chosen) == (room > 0)
        for _ in range(3):
            simulation.step()
            pressed = max(pressed, method.indicators(None, None)["rod_pressed"])
        order = [k for world in range(2) for k, (_, of) in enumerate(method.table.pairs) if of == world]
        each = len(order) // 2
        long, short = (np.stack([method.points(k)[0] for k in order[first::each]]) for first in range(2))
        return long, short, pressed
    one, other, again, whole = places(True), places(False), places(True), places(True, 0)
    assert one[2] > 0.0
    for k in range(2):                                                                # ropes, and the short one
        assert np.array_equal(one[k], again[k])
        assert np.array_equal(one[k][0], one[k][1])                                   # of both worlds
        assert np.abs(one[k] - other[k]).max() < 12 * 1e-6 * 0.0625
        assert np.abs(one[k] - whole[k]).max() < 1e-11
