"""Forces of fluids on bodies: a frame begins with weight and given forces alone, to which each fluid adds what it gives."""

from typing import Any

import warp as wp

from wsim.model.stage import Clock, Stage
from wsim.model.structs import fill_struct, struct_values


def own_force_table(rigid) -> Any:
    """A table of the method of rigid bodies whose push and torque are those of weight and given forces; at the start of a
    frame that of `rigid.table` becomes the same."""
    own = {name: wp.clone(getattr(rigid.table, name)) for name in ("push", "torque")}
    given = fill_struct(rigid.Bodies, **(struct_values(rigid.table) | own))

    def restore_own_forces(clock: Clock) -> None:
        for name, array in own.items():
            wp.copy(getattr(rigid.table, name), array)
    rigid.stages.insert(0, Stage("weights of bodies", "pose", restore_own_forces, 2, 4 * own["push"].capacity, "frame",
                                 "before fluids push them"))
    return given
