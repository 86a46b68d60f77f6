"""What has gradients: one table. Anything else raises before a step is taken, and never gives a zero.

    covered      explicit integrators, all of them, XPBD, and implicit integrators by Newton's method; springs, membranes,
                 bending, and their damping; soft bodies of four and ten nodes a tet, all four materials, their damping,
                 pressure and plastic flow; hard and soft pins; gravity, drag of the air, wind (drag and lift); ties; strain
                 limits and tethers, but for Newton's method; contacts with convex shapes and meshes (that deform too),
                 friction and restitution
    by           initial positions and velocities, masses, every stiffness, damping, yield and pressure above (of each
                 element), rest shapes (with the masses that follow them) and rest lengths, factors of rest lengths over time
                 (muscles), where pins are, stiffness and damping of soft ones, gravity, drag of the air, wind, drag and
                 lift, friction of a body; friction, restitution, thickness and motion of a collider
    of           positions, velocities, and what pins bear (`wsim.reaction_adjoint`)
    not yet      by the shape of a mesh that deforms
"""

from math import isfinite

from wsim.choice import Choice
from wsim.scene import Problem, Scene


def uncovered(scene: Scene, choice: Choice) -> list[Problem]:
    """What of a scene has no gradients, each with its path and the mend."""
    found = []
    other = "leave it out, or set wsim:solver = explicit or xpbd"
    for c in scene.cloths if choice.solver == "implicit" else ():
        found += [(c.path, "tethers under Newton's method", other)] * bool(c.tethers)
        found += [(c.path, "a strain limit under Newton's method", other)] * isfinite(c.material.strain_limit)
    return [Problem(path, f"gradients were asked for, and {what} has none yet; {mend}") for path, what, mend in found]
