"""CPU threads that march abreast have the bits of one; parts of a net; orders that can be cut into parts."""

from dataclasses import replace
from queue import SimpleQueue

import numpy as np
import pytest

from tests.make.physics.motion.fast_paths.simd_springs import DOUBLE, FPS, FRAMES, SUBSTEPS, leapfrog
from wsim.kernels.motion.fast_paths.threads import DONE, FORMED
from wsim.model.stage import THROWN
from wsim.physics.motion import forces
from wsim.physics.motion.fast_paths import simd_springs
from wsim.physics.motion.fast_paths import threads as abreast
from wsim.scene import Motion, Scene
from wsim.simulation.simulation import Simulation

LONG = 400             # substeps: a frame in which helpers have time to come


def band(n: int, reach: int, rng) -> np.ndarray:
    """Two springs from each point to later ones no further than `reach`, (m, 2), either end first."""
    low = np.repeat(np.arange(n - reach), 2)
    ids = np.stack([low, low + rng.integers(1, reach + 1, len(low))], axis=1)
    return np.where(rng.random(len(ids))[:, None] < 0.5, ids, ids[:, ::-1])


def strip(length: int = 60, width: int = 8, **settings) -> tuple[Scene, dict]:
    """A long and crumpled net with holes, its points in random order: such go along Hilbert's curve in the arrays."""
    rng = np.random.default_rng(7)
    n, number = length * width, np.arange(length * width).reshape(length, width)
    pairs = [(number[1:], number[:-1]), (number[:, 1:], number[:, :-1]), (number[1:, 1:], number[:-1, :-1])]
    edges = np.concatenate([np.stack([a.ravel(), b.ravel()], axis=1) for a, b in pairs])
    where = np.stack([*np.divmod(np.arange(n), width), np.zeros(n)], axis=1) + rng.uniform(-0.3, 0.3, (n, 3))
    names = rng.permutation(n)
    return scene_of(where[np.argsort(names)], names[edges[rng.random(len(edges)) < 0.8]], rng, **settings)


def scene_of(points: np.ndarray, edges: np.ndarray, rng, **settings) -> tuple[Scene, dict]:
    """Springs at random tension on the edges, and what `leapfrog` needs."""
    i, j = edges.T
    net = {"points": points, "stiffness": rng.uniform(50.0, 100.0, len(edges)), "masses": rng.uniform(1.0, 2.0, len(points)),
           "velocities": rng.normal(size=points.shape),
           "lengths": np.linalg.norm(points[i] - points[j], axis=1) * rng.uniform(0.8, 1.2, len(edges))}
    net = {name: a.astype(np.float32).astype(np.float64) for name, a in net.items()} | {"edges": edges}
    damping, scene = settings.pop("damping", 0.0), Scene(fps=FPS, integrator="leapfrog", **settings)
    scene.net("/net", damping=damping, **net)
    return scene, net | {"damping": damping}


def several() -> Scene:
    """Two damped nets, one pinned by a pin that moves."""
    scene, net = strip(substeps=LONG, damping=1e-3)
    scene.net("/other", **(net | {"points": net["points"] + 1.0, "damping": 2e-3}))
    matrices = np.tile(np.eye(4), (2, 1, 1))
    matrices[1, 0, 3] = 0.5
    scene.pin("/pin", scene.springs[0], [0, 5], motion=Motion([0.0, 1.0], matrices))
    return scene


@pytest.fixture
def threads(monkeypatch):
    """Function that makes simulations with so many threads, also of nets that are not worth them."""
    def make(scene: Scene, count: int, **settings) -> Simulation:
        monkeypatch.setattr(abreast, "LEAST", 50)
        monkeypatch.setattr(simd_springs, "LOT", 50)
        monkeypatch.setattr(forces, "count_cores", lambda: count)
        sim = Simulation(replace(scene), **(DOUBLE | settings))
        assert sim.plan.method("explicit").pull.abreast.count == count
        return sim
    return make


def met(sim: Simulation) -> bool:
    """Whether the last frame had helpers."""
    team = sim.plan.method("explicit").pull.abreast
    return team.count > 1 and team.words[FORMED] > 0 and team.words[FORMED] == team.words[0] >> 6


@pytest.mark.skipif(abreast.count_cores() < 2, reason="a helper has no core to come to")
@pytest.mark.parametrize("count", [2, 3])
@pytest.mark.parametrize("settings", [{}, {"worlds": 2, "precision": "float32"}])
def test_any_number_of_threads_gives_the_same_bits(threads, count, settings):
    sims = [threads(several(), number, **settings) for number in (1, count, count)]
    frames = 0
    for _ in range(8):
        for sim in sims:
            sim.step()
            frames += met(sim)
        for other in sims[1:]:
            assert np.array_equal(sims[0].positions("/net"), other.positions("/net"))
            assert np.array_equal(sims[0].velocities("/other"), other.velocities("/other"))
    assert frames > 0


def test_helpers_that_never_come_are_not_waited_for(threads, monkeypatch):
    monkeypatch.setattr(abreast, "worker_queue", lambda number: SimpleQueue())
    sims = [threads(several(), number) for number in (1, 2)]
    for sim in sims:
        sim.run(3)
    assert not met(sims[1]) and np.array_equal(sims[0].positions("/net"), sims[1].positions("/net"))


def test_one_core_calls_nobody(threads, monkeypatch):
    monkeypatch.setattr(abreast, "worker_queue", None)
    sim = threads(several(), 1)
    sim.run(2)
    assert sim.plan.method("explicit").pull.abreast.team(0).call == 0


@pytest.mark.skipif(abreast.count_cores() < 2, reason="a helper has no core to come to")
def test_a_torn_spring_is_seen_by_whoever_has_it(threads):
    """The last point of the last part is thrown away: the leader never looks at its springs."""
    scene, _ = strip(substeps=LONG)
    sim, alone, frames = threads(scene, 2), threads(scene, 1), 0
    body = sim.model.body(None)
    last = int(np.argmax(np.where(np.isin(body.index, body.edges), body.index, -1)))      # that no spring holds stand behind it
    for _ in range(8):
        thrown = sim.velocities()
        thrown[last] = 1e3
        for s in (sim, alone):
            s.set("/net", "velocities", thrown)
            s.step()
        frames += met(sim)
        assert sim.plan.status.said(THROWN)[0] == alone.plan.status.said(THROWN)[0] == 1
    assert frames > 0


def test_an_order_by_levels_moves_points_as_numpy_says(threads):
    """Hilbert's curve comes back to where it was, and has no parts: the march goes by levels. Rounding of places up to 60 m."""
    scene, net = strip(substeps=SUBSTEPS, damping=2e-3)
    sim = threads(scene, 2)
    assert not np.array_equal(sim.plan.method("explicit").pull.table.order.numpy(), np.arange(len(net["points"])))
    sim.run(FRAMES)
    x, v = leapfrog(net, FRAMES)
    np.testing.assert_allclose(sim.positions(), x, rtol=0, atol=60.0 * 1e-13)
    np.testing.assert_allclose(sim.velocities(), v, rtol=0, atol=1e-11)


@pytest.mark.parametrize("reach, count", [(5, 8), (40, 7), (390, 1)])
def test_parts_reach_no_further_than_the_next(reach, count):
    """Heads are all that earlier parts reach, and tails all that reaches later ones: at most 3/4 of a part in two parts, of
    800 / count points."""
    rng = np.random.default_rng(reach)
    n = 800
    ids = band(n, reach, rng)
    found = abreast.march_parts(ids, np.bincount(ids.min(1), minlength=n) + 4.0, 8)
    first, head, tail, last = found.T
    assert len(found) == count
    assert first[0] == 0 and last[-1] == n and (first[1:] == last[:-1]).all()
    assert ((first <= head) & (head <= tail) & (tail <= last)).all()
    low, high = ids.min(1), ids.max(1)
    of = np.searchsorted(last, np.arange(n), side="right")
    assert (of[high] - of[low] <= 1).all()
    crossing = of[high] != of[low]
    assert (high[crossing] < head[of[high[crossing]]]).all() and (low[crossing] >= tail[of[low[crossing]]]).all()


def test_a_hub_is_not_cut():
    ids = np.stack([np.zeros(5000, np.int64), np.arange(1, 5001)], axis=1)
    assert len(abreast.march_parts(ids, np.bincount(ids.min(1), minlength=5001) + 4.0, 4)) == 1


def test_a_desk_has_a_word_for_every_thread(threads):
    """Words begin with a pair of cache lines, wherever Warp put the array."""
    team = threads(several(), 3).plan.method("explicit").pull.abreast
    assert len(team.words) >= DONE + 3 and (team.words.ctypes.data % 128) == 0
