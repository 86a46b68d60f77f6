"""The volume of a liquid against closed forms, and what a frame says where it changes or where there is no room for more."""

import numpy as np
import pytest

from tests.physics.fluid.liquid.tanks import tank
from wsim.physics.fluid.liquid.objects import Liquid, LiquidSource
from wsim.scene import Collider, Motion, Scene
from wsim.scene.curve import Curve
from wsim.scene.solids import Box, Plane, Sphere
from wsim.simulation.simulation import Simulation


def turned(degrees: float, place) -> Motion:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    M = np.eye(4)
    M[:3, :3], M[:3, 3] = [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]], place
    return Motion(np.zeros(1), M[None])


def below(degrees: float, place) -> Collider:
    """Everything below a plane through a place."""
    up = np.array([-np.sin(np.radians(degrees)), np.cos(np.radians(degrees)), 0.0])
    return Collider("/slope", Box((2.0, 2.0, 2.0)), turned(degrees, np.asarray(place) - 2.0 * up))


HALF = (0.5, 0.5, 0.5)
CASES = {                                              # colliders, top of the liquid [m], volume that it has in a tank of 1 m
    "walls": ([Collider("/left", Box((0.5, 1.0, 1.0)), Motion.at_place((-0.5, 0.5, 0.5))),
               Collider("/floor", Plane(axis="Y"))], 0.5, 0.5),
    "turned": ([Collider("/box", Box((0.25, 0.15, 1.0)), turned(30.0, HALF))], 1.0, 1.0 - 4.0 * 0.25 * 0.15),
    "slope": ([below(20.0, HALF)], 1.0, 0.5)}
BALL = Collider("/ball", Sphere(0.3), Motion.at_place(HALF))


@pytest.mark.parametrize(("name", "n"), [("walls", (20, 20)), ("turned", (20, 20)), ("slope", (20, 20)), ("walls", (10,) * 3),
                                         ("slope", (10,) * 3)])
def test_obstacles_take_their_volume(name, n):
    """To 4 % of two layers of cells; one that counted as liquid would be 100 %."""
    colliders, top, volume = CASES[name]
    fill = [(0,) * len(n), (1.0, top, *(1.0,) * (len(n) - 2))]
    scene = tank(n, fill, cell=1.0 / n[0], frames=1)
    scene.colliders += colliders
    sim = Simulation(scene, device="cpu")
    sim.step()
    found = sim.indicators()["liquid_volume"] * (n[0] if len(n) == 2 else 1.0)
    assert abs(found - volume) < 0.04 * 2.0 / n[0]
    assert not sim.warnings


def test_the_volume_about_a_ball_converges():
    """4/3 pi r^3 less; half as large cells have a quarter of the error, or less."""
    errors = []
    for n in (10, 20):
        scene = tank((n, n, n), [(0, 0, 0), (1, 1, 1)], cell=1.0 / n, frames=1, gravity=(0, 0, 0))
        scene.colliders.append(BALL)
        sim = Simulation(scene, device="cpu")
        sim.step()
        errors.append(abs(sim.indicators()["liquid_volume"] - 1.0 + 4.0 / 3.0 * np.pi * 0.027))
    assert errors[0] < 0.01 and errors[1] < 0.35 * errors[0]


def test_a_ball_that_moves_through_a_pool_changes_no_volume():
    scene = tank((24, 24), [(0, 0), (1, 0.5)], cell=1.0 / 24.0, frames=12)
    places = np.tile(np.eye(4), (2, 1, 1))
    places[:, :2, 3] = (0.3, 0.1), (0.6, 0.3)
    scene.colliders.append(Collider("/ball", Sphere(0.11), Motion(np.array([0.0, 0.5]), places)))
    sim, whole = Simulation(scene, device="cpu"), 0.5 - np.pi * 0.11 ** 2
    for _ in range(12):
        sim.step()
        assert sim.indicators()["liquid_volume"] * 24.0 == pytest.approx(whole, rel=0.02)
    assert not sim.warnings


# sources

def poured(wall: Collider | None = None, side: str = "closed", frames: int = 48, **more) -> Simulation:
    """A flat box of 16 x 16 cells, and a tap of 2 m/s in its left half."""
    cell = 1.0 / 32.0
    scene = Scene(fps=24, frames=frames)
    sides = ("closed",) * 3 + (side,) + ("closed",) * 2
    scene.add(Liquid("/tank", (0, 0, 0), (0.5, 0.5, cell), cell, sides=sides))
    scene.add(LiquidSource("/tap", Box((2 * cell, 2 * cell, cell)), Motion.at_place((0.125, 0.4, 0)), role="source",
                           velocity=(0, -2, 0), **more))
    scene.colliders += [wall] if wall else []
    return Simulation(scene, device="cpu")


def run(sim: Simulation, frames: int) -> list[float]:
    found = []
    for _ in range(frames):
        sim.step()
        found.append(sim.indicators()["liquid_particles"])
    return found


def stops(sim: Simulation) -> bool:
    return any("/tap stopped" in str(w) for w in sim.warnings)


def test_a_tap_fills_a_closed_box_and_stops():
    """Four particles a cell, and one warning."""
    sim = poured()
    counts = run(sim, 48)
    assert max(counts) == counts[-1] == 1024 and stops(sim) and len(sim.warnings) == 1
    assert sim.indicators()["liquid_volume"] == pytest.approx(0.25 / 32.0, rel=1e-3)


def test_a_tap_behind_a_wall_fills_its_part_alone():
    """A wall of two cells from 7 to 9 leaves 7 x 16 cells to the left."""
    wall = Collider("/wall", Box((1.0 / 32.0, 1.0, 1.0)), Motion.at_place((0.25, 0.25, 0.0)))
    sim = poured(wall, side="open")
    assert run(sim, 40)[-1] > 1024 * 7 / 16 * 0.5 and not stops(sim)          # goes over the wall's top, which is open
    sim = poured(wall)
    assert run(sim, 40)[-1] == 1024 * 7 / 16 and stops(sim)


def test_a_full_box_takes_what_a_sink_makes_room_for():
    """The sum of what is there never passes what fits, and the tap goes on."""
    sim = poured()
    cell = 1.0 / 32.0
    sim.scene.add(LiquidSource("/drain", Box((2 * cell, cell, cell)), Motion.at_place((0.4, cell, 0)), role="sink",
                               strength=Curve(np.array([0.0, 1.5, 1.51]), np.array([0.0, 0.0, 1.0]))))
    sim = Simulation(sim.scene, device="cpu")
    counts = run(sim, 56)
    assert max(counts) <= 1024 and counts[35] == 1024
    ids = sim.plan.method("liquid").particles(0)["id"]
    assert ids.max() > 1100 and counts[-1] > 900


def test_a_tap_within_an_obstacle_gives_nothing():
    """A block of 12 cells about a tap of 4: no part of it is open."""
    block = Collider("/block", Box((6.0 / 32.0, 6.0 / 32.0, 1.0)), Motion.at_place((0.125, 0.4, 0.0)))
    sim = poured(block)
    assert run(sim, 4)[-1] == 0 and not stops(sim)


# what a frame says

@pytest.mark.parametrize("keeps", [True, False])
def test_volume_that_is_lost_is_told_with_its_setting(keeps):
    """A tank that falls over itself keeps its volume; with keepVolume off it does not, and the warning names that."""
    sim = Simulation(tank((32, 24), [(0, 0), (0.3, 0.5)], volume=keeps, frames=24), device="cpu")
    run(sim, 24)
    said = [str(w) for w in sim.warnings]
    assert len(said) == 1 - keeps and all("/tank" in w and "lost" in w and "wsim:liquid:keepVolume 1" in w for w in said)


def test_liquid_that_walls_crush_is_told():
    """A piston leaves 0.3 m^2 to 0.5 m^2 of it: 40 % are lost."""
    scene = tank((32, 16), [(0, 0), (1, 0.25)], frames=24)
    places = np.tile(np.eye(4), (2, 1, 1))
    places[:, :2, 3] = (-0.6, 0.25), (0.2, 0.25)
    scene.colliders.append(Collider("/piston", Box((0.5, 0.6, 1.0)), Motion(np.array([0.0, 1.0]), places)))
    sim = Simulation(scene, device="cpu")
    run(sim, 24)
    assert any("lost 4" in str(w) and "room where walls close in" in str(w) for w in sim.warnings)
