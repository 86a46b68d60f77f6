"""Gradients through contacts with meshes, and by colliders: their friction, restitution, thickness and motion. Differences take
steps within which no list, face or branch changes; they are right to about 1e-7 then. Closed forms to rounding.

Every scene has the same kinds of colliders, so that one module serves: what it does not need lies far below."""

from copy import copy
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import wsim
from tests.conftest import first_and_slow
from tests.make.gradient.gradients import WEIGHTS, Run
from tests.make.physics.contact.collider_adjoint import FRAMES, HIGH, TRIED, G, led, slid
from tests.make.physics.contact.project_adjoint import SOLVERS, Slid
from tests.make.physics.contact.restitution import ball, cube
from wsim.fitting import Settings, Track
from wsim.fitting.fields.field import fields_of_names
from wsim.fitting.fields.misfit import AdjointMisfit
from wsim.fitting.parameter import parameters_of_names
from wsim.geometry.rotation import axis_rotation_matrix
from wsim.gradient.recording import Recording
from wsim.gradient.rollout.products import Rollout
from wsim.scene import Box, Plane, Scene, SceneError, Sphere, Surface, shapes
from wsim.scene.curve import Motion
from wsim.simulation.simulation import Simulation
from wsim.usd.result.fields import author_fields
from wsim.usd.result.fitted import save_fitted


def flat(closed: bool) -> Surface:
    """Triangles whose upper face is z = 0; their edges are away from where points are."""
    if closed:
        box = cube(2.0)
        box.points -= np.array([0.1, 0.05, 2.0], np.float32)
        return box
    return Surface([[-3, -2, 0], [3, -2.5, 0], [0.2, 4, 0.0]], [3], [0, 1, 2])


@cache
def recorded(shape, solver) -> Slid:
    return Slid(slid(shape, solver), frames=FRAMES)


SCENES = [pytest.param(shape, solver, id=f"{shape}-{solver}") for shape in TRIED for solver in SOLVERS
          if solver == "xpbd" or shape in ("plane", "deforming")]        # sweeps on a ball are ragged, in steps as short


@pytest.mark.parametrize("shape, solver", first_and_slow(SCENES))
def test_a_sheet_that_slides_on_a_mesh(shape, solver):
    run = recorded(shape, solver)
    plain = run.plain()
    plain.run(FRAMES)
    assert plain.indicators()["contacts"] >= 4
    assert np.abs(plain.positions() - run.recording.positions(FRAMES)).max() < 1e-11
    run.by("positions", 1e-8)
    # At 1e-6 the plane's differences reach a kink: 2e-6 off, 1e-4 at 2e-6. On the mesh that deforms the slope is 2e-3, and what
    # is lost of losses near 1 to rounding is 1e-6 of it at 1e-7: the adjoint and differences at 1e-6 are 2e-8 apart.
    run.by("velocities", 1e-6 if (shape, solver) == ("deforming", "xpbd") else 1e-7)


@pytest.mark.parametrize("shape, solver", SCENES)
def test_by_friction_and_thickness_of_a_collider(shape, solver):
    run = recorded(shape, solver)
    run.check(run.gradient.friction("/floor")[1], lambda s: ("/floor", "dynamic_friction", 0.4 + s), 1e-7, 3e-7)
    run.check(run.gradient.friction("/cloth")[1], lambda s: ("/cloth", "dynamic_friction", 0.4 + s), 1e-7, 3e-7)
    run.check(run.gradient.thickness("/floor"), lambda s: ("/floor", "thickness", 1e-3 + s), 1e-8, 3e-7)
    assert run.gradient.friction("/floor")[0] == 0.0 and run.gradient.friction("/below2")[1] == 0.0


@pytest.mark.parametrize("shape, solver", SCENES)
def test_by_the_motion_of_a_collider(shape, solver):
    """Worlds share their colliders, so that every difference is a run of its own."""
    run = recorded(shape, solver)
    by, sim = run.gradient.motion("/floor"), run.plain()
    assert by.shape == (FRAMES + 1, 2, 3)
    way = np.random.default_rng(1).normal(size=by.shape)
    for part in (0, 1):
        ways, losses = np.zeros(by.shape), []
        ways[:, part] = way[:, part]
        for s in [sign * k * 1e-8 for k in range(1, 5) for sign in (1, -1)]:
            sim.reset()
            sim.set("/floor", "motion", led(run.scene.colliders[0].motion, run.scene.substeps, *np.moveaxis(s * ways, 1, 0)))
            sim.run(FRAMES)
            losses.append((sim.positions() * run.x).sum() + (sim.velocities() * run.v).sum())
        expected = np.reshape(losses, (4, 2)) @ (1, -1) @ WEIGHTS / 1e-8
        assert (by * ways).sum() == pytest.approx(expected, rel=2e-6, abs=5e-7)     # rounding of losses, 5e-15


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("solver", SOLVERS)
def test_a_plane_of_triangles_has_the_gradients_of_a_plane(solver, closed):
    """Of a sheet that falls on a rising slope and slides. What Warp's meshes keep in float32 is exact here."""
    runs = []
    for shape in (Plane(), flat(closed)):
        scene = slid("sphere", solver, gap=0.004, spin=0.0)
        scene.colliders[0].shape = shape
        scene.colliders[0].thickness = 1.5e-3
        scene.colliders[0].motion.values[:, 2, 3] += HIGH["sphere"] - 1.5e-3
        tilt = axis_rotation_matrix(np.array([0.6, 0.8, 0.0]), 0.02)
        scene.colliders[0].motion.values[:, :3, :3] = scene.colliders[0].motion.values[:, :3, :3] @ tilt
        runs.append(Run(replace(scene, contact_width=1e-3), frames=FRAMES))
    assert np.abs(runs[0].recording.positions(FRAMES) - runs[1].recording.positions(FRAMES)).max() < 1e-14
    for of in (lambda g: g.positions(), lambda g: g.velocities(), lambda g: g.gravity(), lambda g: g.motion("/floor")[:, 0],
               lambda g: g.friction("/floor"), lambda g: g.thickness("/floor")):
        a, b = (np.asarray(of(run.gradient)) for run in runs)
        assert np.abs(a).max() > 0.0 and np.abs(a - b).max() < 1e-10 * np.abs(a).max()


def test_a_sheet_that_slides_down_a_mesh_as_the_formula_says():
    """All its points alike: after n steps of backward Euler x = a h^2 n (n + 1) / 2 + mu z, a = g (sin - mu cos), where z is
    how far above the slope it starts, and mu the mean of its friction and that of the slope."""
    angle, n, h, mu, z = 0.6, 3 * 6, 1 / 360, 0.3, 1e-5
    scene, slope = slid("solid", "xpbd"), np.eye(4)
    cloth, floor = scene.cloths[0], scene.colliders[0]
    slope[:3, :3] = axis_rotation_matrix(np.array([0.0, 1.0, 0.0]), angle)
    down, up = slope[:3, 0], slope[:3, 2]
    cloth.points[:, 2], cloth.velocities = 0.0, None
    cloth.rest_points, cloth.motion = cloth.points.copy(), Motion.still(slope.copy())
    cloth.material = replace(cloth.material, static_friction=0.3, dynamic_friction=0.3)
    floor.shape, floor.static_friction, floor.dynamic_friction = flat(True), 0.3, 0.3
    slope[:3, 3] = -(1.5e-3 + z) * up                                  # its thickness, and half of the sheet's
    scene.gravity, scene.air_drag, floor.motion = (0.0, 0.0, -G), 0.0, Motion.still(slope)
    recording = Recording(Simulation(scene, device="cpu", precision="float64", gradients=True), 3)
    way, cos = h * h * n * (n + 1) / 2, np.cos(angle)
    far = recording.positions(3) @ down - recording.positions(0) @ down
    assert far == pytest.approx(way * G * (np.sin(angle) - mu * cos) + mu * z, rel=1e-9)
    gradient = recording.backward({3: np.tile(down / 25, (25, 1))})
    assert gradient.friction("/floor") == pytest.approx([0.0, 0.5 * (z - G * cos * way)], rel=1e-8)
    assert gradient.positions().sum(axis=0) == pytest.approx(down + mu * up, abs=1e-10)
    assert gradient.motion("/floor")[:, 0].sum(axis=0) == pytest.approx(-mu * up, abs=1e-10)
    assert gradient.thickness("/floor") == pytest.approx(-mu, rel=1e-9)


def test_a_bounce_by_restitution_and_by_where_the_floor_is():
    """v = e S - g (t - S / g), S^2 = 2 g H: dv/de = S, dv/dH = (1 + e) g / S; leapfrog is exact between impacts."""
    scene, S = ball(e=0.6, height=0.2), np.sqrt(2 * G * 0.2)
    recording = Recording(Simulation(scene, device="cpu", precision="float64", gradients=True), 20)
    assert recording.velocities(20)[0, 1] == pytest.approx(0.6 * S - G * (20 / 60 - S / G), rel=1e-10)
    seed = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    gradient = recording.backward(velocities={20: seed})
    assert gradient.restitution("/floor") == pytest.approx(S, rel=1e-10)
    assert gradient.motion("/floor").sum(axis=0) == pytest.approx(
        np.array([[0, -1.6 * G / S, 0], [0, 0, 0]]), abs=1e-9)        # the first point is over the floor's origin
    recording.sim.set("/floor", "restitution", 0.5)
    recording.run()
    assert recording.velocities(20)[0, 1] == pytest.approx(0.5 * S - G * (20 / 60 - S / G), rel=1e-10)


@pytest.mark.parametrize("solver, integrator", [("xpbd", "backward_euler"), ("explicit", "leapfrog")])
def test_by_the_restitution_of_two_colliders_in_two_worlds(solver, integrator):
    scene = ball(e=0.7, height=0.05, v=(1.0, 0.0, 0.0), solver=solver, integrator=integrator)
    turned = np.eye(4)
    turned[:3, :3], turned[0, 3] = axis_rotation_matrix(np.array([0.0, 1.0, 0.0]), -np.pi / 2), 1.15
    scene.collider("/wall", Plane(), motion=Motion.still(turned), restitution=0.4)
    sim = Simulation(scene, device="cpu", precision="float64", gradients=True, worlds=2)
    sim.set("/wall", "restitution", 0.6, 1)
    recording, losses = Recording(sim, 14), []
    rng = np.random.default_rng(2).normal(size=(2, 3))
    gradient = recording.backward({14: {("/ball", 1): rng}})
    for s in (1e-5, -1e-5):
        sim.set("/wall", "restitution", 0.6 + s, 1)
        recording.run()
        losses.append((recording.positions(14, "/ball", 1) * rng).sum())
    assert gradient.restitution("/wall", 1) == pytest.approx((losses[0] - losses[1]) / 2e-5, rel=1e-8)
    assert gradient.restitution("/wall", 0) == 0.0 and gradient.restitution("/wall", 1) != 0.0


def test_the_graph_of_a_deforming_mesh_has_the_bits_of_its_launches():
    ends = []
    for captured in (True, False):
        sim = Simulation(slid("deforming", "xpbd"), device="cpu", precision="float64")
        if not captured:
            sim._replay = sim.plan.frame
        sim.run(FRAMES)
        ends.append(sim.positions())
    assert sim.indicators()["contacts"] >= 4 and np.array_equal(*ends)


def test_what_has_no_derivative_is_named():
    run = recorded("sphere", "xpbd")
    with pytest.raises(SceneError, match="/floor: its restitution is 0"):
        run.gradient.restitution("/floor")
    with pytest.raises(SceneError, match="/none: is no collider; there are /floor"):
        run.gradient.motion("/none")
    with pytest.raises(SceneError, match="dynamic_friction is -1"):
        run.sim.set("/floor", "dynamic_friction", -1.0)
    with pytest.raises(SceneError, match="no live parameter 'restitution'"):
        run.sim.set("/floor", "restitution", 0.5)
    without = copy(run.gradient)
    without.contacts = None
    with pytest.raises(SceneError, match="there is no collider"):
        without.friction("/cloth")


# as inputs, and in fits

def test_shift_friction_and_thickness_as_inputs_of_a_recording():
    """Products of both kinds agree; hvp moves the collider itself, and puts it back."""
    recording = Recording(Simulation(slid("solid", "xpbd"), device="cpu", precision="float64", gradients=True), FRAMES)
    names = ["/floor:dynamic_friction", "/cloth:dynamic_friction", "/floor:thickness", "/floor:shift"]
    rollout, rng = Rollout(recording, names, [FRAMES]), np.random.default_rng(4)
    rollout.run()
    seeds = rng.normal(size=rollout.shape)
    found = rollout.vjp(seeds)
    run = recorded("solid", "xpbd")
    way = 1e-9 * rng.normal(size=(FRAMES + 1, 3))
    losses = [(rollout.run({"/floor:shift": s * way}) * seeds).sum() for s in (1.0, -1.0)]
    rollout.write({"/floor:shift": 0.0 * way})
    assert (found["/floor:shift"] * way).sum() == pytest.approx(0.5 * (losses[0] - losses[1]), rel=1e-5)
    product = rollout.jvp({name: 1.0 for name in names[:2]} | {names[2]: 0.0}, step=1e-7)
    assert (product.value * seeds).sum() == pytest.approx(found[names[0]] + found[names[1]], rel=1e-6)
    assert rollout.values()["/floor:thickness"] == 1e-3 and rollout.values()["/floor:dynamic_friction"] == 0.4
    assert recording.positions(FRAMES) is not None and run.recording.frames == FRAMES
    with pytest.raises(SceneError, match="/floor:shift: found shape .3,.; allowed is .5, 3.: worlds share"):
        rollout.write({"/floor:shift": np.zeros(3)})
    with pytest.raises(SceneError, match="/floor:restitution: no collider throws back"):
        Rollout(recording, ["/floor:restitution"])
    with pytest.raises(SceneError, match="a collider has static_friction"):
        Rollout(recording, ["/floor:radius"])


def test_friction_and_restitution_are_found_again():
    scene = ball(e=0.7, height=0.05, v=(1.5, 0.0, 0.0), solver="xpbd", integrator="backward_euler")
    scene.colliders[0].dynamic_friction = scene.colliders[0].static_friction = 0.3
    sim, found = Simulation(scene, device="cpu", precision="float64"), []
    sim.run(20, lambda s: found.append(s.positions()))
    first = replace(scene, colliders=[replace(scene.colliders[0], dynamic_friction=0.2, restitution=0.6)])
    result = wsim.fit(first, [Track("/ball", np.arange(1, 21), np.array(found))], "dynamic_friction,restitution",
                      settings=Settings(device="cpu"))
    assert result.values["dynamic_friction"] == pytest.approx(0.3, rel=1e-6)
    assert result.values["restitution"] == pytest.approx(0.7, rel=1e-6)
    assert result.scene.colliders[0].restitution == result.values["restitution"] and first.colliders[0].restitution == 0.6
    with pytest.raises(SceneError, match="/floor: restitution is 0 at the start"):
        parameters_of_names("restitution", [ball(e=0.0)])


def test_the_motion_of_a_collider_is_found_from_what_it_throws():
    scene, times, keys = slid("plane", "xpbd", spin=0.0), np.arange(FRAMES + 1) / 60, np.random.default_rng(3)
    truth = Motion(times, np.stack([scene.colliders[0].motion.at(t) for t in times]))
    truth.values[1:, 2, 3] += 2e-3 * keys.normal(size=FRAMES)
    sim, found = Simulation(scene, device="cpu", precision="float64"), []
    sim.set("/floor", "motion", truth)
    sim.run(FRAMES, lambda s: found.append(s.positions()))
    tracks = [Track("/cloth", np.arange(1, FRAMES + 1), np.array(found))]
    misfit = AdjointMisfit([(scene, tracks)], fields_of_names(["/floor:motion[]"], [scene]), "cpu")
    misfit.set_beliefs(misfit.start)
    theta = misfit.theta([truth.values[1:, :3, 3] - np.stack([scene.colliders[0].motion.at(t)[:3, 3] for t in times[1:]])])
    value, slope = misfit.look(theta)
    assert value[0] < 1e-25 and np.abs(slope[0]).max() < 1e-12
    way = np.random.default_rng(5).normal(size=theta.shape)
    at = theta + 1e-4 * way
    ends = [misfit.look(at + s * way, slope=False)[0][0] for s in (1e-8, -1e-8)]
    assert misfit.look(at)[1][0] @ way == pytest.approx((ends[0] - ends[1]) / 2e-8, rel=1e-5)


def test_a_layer_holds_what_was_found_of_colliders(tmp_path):
    """A material that others bind stays as it is; a box keeps its size, which its transform holds."""
    scene, times = Scene(fps=60.0, frames=3), np.arange(4) / 60
    scene.cloth("/cloth", *shapes.sheet(0.5, 0.5, 2, 2))
    turned = np.eye(4)
    turned[:3, :3], turned[:3, 3] = axis_rotation_matrix(np.array([0.0, 0.6, 0.8]), 0.4), (0.1, 0.2, -0.3)
    scene.collider("/World/box", Box((0.1, 0.2, 0.3)), motion=Motion.still(turned))
    for name in "ab":
        scene.collider(f"/World/{name}", Sphere(0.3), restitution=0.5)
    wsim.save(scene, tmp_path / "scene.usda")
    before = wsim.load(str(tmp_path / "scene.usda"))
    box, ball_, other = before.colliders
    values = np.stack([turned] * 4)
    values[1:, :3, 3] += np.random.default_rng(1).normal(size=(3, 3))
    after = replace(before, colliders=[replace(box, motion=Motion(times, values)),
                                       replace(ball_, restitution=0.7, dynamic_friction=0.25), other])
    save_fitted(before, after, tmp_path / "fitted.usda", None,
                lambda stage: author_fields(stage, [(box.path, "motion", values)], {c.path: c for c in after.colliders}))
    found = wsim.load(str(tmp_path / "fitted.usda")).colliders
    assert [(c.restitution, c.dynamic_friction) for c in found] == [(0.0, 0.5), (0.7, 0.25), (0.5, 0.5)]
    assert found[0].shape.half == pytest.approx((0.1, 0.2, 0.3), abs=1e-15)
    assert max(np.abs(found[0].motion.at(t) - M).max() for t, M in zip(times, values, strict=True)) < 1e-15
