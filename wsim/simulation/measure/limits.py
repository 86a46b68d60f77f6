"""Where strain limits and tethers act: they hold edges and points by projection, whatever the fabric's own stiffness says. They
are looks, not accuracy: a square metre of cotton that hung by two corners was moved by 9.4 mm by its limit of 3 % and tethers.
"""

import numpy as np

from wsim.physics.cloth.constraints import LOOKS
from wsim.physics.cloth.kind import kind_row
from wsim.simulation.plan import SimulationPlan

CLOSE = 1e-3           # of its longest that an edge or tether may be shorter and still counts as held


def acting_limits(plan: SimulationPlan, x: np.ndarray) -> dict[str, tuple[int, int]]:
    """Constraints of each hard kind that act, and all there are. x: positions relative to origins [m], solver order."""
    found: dict[str, tuple[int, int]] = {}
    for batch in plan.ports.xpbd_batches:
        for r in batch.rows if batch.hard else ():
            ends = x[r.ids]
            held = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) >= (1.0 - CLOSE) * r.rest
            before = found.get(batch.kind, (0, 0))
            found[batch.kind] = before[0] + int(held.sum()), before[1] + len(held)
    return {kind: counts for kind, counts in found.items() if counts[1]}


def describe_acting_limits(found: dict[str, tuple[int, int]]) -> str:
    """Text of the limits that act; "" where there is none."""
    parts = [f"{held} of {every} {kind_row(kind).held}" for kind, (held, every) in found.items()]
    return f"{' and '.join(parts)}: {LOOKS}" if parts else ""
