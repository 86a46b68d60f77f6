"""The adjoints of membranes and of bending by hand: each kernel alone, against differences of the forces."""

import numpy as np
import pytest

from tests.make.physics.cloth.element_adjoint import Case


@pytest.mark.parametrize("damped", [False, True])
@pytest.mark.parametrize("constraint", ["membrane", "dihedral"])
def test_gradients_are_those_of_differences(constraint, damped):
    case, rng = Case(constraint, damped), np.random.default_rng(6)
    direct, placed = case.gradients(True), case.gradients(False)
    for name in ("x", "d", "rest", "stiffness", *(("v", "tau") if damped else ()), *(("value",) * (constraint == "dihedral"))):
        way = rng.normal(size=case.values[name].shape)
        assert np.array_equal(direct[name], placed[name])
        assert (direct[name] * way).sum() == pytest.approx(case.slope(name, way), rel=1e-9)
    if not damped:
        assert not direct["v"].any() and not direct["tau"].any()


def test_momentum_has_no_gradient():
    """Nobody gains by a shift of all points."""
    for constraint in ("membrane", "dihedral"):
        case = Case(constraint, True)
        found = case.gradients(True)
        for name in ("x", "v"):
            each = found[name].reshape(case.count, case.corners, 3)
            assert np.abs(each.sum(axis=1)).max() < 1e-13 * np.abs(each).max()


def test_what_has_no_angle_or_no_area_has_gradients_that_are_numbers():
    """A triangle without height, one shrunk to a point, and one folded onto itself."""
    for constraint, damped in (("membrane", True), ("dihedral", True)):
        case = Case(constraint, damped)
        x = case.values["x"].reshape(case.count, case.corners, 3)
        x[0, 2] = 0.5 * (x[0, 0] + x[0, 1])
        x[1] = x[1, 0]
        x[2, -1] = x[2, 2] if case.corners == 4 else x[2, 1]
        case.values["d"][:] = 0.0
        assert all(np.isfinite(a).all() for a in case.gradients(True).values())
