"""Rigid contacts of the tests are compiled once for all kinds of shapes, not once for each set of kinds that scenes have.

A scene compiles what its own pairs of shapes need, 4 to 6 s of a core, and the tests have nearly 30 such sets. A kernel for
all kinds takes 1 s longer to compile than one for boxes and a plane, does the same to the last bit, and is as fast. `pytest -m
slow` compiles what each scene needs, as a simulation does, and so does a machine with a GPU, where one for all takes longer.
"""

from wsim.kernels.rigid.lists import collide, collide_mesh
from wsim.kernels.rigid.narrow.pair import pairs_of_kinds
from wsim.kernels.rigid.narrow.shape import KINDS

ALL = pairs_of_kinds(KINDS.keys() - {"triangle", "mesh"})
ON_MESHES = frozenset(KINDS.keys() - {"triangle", "mesh", "plane"})
COLLIDE, COLLIDE_MESH = collide.pair_manifold_kernel, collide_mesh.collide_mesh


def collide_all(pairs, real, module):
    """Instead of `wsim.kernels.rigid.lists.collide.pair_manifold_kernel`."""
    assert pairs <= ALL, pairs - ALL
    return COLLIDE(ALL, real, module)


def collide_mesh_all(kinds, real, module, lanes=1, of_bodies=False):
    """Instead of `wsim.kernels.rigid.lists.collide_mesh.collide_mesh`."""
    met = ON_MESHES | {"plane", "mesh"} if of_bodies else ON_MESHES
    assert kinds <= met, kinds - met
    return COLLIDE_MESH(met, real, module, lanes, of_bodies)
