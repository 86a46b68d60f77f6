"""The table of colliders: what it answers of every shape that moves, and a method from outside (tests/make/rows/grains)
that lies on colliders by five lines; a shape of one row (tests/make/rows/rounded.py) everywhere."""

import numpy as np
import pytest

from tests.make.physics.contact.collider.table import DT, asked, screw
from tests.make.rows.grains import ROW as GRAINS
from tests.make.rows.grains.objects import Grains
from tests.make.rows.rounded import ROW, Rounded
from wsim.physics.contact.collider.table import ColliderTable
from wsim.physics.fluid.liquid.objects import Liquid, LiquidSource
from wsim.physics.fluid.objects import Fluid
from wsim.physics.rigid.objects import Body
from wsim.physics.rods.objects import Rods
from wsim.scene import Collider, Motion, Scene, Sphere, methods, shapes, solids
from wsim.scene.fabric import Fabric
from wsim.scene.solids import Box, Capsule, Cone, Cylinder, Plane
from wsim.simulation.simulation import Simulation

MORE = [Plane(), Sphere(0.3), Box((0.3, 0.2, 0.1)), Capsule(0.2, 0.3), Cylinder(0.3, 0.2), Cone(0.3, 0.4),
        Rounded(0.3, 0.2, 0.05)]


@pytest.fixture(autouse=True)
def rows(monkeypatch):
    monkeypatch.setattr(solids, "SOLIDS", [*solids.SOLIDS, ROW])
    monkeypatch.setattr(methods, "METHODS", [*methods.METHODS, GRAINS])
    for module in ("wsim.simulation.plan", "wsim.simulation.methods"):
        monkeypatch.setattr(f"{module}.METHODS", methods.METHODS)


@pytest.mark.parametrize(("precision", "within"), [("float32", 3e-6), ("float64", 1e-13)])
def test_every_shape_that_moves_is_where_its_motion_has_it_within_a_frame(precision, within):
    """Distances are those of the host at the same time, the nearest place is on the surface; the screw's velocity is exact."""
    times = np.linspace(0.0, DT, 2)
    scene = Scene(fps=1.0 / DT, frames=1)
    scene.colliders = [Collider(f"/c{k}", s, Motion(times, np.array([screw(t) for t in times]))) for k, s in enumerate(MORE)]
    scene.add(Grains("/grain", np.zeros((1, 3))))
    model = Simulation(scene, device="cpu", precision=precision).model
    table = ColliderTable(model, scene.colliders)
    table.pose(0.0, DT)
    y = np.random.default_rng(1).uniform(-1.0, 1.0, (len(MORE), 200, 3)) + screw(0.01)[:3, 3]
    M, real = screw(0.3 * DT), model.real
    phi, n, p, v = asked(table, y, 0.3 * DT, real)
    for k, shape in enumerate(MORE):
        q = (y[k] - M[:3, 3]) @ M[:3, :3]
        host = solids.shape_row(shape).distance(shape, q)
        inside = host < 0.0
        assert np.abs(phi[k] - host)[inside].max(initial=0.0) < 10 * within and (phi[k] > host - 10 * within).all()
        assert np.abs(y[k] - phi[k][:, None] * n[k] - p[k]).max() < within
        assert np.abs(solids.shape_row(shape).distance(shape, (p[k] - M[:3, 3]) @ M[:3, :3])).max() < 10 * within
    exact = np.cross([0.0, 0.0, 3.0], y) + [0.0, 0.0, 0.2]
    assert np.abs(v - exact).max() < 300 * within


# a method from outside

def lying(places, collider: Collider, frames: int, **more) -> tuple[Simulation, np.ndarray]:
    scene = Scene(fps=60.0, frames=frames, substeps=4, up="Z", gravity=(0.0, 0.0, -9.81))
    scene.add(Grains("/grains", places, **more))
    scene.colliders.append(collider)
    sim = Simulation(scene, device="cpu")
    for _ in range(frames):
        sim.step()
    return sim, sim.state.parts["loose_grains"].arrays["x"].numpy()


def test_a_grain_on_a_sphere_stays_where_friction_holds_it_and_slides_off_beyond():
    """mu = 0.5 holds to atan 0.5 = 26.6 degrees from the top."""
    angles = np.radians([0.0, 10.0, 24.0, 29.0, 40.0])
    turn = np.linspace(0.0, 2.0 * np.pi, 5, endpoint=False)
    places = 0.52 * np.stack([np.sin(angles) * np.cos(turn), np.sin(angles) * np.sin(turn), np.cos(angles)], 1)
    _, x = lying(places, Collider("/ball", Sphere(0.5)), 60)
    gone = np.linalg.norm(x - places, axis=1)
    assert gone[:3].max() < 1e-4 and gone[3:].min() > 0.1
    assert np.linalg.norm(x, axis=1).min() > 0.52 - 1e-4


def test_grains_lie_on_a_shape_of_one_row_and_rise_with_it():
    """At 0.5 m/s, which gravity does not part: a heap of 3 x 3 x 2 on a rounded cylinder keeps its radius away."""
    lattice = np.array([(x, y, z) for x in (-0.05, 0.0, 0.05) for y in (-0.05, 0.0, 0.05) for z in (0.13, 0.18)])
    M = np.tile(np.eye(4), (2, 1, 1))
    M[1, 2, 3] = 0.25
    shape = Rounded(0.3, 0.1, 0.04)
    _, x = lying(lattice, Collider("/pillar", shape, Motion(np.array([0.0, 0.5]), M)), 30)
    away = solids.shape_row(shape).distance(shape, x - [0.0, 0.0, 0.25])
    assert away.min() > 0.02 - 1e-3 and (x[:, 2] > 0.25 + 0.1).all()


PILLAR = Rounded(0.3, 0.2, 0.05)                # its top is 0.4 m high


def met(**more) -> Scene:
    scene = Scene(fps=24.0, frames=12, up="Z", gravity=(0.0, 0.0, -9.81), **more)
    scene.collider("/pillar", PILLAR, at=(0.5, 0.5, 0.2))
    return scene


def away(x: np.ndarray) -> np.ndarray:
    """Signed distance of places to it [m]."""
    return solids.shape_row(PILLAR).distance(PILLAR, x - [0.5, 0.5, 0.2])


@pytest.mark.slow
def test_strands_lie_on_a_shape_of_one_row():
    scene = met()
    scene.add(Rods("/hair", np.array([(x, 0.5, 0.42) for x in np.linspace(0.3, 0.7, 11)]), [11], [0.01]))
    sim = Simulation(scene, device="cpu")
    sim.run(12)
    assert sim.positions("/hair")[3:8, 2] == pytest.approx(0.405, abs=2e-3) and away(sim.positions("/hair")).min() > 0.004


def test_smoke_has_a_shape_of_one_row_where_it_is():
    """At the nodes of its grid, within what tells an exact distance from a bound outside."""
    scene = met()
    scene.add(Fluid("/air", (0, 0, 0), (1, 1, 1), 0.1))
    sim = Simulation(scene, device="cpu")
    sim.step()
    obstacles = sim.plan.method("fluid").domains[0].obstacles
    nodes = 0.1 * np.stack(np.meshgrid(*[np.arange(11)] * 3, indexing="ij"), -1).reshape(-1, 3)
    phi, exact = obstacles.phi.numpy(), away(nodes)
    assert np.abs(phi - exact)[exact < 0.0].max() < 1e-6 and (phi[exact > 1e-6] > 0.0).all()


@pytest.mark.slow
def test_bodies_and_liquids_meet_a_shape_of_one_row():
    """A ball rests on its top, no liquid comes into it."""
    scene = met()
    scene.add(Body("/ball", [Collider("/ball/shape", Sphere(0.1))], Motion.at_place((0.5, 0.5, 0.51))))
    sim = Simulation(scene, device="cpu")
    sim.run(12)
    assert sim.poses("/ball")["/ball"][2, 3] == pytest.approx(0.5, abs=2e-3)
    scene.objects.pop("Body")
    scene.add(Liquid("/tank", (0, 0, 0), (1, 1, 1), 0.1))
    scene.add(LiquidSource("/water", Box((0.5, 0.5, 0.2)), Motion.at_place((0.5, 0.5, 0.6))))
    sim = Simulation(scene, device="cpu")
    sim.run(12)
    x = sim.plan.method("liquid").particles(0)["x"]
    assert len(x) > 1000 and away(x).min() > -0.02


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["xpbd", "implicit"])
def test_a_cloth_that_meets_itself_lies_on_a_shape_of_one_row(solver):
    """Where its edge hangs over the rim, nothing is nearer than the thickness of both."""
    scene = met(solver=solver)
    cloth = scene.cloth("/cloth", *shapes.sheet(0.8, 0.8, 12, 12, horizontal=True, up="Z", at=(0.5, 0.5, 0.415)),
                        material=Fabric(stretch=200.0, bend=1e-4), self_collision=True)
    scene.colliders[0].thickness = 0.01
    sim = Simulation(scene, device="cpu")
    sim.run(12)
    x = sim.positions("/cloth")
    assert away(x).min() > 0.99 * (0.01 + 0.5 * cloth.material.thickness) and x[:, 2].min() < 0.35
