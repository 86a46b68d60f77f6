"""Grids of an OpenVDB file as dense arrays, for pictures and tests: what `wsim.usd.result.kinds.vdb` writes, and files of other
programs with trees 5-4-3 of float or vec3s, without codec or with zip. NumPy only.

Read are values of leaves and of active tiles of lower nodes; inactive values are the background, 0 where the tree says 0.
"""

import struct
import zlib
from collections.abc import Callable
from typing import Any, BinaryIO

import numpy as np

from wsim.usd.result.kinds.vdb import ACTIVE_MASK, HALF, LOWER, MAGIC, TYPES, UPPER, VdbGrid

ZIP, BLOSC = 1, 4
OLDEST, NEWEST = 222, 225                        # file versions
ALL, MASKED = 6, (3, 4, 5)                       # what is said before the values of a node: all follow; a mask of two values
NUMBERS = {"int32": "<i", "int64": "<q", "float": "<f", "double": "<d", "bool": "<?"}
MAPS = {"UniformScaleTranslateMap": 18, "ScaleTranslateMap": 18, "UniformScaleMap": 15, "ScaleMap": 15, "TranslationMap": 3}
MOST_BYTES = 4 << 30                             # of a dense grid


def read_vdb(path, names: tuple[str, ...] | None = None) -> dict[str, VdbGrid]:
    """Grids of a file by name: all, or those of `names` alone. Values have the shape of the box of what the tree holds, `first`
    is its lowest index. Raises ValueError for a file that is none, is cut, or holds what is not read; OSError."""
    with open(path, "rb") as file:
        try:
            return _VdbReader(file).grids(names)
        except (struct.error, zlib.error, EOFError, UnicodeDecodeError, OverflowError, MemoryError) as error:
            raise ValueError(f"{path} is no whole OpenVDB file ({error or type(error).__name__})") from None
        except ValueError as error:
            raise ValueError(f"{path} {error}") from None


class _VdbReader:
    def __init__(self, file: BinaryIO):
        self.file, self.flags, self.half, self.components = file, 0, False, 1
        self.background = np.zeros(1, np.float32)

    def take(self, form: str) -> Any:
        found = struct.unpack(form, self.bytes(struct.calcsize(form)))
        return found[0] if len(found) == 1 else found

    def bytes(self, count: int) -> bytes:
        data = self.file.read(count) if count >= 0 else b""
        if len(data) != count:
            raise EOFError("it ends early")
        return data

    def text(self) -> str:
        return self.bytes(self.take("<I")).decode()

    def grids(self, names) -> dict[str, VdbGrid]:
        if self.take("<q") != MAGIC:
            raise ValueError("is no OpenVDB file")
        version = self.take("<I")
        if not OLDEST <= version <= NEWEST:
            raise ValueError(f"is of version {version}; read are {OLDEST} to {NEWEST}: save it by a newer OpenVDB")
        self.bytes(8)
        if not self.take("<B"):
            raise ValueError("has no offsets of its grids (a stream)")
        self.bytes(36)
        self.metadata()
        found = {}
        for _ in range(self.take("<I")):
            name, kind, _ = self.text().split("\x1e")[0], self.text(), self.text()
            begin, _, end = self.take("<qqq")
            if names is None or name in names:
                self.file.seek(begin)
                found[name] = self.grid(name, kind)
            self.file.seek(end)
        return found

    def metadata(self) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for _ in range(self.take("<I")):
            name, kind = self.text(), self.text()
            data = self.bytes(self.take("<I"))
            text = data.decode() if kind == "string" else data
            found[name] = struct.unpack(NUMBERS[kind], data)[0] if kind in NUMBERS else text
        return found

    def grid(self, name: str, kind: str) -> VdbGrid:
        self.half, kind = kind.endswith(HALF), kind.removesuffix(HALF)
        if kind not in TYPES.values():
            raise ValueError(f"has the grid {name} of type {kind}; read are {', '.join(TYPES.values())}")
        self.components = next(c for c, known in TYPES.items() if known == kind)
        self.flags = self.take("<I")
        if self.flags & BLOSC:
            raise ValueError(f"has the grid {name} packed by Blosc; save it with zip, or without a codec")
        said = self.metadata()
        place, voxel = self.transform(name)
        values, first = self.tree(name)
        texts = {key: value for key, value in said.items() if isinstance(value, str) and key not in ("class", "name")}
        return VdbGrid(name, values, place, voxel, first, str(said.get("class", "unknown")), texts)

    def transform(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        kind = self.text()
        if kind not in MAPS:
            raise ValueError(f"has the grid {name} with a {kind}; read are grids that are neither turned nor sheared")
        data = np.frombuffer(self.bytes(8 * MAPS[kind]), "<f8")
        place, scale = (data[:3], data[3:6]) if MAPS[kind] == 18 else (np.zeros(3), data[:3])
        return (data, np.ones(3)) if MAPS[kind] == 3 else (place, scale)

    def tree(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Dense values, and the index of the first of them."""
        self.take("<i")
        self.background = np.frombuffer(self.bytes(4 * self.components), "<f4")
        tiles, children = self.take("<II")
        for _ in range(tiles):
            self.bytes(12 + 4 * self.components)
            if self.take("<B"):
                raise ValueError(f"has the grid {name} with an active tile of 4096 voxels")
        origins, filled = [], []
        for _ in range(children):
            for lower in self.node(np.array(self.take("<iii")), UPPER, 7, filled):
                origins += self.node(lower, LOWER, 3, filled, lambda: self.bytes(64))
        boxes = [(o, 8) for o in origins] + [(o, n) for o, n, _ in filled]
        if not boxes:
            return self.shaped(self.empty(np.ones(3, int))), np.zeros(3, int)
        first = np.min([o for o, _ in boxes], axis=0)
        size = np.max([o + n for o, n in boxes], axis=0) - first
        if 4 * self.components * np.prod(size.astype(float)) > MOST_BYTES:
            raise ValueError(f"has the grid {name} of {size[0]} x {size[1]} x {size[2]} voxels, too large to be held dense")
        dense = self.empty(size)
        for origin, n, value in filled:
            dense[tuple(slice(a, a + n) for a in origin - first)] = value
        for origin in origins:
            mask = self.mask(512)
            x, y, z = origin - first
            block = self.values(mask, np.zeros(512, bool)).reshape(8, 8, 8, self.components)
            dense[x:x + 8, y:y + 8, z:z + 8] = block
        return self.shaped(dense), first

    def empty(self, size: np.ndarray) -> np.ndarray:
        return np.full((*size, self.components), self.background, np.float16 if self.half else np.float32)

    def shaped(self, dense: np.ndarray) -> np.ndarray:
        return dense[..., 0] if self.components == 1 else dense

    def node(self, origin: np.ndarray, log: int, below: int, filled: list,
             child: Callable | None = None) -> list[np.ndarray]:
        """Origins of the children of a node, whose own data `child` skips; else each is itself read by the caller in turn."""
        children, active = self.mask(1 << 3 * log), self.mask(1 << 3 * log)
        tiles = self.values(active, children)
        filled += [(origin + self.place(k, log, below), 1 << below, tiles[k]) for k in np.flatnonzero(active).tolist()]
        found = []
        for k in np.flatnonzero(children).tolist():
            found.append(origin + self.place(k, log, below))
            if child:
                child()
        return found

    def place(self, k: int, log: int, below: int) -> np.ndarray:
        n = (1 << log) - 1
        return np.array([k >> 2 * log, k >> log & n, k & n]) << below

    def mask(self, count: int) -> np.ndarray:
        return np.unpackbits(np.frombuffer(self.bytes(count // 8), np.uint8), bitorder="little").astype(bool)

    def values(self, active: np.ndarray, children: np.ndarray) -> np.ndarray:
        """Values of a node (count, components): active ones as stored, others by what is said before them."""
        said = self.take("<B")
        real = np.dtype(np.float16 if self.half else np.float32)
        others = [self.background, -self.background]
        if said in (2, 4, 5):
            others = [self.some(1, np.dtype(np.float32), False)[0], self.background]
            if said == 5:
                others[1] = self.some(1, np.dtype(np.float32), False)[0]
        elif said == 1:
            others = others[::-1]
        second = self.mask(len(active)) if said in MASKED else np.zeros(len(active), bool)
        whole = said == ALL or not self.flags & ACTIVE_MASK
        stored = self.some(len(active) if whole else int(active.sum()), real, True)
        if whole:
            return stored
        found = np.where(second[:, None], others[1], others[0]).astype(real)
        found[active] = stored
        return found

    def some(self, count: int, real: np.dtype, packed: bool) -> np.ndarray:
        size = count * self.components * real.itemsize
        if packed and self.flags & ZIP:
            length = self.take("<q")
            data = zlib.decompress(self.bytes(length)) if length > 0 else self.bytes(-length)
            if len(data) != size:
                raise EOFError("a node holds another number of values than it says")
        else:
            data = self.bytes(size)
        return np.frombuffer(data, real).reshape(count, self.components)
