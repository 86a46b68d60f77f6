"""Closed strands: rings against closed forms, and against themselves, turned by some points: none of them is the seam."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import wsim
from tests.make.physics.rods.bodies import box
from tests.physics.rods.rig import AREA, DENSITY, POISSON, RADIUS, SECOND, YOUNG, period, simulated, turning
from wsim.physics.rods import coupled_newton
from wsim.physics.rods.objects import Rods
from wsim.scene import Motion, Scene, SceneError, solids
from wsim.scene.curve import then

R = 0.5                                            # of a ring [m]
SHEAR = 1.0 / (1.0 + POISSON)                      # G J / (E I)


def ring(n: int, first: int = 0, radius: float = R) -> np.ndarray:
    """Points of a ring across z, the first of them `first` steps on."""
    a = 2.0 * np.pi * (np.arange(n) + first) / n
    return np.stack([radius * np.cos(a), radius * np.sin(a), np.zeros(n)], axis=1)


def rubber(x: np.ndarray, fps: float = 120.0, gravity=(0.0, 0.0, 0.0), **more) -> tuple[Scene, Rods]:
    made = Scene(gravity=gravity, fps=fps, substeps=4)
    given = {"diameters": 2.0 * RADIUS, "young": YOUNG, "poisson": POISSON, "density": DENSITY, "closed": True} | more
    return made, made.add(Rods("/ring", x, [len(x)], **given))


def error_of_mode(n: int, flat: bool) -> float:
    """Error of the frequency of a ring of n points with two waves around it, in its plane or across it.

    Love 1927, section 293: omega^2 = k^2 (k^2 - 1)^2 / (k^2 + 1) E I / (m R^4) in the plane, and with k^2 + E I / (G J) below
    across it; k = 2, m the mass of a length."""
    x = ring(n)
    a = 2.0 * np.pi * np.arange(n) / n
    if flat:
        around = np.stack([x[:, 1], -x[:, 0], 0.0 * a], axis=1)
        v = (np.cos(2.0 * a)[:, None] * x + 0.5 * np.sin(2.0 * a)[:, None] * around) / R
    else:
        v = np.cos(2.0 * a)[:, None] * np.array([0.0, 0.0, 1.0])
    exact = np.sqrt(YOUNG * SECOND / (DENSITY * AREA * R**4) * 36.0 / (5.0 if flat else 4.0 + 1.0 / SHEAR)) / (2.0 * np.pi)
    made, _ = rubber(x, fps=100.0 * exact, velocities=1e-3 * v)
    simulation, method = simulated(made)
    seen = []
    for _ in range(120):
        simulation.step()
        seen.append(np.linalg.norm(method.points(0)[0][0, :2]) - R if flat else method.points(0)[0][0, 2])
    return 1.0 / period(np.arange(1, 121) / (100.0 * exact), np.array(seen)) / exact - 1.0


@pytest.mark.parametrize("flat", [True, False])
def test_frequencies_of_a_ring_converge_with_order_two_to_loves(flat):
    errors = np.abs([error_of_mode(n, flat) for n in (12, 24, 48)])
    assert errors[2] < 0.01
    assert np.log2(errors[0] / errors[2]) / 2.0 == pytest.approx(2.0, abs=0.4)


@pytest.mark.parametrize("first", [0, 1, 5])
def test_a_ring_under_two_loads_gives_way_as_it_should_wherever_its_first_point_is(first):
    """(pi / 4 - 2 / pi) P R^3 / (E I) (Timoshenko 1936): long steps of damped rubber, loads of small deflections."""
    n, P = 48, 0.02
    x = ring(n, first)
    made, rods = rubber(x, fps=1.0, damping=0.5)
    ends = [(n - first) % n, (n - first + n // 2) % n]
    for name, point, sign in zip("ab", ends, (-1.0, 1.0), strict=True):
        made.force(f"/load_{name}", rods, [point], (sign * P, 0.0, 0.0))
    simulation, method = simulated(made)
    simulation.run(40)
    y = method.points(0)[0]
    given = 2.0 * R - abs(y[ends[0], 0] - y[ends[1], 0])
    exact = (np.pi / 4.0 - 2.0 / np.pi) * P * R**3 / (YOUNG * SECOND)
    assert given == pytest.approx(exact, rel=0.01)
    radii = np.linalg.norm(y, axis=1)
    assert np.roll(radii, first) == pytest.approx(np.roll(radii, first)[-np.arange(n)], abs=1e-9)       # upper and lower half
    assert np.abs(y[:, 2]).max() < 1e-12


def test_a_closed_curve_of_any_shape_is_at_rest_as_it_is():
    """A trefoil, along which a frame that is carried on does not come back to itself: no bend of it has that twist."""
    a = 2.0 * np.pi * np.arange(60) / 60
    x = 0.1 * np.stack([np.sin(a) + 2.0 * np.sin(2.0 * a), np.cos(a) - 2.0 * np.cos(2.0 * a), -np.sin(3.0 * a)], axis=1)
    made, _ = rubber(x)
    simulation, method = simulated(made)
    simulation.run(10)
    assert np.abs(method.points(0)[0] - x).max() < 1e-10
    assert np.abs(method.table.rest[1:61, 0, 2]).max() < 0.5


def test_a_spinning_ring_keeps_its_momentum_and_its_shape():
    n, w = 24, 3.0
    x = ring(n)
    v = np.cross([0.0, 0.0, w], x) + [0.3, 0.0, -0.2]
    made, _ = rubber(x, velocities=v)
    simulation, method = simulated(made)
    m = method.table.masses.reshape(method.table.longest, 1)[:n, 0]
    assert m.sum() == pytest.approx(DENSITY * AREA * np.linalg.norm(x - np.roll(x, 1, axis=0), axis=1).sum(), rel=1e-12)
    simulation.run(60)
    y, u = method.points(0)
    assert m @ u == pytest.approx(m @ v, abs=1e-9 * m.sum())
    radii = np.linalg.norm(y - y.mean(axis=0), axis=1)
    assert np.ptp(radii) < 1e-9 and radii.mean() == pytest.approx(R, rel=1e-3)
    spin = m @ np.cross(y, u)
    assert spin[2] == pytest.approx(m.sum() * R**2 * w + (m.sum() * np.cross(y.mean(axis=0), m @ u / m.sum()))[2], rel=2e-3)


def hung(first: int) -> tuple[np.ndarray, np.ndarray]:
    """A ring that hangs from the point at its top, and what that bears."""
    n = 24
    x = ring(n, first)
    made, rods = rubber(x, fps=10.0, gravity=(0.0, -9.81, 0.0), damping=0.2)
    top = (n // 4 - first) % n
    rods.pin("/pin", [top])
    simulation, method = simulated(made)
    simulation.run(60)
    return np.roll(method.points(0)[0], first, axis=0), simulation.reactions("/pin")[0]


def test_a_ring_hangs_alike_from_each_of_its_points():
    (x, f), others = hung(0), [hung(6), hung(5)]       # 6: from its first point, 5: from its second
    weight = 9.81 * DENSITY * AREA * np.linalg.norm(ring(24)[0] - ring(24)[1]) * 24
    for y, g in [(x, f), *others]:
        assert y == pytest.approx(x, abs=1e-8)
        assert g == pytest.approx([0.0, weight, 0.0], abs=1e-3 * weight)


def placed(x: float, y: float) -> Motion:
    frame = np.eye(4)
    frame[:2, 3] = x, y
    return Motion.still(frame)


def weighed(first: int) -> np.ndarray:
    """A ring on a peg that bears a body at the lowest of its points: where they are, from the lowest on, and the body."""
    n = 36
    made, rods = rubber(ring(n, first, 0.2), fps=60.0, gravity=(0.0, -9.81, 0.0), damping=0.02, stretch=2e3, bend=1e-3,
                        twist=1e-3, static_friction=0.0, dynamic_friction=0.0)
    made.collider("/peg", solids.Capsule(0.03, 0.3), motion=placed(0.0, 0.159), static_friction=0.0, dynamic_friction=0.0)
    box(made, "/weight", (0.02, 0.02, 0.02), (0.0, -0.22, 0.0), 0.5, mass=2.0)
    made.tie("/tie", rods, [(27 - first) % n], "/weight")
    simulation, method = simulated(made)
    simulation.run(90)
    return np.concatenate([np.roll(method.points(0)[0], first, axis=0), simulation.poses("/weight")["/weight"][None, :3, 3]])


def test_a_band_bears_a_body_alike_by_each_of_its_points():
    x = weighed(0)
    for first in (27, 26, 9):                          # tied by its first, by its second; its first on the peg
        assert weighed(first) == pytest.approx(x, abs=2e-6)      # copies have 1/1000 of the mass that contacts go by


@pytest.mark.slow
def test_a_block_of_threads_finds_the_same_of_a_band_that_bears_a_body(monkeypatch):
    found = []
    for team in (False, True):
        monkeypatch.setattr(coupled_newton, "TEAM", team)
        found.append(weighed(26))
    assert np.abs(found[1] - found[0]).max() < 1e-9


def belt(n: int, r: float, far: float) -> np.ndarray:
    """Points around two circles of radius r, 2 far apart."""
    a, b = np.pi * r, 2.0 * far
    x = np.zeros((n, 3))
    for k, s in enumerate(np.linspace(0.0, 2.0 * (a + b), n, endpoint=False).tolist()):
        half, along = divmod(s, a + b)
        turn = max(along - b, 0.0) / r
        x[k, :2] = (-1.0)**half * np.array([far - min(along, b) - r * np.sin(turn), r * np.cos(turn)])
    return x


def test_a_belt_turns_a_pulley_as_fast_as_another_turns_it():
    """Friction carries both: at the same radius alike, in the same sense."""
    r, far, thick, w = 0.05, 0.12, 0.002, 6.0
    x = belt(72, r + thick, far)
    made, _ = rubber(x, fps=60.0, diameters=2.0 * thick, rest_points=0.998 * x, damping=0.002, bend=1e-4, twist=1e-4,
                     young=1e7, static_friction=0.8, dynamic_friction=0.8)
    times = np.linspace(0.0, 2.0, 121)
    driven = then(turning(np.array([0.0, 0.0, -1.0]), np.array([-far, 0.0, 0.0]), times, w * times), placed(-far, 0.0).at(0.0))
    made.collider("/driver", solids.Capsule(r, 0.2), static_friction=0.8, dynamic_friction=0.8, motion=driven)
    wheel = made.body("/wheel", solids.Capsule(r, 0.2), at=(far, 0.0, 0.0), mass=0.2, static_friction=0.8, dynamic_friction=0.8)
    made.joint("revolute", "/axle", None, wheel, at=(far, 0.0, 0.0), axis=(0.0, 0.0, 1.0))
    simulation, method = simulated(made)
    simulation.run(30)
    start = simulation.poses("/wheel")["/wheel"][:2, 0]
    simulation.run(6)
    end = simulation.poses("/wheel")["/wheel"][:2, 0]
    assert np.arcsin(start[0] * end[1] - start[1] * end[0]) * 10.0 == pytest.approx(w, rel=0.02)
    assert np.linalg.norm(method.points(0)[1], axis=1) == pytest.approx(w * (r + thick), rel=0.05)


def test_closed_rods_are_periodic_curves_and_go_on_from_their_file(tmp_path):
    made, rods = rubber(ring(20), gravity=(0.0, -9.81, 0.0), masses=np.linspace(0.01, 0.02, 20))
    rods.pin("/clamp", [19, 0])
    path, first, second = (str(tmp_path / name) for name in ("ring.usda", "a.usdc", "b.usdc"))
    wsim.save(made, path)
    assert 'token wrap = "periodic"' in Path(path).read_text()
    loaded = wsim.load(path)
    assert loaded.things("Rods")[0] == rods and loaded.things("Rods")[0].closed

    def run(output: str, frames: int, restart: str | None = None):
        from wsim.cli.run import prepare_recorded_run
        from wsim.simulation.simulation import Simulation
        job = prepare_recorded_run(replace(wsim.load(path), frames=frames), output, lambda s: Simulation(s, device="cpu"),
                                   restart=restart)
        job.frames()
        return job.simulation.plan.method("rods").points(0)

    whole = run(first, 6)
    run(second, 3)
    later = run(str(tmp_path / "c.usdc"), 6, second)
    assert all(np.array_equal(a, b) for a, b in zip(whole, later, strict=True))


@pytest.mark.parametrize("points, more, said", [
    (ring(20)[:2], {}, "a closed strand has 2 points; allowed: 3 or more"),
    (np.concatenate([ring(20), ring(20)[:1]]), {}, "closed strands name their first point once"),
])
def test_rings_that_cannot_be_are_refused_in_a_line(points, more, said):
    made, _ = rubber(points, **more)
    with pytest.raises(SceneError, match="/ring.*" + re.escape(said)):
        simulated(made)


def test_a_tight_band_that_sinks_into_a_peg_is_told_and_more_substeps_mend_it():
    depths = []
    for substeps in (5, 80):
        scene = Scene(frames=3, substeps=substeps, gravity=(0, 0, 0))
        points = ring(24, radius=0.0225)
        scene.rods("/band", points, counts=[24], diameters=0.004, young=1e6, closed=True, rest_points=0.7 * points)
        scene.collider("/peg", wsim.Cylinder(0.02, 0.05))
        simulation = wsim.Simulation(scene, device="cpu")
        simulation.run(2)
        depths.append(0.022 - np.linalg.norm(simulation.positions("/band")[:, :2], axis=1).min())
        told = [w for w in simulation.report()["warnings"] if "deep in colliders" in str(w)]
        assert len(told) == (depths[-1] > 0.004), (depths, told)
    assert depths[0] > 0.004 and depths[1] < 4e-4, depths


def test_a_tight_band_that_nobody_gave_substeps_gets_enough():
    """F h^2 / (30 m) of T = 5.4 N round 24 corners asks for 60 substeps a frame; without tension the band takes 10."""
    found = {}
    for part in (0.7, 1.0):
        scene = Scene(frames=3, gravity=(0, 0, 0))
        points = ring(24, radius=0.0225)
        scene.rods("/band", points, counts=[24], diameters=0.004, young=1e6, closed=True, rest_points=part * points)
        scene.collider("/peg", wsim.Cylinder(0.02, 0.05))
        simulation = wsim.Simulation(scene, device="cpu")
        simulation.run(2)
        deep = 0.022 - np.linalg.norm(simulation.positions("/band")[:, :2], axis=1).min()
        found[part] = simulation.plan.method("rods").substeps, deep
        assert not [w for w in simulation.report()["warnings"] if "deep in colliders" in str(w)]
    assert 55 <= found[0.7][0] <= 75 and found[0.7][1] < 5e-4, found
    assert found[1.0][0] == 10
