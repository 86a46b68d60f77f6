"""Gradients of the material point method: those of differences, in float64, of every law in contact with a floor."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import warp as wp

import wsim
from wsim import SceneError
from wsim.gradient.inputs.by_name import inputs_by_name
from wsim.gradient.recording import Recording
from wsim.kernels.particles.mpm.adjoint.law_table import BACK, choose_law_adjoint
from wsim.kernels.particles.mpm.material.law_table import LAWS, choose_law
from wsim.kernels.particles.mpm.tables import point_tables
from wsim.physics.mpm.adjoint import step
from wsim.physics.mpm.adjoint.gradient import number_slopes
from wsim.physics.mpm.objects import Granular, Jelly, Snow, Water
from wsim.physics.mpm.tile_grid import TileGrid
from wsim.scene.curve import Motion

MATERIALS = {"neo_hookean": Jelly(2e4), "corotational": Jelly(2e4, model="corotational", viscosity=1.0),
             "snow": Snow(young=5e4, compression_limit=0.01, tension_limit=0.005),
             "sand": Granular(young=1e5, friction_angle=0.5, cohesion=20.0), "water": Water(bulk=2e4, tension=True)}
ELASTIC = ("young", "poisson", "density")
NUMBERS = {"neo_hookean": ELASTIC, "corotational": (*ELASTIC, "viscosity"),
           "snow": (*ELASTIC, "compression_limit", "tension_limit", "hardening"),
           "sand": (*ELASTIC, "friction_angle", "cohesion"), "water": ("bulk", "density", "exponent")}
GRAVITY = np.array([0.3, -9.81, 0.1])
FLOOR = wsim.Box((5, 0.5, 5))
vec8 = point_tables(wp.float64).vec8


# laws

@cache
def law_kernels():
    respond, back = choose_law(tuple(LAWS), wp.float64)[0], choose_law_adjoint(tuple(LAWS), wp.float64)
    real, mat33 = wp.array(dtype=wp.float64), wp.array(dtype=wp.mat33d)

    @wp.kernel(module="unique", enable_backward=False)
    def law_forward(law: int, B: mat33, q: real, m: wp.array(dtype=vec8), B_out: mat33, q_out: real, tau: mat33):
        i = wp.tid()
        C, r, T, a = respond(law, B[i], q[i], m[i])
        B_out[i] = C
        q_out[i] = r
        tau[i] = T

    @wp.kernel(module="unique", enable_backward=False)
    def law_backward(law: int, B: mat33, q: real, m: wp.array(dtype=vec8), by_B: mat33, by_q: real, by_tau: mat33,
                     m_out: wp.array(dtype=vec8)):
        i = wp.tid()
        C, r, n = back(law, B[i], q[i], m[i], by_B[i], by_q[i], by_tau[i])
        by_B[i] = C
        by_q[i] = r
        m_out[i] = n

    return law_forward, law_backward


def on_device(*given):
    types = {(3, 3): wp.mat33d, (8,): vec8, (): wp.float64}
    return [wp.array(np.ascontiguousarray(a), dtype=types[a.shape[1:]], device="cpu") for a in given]


def symmetric(A):
    return 0.5 * (A + A.swapaxes(1, 2))


def strains(n):
    """B of n stretches of all sizes: random ones, then pairs of equal and nearly equal ones, three equal ones, none."""
    rng = np.random.default_rng(0)
    size = 10.0**rng.uniform(-4, -0.7, n)
    s = rng.normal(size=(n, 3))
    s[n // 4:, 1] = s[n // 4:, 0] + np.where(rng.random(n - n // 4) < 0.5, 0.0, 10.0**rng.uniform(-12, -5, n - n // 4))
    s[-n // 8:] = s[-n // 8:, :1]
    V = np.linalg.qr(rng.normal(size=(n, 3, 3)))[0]
    s = np.maximum(1.0 + size[:, None] * s, 0.3)
    s[-1] = 1.0
    return V * (s**2 - 1.0)[:, None, :] @ V.swapaxes(1, 2), size


@pytest.mark.parametrize("name", BACK)
def test_a_law_has_the_derivative_of_differences(name):
    """Of order 4. Where a step of them crosses the kink at which flow begins, a smaller one counts."""
    rng, n, law = np.random.default_rng(1), 400, list(LAWS).index(name)
    B, size = strains(n)
    q, m = 0.02 * np.abs(rng.normal(size=n)), np.tile(MATERIALS[name].numbers(), (n, 1))
    m[:, :2] /= m[:, 1:2]
    if name == "sand":
        m[:, 3] = np.where(rng.random(n) < 0.5, 0.0, 0.01)
    by = symmetric(rng.normal(size=(n, 3, 3))), rng.normal(size=n), symmetric(rng.normal(size=(n, 3, 3)))
    forward, backward = law_kernels()

    def loss(*given):
        out = on_device(np.zeros((n, 3, 3)), np.zeros(n), np.zeros((n, 3, 3)))
        wp.launch(forward, n, [law, *on_device(*given), *out], device="cpu")
        return sum((w * a.numpy()).reshape(n, -1).sum(axis=1) for w, a in zip(by, out, strict=True))
    found = on_device(*by)
    numbers = on_device(np.zeros((n, 8)))
    wp.launch(backward, n, [law, *on_device(B, q, m), *found, *numbers], device="cpu")
    slopes = [found[0].numpy(), found[1].numpy(), numbers[0].numpy()]
    ways = [symmetric(rng.normal(size=(n, 3, 3))) * size[:, None, None], size * rng.normal(size=n),
            m * rng.normal(size=(n, 8)) * (np.arange(8) != 3 if name == "water" else 1.0)]
    for k, (slope, way) in enumerate(zip(slopes, ways, strict=True)):
        each = (slope * way).reshape(n, -1).sum(axis=1)
        off = np.full(n, np.inf)
        for h in (1e-3, 1e-4, 1e-5):
            f = [loss(*(a + s * h * way if j == k else a for j, a in enumerate((B, q, m)))) for s in (-2, -1, 1, 2)]
            expected = (8.0 * (f[2] - f[1]) - (f[3] - f[0])) / (12.0 * h)
            off = np.minimum(off, np.abs(expected - each) / (np.abs(each) + 0.01 * size))
        assert np.quantile(off, 0.98) < 1e-7, (k, np.sort(off)[-10:])


def test_numbers_of_laws_have_the_derivatives_of_their_closed_forms():
    m = Granular(young=1e5, poisson=0.3, friction_angle=0.5)
    assert number_slopes(m, "friction_angle")[2] == pytest.approx(np.sqrt(2.0) / np.cos(0.5)**2, rel=1e-10)
    assert number_slopes(m, "young")[:2] == pytest.approx(np.array(m.numbers()[:2]) / 1e5, rel=1e-10)
    assert number_slopes(m, "poisson")[0] == pytest.approx(-0.5e5 / 1.3**2, rel=1e-10)


# steps

def heap(name, frames=2, fps=60.0, velocity=(0.4, -1.5, 0.2), friction=0.3, mass=1.0, floor=None, **more):
    """Particles that fall on a floor, all at velocities of their own. more: of the material."""
    scene = wsim.Scene(fps=fps, frames=frames, gravity=tuple(GRAVITY))
    scene.collider("/floor", FLOOR, motion=floor or Motion.at_place((0, -0.5, 0)), static_friction=friction,
                   dynamic_friction=friction)
    rng = np.random.default_rng(1)
    index = np.stack(np.meshgrid(*[np.arange(n) for n in (5, 6, 4)], indexing="ij"), -1).reshape(-1, 3)
    x = (index + 0.5) * 0.025 + [0.0, 0.0035, 0.0] + 0.002 * rng.uniform(-1, 1, (len(index), 3))
    scene.mpm("/heap", points=x, volumes=0.025**3, cell=0.05, velocity=np.array(velocity) + 0.3 * rng.normal(size=x.shape),
              material=replace(MATERIALS[name], **more))
    for k, law in enumerate(MATERIALS):                        # all laws: tests share compiled kernels
        soft = replace(MATERIALS[law], **({"bulk": 500.0} if law == "water" else {"young": 500.0}))
        scene.mpm(f"/speck{k}", points=[[2.0, 1.5 + k, 0.0]], volumes=0.025**3, cell=0.05, material=soft)
    return scene


def recorded(scene, keep="auto", worlds=1):
    simulation = wsim.Simulation(scene, device="cpu", precision="float64", gradients=True, worlds=worlds)
    return Recording(simulation, scene.frames, keep)


def weights(r):
    return np.random.default_rng(5).normal(size=(2, len(r.positions(0, "/heap")), 3)) * [[[1.0]], [[0.01]]]


def seen(r):
    r.run()
    return np.stack([r.positions(r.frames, "/heap"), r.velocities(r.frames, "/heap")])


def gradient_of(r):
    r.run()
    w = weights(r)
    return r.backward(positions={r.frames: {"/heap": w[0]}}, velocities={r.frames: {"/heap": w[1]}})


def error_of_slope(r, gradient, path, name, steps=(1e-5, 1e-6, 1e-7), enough=1e-6):
    """Difference of a gradient to differences, over its size, of the first step that has it below `enough`; the least, where
    none has. steps: of the value's size. One that crosses a kink, or changes the number of a frame's steps, is off by more."""
    key = f"{path}:{name}".removeprefix("/:")
    value = inputs_by_name(r, [key])[key]
    base = value.read_value()
    way = np.random.default_rng(8).normal(size=base.shape) if base.ndim else np.ones(())
    scale = {"positions": 0.01, "velocities": 1.0}.get(name, float(np.abs(base).max()))
    found, off = float((np.asarray(gradient.value(path, name)) * way).sum()) * scale, [np.inf]
    w, at = weights(r), seen(r)
    assert abs(found) > 0.0
    for h in steps:
        f = []
        for k in (-2, -1, 1, 2):
            value.write_value(base + k * h * scale * way)
            f.append((w * (seen(r) - at)).sum())
        off.append(abs((8.0 * (f[2] - f[1]) - (f[3] - f[0])) / (12.0 * h) / found - 1.0))
        if off[-1] < enough:
            break
    value.write_value(base)
    return min(off)


INPUTS = [(name, key) for name, keys in NUMBERS.items() for key in (*keys, "positions", "velocities", "gravity")]


@cache
def run_of(name, **more):
    r = recorded(heap(name, **more))
    return r, gradient_of(r)


@pytest.mark.parametrize("name, key", INPUTS)
def test_every_law_has_the_slope_of_differences(name, key):
    """Two frames, while it hits the floor, slides and flows."""
    r, gradient = run_of(name)
    assert error_of_slope(r, gradient, "/" if key == "gravity" else "/heap", key) < 1e-6


@pytest.mark.parametrize("name", MATERIALS)
def test_one_step_has_the_slope_of_differences(name):
    r, gradient = run_of(name, frames=1, fps=2000.0)
    assert r.grains.frames[0][0] == 1
    for key in ("positions", "velocities"):
        assert error_of_slope(r, gradient, "/heap", key, (1e-4, 1e-5)) < 1e-6


@pytest.mark.parametrize("name", ["neo_hookean", *(pytest.param(name, marks=pytest.mark.slow)
                                                   for name in ("sand", "corotational", "snow"))])
def test_fifty_frames_have_the_slope_of_differences(name):
    """It lands, slides and comes to rest. Walls that stop particles are jumps of small size: only small steps fit between."""
    r, gradient = run_of(name, frames=50)
    for key in NUMBERS[name][-1], "positions":
        assert error_of_slope(r, gradient, "/heap", key, (1e-6, 1e-7, 1e-8)) < 1e-6, key


CONTACTS = {"stick": {"friction": 50.0}, "slide": {"friction": 0.05, "velocity": (3.0, -1.0, 0.0)},
            "leave": {"velocity": (0.4, 3.0, 0.0), "frames": 4}, "stop": {"velocity": (1.0, -12.0, 0.5)}}


@pytest.mark.parametrize("case", [*CONTACTS, "pushed"])
@pytest.mark.parametrize("name", ["neo_hookean", "sand"])
def test_contacts_have_the_slope_of_differences(name, case):
    """Nodes that stick, slide and leave; particles that a wall stops in their step; a floor that rises and slides away."""
    more = CONTACTS.get(case, {})
    if case == "pushed":
        ends = [np.eye(4) for _ in range(2)]
        ends[0][:3, 3], ends[1][:3, 3] = (0.0, -0.5, 0.0), (0.1, -0.3, 0.05)
        more = {"floor": Motion(np.array([0.0, 0.1]), np.stack(ends)), "frames": 3}
    r = recorded(heap(name, **more))
    gradient = gradient_of(r)
    for key in "positions", "velocities", "young":
        assert error_of_slope(r, gradient, "/heap", key, (1e-5, 1e-6, 1e-7, 1e-8)) < 1e-6, key


def test_free_fall_has_the_derivatives_of_its_closed_form():
    """The mean place after a time t is x0 + v t + g t (t + h) / 2."""
    scene = wsim.Scene(fps=60, frames=3)
    scene.mpm("/heap", wsim.Box((0.1, 0.1, 0.1)), at=(0, 3, 0), cell=0.05, material=Jelly(1e4))
    r = recorded(scene)
    n = len(r.positions(0))
    gradient = r.backward(positions={3: np.broadcast_to([0.0, 1.0 / n, 0.0], (n, 3))})
    t, h = 3 / 60, 1 / 60 / r.grains.frames[0][0]
    assert gradient.gravity() == pytest.approx([0.0, 0.5 * t * (t + h), 0.0], rel=1e-9, abs=1e-12)
    assert gradient.velocities("/heap").sum(axis=0) == pytest.approx([0.0, t, 0.0], rel=1e-9, abs=1e-12)
    assert gradient.positions("/heap").sum(axis=0) == pytest.approx([0.0, 1.0, 0.0], rel=1e-9, abs=1e-12)
    assert abs(gradient.value("/heap", "young")) < 1e-15


# the recording

def bits(gradient):
    return np.concatenate([np.ravel(gradient.value("/heap", key)) for key in ("positions", "velocities", "young", "density")])


def test_gradients_have_the_same_bits_twice_with_checkpoints_and_with_few_states(monkeypatch):
    """Few states: a frame's steps run a third time."""
    scene = heap("sand", frames=4)
    first = bits(gradient_of(recorded(scene, "all")))
    assert (bits(gradient_of(recorded(scene, "all"))) == first).all()
    assert (bits(gradient_of(recorded(scene, "checkpoints"))) == first).all()
    monkeypatch.setattr(step, "ROOM", 0)
    assert (bits(gradient_of(recorded(scene))) == first).all()


def test_a_recorded_run_is_the_plain_one_to_the_bit():
    scene = heap("sand", frames=4)
    r = recorded(scene)
    r.run()
    simulation = wsim.Simulation(scene, device="cpu", precision="float64")
    simulation.run(4)
    assert (r.positions(4, "/heap") == simulation.samples()[0].positions).all()


def test_worlds_are_apart():
    scene = heap("sand")
    alone = gradient_of(recorded(scene))
    r = recorded(scene, worlds=2)
    r.run()
    w = weights(r)
    both = r.backward(positions={2: {("/heap", 1): w[0]}}, velocities={2: {("/heap", 1): w[1]}})
    assert both.value("/heap", "young", 1) == pytest.approx(alone.value("/heap", "young"), rel=1e-12)
    assert both.gravity(1) == pytest.approx(alone.gravity(), rel=1e-12)
    assert both.value("/heap", "young", 0) == 0.0 and (both.gravity(0) == 0.0).all()


def test_a_frame_that_needs_more_blocks_is_recorded_with_more(monkeypatch):
    """120 particles fly apart: each comes to lie in up to 8 blocks of its own."""
    monkeypatch.setattr(TileGrid, "least_blocks", 64)
    scene = heap("sand", frames=2, fps=40.0)
    thing = scene.things("MaterialPoints")[0]
    thing.velocity = 40.0 * np.random.default_rng(3).normal(size=thing.points.shape) + [0.0, 60.0, 0.0]
    before = recorded(heap("sand")).grains.method.grid.blocks
    r = recorded(scene)
    assert np.isfinite(bits(gradient_of(r))).all() and r.grains.method.grid.blocks > before


def test_float32_is_near():
    scene = heap("neo_hookean", frames=4)
    exact = gradient_of(recorded(scene))
    r = Recording(wsim.Simulation(scene, device="cpu", gradients=True), 4)
    near = gradient_of(r)
    for key in ("positions", "velocities"):
        a, b = (g.value("/heap", key) for g in (exact, near))
        assert np.abs(a - b).max() < 1e-3 * np.abs(a).max()


def test_losses_and_values_that_there_are_not_are_refused():
    r, gradient = run_of("water")
    with pytest.raises(SceneError, match="has the law water, and young is none of its numbers"):
        gradient.value("/heap", "young")
    with pytest.raises(SceneError, match="with respect to its"):
        gradient.friction("/floor")
    with pytest.raises(SceneError, match="derivatives must be finite with shape"):
        r.backward(positions={1: {"/heap": np.zeros((2, 3))}})
    with pytest.raises(SceneError, match="allowed are 0 to 2"):
        r.backward(positions={3: {"/heap": np.zeros((120, 3))}})


@pytest.mark.parametrize("collider, said", [({"shape": wsim.Sphere(0.5)}, "is a Sphere"), ({"turn": True}, "that turns")])
def test_curved_and_turning_colliders_are_refused(collider, said):
    scene = heap("sand")
    motion = Motion.at_place((0, -3.0, 0))
    if "turn" in collider:
        ends = np.stack([np.eye(4), np.eye(4)])
        ends[1, :3, :3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]
        motion = Motion(np.array([0.0, 1.0]), ends)
    scene.collider("/ball", collider.get("shape", FLOOR), motion=motion)
    with pytest.raises(SceneError, match=said) as error:
        recorded(scene)
    assert error.value.problems[0].path == "/ball"
