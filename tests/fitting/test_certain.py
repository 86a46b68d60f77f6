"""What a fit claims: no more than solvers and rounding leave, nothing of what cannot be known, convergence where it is so."""

import numpy as np
import pytest

from tests.make.fitting.fit import CPU
from tools.bench.fitting.cases import chain, net, plain, poisson, soft
from wsim.fitting import Settings, Track, fit
from wsim.fitting.least_squares.normal_equations import NormalEquations
from wsim.fitting.observations.residuals import DifferenceSteps, Misfit, ResidualBlock
from wsim.fitting.parameter import parameters_of_names


def look(case, noise: float, sigma: float | None = None, frames=slice(None), x=None) -> list[Track]:
    """What is seen of an experiment, with a draw of noise."""
    x = (case.x if x is None else x)[frames]
    noisy = x + noise * np.random.default_rng(0).normal(size=x.shape)
    return [Track(case.path, case.frames[frames], noisy, case.points, sigma=sigma)]


def again(case, names, tracks, *settings):
    return fit(case.scene, tracks, names, start=case.start, settings=Settings("cpu", *settings))


@pytest.fixture(scope="module")
def swing():
    scene = soft(7e6, 0.3, 8)
    scene.integrator, scene.iterations = "backward_euler", 4         # which stop at a residual
    return plain(scene, 0.0, {"young": 7e6, "density": 1e3}, {"young": 2.1e7, "density": 5e2})


@pytest.fixture(scope="module")
def pluck():
    return chain()


@pytest.mark.parametrize("noise, differences", [(0.0, "central"), (0.0, "forward"), (1e-7, "central"), (0.1, "central")])
def test_a_pair_that_cannot_be_told_apart_is_said_so_at_any_noise(swing, noise, differences):
    """Young's modulus and density by a motion: exact, as a file in float32 keeps it, and with noise. What the solver leaves to
    chance is no answer, and the values stay near the start along what is not seen."""
    x = swing.x.astype(np.float32).astype(np.float64) if differences == "forward" else None
    found = again(swing, "young,density", look(swing, noise, x=x), differences)
    assert found.errors["young"] == found.errors["density"] == np.inf
    assert "only the ratio of young to density matters" in found.text()
    assert found.converged == (noise < 0.1)                      # then even the ratio is not known to a factor e, which is said
    if found.converged:
        assert found.values["young"] / found.values["density"] == pytest.approx(7e3, rel=1e-3)
        middle = np.sqrt(2.1e7 * 5e2 / (7e6 * 1e3))              # of the start, over the truth
        assert found.values["density"] == pytest.approx(1e3 * middle, rel=0.05)
    else:
        assert "show in what was observed by less than the noise" in found.text()


def test_no_noise_is_claimed_below_what_solvers_and_rounding_leave():
    case = poisson()
    found = again(case, "young,poisson", look(case, 0.0))
    assert found.sigma == pytest.approx(1e-7 * 0.6) and found.origin == "floor" and "as low as a fit claims" in found.text()
    far = [Track(case.path, case.frames, (case.x + 90.0).astype(np.float32).astype(np.float64), case.points)]
    misfit = Misfit([(case.scene, far)], parameters_of_names("young", [case.scene])[0], device="cpu")
    assert misfit.floor == pytest.approx(2.0**-17 / np.sqrt(12.0))             # float32 between 64 and 128
    known = again(case, "young,poisson", look(case, 1e-8, 1e-8))               # noise that was given is not believed below it
    assert known.sigma == pytest.approx(1e-7 * 0.6)
    assert known.errors["poisson"] == pytest.approx(found.errors["poisson"], rel=1e-2)


def test_a_wave_that_has_not_arrived_hides_nothing_later(pluck):
    """Frames with rounding alone come first: both are found, from three times off, without noise and with it."""
    for noise in (0.0, 1e-4):
        found = again(pluck, "stiffness,damping", look(pluck, noise))
        assert found.converged and max(found.errors["stiffness"] / 300.0, found.errors["damping"] / 2e-3) < 0.01
        for name, true in pluck.truth.items():
            assert abs(found.values[name] - true) < 3.5 * found.errors[name]


def test_a_start_that_nothing_has_touched_has_not_converged(pluck):
    """The first three frames at the far end: nothing has come yet."""
    found = again(pluck, "stiffness,damping", look(pluck, 1e-4, frames=slice(3)))
    assert not found.converged and np.isinf(list(found.errors.values())).all() and found.steps < 5
    assert found.values == pytest.approx(pluck.start, rel=1e-6)
    assert "NOT converged" in found.text() and "say nothing" in found.text()
    field = fit(pluck.scene, look(pluck, 1e-4, 1e-4, frames=slice(3)), "stiffness[]", settings=CPU)
    assert not field.converged and "say nothing" in field.text() and field.unseen("stiffness[]").all()
    short = fit(pluck.scene, look(pluck, 1e-4, 1e-5), "damping,stiffness[]", settings=Settings("cpu", limit=3.0))
    assert not short.converged and "not converged within 3 gradients" in short.text() and short.misfit > 3.0
    assert "were widened by that, and are not to be trusted" in short.text()


@pytest.mark.parametrize("limit", [200.0, 8.0])
def test_what_is_returned_was_run(limit):
    """chi^2, and so the noise, are of the very values that are returned, where it converged and where it was stopped."""
    case = net()
    tracks = look(case, 1e-3)
    found = fit(case.scene, tracks, "stiffness,damping", start=case.start, settings=Settings("cpu", limit=limit))
    misfit = Misfit([(found.scene, [Track(case.path, case.frames[k:k + 1], tracks[0].positions[k:k + 1])
                                    for k, f in enumerate(case.frames) if f <= found.frames])], found.parameters, device="cpu")
    r = np.concatenate([part.r for part in misfit.walk(found.estimate.theta)])
    assert np.sqrt((r**2).sum() / (len(r) - 2)) == pytest.approx(found.sigma * found.misfit, rel=1e-3)
    assert found.converged == (limit > 100.0) and ("not converged within 8" in found.text()) == (limit < 100.0)


def test_a_model_that_misses_something_is_not_trusted():
    """A pull to the side that is not there: with the noise that is given bars are widened; without it what is left is alike
    from frame to frame."""
    case = plain(soft(1e5, 0.3, 12), 1e-5, {"young": 1e5}, {"young": 1.5e5})
    case.scene.gravity = (0.3, -9.81, 0.0)
    found = again(case, "young", look(case, 1e-5, 1e-5))
    assert found.misfit > 5.0 and "were widened by that, and are not to be trusted" in found.text()
    right = again(case, "young", look(case, 1e-5, 1e-5 * found.misfit))
    assert found.errors["young"] == pytest.approx(right.errors["young"], rel=0.05)
    unknown = again(case, "young", look(case, 1e-5))
    assert "alike from frame to frame" in unknown.text() and unknown.origin == "estimated"


def test_chance_in_differences_is_no_answer():
    """Residuals that do not depend on the second parameter, but for chance of 1e-8, which 400 of them make look like 1e-2 at a
    step of 1e-3; a direction that does answer, and is a thousand times weaker than the first, is kept."""
    rng, t = np.random.default_rng(0), np.linspace(0.0, 1.0, 400)

    def sums(steps: DifferenceSteps, weak: float) -> NormalEquations:
        def f(theta):
            return np.sin(3.0 * t + theta[0]) + weak * t**2 * np.exp(theta[1]) + 1e-8 * rng.normal(size=t.shape)
        r, along = f(np.zeros(2)), [b * h for b, h in zip(steps.B.T, steps.h, strict=True)]
        ahead, behind = (np.array([f(s * a) for a in along]).T - r[:, None] for s in (1.0, -1.0))
        found = NormalEquations.at(np.zeros(2), steps, central=True)
        found.add(ResidualBlock(1.0, 1, r, ((ahead - behind) / (2.0 * steps.h)) @ steps.B.T, (ahead + behind) / steps.h**2))
        return found
    for weak, seen in ((0.0, False), (1e-3, True), (1e-5, True)):
        first = sums(DifferenceSteps.axes(2, 1e-3), weak)
        second = sums(first.next_steps(1e-3, 0.0, 1e-12), weak)
        assert second.spectrum().kept.tolist() == [True, seen]
        if seen:
            answer = weak * np.linalg.norm(t**2)
            assert second.spectrum().S[1] == pytest.approx(answer, rel=0.2) and second.steps.h[1] > 2e-3
