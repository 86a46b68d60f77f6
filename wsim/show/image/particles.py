"""Particles on the device for one image (kernels/picture/balls.py)."""

from collections.abc import Sequence

import numpy as np
import warp as wp

from wsim.kernels.picture import balls as kernels
from wsim.kernels.picture import ray
from wsim.model import kernel_cache
from wsim.show.prim import Balls


def trace_balls(balls: Sequence[Balls], surfaces: ray.RayScene, view: ray.CameraView, samples: ray.PixelSamples,
                light: wp.array, center: np.ndarray, scale: float) -> None:
    """Draws particles before what each pixel sees, on the current device. center [m] and scale [m] of the image."""
    device = wp.get_device()
    with kernel_cache.GATE.alone(), kernel_cache.without_header():
        kernel_cache.load_kernel_module(kernels, device)
    x = (np.concatenate([each.centers for each in balls]) - center) / scale
    r = np.concatenate([each.radii for each in balls]) / scale
    order = _nearby_order(x)
    x, r = x[order].astype(np.float32), r[order].astype(np.float32)
    table = kernels.BallScene()
    table.centers, table.radii = wp.array(x, dtype=wp.vec3), wp.array(r, dtype=wp.float32)
    table.colors = wp.array(np.concatenate([each.colors for each in balls])[order].astype(np.float32), dtype=wp.vec3)
    tree = wp.Bvh(wp.array(x - r[:, None], dtype=wp.vec3), wp.array(x + r[:, None], dtype=wp.vec3),
                  constructor="lbvh" if device.is_cuda else "median")
    table.tree = tree.id
    wp.launch(kernels.trace_rays_with_balls, dim=light.shape, inputs=[surfaces, table, view, samples], outputs=[light])
    wp.synchronize_device()


def _nearby_order(x: np.ndarray) -> np.ndarray:
    """An order of places (n, 3) in which neighbours stand near each other: by slabs, then by rows of them."""
    cells = np.floor((x - x.min(axis=0)) / max(float(np.ptp(x, axis=0).max()), 1e-9) * 64.0).astype(np.int64)
    return np.lexsort((cells[:, 2], cells[:, 1], cells[:, 0]))
