"""PNG, APNG and GIF files hold exactly the pixels that were given: read back by decoders written from the formats."""

import struct
import zlib

import numpy as np
import pytest

from wsim.show import gif, png


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
    found = dict(chunks(png.still(image)))
    assert struct.unpack(">IIBBBBB", found[b"IHDR"]) == (w, h, 8, 2, 0, 0, 0)
    np.testing.assert_array_equal(unfiltered(found[b"IDAT"], w, h), image)


def test_an_animation_comes_back_exactly_and_stores_only_what_changed():
    frames = [pattern(20, 30) for _ in range(4)]
    frames[1][3:7, 4:15] = 200
    frames[2][:] = frames[1]
    frames[3][:] = pattern(20, 30, seed=1)
    canvas, shown, sizes, number, control = None, [], [], 0, None
    for kind, body in chunks(png.animation(frames, 24.0)):
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


def unpacked(data: bytes) -> list[int]:
    """Values of a GIF's LZW stream with 8-bit values (GIF89a, appendix F)."""
    bits = np.unpackbits(np.frombuffer(data, np.uint8), bitorder="little")
    at, width, out = 0, 9, []
    table: list[bytes] = []
    before = None
    while True:
        code = int(bits[at:at + width] @ (1 << np.arange(width)))
        at += width
        if code == 257:
            assert len(bits) - at < 8, "data after the end code"
            return out
        if code == 256:
            table, width, before = [bytes([k]) for k in range(256)] + [b"", b""], 9, None
            continue
        assert code < len(table) or (before is not None and code == len(table))
        entry = table[code] if code < len(table) else before + before[:1]
        out += entry
        if before is not None and len(table) < 4096:
            table.append(before + entry[:1])
        if len(table) == 1 << width and width < 12:
            width += 1
        before = entry


@pytest.mark.parametrize("values", [
    np.zeros(1), np.zeros(5000), np.arange(256), np.random.default_rng(1).integers(0, 256, 20000),
    np.random.default_rng(2).integers(0, 3, 30000), np.arange(9000) // 7 % 251,
], ids=["one", "flat", "each", "noise fills the table", "few", "runs"])
def test_lzw_comes_back_exactly(values):
    assert unpacked(gif.lzw(values.astype(np.uint8))) == values.astype(int).tolist()


@pytest.mark.parametrize("count", range(250, 262))
def test_lzw_ends_well_where_the_code_width_changes(count):
    """The 255th code is the first that makes a table of 512: the end code may need one bit more."""
    values = np.random.default_rng(3).permutation(np.repeat(np.arange(256), 2))[:count]
    assert unpacked(gif.lzw(values.astype(np.uint8))) == values.tolist()


def gif_frames(data: bytes):
    """(delay [1/100 s], image (h, w, 3)) of each frame, composed."""
    width, height = struct.unpack_from("<HH", data, 6)
    table = np.frombuffer(data, np.uint8, 768, 13).reshape(256, 3)
    at, canvas, delay = 13 + 768, np.zeros((height, width, 3), np.uint8), 0
    while data[at] != 0x3B:
        extension = data[at] == 0x21
        if extension and data[at + 1] == 0xF9:
            delay = struct.unpack_from("<H", data, at + 4)[0]
            assert data[at + 6] == gif.SAME
        left, top, w, h = struct.unpack_from("<HHHH", data, at + 1)
        at, stream = at + (2 if extension else 11), b""
        while data[at]:
            stream += data[at + 1:at + 1 + data[at]]
            at += 1 + data[at]
        at += 1
        if not extension:
            part = np.array(unpacked(stream)).reshape(h, w)
            canvas = canvas.copy()
            canvas[top:top + h, left:left + w][part != gif.SAME] = table[part[part != gif.SAME]]
            yield delay, canvas


def test_a_gif_shows_every_frame_in_its_colours_and_keeps_time():
    y, x = np.mgrid[:60, :80]
    smooth = np.stack([40 + 2 * x, 60 + 2 * y, 200 - x], axis=-1).astype(np.uint8)
    frames = []
    for k in range(13):
        frame = smooth.copy()
        frame[20:30, 5 * k:5 * k + 12] = (200, 30, 20)
        frames.append(frame)
    found = list(gif_frames(gif.write(frames, 24.0)))
    assert len(found) == 13
    assert sum(delay for delay, _ in found) == round(100 * 13 / 24)
    for (_, shown), frame in zip(found, frames, strict=True):
        # dither (half of 7), the cells of 4 levels of the search, and 255 colours over this slope's 2-D patch of
        # 160 x 120 levels: a spacing of sqrt(160 * 120 / 255) = 9 levels in the plane, half of it each way
        assert np.abs(shown.astype(int) - frame).mean() < 0.5 * gif.DITHER + 2 + 4.5
        local = shown.astype(float)[:16, 64:].mean(axis=(0, 1)) - frame.astype(float)[:16, 64:].mean(axis=(0, 1))
        assert np.abs(local).max() < 4.0                       # dithering keeps means nearer than the spacing


def test_the_palette_holds_few_colours_exactly():
    image = np.zeros((8, 8, 3), np.uint8)
    image[:, 4:] = (201, 33, 17)
    shown = next(gif_frames(gif.write([image], 24.0)))[1]
    assert np.abs(shown.astype(int) - image).max() <= 2        # the middle of a cell of 4 levels
