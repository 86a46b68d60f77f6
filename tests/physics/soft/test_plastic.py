"""Plastic flow: the law of one tet, a bar that is pulled and let go, what is elastic stays so, restarts and repeats."""

import numpy as np
import pytest

from tests.make.physics.soft.soft_bar import bar, ran
from tests.make.physics.soft.tet_box import turn
from wsim import Bulk, Scene, Simulation
from wsim.scene import shapes
from wsim.scene.curve import Motion

E, RHO, Y = 1e5, 1e3, 0.02


def deviation(s: np.ndarray) -> float:
    """|dev (s - 1)|"""
    return float(np.linalg.norm(s - s.mean()))


def returned(s: np.ndarray) -> np.ndarray:
    """Elastic stretches that are left of s: the same product and deviatoric directions of their logarithms, by bisection."""
    low, high, b = 0.0, 1.0, np.log(s) - np.log(s).mean()
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if deviation(np.cbrt(np.prod(s)) * np.exp(middle * b)) < Y else (low, middle)
    return np.cbrt(np.prod(s)) * np.exp(low * b)


def block(yields: float = Y) -> Scene:
    scene = Scene(solver="implicit", integrator="backward_euler", substeps=1, iterations=2)
    soft = scene.soft("/block", *shapes.block((0.2, 0.2, 0.2), (1, 1, 1)), material=Bulk(E, 0.3, RHO, yield_strain=yields))
    scene.pin("/wall", soft, [0])                                            # as the bars below: one module for both
    return scene


def flowed(sim: Simulation, F: np.ndarray) -> np.ndarray:
    """F_p of each tet after the block is brought to F."""
    sim.set("/block", "positions", sim.scene.softs[0].points.astype(np.float64) @ F.T)
    table = sim.plan.solids[0]
    table.forget()
    table.plastic.flow(sim.state.x, sim.state.e)
    return sim.fields("/block")["plastic_corotational"]


@pytest.mark.parametrize("s", [(1.1, 1.0, 1.0), (0.9, 1.05, 1.2), (1.5, 0.8, 1.0)])
def test_a_tet_flows_back_to_its_yield_and_keeps_its_volume(s):
    """In a turned pose, along turned axes. Then the strain left is Y, what has flowed is no strain, and nothing flows again."""
    s, Q, R = np.array(s), turn(), turn().T
    sim = Simulation(block(), device="cpu", precision="float64")
    Fp = flowed(sim, R @ Q @ np.diag(s) @ Q.T)
    np.testing.assert_allclose(Fp, np.broadcast_to(Q @ np.diag(s / returned(s)) @ Q.T, Fp.shape), atol=1e-9)
    np.testing.assert_allclose(np.linalg.det(Fp), 1.0, rtol=1e-12)
    stress = sim.stress("/block")
    np.testing.assert_allclose(stress.strain, np.linalg.norm(returned(s) - 1.0), rtol=1e-7)
    again = flowed(sim, R @ Q @ np.diag(s) @ Q.T)
    np.testing.assert_allclose(again, Fp, atol=1e-9)


@pytest.mark.parametrize("F", [np.diag([1.0, 1.0, 0.01]), np.diag([1.3, 1.0, -1.0]), 3.0 * np.eye(3), np.diag([1e3, 1.0, 1.0])])
def test_what_is_flat_inside_out_swollen_or_a_needle_does_not_flow(F):
    Fp = flowed(Simulation(block(), device="cpu"), F)
    assert np.array_equal(Fp, np.broadcast_to(np.eye(3), Fp.shape))


def pulled(solver: str, yields: float, way: list[float], frames: int) -> Simulation:
    """A bar of nu = 0, 1 m long, one end held, the other brought through these elongations [m], so many frames each."""
    more = {"implicit": {"integrator": "backward_euler", "substeps": 1, "iterations": 3},
            "explicit": {"integrator": "leapfrog", "substeps": 60, "iterations": 1}}[solver]
    scene = bar((10, 1, 1), (1.0, 0.1, 0.1), bulk=Bulk(E, 0.0, RHO, yield_strain=yields), solver=solver, fps=30.0,
                gravity=(0.0, 0.0, 0.0), air_drag=20.0, **more)
    poses = np.tile(np.eye(4), (len(way), 1, 1))
    poses[:, 0, 3] = way
    scene.pin("/grip", "/bar", np.flatnonzero(scene.softs[0].points[:, 0] > 0.49999),
              motion=Motion(np.arange(len(way)) * frames / 30.0, poses))
    return ran(scene, (len(way) - 1) * frames)


@pytest.mark.parametrize("solver", ["implicit", "explicit"])
def test_a_bar_that_was_pulled_is_at_rest_where_its_yield_is_subtracted(solver):
    """The strain at yield is sqrt(3/2) Y of 5 %: let back by as much, hardly any stress is left. Not none: nothing hardens, so
    that flow gathers where the bar gets thinner, by up to 8 %, and there it bears less. Volume is that of the start."""
    least = np.sqrt(1.5) * Y
    sim = pulled(solver, Y, [0.0, 0.05, 0.05 - least], 60)
    middle = np.abs(sim.scene.softs[0].points[sim.scene.softs[0].tets].mean(axis=1)[:, 0]) < 0.3
    stress = sim.stress("/bar")
    volume = np.linalg.det(np.diff(sim.positions()[sim.scene.softs[0].tets], axis=1))
    rest = np.linalg.det(np.diff(sim.scene.softs[0].points[sim.scene.softs[0].tets].astype(np.float64), axis=1))
    assert np.median(stress.von_mises[middle]) < 0.1 * E * least
    assert sim.indicators()["plastic_strain"] > 0.9 * (0.05 - least)
    np.testing.assert_allclose((volume / rest)[middle], 1.0, atol=0.01)


def test_below_its_yield_a_bar_is_elastic_to_the_bit():
    least = np.sqrt(1.5) * Y
    way = [0.0, 0.8 * least, 0.2 * least]
    plastic, elastic = pulled("implicit", Y, way, 5), pulled("implicit", 1e9, way, 5)
    assert np.array_equal(plastic.positions(), elastic.positions())
    assert plastic.indicators()["plastic_strain"] == 0.0


def test_a_bar_that_only_turns_does_not_flow():
    """Between the stages of sdirk3 it is longer than it ever is."""
    scene = bar((2, 1, 1), (0.2, 0.1, 0.1), held=False, bulk=Bulk(1e6, 0.3, RHO, yield_strain=Y), integrator="sdirk3",
                substeps=1, iterations=4, gravity=(0.0, 0.0, 0.0))
    soft = scene.softs[0]
    soft.velocities = np.cross([0.0, 0.0, 15.0], soft.points - soft.points.mean(axis=0)).astype(np.float32)
    found = ran(scene, 10).indicators()
    assert found["plastic_strain"] == 0.0 < found["solid_strain"]


def falling(solver: str, integrator: str) -> Scene:
    """A bar that bends under its weight beyond its yield, of two materials."""
    scene = bar(solver=solver, integrator=integrator, substeps=2 if solver == "implicit" else 30, bulk=Bulk(2e4, 0.3, RHO,
                yield_strain=Y), **({} if solver == "implicit" else {"iterations": 1}))
    soft = scene.softs[0]
    soft.which = (np.arange(len(soft.tets)) % 3 == 0).astype(np.int32)
    soft.others = [Bulk(2e4, 0.3, RHO)]
    return scene


@pytest.mark.parametrize("solver, integrator", [("implicit", "bdf2"), ("explicit", "leapfrog")])
def test_a_restart_and_a_repeated_frame_go_on_bit_for_bit(solver, integrator):
    scene = falling(solver, integrator)
    whole = ran(scene, 8)
    assert whole.indicators()["plastic_strain"] > Y
    first = ran(scene, 5)
    second = Simulation(scene, device="cpu")
    second.restart(5, {"/bar": first.fields("/bar")})
    second.run(3)
    assert np.array_equal(second.positions(), whole.positions())
    first.plan.before_frame(first.time)
    first.plan.frame()                                    # a frame that does not hold
    first.state.restore_snapshot()
    first.run(3)
    assert np.array_equal(first.positions(), whole.positions())
    first.reset()
    first.run(8)
    assert np.array_equal(first.positions(), whole.positions())


def test_a_restart_from_a_result_keeps_what_has_flowed(tmp_path):
    from tests.make.cli.cli import run
    from wsim.usd import save
    scene = falling("implicit", "backward_euler")
    scene.frames = 6
    stage, half, rest, all_ = (str(tmp_path / f"{name}.usda") for name in ("scene", "half", "rest", "all"))
    save(scene, stage)
    assert run(stage, half, "--frames", "3", "--quiet") == 0 and run(stage, rest, "--restart", half, "--quiet") == 0
    assert run(stage, all_, "--quiet") == 0
    a, b = (samples_of(path) for path in (rest, all_))
    assert list(a) == list(b) and all(np.array_equal(a[code], b[code]) for code in b)


def samples_of(path) -> dict:
    from pxr import Usd, UsdGeom
    stage = Usd.Stage.Open(path)
    attribute = UsdGeom.PointBased(stage.GetPrimAtPath("/bar")).GetPointsAttr()
    return {code: np.array(attribute.Get(code)) for code in attribute.GetTimeSamples()}
