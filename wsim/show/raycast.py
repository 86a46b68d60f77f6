"""The ray caster from the host: meshes that move, a camera and lights in, an image out. See `kernels.ray`."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from wsim.kernels.picture import ray
from wsim.model import kernel_cache
from wsim.scene import Problem, SceneError
from wsim.show.camera import Camera, fit_camera_to_points, subjects_in_view, up_vector
from wsim.show.shading import MeshLook

if TYPE_CHECKING:
    from wsim.show.prim import Balls
    from wsim.show.smoke.read import SmokeDensity, SmokeVolume
    Cloud = tuple[SmokeVolume, SmokeDensity | None]

# Radiances, linear; a white surface in the open sends out about key * cos + sky = 1.
KEY = (0.86, 0.80, 0.71)
ZENITH, HORIZON = (0.34, 0.40, 0.50), (0.44, 0.45, 0.46)
BACKDROP_HIGH, BACKDROP_LOW = (0.46, 0.57, 0.70), (0.83, 0.84, 0.85)
SPREAD = 0.07                    # tangent of the key light's angular radius: soft shadows


class RayCaster:
    """Takes images of meshes whose points move. Buffers, tree and kernels are kept from image to image."""

    def __init__(self, looks: Sequence[MeshLook], size: tuple[int, int], device=None):
        self.looks, self.size, self.device = list(looks), checked_size(size), kernel_cache.warp_device(device)
        self.mesh: wp.Mesh | None = None
        self.sized = False
        _load_ray_kernels(self.device)
        h, w = 2 * self.size[1], 2 * self.size[0]
        with wp.ScopedDevice(self.device):
            self.samples = ray.PixelSamples()
            self.samples.what = wp.zeros((h, w), dtype=wp.int32)
            self.samples.place, self.samples.normal, self.samples.albedo = (
                wp.zeros((h, w), dtype=wp.vec3) for _ in range(3))
            self.light, self.other = wp.zeros((h, w), dtype=wp.vec4), wp.zeros((h, w), dtype=wp.vec4)
            self.out = wp.zeros((self.size[1], self.size[0], 3), dtype=wp.uint8)

    def image(self, points: Sequence[np.ndarray], camera: Camera, up: str = "Y", floor: float | None = None,
              colors: Sequence[np.ndarray] | None = None, clouds: "Sequence[Cloud]" = (),
              tiles: bool = False, balls: "Sequence[Balls]" = ()) -> np.ndarray:
        """uint8 (h, w, 3), sRGB. points: world positions [m] of each mesh; floor: height of the ground [m], or none; colors:
        linear, of each mesh as many as its look has; None: those; clouds: smoke, and its density now (None: there is none);
        tiles: squares show the ground, else its shadows alone; balls: particles."""
        sets = [np.asarray(p, np.float64) for p in points]
        if not self.sized:                 # unit of length, kept: what stands still is then drawn the same to the bit
            boxes = [smoke.corners(smoke.times[0] if smoke.times else 0.0) for smoke, _ in clouds]
            sets_of_all = [*sets, *(each.corners() for each in balls)]
            seen = [sets_of_all[k] for k in subjects_in_view(sets_of_all)] + boxes or [np.zeros((1, 3))]
            self.sized = any(len(p) for p in sets_of_all) or bool(boxes)           # particles may come later
            low, high = np.min([p.min(axis=0) for p in seen], axis=0), np.max([p.max(axis=0) for p in seen], axis=0)
            self.center, self.scale = 0.5 * (low + high), max(0.5 * float(np.linalg.norm(high - low)), 1e-9)
        center, scale = self.center, self.scale
        with wp.ScopedDevice(self.device):
            surfaces = self._refit_surfaces([(p - center) / scale for p in sets])
            if colors is not None:
                surfaces.colors.assign(np.concatenate([*colors, np.ones((1, 3))]).astype(np.float32))
            view = _ray_view(camera.filled(self.size[0] / self.size[1]), up, floor, center, scale)
            view.tile = tile_size(scale) / scale if tiles else 0.0
            shape = self.light.shape
            wp.launch(ray.trace_primary_rays, dim=shape, inputs=[surfaces, view, self.samples], outputs=[self.light])
            if any(len(each.radii) for each in balls):
                from wsim.show.image.particles import trace_balls
                trace_balls(balls, surfaces, view, self.samples, self.light, center, scale)
            media = _smoke_media_of_image(clouds, camera.eye, center, scale)
            if media:
                self.light, self.other = media.light(surfaces, view, self.samples, self.light, self.other)
            for step in (1, 2, 4):
                wp.launch(ray.smooth_light, dim=shape, inputs=[self.samples, view, step, self.light], outputs=[self.other])
                self.light, self.other = self.other, self.light
            if media:
                media.develop_with_smoke(self.samples, view, self.light, self.out)
            else:
                wp.launch(ray.develop_image, dim=self.out.shape[:2], inputs=[self.samples, view, self.light],
                          outputs=[self.out])
            return self.out.numpy().copy()

    def _refit_surfaces(self, sets: list[np.ndarray]) -> ray.RayScene:
        """All meshes as one: built on the first image, refitted after."""
        points = np.concatenate([*sets, np.full((3, 3), -1e6)]).astype(np.float32)     # and one triangle far away:
        each = [look.normals(p) for look, p in zip(self.looks, sets, strict=True)]     # a mesh may not be empty
        normals = np.concatenate([*each, np.ones((1, 3))]).astype(np.float32)
        if self.mesh is None:
            self._build_index_tables(sets, len(points) - 3, len(normals) - 1)
            self.mesh = wp.Mesh(wp.array(points, dtype=wp.vec3), self.indices)
            self.surfaces.mesh = self.mesh.id
            self.surfaces.normals = wp.array(normals, dtype=wp.vec3)
        else:
            self.mesh.points.assign(points)
            self.mesh.refit()
            self.surfaces.normals.assign(normals)
        return self.surfaces

    def _build_index_tables(self, sets: list[np.ndarray], far: int, last: int) -> None:
        """Index tables of the joined mesh: offsets of each look's points, normals and colours."""
        triangles, normal_of, color_of, colors = [], [], [], []
        at, normal, color = 0, 0, 0
        for look, points in zip(self.looks, sets, strict=True):
            triangles.append(look.triangles + at)
            normal_of.append(look.normal_of + normal)
            color_of.append(look.color_of + color)
            colors.append(look.colors)
            at, normal = at + len(points), normal + int(np.max(look.normal_of, initial=-1)) + 1
            color += len(look.colors)
        triangles.append(np.array([[far, far + 1, far + 2]]))
        normal_of.append(np.full((1, 3), last))
        color_of.append(np.zeros((1, 3), int))
        colors.append(np.ones((1, 3)))
        self.indices: wp.array = wp.array(np.concatenate(triangles).astype(np.int32).ravel(), dtype=wp.int32)
        self.surfaces = ray.RayScene()
        self.surfaces.normal_of = wp.array(np.concatenate(normal_of).astype(np.int32), dtype=wp.vec3i)
        self.surfaces.color_of = wp.array(np.concatenate(color_of).astype(np.int32), dtype=wp.vec3i)
        self.surfaces.colors = wp.array(np.concatenate(colors).astype(np.float32), dtype=wp.vec3)


def tile_size(scale: float) -> float:
    """Edge of the squares of a floor [m]: 1, 2 or 5 times a power of ten, up to 0.35 of half the scene's size `scale` [m]."""
    power = 10.0 ** np.floor(np.log10(0.35 * scale))
    return float(power * max(step for step in (1.0, 2.0, 5.0) if step * power <= 0.35 * scale * (1.0 + 1e-9)))


def _smoke_media_of_image(clouds: "Sequence[Cloud]", eye: np.ndarray, center: np.ndarray, scale: float) -> Any:
    """Smoke on the device; None where there is none: its kernels are not even imported."""
    there = [(smoke, density) for smoke, density in clouds if density is not None]
    if not there:
        return None
    from wsim.show.smoke.media import SmokeMedia
    return SmokeMedia(there, eye, center, scale)


def _load_ray_kernels(device) -> None:
    """Loads the kernels, without the precompiled header, which costs a single module more than it saves."""
    with kernel_cache.GATE.alone(), kernel_cache.without_header():
        kernel_cache.load_kernel_module(ray, device)


def _ray_view(camera: Camera, up: str, floor: float | None, center: np.ndarray, scale: float) -> ray.CameraView:
    """The camera, the ground and the lights, in lengths of the scene's size. The key light stands behind the viewer."""
    right, image_up, forward = camera.axes()
    above = up_vector(up)
    level = forward - (forward @ above) * above
    level = level / np.linalg.norm(level) if np.linalg.norm(level) > 1e-3 else image_up
    light = 1.15 * above - 0.95 * np.cross(level, above) - 0.25 * level
    view = ray.CameraView()
    view.eye = wp.vec3(*((camera.eye - center) / scale))
    view.right, view.above, view.forward = (
        wp.vec3(*v) for v in (camera.tan_x * right, camera.tan_y * image_up, forward))
    view.up, view.light, view.spread = wp.vec3(*above), wp.vec3(*(light / np.linalg.norm(light))), SPREAD
    view.floor = int(floor is not None)
    view.ground = 0.0 if floor is None else (floor - float(center @ above)) / scale
    view.key, view.zenith, view.horizon = wp.vec3(*KEY), wp.vec3(*ZENITH), wp.vec3(*HORIZON)
    view.backdrop_high, view.backdrop_low = wp.vec3(*BACKDROP_HIGH), wp.vec3(*BACKDROP_LOW)
    return view


def render(meshes: Sequence[tuple[np.ndarray, MeshLook]], camera: Camera | None = None, size: tuple[int, int] = (960, 540),
           device=None, *, up: str = "Y", floor: float | None = None) -> np.ndarray:
    """One image of arrays, uint8 (h, w, 3). meshes: (points (n, 3) [m], Look); camera None: fitted to the points."""
    size = checked_size(size)
    sets = [np.asarray(points, np.float64).reshape(-1, 3) for points, _ in meshes]
    for (_, look), points in zip(meshes, sets, strict=True):
        wrong = look.triangles[(look.triangles < 0) | (look.triangles >= len(points))]
        if len(wrong):
            raise ValueError(f"{look.path or 'mesh'}: triangles name point {wrong[0]}; it has {len(points)} points")
        if not np.isfinite(points).all():
            raise ValueError(f"{look.path or 'mesh'}: points are not finite")
    if not any(len(p) for p in sets):
        raise ValueError("nothing to draw: give at least one mesh with points")
    camera = camera or fit_camera_to_points(np.concatenate([sets[k] for k in subjects_in_view(sets)]), up, size[0] / size[1])
    return RayCaster([look for _, look in meshes], size, device).image(sets, camera, up, floor)


def checked_size(size) -> tuple[int, int]:
    width, height = (int(v) for v in size)
    if not (8 <= width <= 8192 and 8 <= height <= 8192):
        raise SceneError(Problem("size", f"{width} x {height} pixels; allowed is 8 to 8192 each way"))
    return width, height
