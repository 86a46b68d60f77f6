"""Smoke on the device for the ray caster: see kernels/picture/smoke.py. Imported where a stage has smoke."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.picture import smoke
from wsim.model import kernel_cache
from wsim.show.smoke.read import SmokeDensity, SmokeVolume

BLOCKS = 96                # along the longest edge of what is drawn: of light, and of two steps of a ray


class SmokeMedia:
    """All smoke of an image. center, scale: world [m] to the lengths of the caster."""

    def __init__(self, clouds: Sequence[tuple[SmokeVolume, SmokeDensity]], eye: np.ndarray, center: np.ndarray, scale: float):
        def negative_eye_distance(cloud: tuple[SmokeVolume, SmokeDensity]) -> float:
            _, density = cloud
            middle = density.world @ np.append(0.5 * np.array(density.values.shape), 1.0)
            return -float(np.linalg.norm(middle[:3] - eye))

        with kernel_cache.GATE.alone(), kernel_cache.without_header():
            kernel_cache.load_kernel_module(smoke, wp.get_device())
        # what is far first
        self.media = [_smoke_medium(*cloud, center, scale) for cloud in sorted(clouds, key=negative_eye_distance)]

    def light(self, surfaces: Any, view: Any, samples: Any, light: wp.array, other: wp.array) -> tuple[wp.array, wp.array]:
        """Lights all smoke, and shades what is behind it; returns (light, other) as they are now."""
        for medium in self.media:
            wp.launch(smoke.light_smoke, dim=medium.lit.shape, inputs=[medium, surfaces, view], outputs=[medium.lit])
            wp.launch(smoke.shade_surfaces, dim=light.shape, inputs=[medium, view, samples, light], outputs=[other])
            light, other = other, light
        return light, other

    def develop_with_smoke(self, samples: Any, view: Any, light: wp.array, out: wp.array) -> None:
        seen, other = (wp.full(light.shape, wp.vec4(0.0, 0.0, 0.0, 1.0), dtype=wp.vec4) for _ in range(2))
        for medium in self.media:
            wp.launch(smoke.march_smoke, dim=light.shape, inputs=[medium, view, samples, seen], outputs=[other])
            seen, other = other, seen
        wp.launch(smoke.develop_smoke, dim=out.shape[:2], inputs=[samples, view, light, seen], outputs=[out])


def _smoke_medium(cloud: SmokeVolume, density: SmokeDensity, center: np.ndarray, scale: float) -> Any:
    back = density.world[:3, :3] / scale
    corner = (density.world[:3, 3] - center) / scale
    turn = np.linalg.inv(back)
    found = smoke.SmokeMedium()
    found.density = wp.array(density.values, dtype=float)
    found.block = -(-max(density.values.shape) // BLOCKS)
    found.lit = wp.zeros(tuple(-(-n // found.block) for n in density.values.shape), dtype=float)
    found.turn, found.back = wp.mat33(*turn.ravel()), wp.mat33(*back.ravel())
    found.shift, found.corner = wp.vec3(*(-turn @ corner)), wp.vec3(*corner)
    found.albedo, found.extinction = wp.vec3(*cloud.albedo), cloud.extinction * scale
    return found
