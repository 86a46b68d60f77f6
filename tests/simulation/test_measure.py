"""What a report says against what can be known without it: energies, strains, its keys, and that asking changes nothing."""

import json

import numpy as np
import pytest

from wsim.physics.rigid.objects import Body
from wsim.scene import Box, Collider, Motion, Plane, Scene, shapes
from wsim.scene.fabric import Fabric
from wsim.simulation.measure.columns import text_columns
from wsim.simulation.measure.indicators import count_constraint_rows, edge_strain
from wsim.simulation.simulation import Simulation

DOUBLE = {"device": "cpu", "precision": "float64"}
KEYS = {"device", "precision", "frames", "ms_per_frame", "seconds", "error", "stages", "skipped", "warnings"}   # promised
ERRORS = {"max_strain", "rms_strain", "residual", "energy", "kinetic_energy", "gravity_energy", "elastic_energy"}


def net(lengths=None, **more) -> Scene:
    """Three points on a line, 1 m and 2 m apart, 10 and 20 N/m, masses 1, 2, 4 kg, at height 3 m."""
    scene = Scene(solver="xpbd", fps=60.0, substeps=4, iterations=2, **more)
    scene.net("/net", [[0, 3, 0], [1, 3, 0], [3, 3, 0]], [[0, 1], [1, 2]], [10.0, 20.0], [1.0, 2.0, 4.0], lengths=lengths)
    return scene


def hanging(**more) -> Scene:
    scene = Scene(solver="xpbd", fps=60.0, substeps=8, iterations=8, **more)
    cloth = scene.cloth("/cloth", *shapes.sheet(1.0, 1.0, 6, 6, horizontal=True), material=Fabric(bend=1e-3))
    scene.pin("/pin", cloth, range(7))
    return scene


@pytest.fixture(scope="module")
def ran():
    sim = Simulation(hanging(), device="cpu")
    sim.run(4)
    return sim


def test_energies_of_a_net_are_the_sums_of_the_textbook():
    """1/2 m v^2, m g y from the origin of the world, 1/2 k (l - L)^2."""
    sim = Simulation(net(lengths=[0.8, 2.5]), **DOUBLE)
    sim.set("/net", "velocities", np.array([[1.0, 0, 0], [0, -2.0, 0], [0, 0, 3.0]]))
    e = sim.indicators()
    assert e["kinetic_energy"] == pytest.approx(0.5 * (1 * 1 + 2 * 4 + 4 * 9), rel=1e-12)
    assert e["gravity_energy"] == pytest.approx(9.81 * 7.0 * 3.0, rel=1e-12)
    assert e["elastic_energy"] == pytest.approx(0.5 * 10 * 0.2**2 + 0.5 * 20 * 0.5**2, rel=1e-6)   # lengths are float32
    assert e["energy"] == e["kinetic_energy"] + e["gravity_energy"] + e["elastic_energy"]


def test_strain_is_signed_and_relative_to_the_rest_length():
    sim = Simulation(net(lengths=[0.8, 2.5]), **DOUBLE)
    body = sim.model.bodies[0]
    np.testing.assert_allclose(edge_strain(body, body.places), [0.25, -0.2], rtol=1e-6)
    e = sim.indicators()
    assert e["max_strain"] == pytest.approx(0.25, rel=1e-6)
    assert e["rms_strain"] == pytest.approx(np.sqrt((0.25**2 + 0.2**2) / 2.0), rel=1e-6)


def test_a_stretched_cloth_has_the_strain_of_its_edges():
    """Along x by 3 %: edges along x 0.03, along z 0, diagonals of squares sqrt((1.03^2 + 1) / 2) - 1."""
    sim = Simulation(hanging(), **DOUBLE)
    sim.set("/cloth", "positions", sim.positions() * (1.03, 1.0, 1.0))
    strain, diagonal = edge_strain(sim.model.bodies[0], sim.state.x.numpy() + sim.state.e.numpy()), \
        np.sqrt((1.03**2 + 1) / 2) - 1
    assert sim.indicators()["max_strain"] == pytest.approx(0.03, rel=1e-5)
    near = np.array([0.0, diagonal, 0.03])
    assert np.abs(strain[:, None] - near).min(axis=1).max() < 1e-6
    assert [int((np.abs(strain - n) < 1e-6).sum()) for n in near] == [42, 36, 42]


def test_pins_have_no_kinetic_energy():
    scene = net()
    scene.pin("/pin", scene.springs[0], [2])
    sim = Simulation(scene, **DOUBLE)
    sim.set("/net", "velocities", np.ones((3, 3)))
    assert sim.indicators()["kinetic_energy"] == pytest.approx(0.5 * (1 + 2) * 3.0, rel=1e-12)


def test_gravity_of_a_cloth_counts_from_the_origin_of_the_world():
    scene = hanging()
    scene.cloths[0].motion = type(scene.cloths[0].motion).at_place((500.0, 100.0, 0.0))
    sim = Simulation(scene, **DOUBLE)
    assert sim.indicators()["gravity_energy"] == pytest.approx(0.2 * 9.81 * 100.0, rel=1e-6)      # 1 m^2 of 0.2 kg/m^2


def test_worlds_add_up():
    one, three = Simulation(net(), **DOUBLE).indicators(), Simulation(net(), worlds=3, **DOUBLE).indicators()
    assert three["energy"] == pytest.approx(3.0 * one["energy"], rel=1e-12)
    assert three["rms_strain"] == pytest.approx(one["rms_strain"], rel=1e-12)


def test_the_residual_falls_with_the_sweeps():
    found = []
    for iterations in (2, 8, 32):
        scene = hanging()
        scene.iterations = iterations
        sim = Simulation(scene, **DOUBLE)
        sim.run(3)
        found.append(sim.indicators()["residual"])
    assert found[0] > found[1] > found[2] > 0.0


def test_energy_of_a_swinging_cloth_never_grows():
    """Backward Euler takes energy away; 1 % of what turned over is left for what sweeps leave."""
    sim, energies = Simulation(hanging(), **DOUBLE), []
    start = sim.indicators()["energy"]
    sim.run(20, lambda s: energies.append(s.indicators()))
    turned = max(e["kinetic_energy"] for e in energies)
    assert turned > 0.1 and np.all(np.diff([start, *(e["energy"] for e in energies)]) < 0.01 * turned)


def test_a_report_has_what_was_promised_and_is_json(ran):
    report = ran.report()
    assert report.keys() >= KEYS and report["error"].keys() >= ERRORS
    assert report["seconds"].keys() >= {"build", "compile", "capture", "first_frame"}
    assert json.loads(json.dumps(report)) == report
    assert report["frames"] == 4 and report["device"] == "cpu" and report["precision"] == "float32"
    assert all({"name", "launches", "bytes", "ms"} <= s.keys() for s in report["stages"])
    assert all(s.keys() == {"stage", "why"} and s["why"] for s in report["skipped"])


def test_counts_and_rates_of_a_report_belong_together(ran):
    report = ran.report(profile=False)
    triangles, inner = 72, 96                              # 6 x 6 cells: 3 * 36 + 12 edges, 24 of them on the border
    assert (report["points"], report["constraints"]) == (49, triangles + inner)
    rate = 8 * 1e3 / report["ms_per_frame"]
    assert report["points_per_second"] == pytest.approx(49 * rate, rel=1e-12)
    assert report["constraints_per_second"] == pytest.approx((triangles + inner) * 8 * rate, rel=1e-12)
    assert report["ms_per_frame"] == pytest.approx(np.mean(ran.milliseconds[1:]), rel=1e-12)
    assert all(s["ms"] is None for s in report["stages"])


@pytest.mark.parametrize("solver, integrator, times", [("explicit", "leapfrog", 1), ("explicit", "rk4", 4),
                                                       ("implicit", "backward_euler", 2), ("xpbd", "backward_euler", 2)])
def test_the_rows_of_every_solver_are_counted(solver, integrator, times):
    """Two springs; evaluations of the forces, or iterations, a substep."""
    scene = net()
    scene.solver, scene.integrator = solver, integrator
    sim = Simulation(scene, **DOUBLE)
    assert count_constraint_rows(sim.plan) == (2, 2 * times)


def test_every_stage_of_a_substep_is_timed(ran):
    timed = {s["name"]: s["ms"] for s in ran.report()["stages"]}
    assert {name for name, ms in timed.items() if ms is None} <= {"guard", "watch", "energy balance"}   # once a frame
    assert all(ms > 0.0 for ms in timed.values() if ms is not None)


@pytest.mark.parametrize("integrator", ["backward_euler", "bdf2"])
def test_asking_changes_nothing(integrator):
    asked, left = (Simulation(hanging(integrator=integrator), device="cpu") for _ in range(2))
    for _ in range(4):
        asked.step()
        asked.report()
        left.step()
    assert np.array_equal(asked.positions(), left.positions()) and np.array_equal(asked.velocities(), left.velocities())


def test_before_the_first_frame_a_report_says_so():
    report = Simulation(net(), **DOUBLE).report()
    assert report["frames"] == 0 and report["ms_per_frame"] == 0.0 and report["points_per_second"] == 0.0
    assert json.loads(json.dumps(report)) == report


def test_cells_of_a_table_stand_below_each_other():
    rows = [("a", "1", "x"), ("long", "22", "")]
    assert text_columns(rows, "<><") == ["a      1  x", "long  22   "]
    assert text_columns(rows, "<><", (6, None, 0), gap="|") == ["a     | 1|x", "long  |22|"]


def test_methods_do_not_write_over_indicators_of_each_other():
    """Points on a floor, of surfaces on each other, and a body: each name is of one thing."""
    scene = Scene(fps=60.0, substeps=8, iterations=4, solver="xpbd")
    for k in range(2):
        points, counts, indices = shapes.sheet(0.2, 0.2, 6, 6, horizontal=True)
        scene.cloth(f"/sheet{k}", np.array(points) + (0.0, 1e-3 + 2e-3 * k, 0.0), counts, indices, self_collision=True,
                    material=Fabric(thickness=2e-3))
    scene.collider("/floor", Plane("Y"))
    scene.add(Body("/box", [Collider("/box/shape", Box((0.1, 0.1, 0.1)))], Motion.at_place((1.0, 0.1, 0.0))))
    sim = Simulation(scene, **DOUBLE)
    sim.run(3)
    x, v = np.asarray(sim.state.x.numpy(), np.float64), np.asarray(sim.state.v.numpy(), np.float64)
    each = [list(method.indicators(x, v)) for method in sim.plan.methods]
    names, told = [name for some in each for name in some], sim.indicators()
    assert len(names) == len(set(names)) and {"contacts", "surface_contacts", "rigid_overlap"} <= set(names)
    assert told["contacts"] == 49 and told["surface_contacts"] > 20


def test_counts_of_a_warning_are_told_with_all_their_digits():
    """1234 pairs were 1.23e+03 of them; what is no count keeps three digits."""
    from types import SimpleNamespace

    from wsim.simulation.measure.exceeded import _add_exceeded_note
    sim = SimpleNamespace(notes={}, warnings=[], frame=1)
    for frame, value in ((1, 12.0), (2, 1234.0), (3, 7.0)):
        sim.frame = frame
        _add_exceeded_note(sim, ("pairs",), value, "{worst} pairs")
    _add_exceeded_note(sim, ("strain",), 2.38461, "{worst} times as long")
    assert sim.warnings == ["frame 1 and 2 later, worst in frame 2: 1234 pairs", "frame 3: 2.38 times as long"]


def test_reports_name_one_of_many_reasons_why_the_balance_is_open():
    """Of each number of frames; nine drives of a robot made one line of 500 characters."""
    from wsim.simulation.report import _balance_lines
    opens = {"/J1 varies": 144, "/J2 varies": 144, "/tie": 3, "/J3 varies": 144}
    said = {"frames": 144, "rise": 0.01, "strained": False}
    assert _balance_lines({"balance": said | {"left_open": opens}}) == [
        "balance   of 144 frames: 144 left open (/J1 varies; and 2 more), 3 left open (/tie)"]
    assert _balance_lines({"balance": said | {"left_open": {"/tie": 3}}}) == [
        "balance   of 144 frames: energy rose by at most 1 % of the largest kinetic energy; 3 left open (/tie)"]
