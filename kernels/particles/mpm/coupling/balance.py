"""Angular momentum between a mesh and the particles that it carries through a frame (surfaces.py). Impulses of particles act on
points of the mesh that are up to a cell away, and what points carry gets their change of velocity where it is itself. So each
row of the table sums what that is off by,

    D = sum (angular momentum that particles have lost) - (that which points of the mesh have got),      M, c, I

and mass, centre and tensor of inertia of the particles that it carries. These then turn about c by w = I^-1 D: momentum stays,
and of all changes of velocity that make D good this takes the least energy. Sums are whole numbers (tables.py), lengths in
units of FAR cells about a point of the mesh.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.coupling.impulses import add_whole
from wsim.kernels.particles.mpm.coupling.tables import FINE, push_tables

FAR = wp.constant(256.0)           # cells of a unit of length
FLAT = wp.constant(wp.float64(1.0e-6))     # least det I over (tr I)^3: what lies on a line is not turned


@cache
def balance_functions(real) -> SimpleNamespace:
    """add_lack(walls, k, D): adds to D of a row [kg m^2/s]; add_carried(walls, k, y, m): a particle of mass m at y that row k
    carries; find_turn(walls, k) -> (w [rad/s], c [m])."""
    t, tables = types(real), push_tables(real)

    @wp.func
    def mesh_reference(w: tables.Walls, k: int):
        mesh = wp.mesh_get_point(w.table.mesh[k], 0)
        return wp.transform_point(w.table.pose[0, k], t.vec3(real(mesh[0]), real(mesh[1]), real(mesh[2])))

    @wp.func
    def add_lack(w: tables.Walls, k: int, D: t.vec3):
        unit = wp.float64(w.pushed.mass) * wp.float64(w.pushed.dx) / wp.float64(w.pushed.dt) * FINE
        for a in range(3):
            add_whole(w.pushed.turning, k, a, wp.float64(D[a]) / (unit * wp.float64(real(FAR) * w.pushed.dx)))

    @wp.func
    def add_carried(w: tables.Walls, k: int, y: t.vec3, m: real):
        r = (y - mesh_reference(w, k)) / (real(FAR) * w.pushed.dx)
        M = wp.float64(m) / (wp.float64(w.pushed.mass) * FINE)
        add_whole(w.pushed.turning, k, 3, M)
        for a in range(3):
            add_whole(w.pushed.turning, k, 4 + a, M * wp.float64(r[a]))
            add_whole(w.pushed.turning, k, 7 + a, M * wp.float64(r[a] * r[a]))
            add_whole(w.pushed.turning, k, 10 + a, M * wp.float64(r[a] * r[(a + 1) % 3]))

    @wp.func
    def find_turn(w: tables.Walls, k: int):
        s = w.pushed.turning[k]
        M = wp.float64(s[3])
        c = wp.vec3d(wp.float64(s[4]), wp.float64(s[5]), wp.float64(s[6])) / wp.max(M, wp.float64(1.0))
        xx = wp.float64(s[7]) - M * c[0] * c[0]
        yy = wp.float64(s[8]) - M * c[1] * c[1]
        zz = wp.float64(s[9]) - M * c[2] * c[2]
        xy = wp.float64(s[10]) - M * c[0] * c[1]
        yz = wp.float64(s[11]) - M * c[1] * c[2]
        zx = wp.float64(s[12]) - M * c[2] * c[0]
        A = wp.mat33d(yy + zz, -xy, -zx, -xy, xx + zz, -yz, -zx, -yz, xx + yy)
        trace = wp.trace(A)
        spin = t.vec3()
        if trace > wp.float64(0.0) and wp.determinant(A) > FLAT * trace * trace * trace:
            D = wp.vec3d(wp.float64(s[0]), wp.float64(s[1]), wp.float64(s[2]))
            rate = wp.float64(1.0) / (wp.float64(w.pushed.dt) * wp.float64(real(FAR)))     # of (dx / dt) FAR dx over (FAR dx)^2
            found = rate * (wp.inverse(A) * D)
            spin = t.vec3(real(found[0]), real(found[1]), real(found[2]))
        far = real(FAR) * w.pushed.dx
        return spin, mesh_reference(w, k) + far * t.vec3(real(c[0]), real(c[1]), real(c[2]))

    return SimpleNamespace(add_lack=add_lack, add_carried=add_carried, find_turn=find_turn)
