"""Lists of the blocks of kernels/motion/fused/sheet.py, and the elements that they are of: see
`wsim.physics.motion.fused.domain_decomposition`."""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.motion.load import borne_loads
from wsim.kernels.soft.fem import elements as tets

LISTS = ("point", "hinge", "hinge_corner", "triangle", "corner", "slot", "moment_begin", "moment", "force_begin", "force",
         "push_begin", "push", "value", "near", "tet", "tet_corner")


@cache
def sheet_patch_table(real, materials: tuple[str, ...] = ()):
    """Struct of the patches, and of the elements that they are made of: reads only, but for met. materials: of tets, each with
    a table of kernels/soft/fem.py."""
    t, Borne = types(real), borne_loads(real)

    class SheetPatches:
        head: wp.array(dtype=int)            # first place in `list` and size of each of LISTS, (blocks * LISTS * 2,)
        list: wp.array(dtype=int)
        rest: wp.array(dtype=t.mat22)        # of triangles, as kernels/cloth/element.py has them
        stiffness: wp.array(dtype=t.vec4)
        tau: wp.array(dtype=t.scalar)
        angle: wp.array(dtype=t.scalar)      # of hinges
        bend: wp.array(dtype=t.scalar)
        relax: wp.array(dtype=t.scalar)
        own: wp.array(dtype=t.scalar)        # of curvatures
        value: wp.array(dtype=t.vec3)
        wind: wp.array(dtype=t.vec3)         # and drag and lift of the air over each object: kernels/cloth/air.py
        drag: wp.array(dtype=t.scalar)
        lift: wp.array(dtype=t.scalar)
        normal_drag: wp.array(dtype=t.scalar)
        room: wp.array(dtype=t.scalar)       # clearance [m], (points,); of frames that are watched
        met: wp.array(dtype=int)             # becomes 1 where a point goes further
        mail: wp.array(dtype=t.vec4)         # what blocks of a grid send, with its substep; 0 at first, (4 points,)
        borne: Borne

    SheetPatches.__annotations__.update({name: tets(real) for name in materials})
    return wp.struct(SheetPatches)
