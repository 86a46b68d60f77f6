"""What `auto` takes: within the wanted error, colliders or not, and by constants that measured frames give back."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp

from tools.bench.choice.costs import fitted, ratios
from tools.bench.choice.scenes import Case
from tools.bench.nets import reference
from wsim.bench.track import largest_body_extent, rms_point_distance
from wsim.model import model as models
from wsim.physics.cloth.constraints import LOOKS, fill_constraints
from wsim.scene import Scene, Surface
from wsim.scene.fabric import Fabric
from wsim.scene.shapes import block, sheet, sphere
from wsim.scene.solid import Bulk
from wsim.simulation import cost
from wsim.simulation.choice import choose_scheme
from wsim.simulation.predicted import errors
from wsim.simulation.report import report_text
from wsim.simulation.simulation import Simulation
from wsim.usd import load

FRAMES = 11                                   # of 1/24 s: a metre's fall


@pytest.mark.parametrize("stiffness, most", [(1e5, 1.5e-5), (1e7, 1e-2)])
def test_auto_errs_by_no_more_than_the_scene_asks(stiffness, most):
    """A net of 16 x 16 that swings: of 1e5 N/m leapfrog costs what sweeps cost and errs by less; of 1e7 XPBD does, with more
    substeps than the 10 x 4 of the scene, which err by 1.8 %. The truth: leapfrog, whose own error is 1e-6 and less."""
    scene = replace(reference.spring_cloth(16, stretch=stiffness), fps=24.0)
    runs = [Simulation(replace(scene, **how), device="cpu") for how in ({"solver": "explicit"}, {}, {"solver": "xpbd"})]
    ends: list[list] = [[], [], []]
    for sim, found in zip(runs, ends, strict=True):
        sim.run(FRAMES, lambda s, found=found: found.append(s.positions()))
    ours, named = (float(rms_point_distance(np.array(found), np.array(ends[0])).max()) / largest_body_extent(scene)
                   for found in ends[1:])
    assert ours <= most and named > 1.5 * scene.error
    assert runs[1].plan.choice.solver == ("explicit" if stiffness < 1e6 else "xpbd")


@pytest.mark.parametrize("kind, size, stiffness", [("above a floor", 2, 1e6), ("on a floor", 3, 1e5), ("on a ball", 12, 50.0)])
def test_a_collider_keeps_nothing_from_explicit_steps_that_cost_less(kind, size, stiffness):
    sim = Simulation(Case(kind, size, stiffness).scene, device="cpu")
    assert sim.plan.choice.solver == "explicit" and "ms" in sim.plan.choice.why and sim.plan.method("contact")


def test_what_is_too_stiff_for_them_takes_the_substeps_that_contacts_need():
    """Backward Euler, of order 1: EULER h sqrt(g L) is no more than wanted; the scene's 10 steps would leave 14 %."""
    sim = Simulation(Case("on a floor", 3, 1e12).scene, device="cpu")
    bodies, n = errors.falling_bodies(sim.model), sim.plan.choice.substeps
    assert sim.plan.choice.solver == "implicit" and sim.plan.choice.integrator.name == "backward_euler"
    left = [errors.drift_error(bodies, 1.0 / 24.0 / k, errors.EULER) / 0.3 for k in (n, n / 1.03, 10)]
    assert left[0] <= 0.01 < left[1] and left[2] == pytest.approx(0.095, rel=0.02)


def test_newton_steps_of_a_sheet_that_bends_are_taken_where_they_cost_less_and_err_by_what_is_said(monkeypatch):
    """Of a wanted error of 0.2 %, where leapfrog costs what it does launch by launch: sweeps would take 217 substeps, leapfrog
    273. The truth: leapfrog, 1e-5 off."""
    monkeypatch.setitem(cost.COSTS["cpu"], "packed", cost.COSTS["cpu"]["element"])
    scene = replace(Case("hinges", 24, 5e3).scene, error=2e-3)
    runs = [Simulation(replace(scene, **how), device="cpu") for how in ({"solver": "explicit"}, {})]
    ends: list[list] = [[], []]
    for sim, found in zip(runs, ends, strict=True):
        sim.run(FRAMES, lambda s, found=found: found.append(s.positions()))
    chosen = runs[1].plan.choice
    assert (chosen.solver, chosen.integrator.name, chosen.iterations) == ("implicit", "bdf2", 1)
    assert "XPBD" in chosen.why and "it errs by about 0.19 % of the size" in chosen.why
    error = float(rms_point_distance(np.array(ends[1]), np.array(ends[0])).max()) / largest_body_extent(scene)
    assert chosen.error / 3.0 < error < chosen.error <= scene.error and not runs[1].warnings


def test_one_sweep_of_more_substeps_is_taken_where_it_costs_less():
    sim = Simulation(reference.spring_cloth(16, stretch=1e9, diagonal=1e9), device="cpu")
    assert (sim.plan.choice.solver, sim.plan.clock.iterations) == ("xpbd", 1)
    assert f"for {sim.plan.clock.substeps} x 1" in sim.plan.choice.why and sim.plan.clock.substeps > 10


def test_a_mesh_that_moves_costs_more_than_a_ball():
    scene = Case("on a ball", 12, 50.0).scene
    ball = cost.count_explicit_frame(Simulation(scene, device="cpu").model, 7)
    scene.colliders[0].shape = Surface(*sphere(0.3, 8))
    mesh = cost.count_explicit_frame(Simulation(scene, device="cpu").model, 7)
    assert ball["near"] == 7 * 144 and mesh["near"] == cost.MESH["cpu"] * ball["near"] and mesh["touch"] == ball["touch"] == 14


def test_a_report_says_how_many_limits_act_and_that_they_are_looks():
    """A strip, 8 edges down, that would stretch by 5 % under its weight, the most at the top, and may by 1 %; and so with
    tethers, which let no point come lower than its rest: all are taut, and no edge is near its limit."""
    said = []
    for tethers in (False, True):
        scene = Scene(solver="xpbd", substeps=40, iterations=2, air_drag=5.0)
        fabric = Fabric(stretch=20.0, shear=10.0, bend=0.0, strain_limit=0.01, density=200.0, thickness=1e-3)
        cloth = scene.cloth("/cloth", *sheet(0.5, 1.0, 4, 8), tethers=tethers, material=fabric)
        scene.pin("/pins", cloth, range(5))
        sim = Simulation(scene, device="cpu")
        sim.run(24)
        said.append(sim.report(profile=False)["limits"])
        assert f"tethers and strain limits are {LOOKS}" in sim.plan.describe() and said[
                                                                                   -1] in report_text(sim.report(profile=False))
    edges = [int(re.findall(r"(\d+) of 108 edges at their strain limit", s)[0]) for s in said]
    assert edges[0] > 10 > edges[1] and "40 of 40 tethers taut" in said[1] and "tether" not in said[0]


def test_measured_frames_give_back_their_constants():
    """Five constants, twelve frames of 5 % noise; one that no frame has stays away."""
    rng = np.random.default_rng(3)
    true = {"step": 3e-7, "spring": 1.2e-9, "rest": 4e-6, "projection": 1.4e-8, "tet": 1e-7}
    rows = []
    for _ in range(12):
        n, size = rng.uniform(10, 1000), 10.0**rng.uniform(2, 5)
        for counts in ({"step": n, "spring": n * size}, {"rest": n, "projection": n * size}, {"tet": n * size}):
            exact = sum(times * true[name] for name, times in counts.items())
            rows.append({"counts": counts, "seconds": exact * rng.uniform(0.95, 1.05)})
    found = fitted(rows, {name: 2.0 * value for name, value in true.items()} | {"near": 1.0})
    assert found.keys() == true.keys()
    assert all(found[name] == pytest.approx(true[name], rel=0.1) for name in ("spring", "projection", "tet"))
    assert np.abs(ratios(rows, found) - 1.0).max() < 0.1


def test_what_a_frame_is_said_to_take_counts_contacts_damping_and_bodies_and_no_choice_does():
    bare = Case("on a ball", 12, 50.0).scene
    model = Simulation(bare, device="cpu").model
    chosen = choose_scheme(model)
    said = cost.count_frame_of_choice(model, chosen)
    assert said["met"] == chosen.substeps * 144 and said["body"] == said["damped"] == 0
    without = {name: value for name, value in said.items() if name not in ("met", "body", "damped")}
    assert without == (cost.count_explicit_frame(model, chosen.substeps) if chosen.solver == "explicit" else
                       cost.count_sweeps_frame(model, chosen.substeps, chosen.iterations))
    assert cost.seconds_of_counts(model, said) > cost.seconds_of_counts(model, without)


@pytest.mark.parametrize("damping, times", [(0.0, 0.0), (0.01, 2.0), (0.05, 4.0)])
def test_a_damped_tet_costs_as_the_iterations_of_its_solve_go(damping, times):
    """sqrt(1 + damping time / step), of 4 Newton steps a frame of 1/75 s."""
    scene = Scene(fps=75.0, solver="implicit", integrator="backward_euler", substeps=4, iterations=1)
    scene.soft("/jelly", *block((1, 1, 1), 2), material=Bulk(damping=damping))
    model = Simulation(scene, device="cpu").model
    chosen = choose_scheme(model)
    assert (chosen.substeps, chosen.iterations) == (4, 1)
    assert cost.count_frame_of_choice(model, chosen)["damped"] == pytest.approx(4 * 40 * times)


@pytest.mark.parametrize("name, least, most", [("pyramid", 2e-3, 5e-2), ("dominoes", 5e-4, 1e-2), ("plume", 2e-2, 0.2)])
def test_rigid_bodies_and_fluids_are_said_to_take_time(name, least, most):
    """Measured: 5.7, 1.4 and 60 to 90 ms a frame on one core."""
    assert least < Simulation(f"scenes/{name}.usda", device="cpu").plan.seconds < most


def test_newtons_steps_of_a_soft_body_are_as_many_as_the_wanted_error_takes():
    """A small bar, too stiff for leapfrog: one step of sdirk3 a frame would err by 10 % of it."""
    scene = Scene(fps=24.0, substeps=2)
    points, tets = block((0.1, 0.02, 0.02), (4, 1, 1))
    scene.pin("/wall", scene.soft("/bar", points, tets, material=Bulk(1e7, damping=0.1)), [0, 1, 2, 3])
    found = Simulation(scene, device="cpu").plan
    assert found.choice.integrator.name == "sdirk3" and found.choice.error <= scene.error

    def error(steps: int) -> float:
        return errors.newton_error(found.model, errors.falling_bodies(found.model), 1.0 / 24.0 / steps, "sdirk3", 0.0) / 0.1
    assert error(found.choice.steps) <= scene.error < error(found.choice.steps - 1)


def test_a_gpu_takes_leapfrog_for_a_sheet_that_its_blocks_share():
    """Hanging cloth on an H200: XPBD 56 x 2 8.7 ms a frame and 26 mm after half a second, leapfrog 3.5 ms and 0.5 um."""
    model = models.build_model(load("scenes/hanging_cloth.usda"), 1, wp.get_device("cpu"), wp.float32)
    fill_constraints(model)
    model.device = SimpleNamespace(is_cuda=True, arch=90, sm_count=132)
    found = choose_scheme(model)
    assert (found.solver, found.integrator.name) == ("explicit", "leapfrog")
    assert found.error < 0.2 * model.scene.error
    assert cost.seconds_of_counts(model, cost.count_frame_of_choice(model, found)) < 12e-3
