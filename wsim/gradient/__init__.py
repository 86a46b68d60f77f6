"""What has gradients: one table. Whatever else is asked for raises, and never gives a zero.

    covered      explicit integrators, all of them, XPBD, and implicit integrators by Newton's method; springs, membranes,
                 bending, and their damping; soft bodies of four and ten nodes a tet, all four materials, their damping,
                 pressure and plastic flow; hard and soft pins; loads; gravity, drag of the air, wind (drag and lift); ties;
                 strain limits and tethers; contacts with convex shapes and meshes (that deform too), friction and restitution
    by           initial positions and velocities, masses, every stiffness, damping, yield and pressure above (of each
                 element), Poisson's ratio of soft bodies and membranes, strain limits (of each edge), rest shapes (with the
                 masses and the longest lengths that follow them) and rest lengths, factors of rest lengths over time (muscles),
                 forces and tractions at each key (on the areas of the scene, which no rest shape that is set changes),
                 where pins are, stiffness and damping of soft ones, gravity, drag of the air, wind, drag and lift, friction of
                 a body; friction, restitution, thickness and motion of a collider
    of           positions, velocities, and what pins bear (`wsim.gradient.reactions.adjoint`), but where tethers or strain
                 limits pull
    not yet      by the shape of a mesh that deforms
"""
