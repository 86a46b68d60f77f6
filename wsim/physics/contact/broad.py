"""Broad phase of the search: Warp's tree over boxes about the bounding balls of colliders, where an object has many.

The tree is built anew in the first substep of a frame and refitted in the others, both on the device and captured: a tree that
was only refitted is 3 times as slow after 4 frames of 1000 balls that move at 2 m/s, where building costs less than one search.
All objects share it, each has a node of its own in it, and a point begins there. Planes have no ball and are always tried. A
point tries the colliders that it would try without, in the same order: results are the same to the bit.

Lists of candidates: which faces of mesh colliders a point may come near in many substeps, see kernels/contact/candidates.py.
"""
from collections.abc import Callable

import numpy as np
import warp as wp

from wsim.kernels.contact import search as kernels
from wsim.kernels.contact.candidates import MOST
from wsim.physics.contact.colliders import ColliderRowTable

ROOM, WIDE = 16, 48    # faces of a list at first, of explicit steps and of others; MOST at last
EVERY = 32             # substeps of a list. H100, the shirt on its dummy, 1122 substeps a frame, ms: 8 69.8, 32 65.1, 128 73.5;
                       # without lists 94.1
OFTEN = 8              # of one where substeps are long: it holds what a point may come near until it ends. bone_cape with
                       # 108 substeps, its frames with most contacts, CPU-ms: 32 60, 16 51, 8 50, 4 54


class ColliderTree:
    """Tree of the rows of a table (`wsim.kernels.contact.project.contact_tables`)."""

    def __init__(self, rows: ColliderRowTable, table, device, real, module):
        self.table, self.real = table, real
        self.boxes, self.roots = kernels.ball_box_kernel(real, module), kernels.tree_root_kernel(module)
        objects = np.repeat(np.arange(len(rows.first) - 1), np.diff(rows.first)).astype(np.int32)
        finite = np.isfinite(rows.radius)[rows.collider]
        leaf, endless = np.flatnonzero(finite).astype(np.int32), np.flatnonzero(~finite).astype(np.int32)

        def upload_tree_rows(values):
            return wp.array(values, dtype=int, device=device)
        table.leaf, table.endless = upload_tree_rows(leaf), upload_tree_rows(endless)
        table.start = upload_tree_rows(np.searchsorted(endless, rows.first).astype(np.int32))
        table.root = wp.zeros(len(rows.first) - 1, dtype=int, device=device)
        self.groups = upload_tree_rows(objects[leaf])
        self.low, self.high = (wp.zeros(len(leaf), dtype=wp.vec3f, device=device) for _ in range(2))
        self.bvh: wp.Bvh | None = None

    def build(self, launch: Callable) -> None:
        """Builds the tree before the first frame; not captured."""
        if self.bvh is None:
            self._fit_tree_boxes(launch, 0)
            self.bvh = wp.Bvh(self.low, self.high, groups=self.groups)
            self.table.tree = self.bvh.id

    def fit(self, launch: Callable, k: int) -> None:
        """Fits the tree to the balls of substep k; capturable."""
        assert self.bvh is not None
        self._fit_tree_boxes(launch, k)
        if k == 0:
            self.bvh.rebuild()
            launch(self.roots, len(self.table.root), [self.table.tree], [self.table.root])
        else:
            self.bvh.refit()

    def _fit_tree_boxes(self, launch: Callable, k: int) -> None:
        launch(self.boxes, len(self.low), [self.table, k], [self.low, self.high])


def use_face_lists(contacts, room: int = ROOM, every: int = EVERY) -> None:
    """Lets the search of `contacts` (`wsim.physics.contact.contacts.ColliderContacts`) list faces, where an object has meshes:
    for substeps that are many and short. room: for faces of a list; every: substeps of it."""
    size = _number_object_meshes(contacts)
    if not size:
        return
    p, device = contacts.points, contacts.device
    p.every = every
    p.count, p.place = (wp.zeros(size, dtype=kind, device=device) for kind in (int, wp.vec3f))
    p.radius = wp.full(size, -1.0, dtype=float, device=device)
    p.wanted = wp.zeros(1, dtype=int, device=device)
    grow_face_lists(p, room)
    contacts.make_search_kernel(listed=True)


def skip_far_meshes(contacts) -> None:
    """Lets the search of `contacts` pass over meshes that a point is known to be far from: for a CPU, which lists save nothing
    there (bone_cape 47 CPU-ms a frame against 41, caped_man 80 against 65)."""
    p, size = contacts.points, _number_object_meshes(contacts)
    if size and contacts.tree is None:
        device = contacts.device
        p.count, p.place = (wp.zeros(size, dtype=kind, device=device) for kind in (int, wp.vec3f))
        p.radius = wp.zeros(size, dtype=float, device=device)
        contacts.cleared = True
        contacts.make_search_kernel()


def _number_object_meshes(contacts) -> int:
    """Numbers the meshes of each object; slots of all points."""
    rows = contacts.rows
    slot = np.full(len(rows.collider), -1, np.int32)
    for first, last in zip(rows.first[:-1], rows.first[1:], strict=True):
        meshes = [r for r in range(first, last) if rows.meshes[rows.collider[r]] is not None]
        slot[meshes] = np.arange(len(meshes))
    contacts.points.slot = wp.array(slot, dtype=int, device=contacts.device)
    return (int(slot.max(initial=-1)) + 1) * contacts.count


def grow_face_lists(p, wanted: int) -> bool:
    """Gives lists of points (`wsim.kernels.contact.project.contact_tables`) room for as many faces as were wanted, MOST at
    most; False where they have as much."""
    room = min(wanted, MOST)
    if room <= p.room:
        return False
    p.room = room
    p.face, p.far = (wp.zeros(len(p.count) * room, dtype=kind, device=p.count.device) for kind in (int, float))
    p.radius.fill_(-1.0)
    return True
