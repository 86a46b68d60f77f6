"""Grains that turn: closed forms of rolling and sliding, momenta of collisions, rest, and that others do not pay for it."""

import numpy as np
import pytest

import wsim
from tests.make.physics.piles import set_spins, spins
from wsim.physics.position_based.objects import Grains
from wsim.scene import Scene, SceneError

G = 9.81


def ball_on_plane(slope=0.0, mu=0.5, rolling=0.0, speed=0.0, radius=0.01, motion=None, **more):
    """A ball on a plane that falls by `slope` [rad] along x."""
    scene = Scene(**{"fps": 60, "substeps": 8, "iterations": 4} | more, gravity=(G * np.sin(slope), -G * np.cos(slope), 0))
    scene.collider("/floor", wsim.Plane(), static_friction=mu, dynamic_friction=mu, **({"motion": motion} if motion else {}))
    scene.particles("/ball", points=[[0, radius, 0]], radius=radius, velocities=[[speed, 0, 0]],
                    material=Grains(static_friction=mu, dynamic_friction=mu, rolling_friction=rolling))
    return wsim.Simulation(scene, device="cpu")


@pytest.mark.parametrize(("substeps", "iterations", "radius"), [(4, 1, 0.01), (8, 4, 0.001), (32, 8, 0.01), (8, 2, 1000.0)])
def test_a_ball_rolls_down_a_slope_by_five_sevenths(substeps, iterations, radius):
    simulation = ball_on_plane(0.3, radius=radius, substeps=substeps, iterations=iterations)
    simulation.run(30)
    speed = simulation.velocities()[0, 0]
    assert np.isclose(speed, 5 / 7 * G * np.sin(0.3) * 0.5, rtol=1e-4)
    assert np.isclose(spins(simulation, "/ball")[0, 2], -speed / radius, rtol=1e-4)


def test_a_ball_slides_above_the_slope_that_friction_can_turn_it_on():
    """tan > 7/2 mu: friction mu N turns it by 5/2 mu g cos / R, and it slides."""
    mu, slope = 0.2, np.arctan(3.5 * 0.2) + 0.1
    simulation = ball_on_plane(slope, mu)
    simulation.run(30)
    assert np.isclose(simulation.velocities()[0, 0], G * (np.sin(slope) - mu * np.cos(slope)) * 0.5, rtol=1e-4)
    assert np.isclose(spins(simulation, "/ball")[0, 2], -2.5 * mu * G * np.cos(slope) * 0.5 / 0.01, rtol=1e-3)
    simulation = ball_on_plane(slope - 0.2, mu)
    simulation.run(30)
    assert np.isclose(simulation.velocities()[0, 0], 5 / 7 * G * np.sin(slope - 0.2) * 0.5, rtol=1e-4)


def test_a_ball_that_slides_ends_by_rolling_with_five_sevenths_of_its_speed():
    simulation = ball_on_plane(0.0, 0.3, speed=1.0)
    simulation.run(12)
    assert np.isclose(simulation.velocities()[0, 0], 5 / 7, rtol=1e-5)
    before = simulation.positions()[0, 0]
    simulation.run(60)
    assert np.isclose(simulation.positions()[0, 0] - before, 5 / 7, rtol=1e-5)                # and goes on for ever


@pytest.mark.parametrize(("substeps", "iterations"), [(4, 1), (16, 4)])
def test_rolling_friction_slows_a_ball_and_stops_it_for_good(substeps, iterations):
    rolling = 0.08
    simulation = ball_on_plane(rolling=rolling, speed=1.0, substeps=substeps, iterations=iterations)
    simulation.run(15)
    early = simulation.velocities()[0, 0]
    simulation.run(15)
    late = simulation.velocities()[0, 0]
    assert np.isclose(early - late, 5 / 7 * rolling * G * 0.25, rtol=1e-3)
    simulation.run(60)
    rest = simulation.positions().copy()
    simulation.run(60)
    assert np.abs(simulation.positions() - rest)[:, [0, 2]].max() < 1e-9 and np.abs(spins(simulation, "/ball")).max() < 1e-6


@pytest.mark.parametrize(("slope", "rolling"), [(0.3, 0.0), (0.0, 0.08), (0.3, 0.08)])
def test_the_energy_balance_counts_the_spin_of_a_ball_that_rolls(slope, rolling):
    """It rolls by 7/10 m v^2, of which 2/7 are in its spin; rolling friction takes mu_r m g cos times its way, and no frame is
    left open."""
    simulation = ball_on_plane(slope, rolling=rolling, speed=1.0)
    simulation.run(15)                                           # it has slid, and rolls
    balance, m = simulation.plan.method("balance"), 2600 * 4 / 3 * np.pi * 0.01**3
    before = balance.found()["kinetic"]
    x, v = simulation.positions()[0, 0], simulation.velocities()[0, 0]
    assert np.isclose(before, 0.7 * m * v * v, rtol=1e-4)
    simulation.run(15)
    way = simulation.positions()[0, 0] - x
    work = m * G * way * (np.sin(slope) - rolling * np.cos(slope))
    assert np.isclose(balance.found()["kinetic"] - before, work, rtol=2e-3, atol=1e-4 * before)
    assert not balance.report()["left_open"] and balance.report()["rise"] < 1e-6


@pytest.mark.parametrize(("beyond", "rolls"), [(-0.1, False), (0.1, True)])
def test_a_ball_stays_on_slopes_up_to_its_rolling_friction(beyond, rolls):
    """A tenth of a degree below atan(mu_r) it stays, above it rolls, by the closed form."""
    rolling = 0.1
    slope = np.arctan(rolling) + np.radians(beyond)
    simulation = ball_on_plane(slope, rolling=rolling)
    simulation.run(60)
    speed, want = simulation.velocities()[0, 0], 5 / 7 * G * (np.sin(slope) - rolling * np.cos(slope))
    assert np.isclose(speed, want, rtol=1e-3) if rolls else abs(speed) < 1e-7


def test_a_belt_takes_a_ball_along_by_two_sevenths_and_a_turntable_turns_it():
    """A plane that goes at V starts a ball that does not turn: friction brings it to 2/7 V, and then it rolls. A ball of
    rolling friction in the middle of a turntable turns with it about the normal."""
    times = np.linspace(0.0, 2.0, 121)
    level = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]])          # normal of a Plane: z
    poses = np.tile(level, (121, 1, 1))
    poses[:, 0, 3] = 0.7 * times
    simulation = ball_on_plane(mu=0.4, motion=wsim.Motion(times, poses))
    simulation.run(60)
    assert np.isclose(simulation.velocities()[0, 0], 2 / 7 * 0.7, rtol=1e-4)
    poses = np.tile(np.eye(4), (121, 1, 1))
    poses[:, 0, 0] = poses[:, 2, 2] = np.cos(times)
    poses[:, 0, 2], poses[:, 2, 0] = np.sin(times), -np.sin(times)
    simulation = ball_on_plane(mu=0.4, rolling=0.1, motion=wsim.Motion(times, poses @ level))
    simulation.run(60)
    assert np.allclose(spins(simulation, "/ball"), [[0, 1, 0]], atol=1e-3)


@pytest.mark.parametrize(("ratio", "rolling", "size"), [(1.0, 0.0, 1e-3), (3.0, 0.3, 0.01), (1.0, 0.2, 1000.0)])
def test_balls_that_collide_with_spin_keep_both_momenta(ratio, rolling, size):
    r = size * np.array([1.0, 1.0 / ratio])
    scene = Scene(fps=60, substeps=8, iterations=8, gravity=(0, 0, 0))
    scene.particles("/balls", points=[[-2 * size, 0, 0], [2 * size, 0.7 * r[1], 0.2 * r[1]]], radius=r,
                    velocities=[[100 * size, 0, 0], [-100 * size, 0, 0]], material=Grains(rolling_friction=rolling))
    simulation = wsim.Simulation(scene, device="cpu")
    set_spins(simulation, "/balls", [[100, 0, 50], [0, -30, 20]])
    m = 2600 * 4 / 3 * np.pi * r**3

    def momenta():
        x, v, omega = simulation.positions().astype(float), simulation.velocities().astype(float), spins(simulation, "/balls")
        L = (m[:, None] * np.cross(x, v)).sum(0) + (0.4 * m * r * r) @ omega
        return m @ v, L, 0.5 * m @ (v**2).sum(1) + 0.2 * (m * r * r) @ (omega**2).sum(1)
    before = momenta()
    simulation.run(12)
    after, scale = momenta(), (m * 100 * size).sum()
    assert np.abs(after[0] - before[0]).max() < 1e-6 * scale
    assert np.abs(after[1] - before[1]).max() < 1e-6 * scale * size
    assert after[2] < 0.95 * before[2] and np.abs(spins(simulation, "/balls") - [[100, 0, 50], [0, -30, 20]]).max() > 1


@pytest.mark.parametrize(("rolling", "stands"), [(None, True), (0.0, False), (0.05, True)])
def test_a_tower_of_three_balls_falls_if_they_roll_freely(rolling, stands):
    r = 0.005
    scene = Scene(fps=60, substeps=8, iterations=8)
    scene.collider("/floor", wsim.Plane(), static_friction=0.5, dynamic_friction=0.5)
    scene.particles("/tower", points=[[1e-6 * i, r + 2 * r * i, 0] for i in range(3)], radius=r,
                    material=Grains(rolling_friction=rolling))
    simulation = wsim.Simulation(scene, device="cpu")
    simulation.run(60)
    height = simulation.positions()[:, 1] / r
    assert np.allclose(height, [1, 3, 5], atol=0.01) if stands else height.max() < 1.1
    assert not stands or np.abs(simulation.velocities()).max() < 1e-5


@pytest.mark.parametrize("iterations, seconds", [(2, 8), (8, 3)])
def test_a_heap_that_rolls_with_resistance_comes_to_rest(iterations, seconds):
    """With 2 iterations its grains are carried: a steep heap stands, off which single grains roll for some seconds."""
    scene = Scene(fps=60, substeps=8, iterations=iterations)
    scene.collider("/floor", wsim.Plane(), static_friction=0.5, dynamic_friction=0.5)
    scene.particles("/grains", wsim.Box((0.025, 0.05, 0.025)), at=(0, 0.055, 0), radius=0.004,
                    material=Grains(rolling_friction=0.2))
    simulation = wsim.Simulation(scene, device="cpu")
    assert next(m for m in simulation.plan.methods if m.name == "grains").deep == (iterations == 2)
    simulation.run(60 * seconds)
    rest = simulation.positions().copy()
    assert np.abs(simulation.velocities()).max() < 1e-3
    simulation.run(60)
    assert np.abs(simulation.positions() - rest).max() < 2e-4


def rolling_pour():
    """Grains that roll into each other and over an edge."""
    scene = Scene(fps=60, frames=40, substeps=8, iterations=2)
    scene.collider("/floor", wsim.Plane(), static_friction=0.5, dynamic_friction=0.5)
    scene.particles("/rolls", wsim.Box((0.02, 0.03, 0.02)), at=(0, 0.04, 0), radius=0.005, velocity=(0.3, 0, 0),
                    material=Grains(rolling_friction=0.02))
    scene.particles("/slides", wsim.Box((0.02, 0.02, 0.02)), at=(0.06, 0.03, 0), radius=0.005,
                    material=Grains(rolling_friction=np.inf))
    return scene


def test_the_same_bits_twice_behind_a_reset_and_a_restart():
    def everything(simulation):
        return [simulation.positions("/rolls"), simulation.positions("/slides"), spins(simulation, "/rolls")]
    simulation = wsim.Simulation(rolling_pour(), device="cpu")
    simulation.run(12)
    fields = {path: simulation.fields(path) for path in ("/rolls", "/slides")}
    simulation.run(12)
    first = [np.copy(values) for values in everything(simulation)]
    assert np.abs(first[2]).max() > 1.0
    simulation.reset()
    simulation.run(24)
    assert all(map(np.array_equal, everything(simulation), first))
    again = wsim.Simulation(rolling_pour(), device="cpu")
    again.restart(12, fields)
    again.run(12)
    assert all(map(np.array_equal, everything(again), first))


def test_what_does_not_turn_has_no_kernels_of_rolling_and_bad_numbers_are_named():
    scene = rolling_pour()
    scene.things("Particles")[0].material = Grains(rolling_friction=np.inf)
    simulation = wsim.Simulation(scene, device="cpu")
    assert not any("rolling" in name for name in simulation.plan.model.modules)
    assert not any("rolling" in stage.name for method in simulation.plan.methods for stage in method.stages)
    scene.things("Particles")[0].material = Grains(rolling_friction=-0.1)
    with pytest.raises(SceneError, match=r"/rolls.*rolling_friction is -0.1"):
        wsim.Simulation(scene, device="cpu")


@pytest.mark.parametrize(("rolling", "mass"), [(0.0, 0.03), (0.2, 0.03), (0.1, 0.002)])
def test_a_ball_that_hits_a_free_body_keeps_both_momenta(rolling, mass):
    r, half = 0.01, np.array([0.05, 0.02, 0.05])
    scene = Scene(fps=60, substeps=8, iterations=4, gravity=(0, 0, 0))
    scene.body("/box", shape=wsim.Box(tuple(half)), mass=mass, static_friction=0.5, dynamic_friction=0.5)
    scene.particles("/ball", points=[[-0.02, 0.05, 0.01]], radius=r, velocities=[[1, -1, 0.3]],
                    material=Grains(rolling_friction=rolling))
    simulation = wsim.Simulation(scene, device="cpu")
    m, rigid = 2600 * 4 / 3 * np.pi * r**3, simulation.plan.method("rigid").part.arrays

    def momenta():
        x, v = (np.ravel(values).astype(float) for values in (simulation.positions("/ball"), simulation.velocities("/ball")))
        p, L, X = (rigid["p"].numpy()[0].astype(float), rigid["L"].numpy()[0].astype(float),
                   simulation.poses("/box")["/box"][:3, 3])
        return m * v + p, m * np.cross(x, v) + 0.4 * m * r * r * spins(simulation, "/ball")[0] + np.cross(X, p) + L
    before = momenta()
    simulation.run(12)
    after = momenta()
    assert np.abs(after[0] - before[0]).max() < 1e-6 * m and np.abs(after[1] - before[1]).max() < 2e-6 * m * r
    assert np.abs(spins(simulation, "/ball")).max() > 5 and np.linalg.norm(rigid["L"].numpy()) > 1e-2 * m * r


@pytest.mark.parametrize("iterations", [2, 8])
def test_a_plate_on_balls_goes_twice_as_fast_as_they_do(iterations):
    """Lagrange: balls of m at half of the plate's speed have 7/20 m of its mass, and half of their weight pulls along."""
    r, mass, slope = 0.01, 0.05, 0.1
    scene = Scene(fps=60, substeps=8, iterations=iterations, gravity=(G * np.sin(slope), -G * np.cos(slope), 0))
    scene.collider("/floor", wsim.Plane(), static_friction=0.5, dynamic_friction=0.5)
    scene.body("/plate", shape=wsim.Box((0.2, 0.005, 0.05)), mass=mass, at=(0, 2 * r + 0.005, 0), static_friction=0.5,
               dynamic_friction=0.5)
    points = [[x, r, z] for x in (-0.1, 0.1) for z in (-0.03, 0.03)]
    scene.particles("/balls", points=points, radius=r, material=Grains(rolling_friction=0.0))
    simulation = wsim.Simulation(scene, device="cpu")
    simulation.run(18)
    m = 2600 * 4 / 3 * np.pi * r**3
    pull = G * np.sin(slope) * (mass + 4 * m / 2) / (mass + 4 * 0.35 * m)
    speed = simulation.plan.method("rigid").part.arrays["p"].numpy()[0, 0] / mass
    assert np.isclose(speed, pull * 0.3, rtol=0.01)
    assert np.allclose(simulation.velocities("/balls")[:, 0], 0.5 * speed, rtol=0.01)


def test_grains_beside_newtons_method_do_not_turn_and_say_so():
    points, counts, indices = wsim.shapes.sheet(0.1, 0.1, 3, 3, horizontal=True)
    scene = Scene(fps=60, substeps=4, iterations=2, solver="implicit")
    scene.cloth("/cloth", points, counts, indices)
    scene.particles("/grains", points=[[0, 0.05, 0]], radius=0.01, material=Grains(rolling_friction=0.1))
    simulation = wsim.Simulation(scene, device="cpu")
    assert any("/grains: its grains do not turn" in str(w) for w in simulation.report(profile=False)["warnings"])
    assert simulation.plan.method("grains").rolling is None
