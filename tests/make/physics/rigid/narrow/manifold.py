"""What tests/physics/rigid/narrow/test_manifold.py shares with other tests: about, both, eps."""

import numpy as np
import pytest
import warp as wp

from tests.physics.rigid.pairs import PRECISIONS

both = pytest.mark.parametrize("real", PRECISIONS, ids=("f32", "f64"))


def eps(real):
    return np.finfo(np.float32 if real is wp.float32 else np.float64).eps


def about(axis, angle):
    return np.append(np.sin(angle / 2) * np.asarray(axis, float), np.cos(angle / 2))
