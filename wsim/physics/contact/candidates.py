"""Lists of candidates on a device: which faces of mesh colliders a point may come near in many substeps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from wsim.kernels.contact import search
from wsim.kernels.contact.candidates import ROOM, Lists

if TYPE_CHECKING:
    from wsim.physics.contact.contacts import Contacts

EVERY = 32             # substeps of a list


def none() -> Lists:
    """Lists that there are not."""
    return Lists()


def listed(contacts: Contacts, module) -> None:
    """Lets the search of `contacts` list faces, where an object has meshes: for substeps that are many and short."""
    rows = contacts.rows
    slot = np.full(len(rows.collider), -1, np.int32)
    for first, last in zip(rows.first[:-1], rows.first[1:], strict=True):
        meshes = [r for r in range(first, last) if rows.meshes[rows.collider[r]] is not None]
        slot[meshes] = np.arange(len(meshes))
    most = int(slot.max(initial=-1)) + 1
    if not most:
        return
    L, n, device = Lists(), contacts.count, contacts.device
    L.every, L.points, L.slot = EVERY, n, wp.array(slot, dtype=int, device=device)
    L.count, L.place = (wp.zeros(most * n, dtype=kind, device=device) for kind in (int, wp.vec3f))
    L.radius = wp.full(most * n, -1.0, dtype=float, device=device)
    L.face = wp.zeros(most * n * ROOM, dtype=int, device=device)
    contacts.lists = L
    contacts.search_kernel = search.search(contacts.kinds, contacts.real, module, contacts.tree is not None, True)
