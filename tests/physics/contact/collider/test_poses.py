"""Many colliders: poses that the device evaluates against `Motion.at`, live motions, and a broad phase that changes no bit;
outlines of frames, and colliders that have no poses."""

import numpy as np
import pytest
import warp as wp

from tests.conftest import first_and_slow
from tests.make.gradient.gradients import Run
from tests.make.physics.contact.collider.poses import crowd, met, mixed, motion, table, tried
from tests.make.physics.contact.free_flight_test import CPU, FORMS, MARCH, WHOLE, rising, sheet, state, swelling
from wsim.geometry import rotation
from wsim.kernels.contact.search import MOST, ROOM
from wsim.kernels.motion.free_flight_test import WIDTH
from wsim.physics.contact import ColliderContacts, contacts, free_flight_test, poses
from wsim.physics.contact.poses import swept_bounds
from wsim.physics.contact.poses.swept_bounds import SweptBounds
from wsim.scene import Box, Collider, Scene, Sphere, Surface, shapes
from wsim.scene.curve import Curve, Motion, Part, Stack
from wsim.simulation.simulation import Simulation

# Roundings of places and sizes of 2 m: 1e-14 is 22 of them. Balls and turns are made of a few more sums.
CLOSE = {"rtol": 0.0, "atol": 1e-14}


def both(monkeypatch, make, time) -> list[list[np.ndarray]]:
    """The table at the frame that begins at `time`, evaluated by the device and by the host."""
    found = []
    for most in (0, 1000):
        monkeypatch.setattr(poses, "HOST_MOST", most)
        found.append(make())
        found[-1].prepare(time)
    assert len(found[0].poses.many) > 0 and len(found[1].poses.many) == 0
    return [table(c) for c in found]


@pytest.mark.parametrize("seed", range(3))
def test_motions_on_the_device_are_those_of_the_host(seed):
    """Before, between and behind the keys, with turns of 0, of nearly 0, of nearly and of exactly pi."""
    rng = np.random.default_rng(seed)
    given = [motion(rng, count) for count in (2, 3, 6, 20)] + [
        motion(rng, 4, angles) for angles in ([np.pi], [np.pi - 1e-7], [1e-13], [1e-9], [0.0], [np.pi - 2e-6])]
    stretched = motion(rng, 5)
    stretched.values[:, :3, :3] = stretched.values[:, :3, :3] @ (np.eye(3) + 1e-5 * rng.uniform(-1, 1, (5, 3, 3)))
    given.append(stretched)
    c = tried([Collider(f"/c{k}", Sphere(0.1), m) for k, m in enumerate(given)])
    for time in (-2.0, -1.1, *rng.uniform(-1.0, 2.0, 8), 1.9, *(given[2].times[[0, 2, 5]])):
        c.prepare(time)
        A, p = (array.numpy() for array in (c.poses.device_rows.sampled.A, c.poses.device_rows.sampled.p))
        for k, own in enumerate(given):
            for j, t in enumerate(time + 0.5 * np.arange(8) / 7):
                expected = own.at(t)
                np.testing.assert_allclose(A[k, j], expected[:3, :3], **CLOSE)
                np.testing.assert_allclose(p[k, j], expected[:3, 3], **CLOSE)
                assert not t > own.times[-1] or np.array_equal(A[k, j], own.values[-1, :3, :3])


def test_rows_of_the_device_are_those_of_the_host(monkeypatch):
    """Two objects with origins of their own: places, turns, balls with the distance that is kept, strides."""
    rows = both(monkeypatch, lambda: tried(mixed(np.random.default_rng(4)), ((0.5, -0.2, 1.0), (-1.0, 0.3, 0.2))), 0.1)
    for device, host in zip(*rows, strict=True):
        np.testing.assert_allclose(device, host, **CLOSE)
    assert rows[0][3].max() > 1e-3 and np.isinf(rows[0][2][..., 3]).any()


def test_float32_is_rounded_once(monkeypatch):
    """From two values 1e-15 apart: the same number, but for one that lies so near to the middle of two (1e-8 of them)."""
    for device, host in zip(*both(monkeypatch, lambda: tried(mixed(np.random.default_rng(5)), real=wp.float32), 0.3),
                            strict=True):
        assert (device != host).sum() <= 1
        np.testing.assert_allclose(device, host, rtol=2e-7, atol=1e-9)


def test_a_motion_that_is_no_curve_is_evaluated_by_the_host_beside_others():
    """As inputs of gradients shift colliders: it goes by its own formula."""
    class Circling(Motion):
        def sampled(self, t) -> np.ndarray:
            M = np.tile(np.eye(4), (len(t), 1, 1))
            M[:, :3, 3] = np.stack([np.cos(t), np.sin(t), 0.0 * t], axis=1)
            return M
    rng = np.random.default_rng(6)
    plain, round_ = motion(rng), Circling([0.0, 1.0], np.tile(np.eye(4), (2, 1, 1)))
    c = tried([Collider("/plain", Sphere(0.1), plain), Collider("/round", Sphere(0.1), round_)])
    for time in (0.0, 0.5):
        c.prepare(time)
        assert (c.poses.many.tolist(), c.poses.few.tolist()) == ([0], [1])
        times = time + 0.5 * np.arange(8) / 7
        for k, of in enumerate((plain, round_)):
            np.testing.assert_allclose(c.table.of.pose.numpy()[:, k, :3], of.sampled(times)[:, :3, 3], **CLOSE)


def test_a_motion_set_live_is_met_from_the_next_frame_on():
    """Another motion, a still pose, a still collider that moves from now on, and in the end most stand."""
    rng = np.random.default_rng(7)
    count = 6
    scene = Scene(solver="xpbd", gravity=(0.0, 0.0, -9.81), up="Z", fps=24.0, substeps=3)
    scene.cloth("/cloth", *shapes.sheet(1.0, 1.0, 2, 2, horizontal=True, up="Z"))
    given = {f"/c{k}": motion(rng) for k in range(count)} | {"/still": Motion.at_place((0.2, 0.1, -3.0))}
    for path, own in given.items():
        scene.collider(path, Sphere(0.01), motion=own)
    sim = Simulation(scene, device="cpu", precision="float64")
    contact = sim.plan.method("contact").contacts
    changes = [{}, {"/c1": motion(rng)}, {"/c2": motion(rng).values[3]}, {"/still": motion(rng)}, {},
               {f"/c{k}": np.eye(4) for k in range(3, count)}, {"/c3": motion(rng)}]
    many = []
    for frame, change in enumerate(changes):
        for path, value in change.items():
            sim.set(path, "motion", value)
            given[path] = value if isinstance(value, Motion) else Motion.still(value)
        sim.step()
        contact.place()                                  # a frame without contacts has asked for no poses
        many.append(len(contact.poses.many))
        pose = contact.table.of.pose.numpy()
        for j, t in enumerate(frame / 24.0 + np.arange(4) / 72.0):
            expected = np.array([own.at(t)[:3, 3] for own in given.values()]) - sim.model.bodies[0].origin
            np.testing.assert_allclose(pose[j, :, :3], expected, **CLOSE)
    assert many == [count, count, count - 1, count, count, 3, 4]


# outlines of frames

def outlined(of: ColliderContacts, frame: int) -> np.ndarray:
    """Rows (rows, WIDTH) of a frame."""
    of.prepare(frame * of.dt)
    of.outline.frame(frame * of.dt)
    return of.outline.now.numpy().reshape(-1, WIDTH).astype(np.float64).copy()


def easing(rng) -> Motion:
    plain = motion(rng)
    return Motion(plain.times, plain.values, "eased", easing="bounce-out")


def smooth(rng) -> Motion:
    plain = motion(rng, angles=[0.4])
    return Motion(plain.times, plain.values, "catmull_rom", after="linear")


def stacked(rng) -> Motion:
    return Stack([Part("turn", Curve(np.array([-1.0, 2.0]), np.array([0.0, 2.0])), 2), motion(rng)])


MOTIONS = {"slerp": motion, "smooth": smooth, "eased": easing, "stack": stacked, "still": lambda rng: motion(rng, 1)}


def outlines(make, seed=8) -> ColliderContacts:
    own = Collider("/own", Box((0.1, 0.2, 0.3)), make(np.random.default_rng(seed)))
    c = tried([*mixed(np.random.default_rng(seed), 4), own], ((0.5, -0.2, 1.0), (-1.0, 0.3, 0.2)), dt=0.05)
    c.outline = SweptBounds(c)
    return c


@pytest.mark.parametrize("make", MOTIONS.values(), ids=MOTIONS)
def test_an_outline_loses_what_the_poses_of_its_frame_do_or_more(make):
    """Of each row, by the formula of kernels/motion/free_flight_test.py; as much where poses are looked at."""
    c = outlines(make)
    ball, size = c.rows.centers()[c.rows.collider], np.where(np.isfinite(c.rows.radius), c.rows.radius, -1.0)[c.rows.collider]
    for frame in range(-22, 44, 3):
        row, (pose, _, _, stride) = outlined(c, frame), table(c)
        R, p = rotation.quaternion_to_matrix(pose[..., 3:]), pose[..., :3]
        center = (R @ ball[:, :, None])[..., 0] + p

        def most(x):
            return np.linalg.norm(x, axis=-1).max(axis=0)

        def turned(A, B):
            return np.linalg.norm(A - B, ord=2, axis=(-2, -1)).max(axis=0)
        s, S, w, W = most(center - center[0]), turned(R, R[:1]), most(np.diff(center, axis=0)), turned(R[1:], R[:-1])
        lever = np.where(size < 0.0, s, size)
        loss = s + S * lever + 2.0 * (w + W * s) + stride.max(axis=0) + c.gap
        slope = 4.0 * W + 2.0 * S * (size < 0.0)
        np.testing.assert_allclose(row[:, :3], p[0], **CLOSE)
        np.testing.assert_allclose(rotation.quaternion_to_matrix(row[:, 3:7]), R[0], **CLOSE)
        np.testing.assert_allclose(row[:, 9:], center[0], **CLOSE)
        assert (row[:, 7] >= loss).all() and (row[:, 8] >= slope).all()
        own = slice(-1, None)
        if make in (easing, MOTIONS["still"]):
            np.testing.assert_allclose(row[own, 7:9], np.stack([loss, slope], 1)[own], atol=1e-4, rtol=0.0)


@pytest.mark.parametrize("make", MOTIONS.values(), ids=MOTIONS)
def test_an_outline_is_the_same_whichever_frames_it_is_worked_out_with(make, monkeypatch):
    """Frame by frame, in sets that double, in small ones, and after something was set."""
    rows = [outlined(outlines(make), k) for k in range(40)]
    on, few, anew = (outlines(make) for _ in range(3))
    for k in range(40):
        assert np.array_equal(outlined(on, k), rows[k])
        anew.redrawn = k % 3 == 0
        assert np.array_equal(outlined(anew, k), rows[k])
    assert on.outline.count >= 16 and anew.outline.count <= 4
    monkeypatch.setattr(swept_bounds, "SAMPLES", 7 * 3)
    for k in range(10, 20):
        assert np.array_equal(outlined(few, k), rows[k])
    assert few.outline.count == 3 or make is not easing


WAY = [(0.0, 0.0, -9.0), (3.0, 0.0, -9.0), (0.0, 2.0, -8.0)]
TURNS = [(0.0, 0.0, 0.0, 1.0), (0.0, 0.6, 0.0, 0.8), (0.0, 0.0, 0.6, 0.8)]


def throughout(scene: Scene, monkeypatch) -> Simulation:
    """With contacts in every frame."""
    with monkeypatch.context() as m:
        m.setattr(free_flight_test, "allows_free_flight", lambda *_: False)
        return Simulation(scene, **CPU)


def placed(contacts) -> list[wp.array]:
    return [contacts.table.of.pose, *(mesh.device["mesh"].points for mesh in contacts.meshes.values())]


@pytest.mark.parametrize(("kind", "shape"), [("linear", Box((0.1, 0.2, 0.3))), ("catmull_rom", Surface(*shapes.sphere(0.5, 8))),
                                             ("linear", "swells"), (None, "swells")])
def test_a_collider_that_moves_far_away_has_no_poses(kind, shape, monkeypatch):
    """None of its substeps is worked out until indicators ask: then it is where it is with contacts throughout."""
    shape = swelling(0.5, 0.2, [0.0, 0.1, 0.2]) if shape == "swells" else shape
    by = Motion.through([0.0, 0.1, 0.2], WAY, TURNS, kind) if kind else None
    scene, place, asked = sheet(shape, motion=by, **MARCH), poses.ColliderPoses.place, []
    met, sim, alone = throughout(scene, monkeypatch), *(Simulation(s, **CPU) for s in (scene, sheet(**MARCH)))
    monkeypatch.setattr(poses.ColliderPoses, "place", lambda *given: (asked.append(1), place(*given)))
    for each in (sim, alone):
        each.run(9)
    assert not asked and sim.forms == {"free": 9, "met": 0, "repeated": 0} and np.array_equal(state(sim), state(alone))
    met.run(9)
    assert sim.indicators()["penetration"] == 0.0 and len(asked) == 9 + 1
    for a, b in zip(*(placed(each.plan.ports.contacts) for each in (sim, met)), strict=True):
        assert np.array_equal(a.numpy(), b.numpy())


@pytest.mark.parametrize("form", ["march", "xpbd", "newton"])
def test_a_mesh_that_swells_is_met_where_its_ball_is_near(form, monkeypatch):
    """Seen from afar as the ball that it becomes; it lifts a sheet, and frames without contacts come before."""
    ball, more = swelling(0.2, 0.3, [0.0, 0.5, 1.0, 1.5]), FORMS[form] | {"gravity": (0.0, 0.0, 0.0)}
    scene = sheet(ball, motion=rising(-2.0, -0.45, 1.0), **more)
    sim, met = Simulation(scene, **CPU), throughout(scene, monkeypatch)
    for each in (sim, met):
        each.run(90)
    assert sim.forms["free"] >= 20 and sim.forms["met"] >= 20 and sim.positions()[:, 2].max() > 0.02
    assert np.abs(sim.positions() - met.positions()).max() <= (1e-9 if form in WHOLE else 0.0)


# the broad phase


@pytest.mark.parametrize("seed, precision", first_and_slow([(0, "float32"), (1, "float32"), (2, "float64"), (3, "float64")]))
def test_a_broad_phase_changes_no_bit(monkeypatch, seed, precision):
    plain = {}
    for many in (contacts.MANY, 10**9):
        monkeypatch.setattr(contacts, "MANY", many)
        found, c = met(crowd(seed), precision=precision, worlds=2)
        assert (c.tree is None) == (many == 10**9)
        plain[many] = found
    for tree, each in zip(*plain.values(), strict=True):
        assert np.array_equal(tree, each)
    held = found[2]
    assert c.slots.capacity > MOST and held.max() > ROOM and (held == 0).any()


@pytest.mark.slow
def test_gradients_of_many_colliders_are_those_of_each(monkeypatch):
    """By where points start and by the motions of colliders, of a recording whose frames are captured. Poses differ by the last
    bits of float64, and gradients by as much for each of the eight substeps that multiply them."""
    found = []
    for most, many in ((0, 1), (1000, 10**9)):
        monkeypatch.setattr(poses, "HOST_MOST", most)
        monkeypatch.setattr(contacts, "MANY", many)
        rng = np.random.default_rng(8)
        scene = Scene(solver="xpbd", gravity=(0.0, 0.0, -9.81), up="Z", fps=60.0, substeps=4, iterations=2)
        points = np.stack(np.meshgrid([-0.1, 0.0, 0.1], [-0.1, 0.1], [0.0]), axis=-1).reshape(-1, 3)
        scene.net("/net", points, [(0, 1), (2, 3), (4, 5)], np.full(3, 10.0), np.full(6, 1e-2))
        for k in range(12):
            own = motion(rng, 3, [0.5], 0.02)
            own.values[:, :3, 3] += (0.1 * (k % 3 - 1), 0.2 * (k % 2) - 0.1, -0.08)
            scene.collider(f"/c{k}", Sphere(0.05 + 0.001 * k), motion=own)
        run = Run(scene, frames=2)
        c = run.sim.plan.method("contact").contacts
        assert (c.tree is None) == (many > 1) and len(c.poses.many) == (12 if most == 0 else 0)
        found.append([run.gradient.positions("/net"), *(run.gradient.motion(f"/c{k}") for k in range(12))])
    assert sum(np.abs(by).max() > 1e-3 for by in found[0][1:]) > 3
    for device, host in zip(*found, strict=True):
        np.testing.assert_allclose(device, host, rtol=1e-11, atol=1e-12)


def test_a_recorded_run_asks_no_motion_of_a_moving_collider_but_of_one_that_was_moved_otherwise(tmp_path, monkeypatch):
    """The result moves those only, and 1000 motions on the host would take longer than the frame."""
    from pxr import Sdf, Usd, UsdGeom

    from wsim.cli.run import prepare_recorded_run
    from wsim.usd import load, save
    scene = Scene(solver="xpbd", gravity=(0.0, 0.0, -9.81), up="Z", fps=60.0, frames=3, substeps=4, iterations=1)
    scene.cloth("/cloth", *shapes.sheet(1.0, 1.0, 4, 4, horizontal=True, up="Z"))
    for k in range(poses.HOST_MOST + 4):
        keys = np.tile(np.eye(4), (2, 1, 1))
        keys[:, :3, 3] = [(0.2 * k, 0.0, -0.5), (0.2 * k, 0.0, -0.4)]
        scene.collider(f"/ball{k}", Sphere(0.05), motion=Motion(np.array([0.0, 1.0]), keys))
    source = str(tmp_path / "s.usda")
    save(scene, source)
    asked: list[int] = []
    given = Motion.still(np.eye(4))
    at = Motion.at
    job = prepare_recorded_run(load(source), str(tmp_path / "r.usda"), lambda s: Simulation(s, device="cpu"))
    job.simulation.run(1)
    job.simulation.reset()
    job.simulation.set("/ball3", "motion", given)
    monkeypatch.setattr(Motion, "at", lambda motion, t: asked.append(id(motion)) or at(motion, t))
    job.frames()
    (moved,) = [c for c in job.simulation.scene.colliders if c.path == "/ball3"]
    source_of_it = next(c for c in job.scene.colliders if c.path == "/ball3").motion
    assert set(asked) == {id(moved.motion), id(source_of_it)}
    layer = Sdf.Layer.FindOrOpen(job.result)
    written = [k for k in range(poses.HOST_MOST + 4) if layer.GetPrimAtPath(f"/ball{k}")]
    assert written == [3]
    stage = Usd.Stage.Open(job.result)
    ball = UsdGeom.Xformable(stage.GetPrimAtPath("/ball3")).ComputeLocalToWorldTransform(3.0)
    assert np.abs(np.array(ball).T - given.at(0.0)).max() < 1e-6 and job.simulation.poses("/ball3")["/ball3"][0, 3] == 0.0


def test_indicators_of_a_run_that_goes_on_are_of_where_it_was_left():
    """A ball has come to a sheet and touches it; no frame is stepped."""
    run, again = (Simulation(sheet(Sphere(0.4), motion=rising(-0.5, -0.3, 0.1), **MARCH), **CPU) for _ in range(2))
    run.run(3)
    with np.errstate(all="raise"):
        again.restart(3, {"/sheet": run.fields("/sheet")})
        assert again.indicators() == run.indicators() and run.indicators()["contacts"] > 0
