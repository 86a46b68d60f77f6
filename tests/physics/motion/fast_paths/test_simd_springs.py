"""One CPU thread that takes every spring once, against leapfrog written down in NumPy, on nets that are no regular sheet."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from tests.make.physics.motion.fast_paths.simd_springs import DOUBLE, FPS, FRAMES, SUBSTEPS, leapfrog
from wsim.kernels.motion.fast_paths.simd_springs import EIGHT, LANES
from wsim.physics.motion.fast_paths.simd_springs import LOT, RUN, Packets
from wsim.scene import Scene, Sphere, shapes
from wsim.scene.fabric import Fabric
from wsim.simulation.plan import build_plan
from wsim.simulation.simulation import Simulation


def tangle(hub: int, **settings) -> tuple[Scene, dict]:
    """A hub with so many springs, a ring, points with 0, 1, 5 and 9 springs, and springs that are there twice."""
    rng = np.random.default_rng(5)
    n = hub + 30
    points = rng.normal(size=(n, 3))
    edges = [[0, k] for k in range(1, hub + 1)] + [[k, k + 1] for k in range(hub + 1, n - 3)]
    edges += [[hub + 2, hub + 2 + k] for k in (2, 3, 4)] + [[k, hub + 9] for k in range(hub + 11, hub + 18)]
    edges += [[n - 3, n - 2], [n - 3, n - 2], [n - 2, n - 4], [hub + 1, 1], [1, hub + 1]]       # the last point has none
    i, j = np.array(edges).T
    net = {"points": points, "edges": np.array(edges), "stiffness": rng.uniform(50.0, 100.0, len(edges)),
           "masses": rng.uniform(1.0, 2.0, n), "velocities": rng.normal(size=(n, 3)),
           "lengths": np.linalg.norm(points[i] - points[j], axis=1) * rng.uniform(0.8, 1.2, len(edges))}
    net |= {name: a.astype(np.float32).astype(np.float64) for name, a in net.items() if name != "edges"}       # as scenes are
    damping, scene = settings.pop("damping", 0.0), Scene(fps=FPS, substeps=SUBSTEPS, integrator="leapfrog", **settings)
    scene.net("/net", damping=damping, **net)
    return scene, net | {"damping": damping}


@pytest.mark.parametrize("hub", [5, LOT, LOT + 13])
@pytest.mark.parametrize("settings", [{}, {"damping": 2e-3}, {"air_drag": 3.0}])
def test_a_tangle_moves_as_numpy_says(hub, settings):
    """Rounding: some 20 steps of sums of at most hub + 13 forces of 1e3 N."""
    scene, net = tangle(hub, **settings)
    sim = Simulation(scene, **DOUBLE)
    sim.run(FRAMES)
    x, v = leapfrog(net, FRAMES, settings.get("air_drag", 0.0))
    np.testing.assert_allclose(sim.positions(), x, rtol=0, atol=1e-13)
    np.testing.assert_allclose(sim.velocities(), v, rtol=0, atol=1e-11)


@pytest.mark.parametrize("damping", [0.0, 2e-3])
def test_a_substep_at_a_time_is_the_same_motion(damping):
    """A collider out of reach: other stages come between the substeps."""
    scene, net = tangle(9, damping=damping)
    scene.collider("/far", Sphere(0.1), at=(0.0, 100.0, 0.0))
    sim = Simulation(scene, **DOUBLE)
    sim.run(1)
    np.testing.assert_allclose(sim.positions(), leapfrog(net, 1)[0], rtol=0, atol=1e-11)


@pytest.mark.parametrize("damping", [0.0, 2e-3])
def test_springs_pull_the_same_beside_elements(damping):
    """A membrane in the scene: springs are summed here, points move with the others. It has damping, or none, as the net."""
    scene, net = tangle(9, damping=damping)
    scene.cloth("/cloth", *shapes.sheet(0.5, 0.5, 3, 3), material=Fabric(stretch=5.0, shear=2.0, bend=1e-4, damping=damping))
    sim = Simulation(scene, **DOUBLE)
    sim.run(FRAMES)
    np.testing.assert_allclose(sim.positions("/net"), leapfrog(net, FRAMES)[0], rtol=0, atol=1e-13)


@pytest.mark.parametrize("precision, rounding", [("float32", 6e-8), ("float64", 1.2e-16)])
def test_a_free_tangle_keeps_its_momentum(precision, rounding):
    """Both ends get the same bits: what is left are the roundings of the sums, at random signs."""
    scene, net = tangle(LOT + 13, gravity=(0.0, 0.0, 0.0), damping=2e-3)
    sim, m = Simulation(scene, device="cpu", precision=precision), net["masses"][:, None]
    sim.run(FRAMES)
    size = np.abs(m * sim.velocities()).sum()
    assert np.abs((m * sim.velocities()).sum(0) - (m * net["velocities"]).sum(0)).max() < 4.0 * rounding * size


def sheet(side: int, rng) -> np.ndarray:
    """Edges of a grid and their diagonals, (m, 2), one in twenty missing, one in twenty there twice, either end first."""
    at = np.arange(side * side).reshape(side, side)
    pairs = [(at[1:], at[:-1]), (at[:, 1:], at[:, :-1]), (at[1:, 1:], at[:-1, :-1]), (at[2:], at[:-2])]
    ids = np.concatenate([np.stack([a.ravel(), b.ravel()], axis=1) for a, b in pairs])
    ids = np.concatenate([ids[rng.random(len(ids)) < 0.95], ids[rng.random(len(ids)) < 0.05]])
    return np.where(rng.random(len(ids))[:, None] < 0.5, ids, ids[:, ::-1])


@pytest.mark.parametrize("damping", [0.0, 2e-3])
def test_a_sheet_in_runs_moves_as_numpy_says(damping):
    rng, side = np.random.default_rng(3), 21
    points = np.stack([*np.divmod(np.arange(side**2.0), side), np.zeros(side**2)], axis=1)
    net = {"points": points, "edges": sheet(side, rng), "velocities": rng.normal(size=(side**2, 3))}
    size = np.linalg.norm(np.diff(points[net["edges"]], axis=1)[:, 0], axis=1)
    net |= {"stiffness": rng.uniform(50.0, 100.0, len(size)), "lengths": size * rng.uniform(0.8, 1.2, len(size)),
            "masses": rng.uniform(1.0, 2.0, side**2)}
    net = {name: a if name == "edges" else a.astype(np.float32).astype(np.float64) for name, a in net.items()}
    scene = Scene(fps=FPS, substeps=SUBSTEPS, integrator="leapfrog")
    scene.net("/net", damping=damping, **net)
    sim = Simulation(scene, **DOUBLE)
    assert sim.plan.method("explicit").pull.table.runs.numpy().sum() > side
    sim.run(FRAMES)
    np.testing.assert_allclose(sim.positions(), leapfrog(net | {"damping": damping}, FRAMES)[0], rtol=0, atol=1e-12)


@pytest.mark.parametrize("beside", [False, True])
def test_a_frame_remembers_nothing_of_the_one_before(beside):
    """One that has run into no number is repeated: what it left in the room is nobody's."""
    scene, _ = tangle(9, damping=2e-3)
    if beside:
        scene.cloth("/cloth", *shapes.sheet(0.5, 0.5, 3, 3), material=Fabric(stretch=5.0, shear=2.0, bend=1e-4))
    sims = [Simulation(replace(scene), **DOUBLE) for _ in range(2)]
    sims[1].plan.method("explicit").pull.space.fill_(np.nan)
    for sim in sims:
        sim.run(1)
    assert np.array_equal(sims[0].positions("/net"), sims[1].positions("/net"))


def test_packets_hold_every_spring_once():
    """Two worlds of a sheet whose points stand in another order than in the arrays; lanes past those of a run are no spring."""
    rng, n = np.random.default_rng(4), 21**2
    ids, order = sheet(21, rng), np.r_[n - 1:-1:-1]
    both = np.concatenate([ids, ids + n])
    found = Packets(both, np.append(order, order + n), worlds=2)
    spring = np.empty((len(found.entry) // EIGHT, EIGHT), int)
    spring[:, LANES] = found.entry.reshape(-1, EIGHT)
    held, ends = spring.ravel() >= 0, np.append(found.order, -1)[np.minimum(found.ends, len(found.order))]
    assert np.array_equal(np.sort(spring.ravel()[held]), np.arange(len(both)))
    assert np.array_equal(np.sort(ends[held]), np.sort(both[spring.ravel()[held]]))
    assert held.reshape(-1, EIGHT).any(axis=1).all() and 0 < found.runs.sum() * RUN <= held.sum()
    assert np.array_equal(found.runs[:len(found.runs) // 2], found.runs[len(found.runs) // 2:])
    assert found.start[-1] == len(found.entry) and found.group[-1] * EIGHT == len(found.order)


def test_coincident_points_pull_at_nothing():
    """They fall together, and nothing becomes no number. `Simulation` would have moved them apart: the plan is run as it is."""
    scene = Scene(fps=FPS, substeps=SUBSTEPS, integrator="leapfrog")
    scene.net("/net", np.zeros((3, 3)), [[0, 1], [1, 2]], [100.0, 100.0], 1.0, lengths=[0.0, 0.0], damping=1e-3)
    plan = build_plan(scene, device=wp.get_device("cpu"), real=wp.float64)
    for _ in range(FRAMES):
        plan.before_frame(0.0)
        plan.frame()
    fallen = [0.0, -0.5 * 9.81 * (FRAMES / FPS)**2, 0.0]
    np.testing.assert_allclose(plan.state.x.numpy() + plan.state.e.numpy(), np.tile(fallen, (3, 1)), rtol=0, atol=1e-15)


def test_worlds_have_the_same_bits_wherever_their_lots_begin():
    scene, _ = tangle(LOT - 3, damping=1e-3)
    one, three = (Simulation(replace(scene), device="cpu", worlds=worlds) for worlds in (1, 3))
    one.run(2)
    three.run(2)
    assert all(np.array_equal(one.positions(), three.positions(world=w)) for w in range(3))
