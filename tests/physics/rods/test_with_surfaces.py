"""Rods against cloth and soft bodies: they never pass through, keep momentum, stick and slip, and bear what is pulled over."""

from dataclasses import replace

import numpy as np
import pytest

import wsim
from tests.make.physics.rods.with_surfaces import CLOTH, MU, THICK, G, crossed, rope, sheet, thrown
from tests.physics.contact.selfcontact.rig import solvers
from wsim.cli.run import prepare_recorded_run
from wsim.physics.rods.objects import Rods
from wsim.scene import Pin, Plane, Scene, shapes
from wsim.simulation.simulation import Simulation

MEETING = ("xpbd", "xpbd bdf2", "newton", "newton bdf2", "leapfrog", "rk4")


@pytest.mark.parametrize("solver", solvers(*MEETING))
@pytest.mark.parametrize("seed", [0, 1])
def test_a_rope_that_is_thrown_at_a_cloth_never_passes(solver, seed):
    """At 10 m/s: no edge of it has a point in common with a triangle, in any substep; without contact it passes."""
    each = {"fps": 60.0 * solver["substeps"]} | solver | {"substeps": 1}
    sim, free = (Simulation(thrown(seed, 10.0, on, **each), device="cpu") for on in (True, False))
    passed = 0
    for _ in range(10 * solver["substeps"]):
        sim.step()
        free.step()
        assert crossed(sim) == 0
        passed = max(passed, crossed(free))
    found = sim.plan.method("selfcontact").indicators(None, None)
    assert passed > 0 and found["held"] == 0


@pytest.mark.parametrize("solver", solvers(*MEETING))
def test_a_rope_and_a_cloth_that_collide_keep_their_momentum(solver):
    """Sum of m v, to 1e-6 of the sum of m |v|, in every frame while they touch. By BDF2, whose velocities are sums of two
    before, float32 rounds by 1.1e-6 in 12 frames: float64 is held to what it rounds by."""
    precision = "float64" if solver["integrator"] == "bdf2" else "float32"
    scene = thrown(3, 5.0, **solver)
    scene.gravity, scene.pins = (0.0, 0.0, 0.0), []
    sim = Simulation(scene, device="cpu", precision=precision)
    rods, m = sim.plan.method("rods"), sim.model.bodies[0].masses
    mass = rods.table.values["m"].T.ravel()

    def momentum() -> np.ndarray:
        return mass @ rods.points(0)[1] + m @ np.asarray(sim.velocities("/cloth"), np.float64)
    first = momentum()
    scale = float(mass @ np.linalg.norm(rods.points(0)[1], axis=1))
    for _ in range(12):
        sim.step()
        assert np.abs(momentum() - first).max() < {"float32": 1e-6, "float64": 1e-11}[precision] * scale
    assert rods.points(0)[1][:, 1].mean() > -4.5                                # they met


def lying(degrees: float, frames: int, **solver) -> np.ndarray:
    """How far along x points of a rope have gone that lies on a tilted cloth [m], after so many frames."""
    a, t = np.radians(degrees), np.linspace(-0.05, 0.05, 11)
    scene = Scene(gravity=(G * np.sin(a), -G * np.cos(a), 0.0), **({"fps": 60.0} | solver))
    points = sheet(scene, 0.3, 10, held=False)
    scene.pins.append(Pin("/pin", "/cloth", range(len(points) - 1)))
    x = np.stack([0.3 * t, 0.5 * (THICK + CLOTH.thickness) + 0.0 * t, t], axis=1)
    rope(scene, x)
    sim = Simulation(scene, device="cpu")
    sim.run(frames)
    now = sim.plan.method("rods").points(0)[0]
    assert np.abs(now[:, 1] - x[:, 1]).max() < 0.05 * THICK
    return (now - x)[:, 0]


@pytest.mark.parametrize("solver", solvers(*MEETING))
def test_a_rope_on_a_cloth_sticks_and_slips_at_the_critical_angle(solver):
    """Half a degree below and above atan(mu); above, it slides as a block does."""
    critical, time = np.degrees(np.arctan(MU)), 20 / 60.0

    def block(angle: float) -> float:
        a = np.radians(angle)
        return 0.5 * G * (np.sin(a) - MU * np.cos(a)) * time**2
    below, above = lying(critical - 0.5, 20, **solver), lying(critical + 0.5, 20, **solver)
    assert np.abs(below).max() < block(critical + 0.01)
    assert above == pytest.approx(block(critical + 0.5), rel=0.05)


@pytest.mark.parametrize("solver", solvers(*MEETING))
def test_a_ridge_bears_a_rope_and_stretches_it_no_more_than_its_weight_does(solver):
    """A rope over the ridge of a tent: what each substep pushes is that of a few points, which bear 40; solved without it, an
    edge at the ridge was stretched by 2.6 %, 6 times what its weight does. It falls by 12 mm at first: a wave of strain v / c,
    1.5 %, of which BDF2 takes nothing and drag leaves 0.2 % behind a second; by the others it is over in 10 frames."""
    scene = Scene(gravity=(0.0, -G, 0.0), air_drag=4.0, fps=60.0, **solver)
    points = sheet(scene, 0.2, 10, held=False)
    scene.cloths[0].points[:, 1] = -np.abs(points[:, 0])
    scene.pins.append(Pin("/pin", "/cloth", range(len(points) - 1)))
    t = np.linspace(-0.4, 0.4, 41)
    x = np.stack([t, 0.012 - 0.9 * np.abs(t), 0.0 * t + 0.003], axis=1) / np.array([np.sqrt(1.81), np.sqrt(1.81), 1.0])
    rods = rope(scene, x)
    sim = Simulation(scene, device="cpu")
    method, strain, force = sim.plan.method("rods"), [], []
    for _ in range(90):
        sim.step()
        strain.append(method.indicators(None, None)["rod_strain"])
        force.append(method.among.company.force.numpy().sum(axis=(0, 1))[1])
    weight = G * method.table.values["m"].sum()
    own = 0.5 * weight / (rods.young * 0.25 * np.pi * THICK**2)
    assert max(strain[60 if solver["integrator"] == "bdf2" else 10:]) < 1.5 * own
    assert np.mean(force[-30:]) == pytest.approx(weight, rel=0.05)
    assert crossed(sim) == 0


def test_ropes_are_proven_against_each_other_as_well():
    """Two ropes that a cloth is thrown at: no pair of any passes, and neither does one of the ropes."""
    scene = thrown(2, 8.0, **solvers("xpbd")[0].values[0])
    first = scene.things("Rods")[0]
    scene.objects.pop("Rods")
    x = np.concatenate([first.points, first.points[:, [2, 1, 0]] + (0.0, 0.02, 0.0)])
    scene.add(Rods("/ropes", x, [21, 21], THICK, young=1e6, velocities=np.tile([0.0, -8.0, 0.0], (42, 1)), self_collision=True))
    sim = Simulation(scene, device="cpu")
    for _ in range(12):
        sim.step()
        assert crossed(sim) == 0
    found = sim.plan.method("selfcontact").near.pairs
    ids, first = found.ids.numpy()[:int(found.count.numpy()[0])], sim.model.points
    both = (ids[:, 0] >= first) & (ids[:, 2] >= first)
    assert both.any() and not found.keep.numpy()[:len(ids)][both].any()


def test_results_are_the_same_from_run_to_run_and_in_worlds():
    found = []
    for worlds in (1, 1, 2):
        sim = Simulation(thrown(2, 6.0, **solvers("newton")[0].values[0]), device="cpu", worlds=worlds)
        sim.run(5)
        rods = sim.plan.method("rods")
        found += [np.concatenate([rods.points(k)[0], sim.positions("/cloth", world=k)]) for k in range(worlds)]
    assert all(np.array_equal(found[0], each) for each in found[1:])


@pytest.mark.parametrize("solver", solvers("newton bdf2"))
def test_nothing_is_read_of_a_pair_that_was_not_looked_at(solver):
    """What lists of pairs held before, here no numbers, changes no bit: of the rope's own, and of those with the cloth."""
    found = []
    for fill in (0.0, np.nan):
        sim = Simulation(thrown(1, 6.0, **solver), device="cpu")
        rods, meeting = sim.plan.method("rods"), sim.plan.method("selfcontact")
        meeting.near.room(20000)
        meeting.settle.room()
        for near in (rods.touching.near, meeting.near):
            for name in ("n", "b", "away", "gap", "least", "push", "past", "keep"):
                array = getattr(near.pairs, name)
                array.assign(np.full_like(array.numpy(), fill))
        sim.run(3)
        assert not any("was room for" in text for text in sim.repeats)
        found.append(np.concatenate([rods.points(0)[0], sim.positions("/cloth")]))
    assert np.array_equal(*found) and np.isfinite(found[0]).all()


def test_bdf2_that_gives_way_keeps_momentum_as_well():
    """A stiff cloth whose sides shear apart, by 13 Newton steps of 1/600 s: the residual is missed where the rope has met it,
    and both forget what the contact has changed of their velocities."""
    solver = solvers("newton bdf2")[0].values[0]
    scene = thrown(3, 5.0, **solver | {"fps": 600.0, "substeps": 1, "iterations": 1})
    scene.gravity, scene.pins, cloth = (0.0, 0.0, 0.0), [], scene.cloths[0]
    scene.things("Rods")[0].points[:, 1] -= 0.035
    x = np.asarray(cloth.points)
    cloth.material = replace(cloth.material, stretch=5e6, shear=1e6)
    cloth.velocities = 100.0 * x[:, :1] * np.sign(x[:, 2:]) * (1.0, 0.0, 0.0)
    sim = Simulation(scene, device="cpu")
    rods, m = sim.plan.method("rods"), sim.model.bodies[0].masses
    mass = rods.table.values["m"].T.ravel()
    first, size = mass @ rods.points(0)[1], mass @ np.abs(rods.points(0)[1])
    before: list[np.ndarray] = []                                               # of the rope, until it gives way
    told: list[str] = []
    for _ in range(9):
        before += [mass @ rods.points(0)[1]] * (not told)
        sim.step()
        now = mass @ rods.points(0)[1] + m @ np.asarray(sim.velocities("/cloth"), np.float64)
        assert np.abs(now - first).max() < 1e-6 * size.sum()
        told = [text for text in sim.warnings if "backward Euler from here on" in text]
    assert told and np.abs(before[-1] - before[0]).max() > 0.01 * size.sum()
    assert rods.points(0)[1][:, 1].mean() > -4.0                                # they met


def test_nothing_of_it_is_built_where_one_side_says_nothing():
    for on in (True, False):
        scene = thrown(0, 1.0, not on, **solvers("xpbd")[0].values[0])
        scene.cloths[0].self_collision = on
        sim = Simulation(scene, device="cpu")
        assert sim.plan.method("rods").among is None and not any("among" in name for name in sim.model.modules)
        assert any("strands pass through /cloth" in text for text in sim.warnings)


@pytest.mark.parametrize("solver", ["explicit", "implicit"])
def test_strands_that_fall_on_a_soft_body_lie_on_it(solver):
    """Three strands on a block that stands on a floor, which they meet as well: no edge is in the block, in any frame."""
    scene = Scene(gravity=(0.0, -G, 0.0), fps=24.0, substeps=8, iterations=4, solver=solver)
    points, tets = shapes.block((0.2, 0.2, 0.2), (3, 3, 3))
    scene.soft("/block", np.array(points) + (0.0, 0.1, 0.0), tets, self_collision=True)
    scene.collider("/floor", Plane("Y"))
    t = np.linspace(-0.25, 0.25, 21)
    x = np.concatenate([np.stack([t, 0.23 + 0.01 * k + 0.0 * t, 0.05 * (k - 1) + 0.1 * t * k], axis=1) for k in range(3)])
    scene.add(Rods("/strands", x, [21, 21, 21], THICK, young=1e6, self_collision=True))
    sim = Simulation(scene, device="cpu")
    for _ in range(16):
        sim.step()
        assert crossed(sim) == 0
    now = sim.plan.method("rods").points(0)[0]
    found = sim.plan.method("selfcontact").indicators(None, None)
    assert found["surface_contacts"] > 0 and found["held"] == 0
    assert now[:, 1].min() > 0.4 * THICK                                        # the floor holds them too
    assert (now.reshape(3, 21, 3)[:, 10, 1] > 0.15).all()                       # their middles are on the block


def test_a_rope_that_starts_through_a_cloth_is_told_with_its_place():
    scene = thrown(0, 0.0, **solvers("newton")[0].values[0])
    rods = scene.things("Rods")[0]
    rods.points[:, 1] = 0.1 * (rods.points[:, 0] - rods.points[:, 0].mean())
    sim = Simulation(scene, device="cpu")
    before = crossed(sim)
    sim.run(3)
    told = f"{before} edges of rods go through triangles where they start, such as /rope and /cloth at ("
    assert before > 0 and any(told in text for text in sim.warnings)
    assert np.isfinite(sim.plan.method("rods").points(0)[0]).all()


def test_what_is_written_a_kilometre_away_does_not_cross_either():
    each = solvers("newton")[0].values[0]
    scene = thrown(0, 10.0, **each | {"fps": 60.0 * each["substeps"], "substeps": 1})
    rods = scene.things("Rods")[0]
    for thing in (scene.cloths[0], rods):
        thing.points = thing.points + (0.3, 700.0, -1000.0)
    sim = Simulation(scene, device="cpu")
    for _ in range(60):
        sim.step()
        assert crossed(sim) == 0
    found = sim.plan.method("selfcontact").indicators(None, None)
    assert found["surface_contacts"] > 0 and found["held"] == 0


def test_a_run_goes_on_from_its_file_to_the_bit(tmp_path):
    path, first, second = (str(tmp_path / name) for name in ("ropes.usda", "a.usdc", "b.usdc"))
    wsim.save(thrown(1, 6.0, **solvers("newton")[0].values[0]), path)

    def run(output: str, frames: int, restart: str | None = None) -> tuple[np.ndarray, np.ndarray]:
        job = prepare_recorded_run(replace(wsim.load(path), frames=frames), output, lambda s: Simulation(s, device="cpu"),
                                   restart=restart)
        job.frames()
        return job.simulation.plan.method("rods").points(0)[0], job.simulation.positions("/cloth")
    whole = run(first, 8)
    run(second, 5)
    assert all(np.array_equal(a, b) for a, b in zip(whole, run(str(tmp_path / "c.usdc"), 8, second), strict=True))
