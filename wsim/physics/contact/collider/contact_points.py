"""Contact points of cloth, nets and soft bodies with colliders and rigid bodies, and the forces of the last substep.

A push P of a point of mass m is the impulse m P / g (kernels/contact/project.py), and g the step over which its force acts:

    F = m P / g^2

NumPy only.
"""

import numpy as np

from wsim.scene.samples import ContactPoints


def collider_contact_points(contact, g: float) -> ContactPoints:
    """Contacts of `wsim.physics.contact.method.ContactMethod` with an effective step g [s]."""
    own, state, model = contact.contacts, contact.state, contact.model
    slots, n = own.slots, own.count
    row = slots.row.numpy().reshape(-1, n)
    slot, at = np.nonzero(np.arange(len(row))[:, None] < slots.count.numpy())
    w, normal, push, b, d = (array.numpy().astype(np.float64)
                             for array in (own.points.w, slots.n, own.push, slots.b, state.d))
    hit, n_hit = row[slot, at], normal.reshape(-1, n, 3)[slot, at]
    gap = b.reshape(-1, n)[slot, at] + (n_hit * d[at]).sum(1)
    force = push.reshape(-1, n, 3)[slot, at] / (np.where(w > 0.0, w, np.inf)[at, None] * g * g)      # of what is held: none
    along = (force * n_hit).sum(1)
    x = state.x.numpy().astype(np.float64) + state.e.numpy()
    body, element = _authored_points(model)
    paths = np.array([_path_of_row(contact, r) for r in range(len(own.rows.collider))], dtype=str)[hit]
    origins = np.stack([each.origin for each in model.bodies])
    names = np.array([each.path for each in model.bodies], dtype=str)
    worlds = np.array([each.world for each in model.bodies])
    keep = along > 0.0
    own_body = body[at]
    found = ContactPoints(names[own_body], paths, worlds[own_body], element[at], x[at] + origins[own_body], n_hit, gap, along,
                          force - along[:, None] * n_hit)
    return found.rows(keep)


def _path_of_row(contact, row: int) -> str:
    """Path of the rigid body of a row of the table of colliders, else of the collider."""
    own = contact.contacts
    body = own.owner[row]
    return contact.movers.rigid.bodies[body][0].path if body >= 0 else own.rows.colliders[own.rows.collider[row]].path


def _authored_points(model) -> tuple[np.ndarray, np.ndarray]:
    """(body, number of the point in the author's order; -1 of mid-edge nodes) of each point of the solver."""
    body, element = np.zeros(model.points, int), np.full(model.points, -1)
    for k, each in enumerate(model.bodies):
        body[each.first:each.last] = k
        element[each.index] = np.arange(len(each.index))
    return body, element
