"""What stands and what falls, where statics says so: arches of stones, leaning cards, a house of cards."""

import numpy as np
import pytest

from tests.make.physics.rigid.contact import UP, G, Seen
from tests.make.physics.rigid.standing.statics import frame, stone
from tests.physics.rigid.pairs import WHERE
from wsim.geometry.rotation import axis_rotation_matrix
from wsim.physics.rigid.objects import Body
from wsim.scene import Box, Capsule, Collider, Plane, Scene
from wsim.scene.curve import Motion
from wsim.simulation.simulation import Simulation


def stage(bodies, rub: float, substeps: int = 16, sweeps: int = 4, precision: str = "float32") -> Simulation:
    scene = Scene(gravity=(0.0, -G, 0.0), fps=60.0, substeps=substeps, iterations=sweeps)
    scene.collider("/ground", Plane(), motion=Motion.still(UP), static_friction=rub, dynamic_friction=rub)
    for body in bodies:
        scene.add(body)
    return Simulation(scene, **WHERE, precision=precision)


def arch(thickness: float, stones: int = 17, rub: float = 0.8) -> list[Body]:
    """Half a ring of mean radius 1 on the ground, its joints radial."""
    angle = np.pi / stones
    bodies = []
    for k in range(stones):
        turn = 0.5 * np.pi - (k + 0.5) * angle
        R = axis_rotation_matrix(np.array([0.0, 0.0, 1.0]), turn)
        shape = Collider(f"/stone{k}/shape", stone(thickness, angle), static_friction=rub, dynamic_friction=rub)
        bodies.append(Body(f"/stone{k}", [shape], frame(R, R @ (0.0, 1.0, 0.0))))
    return bodies


@pytest.mark.parametrize("thickness, stands", [(0.16, True), (0.12, True), (0.09, False)])
def test_an_arch_stands_where_it_is_thicker_than_milankovitch_says(thickness, stands):
    """Half a ring with radial joints needs t / R = .1075 (Milankovitch 1907; Heyman 1969 has .106), and friction of .31."""
    sim = stage(arch(thickness), 0.8)
    sim.run(300)
    crown = Seen(sim).at("/stone8")[1]
    assert (crown > 0.99) == stands and (stands or crown < 0.5)
    if stands:
        assert np.abs(Seen(sim).v).max() < 1e-3


LENGTH, ROUND, LEAN = 1.0, 0.02, np.radians(30.0)


def card(path: str, side: float, rub: float) -> Body:
    """Leans by LEAN towards x = 0 from x of the sign -side; two rounds, of which the lower stands on the ground."""
    R = axis_rotation_matrix(np.array([0.0, 0.0, 1.0]), -side * LEAN)
    ends = [Collider(f"{path}/{name}", Capsule(ROUND, 0.3), Motion.at_place((0.0, y, 0.0)), static_friction=rub,
                     dynamic_friction=rub) for name, y in (("foot", -0.5 * LENGTH), ("top", 0.5 * LENGTH))]
    foot = np.array([-side * (LENGTH * np.sin(LEAN) + ROUND), ROUND, 0.0])
    return Body(path, ends, frame(R, foot + R @ (0.0, 0.5 * LENGTH, 0.0)), mass=1.0, center=np.zeros(3),
                inertia=(0.1, 0.05, 0.1))


@pytest.mark.parametrize("part, stands", [(1.05, True), (0.95, False)])
def test_two_cards_that_lean_on_each_other_stand_where_friction_is_enough(part, stands):
    """The push H at the top and the friction of a foot are equal; moments about the foot's round, of radius r:
    m g L / 2 sin a = H (L cos a + r), and the ground bears m g a card: mu = L sin a / (2 (L cos a + r))."""
    critical = 0.5 * LENGTH * np.sin(LEAN) / (LENGTH * np.cos(LEAN) + ROUND)
    sim = stage([card("/left", 1.0, part * critical), card("/right", -1.0, part * critical)], part * critical,
                precision="float64")
    start = Seen(sim).at("/left")[1]
    sim.run(120)
    fallen = start - Seen(sim).at("/left")[1]
    assert (fallen < 1e-3) == stands and (stands or fallen > 0.1)


def house(rub: float) -> list[Body]:
    """Two pairs of leaning cards, one across them, one pair on it; cards of 0.5 x 0.01 x 0.4 m, 20 degrees."""
    long, thin, lean = 0.5, 0.01, np.radians(20.0)
    half = (0.5 * thin, 0.5 * long, 0.2)
    inner = 0.5 * long * np.sin(lean) + 0.5 * thin * np.cos(lean)             # middle of a card to its highest inner edge
    rise = 0.5 * long * np.cos(lean) + 0.5 * thin * np.sin(lean)

    def one(path: str, x: float, y: float, turn: float, size=half) -> Body:
        shape = Collider(f"{path}/shape", Box(size), static_friction=rub, dynamic_friction=rub)
        return Body(path, [shape], frame(axis_rotation_matrix(np.array([0.0, 0.0, 1.0]), turn), (x, y, 0.0)))

    apart = 4.0 * inner + 0.02
    bodies = [one(f"/pair{k}_{s > 0}", x - s * inner, y, -s * lean)
              for k, (x, y) in enumerate([(-0.5 * apart, rise), (0.5 * apart, rise), (0.0, 3.0 * rise + thin)])
              for s in (1.0, -1.0)]
    return [*bodies, one("/roof", 0.0, 2.0 * rise + 0.5 * thin, 0.0, (0.5 * apart + 0.1, 0.5 * thin, 0.2))]


@pytest.mark.parametrize("rub, stands", [(0.6, True), (0.1, False)])
def test_a_house_of_cards_stands_by_friction(rub, stands):
    """Under the roof a card bears its own weight and at least half of what is above: a foot needs a friction of tan(20) / 2 =
    .18 and more, at most tan(20) = .36."""
    sim = stage(house(rub), rub)
    top = Seen(sim).at("/pair2_True")[1]
    sim.run(240)
    fallen = top - Seen(sim).at("/pair2_True")[1]
    assert (fallen < 5e-3) == stands and (stands or fallen > 0.3)
    if stands:
        assert np.abs(Seen(sim).v).max() < 2e-3
