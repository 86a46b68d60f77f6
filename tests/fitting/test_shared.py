"""Experiments that share some of the parameters, and fits whose copies take turns."""

from dataclasses import replace

import numpy as np
import pytest

from tests.make.fitting.shared import HOW, WINDS, hung, seen
from wsim.fitting.fit import Settings, fit
from wsim.scene import SceneError


def together(shared, solver: str = "xpbd", **more):
    one, other = (seen(hung(solver, wind)) for wind in WINDS)
    begun = hung(solver, stretch=200.0, wind=2.0)
    return fit(begun, one, "stretch,wind_x", also=[(replace(begun), other)],
               settings=Settings(device="cpu", shared=shared, **more))


def test_what_is_shared_and_what_is_of_each_are_found_together():
    """One fabric in two winds."""
    found = together(("stretch",))
    assert found.converged and list(found.values) == ["stretch", "wind_x@1", "wind_x@2"]
    assert found.values["stretch"] == pytest.approx(300.0, rel=1e-3)
    assert [found.values[f"wind_x@{k}"] for k in (1, 2)] == pytest.approx(WINDS, rel=1e-3)
    assert [s.wind[0] for s in found.scenes] == pytest.approx(WINDS, rel=1e-3)
    assert {s.cloths[0].material.stretch for s in found.scenes} == {found.values["stretch"]}
    assert [p.get("experiment") for p in found.as_dict()["parameters"]] == [None, 1, 2]


def test_a_wind_that_two_experiments_are_said_to_share_fits_neither():
    found = together(None)
    assert list(found.values) == ["stretch", "wind_x"] and found.misfit > 10.0


def test_what_two_experiments_know_of_what_they_share_is_more_than_one_does():
    alone = fit(hung(wind=2.0), seen(hung(wind=WINDS[0])), "stretch,wind_x", settings=Settings(device="cpu"))
    assert together(("stretch",)).errors["stretch"] < 0.9 * alone.errors["stretch"]


def test_a_name_that_is_not_fitted_cannot_be_shared():
    with pytest.raises(SceneError, match="bend: is shared and not fitted; fitted are stretch, wind_x"):
        together(("bend",))
    with pytest.raises(SceneError, match="there is one experiment"):
        fit(hung(), seen(hung()), "stretch", settings=Settings(device="cpu", shared=("stretch",)))


@pytest.mark.parametrize("solver", list(HOW))
def test_copies_that_take_turns_give_the_same_fit_to_the_bit(solver):
    """Seven copies of two experiments at once, and three at a time, by contacts in every frame."""
    whole, parts = (together(("stretch",), solver, copies=copies) for copies in (None, 3))
    assert np.array_equal(whole.estimate.theta, parts.estimate.theta)
    assert np.array_equal(whole.estimate.singular, parts.estimate.singular)
    assert (whole.steps, whole.simulations, whole.residuals) == (parts.steps, parts.simulations, parts.residuals)
