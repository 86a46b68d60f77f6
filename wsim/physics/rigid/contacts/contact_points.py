"""Contact points of rigid bodies with the forces of the last substep: what its impulses give over its length,

    F_n = push / h,   F_t = rub / h                     kernels/rigid/soft_step.py, kernels/rigid/joint/tree/contact/contacts.py

Places and gaps are those behind the substep. Of a point that touches nothing and was not pushed there is no row. Blows that
throw bodies back (restitution) are impulses of their own and no part of it. NumPy only.
"""

import numpy as np

from wsim.scene.samples import ContactPoints

POINTS = 4                   # of a manifold


def rigid_contact_points(tables, h: float) -> ContactPoints:
    """Contacts of `wsim.physics.rigid.contacts.RigidContactTables`, of a substep of h [s]."""
    rows, work = tables.list, tables.work
    a, b, count, normal = (array.numpy() for array in (rows.a, rows.b, rows.count, rows.n))
    push, rub, gap, arm = (array.numpy().astype(np.float64) for array in (rows.push, rows.rub, work.now, work.r_a))
    j = np.flatnonzero(((a >= 0)[:, None] & (np.arange(POINTS) < count[:, None])).ravel() & ((push > 0.0) | (gap <= 0.0)))
    m = j // POINTS
    a, b, n = a[m], b[m], normal[m].astype(np.float64)
    frame, named = tables.table.frame.numpy()[a], tables.named
    point = tables.table.origin.numpy()[frame] + _frame_shifts(tables)[frame] + arm[j] - 0.5 * gap[j, None] * n
    paths = np.array([path for path, _ in named], dtype=str)
    worlds = np.array([of for _, of in named], dtype=int)
    return ContactPoints(paths[a], paths[b], np.maximum(worlds[a], worlds[b]), np.full(len(j), -1), point, n, gap[j],
                         push[j] / h, rub[j] / h)


def _frame_shifts(tables) -> np.ndarray:
    """How far frames of bodies and colliders are from their origins now (frames, 3) [m]."""
    method = tables.method
    still = tables.still.x.numpy()[-1] if tables.poses_of else np.zeros((len(tables.colliders), 3))
    return np.concatenate([method.get("x") + method.get("e"), still.reshape(-1, 3)])
