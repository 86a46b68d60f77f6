"""Moving pictures: GIF by Pillow, MP4 by imageio (H.264). Both are in the extra `picture`; a PNG needs neither."""

from collections.abc import Sequence
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from wsim.scene import Problem, SceneError
from wsim.usd.result.atomic import replace_bytes, replace_file_atomically

NEEDS = {".gif": ("PIL",), ".mp4": ("imageio", "imageio_ffmpeg")}
COLOURS = 255                # of a GIF, and one for "as before"
SEEN = 1 << 20               # pixels that the palette is made of


def require_image_writer(suffix: str) -> None:
    """Raises SceneError where what writes such files is not installed: found out before anything is drawn."""
    missing = [name for name in NEEDS.get(suffix, ()) if find_spec(name) is None]
    if missing:
        raise SceneError(Problem(suffix, f"{' and '.join(missing)} not installed; install by: pip install -e \".[picture]\", "
                                 "or write .png or .apng"))


def write_animation(out: Path, images: Sequence[np.ndarray], fps: float) -> None:
    """A file by its ending, whole or not at all. images: uint8 (h, w, 3). Raises OSError where it cannot be written."""
    if out.suffix.lower() == ".gif":
        replace_bytes(out, encode_gif(images, fps))
    else:
        with replace_file_atomically(out) as temporary:
            encode_mp4(temporary, images, fps)


def gif_frame_delays(count: int, fps: float) -> list[int]:
    """Delays of each frame of a GIF [ms]: it counts in 1/100 s, so that delays vary to keep time, and a frame lasts at least
    2, since readers slow down shorter ones."""
    ticks = np.round(100.0 * np.arange(count + 1) / fps).astype(int)
    return [10 * max(int(d), 2) for d in np.diff(ticks)]


def encode_gif(images: Sequence[np.ndarray], fps: float) -> bytes:
    """The bytes of a GIF that repeats for ever: one palette for all frames (median cut), no dithering, so that what does not
    move stays equal between frames and costs nothing."""
    from PIL import Image
    step = max(1, len(images) * images[0].shape[0] * images[0].shape[1] // SEEN)
    pixels = np.concatenate([im.reshape(-1, 3)[k % step::step] for k, im in enumerate(images)])
    palette = Image.fromarray(pixels[None]).quantize(COLOURS, Image.Quantize.MEDIANCUT, kmeans=3)
    frames = [Image.fromarray(im).quantize(palette=palette, dither=Image.Dither.NONE) for im in images]
    file = BytesIO()
    frames[0].save(file, "GIF", save_all=True, append_images=frames[1:], duration=gif_frame_delays(len(images), fps), loop=0,
                   optimize=False)
    return file.getvalue()


def encode_mp4(path: Path, images: Sequence[np.ndarray], fps: float) -> None:
    """H.264 in 4:2:0, which every player shows; odd sizes lose a row or a column."""
    import imageio.v2 as imageio
    film: Any = imageio.get_writer(path, format="FFMPEG", fps=fps, codec="libx264", quality=8, macro_block_size=2)
    with film as writer:
        for image in images:
            writer.append_data(image[:image.shape[0] // 2 * 2, :image.shape[1] // 2 * 2])
