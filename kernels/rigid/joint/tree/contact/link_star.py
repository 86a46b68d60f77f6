"""Links of a tree and all points that touch them: stars (kernels/rigid/touch/body_point_solve.py) with the response of the
whole tree in the place of a body's own mass.

    V = V_0 - S w,   w = sum (J, r x J)(V)           S: of the link, Z^T Z (responses.py); V_0: without these points' impulses
    F(w) = w - sum (J, r x J)(V_0 - S w) = 0         Newton's method: (1 + K S) dw = -F,  K = d sum / dV

S may be singular: joints leave a link fewer than six motions. F is measured by F.S F, the energy that it stands for. The links
of a tree are solved in turn, each with what the others' points have given it through the joints (Gauss-Seidel), until none
changes.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.math.real import types
from wsim.kernels.rigid.joint.tree.contact.pushed import link_motion_func, wrench_at_origin
from wsim.kernels.rigid.joint.tree.contact.responses import push_link
from wsim.kernels.rigid.joint.tree.lanes import tree_barrier, tree_lane, tree_lanes
from wsim.kernels.rigid.joint.tree.mass_matrix import tree_dofs
from wsim.kernels.rigid.joint.tree.tables import Trees, mat66d, vec6d
from wsim.kernels.rigid.motion import double_vec3
from wsim.kernels.rigid.touch.body_point_solve import EVALUATIONS, LEAST_STEP, SMALL, StarSums, star_sum_func, sum_star_team
from wsim.kernels.rigid.touch.body_point_solve import star_structs as stars
from wsim.kernels.rigid.touch.points import touch_structs

TURNS = wp.constant(16)                            # over the links of a tree, at most
CALM = wp.constant(wp.float64(1e-16))              # of the energy of a tree's impulses to that of their last change


@standalone_function
@wp.func
def solve_six(matrix: mat66d, right: vec6d):
    """x of A x = b, with the largest pivots."""
    A = matrix
    b = right
    six = int(6)                                   # a variable: a loop over a constant is unrolled
    for k in range(six):
        best = k
        for i in range(k + 1, six):
            if wp.abs(A[i, k]) > wp.abs(A[best, k]):
                best = i
        for j in range(six):
            swap = A[k, j]
            A[k, j] = A[best, j]
            A[best, j] = swap
        beside = b[k]
        b[k] = b[best]
        b[best] = beside
        for i in range(k + 1, six):
            part = A[i, k] / A[k, k]
            for j in range(k, six):
                A[i, j] = A[i, j] - part * A[k, j]
            b[i] = b[i] - part * b[k]
    for c in range(six):
        i = 5 - c
        for j in range(i + 1, six):
            b[i] = b[i] - A[i, j] * b[j]
        b[i] = b[i] / A[i, i]
    return b


@wp.func
def linear_part(v: vec6d):
    return wp.vec3d(v[0], v[1], v[2])


@wp.func
def angular_part(v: vec6d):
    return wp.vec3d(v[3], v[4], v[5])


@wp.func
def six_of(a: wp.vec3d, b: wp.vec3d):
    return vec6d(a[0], a[1], a[2], b[0], b[1], b[2])


@standalone_function
@wp.func
def center_response(link: int, T: Trees):
    """S of a link about its centre of mass: (velocity, spin) by (impulse, moment)."""
    x = T.X[link] - T.X[T.t.first_link[T.tree_of[link]]]
    S = mat66d()
    six = int(6)
    for c in range(six):
        unit = vec6d()
        unit[c] = wp.float64(1.0)
        V = T.swing[link] * wrench_at_origin(x, linear_part(unit), angular_part(unit))
        w = wp.vec3d(V[0], V[1], V[2])
        v = wp.vec3d(V[3], V[4], V[5]) + wp.cross(w, x)
        for r in range(3):
            S[r, c] = v[r]
            S[3 + r, c] = w[r]
    return S


@wp.func
def star_slopes(s: StarSums):
    """K."""
    K = mat66d()
    for i in range(3):
        for j in range(3):
            K[i, j] = s.A[i, j]
            K[i, 3 + j] = s.B[i, j]
            K[3 + i, j] = s.C[i, j]
            K[3 + i, 3 + j] = s.D[i, j]
    return K


@cache
def link_star_func(of, rolling: bool = False):
    """Function (rows, at, kg, S, V0, w0): w from the guess w0 on, and what is left of F as a part of the impulses or of what it
    began with. at: body, and number of the warp in its block. kg: k, g of `star_impulse_func`."""
    Rows, part_of = stars(of)[0], star_sum_func(of, rolling)

    @standalone_function
    @wp.func
    def solve_link_star(rows: Rows, at: wp.vec2i, kg: wp.vec3d, S: mat66d, V0: vec6d, w0: vec6d):
        w = w0
        dw = vec6d()
        best_w = w0
        best = wp.float64(-1.0)
        begun = wp.float64(0.0)
        scale = wp.float64(0.0)
        last = wp.vec4d()                          # F^2 of the last step, and once it is stuck of three before it
        stuck = int(0)
        part = wp.float64(1.0)
        light = wp.max(S[0, 0], wp.max(S[1, 1], S[2, 2]))
        whole = wp.vec3d(kg[0], kg[1], wp.float64(1.0))
        going = int(EVALUATIONS)
        while going > 0:
            going -= 1
            tw = w + part * dw
            V = V0 - S * tw
            own = part_of(rows, at[0], tree_lane(), tree_lanes(), whole, linear_part(V), angular_part(V))
            s = sum_star_team(own, 1, at[1])
            F = tw - six_of(s.J, s.T)
            found = wp.max(wp.dot(F, S * F), wp.float64(0.0))
            if best < wp.float64(0.0):
                begun = found
                last = wp.vec4d(found, wp.float64(0.0), wp.float64(0.0), wp.float64(0.0))
            if best < wp.float64(0.0) or found < best:
                best = found
                best_w = tw
                scale = wp.max(begun, wp.max(light * s.size * s.size, wp.dot(tw, S * tw)))
                if best <= SMALL * scale:
                    going = int(0)
            if part < LEAST_STEP:
                stuck = int(1)
            if found <= wp.max(wp.max(last[0], last[1]), wp.max(last[2], last[3])) or part < LEAST_STEP:
                w = tw
                last = wp.vec4d(found, wp.float64(stuck) * last[0], wp.float64(stuck) * last[1], wp.float64(stuck) * last[2])
                part = wp.float64(1.0)
                dw = -solve_six(wp.identity(n=6, dtype=wp.float64) + star_slopes(s) * S, F)
            else:
                part = wp.float64(0.5) * part
        return best_w, of(wp.sqrt(wp.max(best, wp.float64(0.0)) / wp.max(scale, wp.float64(1e-300))))

    return solve_link_star


@cache
def star_frame_functions(of, moving: bool, rolling: bool = False):
    """(open, close): functions of a tree around its stars. open: u and the impulses `given` times those at hand are kept;
    close: V of its bodies, less that which contacts were found with, and u as it was."""
    Found, motion = touch_structs(of)[1], link_motion_func(moving)

    @standalone_function
    @wp.func
    def open_stars(g: int, given: wp.float64, found: Found, T: Trees):
        n = T.links.J.shape[0]
        for link in range(T.t.first_link[g] + tree_lane(), T.t.first_link[g + 1], tree_lanes()):
            i = T.t.body[link]
            T.links.J[i] = given * found.total[i]
            T.links.M[i] = given * found.total[n + i]
            if wp.static(rolling):
                T.links.M[i] = T.links.M[i] + given * found.rolled[i]
        dofs = tree_dofs(g, T)
        for d in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
            T.links.u[d] = T.u[d]
        tree_barrier()

    @standalone_function
    @wp.func
    def close_stars(g: int, found: Found, T: Trees, V_out: wp.array(dtype=wp.vec3d)):
        n = T.links.J.shape[0]
        for link in range(T.t.first_link[g] + tree_lane(), T.t.first_link[g + 1], tree_lanes()):
            i = T.t.body[link]
            v, o, x = motion(link, T)
            V_out[i] = v - found.ahead[i]
            V_out[n + i] = o - found.ahead[n + i]
        tree_barrier()
        dofs = tree_dofs(g, T)
        for d in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
            T.u[d] = T.links.u[d]

    return open_stars, close_stars


@cache
def tree_star_func(of, moving: bool, rolling: bool = False):
    """Function of a tree, by warp number `warp` of its block: V of its bodies, (velocity, then spin), less that which contacts
    were found with, and what is left of F. kg: k and g of `star_impulse_func` [s], and 1 where impulses are all of a substep,
    0 where they come on top. u stays as it is."""
    Rows, Found = stars(of)[0], touch_structs(of)[1]
    solve, motion = link_star_func(of, rolling), link_motion_func(moving)
    opened, close = star_frame_functions(of, moving, rolling)

    @standalone_function
    @wp.func
    def turn_over_links(g: int, warp: int, kg: wp.vec3d, rows: Rows, found: Found, T: Trees, left_out: wp.array(dtype=of)):
        """Each star once: (energy of the impulses, of their changes, how many have points)."""
        n = T.links.J.shape[0]
        all = wp.float64(0.0)
        most = wp.float64(0.0)
        many = wp.float64(0.0)
        for link in range(T.t.first_link[g], T.t.first_link[g + 1]):
            i = T.t.body[link]
            if rows.first[i + 1] > rows.first[i]:
                S = center_response(link, T)
                v, o, x = motion(link, T)
                w0 = six_of(T.links.J[i], T.links.M[i])
                V0 = six_of(v - found.ahead[i], o - found.ahead[n + i]) + S * w0
                w, left = solve(rows, wp.vec2i(i, warp), kg, S, V0, w0)
                dw = w - w0
                tree_barrier()                           # all lanes have read velocities
                push_link(link, wrench_at_origin(x, -linear_part(dw), -angular_part(dw)), T)
                if tree_lane() == 0:
                    T.links.J[i] = linear_part(w)
                    T.links.M[i] = angular_part(w)
                    left_out[i] = left
                tree_barrier()
                all += wp.dot(w, S * w)
                most += wp.dot(dw, S * dw)
                many += wp.float64(1.0)
        return wp.vec3d(all, most, many)

    @standalone_function
    @wp.func
    def tree_has_points(g: int, rows: Rows, T: Trees):
        for link in range(T.t.first_link[g], T.t.first_link[g + 1]):
            if rows.first[T.t.body[link] + 1] > rows.first[T.t.body[link]]:
                return True
        return False

    @standalone_function
    @wp.func
    def solve_tree_stars(g: int, warp: int, kg: wp.vec3d, rows: Rows, found: Found, T: Trees, V_out: wp.array(dtype=wp.vec3d),
                         left_out: wp.array(dtype=of)):
        if tree_has_points(g, rows, T):
            opened(g, kg[2], found, T)
            going = int(TURNS)
            while going > 0:
                going -= 1
                said = turn_over_links(g, warp, kg, rows, found, T, left_out)
                if said[2] <= wp.float64(1.0) or said[1] <= CALM * said[0]:
                    going = int(0)
            close(g, found, T, V_out)

    return solve_tree_stars


@cache
def link_star_kernel(of, module, moving: bool):
    """Kernel over trees, see `tree_star_func`."""
    Rows, Found, solve = stars(of)[0], touch_structs(of)[1], tree_star_func(of, moving)

    def solve_link_stars(rows: Rows, found: Found, kg: wp.vec3d, T: Trees, V_out: wp.array(dtype=wp.vec3d),
                         left_out: wp.array(dtype=of)):
        solve(wp.tid() // tree_lanes(), 0, kg, rows, found, T, V_out, left_out)

    return wp.kernel(solve_link_stars, name="solve_link_stars", module=module, enable_backward=False)


@cache
def link_recall_kernel(of, module, moving: bool):
    """Kernel over trees: V of bodies that have contacts by the impulses J, M that points had in the substep before."""
    Rows, Found = stars(of)[0], touch_structs(of)[1]
    (opened, close), vectors = star_frame_functions(of, moving), wp.array(dtype=types(of).vec3)

    def recall_link_impulses(rows: Rows, found: Found, J: vectors, M: vectors, T: Trees,
                             V_out: wp.array(dtype=wp.vec3d)):
        g = wp.tid() // tree_lanes()
        opened(g, wp.float64(0.0), found, T)
        first = T.t.first_link[g]
        for link in range(first, T.t.first_link[g + 1]):
            i = T.t.body[link]
            if rows.first[i + 1] > rows.first[i]:
                push_link(link, wrench_at_origin(T.X[link] - T.X[first], -double_vec3(J[i]), -double_vec3(M[i])), T)
        tree_barrier()
        close(g, found, T, V_out)

    return wp.kernel(recall_link_impulses, name="recall_link_impulses", module=module, enable_backward=False)
