"""Kernels of bodies and points that have another form where balls turn (kernels/position_based/rolling/law.py)."""

from wsim.kernels.rigid.touch.body_point_solve import star_solve_kernel
from wsim.kernels.rigid.touch.exchange import contact_plane_kernel, point_impulse_kernel, star_hub_kernel, star_row_kernel
from wsim.kernels.rigid.touch.points import found_contact_kernel, touch_begin_kernel

ROLLING = (touch_begin_kernel, found_contact_kernel, star_row_kernel, point_impulse_kernel, star_solve_kernel, star_hub_kernel,
           contact_plane_kernel)
