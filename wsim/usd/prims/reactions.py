"""Reactions of pins on a stage, `wsim:reaction` of the attachment: written by a run, read as observations.

    vector3f[] wsim:reaction          time samples: the force that the attachment puts on each point of physics:indices0, in the
                                      world [mass length/s^2]; a single value is their sum; NaN: not seen
    float      wsim:reactionNoise     standard deviation of each component [mass length/s^2], of observations
    float[]    wsim:reactionWeights   of each point: part of 1 / noise^2; 0: not counted
"""

from collections.abc import Mapping

import numpy as np
from pxr import Usd

from wsim.usd import names
from wsim.usd.attributes import define_attribute, read_attribute, to_usd_array
from wsim.usd.stage import StageUnits

REACTION = names.attribute_entry("Pin", "reaction").attribute


def reaction_sample(prim: Usd.Prim, forces: np.ndarray) -> tuple:
    """(attribute, value) of forces [N] (n, 3), not yet set."""
    entry = names.attribute_entry("Pin", "reaction")
    prim.AddAppliedSchema(entry.schema)
    return define_attribute(prim, entry), to_usd_array(forces, entry.type, StageUnits.of(prim.GetStage()).factor(entry.unit))


def reaction_samples_of_pins(stage: Usd.Stage, forces: Mapping[str, np.ndarray]) -> list[tuple]:
    """`reaction_sample` of each pin, by path; pins that are painted have no prim, and none."""
    found = ((stage.GetPrimAtPath(path), values) for path, values in forces.items())
    return [reaction_sample(prim, values) for prim, values in found if prim]


def reaction_time_codes(prim: Usd.Prim) -> list[float]:
    """Time codes of the samples; none where there is no such prim."""
    attribute = prim.GetAttribute(REACTION) if prim else None
    return list(attribute.GetTimeSamples()) if attribute else []


def read_reaction_forces(prim: Usd.Prim, code: float) -> np.ndarray:
    """[N], (n, 3) float64; (0, 3) where nothing is said."""
    value = read_attribute(prim, "Pin", "reaction", StageUnits.of(prim.GetStage()), time=code)
    return np.zeros((0, 3)) if value is None else value.astype(np.float64)


def read_reaction_noise(prim: Usd.Prim) -> tuple[float | None, np.ndarray | None]:
    """Standard deviation [N] and weights, None where they are not authored."""
    units = StageUnits.of(prim.GetStage())
    return read_attribute(prim, "Pin", "reaction_noise", units), read_attribute(prim, "Pin", "reaction_weights")
