"""What trees say of their bodies: places and momenta, rounded, with what rounding left."""

from functools import cache

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.rigid.joint.steps import rounded_like
from wsim.kernels.rigid.joint.tree.kinematics import move_tree_velocities
from wsim.kernels.rigid.joint.tree.lanes import tree_barrier, tree_lane, tree_lanes
from wsim.kernels.rigid.joint.tree.mass_matrix import link_inertia_world
from wsim.kernels.rigid.joint.tree.tables import Trees
from wsim.kernels.rigid.motion import body_structs, double_quat, double_vec3, rounded_quaternion


@cache
def tree_writing_func(real):
    """Function of a tree: its bodies."""
    _, Moving = body_structs(real)

    @standalone_function
    @wp.func
    def write_tree(g: int, T: Trees, out: Moving):
        """Places and momenta of the bodies of a tree, whose links and joints are placed."""
        t = T.t
        move_tree_velocities(g, T)
        root = t.first_link[g]
        for link in range(root + tree_lane(), t.first_link[g + 1], tree_lanes()):
            i = t.body[link]
            x = T.X[link] - t.start[link]
            out.x[i] = rounded_like(x, out.x[i])
            out.e[i] = rounded_like(x - double_vec3(out.x[i]), out.x[i])
            out.q[i] = rounded_quaternion(T.Q[link], out.q[i])
            out.o[i] = rounded_quaternion(T.Q[link] - double_quat(out.q[i], wp.quatd()), out.q[i])
            out.p[i] = rounded_like(t.mass[link] * (T.V[link] + wp.cross(T.W[link], T.X[link] - T.X[root])), out.p[i])
            out.L[i] = rounded_like(link_inertia_world(link, T) * T.W[link], out.L[i])
        tree_barrier()

    return write_tree
