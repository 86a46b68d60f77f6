"""Adjoint of a reflection, kernels/fluid/passes/reflection.py, and what adjoints of a step add and keep.

    v' = 2 w - v,  u' = 2 w - u:    w += 2 v' + 2 u',  v = -v',  u = -u'    with a bar over each
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types


@cache
def reflection_adjoint_kernel(real, module):
    """Kernel over faces: cotangents of v' and u' become those of v and u; w_out adds."""

    def reflect_faces_adjoint(v_out: wp.array(dtype=real), u_out: wp.array(dtype=real), w_out: wp.array(dtype=real)):
        c = wp.tid()
        v = v_out[c]
        u = u_out[c]
        w_out[c] = w_out[c] + real(2.0) * (v + u)
        v_out[c] = -v
        u_out[c] = -u

    return wp.kernel(reflect_faces_adjoint, name=f"reflect_adjoint_{types(real).name}", module=module, enable_backward=False)


@cache
def mirror_velocity_kernel(real, module):
    """Kernel over rows: y_out = 2 w - v."""

    def mirror_velocity(w: wp.array(dtype=real), v: wp.array(dtype=real), y_out: wp.array(dtype=real)):
        c = wp.tid()
        y_out[c] = real(2.0) * w[c] - v[c]

    return wp.kernel(mirror_velocity, name=f"mirror_{types(real).name}", module=module, enable_backward=False)


@cache
def row_addition_kernel(real, module):
    """Kernel over rows: y_out += factor x."""

    def add_scaled_rows(x: wp.array(dtype=real), factor: real, y_out: wp.array(dtype=real)):
        c = wp.tid()
        y_out[c] = y_out[c] + factor * x[c]

    return wp.kernel(add_scaled_rows, name=f"add_rows_{types(real).name}", module=module, enable_backward=False)


@cache
def step_storage_kernel(real, module):
    """Kernel over rows: slots_out of step done[0] are q."""

    def store_step_rows(q: wp.array(dtype=real), done: wp.array(dtype=int), slots_out: wp.array(dtype=real)):
        c = wp.tid()
        slots_out[done[0] * q.shape[0] + c] = q[c]

    return wp.kernel(store_step_rows, name=f"keep_step_{types(real).name}", module=module, enable_backward=False)


@cache
def step_fetch_kernel(real, module):
    """Kernel over rows: q_out as step done[0] + ahead had it."""

    def fetch_step_rows(slots: wp.array(dtype=real), done: wp.array(dtype=int), ahead: int, q_out: wp.array(dtype=real)):
        c = wp.tid()
        q_out[c] = slots[(done[0] + ahead) * q_out.shape[0] + c]

    return wp.kernel(fetch_step_rows, name=f"fetch_step_{types(real).name}", module=module, enable_backward=False)


@cache
def last_step_kernel(real, module):
    """Kernel of one thread: behind the last step of a frame."""

    def mark_last_step(clock: wp.array(dtype=real), done_out: wp.array(dtype=int), going_out: wp.array(dtype=int)):
        done_out[0] = int(clock[2])
        going_out[0] = 1

    return wp.kernel(mark_last_step, name=f"steps_last_{types(real).name}", module=module, enable_backward=False)


@cache
def previous_step_kernel(real, module):
    """Kernel of one thread: to the step before, and whether there is another before that."""

    def rewind_step(done_out: wp.array(dtype=int), clock_out: wp.array(dtype=real), going_out: wp.array(dtype=int)):
        k = done_out[0] - 1
        done_out[0] = k
        clock_out[1] = clock_out[0] * real(k)
        going_out[0] = int(k > 0)

    return wp.kernel(rewind_step, name=f"steps_before_{types(real).name}", module=module, enable_backward=False)
