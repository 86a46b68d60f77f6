"""Closed strands that touch: themselves, each other, open ropes, cloth, grains and fluids. None of their points is the seam."""

import numpy as np
import pytest

import wsim
from tests.make.physics.rods.with_surfaces import crossed, sheet
from tests.physics.contact.selfcontact.rig import solvers
from tests.physics.rods.knots import linking
from tests.physics.rods.rig import simulated
from wsim import Plane
from wsim.physics.position_based.objects import Grains
from wsim.physics.rods import coupled_newton
from wsim.physics.rods.objects import Rods
from wsim.scene import Scene

THICK = 0.01                                       # of ropes, and radius of grains [m]
CLOTHS = ("xpbd", "newton bdf2", "leapfrog")


def ring(n: int, first: int = 0, radius: float = 0.1, up: int = 1, at=(0.0, 0.0, 0.0)) -> np.ndarray:
    """Points of a ring in the plane of x and the axis `up`, the first of them `first` steps on."""
    a, x = 2.0 * np.pi * (np.arange(n) + first) / n, np.zeros((n, 3))
    x[:, 0], x[:, up] = radius * np.cos(a), radius * np.sin(a)
    return x + at


def chain(speed: float, first: int = 0, **more) -> Scene:
    """Two rings, linked, that fly apart."""
    x = np.concatenate([ring(24, first), ring(24, first, up=2, at=(0.1, 0.0, 0.0))])
    scene = Scene(fps=240, substeps=1, gravity=(0, 0, 0))
    scene.add(Rods("/chain", x, [24, 24], THICK, young=1e6, closed=True,
                   velocities=np.repeat([[-speed, 0.0, 0.0], [speed, 0.1, 0.2]], 24, axis=0),
                   **{"self_collision": True} | more))
    return scene


def test_linked_rings_that_fly_apart_stay_a_chain():
    """At 10 m/s each: their linking number is 1 or -1 in every substep; without contact they come apart."""
    simulation, method = simulated(chain(10.0))
    for _ in range(48):
        simulation.step()
        assert abs(linking(*method.points(0)[0].reshape(2, 24, 3))) == pytest.approx(1.0, abs=1e-9)
    found = method.indicators(None, None)
    assert found["rod_cut"] == found["rod_held"] == 0
    free, alone = simulated(chain(10.0, self_collision=False))
    free.run(24)
    assert linking(*alone.points(0)[0].reshape(2, 24, 3)) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("first", [8, 1])
def test_a_chain_does_not_know_where_its_rings_begin(first):
    """Newton's method leaves 1e-6 of an edge, and leaves the same wherever it begins, but for rounding."""
    found = []
    for k in (0, first):
        simulation, method = simulated(chain(4.0, k))
        simulation.run(16)
        found.append(np.roll(method.points(0)[0].reshape(2, 24, 3), k, axis=1))
    assert method.indicators(None, None)["rod_pairs"] > 0 and np.ptp(found[0][0], axis=0)[1] < 0.195     # they pull
    assert np.abs(found[1] - found[0]).max() < 1e-8


def squeezed(first: int) -> tuple[np.ndarray, float]:
    """A ring whose two halves are thrown at each other: places, and how near they came."""
    scene = Scene(fps=240, substeps=1, gravity=(0, 0, 0))
    x = ring(32, first)
    scene.add(Rods("/ring", x, [32], THICK, young=1e5, closed=True, self_collision=True,
                   velocities=np.stack([0.0 * x[:, 0], -60.0 * x[:, 1], 0.0 * x[:, 0]], axis=1)))
    simulation, method = simulated(scene)
    least = np.inf
    for _ in range(12):
        simulation.step()
        y = np.roll(method.points(0)[0], first, axis=0)
        least = min(least, y[8, 1] - y[24, 1])
    return y, least


def test_a_ring_touches_itself_alike_wherever_it_begins():
    """The halves come as near as they are thick, less what stiffness gives, and no nearer."""
    (x, least), (y, _) = squeezed(0), squeezed(11)
    assert 0.8 * THICK < least < 1.1 * THICK
    assert np.abs(y - x).max() < 1e-7


def beside(partner: str, first: int = 0, **more) -> wsim.Simulation:
    """A ring that flies down at something free."""
    scene = Scene(fps=60, substeps=8, iterations=4, gravity=(0, 0, 0))
    x = ring(24, first, up=2, at=(0.0, 0.05, 0.0))
    scene.add(Rods("/ring", x, [24], THICK, young=1e6, closed=True, self_collision=True, static_friction=0.0,
                   dynamic_friction=0.0, velocities=np.tile([0.05, -1.0, 0.1], (24, 1))))
    if partner == "cloth":
        sheet(scene, 0.3, 8, held=False)
    elif partner == "rope":
        scene.add(Rods("/rope", np.stack([np.linspace(-0.2, 0.2, 9), *np.zeros((2, 9))], axis=1), [9], THICK, young=1e6,
                       self_collision=True))
    else:
        k = np.stack(np.meshgrid(np.arange(9), [0], np.arange(9), indexing="ij"), -1).reshape(-1, 3)
        scene.particles("/p", points=2.05 * THICK * (k - [4, 0, 4]) + [0.003, 0.0, 0.002], radius=THICK,
                        material=Grains(static_friction=0.0, dynamic_friction=0.0) if partner == "grains" else partner)
    return wsim.Simulation(scene, device="cpu", **more)


def momentum(simulation: wsim.Simulation) -> np.ndarray:
    method = simulation.plan.method("rods")
    found = sum(b.point_masses @ simulation.velocities(b.path).astype(float) for b in simulation.model.bodies)
    m = method.table.masses
    return found + sum(m[place] @ method.points(k)[1] for k, place in enumerate(method.table.place))


@pytest.mark.parametrize("partner", ["rope", "cloth", "grains", "fluid"])
def test_what_a_ring_loses_the_other_gains(partner):
    simulation = beside(partner)
    before = momentum(simulation)
    simulation.run(8)
    assert simulation.plan.method("rods").points(0)[1][:, 1].max() > -0.9                  # they met
    assert np.abs(momentum(simulation) - before).max() < 1e-6 * np.linalg.norm(before)


@pytest.mark.parametrize("partner", ["grains", "cloth"])
def test_no_point_of_a_ring_that_meets_others_is_its_seam(partner):
    """Turned by a third of its points: places agree in float64."""
    found = []
    for first in (0, 8):
        simulation = beside(partner, first, precision="float64")
        simulation.run(6)
        found.append(np.roll(simulation.plan.method("rods").points(0)[0], first, axis=0))
    assert found[0][:, 1].max() > -0.05 + 1e-3                                             # it met the others
    assert np.abs(found[1] - found[0]).max() < 1e-9


def rails(closed: bool, first: int) -> tuple[np.ndarray, np.ndarray]:
    """A loop of string round four pins, a grain on both of its sides: places of the loop, in one order, and of the grain. Open:
    without its edge between two of the pins."""
    x, n = np.linspace(-0.1, 0.1, 11), 22
    loop = np.stack([np.concatenate([x, x[::-1]]), np.zeros(n), np.repeat([-0.006, 0.006], 11)], axis=1)
    scene = Scene(fps=60, substeps=8, iterations=4)
    loop = np.roll(loop, -first, axis=0)
    rods = scene.add(Rods("/loop", loop, [n], 0.004, density=2000.0, stretch=100.0, bend=0.0, twist=0.0, damping=0.02,
                          rest_points=0.95 * loop, closed=closed, self_collision=True))
    rods.pin("/pins", (np.array([0, 10, 11, 21]) - first) % n)
    scene.particles("/grain", points=[[0.0, 0.0105, 0.0]], radius=0.01, material=Grains(density=2500.0))
    simulation = wsim.Simulation(scene, device="cpu")
    simulation.run(60)
    return np.roll(simulation.plan.method("rods").points(0)[0], first, axis=0), simulation.positions("/grain").astype(float)


def test_a_loop_round_pins_carries_a_grain_as_an_open_rope_does():
    """The string sags by W / 2 L / (4 T), and by its own weight, wherever it begins, and whether it is closed at the pins."""
    length, area = 0.2, np.pi * 0.002**2
    tension, weight = 100.0 * (1.0 / 0.95 - 1.0), 9.81 * 2500.0 * 4.0 / 3.0 * np.pi * 0.01**3
    sag = 0.5 * weight * length / (4.0 * tension) + 9.81 * 1900.0 * area * length**2 / (8.0 * tension)
    open_rope, grain = rails(False, 0)
    assert -open_rope[[5, 16], 1] == pytest.approx([sag, sag], rel=0.01)
    for first in (0, 5, 16):                           # the seam between two pins, at the grain, at the grain's other side
        x, y = rails(True, first)
        assert np.abs(x - open_rope).max() < 1e-9 and np.abs(y - grain).max() < 1e-7


def test_a_ring_that_falls_round_a_column_of_grains_stays_there():
    """Thrown sideways it is stopped by the column, and lies on the floor around it."""
    scene = Scene(fps=60, substeps=8, iterations=4)
    scene.collider("/floor", Plane("Y"), static_friction=0.5, dynamic_friction=0.5)
    scene.particles("/column", points=[[0.0, 0.01 + 0.02 * k, 0.0] for k in range(4)], radius=0.01,
                    material=Grains(density=8000.0, rolling_friction=np.inf))
    x = ring(24, radius=0.04, up=2, at=(0.0, 0.12, 0.0))
    scene.add(Rods("/ring", x, [24], 0.006, young=1e6, density=300.0, damping=0.01, closed=True, self_collision=True,
                   velocities=np.tile([0.3, 0.0, 0.0], (24, 1))))
    simulation = wsim.Simulation(scene, device="cpu")
    simulation.run(45)
    y, grains = simulation.positions("/ring").astype(float), simulation.positions("/column").astype(float)
    assert np.abs(y[:, 1] - 0.003).max() < 1e-3
    away = np.linalg.norm(y[:, None, [0, 2]] - grains[None, :, [0, 2]], axis=-1)
    assert 0.9 * 0.013 < away.min() < 0.02
    axis = np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0], [9.0, 1.0, 0.0], [9.0, -1.0, 0.0]]) + [grains[:, 0].mean(), 0.0, 0.0]
    assert abs(linking(y, axis)) == pytest.approx(1.0, abs=1e-9)
    assert np.ptp(grains[:, [0, 2]], axis=0).max() < 0.01                                   # it stands


@pytest.mark.parametrize("solver", solvers(*CLOTHS))
def test_a_loop_that_is_thrown_at_a_cloth_does_not_pass(solver):
    """No edge of it, that of the seam included, has a point in common with a triangle, in any frame."""
    scene = Scene(**{"fps": 60.0} | solver)
    sheet(scene, 0.3, 10)
    scene.add(Rods("/loop", ring(32, up=2, at=(0.01, 0.02, 0.0), radius=0.06), [32], 8e-3, young=1e6, closed=True,
                   self_collision=True, velocities=np.tile([0.0, -2.0, 0.0], (32, 1))))
    simulation = wsim.Simulation(scene, device="cpu")
    touched, method = 0.0, simulation.plan.method("selfcontact")
    for _ in range(15):
        simulation.step()
        assert crossed(simulation) == 0
        touched = max(touched, method.indicators(None, None)["surface_contacts"])
    assert touched > 0 and method.indicators(None, None)["held"] == 0


def places(simulation: wsim.Simulation) -> list[np.ndarray]:
    return [simulation.plan.method("rods").points(0)[0], simulation.positions("/p")]


def test_two_runs_and_one_that_goes_on_from_its_fields_have_the_same_bits():
    first, second, third = (beside("grains") for _ in range(3))
    first.run(6)
    second.run(4)
    third.restart(4, {path: second.fields(path) for path in second.state.paths()})
    second.run(2)
    third.run(2)
    assert all(np.array_equal(a, b) for other in (second, third) for a, b in zip(places(first), places(other), strict=True))


def test_a_block_of_threads_finds_what_a_thread_a_strand_does(monkeypatch):
    """Rings and an open rope that touch, in two worlds: iterations end at 1e-6 of an edge, 12 substeps."""
    found = {}
    for team in (True, False):
        monkeypatch.setattr(coupled_newton, "TEAM", team)
        scene = chain(4.0)
        scene.add(Rods("/rope", np.stack([np.linspace(0.12, 0.4, 8), *np.zeros((2, 8))], axis=1), [8], THICK, young=1e6,
                       self_collision=True))
        simulation, method = simulated(scene, worlds=2)
        assert bool(method.touching.team) == team
        simulation.run(12)
        found[team] = [method.points(k)[0] for k in range(4)]
        assert method.indicators(None, None)["rod_pressed"] > 0.0
    for a, b in zip(found[True], found[False], strict=True):
        assert np.abs(a - b).max() < 1e-5
