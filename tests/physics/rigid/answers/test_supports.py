"""Floors of flush pieces are one floor, and what turns or shakes carries along what stands on it."""

import numpy as np
import pytest

from tests.conftest import first_and_slow
from tests.physics.rigid.answers.answered import check_case
from tools.bench.rigid.answers.stage import Stage, framed
from wsim.scene import Box, Sphere


@pytest.mark.parametrize("where", first_and_slow(["boxes/0.3/24x10", "boxes/2/60x8", "hulls/0.3/24x10", "mesh/0.3/24x10"]))
def test_a_ball_rolls_over_flush_tiles_as_over_one_floor(where):
    check_case(f"flush/{where}")


def test_a_ball_rolls_over_tiles_that_rise_together_as_over_tiles_that_stand():
    """Motion at a constant velocity changes nothing (Galileo): at 2 m/s the ball keeps its speed, and its height above them."""
    stage, rise, r, v = Stage(24.0, 10), np.array([0.0, 0.0, 0.2]), 0.1, 2.0
    for k in range(8):
        place = np.array([0.5 * k, 0.0, -0.1])
        stage.carrier(f"/tile{k}", Box((0.25, 0.5, 0.1)), [0.0, 2.0], [framed(place), framed(place + 2.0 * rise)])
    stage.body("/ball", Sphere(r), (0.0, 0.05, r), velocity=(v, 0.0, 0.0) + rise, spin=(0.0, v / r, 0.0))
    track = stage.run(1.5)
    x = track.x[:, 0] - track.t[:, None] * rise
    assert np.ptp(x[4:, 2]) < 2e-5 and np.abs(x[:, 1] - 0.05).max() < 1e-4
    assert np.abs(track.v[:, 0, 0] / v - 1.0).max() < 1e-4


def test_a_cube_without_friction_does_not_jump_on_a_flat_mesh():
    check_case("flush/cube/24x10")


@pytest.mark.parametrize("where", first_and_slow(["box/24x10", "box/60x8", "cylinder/60x8", "mesh/24x10"]))
def test_a_box_on_a_turntable_does_not_creep(where):
    check_case(f"carried/{where}")


def test_a_box_that_a_turntable_cannot_hold_leaves_it():
    check_case("carried/over the limit/60x8")


@pytest.mark.slow
@pytest.mark.parametrize("where", ["pile/24x10", "pile/60x8"])
def test_a_thousand_boxes_that_fall_on_each_other_overlap_by_ten_millimetres_at_most(where):
    check_case(f"unchanged/{where}")
