"""Material points and cloth or soft bodies push each other."""

import numpy as np
import pytest

import wsim
from wsim.physics.mpm.objects import Granular, Jelly, Snow

from .test_method import find_method, total_momentum


def whole_momenta(simulation, path):
    """Momentum [kg m/s] and angular momentum [kg m^2/s] of particles and of the points of a body."""
    body = next(b for b in simulation.plan.model.bodies if b.path == path)
    x, v = (a.numpy()[:len(body.masses)] for a in (simulation.state.x, simulation.state.v))
    p, spin = total_momentum(simulation)
    return p + body.masses @ v, spin + body.masses @ np.cross(x + body.origin, v)


def whole_momentum(simulation, path):
    """Momentum of particles and of the points of a body [kg m/s]."""
    return whole_momenta(simulation, path)[0]


def heights_above(cloth, counts, indices, x):
    """Height [m] of places above a sheet that lies more or less flat; what is not above or below it is left out."""
    from wsim.geometry.triangulate import triangulate_polygons
    found = np.full(len(x), np.inf)
    for corners in triangulate_polygons(cloth, counts, indices)[0]:
        a, b, c = cloth[corners]
        M = np.array([b - a, c - a])[:, [0, 2]].T
        uv = np.linalg.solve(M, (x - a)[:, [0, 2]].T)
        on = (uv >= 0).all(axis=0) & (uv.sum(axis=0) <= 1)
        found[on] = np.minimum(found[on], (x - a - uv.T @ np.array([b - a, c - a]))[on, 1])
    return found


@pytest.mark.parametrize("solver", ["explicit", "xpbd", "implicit"])
def test_momentum_stays_when_jelly_hits_a_cloth(solver):
    """Float64; the cloth has a fiftieth of the jelly's mass. Angular momentum relative to the momentum times the radius."""
    scene = wsim.Scene(fps=60, gravity=(0, 0, 0), solver=solver, substeps=20)
    sheet = wsim.shapes.sheet(0.8, 0.8, 12, 12, horizontal=True)
    scene.cloth("/cloth", *sheet, material=wsim.Fabric(density=300.0, stretch=200.0, shear=50.0, bend=1e-4))
    scene.mpm("/jelly", wsim.Sphere(0.12), at=(0.03, 0.2, 0), cell=0.05, velocity=(0.3, -2, 0), material=Jelly(2e4))
    simulation = wsim.Simulation(scene, device="cpu", precision="float64")
    before, spin = whole_momenta(simulation, "/cloth")
    for _ in range(10):
        simulation.step()
        now, turns = whole_momenta(simulation, "/cloth")
        assert np.abs(now - before).max() < 1e-9 * np.abs(before).max()
        assert np.abs(turns - spin).max() < 3e-4 * 0.12 * np.linalg.norm(before)
    assert simulation.positions("/cloth")[:, 1].min() < -0.1
    assert heights_above(simulation.positions("/cloth"), *sheet[1:], find_method(simulation).read_particles(0)["x"]).min() > 0


def test_a_hammock_carries_sand_of_44_times_its_mass():
    """What its pins bear is the weight of the sand and the cloth, and what these gain of momentum; nothing passes."""
    scene = wsim.Scene(fps=60)
    sheet = wsim.shapes.sheet(0.8, 0.6, 16, 12, horizontal=True)
    cloth = scene.cloth("/cloth", *sheet, material=wsim.Fabric(density=300.0, stretch=4000.0, shear=1000.0, bend=1e-3,
                                                               damping=0.006))
    scene.pin("/pins", cloth, np.flatnonzero(abs(abs(sheet[0][:, 0] - sheet[0][:, 0].mean()) - 0.4) < 1e-6))
    scene.mpm("/sand", wsim.Box((0.1, 0.05, 0.1)), at=(0, 0.07, 0), cell=0.05, material=Granular(friction_angle=0.6))
    simulation = wsim.Simulation(scene, device="cpu")
    forces = []
    for frame in range(120):
        simulation.step()
        x = find_method(simulation).read_particles(0)["x"]
        assert heights_above(simulation.positions("/cloth"), *sheet[1:], x).min() > 0
        if frame == 39:
            before = whole_momentum(simulation, "/cloth")
        elif frame >= 40:
            forces.append(simulation.reactions("/pins").reshape(-1, 3).sum(axis=0))
    gained = (whole_momentum(simulation, "/cloth") - before) / (len(forces) / 60)            # it still swings up and down
    weight = 9.81 * (1600.0 * 0.2 * 0.1 * 0.2 + simulation.plan.model.bodies[0].masses.sum())
    assert abs((np.mean(forces, axis=0) - gained)[1] / weight - 1) < 0.005


def test_a_snowball_pushes_a_soft_body_and_a_run_restarts_to_the_bit(tmp_path):
    """Float64: momentum stays, and the block of 2.7 kg gets most of that of the snowball of 2.9 kg."""
    from dataclasses import replace

    from wsim.cli.run import prepare_recorded_run
    scene = wsim.Scene(fps=60, gravity=(0, 0, 0))
    scene.soft("/block", *wsim.shapes.block((0.3, 0.3, 0.3), (3, 3, 3)), material=wsim.Bulk(2e4, 0.3, 100.0))
    scene.mpm("/ball", wsim.Sphere(0.12), at=(0.01, 0.4, 0.02), cell=0.05, velocity=(0, -4, 0), material=Snow())

    def run(output, frames, restart=None):
        job = prepare_recorded_run(replace(scene, frames=frames), str(tmp_path / output),
                                   lambda s: wsim.Simulation(s, device="cpu", precision="float64"),
                                   restart=restart and str(tmp_path / restart))
        before = whole_momentum(job.simulation, "/block")
        job.frames()
        return before, job.simulation
    (before, whole), _ = run("o.usdc", 8), run("half.usdc", 3)
    rest = run("rest.usdc", 8, "half.usdc")[1]
    assert np.abs(whole_momentum(whole, "/block") - before).max() < 1e-9 * np.abs(before).max()
    assert whole_momentum(whole, "/block")[1] < 0 and whole.velocities("/block")[:, 1].mean() < -1
    assert all(np.array_equal(getattr(whole.state, name).numpy(), getattr(rest.state, name).numpy()) for name in "xv")
    for field in find_method(whole).part.kept:
        assert np.array_equal(*(find_method(s).part.arrays[field.name].numpy() for s in (whole, rest))), field.name
