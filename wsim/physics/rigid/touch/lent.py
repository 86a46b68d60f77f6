"""Forces of fluids on bodies: a frame begins with weight and given forces alone, to which each fluid adds what it gives."""

from typing import Any

import warp as wp

from wsim.model.stage import Clock, Stage
from wsim.model.structs import filled, values


def lent(rigid) -> Any:
    """A table of the method of rigid bodies whose push and torque are those of weight and given forces; at the start of a
    frame that of `rigid.table` becomes the same."""
    own = {name: wp.clone(getattr(rigid.table, name)) for name in ("push", "torque")}
    given = filled(rigid.Bodies, **(values(rigid.table) | own))

    def begin(clock: Clock) -> None:
        for name, array in own.items():
            wp.copy(getattr(rigid.table, name), array)
    rigid.stages.insert(0, Stage("weights of bodies", "pose", begin, 2, 4 * own["push"].capacity, "frame",
                                 "before fluids push them"))
    return given
