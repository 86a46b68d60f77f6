"""A rollout as a layer of PyTorch. That package is an extra (`torch`) and large: where it is not installed, these tests are
skipped. What the wrapper calls is tested by tests/gradient/test_products.py all the same."""

import numpy as np
import pytest

from tests.make.gradient.gradients import bar, net, sheet
from wsim.gradient.recording import Recording
from wsim.scene import SceneError
from wsim.simulation.simulation import Simulation

torch = pytest.importorskip("torch", reason="PyTorch is not installed: pip install -e .[torch]")
from wsim.gradient.rollout.torch import Layer  # noqa: E402

CASES = {
    "chain": (lambda: net(integrator="leapfrog"), ["/chain:stiffness", "/chain:positions", "gravity", "/pin:targets"]),
    "membrane": (lambda: sheet("membrane", substeps=40), ["/cloth:stretch", "/cloth:bend", "/cloth:velocities"]),
    "implicit": (lambda: sheet("springs", solver="implicit", integrator="backward_euler", substeps=2), ["/cloth:density"]),
    "solid": (lambda: bar("corotational"), ["/bar:young", "/bar:poisson"]),
}


def layer(scene, names, frames=None, precision="float64", count=2, **how) -> Layer:
    sim = Simulation(scene, device="cpu", precision=precision, gradients=True)
    return Layer(Recording(sim, count), names, frames, **how)


@pytest.mark.parametrize("key", CASES)
def test_gradcheck(key):
    """In float64, of inputs in units of their own size, so that torch's differences are right to 1e-8."""
    make, names = CASES[key]
    f = layer(make(), names, [2])
    sizes = [20.0 * i.difference_scale() for i in f.rollout.inputs.values()]
    given = [(value / size).requires_grad_() for value, size in zip(f.values(), sizes, strict=True)]

    def scaled(*u):
        return f(*(a * size for a, size in zip(u, sizes, strict=True)))
    assert torch.autograd.gradcheck(scaled, given, eps=1e-5, rtol=1e-6, atol=1e-7, fast_mode=True)


def test_an_optimiser_recovers_a_stretch_and_a_push():
    """From the last positions and velocities of a run; the stretch by its logarithm."""
    f = layer(sheet("membrane", substeps=40), ["/cloth:stretch", "/cloth:velocities"], count=4)
    push = torch.tensor([0.3, -0.2, 0.5], dtype=torch.float64)
    free = torch.ones(25, 1, dtype=torch.float64)
    free[[20, 24]] = 0.0                                             # the pins
    wanted = [part.detach() for part in f(torch.tensor(25.0), free * push)]
    theta = torch.tensor(np.log(40.0), requires_grad=True)
    found = torch.zeros(3, dtype=torch.float64, requires_grad=True)
    descent = torch.optim.LBFGS([theta, found], max_iter=60, line_search_fn="strong_wolfe", tolerance_grad=1e-12,
                                tolerance_change=1e-14)

    def loss():
        descent.zero_grad()
        x, v = f(theta.exp(), free * found)
        missed = 1e4 * ((x - wanted[0]) ** 2).sum() + ((v - wanted[1]) ** 2).sum()
        missed.backward()
        return missed
    descent.step(loss)
    assert float(theta.exp().detach()) == pytest.approx(25.0, rel=1e-3)
    assert found.detach().numpy() == pytest.approx(push.numpy(), abs=1e-4)


def test_it_stands_between_other_layers():
    """A small net chooses stiffness and gravity; every weight gets a gradient, in its own precision."""
    f = layer(net(integrator="leapfrog"), ["/chain:stiffness", "gravity"], precision="float32")
    torch.manual_seed(1)
    head, tail = torch.nn.Linear(3, 14), torch.nn.Linear(36, 1)
    out = head(torch.ones(3))
    x, v = f(30.0 + out[:11].tanh(), out[11:])
    assert x.shape == v.shape == (2, 12, 3) and x.dtype == torch.float32
    tail(x[1].flatten()).sum().backward()
    assert all(p.grad is not None and p.grad.abs().sum() > 0.0 for p in head.parameters())


def test_outputs_in_float64_of_a_float32_run_carry_the_remainders():
    f = layer(net(integrator="leapfrog"), ["gravity"], precision="float32", dtype=torch.float64)
    x, v = f(torch.tensor(f.rollout.values()["gravity"]))
    y = f.rollout.motion()
    assert np.abs(f.recording.rests.numpy()).max() > 0.0
    assert np.array_equal(x.numpy(), y[0]) and np.array_equal(v.numpy(), y[1])


def test_two_rollouts_of_one_recording_have_their_own_gradients():
    f = layer(net(integrator="leapfrog"), ["/chain:stiffness"])
    ways, alone = [30.0, 38.0], []
    for k in ways:
        value = torch.tensor(k, requires_grad=True)
        f(value)[0].pow(2).sum().backward()
        alone.append(value.grad)
    both = [torch.tensor(k, requires_grad=True) for k in ways]
    runs = [f(k)[0] for k in both]
    assert not torch.equal(*runs)
    sum(x.pow(2).sum() for x in runs).backward()
    assert torch.equal(torch.stack([k.grad for k in both]), torch.stack(alone))


def test_what_is_no_input_may_not_change_before_the_backward_pass():
    f = layer(net(integrator="leapfrog"), ["/chain:stiffness"])
    x, _ = f(torch.tensor(30.0, requires_grad=True))
    f.recording.sim.set("/", "gravity", (0.0, 0.0, -3.0))
    f(torch.tensor(35.0))
    with pytest.raises(SceneError, match="between its forward and its backward pass"):
        x.sum().backward()


def test_wrong_tensors_and_second_derivatives_are_refused():
    f = layer(net(integrator="leapfrog"), ["/chain:stiffness"])
    with pytest.raises(SceneError, match="found 2 tensors; allowed are 1: /chain:stiffness"):
        f(torch.tensor(1.0), torch.tensor(1.0))
    with pytest.raises(SceneError, match=r"allowed are \(\), \(11,\)"):
        f(torch.ones(3))
    k = torch.tensor(30.0, dtype=torch.float64, requires_grad=True)
    first, = torch.autograd.grad(f(k)[0].pow(2).sum(), k, create_graph=True)
    with pytest.raises(RuntimeError, match="once_differentiable"):
        first.backward()


def test_worlds_are_a_batch():
    """Each row has the outputs and gradients that it has alone; what all share has the sum."""
    scene, names = net(integrator="leapfrog"), ["/chain:stiffness", "gravity"]
    sims = [Simulation(scene, device="cpu", precision="float64", worlds=w, gradients=True) for w in (3, 1)]
    many, one = (Layer(Recording(sim, 2), names, [2]) for sim in sims)
    k = torch.tensor([30.0, 34.0, 38.0], dtype=torch.float64, requires_grad=True)
    g = torch.tensor([0.0, -9.0, 1.0], dtype=torch.float64, requires_grad=True)
    x, v = many(k, g)
    assert x.shape == (3, 1, 12, 3)
    way = torch.randn(3, 1, 12, 3, dtype=torch.float64)
    (x * way).sum().backward()
    total = 0
    for w in range(3):
        a, b = k[w].detach().requires_grad_(), g.detach().requires_grad_()
        y, _ = one(a, b)
        assert torch.allclose(y, x[w], rtol=0, atol=1e-13)
        (y * way[w]).sum().backward()
        assert torch.allclose(a.grad, k.grad[w], rtol=1e-10)
        total = total + b.grad
    assert torch.allclose(total, g.grad, rtol=1e-11)
