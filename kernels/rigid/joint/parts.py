"""The substep of islands of joints in two launches, between which a recording looks (in one: kernels/rigid/joint/steps.py).

    held      forces, sweeps                    loosed      places, velocities along what is held
"""

import warp as wp

from wsim.kernels.rigid.joint.steps import joint_step_functions
from wsim.kernels.rigid.joint.tables import joint_table_structs as tables
from wsim.kernels.rigid.motion import body_structs


def jointed_parts(real, module) -> list:
    """Kernels held (substep steps[0], of steps[2] sweeps) and loosed of islands of joints alone: a thread each."""
    Bodies, Moving = body_structs(real)
    Linked = tables()[1]
    f = joint_step_functions(real)
    placed, begun, solve, relax, kicks, place = f.placed, f.begun, f.solve, f.relax, f.kicks, f.place

    def rigid_joints_held(steps: wp.vec3i, h: real, b: Bodies, J: Linked, now: Moving):
        g = wp.tid()
        d = wp.float64(h)
        placed(g, steps[0], b, now, J)
        for m in range(J.t.first_body[g], J.t.first_body[g + 1]):
            kicks(J.t.body[m], h, b, now, J)
        if J.t.first_joint[g + 1] > J.t.first_joint[g]:
            begun(g, steps[0], d, J)
            for _sweep in range(steps[2]):
                solve(g, steps[0], d, b, now, J)

    def rigid_joints_loosed(steps: wp.vec3i, h: real, b: Bodies, J: Linked, now: Moving):
        g = wp.tid()
        for m in range(J.t.first_body[g], J.t.first_body[g + 1]):
            place(J.t.body[m], h, b, now, J)
        if J.t.first_joint[g + 1] > J.t.first_joint[g]:
            placed(g, steps[0] + 1, b, now, J)
            relax(g, steps[0], wp.float64(h), now, J)

    return [wp.kernel(each, name=each.__name__, module=module, enable_backward=False)
            for each in (rigid_joints_held, rigid_joints_loosed)]
