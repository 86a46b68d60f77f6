"""PNG, APNG and GIF files hold exactly the pixels that were given: read back by decoders written from the formats."""

import struct
import zlib

import numpy as np
import pytest

from wsim.show.image import png


def chunks(data: bytes):
    """(kind, content) of each chunk, checksums verified."""
    assert data[:8] == png.SIGNATURE
    at = 8
    while at < len(data):
        length, = struct.unpack_from(">I", data, at)
        body = data[at + 4:at + 8 + length]
        assert struct.unpack_from(">I", data, at + 8 + length)[0] == zlib.crc32(body)
        yield body[:4], body[4:]
        at += 12 + length


def unfiltered(packed: bytes, width: int, height: int) -> np.ndarray:
    """Pixels of deflated, filtered rows (PNG, section 9), one byte after the other."""
    raw, stride = zlib.decompress(packed), 3 * width
    rows = np.zeros((height + 1, stride + 3), np.uint8).tolist()              # a zero row above, a zero pixel left
    for y in range(height):
        line = raw[y * (stride + 1):(y + 1) * (stride + 1)]
        above, row = rows[y], rows[y + 1]
        for k in range(stride):
            a, b, c = row[k], above[k + 3], above[k]
            p = a + b - c
            paeth = min((a, b, c), key=lambda v, p=p: abs(p - v))            # the first wins a tie
            row[k + 3] = (line[k + 1] + (0, a, b, (a + b) // 2, paeth)[line[0]]) % 256
    return np.array(rows, np.uint8)[1:, 3:].reshape(height, width, 3)


def pattern(h: int, w: int, seed: int = 0) -> np.ndarray:
    """A slope, a flat part and noise, so that every filter is the best one somewhere."""
    y, x = np.mgrid[:h, :w]
    image = np.stack([3 * x + y, 2 * y, (x * y) // 3], axis=-1) % 256
    image[h // 2:, w // 2:] = np.random.default_rng(seed).integers(0, 256, image[h // 2:, w // 2:].shape)
    image[: h // 4] = 77
    return image.astype(np.uint8)


@pytest.mark.parametrize(("h", "w"), [(1, 1), (5, 3), (24, 37)])
def test_a_still_comes_back_exactly(h, w):
    image = pattern(h, w)
    found = dict(chunks(png.encode_png(image)))
    assert struct.unpack(">IIBBBBB", found[b"IHDR"]) == (w, h, 8, 2, 0, 0, 0)
    np.testing.assert_array_equal(unfiltered(found[b"IDAT"], w, h), image)


def test_an_animation_comes_back_exactly_and_stores_only_what_changed():
    frames = [pattern(20, 30) for _ in range(4)]
    frames[1][3:7, 4:15] = 200
    frames[2][:] = frames[1]
    frames[3][:] = pattern(20, 30, seed=1)
    canvas, shown, sizes, number, control = None, [], [], 0, None
    for kind, body in chunks(png.encode_animated_png(frames, 24.0)):
        if kind == b"acTL":
            assert struct.unpack(">II", body) == (4, 0)
        elif kind in (b"fcTL", b"fdAT"):
            assert struct.unpack(">I", body[:4])[0] == number
            number += 1
        if kind == b"fcTL":
            control = struct.unpack(">IIIIHHBB", body[4:])
            assert control[4:6] == (1, 24)                                    # delay in seconds
        if kind in (b"IDAT", b"fdAT"):
            w, h, left, top = control[:4]
            canvas = np.zeros((20, 30, 3), np.uint8) if canvas is None else canvas.copy()
            canvas[top:top + h, left:left + w] = unfiltered(body[4 * (kind == b"fdAT"):], w, h)
            shown.append(canvas)
            sizes.append((h, w))
    np.testing.assert_array_equal(shown, frames)
    assert sizes[:3] == [(20, 30), (4, 11), (1, 1)]
