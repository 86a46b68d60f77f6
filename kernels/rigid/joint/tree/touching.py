"""Substeps of trees that touch something, a thread for each world.

    predict    coordinates and velocities a step on without contacts and limits, by rk4 or implicitly (steps.py)
    solve      sweeps over contacts and limits, from the mean rate of the prediction: what they change is added to it
    place      q' = q moved by the mean rate and that change
    relax      a sweep without bias, with the velocities at the end and all responses at q'

A tree that nothing touches so moves as if it were alone. Bodies without joints are trees of one link.
"""

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.rigid.contact import manifold_count_func, rig_type
from wsim.kernels.rigid.joint.elimination import Linked
from wsim.kernels.rigid.joint.tree.contacts import link_contact_functions
from wsim.kernels.rigid.joint.tree.joint_forces import add_drive_inertia, note_drive_work
from wsim.kernels.rigid.joint.tree.kinematics import move_tree_coordinates, place_tree
from wsim.kernels.rigid.joint.tree.limits import reset_limit_impulses, start_tree_limits, sweep_tree_limits
from wsim.kernels.rigid.joint.tree.mass_matrix import assemble_tree_matrix, factor_tree_matrix, tree_dofs
from wsim.kernels.rigid.joint.tree.stages import copy_tree_state
from wsim.kernels.rigid.joint.tree.steps import tree_step_functions
from wsim.kernels.rigid.joint.tree.tables import Trees
from wsim.kernels.rigid.lists.pairs import body_straying_func
from wsim.kernels.rigid.soft_step import body_steps


def touching_tree_kernel(real, module):
    """Kernel of substeps steps[0] .. steps[1] of a frame, of h [s], over worlds, with steps[2] sweeps. Manifolds are those of
    steps[0]. P: scratch of the prediction."""
    Rig, contact, f, count = rig_type(real), link_contact_functions(real), tree_step_functions(real), manifold_count_func(real)
    meet, prepare, warm, solve = contact.meet, contact.prepare, contact.warm, contact.solve
    begin, stages, implicit, write = f.begin, f.stages, f.implicit, f.write
    (orient, turn, _, _), stray = body_steps(real), body_straying_func(real)

    @standalone_function
    @wp.func
    def first_manifold_of_world(w: int, rig: Rig):
        """Place of the first manifold whose shape a is of world w or a later one: the list is sorted by it."""
        low = int(0)
        high = count(rig)
        while low < high:
            middle = (low + high) // 2
            if rig.s.world[rig.c.a[middle]] < w:
                low = middle + 1
            else:
                high = middle
        return low

    @standalone_function
    @wp.func
    def ready_tree(g: int, k: int, h: real, rig: Rig, J: Linked, T: Trees):
        """Places a tree at its coordinates, with the factors of H and limits; its bodies are turned as it is."""
        place_tree(g, T)
        assemble_tree_matrix(g, T)
        if T.soft_drives[g] == 0:
            add_drive_inertia(g, k, wp.float64(h), T, J)
        factor_tree_matrix(g, T)
        start_tree_limits(g, wp.float64(h), T, J)
        for link in range(T.t.first_link[g], T.t.first_link[g + 1]):
            T.met[link] = 0

    @standalone_function
    @wp.func
    def ready_contacts(w: int, k: int, rig: Rig, T: Trees):
        """Responses, arms, gaps of a world's manifolds where substep k begins."""
        first = first_manifold_of_world(w, rig)
        last = first_manifold_of_world(w + 1, rig)
        for m in range(first, last):
            meet(m, rig, T)
        for m in range(first, last):
            prepare(m, k, rig, T)

    @standalone_function
    @wp.func
    def predict_tree(g: int, k: int, h: wp.float64, rig: Rig, J: Linked, T: Trees, P: Trees):
        copy_tree_state(g, T.q, T.qd, P.q, P.qd, T)
        if T.soft_drives[g] == 1:
            stages(g, k, h, rig.b, P, J)
        else:
            implicit(g, k, h, rig.b, P, J)
        reset_limit_impulses(g, T)
        dofs = tree_dofs(g, T)
        for d in range(dofs[0], dofs[1]):
            T.qd[d] = P.rates[d]

    @standalone_function
    @wp.func
    def move_tree(g: int, h: wp.float64, T: Trees, P: Trees):
        copy_tree_state(g, T.q, T.qd, T.q_before, T.qd_before, T)
        move_tree_coordinates(g, h, T.qd, T.q_before, T)
        dofs = tree_dofs(g, T)
        for d in range(dofs[0], dofs[1]):
            T.qd[d] = P.qd[d] + (T.qd[d] - P.rates[d])

    @standalone_function
    @wp.func
    def sweep_world(w: int, k: int, h: real, biased: int, rig: Rig, J: Linked, T: Trees):
        """One sweep over a world."""
        for m in range(first_manifold_of_world(w, rig), first_manifold_of_world(w + 1, rig)):
            solve(m, k, h, biased, rig, T)
        for g in range(T.first_tree[w], T.first_tree[w + 1]):
            sweep_tree_limits(g, wp.float64(biased) * wp.float64(h), T, J)

    @standalone_function
    @wp.func
    def place_world_bodies(w: int, k: int, h: real, rig: Rig, T: Trees):
        for link in range(T.t.first_link[T.first_tree[w]], T.t.first_link[T.first_tree[w + 1]]):
            i = T.t.body[link]
            orient(i, rig)
            stray(i, h, rig)

    def rigid_touching_trees(steps: wp.vec3i, h: real, rig: Rig, J: Linked, T: Trees, P: Trees):
        w = wp.tid()
        d = wp.float64(h)
        one = T.first_tree[w]
        last = T.first_tree[w + 1]
        if steps[0] == 0:
            for g in range(one, last):
                begin(g, d, rig.b, T, J)
                ready_tree(g, 0, h, rig, J, T)           # else as the launch before has left it
        for i in range(rig.b.w.shape[0], rig.work.turn.shape[0]):
            turn(i, steps[0], rig)
        place_world_bodies(w, steps[0], h, rig, T)
        for k in range(steps[0], steps[1]):
            ready_contacts(w, k, rig, T)
            for g in range(one, last):
                predict_tree(g, k, d, rig, J, T, P)
            for m in range(first_manifold_of_world(w, rig), first_manifold_of_world(w + 1, rig)):
                warm(m, k, h, rig, T)
            for _sweep in range(steps[2]):
                sweep_world(w, k, h, 1, rig, J, T)
            for g in range(one, last):
                move_tree(g, d, T, P)
                ready_tree(g, k + 1, h, rig, J, T)
                write(g, T, rig.now)
            place_world_bodies(w, k + 1, h, rig, T)
            ready_contacts(w, k + 1, rig, T)
            sweep_world(w, k, h, 0, rig, J, T)
            for g in range(one, last):
                note_drive_work(g, k, d, T, J)
                write(g, T, rig.now)

    return wp.kernel(rigid_touching_trees, name="rigid_touching_trees", module=module, enable_backward=False, grid_stride=False)
