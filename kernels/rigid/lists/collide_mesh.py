"""Manifolds of pairs with a triangle mesh: of a pair as many as there are normals, ROWS at most.

The first row of a pair has the threads: a warp of a GPU, or one. They walk over the mesh (mesh_walk.py beside this) and put
what touches into the rows (mesh_rows.py). Of a mesh that a body has, what comes after it may be convex, a plane or a mesh.
"""

import warp as wp

from wsim.kernels.contact.collider.shape import PLANE, SPHERE
from wsim.kernels.math.block import warp_barrier
from wsim.kernels.math.real import types
from wsim.kernels.rigid.contact import rig_type, rigid_contact_structs
from wsim.kernels.rigid.impulse import impulse_formulas
from wsim.kernels.rigid.lists.core import cores_on_meshes
from wsim.kernels.rigid.lists.mesh_pair_walk import mesh_pair_walk_func
from wsim.kernels.rigid.lists.mesh_rows import approach_func
from wsim.kernels.rigid.lists.mesh_walk import flipped_walk_func, mesh_walk_func, plane_walk_func
from wsim.kernels.rigid.lists.pairs import ROWS
from wsim.kernels.rigid.lists.renewal import LATER, STEPS, TOUCHES, manifold_need_func, twist_functions
from wsim.kernels.rigid.lists.rows import keep_row_func, last_list_type, posed_pair_type, row_writing_funcs
from wsim.kernels.rigid.lists.worlds import listed_anew_func, row_move_func
from wsim.kernels.rigid.narrow.mesh import mesh_type
from wsim.kernels.rigid.narrow.shape import MESH, hull_type


def mesh_pair_walk(kinds: frozenset[str], real, lanes: int, of_bodies: bool):
    """Walk of a pair with a mesh, whose other shape is of one of these kinds; of_bodies: bodies have meshes, else colliders."""
    Rig, Posed, Hulls, Surfaces = rig_type(real), posed_pair_type(real)[0], hull_type(real), mesh_type(real)
    convex, planes, meshes = kinds - {"plane", "mesh"}, "plane" in kinds, "mesh" in kinds
    if not of_bodies:
        return mesh_walk_func(kinds, real, lanes)
    shapes, any_convex = convex or frozenset({"box"}), bool(convex)
    on_mesh, flipped = mesh_walk_func(shapes, real, lanes), flipped_walk_func(shapes, real, lanes)
    on_plane, of_two = plane_walk_func(real, lanes), mesh_pair_walk_func(real, lanes)

    @wp.func
    def walk_pair_with_mesh(m: int, lane: int, p: Posed, H: Hulls, S: Surfaces, rig: Rig):
        if wp.static(meshes):
            if p.a.kind == MESH and p.b.kind == MESH:
                of_two(m, lane, p, H, S, rig)
        if wp.static(planes):
            if p.b.kind == PLANE:
                on_plane(m, lane, p, H, S, rig)
        if wp.static(any_convex):
            if p.a.kind == MESH and p.b.kind != MESH and p.b.kind != PLANE:
                flipped(m, lane, p, H, S, rig)
            if p.a.kind != MESH:
                on_mesh(m, lane, p, H, S, rig)

    return walk_pair_with_mesh


def collide_mesh(kinds: frozenset[str], real, module, lanes: int = 1, of_bodies: bool = False):
    """Kernel over the rows of a list, so many threads each, behind `rigid_collide`; kinds: of the shapes that meet meshes; h as
    there. lanes: 1, or 32 on a GPU. of_bodies: see `mesh_pair_walk`."""
    t, Rig, Last, Hulls, Surfaces = types(real), rig_type(real), last_list_type(real), hull_type(real), mesh_type(real)
    write, (Posed, posed), walk = row_writing_funcs(real), posed_pair_type(real), mesh_pair_walk(kinds, real, lanes, of_bodies)
    known, point, poses, keep, approaching = write.known, write.point, write.poses, keep_row_func(real), approach_func(real)
    needed, of, prepare = manifold_need_func(real), twist_functions(real), impulse_formulas(real)[1]
    block, twist, advanced, hurried, margin, size = cores_on_meshes(real), of.twist, of.advanced, of.hurried, of.margin, of.size
    Table, anew, move = rigid_contact_structs(real)[2], listed_anew_func(real), row_move_func(real)

    @wp.func
    def first_of_its_pair(m: int, rig: Rig):
        first = rig.s.kind[rig.c.b[m]] == MESH or rig.s.kind[rig.c.a[m]] == MESH
        if first and m > 0:
            first = rig.c.a[m - 1] != rig.c.a[m] or rig.c.b[m - 1] != rig.c.b[m]
        return first

    @wp.func
    def mesh_rows_awake(m: int, rig: Rig):
        rows = int(ROWS)
        found = bool(True)
        for r in range(rows):
            if rig.c.count[m + r] < 0:
                found = False
        return found

    @wp.func(inline=False)
    def empty_mesh_rows(m: int, lane: int, rig: Rig):
        warp_barrier()
        for r in range(lane, ROWS, lanes):
            rig.c.count[m + r] = 0
        warp_barrier()

    @wp.func(inline=False)
    def write_mesh_rows(m: int, lane: int, k: int, row: int, p: Posed, last: Last, rig: Rig):
        """Rows of a pair from A's frame into the world's axes, with their impulses."""
        q = wp.transform_get_rotation(p.pose_a)
        o = wp.transform_get_translation(p.pose_a)
        for r in range(lane, ROWS, lanes):
            rig.c.colour[m + r] = -1
            if row >= 0:
                rig.c.colour[m + r] = last.colour[row + r]
            rig.c.n[m + r] = wp.quat_rotate(q, rig.c.n[m + r])
            rig.work.renewed[m + r] = 1
            rig.c.skin[m + r] = t.vec2(rig.s.skin[rig.c.a[m]], rig.s.skin[rig.c.b[m]])
            poses(m + r, p, rig)
            for i in range(rig.c.count[m + r]):
                j = 4 * (m + r) + i
                point(m + r, i, wp.quat_rotate(q, rig.c.first_a[j]) + o, rig.c.gap[j], row, p, last, rig)
            prepare(m + r, k, rig)

    @wp.func(inline=False)
    def move_mesh_rows(m: int, lane: int, row: int, aside: Table, k: int, rig: Rig):
        for r in range(lane, ROWS, lanes):
            move(m + r, row + r, aside, k, rig)
        warp_barrier()

    def rigid_collide_mesh(rig: Rig, H: Hulls, S: Surfaces, k: int, h: real, last: Last, aside: Table):
        m = wp.tid() // lanes
        lane = wp.tid() % lanes
        a = rig.c.a[m]
        if a >= 0 and m + ROWS <= rig.c.a.shape[0]:
            if first_of_its_pair(m, rig):
                whole_list = rig.work.strayed[0]
                make = bool(False)
                if whole_list == 1:
                    make = anew(a, rig)
                    if not make:
                        move_mesh_rows(m, lane, known(m, last, rig), aside, k, rig)
                if not make and mesh_rows_awake(m, rig):
                    make = needed(m, k, rig)
                if make:
                    row = int(m)
                    if whole_list == 1:
                        row = known(m, last, rig)
                    else:
                        for r in range(lane, ROWS, lanes):
                            keep(m + r, rig.c, last)
                    p = posed(m, k, rig)
                    both = twist(m, k, h, rig)
                    p.margin = margin(both, h, m, p, rig)
                    q = p
                    fast = hurried(both, h, m, rig)
                    time = real(0.0)
                    steps = int(STEPS)
                    for _step in range(steps):
                        q = advanced(p, both, time, m, rig)
                        empty_mesh_rows(m, lane, rig)
                        walk(m, lane, q, H, S, rig)
                        if not fast:
                            break
                        least, more = approaching(m, both, q, rig)
                        if least <= real(TOUCHES) * size(m, rig) or more < real(0.0) or time + more > real(LATER) * h:
                            break
                        time += more
                    if fast and rig.s.kind[a] != SPHERE and rig.s.kind[a] != MESH and lane == 0:
                        block(m, q, both, h, S, rig)
                    warp_barrier()
                    write_mesh_rows(m, lane, k, row, q, last, rig)
        elif a >= 0:
            if rig.s.kind[rig.c.b[m]] == MESH or rig.s.kind[a] == MESH:
                rig.c.count[m] = 0                      # no room for all rows of its pair

    return wp.kernel(rigid_collide_mesh, name="rigid_collide_mesh", module=module, enable_backward=False)
