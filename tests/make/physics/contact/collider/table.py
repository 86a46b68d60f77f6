"""What tests/physics/contact/collider/test_table.py shares with other tests: DT, asked, screw."""

import numpy as np
import warp as wp

from wsim.kernels.contact.collider.table import collider_queries, collider_type
from wsim.kernels.math.real import types
from wsim.physics.contact.collider.table import ColliderTable

DT = 0.04


def screw(t: float) -> np.ndarray:
    """A turn about an axis beside the shape, and a way along it."""
    c, s = np.cos(3.0 * t), np.sin(3.0 * t)
    return np.array([[c, -s, 0, 0.5 * c], [s, c, 0, 0.5 * s], [0, 0, 1.0, 0.2 * t], [0, 0, 0, 1.0]])


def asked(table: ColliderTable, y: np.ndarray, time: float, real):
    """(closest, velocity) of each place y (rows, n, 3) to its collider."""
    t, C, ask = types(real), collider_type(real), collider_queries(table.kinds, real)

    def answer(c: C, y: wp.array2d(dtype=t.vec3), time: real, phi_out: wp.array2d(dtype=real), n_out: wp.array2d(dtype=t.vec3),
               p_out: wp.array2d(dtype=t.vec3), v_out: wp.array2d(dtype=t.vec3)):
        k, i = wp.tid()
        phi, n, p = ask.closest(c, k, y[k, i], time)
        phi_out[k, i] = phi
        n_out[k, i] = n
        p_out[k, i] = p
        v_out[k, i] = ask.rate(c, k, y[k, i], time)

    kernel = wp.kernel(answer, name=f"answer_{t.name}", module="unique", enable_backward=False)
    out = [wp.zeros(y.shape[:2], real), *[wp.zeros(y.shape[:2], t.vec3) for _ in range(3)]]
    wp.launch(kernel, y.shape[:2], [table.rows, wp.array(y, t.vec3), real(time)], out, device="cpu")
    return [a.numpy() for a in out]
