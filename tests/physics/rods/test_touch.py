"""Rods against rods and themselves: they never pass through each other, keep momentum, stick and slip, and stay knotted."""

from dataclasses import replace

import numpy as np
import pytest

import wsim
from tests.physics.rods.knots import closed, determinant, linking
from tests.physics.rods.rig import simulated
from wsim.physics.rods import shape
from wsim.physics.rods.objects import Rods
from wsim.scene import Motion, Scene

N, THICK = 17, 0.02


def thrown(seed: int = 0, speed: float = 10.0, held: bool = True, on: bool = True, substeps: int = 4) -> tuple[Scene, Rods]:
    """Two ropes across each other, 0.1 m apart, thrown at each other; held: by their ends. seed: tilts and shifts, 0: none."""
    rng = np.random.default_rng(seed)
    t, some = np.linspace(-0.5, 0.5, N), float(seed > 0)
    turn = np.pi / 2.0 + some * rng.uniform(-0.9, 0.9)
    off = some * rng.uniform(-0.2, 0.2, 2)
    a = np.stack([t, 0.0 * t, 0.0 * t + 0.05], axis=1)
    b = np.stack([t * np.cos(turn) + off[0], t * np.sin(turn) + off[1], 0.0 * t - 0.05], axis=1)
    v = np.zeros((2 * N, 3))
    v[:, 2] = np.repeat([-speed, speed], N)
    v[:, :2] += some * rng.normal(size=2) * np.repeat([1.0, -1.0], N)[:, None]
    scene = Scene(gravity=(0.0, 0.0, 0.0), fps=60.0, substeps=substeps)
    rods = scene.add(Rods("/ropes", np.concatenate([a, b]), [N, N], THICK, young=1e7, velocities=v, self_collision=on))
    if held:
        rods.pin("/ends", [0, N - 1, N, 2 * N - 1])
    return scene, rods


def linked(x: np.ndarray) -> float:
    """Linking number of two held ropes as a file has them, each closed on its own side."""
    x = np.asarray(x, np.float32).astype(np.float64)
    a, b = x[:N], x[N:]
    return linking(closed(a, a[[-1, 0]] + (0.0, 0.0, 30.0)), closed(b, b[[-1, 0]] - (0.0, 0.0, 30.0)))


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
    straight, director = np.zeros_like(x), shape.frames(x[None])[0]
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
