"""A method with a carrier of its own (tests/make/balls) exchanges impulses with the points of a cloth through wsim's pairs."""

import subprocess
import sys

import numpy as np
import pytest

from tests.make.balls import ROW
from tests.make.balls.objects import Ball
from wsim.scene import Scene, methods, shapes
from wsim.simulation.simulation import Simulation

CPU = {"device": "cpu"}
SCHEMES = [("xpbd", "backward_euler", 4), ("xpbd", "bdf2", 8), ("implicit", "backward_euler", 1), ("implicit", "bdf2", 1),
           ("implicit", "implicit_midpoint", 1), ("explicit", "leapfrog", 1), ("explicit", "rk4", 1)]


@pytest.fixture(autouse=True)
def row(monkeypatch):
    monkeypatch.setattr(methods, "METHODS", [*methods.METHODS, ROW])
    for module in ("wsim.simulation.plan", "wsim.simulation.methods"):
        monkeypatch.setattr(f"{module}.METHODS", methods.METHODS)


def thrown(solver: str = "xpbd", integrator: str = "backward_euler", iterations: int = 4, far: float = 0.0, **more) -> Scene:
    """Two balls fly into a free sheet without gravity."""
    scene = Scene(fps=60.0, frames=8, substeps=20 if solver == "explicit" else 8, iterations=iterations, solver=solver,
                  integrator=integrator, gravity=(0.0, 0.0, 0.0), up="Z")
    points, counts, indices = shapes.sheet(0.6, 0.6, 6, 6, horizontal=True, up="Z")
    scene.cloth("/World/cloth", points + (far, 0.0, 0.0), counts, indices)
    heavy, light = ({"mass": 0.3, "radius": 0.15} | more), ({"mass": 0.02, "radius": 0.1} | more)
    scene.add(Ball("/World/heavy", (far + 0.12, 0.11, 0.2), (0.1, 0.2, -3.0), **heavy))
    scene.add(Ball("/World/light", (far - 0.15, -0.12, -0.15), (0.0, -0.1, 4.0), **light))
    return scene


def momentum(sim: Simulation) -> np.ndarray:
    """Of the cloth and of the balls [kg m/s], (2, 3); of leapfrog at the half step, which carries it from frame to frame."""
    balls = sim.scene.things("Ball")
    of_balls = np.array([b.mass for b in balls]) @ sim.state.parts["balls"].arrays["v"].numpy()
    velocity = sim.state.b if sim.state.has("b") and sim.frame else sim.state.v
    return np.array([sim.model.stack("masses") @ velocity.numpy(), of_balls])


@pytest.mark.parametrize("scheme", SCHEMES, ids=lambda scheme: "-".join(map(str, scheme[:2])))
def test_momentum_of_a_toy_carrier_and_a_cloth_is_kept(scheme):
    """To 1e-12 in float64 whatever integrates the cloth; the balls' own integrator is symplectic Euler. With friction and a
    rebound. The cloth's elements keep momentum by themselves, and a linear solver to its residual."""
    sim = Simulation(thrown(*scheme, friction=(0.5, 0.4), restitution=0.3), precision="float64", **CPU)
    before = momentum(sim)
    sim.run(8)
    after = momentum(sim)
    assert np.abs(after - before).max() > 0.05, "nothing was exchanged"
    assert np.abs(after.sum(axis=0) - before.sum(axis=0)).max() < 1e-12


@pytest.mark.parametrize("warm", [False, True])
def test_a_list_that_was_too_short_grows_and_the_frame_is_repeated_to_the_bit(warm, monkeypatch):
    """With the impulses of the last substep too, which are put back."""
    from tests.make.balls import method
    monkeypatch.setattr(method, "WARM", warm)
    ends = []
    for room in (8, 500):
        monkeypatch.setattr(method, "ROOM", room)
        sim = Simulation(thrown(), **CPU)
        sim.run(8)
        ends.append((sim.positions(), sim.state.parts["balls"].arrays["x"].numpy()))
        said = [w for w in sim.repeats if "pairs were in contact" in w]
        assert bool(said) == (room == 8) and all("the frame was repeated" in w for w in said)
        assert ("pairs of balls" in sim.state.parts) == warm
    assert np.array_equal(ends[0][0], ends[1][0]) and np.array_equal(ends[0][1], ends[1][1])


def test_points_are_kept_out_of_the_balls():
    scene = thrown("xpbd", "backward_euler", 8)
    sim = Simulation(scene, precision="float64", **CPU)
    reach = float(sim.model.stack("reach")[0])
    for _ in range(8):
        sim.step()
        places = sim.positions()
        for ball, x in zip(scene.things("Ball"), sim.state.parts["balls"].arrays["x"].numpy(), strict=True):
            assert np.linalg.norm(places - x, axis=1).min() > 0.98 * (ball.radius + reach)


def test_keys_and_impulses_do_not_know_where_the_scene_stands():
    """A whole number of metres away, which the origin of an object takes exactly; the balls' places are rounded in float64."""
    found = []
    for far in (0.0, 512.0):
        sim = Simulation(thrown(far=far), precision="float64", **CPU)
        for _ in range(3):
            sim.step()
        pairs = next(m for m in sim.plan.methods if m.name == "balls").pairs.list
        count = int(pairs.count.numpy()[0])
        found.append((pairs.key_a.numpy()[:count], pairs.key_b.numpy()[:count], pairs.total.numpy()[:count]))
    assert len(found[0][0]) > 4
    assert np.array_equal(found[0][0], found[1][0]) and np.array_equal(found[0][1], found[1][1])
    assert np.abs(found[0][2] - found[1][2]).max() < 1e-9 * np.abs(found[0][2]).max()


def test_a_scene_without_pairs_imports_and_compiles_nothing_of_carriers():
    code = """if True:
        import sys
        from wsim.scene import Scene, Sphere, shapes
        from wsim.simulation.simulation import Simulation
        import warp as wp
        scene = Scene(fps=24.0, frames=2, substeps=4, solver="xpbd", up="Z")
        scene.cloth("/cloth", *shapes.sheet(0.5, 0.5, 4, 4, horizontal=True, up="Z"))
        scene.collider("/ball", Sphere(0.1))
        sim = Simulation(scene, device="cpu")
        sim.run(2)
        kernels = set(wp.get_module(sim.model.module).kernels)
        print(sorted(name for name in sys.modules if "carrier" in name), [k for k in kernels if "exchange" in str(k)])
    """
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=".")
    assert out.stdout.splitlines()[-1] == "[] []"


def test_sdirk3_is_refused_by_name():
    from wsim.scene import SceneError
    sim = Simulation(thrown("implicit", "sdirk3", 1), **CPU)
    with pytest.raises(SceneError, match="sdirk3 has stages at times of its own"):
        sim.run(1)
