"""Values known for all time: curves by keys, motions of frames, easing. NumPy only. Stacks of transforms are imported when they
are asked for."""

from typing import TYPE_CHECKING

from wsim.scene.curve.curve import Curve
from wsim.scene.curve.motion import Motion

if TYPE_CHECKING:
    from wsim.scene.curve.stack import Part, Stack, then

__all__ = ["Curve", "Motion", "Part", "Stack", "then"]


def __getattr__(name: str):
    if name in ("Part", "Stack", "then"):
        from wsim.scene.curve import stack
        return getattr(stack, name)
    raise AttributeError(name)
