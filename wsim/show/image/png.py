"""PNG files, still and animated, with zlib and struct only.

PNG specification, third edition (W3C 2025): filters in section 9, animation chunks acTL, fcTL, fdAT in 11.3.4.
Images are uint8 arrays of shape (h, w, 3), sRGB, row 0 on top.
"""

import struct
import zlib
from collections.abc import Sequence

import numpy as np

SIGNATURE = b"\x89PNG\r\n\x1a\n"
_COLOUR = struct.pack(">B", 0)      # sRGB chunk, perceptual intent


def _png_chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def _png_header(width: int, height: int) -> bytes:
    return SIGNATURE + _png_chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)) + _png_chunk(b"sRGB", _COLOUR)


def _filter_and_deflate(image: np.ndarray) -> bytes:
    """Rows filtered by the filter with the least sum of absolute differences, then deflated."""
    h, w, _ = image.shape
    rows = np.ascontiguousarray(image).reshape(h, 3 * w)
    left, above, corner = (np.zeros_like(rows) for _ in range(3))
    left[:, 3:] = rows[:, :-3]
    above[1:] = rows[:-1]
    corner[1:, 3:] = rows[:-1, :-3]
    a, b, c = left.astype(np.int16), above.astype(np.int16), corner.astype(np.int16)
    to_a, to_b, to_c = np.abs(b - c), np.abs(a - c), np.abs(a + b - 2 * c)
    paeth = np.where((to_a <= to_b) & (to_a <= to_c), left, np.where(to_b <= to_c, above, corner))
    mean = ((a + b) >> 1).astype(np.uint8)
    trials = np.stack([rows, rows - left, rows - above, rows - mean, rows - paeth])       # modulo 256
    cost = np.abs(trials.view(np.int8).astype(np.int16)).sum(axis=2, dtype=np.int64)
    best = np.argmin(cost, axis=0)
    lines = np.empty((h, 1 + 3 * w), np.uint8)
    lines[:, 0] = best
    lines[:, 1:] = trials[best, np.arange(h)]
    return zlib.compress(lines.tobytes(), 7)


def encode_png(image: np.ndarray) -> bytes:
    """The file's bytes for one image (h, w, 3)."""
    h, w, _ = image.shape
    return _png_header(w, h) + _png_chunk(b"IDAT", _filter_and_deflate(image)) + _png_chunk(b"IEND", b"")


def changed_pixels_box(before: np.ndarray, after: np.ndarray) -> tuple[int, int, int, int]:
    """Smallest box (top, bottom, left, right; ends excluded) that holds every changed pixel; one pixel if none did."""
    differs = np.any(before != after, axis=2)
    rows, columns = np.flatnonzero(differs.any(axis=1)), np.flatnonzero(differs.any(axis=0))
    if len(rows) == 0:
        return 0, 1, 0, 1
    return int(rows[0]), int(rows[-1]) + 1, int(columns[0]), int(columns[-1]) + 1


def encode_animated_png(images: Sequence[np.ndarray], fps: float) -> bytes:
    """The bytes of an animated PNG that repeats for ever. Frames after the first hold only the box that changed.

    fps: frames a second, kept to a thousandth. Readers without animation show the first image.
    """
    h, w, _ = images[0].shape
    parts = [_png_header(w, h), _png_chunk(b"acTL", struct.pack(">II", len(images), 0))]
    number = 0
    for k, image in enumerate(images):
        top, bottom, left, right = (0, h, 0, w) if k == 0 else changed_pixels_box(images[k - 1], image)
        control = struct.pack(">IIIIIHHBB", number, right - left, bottom - top, left, top, *_frame_delay_fraction(fps), 0, 0)
        parts.append(_png_chunk(b"fcTL", control))
        number += 1
        data = _filter_and_deflate(image[top:bottom, left:right])
        if k == 0:
            parts.append(_png_chunk(b"IDAT", data))
        else:
            parts.append(_png_chunk(b"fdAT", struct.pack(">I", number) + data))
            number += 1
    return b"".join([*parts, _png_chunk(b"IEND", b"")])


def _frame_delay_fraction(fps: float) -> tuple[int, int]:
    """Seconds a frame as a fraction of 16-bit integers."""
    if fps == int(fps) and fps < 65536:
        return 1, int(fps)
    return (1000, round(1000 * fps)) if fps < 65 else (1, round(min(fps, 65535)))
