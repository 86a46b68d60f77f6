"""Splines and easing against closed forms, USD's own splines and SciPy."""

import numpy as np
import pytest
from pxr import Gf, Ts

from wsim.scene.curve import Curve
from wsim.scene.curve.easing import CSS, FAMILIES, NAMES, ease_fractions

RULES = (lambda t, v: Curve(t, v, "catmull_rom"), lambda t, v: Curve(t, v, "catmull_rom", alpha=0.5),
         lambda t, v: Curve(t, v, "kochanek_bartels", tension=0.3, bias=-0.4, continuity=0.2),
         lambda t, v: Curve(t, v, "monotone"),
         lambda t, v: Curve(t, v, "hermite", leave=np.sin(v), arrive=np.cos(v)))


def keys(seed=0, n=7, shape=()):
    rng = np.random.default_rng(seed)
    return np.cumsum(rng.uniform(0.2, 1.5, n)), rng.normal(size=(n, *shape))


def usd(times, values, arrive, leave) -> Ts.Spline:
    """The same Hermite curve as USD has it."""
    spline = Ts.Spline()
    spline.SetCurveType(Ts.CurveTypeHermite)
    for k, (t, v) in enumerate(zip(times, values, strict=True)):
        knot = Ts.Knot(typeName="double", time=float(t), value=float(v), curveType=Ts.CurveTypeHermite,
                       nextInterp=Ts.InterpCurve, preTanSlope=float(arrive[k]), postTanSlope=float(leave[k]))
        spline.SetKnot(knot)
    return spline


@pytest.mark.parametrize("rule", RULES, ids=("by times", "centripetal", "kochanek", "monotone", "hermite"))
def test_a_spline_is_that_of_usd_with_its_slopes(rule):
    times, values = keys()
    ours = rule(times, values)
    theirs = usd(times, values, *ours.slopes())
    at = np.linspace(times[0], times[-1], 301)
    np.testing.assert_allclose(ours.sampled(at), [theirs.Eval(t) for t in at], atol=1e-12)
    inner = at[~np.isclose(at[:, None], times).any(1)]
    np.testing.assert_allclose(ours.rate(inner), [theirs.EvalDerivative(t) for t in inner], atol=1e-10)


def test_catmull_rom_undershoots_a_unit_step_by_two_twenty_sevenths():
    step = Curve(np.arange(4.0), [0.0, 0.0, 1.0, 1.0], "catmull_rom")
    assert step.at(2 / 3) == pytest.approx(-2 / 27, abs=1e-15)
    assert step.sampled(np.linspace(0, 3, 30001)).min() == pytest.approx(-2 / 27, abs=1e-9)


@pytest.mark.parametrize("rule", RULES, ids=("by times", "centripetal", "kochanek", "monotone", "hermite"))
def test_rates_are_the_derivative_and_keys_are_met(rule):
    times, values = keys(1, 6, (3,))
    curve = rule(times, values)
    np.testing.assert_allclose(curve.sampled(times), values, atol=1e-15)
    at, h = np.linspace(times[0], times[-1], 200)[1:-1], 1e-6
    at = at[(np.abs(at[:, None] - times) > 2 * h).all(1)]
    np.testing.assert_allclose(curve.rate(at), (curve.sampled(at + h) - curve.sampled(at - h)) / (2 * h), atol=1e-7)
    assert np.array_equal(curve.at(times[0] - 1), values[0]) and np.array_equal(curve.at(times[-1] + 1), values[-1])
    assert not curve.rate([times[0] - 1, times[-1] + 1]).any()


def test_a_monotone_spline_never_leaves_the_range_of_its_keys():
    for seed in range(300):
        times, values = keys(seed, np.random.default_rng(seed).integers(2, 8))
        curve = Curve(times, values, "monotone")
        for k in range(len(times) - 1):
            found = curve.sampled(np.linspace(times[k], times[k + 1], 50))
            low, high = sorted(values[k:k + 2])
            assert found.min() >= low - 1e-12 and found.max() <= high + 1e-12


def test_a_monotone_spline_is_scipys():
    interpolate = pytest.importorskip("scipy.interpolate")
    for seed in range(20):
        times, values = keys(seed)
        at = np.linspace(times[0], times[-1], 400)
        np.testing.assert_allclose(Curve(times, values, "monotone").sampled(at),
                                   interpolate.PchipInterpolator(times, values)(at), atol=1e-12)


def test_without_tension_bias_and_continuity_it_is_catmull_rom_and_tension_one_is_still_at_the_keys():
    times, values = keys(3)
    plain = Curve(times, values, "kochanek_bartels")
    assert all(np.array_equal(a, b) for a, b in zip(plain.slopes(), Curve(times, values, "catmull_rom").slopes(), strict=True))
    assert not np.any(Curve(times, values, "kochanek_bartels", tension=1.0).slopes())
    inner = Curve(np.arange(7.0), np.arange(7.0) ** 2, "catmull_rom")           # a parabola's slopes are right
    np.testing.assert_allclose(inner.slopes()[0][1:-1], 2 * np.arange(7.0)[1:-1])


def test_a_centripetal_path_has_one_tangent_at_a_key_and_no_cusp_where_the_uniform_one_loops():
    times = np.arange(4.0)
    path = np.array([(0.0, 0), (1, 1), (1.02, 1), (2, 0)])     # two keys close together
    curve = Curve(times, path, "catmull_rom", alpha=0.5)
    for k in (1, 2):
        a, b = (slopes[k] for slopes in curve.slopes())
        assert a @ b / np.linalg.norm(a) / np.linalg.norm(b) == pytest.approx(1.0, abs=1e-12)
    at = np.linspace(1, 2, 500)[1:-1]
    assert (curve.rate(at)[:, 0] > 0).all()                    # goes on
    assert (Curve(times, path, "catmull_rom", alpha=0.0).rate(at)[:, 0] < 0).any()     # turns back: a loop


def test_weights_of_keys_are_the_derivative_with_respect_to_their_values():
    times, values = keys(4, 6, (2,))
    at = np.linspace(times[0] - 0.5, times[-1] + 0.5, 40)
    for curve in (Curve(times, values, "catmull_rom"), RULES[2](times, values)):
        np.testing.assert_allclose(np.tensordot(curve.weights(at), values, 1), curve.sampled(at), atol=1e-12)
    with pytest.raises(ValueError, match="monotone"):
        Curve(times, values, "monotone").weights(at)


@pytest.mark.parametrize("wrong", [
    (lambda: Curve([0, 1, 1], [0, 1, 2], "catmull_rom"), "key 2 at 1 s follows key 1 at 1 s; sort the keys"),
    (lambda: Curve([0, 2, 1], [0, 1, 2]), "key 2 at 1 s follows key 1 at 2 s"),
    (lambda: Curve([0, 1], [0.0, np.nan], "catmull_rom"), "finite"),
    (lambda: Curve([0, 1], [0.0, 1.0], "hermite", leave=[1.0]), "one finite slope a value"),
    (lambda: Curve([0, 1], [0.0, 1.0], "hermite"), "needs leave"),
    (lambda: Curve([0, 1], [0.0, 1.0], "catmull_rom", alpha=2.0), "alpha"),
    (lambda: Curve([0, 1], [0.0, 1.0], "cubic"), "no kind of curve is called 'cubic'; there are linear, hold"),
    (lambda: Curve([0, 1], [0.0, 1.0], "monotone", tension=1.0), "takes nothing"),
    (lambda: Curve([0, 1], [0.0, 1.0], after="forever"), "held, linear, repeat, reset, oscillate"),
    (lambda: Curve([0, 1], [0.0, 1.0], after=np.nan), "finite"),
    (lambda: Curve([0, 1], [0.0, 1.0], "bezier", leave=[0, 0], leave_width=[2.0, 0.0]), "time does not run back"),
    (lambda: Curve([0, 1, 2], [0.0, 1.0, 2.0], "eased", easing=["ease"]), "1 easings for 2 pieces"),
    (lambda: Curve([0, 1], [0.0, 1.0], "eased", easing="fast"), "no easing is called 'fast'"),
    (lambda: Curve([], []), "one value a time")])
def test_what_is_no_curve_is_refused_with_what_was_found_and_what_is_allowed(wrong):
    make, said = wrong
    with pytest.raises(ValueError, match=said):
        make()


def test_one_key_is_a_constant():
    curve = Curve([2.0], [[1.0, 2.0]], "catmull_rom")
    assert curve.at(-1.0).tolist() == [1.0, 2.0] == curve.at(5.0).tolist() and not curve.rate([2.0]).any()


@pytest.mark.parametrize("name", NAMES)
def test_an_easing_begins_at_0_ends_at_1_and_its_rate_is_the_derivative(name):
    assert ease_fractions(name, [0.0, 1.0])[0] == pytest.approx([0.0, 1.0], abs=1e-15)
    s, h = np.linspace(0.0, 1.0, 1999)[100:-100], 1e-6
    slope = (ease_fractions(name, s + h)[0] - ease_fractions(name, s - h)[0]) / (2 * h)
    wrong = np.abs(slope - ease_fractions(name, s)[1]) > 1e-7 * np.maximum(1.0, np.abs(slope)) ** 3  # steep: differences err
    assert wrong.sum() <= 3                                    # corners of bounce and of halves


def test_css_eases_are_their_beziers():
    """De Casteljau at the parameter where x is s, by bisection."""
    for name, (x1, y1, x2, y2) in CSS.items():
        for s in np.linspace(0, 1, 21):
            low, high = 0.0, 1.0
            for _ in range(60):
                u = 0.5 * (low + high)
                x = 3 * u * (1 - u) ** 2 * x1 + 3 * u * u * (1 - u) * x2 + u ** 3
                low, high = (u, high) if x < s else (low, u)
            assert ease_fractions(name, s)[0] == pytest.approx(3 * u * (1 - u) ** 2 * y1 + 3 * u * u * (1 - u) * y2 + u ** 3,
                                                               abs=1e-12)
    assert ease_fractions("ease", [0.25, 0.5, 0.75])[0] == pytest.approx([0.408511, 0.802403, 0.960459], abs=5e-7)
    steep, near = ease_fractions((0.0, 0.3, 0.0, 1.0), [1e-9, 0.5])[0], ease_fractions((1e-13, 0.3, 1e-13, 1.0), [1e-9, 0.5])[0]
    assert steep == pytest.approx(near, abs=1e-6)


def test_forms_of_a_family_mirror_each_other():
    s = np.linspace(0, 1, 101)
    for family in FAMILIES:
        np.testing.assert_allclose(ease_fractions(f"{family}-out", s)[0], 1 - ease_fractions(f"{family}-in", 1 - s)[0],
                                   atol=1e-15)
        half = ease_fractions(f"{family}-in-out", s)[0]
        np.testing.assert_allclose(half, 1 - half[::-1], atol=1e-12)
    assert ease_fractions("back-in", s)[0].min() == pytest.approx(-0.1, abs=1e-4)
    bounces = ease_fractions("bounce-out", np.linspace(0, 1, 100001))[0]
    assert bounces[36363] == pytest.approx(1.0, abs=1e-4)      # first touch at 1 / 2.75


def test_unknown_easings_and_handles_that_go_back_in_time_are_refused():
    with pytest.raises(ValueError, match="no easing is called 'fast'"):
        ease_fractions("fast", 0.5)
    with pytest.raises(ValueError, match="x in 0"):
        ease_fractions((1.2, 0.0, 0.5, 1.0), 0.5)


def test_a_bezier_of_usd_is_hermite_with_handles_of_a_third():
    """Handles at a third of the time make x(u) = u."""
    values, (m, n) = (1.0, 3.0), (2.0, -1.0)
    spline = Ts.Spline()
    for k, t in enumerate((0.0, 2.0)):
        spline.SetKnot(Ts.Knot(typeName="double", time=t, value=values[k], nextInterp=Ts.InterpCurve, preTanSlope=n,
                               preTanWidth=2 / 3, postTanSlope=m, postTanWidth=2 / 3))
    ours = Curve([0.0, 2.0], values, "hermite", leave=[m, n])
    at = np.linspace(0, 2, 50)
    np.testing.assert_allclose(ours.sampled(at), [spline.Eval(t) for t in at], atol=1e-12)
    assert Gf.IsClose(ours.at(1.0).item(), spline.Eval(1.0), 1e-12)
