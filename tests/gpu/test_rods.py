"""Rods on a GPU: where they are on a CPU, and the same to the bit from run to run."""

import numpy as np
import pytest
import warp as wp

from tests.physics.rods.rig import on_ball, scene
from wsim.geometry import primitives
from wsim.physics.rods import method
from wsim.scene import Box, Motion, Sphere, Surface
from wsim.scene.solids import Capsule
from wsim.simulation.simulation import Simulation

pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device here: run on a GPU machine")


def fallen(device: str, shape, place=(0.0, 0.0, 0.0), wind=0.0, frames=12) -> tuple[np.ndarray, np.ndarray]:
    """A strand that is held at one end and falls over a shape at a place."""
    x = np.zeros((14, 3))
    x[:, 0], x[:, 1] = np.linspace(0.0, 0.6, 14), 0.3
    made, rods = scene(x, gravity=(0.0, -9.81, 0.0), young=1e6)
    rods.pin("/clamp", [0, 1])
    made.collider("/shape", shape, motion=Motion.at_place(place))
    if wind:
        made.wind, made.air_drag, rods.drag = (0.0, 0.0, wind), 0.1, 1.0
    simulation = Simulation(made, device=device)
    simulation.run(frames)
    return simulation.plan.method("rods").points(0)


@pytest.mark.parametrize("shape", [Sphere(0.25), Box((0.2, 0.2, 0.2))], ids=["sphere", "box"])
def test_a_strand_goes_where_it_does_on_a_cpu(shape):
    one, other = fallen("cuda:0", shape), fallen("cpu", shape)
    assert np.abs(one[0] - other[0]).max() < 1e-5                              # iterations end at 1e-6 of an edge
    assert np.abs(one[1] - other[1]).max() < 1e-2
    assert all(np.array_equal(a, b) for a, b in zip(one, fallen("cuda:0", shape), strict=True))


TUBE, FACES = primitives.capsule_outline(0.01, 0.01, 0.3, 24)


@pytest.mark.parametrize("shape", [Capsule(0.004, 0.3), Box((0.01, 0.01, 0.3)),
                                   Surface(TUBE, np.full(len(FACES), 3), FACES.ravel())], ids=["wire", "bar", "mesh"])
@pytest.mark.parametrize("wind", [0.0, 3.0])
def test_a_strand_that_a_thin_collider_meets_between_its_points_goes_where_it_does_on_a_cpu(shape, wind):
    one, other = (fallen(device, shape, (0.3, 0.2, 0.0), wind, 30) for device in ("cuda:0", "cpu"))
    faceted = isinstance(shape, Surface)         # nearest faces are found in float32: at ridges of facets places go apart
    assert np.abs(one[0] - other[0]).max() < (1e-3 if faceted else 1e-5)
    assert faceted or np.abs(one[1] - other[1]).max() < 1e-2
    assert one[0][7, 1] > 0.2                                                  # it would be at 0.05
    assert all(np.array_equal(a, b) for a, b in zip(one, fallen("cuda:0", shape, (0.3, 0.2, 0.0), wind, 30), strict=True))


def test_a_hair_in_the_wind_goes_where_it_does_on_a_cpu():
    from tests.make.physics.rods.air import hair

    def blown(device: str) -> tuple[np.ndarray, np.ndarray]:
        made, rods = hair(1, gravity=(0.0, -9.81, 0.0))
        rods.pin("/root", [7, 8])
        made.wind, made.air_drag = (5.0, 0.0, 1.0), 0.5
        simulation = Simulation(made, device=device)
        simulation.run(6)
        return simulation.plan.method("rods").points(0)
    one, other = blown("cuda:0"), blown("cpu")
    assert np.abs(one[0] - other[0]).max() < 1e-5
    assert all(np.array_equal(a, b) for a, b in zip(one, blown("cuda:0"), strict=True))


@pytest.mark.parametrize("few", [1, 3, 1000])
def test_strands_of_which_some_take_long_go_where_they_do_on_a_cpu(few, monkeypatch):
    """Strands that fall on a ball: in one launch, the last 16 so, and by launches alone."""
    monkeypatch.setattr("wsim.physics.rods.gpu_elimination.FEW", few)

    def fallen(device: str) -> tuple[np.ndarray, np.ndarray, dict]:
        simulation = Simulation(on_ball(), device=device)
        simulation.run(8)
        method = simulation.plan.method("rods")
        return *method.points(0), method.indicators(None, None)
    one, other = fallen("cuda:0"), fallen("cpu")
    assert np.abs(one[0] - other[0]).max() < 1e-5
    assert one[2]["rod_residual"] <= 1e-6 and other[2]["rod_iterations"] > 6.0
    assert all(np.array_equal(a, b) for a, b in zip(one[:2], fallen("cuda:0")[:2], strict=True))


def test_no_strand_knows_its_place_in_the_list(monkeypatch):
    """Launches over all strands, over lists in the order of threads from the start, and from half of them on: the same bits."""
    found = []
    for half in (1000, 1, 2, 1):
        monkeypatch.setattr("wsim.physics.rods.gpu_elimination.FEW", 1000)
        monkeypatch.setattr("wsim.physics.rods.gpu_elimination.HALF", half)
        simulation = Simulation(on_ball(), device="cuda:0")
        simulation.run(8)
        found.append(simulation.plan.method("rods").points(0))
    assert all(np.array_equal(a, b) for one in found[1:] for a, b in zip(found[0], one, strict=True))


def test_hairs_that_follow_go_where_they_do_on_a_cpu():
    from tests.make.physics.rods.follow import carried, combed

    def places(device: str) -> np.ndarray:
        simulation = Simulation(combed(gravity=(0.0, -9.81, 0.0), curl=0.0)[0], device=device)
        simulation.run(6)
        return carried(simulation).positions
    one, other = places("cuda:0"), places("cpu")
    assert np.abs(one - other).max() < 1e-6
    assert np.array_equal(one, places("cuda:0"))


def test_ropes_that_are_thrown_at_each_other_go_as_on_a_cpu():
    """Held by their ends, at 10 m/s; the same bits from run to run, and never passed."""
    from tests.make.physics.rods.touch import linked, thrown

    def places(device: str) -> list[np.ndarray]:
        simulation = Simulation(thrown(1)[0], device=device)
        found = []
        for _ in range(6):
            simulation.step()
            found.append(simulation.plan.method("rods").points(0)[0])
        return found
    one, again, other = places("cuda:0"), places("cuda:0"), places("cpu")
    assert all(np.array_equal(a, b) for a, b in zip(one, again, strict=True))
    assert max(np.abs(a - b).max() for a, b in zip(one, other, strict=True)) < 1e-4
    assert all(abs(linked(x)) < 1e-6 for x in one)


def test_ropes_that_touch_go_on_where_an_earlier_run_ended_to_the_bit():
    from tests.make.physics.rods.touch import thrown

    def made() -> Simulation:
        return Simulation(thrown(2, 4.0)[0], device="cuda:0")
    whole, ends = made(), []
    whole.step()
    written = {path: whole.fields(path) for path in whole.state.paths()}
    for _ in range(3):
        whole.step()
        ends.append(whole.plan.method("rods").points(0)[0].copy())
    again = made()
    again.restart(1, written)
    for end in ends:
        again.step()
        assert np.array_equal(again.plan.method("rods").points(0)[0], end)
    assert len(written["/ropes"]["pair0"]) > 1


@pytest.mark.parametrize("on", [False, True], ids=["alone", "touching"])
def test_a_rope_and_a_box_that_collide_go_as_on_a_cpu(on):
    """The same bits from run to run; momentum of both."""
    from tests.make.physics.rods.bodies import masses, thrown

    def thrown_on(device: str):
        simulation = Simulation(thrown(0.2, on, 3.0), device=device)
        simulation.run(12)
        method, rigid = simulation.plan.method("rods"), simulation.plan.method("rigid")
        m, M = masses(method, rigid)
        return method.points(0)[0], rigid.poses(), m @ method.points(0)[1] + M @ rigid.velocities()
    one, again, other = thrown_on("cuda:0"), thrown_on("cuda:0"), thrown_on("cpu")
    assert all(np.array_equal(a, b) for a, b in zip(one, again, strict=True))
    assert max(np.abs(a - b).max() for a, b in zip(one[:2], other[:2], strict=True)) < 1e-4
    assert np.abs(one[2] - 0.2 * np.array([0.5, -3.0, 0.1])).max() < 1e-6 * 0.6


@pytest.mark.parametrize("on", [False, True], ids=["alone", "touching"])
def test_a_bar_and_a_box_on_edges_of_ropes_go_as_on_a_cpu(on):
    """A bar that is thrown between two points, and a box that falls by an edge: the same bits from run to run."""
    from tests.make.physics.rods.body_edges import EDGE, blow, landing

    def gone(device: str) -> list[np.ndarray]:
        found = []
        for made, frames in ((blow(3.0, on), 24), (landing(EDGE, on), 14)):
            simulation = Simulation(made, device=device)
            simulation.run(frames)
            found += [simulation.plan.method("rods").points(0)[0], simulation.plan.method("rigid").poses()]
        return found
    one, again, other = gone("cuda:0"), gone("cuda:0"), gone("cpu")
    assert all(np.array_equal(a, b) for a, b in zip(one, again, strict=True))
    assert max(np.abs(a - b).max() for a, b in zip(one, other, strict=True)) < 1e-4


def beside(monkeypatch, apart: bool, air: bool):
    """Strands of 14, 9 and 2 points, the first held and damped, that fall on a ball; a load on the second."""
    monkeypatch.setattr(method, "APART", apart)
    x = np.zeros((25, 3))
    x[:14, 0], x[:14, 1] = np.linspace(-0.1, 0.4, 14), 0.28
    x[14:23, 0], x[14:, 1], x[14:, 2] = np.linspace(-0.2, 0.2, 9), 0.3, 0.05
    x[23:, 0], x[23:, 2] = (0.0, 0.05), 0.1
    made, rods = scene(x, gravity=(0.0, -9.81, 0.0), young=1e6, drag=2.0 * air, skin_drag=0.1 * air, damping=0.01 * air)
    made.force("/push", "/rod", [18, 22], (0.0, 0.0, 0.02))
    rods.counts = np.array([14, 9, 2], np.int32)
    made.wind = (0.0, 0.0, 3.0)
    rods.pin("/clamp", [0, 1])
    made.collider("/ball", Sphere(0.25))
    simulation = Simulation(made, device="cuda:0")
    found = []
    for _ in range(10):
        simulation.step()
        rods = simulation.plan.method("rods")
        found.append((*rods.points(0), rods.said.numpy().copy(), rods.part.arrays["load"].numpy().max()))
    assert max(load for *_, load in found) > 0.0                                # the ball is met
    return found


@pytest.mark.parametrize("air", [False, True])
def test_each_way_ends_where_the_other_does(monkeypatch, air):
    one, other = beside(monkeypatch, False, air), beside(monkeypatch, True, air)
    for (x, v, said, _), (y, w, told, _) in zip(one, other, strict=True):
        assert np.abs(x - y).max() < 1e-9 and np.abs(v - w).max() < 1e-6
        assert np.array_equal(said[:, 0], told[:, 0])                           # iterations
        assert said[:, 2] == pytest.approx(told[:, 2], abs=1e-9)
    again = beside(monkeypatch, True, air)
    assert all(np.array_equal(a[0], b[0]) and np.array_equal(a[1], b[1]) for a, b in zip(other, again, strict=True))
