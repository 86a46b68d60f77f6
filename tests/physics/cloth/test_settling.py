"""Drag of the air that fabrics have of their own: along the normal alone, for cloth whose own drag is not authored."""

from dataclasses import replace

import numpy as np
import pytest

from wsim.scene import Plane, Scene, shapes
from wsim.scene.fabric import FABRICS, Fabric, fabric
from wsim.simulation.simulation import Simulation

RATE = 2.0                                                  # c / m [1/s]
STIFF = Fabric(stretch=500.0, shear=100.0, bend=1e-4, thickness=1e-3, density=200.0, normal_drag=RATE * 0.2)
SOLVERS = [("explicit", "leapfrog"), ("explicit", "rk4"), ("xpbd", "auto"), ("implicit", "backward_euler"),
           ("implicit", "bdf2"), ("implicit", "implicit_midpoint"), ("implicit", "sdirk3")]


def sheet(velocity=(0.0, 0.0, 0.0), material=STIFF, size: float = 0.4, cells: int = 4, **more) -> Scene:
    """A horizontal square sheet that flies freely, normal +y."""
    own = {name: more.pop(name) for name in ("drag",) if name in more}
    scene = Scene(**{"gravity": (0.0, 0.0, 0.0), "fps": 60.0, "substeps": 10, "solver": "xpbd"} | more)
    points, counts, indices = shapes.sheet(size, size, cells, cells, horizontal=True)
    scene.cloth("/cloth", points, counts, indices, material=material, velocities=np.tile(velocity, (len(points), 1)), **own)
    return scene


def speeds(scene: Scene, frames: int = 30) -> np.ndarray:
    sim = Simulation(scene, device="cpu", precision="float64")
    sim.run(frames)
    return sim.velocities("/cloth")


@pytest.mark.parametrize("solver, integrator", SOLVERS)
def test_motion_along_the_normal_decays_and_motion_in_the_plane_stays(solver, integrator):
    """v_n = v_n0 (1 + h c / m)^-n, whose limit is exp(-c t / m): to h c / 2 m of the exponent. In the plane: v stays."""
    h, t = 1.0 / 600.0, 0.5
    v = speeds(sheet((0.7, 3.0, -0.4), solver=solver, integrator=integrator))
    np.testing.assert_allclose(v[:, 1], 3.0 * np.exp(-RATE * t), rtol=RATE * t * h * RATE)
    np.testing.assert_allclose(v[:, [0, 2]], np.tile([0.7, -0.4], (len(v), 1)), rtol=1e-6)


def test_one_substep_of_the_scheme_is_its_formula():
    scene = sheet((0.0, 3.0, 0.0))
    np.testing.assert_allclose(speeds(scene)[:, 1], 3.0 * (1.0 + RATE / 600.0)**-300, rtol=1e-9)


def test_a_sheet_is_carried_by_the_wind_across_it():
    """v = w (1 - exp(-c t / m)) along the normal, nothing along the sheet."""
    v = speeds(sheet(wind=(5.0, 2.0, 0.0)))
    np.testing.assert_allclose(v[:, 1], 2.0 * (1.0 - np.exp(-RATE * 0.5)), rtol=4e-3)
    assert np.abs(v[:, [0, 2]]).max() < 1e-9


def test_a_sheet_sinks_at_its_terminal_velocity():
    """m g = c v, to h c / m: v = v / (1 + h c / m) + h g."""
    falls = 9.81 / RATE * (1.0 + RATE / 600.0)
    v = speeds(sheet((0.0, -falls, 0.0), gravity=(0.0, -9.81, 0.0)))
    np.testing.assert_allclose(v[:, 1], -falls, rtol=1e-9)


@pytest.mark.parametrize("solver, integrator", SOLVERS[2:-1])
def test_a_sheet_at_rest_has_its_whole_weight(solver, integrator):
    """A drag of 1000 / s on a sheet that lies on a floor: the air does not carry what does not move, so that friction holds it
    on a slope of 0.9 of its angle. (Explicit steps meet the floor after the air: there it carries h c / m of the weight.)"""
    scene = sheet(material=replace(STIFF, normal_drag=200.0, static_friction=0.5, dynamic_friction=0.5), solver=solver,
                  integrator=integrator, gravity=(9.81 * 0.45, -9.81, 0.0), substeps=20)
    scene.collider("/floor", Plane(), at=(0.0, -0.5e-3, 0.0), static_friction=0.5, dynamic_friction=0.5)
    sim = Simulation(scene, device="cpu", precision="float64")
    sim.run(10)
    assert np.abs(sim.positions("/cloth") - scene.cloths[0].points)[:, 0].max() < 1e-4


def test_an_explicit_drag_of_0_stays_0_and_nothing_of_the_air_is_planned():
    scene = sheet((0.0, 3.0, 0.0), material=fabric("silk"), drag=0.0)
    sim = Simulation(scene, device="cpu", precision="float64")
    assert sim.plan.ports.wind is None and not scene.cloths[0].feels_air
    sim.run(10)
    np.testing.assert_allclose(sim.velocities("/cloth")[:, 1], 3.0, rtol=1e-9)


def test_an_authored_drag_replaces_that_of_the_fabric():
    with_own, without = (sheet((0.0, 3.0, 0.0), material=m, drag=1.1) for m in (STIFF, replace(STIFF, normal_drag=0.0)))
    np.testing.assert_array_equal(speeds(with_own, 5), speeds(without, 5))


def test_a_cloth_without_a_preset_flies_without_drag_and_the_scene_has_none():
    scene = sheet((0.0, 3.0, 0.0), material=Fabric())
    assert scene.air_drag == 0.0 and Fabric().normal_drag == 0.0
    np.testing.assert_allclose(speeds(scene, 10)[:, 1], 3.0, rtol=1e-9)


def test_other_objects_are_not_slowed():
    """A spring net and a cloth without coefficients fly beside a silk."""
    scene = sheet((0.0, 3.0, 0.0), material=fabric("silk"))
    points, counts, indices = shapes.sheet(0.4, 0.4, 2, 2, horizontal=True, at=(3.0, 0.0, 0.0))
    up = np.tile((0.0, 3.0, 0.0), (len(points), 1))
    scene.cloth("/plain", points, counts, indices, velocities=up)
    scene.net("/net", points + np.float32([3.0, 0.0, 0.0]), [[0, 1], [1, 2]], [100.0, 100.0], np.full(len(points), 0.1),
              velocities=up)
    sim = Simulation(scene, device="cpu", precision="float64")
    sim.run(10)
    for path in ("/plain", "/net"):
        np.testing.assert_allclose(sim.velocities(path)[:, 1], 3.0, rtol=1e-9)
    assert sim.velocities("/cloth")[:, 1].max() < 0.8 * 3.0


def settled(name: str, size: float, hold: str, cells: int = 8, **more) -> float:
    """Time [s] after which the kinetic energy stays below 1 % of its peak: a cloth that is let go flat, held by an edge or by
    two corners."""
    scene = Scene(**more)
    points, counts, indices = shapes.sheet(size, size, cells, cells, horizontal=True)
    cloth = scene.cloth("/cloth", points, counts, indices, material=FABRICS[name])
    row = np.flatnonzero(points[:, 2] < points[:, 2].min() + 1e-6)
    scene.pin("/pin", cloth, row if hold == "edge" else row[[0, -1]])
    sim, energy = Simulation(scene, device="cpu"), []
    for _ in range(int(7 * scene.fps)):
        sim.step()
        energy.append(float((sim.velocities("/cloth")**2).sum()))
    return (np.flatnonzero(np.array(energy) >= 0.01 * max(energy))[-1] + 1) / scene.fps


@pytest.mark.parametrize("name, size, hold", [("cotton", 1.0, "edge"), ("denim", 2.0, "corners"), ("silk", 1.0, "corners"),
                                              ("leather", 1.0, "edge")])
def test_a_hanging_cloth_settles_within_2_to_6_s(name, size, hold):
    assert 2.0 <= settled(name, size, hold) <= 6.0


@pytest.mark.slow
@pytest.mark.parametrize("name", FABRICS)
@pytest.mark.parametrize("hold", ["edge", "corners"])
@pytest.mark.parametrize("size", [0.3, 1.0, 2.0])
def test_every_fabric_of_every_size_settles_within_2_to_6_s(name, size, hold):
    assert 2.0 <= settled(name, size, hold) <= 6.0


@pytest.mark.slow
@pytest.mark.parametrize("solver, integrator", [("xpbd", "auto"), ("implicit", "backward_euler"), ("implicit", "bdf2"),
                                                ("implicit", "implicit_midpoint"), ("implicit", "sdirk3")])
@pytest.mark.parametrize("hold", ["edge", "corners"])
def test_by_every_solver_a_hanging_cloth_settles_within_2_to_6_s(solver, integrator, hold):
    assert 2.0 <= settled("cotton", 1.0, hold, solver=solver, integrator=integrator) <= 6.0
