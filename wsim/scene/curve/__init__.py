"""Values known for all time: curves by keys, motions of frames, easing. NumPy only."""

from wsim.scene.curve.curve import KINDS, Curve
from wsim.scene.curve.motion import Motion
from wsim.scene.curve.stack import Part, Stack, then

__all__ = ["KINDS", "Curve", "Motion", "Part", "Stack", "then"]
