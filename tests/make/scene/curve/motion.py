"""What tests/scene/curve/test_motion.py shares with other tests: KINDS, OUTSIDE, keys, made."""

import numpy as np

from wsim.geometry import rotation
from wsim.scene.curve import Motion

KINDS = {"linear": {}, "hold": {}, "catmull_rom": {"alpha": 0.5}, "kochanek_bartels": {"tension": 0.2}, "monotone": {},
         "eased": {"easing": ["ease", "bounce-out", (0.3, -0.5, 0.6, 1.4), "smootherstep"]}}
OUTSIDE = ["held", "linear", "repeat", "reset", "oscillate"]


def keys(seed=0, n=5):
    rng = np.random.default_rng(seed)
    q = rotation.unit_quat(rng.normal(size=(n, 4)))
    return np.cumsum(rng.uniform(0.4, 1.3, n)), rng.normal(size=(n, 3)), q


def made(kind, outside="held", seed=0, **how) -> Motion:
    return Motion.through(*keys(seed), kind, outside, outside, **KINDS.get(kind, {}) | how)
