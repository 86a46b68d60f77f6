"""Pictures of a stage: still, contact sheet, animated PNG or GIF, by the ray caster of `kernels.ray`.

    picture("flag_out.usdc", "flag.png")                      # last frame
    picture("flag_out.usdc", "flag.png", sheet=6)             # six frames side by side
    picture("flag_out.usdc", "flag.gif", size=(480, 270))     # all frames, moving
"""

import os
import tempfile
from collections.abc import Iterable, Sequence
from math import ceil, sqrt
from pathlib import Path
from time import perf_counter

import numpy as np
import warp as wp

from wsim import gif, png
from wsim.camera import Camera, fitted, subjects, up_vector
from wsim.kernels import ray
from wsim.look import Look
from wsim.scene import Problem, SceneError
from wsim.visible import Visible, visible

SUFFIXES = (".png", ".apng", ".gif")
MOST_FRAMES = 2000               # of one animation: all images are held in memory
GUTTER = 4                       # pixels between the images of a sheet

# Radiances, linear; a white surface in the open sends out about key * cos + sky = 1.
KEY = (0.86, 0.80, 0.71)
ZENITH, HORIZON = (0.34, 0.40, 0.50), (0.44, 0.45, 0.46)
BACKDROP_HIGH, BACKDROP_LOW = (0.46, 0.57, 0.70), (0.83, 0.84, 0.85)
SPREAD = 0.07                    # tangent of the key light's angular radius: soft shadows


class Caster:
    """Takes images of meshes whose points move. Buffers, tree and kernels are kept from image to image."""

    def __init__(self, looks: Sequence[Look], size: tuple[int, int], device=None):
        self.looks, self.size, self.device = list(looks), _checked_size(size), _device(device)
        self.mesh: wp.Mesh | None = None
        h, w = 2 * self.size[1], 2 * self.size[0]
        with wp.ScopedDevice(self.device):
            self.samples = ray.Samples()
            self.samples.what = wp.zeros((h, w), dtype=wp.int32)
            self.samples.place, self.samples.normal, self.samples.albedo = (
                wp.zeros((h, w), dtype=wp.vec3) for _ in range(3))
            self.light, self.other = wp.zeros((h, w), dtype=wp.vec4), wp.zeros((h, w), dtype=wp.vec4)
            self.out = wp.zeros((self.size[1], self.size[0], 3), dtype=wp.uint8)

    def image(self, points: Sequence[np.ndarray], camera: Camera, up: str = "Y",
              floor: float | None = None) -> np.ndarray:
        """uint8 (h, w, 3), sRGB. points: world positions [m] of each mesh; floor: height of the ground [m], or none."""
        sets = [np.asarray(p, np.float64) for p in points]
        if self.mesh is None:              # unit of length, kept: what stands still is then drawn the same to the bit
            seen = [sets[k] for k in subjects(sets)] or [np.zeros((1, 3))]
            low, high = np.min([p.min(axis=0) for p in seen], axis=0), np.max([p.max(axis=0) for p in seen], axis=0)
            self.center, self.scale = 0.5 * (low + high), max(0.5 * float(np.linalg.norm(high - low)), 1e-9)
        center, scale = self.center, self.scale
        with wp.ScopedDevice(self.device):
            surfaces = self._surfaces([(p - center) / scale for p in sets])
            view = _view(camera.filled(self.size[0] / self.size[1]), up, floor, center, scale)
            shape = self.light.shape
            wp.launch(ray.trace, dim=shape, inputs=[surfaces, view, self.samples], outputs=[self.light])
            for step in (1, 2, 4):
                wp.launch(ray.smooth, dim=shape, inputs=[self.samples, view, step, self.light], outputs=[self.other])
                self.light, self.other = self.other, self.light
            wp.launch(ray.develop, dim=self.out.shape[:2], inputs=[self.samples, view, self.light], outputs=[self.out])
            return self.out.numpy().copy()

    def _surfaces(self, sets: list[np.ndarray]) -> ray.Surfaces:
        """All meshes as one: built on the first image, refitted after."""
        points = np.concatenate([*sets, np.full((3, 3), -1e6)]).astype(np.float32)     # and one triangle far away:
        each = [look.normals(p) for look, p in zip(self.looks, sets, strict=True)]     # a mesh may not be empty
        normals = np.concatenate([*each, np.ones((1, 3))]).astype(np.float32)
        if self.mesh is None:
            self._fixed(sets, len(points) - 3, len(normals) - 1)
            self.mesh = wp.Mesh(wp.array(points, dtype=wp.vec3), self.indices)
            self.surfaces.mesh = self.mesh.id
            self.surfaces.normals = wp.array(normals, dtype=wp.vec3)
        else:
            self.mesh.points.assign(points)
            self.mesh.refit()
            self.surfaces.normals.assign(normals)
        return self.surfaces

    def _fixed(self, sets: list[np.ndarray], far: int, last: int) -> None:
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
        self.surfaces = ray.Surfaces()
        self.surfaces.normal_of = wp.array(np.concatenate(normal_of).astype(np.int32), dtype=wp.vec3i)
        self.surfaces.color_of = wp.array(np.concatenate(color_of).astype(np.int32), dtype=wp.vec3i)
        self.surfaces.colors = wp.array(np.concatenate(colors).astype(np.float32), dtype=wp.vec3)


def _view(camera: Camera, up: str, floor: float | None, center: np.ndarray, scale: float) -> ray.View:
    """The camera, the ground and the lights, in lengths of the scene's size. The key light stands behind the viewer."""
    right, image_up, forward = camera.axes()
    above = up_vector(up)
    level = forward - (forward @ above) * above
    level = level / np.linalg.norm(level) if np.linalg.norm(level) > 1e-3 else image_up
    light = 1.15 * above - 0.95 * np.cross(level, above) - 0.25 * level
    view = ray.View()
    view.eye = wp.vec3(*((camera.eye - center) / scale))
    view.right, view.above, view.forward = (
        wp.vec3(*v) for v in (camera.tan_x * right, camera.tan_y * image_up, forward))
    view.up, view.light, view.spread = wp.vec3(*above), wp.vec3(*(light / np.linalg.norm(light))), SPREAD
    view.floor = int(floor is not None)
    view.ground = 0.0 if floor is None else (floor - float(center @ above)) / scale
    view.key, view.zenith, view.horizon = wp.vec3(*KEY), wp.vec3(*ZENITH), wp.vec3(*HORIZON)
    view.backdrop_high, view.backdrop_low = wp.vec3(*BACKDROP_HIGH), wp.vec3(*BACKDROP_LOW)
    return view


def render(meshes: Sequence[tuple[np.ndarray, Look]], camera: Camera | None = None, size: tuple[int, int] = (960, 540),
           device=None, *, up: str = "Y", floor: float | None = None) -> np.ndarray:
    """One image of arrays, uint8 (h, w, 3). meshes: (points (n, 3) [m], Look); camera None: fitted to the points."""
    size = _checked_size(size)
    sets = [np.asarray(points, np.float64).reshape(-1, 3) for points, _ in meshes]
    for (_, look), points in zip(meshes, sets, strict=True):
        wrong = look.triangles[(look.triangles < 0) | (look.triangles >= len(points))]
        if len(wrong):
            raise ValueError(f"{look.path or 'mesh'}: triangles name point {wrong[0]}; it has {len(points)} points")
        if not np.isfinite(points).all():
            raise ValueError(f"{look.path or 'mesh'}: points are not finite")
    if not any(len(p) for p in sets):
        raise ValueError("nothing to draw: give at least one mesh with points")
    camera = camera or fitted(np.concatenate([sets[k] for k in subjects(sets)]), up, size[0] / size[1])
    return Caster([look for _, look in meshes], size, device).image(sets, camera, up, floor)


def picture(stage_path, out, *, frames=None, size: tuple[int, int] = (960, 540), sheet: int | None = None, device=None,
            camera: str | Camera | None = None) -> dict:
    """Draws a stage (a scene or a result) into a file: .png, or .gif and .apng for an animation.

    frames  time codes: one, several, "all", or None: the last for a still, all for an animation or a sheet. Several
            frames in a .png without a sheet give an animated PNG.
    sheet   number of frames on one contact sheet, evenly chosen; size is then that of the whole sheet, about
    camera  path of a UsdGeom.Camera, a `Camera`, "auto", or None: the stage's first camera, else one that fits
    Returns {"out", "frames", "size", "seconds", "notes"}. Raises SceneError for a stage that cannot be drawn, OSError
    for files that cannot be read or written; an old file at `out` is replaced only by a finished one.
    """
    began = perf_counter()
    out = _checked_out(Path(out))
    size = _checked_size(size)
    seen = visible(stage_path)
    moving = out.suffix.lower() in (".gif", ".apng")
    times = _chosen(seen, frames, moving, sheet)
    cell, columns = _grid(size, len(times)) if sheet else (size, 1)
    cameras, floors = _cameras(seen, times, camera, cell[0] / cell[1])
    caster = Caster([d.look for d in seen.drawn], cell, device)
    images = [caster.image([d.points(t) for d in seen.drawn], c, seen.up, floor)
              for t, c, floor in zip(times, cameras, floors, strict=True)]
    drawn = perf_counter()
    if sheet:
        images = [_sheet(images, columns)]
    fps = seen.fps * (len(times) - 1) / (times[-1] - times[0]) if len(times) > 1 else seen.fps
    if out.suffix.lower() == ".gif":
        data = gif.write(images, fps)
    else:
        data = png.still(images[0]) if len(images) == 1 else png.animation(images, fps)
    _write(out, data)
    return {"out": str(out), "frames": times, "size": [images[0].shape[1], images[0].shape[0]], "notes": seen.notes,
            "seconds": {"draw": drawn - began, "total": perf_counter() - began}}


def _device(device):
    try:
        return wp.get_device(device)
    except (ValueError, RuntimeError):
        names = ", ".join(str(d) for d in wp.get_devices())
        raise SceneError(Problem("device", f"{device!r} is not here; there are {names}")) from None


def _checked_size(size) -> tuple[int, int]:
    width, height = (int(v) for v in size)
    if not (8 <= width <= 8192 and 8 <= height <= 8192):
        raise SceneError(Problem("size", f"{width} x {height} pixels; allowed is 8 to 8192 each way"))
    return width, height


def _checked_out(out: Path) -> Path:
    if out.suffix.lower() not in SUFFIXES:
        raise SceneError(Problem(str(out), f"pictures end in {', '.join(SUFFIXES)}; found '{out.suffix}'"))
    if out.is_dir():
        raise IsADirectoryError(f"{out}: is a folder; name a file")
    if not out.parent.is_dir():
        raise FileNotFoundError(f"{out}: there is no folder {out.parent}; make it first")
    if not os.access(out.parent, os.W_OK):
        raise PermissionError(f"{out}: the folder {out.parent} cannot be written; choose another")
    return out


def _chosen(seen: Visible, frames, moving: bool, sheet: int | None) -> list[float]:
    """Time codes to draw, checked against the stage's range."""
    if frames is None:
        frames = "all" if moving or sheet else seen.times[-1]
    if isinstance(frames, str) and frames != "all":
        raise SceneError(Problem("frames", f"{frames!r}; allowed are time codes or 'all'"))
    if isinstance(frames, str):
        times = list(seen.times)
    else:
        times = [float(t) for t in frames] if isinstance(frames, Iterable) else [float(frames)]
    wrong = [t for t in times if not seen.times[0] <= t <= seen.times[-1]]
    if wrong or not times:
        found = f"time code {wrong[0]:g}" if wrong else "no time code"
        raise SceneError(Problem("frames", f"{found}; the stage has {seen.times[0]:g} to {seen.times[-1]:g}"))
    if sheet is not None:
        if sheet < 1:
            raise SceneError(Problem("sheet", f"{sheet} frames; a sheet holds at least 1"))
        times = [times[k] for k in np.unique(np.round(np.linspace(0, len(times) - 1, sheet)).astype(int))]
    if len(times) > MOST_FRAMES:
        raise SceneError(Problem("frames", f"{len(times)}; an animation holds {MOST_FRAMES} at most: name fewer"))
    return times


def _cameras(seen: Visible, times: list[float], camera, aspect: float) -> tuple[list[Camera], list[float | None]]:
    """The camera and the height of the ground at each time."""
    sets: list[list[np.ndarray]] = [[] for _ in seen.drawn]
    for t in times:
        for k, d in enumerate(seen.drawn):
            points = d.points(t)
            sets[k].append(points[:: 1 + len(points) // 20000])
    groups = [np.concatenate(s) for s in sets]
    chosen = np.concatenate([groups[k] for k in subjects(groups)] or [np.array([[-1.0, 0, -1.0], [1.0, 0, 1.0]])])
    axis = "XYZ".index(seen.up)
    base = min((float(g[:, axis].min()) for g in groups), default=0.0)
    floors: list[float | None] = [base if seen.floor is None else seen.floor(t) for t in times]
    if isinstance(camera, Camera):
        return [camera] * len(times), floors
    if camera is None and seen.cameras:
        camera = next(iter(seen.cameras))
    if camera is None or camera == "auto":
        return [fitted(chosen, seen.up, aspect)] * len(times), floors
    if camera not in seen.cameras:
        raise SceneError(Problem(str(camera), f"no such camera; the stage has {', '.join(seen.cameras) or 'none'}"))
    return [_of_stage(seen, camera, t) for t in times], floors


def _of_stage(seen: Visible, path: str, time: float) -> Camera:
    """A UsdGeom.Camera at a time; its whole aperture stays in view."""
    lens = seen.cameras[path](time)
    M = np.array(lens.transform)                    # rows: right, up, back, place
    tan_x, tan_y = (0.5 * a / lens.focalLength for a in (lens.horizontalAperture, lens.verticalAperture))
    unit = M[:3, :3] / np.linalg.norm(M[:3, :3], axis=1, keepdims=True)
    return Camera(seen.meters * M[3, :3], -unit[2], unit[1], tan_x, tan_y)


def _grid(size: tuple[int, int], count: int) -> tuple[tuple[int, int], int]:
    """Size of one image of a sheet, and the number of columns."""
    columns = ceil(sqrt(count))
    width = max((size[0] - (columns - 1) * GUTTER) // columns, 8)
    return (width, max(round(width * size[1] / size[0]), 8)), columns


def _sheet(images: list[np.ndarray], columns: int) -> np.ndarray:
    """Images in rows of `columns`, white between and behind."""
    h, w, _ = images[0].shape
    rows = ceil(len(images) / columns)
    whole = np.full((rows * (h + GUTTER) - GUTTER, columns * (w + GUTTER) - GUTTER, 3), 255, np.uint8)
    for k, image in enumerate(images):
        y, x = (k // columns) * (h + GUTTER), (k % columns) * (w + GUTTER)
        whole[y:y + h, x:x + w] = image
    return whole


def _write(out: Path, data: bytes) -> None:
    """Writes beside the target and renames, so that no half file is ever seen."""
    handle, name = tempfile.mkstemp(dir=out.parent, prefix=f".{out.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
        os.chmod(name, 0o644)
        os.replace(name, out)
    except OSError as error:
        Path(name).unlink(missing_ok=True)
        raise OSError(error.errno, f"not written ({error.strerror}); free space or write elsewhere", str(out)) from None
