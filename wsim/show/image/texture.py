"""Textures of preview materials: PNG files of eight bits, looked up where the corners of triangles are.

A texture is seen as finely as its mesh is cut: a triangle blends the colours of its three corners.
"""

import struct
import zlib
from functools import lru_cache

import numpy as np
from pxr import Usd, UsdGeom, UsdShade

CHANNELS = {0: 1, 2: 3, 4: 2, 6: 4}          # of the colour types of PNG that are read


@lru_cache(maxsize=8)
def read_png(path: str) -> np.ndarray:
    """An image of eight bits a channel, not interlaced, (h, w, channels) uint8. Raises ValueError for any other, OSError for a
    file that cannot be read."""
    with open(path, "rb") as file:
        data = file.read()
    if data[:8] != b"\x89PNG\r\n\x1a\n":
        raise ValueError("is no PNG file")
    width, height, depth, kind, _, _, interlaced = struct.unpack(">IIBBBBB", data[16:29])
    if depth != 8 or kind not in CHANNELS or interlaced:
        raise ValueError("is a PNG file with a palette, interlaced, or not of 8 bits")
    parts, at = [], 8
    while at + 12 <= len(data):
        size, name = struct.unpack(">I4s", data[at:at + 8])
        if name == b"IDAT":
            parts.append(data[at + 8:at + 8 + size])
        at += 12 + size
    n = CHANNELS[kind]
    try:
        rows = np.frombuffer(zlib.decompress(b"".join(parts)), np.uint8).reshape(height, 1 + n * width)
    except zlib.error:
        raise ValueError("is a PNG file that is cut or garbled") from None
    return unfilter_rows(rows, n).reshape(height, width, n)


def unfilter_rows(rows: np.ndarray, n: int) -> np.ndarray:
    """Bytes of the rows of a PNG image, whose first byte says how they were filtered; n channels. A pixel needs those to its
    left, above, and above to the left (PNG, 9.2): all of a diagonal are done at once."""
    kinds, raw = rows[:, 0].astype(int), rows[:, 1:].astype(np.int32).reshape(len(rows), -1, n)
    h, w, _ = raw.shape
    done = np.zeros((h + 1, w + 1, n), np.int32)                        # with a margin of zeros above and to the left
    for diagonal in range(h + w - 1):
        y = np.arange(max(0, diagonal - w + 1), min(h, diagonal + 1))
        x = diagonal - y
        left, above, corner = done[y + 1, x], done[y, x + 1], done[y, x]
        by_left, by_above, by_corner = (np.abs(left + above - corner - each) for each in (left, above, corner))
        paeth = np.where((by_left <= by_above) & (by_left <= by_corner), left, np.where(by_above <= by_corner, above, corner))
        guess = np.choose(kinds[y][:, None], [np.zeros_like(left), left, above, (left + above) // 2, paeth])
        done[y + 1, x + 1] = (raw[y, x] + guess) & 255
    return done[1:, 1:].reshape(h, -1).astype(np.uint8)


def texture_of(prim: Usd.Prim) -> tuple[str, str] | None:
    """File of the texture of the bound preview material's diffuse colour, and the primvar of its coordinates; None: none."""
    material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
    shader = material.ComputeSurfaceSource()[0] if material else None
    channel = shader.GetInput("diffuseColor") if shader else None
    sources = channel.GetConnectedSources()[0] if channel else []
    if not sources or UsdShade.Shader(sources[0].source.GetPrim()).GetIdAttr().Get() != "UsdUVTexture":
        return None
    texture = UsdShade.Shader(sources[0].source.GetPrim())
    file, place = texture.GetInput("file"), texture.GetInput("st")
    asset = file.Get() if file else None
    reader = place.GetConnectedSources()[0] if place else []
    name = UsdShade.Shader(reader[0].source.GetPrim()).GetInput("varname") if reader else None
    return (asset.resolvedPath, str(name.Get() or "st") if name else "st") if asset and asset.resolvedPath else None


def corner_colors(prim: Usd.Prim, time: float, triangles: np.ndarray, corners: np.ndarray | None) -> np.ndarray | None:
    """Linear colours of the corners of triangles, (t, 3, 3), by the texture of a prim; None where there is none to read."""
    found = texture_of(prim)
    primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(found[1]) if found else None
    values = primvar.ComputeFlattened(time) if primvar and primvar.HasValue() else None
    if found is None or primvar is None or values is None or corners is None:
        return None
    st, by = np.asarray(values, np.float64)[:, :2], corners if str(primvar.GetInterpolation()) == "faceVarying" else triangles
    if int(by.max(initial=0)) >= len(st):
        return None
    try:
        image = read_png(found[0])
    except (OSError, ValueError):
        return None
    h, w, n = image.shape
    x, y = (st[by] % 1.0).reshape(-1, 2).T
    seen = image[np.minimum(((1.0 - y) * h).astype(int), h - 1), np.minimum((x * w).astype(int), w - 1)]
    seen = (seen[:, :3] if n >= 3 else np.repeat(seen[:, :1], 3, axis=1)) / 255.0
    linear = np.where(seen <= 0.04045, seen / 12.92, ((seen + 0.055) / 1.055) ** 2.4)
    return linear.reshape(*by.shape, 3)
