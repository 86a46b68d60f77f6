"""One-sided constraints of a tree in a step: limits and dry friction of its joints (../limits.py), and in scenes that have them
strings (../loops/strings.py), in the same sweeps."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.rigid.joint.elimination import Linked
from wsim.kernels.rigid.joint.tree.contact.responses import close_tree_sweeps, open_tree_sweeps
from wsim.kernels.rigid.joint.tree.kinematics import move_tree_coordinates, place_tree
from wsim.kernels.rigid.joint.tree.limits import (
    passes_tree_limit,
    reset_limit_impulses,
    start_tree_limits,
    sweep_tree_limits,
)
from wsim.kernels.rigid.joint.tree.loops.strings import (
    has_strings,
    passes_tree_string,
    place_string_ends,
    renew_string_bends,
    reset_string_impulses,
    start_tree_strings,
    sweep_tree_strings,
)
from wsim.kernels.rigid.joint.tree.substep.bases import place_tree_base
from wsim.kernels.rigid.joint.tree.substep.stages import copy_tree_state
from wsim.kernels.rigid.joint.tree.tables import Trees

SWEEPS = wp.constant(64)
DONE = wp.constant(wp.float64(1.0e-12))      # of the largest rate: change in a sweep at which sweeps end
BENT, BENDS = wp.constant(wp.float64(1.0e-13)), wp.constant(10)                 # [m] at which strings are right, tries


@wp.func
def place_strung_supports(g: int, k: int, part: wp.float64, h: wp.float64, T: Trees, J: Linked):
    """Places what a tree and its strings hang from at a part of substep k of h [s] (bases.py)."""
    place_tree_base(g, k, part, h, T, J)
    place_string_ends(g, k, part, h, T, J)


@standalone_function
@wp.func
def bend_tree_strings(g: int, k: int, h: wp.float64, T: Trees, J: Linked):
    """Measures what strings do by the rates of substep k that are not linear in them; by how much that changed [m]."""
    close_tree_sweeps(g, T)
    if T.moves == 1:
        place_strung_supports(g, k, wp.float64(1.0), h, T, J)
    move_tree_coordinates(g, h, T.qd, T.q_before, T)
    place_tree(g, T)
    found = renew_string_bends(g, h, T)
    copy_tree_state(g, T.q_before, T.qd, T.q, T.qd, T)
    return found


@standalone_function
@wp.func
def strings_pass(g: int, k: int, h: wp.float64, T: Trees, J: Linked):
    """1 where a string of a tree is out of its range at the end of substep k."""
    if T.moves == 1:
        place_strung_supports(g, k, wp.float64(1.0), h, T, J)
    place_tree(g, T)
    return passes_tree_string(g, T)


@cache
def one_sided_functions(strings: bool):
    """Functions of a tree: start (1 if a constraint acts), reset, sweep, solve, passes; place (what it hangs from, see
    bases.py). strings: the scene has some."""

    @standalone_function
    @wp.func
    def start_one_sided(g: int, h: wp.float64, T: Trees, J: Linked):
        """1 if a constraint acts, as qd would have it; its response is ready. H is factored."""
        acting = start_tree_limits(g, h, T, J)
        if wp.static(strings):
            acting = wp.max(acting, start_tree_strings(g, h, T))
        return acting

    @standalone_function
    @wp.func
    def reset_one_sided(g: int, T: Trees):
        """A step begins: impulses count from 0, those behind the places of the last step stay given."""
        reset_limit_impulses(g, T)
        if wp.static(strings):
            reset_string_impulses(g, T)

    @standalone_function
    @wp.func
    def sweep_one_sided(g: int, h: wp.float64, T: Trees, J: Linked):
        """One sweep over u; returns the largest change of a rate, over the largest rate."""
        found = sweep_tree_limits(g, h, T, J)
        if wp.static(strings):
            if has_strings(g, T):
                of_strings = sweep_tree_strings(g, h, T)
                found = wp.vec2d(wp.max(found[0], of_strings[0]), wp.max(found[1], of_strings[1]))
        return found[0] / found[1]

    @standalone_function
    @wp.func
    def solve_one_sided(g: int, k: int, h: wp.float64, T: Trees, J: Linked):
        """qd obeys limits, friction and strings of tree g. Returns what the last sweep changed, over the largest rate."""
        left = wp.float64(0.0)
        if start_one_sided(g, h, T, J) == 1:
            open_tree_sweeps(g, T)
            bent = wp.float64(1.0)
            tries = int(0)
            while bent > BENT and tries < BENDS:
                sweep = int(0)
                left = wp.float64(1.0)
                while left > DONE and sweep < SWEEPS:
                    left = sweep_one_sided(g, h, T, J)
                    sweep += 1
                bent = wp.float64(0.0)
                if wp.static(strings):
                    if h > wp.float64(0.0) and has_strings(g, T):
                        bent = bend_tree_strings(g, k, h, T, J)
                tries += 1
            close_tree_sweeps(g, T)
        return left

    @standalone_function
    @wp.func
    def passes_one_sided(g: int, k: int, h: wp.float64, T: Trees, J: Linked):
        """1 where a coordinate or a string is beyond a limit at the end of substep k, or a joint has dry friction."""
        found = passes_tree_limit(g, T, J)
        if wp.static(strings):
            if has_strings(g, T):
                found = wp.max(found, strings_pass(g, k, h, T, J))
        return found

    return SimpleNamespace(start=start_one_sided, reset=reset_one_sided, sweep=sweep_one_sided, solve=solve_one_sided,
                           passes=passes_one_sided, place=place_strung_supports if strings else place_tree_base)
