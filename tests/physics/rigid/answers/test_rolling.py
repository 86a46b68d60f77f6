"""Round bodies roll: they keep speed, height and way on the level, and go down a slope as their closed form says."""

import numpy as np
import pytest

from tests.conftest import first_and_slow
from tests.physics.rigid.answers.answered import check_case
from tools.bench.rigid.answers import coin, prism
from tools.bench.rigid.answers.rolling import cone_steady


@pytest.mark.parametrize("where", first_and_slow(["plane/24x10/37", "plane/60x8/0", "box/24x10/37", "plane/24x10/37/r0.012"]))
def test_a_wheel_keeps_its_speed_its_height_and_its_way(where):
    check_case(f"roll/wheel/{where}")


@pytest.mark.parametrize("shape", first_and_slow(["barrel", "disc", "coin", "drum"]))
def test_other_round_bodies_keep_theirs_at_the_defaults_of_a_stage(shape):
    check_case(f"roll/{shape}/plane/24x10/37")


@pytest.mark.slow
def test_a_cone_on_its_side_rolls_about_its_apex():
    check_case("roll/cone/plane/60x8")


def test_the_axis_of_contact_of_a_rolling_cone_does_not_move():
    """The closed form itself: the velocity of the centre of mass is that of a turn about the line of contact."""
    known = cone_steady(0.3, 0.6, 1.0)
    center = 0.45 * known["axis"]
    assert np.abs(np.cross(known["spin"], center) - (0.0, 1.0, 0.0)).max() < 1e-12


@pytest.mark.parametrize("where", first_and_slow(["25/plane/24x10", "10/plane/60x8", "2/plane/24x10", "10/box/24x10"]))
def test_cylinders_hoops_and_balls_go_down_a_slope_as_their_moments_say(where):
    check_case(f"slope/{where}")


@pytest.mark.parametrize("name", coin.COINS)
def test_the_steady_precession_of_a_coin_is_that_of_its_equations_of_motion(name):
    check_case(f"coin/reference/{name}")


@pytest.mark.parametrize("name", first_and_slow(["thick", "thin"]))
def test_a_leaning_coin_precesses_as_it_should(name):
    check_case(f"coin/{name}")


@pytest.mark.parametrize("name", first_and_slow(["0.1x0.001/5", "0.1x0.001/40", "0.1x0.01/20", "0.0125x0.001/20"]))
def test_an_eulers_disc_keeps_its_energy_to_second_order(name):
    check_case(f"coin/spun/{name}")


@pytest.mark.parametrize("lean", first_and_slow(["0", "25"]))
def test_a_prism_rolls_with_the_substeps_that_its_facets_want(lean):
    check_case(f"prism/auto/{lean}")


def test_a_prism_of_many_sides_loses_what_its_edges_take():
    """Beside Moreau's time stepping of the plane; 64 sides from 5 m/s have 4.6 m/s after 2 s."""
    check_case("prism/64/5/plane/960x1")


def test_a_planar_octagon_slows_down_at_each_edge_by_its_closed_form():
    assert abs(prism.planar(8, 1.6, 0.5)[0] - prism.over_corner(8, 1.6, 2)) < 5e-3
