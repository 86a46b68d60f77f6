"""A rollout as a function of JAX: gradients, jit, vmap. The package is an extra (`jax`): where it is not installed, these tests
are skipped."""

import numpy as np
import pytest

from tests.make.gradient.gradients import net
from wsim.gradient.recording import Recording
from wsim.gradient.rollout.products import Rollout
from wsim.simulation.simulation import Simulation

jax = pytest.importorskip("jax", reason="JAX is not installed: pip install -e .[jax]")
from wsim.gradient.rollout.jax import function  # noqa: E402

NAMES, FRAMES = ["/chain:stiffness", "gravity"], [1, 2]
STIFFNESS = np.array([30.0, 34.0, 38.0])
GRAVITY = np.array([[0.0, -9.0, 1.0], [1.0, -8.0, 0.0], [0.0, -10.0, 2.0]])


@pytest.fixture(scope="module")
def recording() -> Recording:
    return Recording(Simulation(net(integrator="leapfrog"), device="cpu", precision="float64", gradients=True), 2)


@pytest.fixture(autouse=True)
def doubles():
    """For all threads: `jax.enable_x64` holds in its own, and callbacks run in others."""
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", before)


def loss_of(f):
    return lambda *given: (f(*given)[0] ** 2).sum() + 0.1 * (f(*given)[1] ** 2).sum()


def test_the_gradient_is_that_of_the_rollout(recording):
    rollout = Rollout(recording, NAMES, FRAMES)
    y = rollout.run(dict(zip(NAMES, (STIFFNESS[0], GRAVITY[0]), strict=True)))
    found = rollout.vjp(2.0 * np.stack([y[0], 0.1 * y[1]]))
    loss = jax.jit(jax.grad(loss_of(function(recording, NAMES, FRAMES)), (0, 1)))
    for mine, name in zip(loss(STIFFNESS[0], GRAVITY[0]), NAMES, strict=True):
        assert np.asarray(mine) == pytest.approx(found[name], rel=1e-12)


def test_vmap_gives_each_row_what_it_has_alone(recording):
    """Motions and gradients of rows of both inputs, and of one, with the other shared."""
    f = function(recording, NAMES, FRAMES)
    slope = jax.grad(loss_of(f), (0, 1))
    for axes, given in (((0, 0), (STIFFNESS, GRAVITY)), ((0, None), (STIFFNESS, GRAVITY[0])), ((None, 0), (30.0, GRAVITY))):
        rows = [tuple(g[k] if a == 0 else g for a, g in zip(axes, given, strict=True)) for k in range(3)]
        for many, one in ((jax.vmap(f, axes), f), (jax.jit(jax.vmap(slope, axes)), slope)):
            for found, alone in zip(many(*given), zip(*[one(*row) for row in rows], strict=True), strict=True):
                assert np.array_equal(found, np.stack(alone))


def test_jacrev_is_the_jacobian_of_differences(recording):
    f = function(recording, NAMES, [2])
    found = np.asarray(jax.jacrev(lambda k: f(k, GRAVITY[0])[0][0, 2])(STIFFNESS[0]))
    ends = [np.asarray(f(STIFFNESS[0] + s, GRAVITY[0])[0][0, 2]) for s in (1e-3, -1e-3)]
    assert found.shape == (3,) and found == pytest.approx((ends[0] - ends[1]) / 2e-3, rel=1e-7, abs=1e-12)
