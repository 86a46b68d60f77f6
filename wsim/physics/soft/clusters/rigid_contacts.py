"""Contacts of rigid clusters in a plan, each iteration behind their projection: kernels/soft/clusters/rigid_contacts.py."""

import numpy as np
import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.soft.clusters import rigid_contacts as kernels
from wsim.model.stage import Clock, Stage
from wsim.model.structs import fill_struct
from wsim.physics.soft.clusters.tables import cluster_sources


def whole_clusters(method) -> np.ndarray:
    """True for clusters that are rigid, share no point with others, and have no pinned one, (clusters,) bool."""
    table, w = method.table, method.points.constants.w.numpy()
    alone = (np.bincount(table.point, minlength=len(w)) == 1) & (w > 0.0)
    return np.logical_and.reduceat(alone[table.point], table.first[:-1]) & (method.kappa == 0.0)


class RigidClusterContacts:
    """method: `ShapeMatching`; contact: `wsim.physics.contact.method.ContactMethod`, whose search comes before."""

    def __init__(self, method, contact, whole: np.ndarray):
        self.method, self.contact = method, contact
        model, n, threads = method.model, len(method.table.sizes), method.threads
        t, device, of = types(model.real), model.device, cluster_sources(model)
        friction = np.array([of[k].friction for k in method.table.body], model.dtype)
        self.table = fill_struct(
            kernels.rigid_contact_table(model.real), whole=model.upload(whole.astype(np.int32), int),
            friction=model.upload(friction, t.vec2), listed=wp.zeros(len(method.table.point), dtype=int, device=device),
            count=wp.zeros(n * threads, dtype=int, device=device), touches=wp.zeros(n, dtype=int, device=device),
            way=wp.zeros(n, dtype=wp.float64, device=device), mass=wp.zeros(n, dtype=wp.float64, device=device),
            inverse=wp.zeros(n, dtype=wp.mat33d, device=device))
        module = model.shared_module("rigid_contacts", threads, threads=threads)
        self.find, self.solve = (make(model.real, module) for make in (kernels.touching_member_kernel,
                                                                       kernels.rigid_contact_kernel))
        contact.stages.append(Stage("contacts of clusters", "collide", self.list_members, 1, len(method.table.point) * 20,
                                    what=f"{int(whole.sum())} rigid ones", frames=contact.stages[0].frames))

    def read(self):
        """Places that kernels read."""
        s = self.method.state
        return self.contact.contacts.read(x=s.x, d=s.d, a=self.contact.anchor, push=self.contact.contacts.push)

    def list_members(self, clock: Clock) -> None:
        """Members that touch, behind the search."""
        self.method.blocks(self.find, len(self.method.table.sizes),
                           [self.method.data, self.contact.contacts.slots, self.read(), self.table], [])

    def project(self, clock: Clock) -> None:
        """An iteration of all contacts."""
        found = self.contact.contacts
        self.method.blocks(self.solve, len(self.method.table.sizes),
                           [self.method.data, self.table, found.table, found.slots, self.read(), self.contact.step(clock)],
                           [self.method.state.d, found.push])
