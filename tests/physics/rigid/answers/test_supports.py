"""Floors of flush pieces are one floor, and what turns or shakes carries along what stands on it."""

import pytest

from tests.conftest import first_and_slow
from tests.physics.rigid.answers.answered import check_case


@pytest.mark.parametrize("where", first_and_slow(["boxes/0.3/24x10", "boxes/2/60x8", "hulls/0.3/24x10", "mesh/0.3/24x10"]))
def test_a_ball_rolls_over_flush_tiles_as_over_one_floor(where):
    check_case(f"flush/{where}")


def test_a_cube_without_friction_does_not_jump_on_a_flat_mesh():
    check_case("flush/cube/24x10")


@pytest.mark.parametrize("where", first_and_slow(["box/60x8", "cylinder/60x8", "mesh/24x10", "platter/60x8"]))
def test_a_box_on_a_turntable_does_not_creep(where):
    check_case(f"carried/{where}")


def test_a_box_that_a_turntable_cannot_hold_leaves_it():
    check_case("carried/over the limit/60x8")


@pytest.mark.slow
@pytest.mark.parametrize("where", ["pile/24x10", "pile/60x8"])
def test_a_thousand_boxes_that_fall_on_each_other_overlap_by_ten_millimetres_at_most(where):
    check_case(f"unchanged/{where}")
