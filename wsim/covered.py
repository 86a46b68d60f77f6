"""What has gradients: one table. Anything else raises before a step is taken, and never gives a zero.

    covered      explicit integrators, all of them, XPBD, and implicit integrators by Newton's method; springs, membranes,
                 bending, and their damping; strain limits; soft bodies of linear tets, all four materials, and their damping;
                 hard pins; gravity and drag; ties
    by           initial positions and velocities, masses, every stiffness and damping above (of each element), rest lengths,
                 where pins are, gravity, drag of the air
    not yet      contacts, wind, soft pins, tethers, pressure, plasticity, quadratic tets; strain limits beside other solvers
"""

from math import inf, isfinite

from wsim.choice import Choice
from wsim.scene import Problem, Scene


def uncovered(scene: Scene, choice: Choice) -> list[Problem]:
    """What of a scene has no gradients, each with its path and the mend."""
    found = [(c.path, "contacts", "leave the collider out") for c in scene.colliders]
    for c in scene.cloths:
        found += [(c.path, "drag or lift", "leave them out")] * bool(c.drag or c.lift)
        found += [(c.path, "tethers", "leave them out")] * bool(c.tethers)
    for s in scene.softs:
        found += [(s.path, "pressure", "leave it out")] * bool(s.pressure)
        found += [(s.path, "quadratic tets", "leave wsim:quadratic off")] * s.quadratic
        found += [(s.path, "a yield strain", "leave it out")] * any(m.yield_strain < inf for m in s.materials)
    found += [(p.path, "a soft pin", "leave its stiffness out") for p in scene.pins if isfinite(p.stiffness)]
    return [Problem(path, f"gradients were asked for, and {what} has none yet; {mend}") for path, what, mend in found]
