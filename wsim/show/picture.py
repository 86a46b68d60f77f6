"""Pictures of a stage: still, contact sheet, animated PNG, GIF or MP4, by the ray caster of kernels/picture/ray.py.

    picture("flag_out.usdc", "flag.png")                      # last frame
    picture("flag_out.usdc", "flag.png", sheet=6)             # six frames side by side
    picture("flag_out.usdc", "flag.gif", size=(480, 270))     # all frames, moving
"""

import os
from collections.abc import Iterable
from math import ceil, sqrt
from pathlib import Path
from time import perf_counter

import numpy as np

from wsim.scene import Problem, SceneError
from wsim.show.camera import Camera, fit_camera_to_points, subjects_in_view
from wsim.show.image import animation, png
from wsim.show.prim import DrawnPrim
from wsim.show.raycast import RayCaster, checked_size, render
from wsim.show.visible import VisibleStage, read_visible_stage
from wsim.usd.result.atomic import replace_bytes
from wsim.usd.result.dependencies import refuse_overwrite

__all__ = ["Camera", "RayCaster", "picture", "render"]
SUFFIXES = (".png", ".apng", ".gif", ".mp4")
MOVING = (".apng", ".gif", ".mp4")
MOST_FRAMES = 2000               # of one animation: all images are held in memory
LOOKS = 9                        # frames that an automatic camera looks at, besides those that are drawn
GUTTER = 4                       # pixels between the images of a sheet


def picture(stage_path, out, *, frames=None, size: tuple[int, int] = (960, 540), sheet: int | None = None, device=None,
            camera: str | Camera | None = None, colour: str | None = None) -> dict:
    """Draws a stage (a scene or a result) into a file: .png, or .apng, .gif and .mp4 for an animation (the last two with
    the extra `picture`).

    frames  time codes: one, several, "all", or None: the last for a still, all for an animation or a sheet. Several
            frames in a .png without a sheet give an animated PNG.
    sheet   number of frames on one contact sheet, evenly chosen; size is then that of the whole sheet, about
    colour  strain, stress or contact: bodies are coloured by it (`wsim.show.colour`); None: as the stage has them
    camera  path of a UsdGeom.Camera, a `Camera`, "auto", or None: the stage's first camera, else one that fits
    Returns {"out", "frames", "size", "seconds", "notes"}. Raises SceneError for a stage that cannot be drawn, OSError
    for files that cannot be read or written; an old file at `out` is replaced only by a finished one, and not one that
    the stage is made of.
    """
    began = perf_counter()
    out = _checked_out(Path(out))
    refuse_overwrite("the picture", out, {stage_path: "the stage"})
    size = checked_size(size)
    seen = read_visible_stage(stage_path)
    moving = out.suffix.lower() in MOVING
    if colour:
        from wsim.show.paint import paint_measured_colours
        paint_measured_colours(seen, colour, device)
    times = _time_codes_to_draw(seen, frames, moving, sheet)
    cell, columns = contact_sheet_cells(size, len(times)) if sheet else (size, 1)
    cameras, floors = _cameras_and_ground(seen, times, camera, cell[0] / cell[1])
    caster = caster_of_stage(seen, cell, device)
    images = [image_of_stage(caster, seen, t, c, floor) for t, c, floor in zip(times, cameras, floors, strict=True)]
    drawn = perf_counter()
    if sheet:
        images = [tile_images(images, columns)]
    fps = seen.fps * (len(times) - 1) / (times[-1] - times[0]) if len(times) > 1 else seen.fps
    _write_picture_file(out, images, fps)
    return {"out": str(out), "frames": times, "size": [images[0].shape[1], images[0].shape[0]], "notes": seen.notes,
            "seconds": {"draw": drawn - began, "total": perf_counter() - began}}


def caster_of_stage(seen: VisibleStage, size: tuple[int, int], device=None) -> RayCaster:
    """A ray caster of the meshes of a stage."""
    return RayCaster([d.look for d in seen.drawn if not d.balls], size, device)


def image_of_stage(caster: RayCaster, seen: VisibleStage, time: float, camera: Camera, floor: float | None) -> np.ndarray:
    """A stage at a time code: uint8 (h, w, 3), sRGB."""
    meshes = [d for d in seen.drawn if not d.balls]
    return caster.image([d.points(time) for d in meshes], camera, seen.up, floor,
                        [d.colors(time) if d.colors else d.look.colors for d in meshes],
                        [(smoke, smoke.at(time)) for smoke in seen.smoke], seen.floor is not None,
                        [d.balls(time) for d in seen.drawn if d.balls])


def _checked_out(out: Path) -> Path:
    if out.suffix.lower() not in SUFFIXES:
        raise SceneError(Problem(str(out), f"pictures end in {', '.join(SUFFIXES)}; found '{out.suffix}'"))
    animation.require_image_writer(out.suffix.lower())
    if out.is_dir():
        raise IsADirectoryError(f"{out}: is a folder; name a file")
    if not out.parent.is_dir():
        raise FileNotFoundError(f"{out}: there is no folder {out.parent}; make it first")
    if not os.access(out.parent, os.W_OK):
        raise PermissionError(f"{out}: the folder {out.parent} cannot be written; choose another")
    return out


def _time_codes_to_draw(seen: VisibleStage, frames, moving: bool, sheet: int | None) -> list[float]:
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


def _cameras_and_ground(seen: VisibleStage, times: list[float], camera, aspect: float) -> tuple[list[Camera],
                                                                                                list[float | None]]:
    """The camera and the height of the ground at each time."""
    groups = framed_points(seen, times, whole=len(times) > 1)
    subjects = sorted({*subjects_in_view(groups), *(k for k, d in enumerate(seen.drawn) if d.balls)})
    chosen = np.concatenate([groups[k] for k in subjects] or [np.array([[-1.0, 0, -1.0], [1.0, 0, 1.0]])])
    axis = "XYZ".index(seen.up)
    below = groups if len(times) > 1 or seen.floor else framed_points(seen, times)        # no floor that rises with the cloth
    base = min((float(g[:, axis].min()) for g in below if len(g)), default=0.0)
    floors: list[float | None] = [base if seen.floor is None else seen.floor(t) for t in times]
    if isinstance(camera, Camera):
        return [camera] * len(times), floors
    if camera is None and seen.cameras:
        camera = next(iter(seen.cameras))
    if camera is None or camera == "auto":
        return [fit_camera_to_points(chosen, seen.up, aspect)] * len(times), floors
    if camera not in seen.cameras:
        raise SceneError(Problem(str(camera), f"no such camera; the stage has {', '.join(seen.cameras) or 'none'}"))
    return [_camera_of_stage(seen, camera, t) for t in times], floors


def framed_points(seen: VisibleStage, times: list[float], whole: bool = True) -> list[np.ndarray]:
    """Points that a camera frames, of each thing that is drawn and each volume (n, 3) [m], at the times that are drawn; of
    volumes where there is smoke. whole: over the whole run, at LOOKS between: the camera of several frames stands still."""
    others = np.linspace(0, len(seen.times) - 1, min(LOOKS, len(seen.times))) if whole else ()
    looks = sorted({*times, *(seen.times[int(k)] for k in others)})
    groups = []
    for d in seen.drawn:
        sets = [points for t in (looks if d.moves else times[:1]) if (points := finite_points(d, t, t in times)) is not None]
        group = np.concatenate([points[:: 1 + len(points) // 20000] for points in sets])
        groups.append(without_strays(group) if d.balls else group)
    for smoke in seen.smoke:
        found = [corners for t in looks if (corners := smoke.filled(t)) is not None]
        groups.append(np.concatenate(found) if found else smoke.corners(times[0]))
    return groups


def without_strays(points: np.ndarray) -> np.ndarray:
    """Points (n, 3) less the few that are farther away than most of them are wide: a drop that flies off steers no camera."""
    if not len(points):
        return points
    low, high = np.quantile(points, [0.02, 0.98], axis=0)
    near = (points >= low - (high - low)) & (points <= high + (high - low))
    return points[near.all(axis=1)]


def finite_points(drawn: DrawnPrim, time: float, needed: bool) -> np.ndarray | None:
    """Points of a thing at a time code, of particles the corners of boxes about them; None of a broken frame, where it is not
    needed."""
    try:
        return drawn.balls(time).corners() if drawn.balls else drawn.points(time)
    except SceneError:
        if needed:
            raise
        return None


def _camera_of_stage(seen: VisibleStage, path: str, time: float) -> Camera:
    """A UsdGeom.Camera at a time; its whole aperture stays in view."""
    lens = seen.cameras[path](time)
    M = np.array(lens.transform)                    # rows: right, up, back, place
    tan_x, tan_y = (0.5 * a / lens.focalLength for a in (lens.horizontalAperture, lens.verticalAperture))
    unit = M[:3, :3] / np.linalg.norm(M[:3, :3], axis=1, keepdims=True)
    return Camera(seen.meters * M[3, :3], -unit[2], unit[1], tan_x, tan_y)


def contact_sheet_cells(size: tuple[int, int], count: int) -> tuple[tuple[int, int], int]:
    """Size of one image of a sheet, and the number of columns."""
    columns = ceil(sqrt(count))
    width = max((size[0] - (columns - 1) * GUTTER) // columns, 8)
    return (width, max(round(width * size[1] / size[0]), 8)), columns


def tile_images(images: list[np.ndarray], columns: int) -> np.ndarray:
    """Images in rows of `columns`, white between and behind."""
    h, w, _ = images[0].shape
    rows = ceil(len(images) / columns)
    whole = np.full((rows * (h + GUTTER) - GUTTER, columns * (w + GUTTER) - GUTTER, 3), 255, np.uint8)
    for k, image in enumerate(images):
        y, x = (k // columns) * (h + GUTTER), (k % columns) * (w + GUTTER)
        whole[y:y + h, x:x + w] = image
    return whole


def _write_picture_file(out: Path, images: list[np.ndarray], fps: float) -> None:
    """Writes beside the target and renames, so that no half file is ever seen."""
    try:
        if out.suffix.lower() in animation.NEEDS:
            animation.write_animation(out, images, fps)
        else:
            replace_bytes(out, png.encode_png(images[0]) if len(images) == 1 else png.encode_animated_png(images, fps))
    except OSError as error:
        raise OSError(error.errno, f"not written ({error.strerror}); free space or write elsewhere", str(out)) from None
