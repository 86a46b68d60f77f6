"""What can be wrong with solref and solimp of MuJoCo's contacts. NumPy only."""

from collections.abc import Iterator

import numpy as np

from wsim.scene import Collider, Problem
from wsim.scene.check.objects import object_warning, thing_error


def check_softness(c: Collider) -> Iterator[Problem]:
    """Faults of a collider where `Scene.contact_model` is mujoco."""
    ref, imp = c.solref, c.solimp
    if len(ref) != 2 or not np.isfinite(ref).all() or not (min(ref) > 0.0 or max(ref) <= 0.0):
        yield thing_error(c.path, f"solref is {tuple(ref)}", "two numbers > 0: a time constant [s], a damping ratio; or two <= "
                          "0: minus a stiffness and a damping", "author mjc:solref = [0.02, 1]")
    inside = len(imp) == 5 and min(*imp[:2], imp[3]) >= 0.0 and max(*imp[:2], imp[3]) <= 1.0
    if not inside or not np.isfinite(imp).all() or imp[2] <= 0.0 or imp[4] < 1.0:
        yield thing_error(c.path, f"solimp is {tuple(imp)}", "two impedances and a midpoint from 0 to 1, a width > 0 [m] "
                          "before the midpoint, a power >= 1 behind it", "author mjc:solimp = [0.9, 0.95, 0.001, 0.5, 2]")
    if c.restitution > 0.0:
        yield object_warning(c.path, f"has restitution {c.restitution:g}; contact_model mujoco has none", "0",
                             "give solref a damping ratio below 1: such a contact throws back")
