"""Contacts of a cloth's edges and triangles with colliders that have sharp edges or corners: three launches behind the search
of points, and one in each sweep of XPBD. Equations: kernels/cloth/edge_contact/sites.py.

Cloths that collide with themselves meet colliders by their surfaces (`wsim.physics.contact.selfcontact`), and have none of
these. Nor have recordings with gradients, Newton's method, scenes with a `contact_width`, shapes of other places, meshes that
are open or deform, and those with few creases (`wsim.scene.check.sharp`).
"""

from __future__ import annotations

import numpy as np
import warp as wp

from wsim.geometry import topology
from wsim.kernels.cloth.edge_contact import gather, sites
from wsim.kernels.math.real import types
from wsim.model.structs import fill_struct
from wsim.scene.check.chord import triangle_breadth
from wsim.scene.check.sharp import has_edges

MORE = 8               # contacts of a point beyond those of points; more are made room for, and the frame is repeated

LOT = 24               # sites of a lot on a CPU, which are left alone where all of its points are at one face
EVERY = 2              # explicit substeps, which are short, of which one looks for sites. 24 x 20 cells over a box,
                       # ms a frame: none 12, each 22, of 2 17.5, of 4 16, of 8 15, and edges stand out by 1 mm at times


def _site_lots(triangles: np.ndarray, size: int) -> np.ndarray:
    """Sites of a body, (m, 3): its edges (i, j, j) and triangles, those that are near each other together; the last again until
    there are lots of `size`."""
    corner = np.concatenate([topology.edges_of_triangles(triangles)[:, [0, 1, 1]], triangles])
    corner = corner[np.lexsort((np.arange(len(corner)), corner.min(axis=1)))]
    return np.pad(corner, ((0, -len(corner) % size), (0, 0)), "edge")


def _lot_members(corner: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """First of each lot's points, and all of them."""
    lots = np.repeat(np.arange(len(corner) // size), 3 * size)
    pairs = np.unique(np.stack([lots, corner.ravel()], axis=1), axis=0)
    return np.searchsorted(pairs[:, 0], np.arange(len(corner) // size + 1)).astype(np.int32), pairs[:, 1].astype(np.int32)


class EdgeContacts:
    """Edges and triangles of the cloths of a model against the sharp colliders of its scene."""

    def __init__(self, model, contacts, short: bool):
        """contacts: `wsim.physics.contact.contacts.ColliderContacts`, of which those of sites are behind those of points;
        short: steps are explicit."""
        self.model, self.contacts, rows = model, contacts, contacts.rows
        known = rows.sharp(np.array([has_edges(b.source) for b in model.bodies]))
        each = [np.flatnonzero(known[first:last]) + first for first, last in zip(rows.first[:-1], rows.first[1:], strict=True)]
        size = LOT if model.device.is_cpu else 1
        made = [_site_lots(model.shared(b.triangles), size) for b, own in zip(model.bodies, each, strict=True) if len(own)]
        corner, (lot, member) = np.concatenate(made), _lot_members(np.concatenate(made), size)
        start, site = topology.incident_rows(corner, model.points)
        self.count, self.row, real, t = len(corner), np.concatenate(each).astype(int), model.real, types(model.real)
        up = model.upload

        def site_zeros(n, dtype):
            return wp.zeros(n, dtype=dtype, device=model.device)
        many = max(map(len, each)) * model.points
        self.data = fill_struct(
            sites.sharp_sites(real), first=up(np.append(0, np.cumsum(list(map(len, each)))).astype(np.int32), int),
            row=up(self.row.astype(np.int32), int), keep=site_zeros(len(self.row), real), corner=up(corner, wp.vec3i),
            size=size, object=up(contacts.points.object.numpy()[corner[::size, 0]], int), lot=up(lot, int),
            member=up(member, int), busy=site_zeros(len(lot) - 1, int), start=up(start.astype(np.int32), int),
            site=up(site.astype(np.int32), int), points=model.points,
            every=EVERY if short else 1,
            q=site_zeros(many, t.vec3), felt=site_zeros(many, t.vec4), side=site_zeros(many, int),
            touched=site_zeros(model.points, int), begin=site_zeros(model.points, int),
            met=up(np.full(self.count, -1, np.int32), int), beta=site_zeros(self.count, t.vec3),
            n=site_zeros(self.count, t.vec3), u=site_zeros(self.count, t.vec3), base=site_zeros(self.count, real),
            C=site_zeros(self.count, t.vec2))
        chord = np.zeros(len(rows.collider))
        for b, own in zip(model.bodies, each, strict=True):
            chord[own] = triangle_breadth(b.rest, b.triangles - b.first) if len(own) else 0.0
        contacts.table.chord.assign(chord.astype(contacts.dtype))
        self.keep()
        contacts.edges = self                            # slots have room for numbers of sites
        contacts.grow(contacts.slots.capacity + MORE)
        kinds = tuple(k for k in contacts.kinds if k in {rows.kind[rows.collider[r]] for r in self.row})
        self.kernels = (sites.sharp_distance_kernel(kinds, real, model.module),
                        sites.site_detection_kernel(kinds, real, model.module),
                        gather.site_gather_kernel(real, model.module),
                        None if short else gather.site_plane_kernel(real, model.module))

    def keep(self) -> None:
        """Distances that sites keep of colliders [m]: the authored ones. Edges need none of what hides chords."""
        rows = self.contacts.rows
        kept = [rows.colliders[rows.collider[r]].thickness or 0.0 for r in self.row]
        self.data.keep.assign(np.array(kept, self.contacts.dtype))

    def search(self, at, d: wp.array, a: wp.array) -> None:
        """Launches; at: what the search of points read, behind which this stands. Writes d and a as it does."""
        c, launch = self.contacts, self.model.launch
        feel, find, gather, _ = self.kernels
        launch(feel, self.model.points, [c.table, c.points, at], [self.data])
        launch(find, len(self.data.object), [c.table, c.points, at, self.data], [self.data])
        launch(gather, self.model.points, [c.table, c.points, at, self.data], [c.slots, d, a, c.push])

    def renew(self, at) -> None:
        """Launches planes of sites at the displacements of `at`, before a further sweep."""
        c = self.contacts
        self.model.launch(self.kernels[-1], self.model.points, [c.table, c.points, at, self.data, c.slots], [])
