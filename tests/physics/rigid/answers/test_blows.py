"""Elastic blows without friction, and fast bodies that meet thin walls."""

import pytest

from tests.conftest import first_and_slow
from tests.physics.rigid.answers.answered import check_case


@pytest.mark.parametrize("where", first_and_slow(["floor/r0.0285/24x10", "free/r0.0285/240x2", "free/r0.1x3/24x10"]))
def test_a_struck_ball_leaves_along_the_line_of_centres_and_a_missed_one_stays(where):
    check_case(f"blow/balls/{where}")


@pytest.mark.slow
@pytest.mark.parametrize("pair", ["ball-box", "capsule-capsule", "ball-capsule"])
def test_what_is_struck_leaves_along_the_normal_at_the_time_of_impact(pair):
    check_case(f"blow/{pair}/60x8/0.05")


@pytest.mark.slow
@pytest.mark.parametrize("where", [f"{wall}/24x10/e0{spin}" for wall in ("box", "mesh", "body") for spin in ("", "/spin25")])
def test_nothing_passes_a_wall_of_two_millimetres_at_a_hundred_metres_a_second(where):
    check_case(f"wall/{where}")
