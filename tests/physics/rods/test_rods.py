"""Rods against closed forms: free fall, beams, torsion, Michell's ring, friction."""

from dataclasses import replace

import numpy as np
import pytest

import wsim
from tests.physics.rods.rig import (
    AREA,
    DENSITY,
    FIRST,
    POISSON,
    SECOND,
    YOUNG,
    clamped,
    on_ball,
    period,
    scene,
    simulated,
    turning,
)
from wsim.physics.rods.objects import Rods
from wsim.scene import Plane, Scene, SceneError
from wsim.simulation.measure.indicators import make_run_report
from wsim.simulation.report import report_text


def test_a_bent_rod_falls_freely_and_keeps_its_momentum():
    rng = np.random.default_rng(0)
    x = np.cumsum(np.array([0.05, 0.0, 0.0]) + 0.01 * rng.normal(size=(12, 3)), axis=0)
    made, rods = scene(x, gravity=(0.0, -9.81, 0.0), velocities=rng.normal(size=(12, 3)))
    simulation, method = simulated(made)
    m = method.table.values["m"][:, 0]
    first = m @ method.points(0)[1]
    simulation.run(20)
    weight = m.sum() * np.array([0.0, -9.81, 0.0])
    assert m @ method.points(0)[1] == pytest.approx(first + weight * 20.0 / 60.0, abs=1e-9 * m.sum())


def error_of_bending(n: int) -> float:
    made, rods = clamped(n, fps=400.0)
    s = np.clip(rods.points[:, 0].astype(float), 0.0, None)
    mode = np.cosh(FIRST * s) - np.cos(FIRST * s) - 0.7340955138 * (np.sinh(FIRST * s) - np.sin(FIRST * s))
    rods.velocities = 5e-4 * mode[:, None] * np.array([0.0, 1.0, 0.0]) * (s > 0.0)[:, None]
    simulation, method = simulated(made)
    tip = []
    for _ in range(480):
        simulation.step()
        tip.append(method.points(0)[0][-1, 1])
    exact = FIRST**2 / (2.0 * np.pi) * np.sqrt(YOUNG * SECOND / (DENSITY * AREA))
    return 1.0 / period(np.arange(1, 481) / 400.0, np.array(tip)) / exact - 1.0


def test_the_first_bending_frequency_converges_with_order_two_to_eulers_and_bernoullis():
    errors = np.abs([error_of_bending(n) for n in (9, 17, 33)])
    assert errors[2] < 0.0015
    assert np.log2(errors[:-1] / errors[1:]) == pytest.approx([2.0, 2.0], abs=0.15)


def test_the_first_twisting_frequency_is_that_of_a_clamped_shaft():
    exact = np.sqrt(YOUNG / (2.0 * (1.0 + POISSON)) / DENSITY) / 4.0
    fps = 400.0 * exact
    made, rods = clamped(17, fps=fps)
    simulation, method = simulated(made)
    x = rods.points[:, 0].astype(float)
    w = np.zeros((18, 3))
    w[1:-1, 0] = 0.01 * np.sin(0.5 * np.pi * 0.5 * (x[1:-1] + x[2:]))
    method.part.arrays["w"].assign(w)
    angle = []
    for _ in range(450):
        simulation.step()
        d = method.part.arrays["d"].numpy()[-2]
        angle.append(np.arctan2(d @ np.cross([1.0, 0.0, 0.0], method.table.d[-2, 0]), d @ method.table.d[-2, 0]))
    assert 1.0 / period(np.arange(1, 451) / fps, np.array(angle)) == pytest.approx(exact, rel=2e-3)


def test_a_beam_sags_under_its_weight_as_it_should():
    """Small deflections: q L^4 / (8 E I), settled by damping of the steps: BDF2 with long ones."""
    made, rods = clamped(33, gravity=(0.0, -0.02, 0.0), fps=2.0)
    made.substeps = 1
    simulation, method = simulated(made)
    method.shortest = method.substeps = 1                  # as long as a frame
    simulation.run(60)
    sag = DENSITY * AREA * 0.02 / (8.0 * YOUNG * SECOND)
    assert method.points(0)[0][-1, 1] == pytest.approx(-sag, rel=3e-3)


@pytest.mark.slow
def test_a_ring_buckles_at_michells_twist():
    """Critical twist 2 pi sqrt(3) B / C (Michell 1890). The held edge is straight, which disturbs the ring: out of plane it
    goes as load / (critical - load) (Southwell 1932), from which the critical twist is told, near to it."""
    n, crit, frames, end = 48, 2.0 * np.pi * np.sqrt(3.0) * (1.0 + POISSON), 600, 0.95
    a = 2.0 * np.pi * np.arange(n + 2) / n
    x = np.stack([np.cos(a), np.sin(a), 0.0 * a], axis=1)
    straight = np.zeros_like(x)
    straight[:, 0] = np.arange(n + 2) * 2.0 * np.sin(np.pi / n)
    slow = np.sqrt(DENSITY * AREA / (YOUNG * SECOND))
    made, rods = scene(x, rest_points=straight, directors=np.tile([0.0, 0.0, 1.0], (n + 2, 1)), fps=1.0 / slow)
    made.substeps = 40
    t, times = (x[1] - x[0]) / np.linalg.norm(x[1] - x[0]), np.linspace(0.0, frames * slow, 2 * frames + 1)
    rods.pin("/still", [0, 1])
    angles = crit * np.linspace(0.0, end, len(times))
    rods.pin("/turned", [n, n + 1], motion=turning(t, 0.5 * (x[0] + x[1]), times, angles))
    simulation, method = simulated(made)
    method.shortest = 1                                    # steps as authored
    load, high = end * np.arange(1, frames + 1) / frames, []
    for _ in range(frames):
        simulation.step()
        high.append(np.abs(method.points(0)[0][:, 2]).max())
    near = load > 0.85
    slope, start = np.polyfit(load[near], load[near] / np.array(high)[near], 1)
    assert -start / slope == pytest.approx(1.0, abs=0.03)


def sliding(degrees: float, frames: int) -> float:
    """Speed [m/s] of a rod that has lain along the fall line of a slope for so many frames, friction 0.5."""
    a = np.radians(degrees)
    x = np.zeros((9, 3))
    x[:, 0], x[:, 1] = np.linspace(0.0, 0.4, 9), 0.01
    made, rods = scene(x, gravity=(9.81 * np.sin(a), -9.81 * np.cos(a), 0.0))
    made.collider("/slope", Plane("Y"), static_friction=0.5, dynamic_friction=0.5)
    simulation, method = simulated(made)
    simulation.run(frames)
    return float(method.points(0)[1][:, 0].mean())


def test_a_rod_sticks_and_slips_at_the_critical_angle():
    critical = np.degrees(np.arctan(0.5))
    assert abs(sliding(critical - 0.5, 90)) < 1e-5
    a = np.radians(critical + 2.0)
    gain = sliding(critical + 2.0, 60) - sliding(critical + 2.0, 30)
    assert gain == pytest.approx(0.5 * 9.81 * (np.sin(a) - 0.5 * np.cos(a)), rel=0.05)


def test_a_run_repeats_to_the_bit_and_goes_on_from_its_file(tmp_path):
    x = np.zeros((10, 3))
    x[:, 0] = np.arange(10) * 0.05
    made, rods = scene(x, gravity=(0.0, -9.81, 0.0), young=1e6)
    rods.pin("/clamp", [0, 1])
    path, first, second = (str(tmp_path / name) for name in ("rod.usda", "a.usdc", "b.usdc"))
    wsim.save(made, path)
    loaded = wsim.load(path)
    assert loaded.things("Rods")[0] == rods and loaded.things("Rods")[0].pins == rods.pins

    def run(output: str, frames: int, restart: str | None = None):
        from wsim.cli.run import prepare_recorded_run
        from wsim.simulation.simulation import Simulation
        scene = replace(wsim.load(path), frames=frames)
        job = prepare_recorded_run(scene, output, lambda s: Simulation(s, device="cpu"), restart=restart)
        job.frames()
        return job.simulation.plan.method("rods").points(0)

    whole = run(first, 6)
    run(second, 3)
    later = run(str(tmp_path / "c.usdc"), 6, second)
    assert all(np.array_equal(a, b) for a, b in zip(whole, later, strict=True))


def test_worlds_have_the_bits_of_one_alone():
    made, rods = clamped(9, gravity=(0.0, -9.81, 0.0), young=1e6)
    alone, one = simulated(made)
    many, three = simulated(made, worlds=3)
    alone.run(5)
    many.run(5)
    assert all(np.array_equal(one.points(0)[0], three.points(k)[0]) for k in range(3))


@pytest.mark.parametrize("more, said", [
    ({"diameters": 0.0}, "diameters"), ({"young": -1.0}, "young"), ({"poisson": 0.7}, "poisson"), ({"density": 0.0}, "density"),
    ({"masses": np.zeros(4)}, "masses"), ({"counts": [5]}, "counts"), ({"velocities": np.full((4, 3), np.nan)}, "velocities"),
    ({"points": np.zeros((4, 3))}, "one place")])
def test_bad_rods_are_refused_by_path(more, said):
    x = np.zeros((4, 3))
    x[:, 0] = np.arange(4)
    made = Scene()
    made.add(Rods("/rod", **({"points": x, "counts": [4], "diameters": 0.01} | more)))
    with pytest.raises(SceneError, match=f"/rod.*{said}"):
        simulated(made)


def test_pins_of_rods_are_hard_and_hold_points_that_there_are():
    for given, said in (({"points": [9]}, "0 to 3"), ({"points": [0], "stiffness": 5.0}, "hard")):
        made, rods = scene(np.arange(12.0).reshape(4, 3))
        rods.pin("/pin", **given)
        with pytest.raises(SceneError, match=said):
            simulated(made)


def test_what_iterations_leave_is_told_and_no_number_is_lost():
    """A strand scattered at 300 m/s, in steps of 40 ms: it is not solved, and that is said."""
    rng = np.random.default_rng(0)
    x = np.cumsum(np.array([0.02, 0.0, 0.0]) + 0.005 * rng.normal(size=(16, 3)), axis=0)
    made, rods = scene(x, fps=25.0, velocities=300.0 * rng.normal(size=(16, 3)))
    simulation, method = simulated(made)
    method.shortest = 1
    simulation.run(3)
    assert np.isfinite(method.points(0)[0]).all()
    left = method.said.numpy()[0, 1]
    assert left > 1e-6 and any("/rod: Newton's method left corrections" in w for w in simulation.warnings)


def test_strands_that_fall_on_a_ball_are_solved():
    """Points go in and out, and slip: 50 iterations of Gauss and Newton, contacts let go at once, left 1e-3 of an edge."""
    simulation, method = simulated(on_ball())
    told = []
    for _ in range(12):
        simulation.step()
        told.append(method.said.numpy().copy())
    assert np.max(told, axis=(0, 1))[1] <= 1e-6
    assert 6.0 < np.max(told, axis=(0, 1))[0] < 27.0                                     # most of a strand: 25; was 29
    assert np.max(told, axis=1)[:5, 0].max() <= 2.0                                      # that fall freely
    assert not simulation.warnings


@pytest.mark.parametrize("speed", [0.0, 1.0])
def test_a_strand_that_lands_on_a_floor_is_solved_in_four_iterations(speed):
    """One finds the floor, one its force, which is linear then, one the depth, and one tells that all is so; speed [m/s] keeps
    it slipping. By the depth's force alone the depth of what weighs so little is halved an iteration: five and six it took."""
    x = np.zeros((12, 3))
    x[:, 0], x[:, 1] = np.linspace(0.0, 0.3, 12), 0.02
    made, rods = scene(x, gravity=(0.0, -9.81, 0.0), young=4e9, diameters=1e-4, density=1300.0,
                       velocities=np.tile(np.array([speed, 0.0, 0.3 * speed]), (12, 1)))
    made.substeps = 4
    made.collider("/floor", Plane(), static_friction=0.5, dynamic_friction=0.5)
    simulation, method = simulated(made)
    said = []
    for _ in range(10):
        simulation.step()
        said.append(method.said.numpy()[0].copy())
    said = np.array(said)
    assert 3.0 <= said[:, 0].max() <= 4.0 and said[:, 1].max() <= 1e-6
    load = method.part.arrays["load"].numpy()
    weight = method.table.values["m"][:, 0] * 9.81
    assert np.allclose(load, weight, rtol=1e-6)                                          # each point bears its own


def test_a_report_counts_points_of_strands_of_all_lengths():
    """It said 1920 rods: 48 strands of the longest one's points."""
    simulation, _ = simulated(on_ball())
    found = make_run_report(simulation)
    assert found["sizes"] == {"rods": 16 * (9 + 20 + 40)}
    assert report_text(found).startswith("0 frames of 1104 rod points on cpu")


def test_what_strands_do_not_feel_is_told():
    made, rods = clamped(5)
    made.wind = (3.0, 0.0, 0.0)
    simulation, method = simulated(made)
    assert any("do not feel the wind" in w for w in simulation.warnings)


def test_a_strand_lies_on_a_mesh_whichever_way_its_faces_are_wound():
    from wsim.scene import Surface
    corners = np.array([(i, j, k) for i in (-0.3, 0.3) for j in (-0.1, 0.0) for k in (-0.3, 0.3)], np.float32)
    faces = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])
    heights = []
    for turned in (faces, faces[:, ::-1]):
        x = np.zeros((9, 3))
        x[:, 0], x[:, 1] = np.linspace(-0.1, 0.1, 9), 0.02
        made, rods = scene(x, gravity=(0.0, -9.81, 0.0))
        made.collider("/box", Surface(corners, np.full(6, 4), turned.ravel()))
        simulation, method = simulated(made)
        simulation.run(40)
        heights.append(method.points(0)[0][:, 1])
    assert np.abs(heights[0] - heights[1]).max() < 1e-7                                  # meshes are float32
    assert np.abs(heights[0] - 0.01).max() < 6e-4                                        # its radius, and what it floats


def test_a_frame_is_said_to_take_what_its_strands_do():
    """By points and substeps; strands that may touch each other are solved for together, which takes much longer."""
    def said(count: int, substeps: int = 4, **more) -> float:
        made = Scene(fps=60.0, substeps=substeps)
        x = np.zeros((count, 10, 3))
        x[..., 0], x[..., 2] = np.linspace(0.0, 0.9, 10), np.arange(count)[:, None]
        made.add(Rods("/rods", x.reshape(-1, 3), [10] * count, 0.01, 1e6, **more))
        return simulated(made)[0].plan.seconds
    assert said(20) == pytest.approx(2.0 * said(10), rel=0.05) and said(20, 8) == pytest.approx(2.0 * said(20), rel=0.05)
    assert said(20, self_collision=True) > 2.0 * said(20)
