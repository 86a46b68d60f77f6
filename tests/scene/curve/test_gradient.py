"""Gradients by keys, slopes and easing handles against complex-free differences, float64."""

import numpy as np
import pytest

from wsim.scene.curve import Curve

TIMES = np.array([0.0, 0.7, 1.1, 2.0, 3.4])
P = np.random.default_rng(5).normal(size=(5, 3))
HANDLES = [(0.2, 0.4, 0.7, 1.3), "bounce-out", "hold", (0.9, -0.2, 0.1, 0.8)]
MADE = {"linear": {}, "hold": {}, "catmull_rom": {}, "centripetal": {"kind": "catmull_rom", "alpha": 0.5}, "monotone": {},
        "kochanek_bartels": {"tension": 0.3, "bias": -0.2, "continuity": 0.4}, "eased": {"easing": HANDLES},
        "hermite": {"leave": np.sin(P), "arrive": np.cos(P)},
        "jumps": {"kind": "hermite", "leave": np.sin(P), "arrive": np.cos(P), "until": P[::-1],
                  "form": ["curve", "linear", "hold", "curve"]},
        "bezier": {"leave": np.sin(P), "arrive": np.cos(P), "leave_width": [0.5, 0.3, 0.2, 1.0, 0.0]}}


def made(name, outside="held", values=P, **more) -> Curve:
    how = {"kind": name, **MADE[name]} | more
    return Curve(TIMES, values, before=outside, after=outside, **how)


def slope(f, at, eps=1e-6) -> np.ndarray:
    found = np.zeros_like(at)
    for k in np.ndindex(*at.shape):
        step = np.zeros_like(at)
        step[k] = eps
        found[k] = (f(at + step) - f(at - step)) / (2 * eps)
    return found


@pytest.mark.parametrize("outside", ["held", "linear", "repeat", "reset", "oscillate"])
@pytest.mark.parametrize("name", MADE)
def test_gradients_by_keys_slopes_and_handles_are_those_of_differences(name, outside):
    t = np.linspace(-1.93, 5.61, 57)
    by = np.random.default_rng(1).normal(size=(57, 3))
    if name == "eased" and outside == "linear":
        with pytest.raises(ValueError, match="slope of an easing"):
            made(name, outside).pulled(t, by)
        return
    found = made(name, outside).pulled(t, by)

    def loss(**how) -> float:
        return float((made(name, outside, **how).sampled(t) * by).sum())
    np.testing.assert_allclose(found["values"], slope(lambda v: loss(values=v), P), rtol=1e-7, atol=1e-7)
    for part in ("leave", "arrive", "until"):
        if part in MADE[name]:
            np.testing.assert_allclose(found[part], slope(lambda v, part=part: loss(**{part: v}), np.array(
                made(name).how[part])), rtol=1e-7, atol=1e-7)
    if name == "eased":
        for k in (0, 3):
            def handled(v, k=k):
                return loss(easing=[tuple(v) if j == k else e for j, e in enumerate(HANDLES)])
            np.testing.assert_allclose(found["easing"][k], slope(handled, np.array(HANDLES[k])), rtol=1e-6, atol=1e-6)
        assert not found["easing"][1:3].any()


@pytest.mark.parametrize("outside", ["held", "linear", "repeat", "oscillate"])
@pytest.mark.parametrize("name", ["linear", "hold", "catmull_rom", "kochanek_bartels", "eased"])
def test_weights_times_keys_are_the_values(name, outside):
    t = np.linspace(-1.93, 5.61, 57)
    curve = made(name, outside)
    np.testing.assert_allclose(curve.weights(t) @ curve.values, curve.sampled(t), atol=1e-12)
