"""Animated GIF files, with NumPy only: one palette for all frames, ordered dithering, LZW.

GIF89a specification (CompuServe 1990), appendix F for LZW (Welch 1984). Palette by median cut (Heckbert 1982) and three
rounds of k-means. The dither pattern stands still, so what does not move stays equal between frames and is written as
transparent, which LZW packs into next to nothing.
"""

import struct
from collections.abc import Sequence

import numpy as np

from wsim.show.png import changed

COLORS = 255                # and one for "as before"
SAME = 255
DITHER = 7.0                # peak to peak of the dither [1/255]; smaller: bands in smooth shades, larger: grain


def write(images: Sequence[np.ndarray], fps: float) -> bytes:
    """The bytes of a GIF that repeats for ever. images: uint8 (h, w, 3). GIF counts in 1/100 s: delays vary to keep
    time, and a frame lasts at least 2, since readers slow down shorter ones."""
    h, w, _ = images[0].shape
    colors = palette(images)
    table = np.zeros((256, 3), np.uint8)
    table[:len(colors)] = np.round(colors)
    parts = [b"GIF89a", struct.pack("<HHBBB", w, h, 0xF7, 0, 0), table.tobytes(),
             b"\x21\xff\x0bNETSCAPE2.0\x03\x01\x00\x00\x00"]
    ticks = np.round(100.0 * np.arange(len(images) + 1) / fps).astype(int)
    before = None
    for k, image in enumerate(images):
        after = indices(image, colors)
        top, bottom, left, right = (0, h, 0, w) if before is None else changed(before[..., None], after[..., None])
        part = after[top:bottom, left:right]
        if before is not None:
            part = np.where(part == before[top:bottom, left:right], SAME, part)
        parts += [struct.pack("<BBBBHBB", 0x21, 0xF9, 4, 0x05, max(ticks[k + 1] - ticks[k], 2), SAME, 0),
                  struct.pack("<BHHHHB", 0x2C, left, top, right - left, bottom - top, 0), _blocks(lzw(part.ravel()))]
        before = after
    return b"".join([*parts, b"\x3b"])


def palette(images: Sequence[np.ndarray]) -> np.ndarray:
    """At most 255 colours (k, 3), float, that fit the images; every picture counts, large ones are thinned."""
    step = max(1, int(len(images) * images[0].shape[0] * images[0].shape[1] // 1_000_000))
    pixels = np.concatenate([im.reshape(-1, 3)[k % step::step] for k, im in enumerate(images)])
    fine = pixels.astype(np.int64) >> 2
    keys, counts = np.unique(fine[:, 0] << 12 | fine[:, 1] << 6 | fine[:, 2], return_counts=True)
    colors = _unpack(keys)
    weights = np.sqrt(counts)                    # rare colours are seen too
    centers = _median_cut(colors, weights, COLORS)
    for _ in range(3):
        near = _nearest(colors, centers)
        total = np.maximum(np.bincount(near, weights, len(centers)), 1e-9)
        sums = np.stack([np.bincount(near, weights * colors[:, c], len(centers)) for c in range(3)], axis=1)
        centers = np.where((np.bincount(near, minlength=len(centers)) > 0)[:, None], sums / total[:, None], centers)
    return centers


def _unpack(keys: np.ndarray) -> np.ndarray:
    """Middles (k, 3) of cells of 4 x 4 x 4 colours."""
    return np.stack([keys >> 12, keys >> 6 & 63, keys & 63], axis=1) * 4.0 + 1.5


def _median_cut(colors: np.ndarray, weights: np.ndarray, count: int) -> np.ndarray:
    """Means of `count` boxes: the box with most weighted spread is halved at its weighted median."""
    def box(rows):
        mean = np.average(colors[rows], axis=0, weights=weights[rows])
        spread = (weights[rows, None] * (colors[rows] - mean) ** 2).sum(axis=0)
        return float(spread.max()) if len(rows) > 1 else 0.0, int(spread.argmax()), mean, rows

    boxes = [box(np.arange(len(colors)))]
    while len(boxes) < count:
        k = max(range(len(boxes)), key=lambda k: boxes[k][0])
        spread, axis, _, rows = boxes[k]
        if spread <= 0.0:
            break
        rows = rows[np.argsort(colors[rows, axis], kind="stable")]
        half = np.cumsum(weights[rows])
        cut = int(np.clip(np.searchsorted(half, 0.5 * half[-1]), 1, len(rows) - 1))
        boxes[k:k + 1] = [box(rows[:cut]), box(rows[cut:])]
    return np.array([b[2] for b in boxes])


def _nearest(colors: np.ndarray, centers: np.ndarray) -> np.ndarray:
    """Index of the nearest centre for each colour; the eye's weights of red, green and blue."""
    w = np.sqrt([0.30, 0.59, 0.11])
    a, b = (colors * w).astype(np.float32), (centers * w).astype(np.float32)
    size = (b * b).sum(axis=1)
    return np.concatenate([np.argmin(size - 2.0 * (part @ b.T), axis=1)
                           for part in np.array_split(a, max(1, len(a) // 8192))])


def indices(image: np.ndarray, colors: np.ndarray) -> np.ndarray:
    """Palette index of each pixel (h, w) uint8, with an ordered 8 x 8 dither (Bayer 1973)."""
    h, w, _ = image.shape
    bayer = np.array([[0.0]])
    for _ in range(3):
        bayer = np.block([[4 * bayer, 4 * bayer + 2], [4 * bayer + 3, 4 * bayer + 1]])
    shift = np.tile((bayer + 0.5) / 64.0 - 0.5, (h // 8 + 1, w // 8 + 1))[:h, :w] * DITHER
    fine = np.clip(image + shift[..., None], 0, 255).astype(np.int64) >> 2
    keys, where = np.unique(fine[..., 0] << 12 | fine[..., 1] << 6 | fine[..., 2], return_inverse=True)
    return _nearest(_unpack(keys), colors).astype(np.uint8)[where].reshape(h, w)


def lzw(values: np.ndarray) -> bytes:
    """LZW code stream of bytes, variable width 9 to 12 bits, least significant bit first."""
    codes, widths = [256], [9]
    table: dict[int, int] = {}
    free, width = 258, 9
    pixels = values.tolist()
    prefix = pixels[0]
    for pixel in pixels[1:]:
        key = prefix << 8 | pixel
        found = table.get(key)
        if found is not None:
            prefix = found
            continue
        codes.append(prefix)
        widths.append(width)
        prefix = pixel
        if free < 4096:
            table[key] = free
            if free == 1 << width:
                width += 1
            free += 1
        else:
            codes.append(256)
            widths.append(12)
            table = {}
            free, width = 258, 9
    codes += [prefix, 257]
    widths += [width, _after(free, width)]
    return _bits(np.array(codes), np.array(widths))


def _after(free: int, width: int) -> int:
    """Width of the code that follows one more entry: the reader adds one for the last code too."""
    return width + 1 if free == 1 << width and width < 12 else width


def _bits(codes: np.ndarray, widths: np.ndarray) -> bytes:
    starts = np.concatenate([[0], np.cumsum(widths)])
    bits = np.zeros(starts[-1], np.uint8)
    for b in range(12):
        long = widths > b
        bits[starts[:-1][long] + b] = codes[long] >> b & 1
    return np.packbits(bits, bitorder="little").tobytes()


def _blocks(data: bytes) -> bytes:
    """Image data: minimum code size, blocks of at most 255 bytes, an empty one at the end."""
    parts = [b"\x08"]
    for k in range(0, len(data), 255):
        parts += [bytes([len(data[k:k + 255])]), data[k:k + 255]]
    return b"".join([*parts, b"\x00"])
