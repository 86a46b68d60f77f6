"""The examples find what they say, in smaller sizes where that saves time."""

import numpy as np
import pytest

from scenes.examples import moduli_of_a_bar, sheet_from_points, stiffness_field, swing, throw_cloth


@pytest.mark.parametrize("example, within", [(sheet_from_points, 0.01), (moduli_of_a_bar, 0.005)])
def test_two_numbers_are_found_with_their_error_bars(example, within):
    found = example.run()
    for name, true in example.TRUTH.items():
        assert found["values"][name] == pytest.approx(true, rel=within)
        assert abs(found["values"][name] - true) < 4.0 * found["errors"][name]


def test_the_two_halves_of_a_bar_are_told_apart():
    found = stiffness_field.run((4, 1, 1), limit=80.0)
    away = np.log(found["young"] / found["truth"])
    inner = found["along"] < 0.15                                # the last quarter carries too little
    assert np.sqrt(np.mean(away[inner]**2)) < 0.1


def test_a_cloth_is_thrown_into_the_frame():
    found = throw_cloth.run(cells=4, limit=40.0)
    assert found["missed"].max() < 0.03 and (found["velocity"] > found["without_air"])[:2].all()


def test_the_swing_goes_farther_than_the_hand():
    found = swing.run(frames=16, limit=8.0, out=0.1)
    assert found["reached"] > 3.0 * np.abs(found["hand"]).max() and found["reached"] > 0.02
