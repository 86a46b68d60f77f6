"""Grids as an OpenVDB file, version 224: what Blender, Houdini and every program on OpenVDB open. NumPy only.

A grid is a tree of fixed branching (5-4-3): a root, upper nodes of 32^3 children, lower nodes of 16^3, leaves of 8^3 voxels.
Voxels that equal the background 0 are not active; leaves without an active voxel are left out, and of the others the active
values alone are stored (active mask compression; no codec, so that a file is written at the speed of its bytes). Within a node
x varies slowest, and bit k of a mask belongs to child or voxel k. In the file:

    header      magic, version, library, offsets flag, identity, metadata, number of grids
    each grid   name, type, offsets | compression, metadata, transform | masks of all nodes | masks and values of all leaves

(tinyvdb 0.9, of PyPI, reads such files; it makes no grid from nothing, and stores vectors not at all.)

Museth 2013, VDB: High-resolution sparse volumes with dynamic topology, ACM Transactions on Graphics 32(3), section 3; the
layout as OpenVDB 10 writes it.
"""

import hashlib
import struct
import uuid
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import BinaryIO

import numpy as np

MAGIC, VERSION, LIBRARY = 0x56444220, 224, (10, 0)
LEAF, LOWER, UPPER = 3, 4, 5                     # log2 of the edge of a node, in children
MOST = 1 << (LEAF + LOWER + UPPER)               # voxels along an axis
ACTIVE_MASK = 2                                  # compression flag: inactive values are not stored
TYPES = {1: "Tree_float_5_4_3", 3: "Tree_vec3s_5_4_3"}
HALF = "_HalfFloat"                              # ending of the type of a grid whose values are stored as halves
UNIFORM, SCALED = "UniformScaleTranslateMap", "ScaleTranslateMap"
CLASSES = ("fog volume", "staggered", "level set", "unknown")


@dataclass(frozen=True)
class VdbGrid:
    """name; values (nx, ny, nz) or (nx, ny, nz, 3), float32, or float16 to be stored as such; place (3,) of the centre of the
    first voxel and voxel (3,) the edges of one, in the units of the file; first (3,) index of the first voxel; kind: one of
    `CLASSES`; metadata: more of it, texts."""

    name: str
    values: np.ndarray
    place: np.ndarray = field(default_factory=lambda: np.zeros(3))
    voxel: np.ndarray = field(default_factory=lambda: np.ones(3))
    first: np.ndarray = field(default_factory=lambda: np.zeros(3, int))
    kind: str = "fog volume"
    metadata: Mapping[str, str] = field(default_factory=dict)

    @property
    def components(self) -> int:
        return 1 if self.values.ndim == 3 else self.values.shape[3]


def write_vdb(file: BinaryIO, grids: Sequence[VdbGrid]) -> None:
    """Writes grids into an open file. Raises ValueError for one that no such tree can hold."""
    parts: list[bytes] = []
    at = 8 + 4 + 8 + 1 + 36 + 4 + 4              # of the first grid: behind magic, version, library, flag, identity, counts
    for grid in grids:
        found = _encode_vdb_grid(grid, at)
        parts += found
        at += sum(map(len, found))
    digest = hashlib.blake2b(digest_size=16)
    for part in parts:
        digest.update(part)
    file.write(struct.pack("<qIIIB", MAGIC, VERSION, *LIBRARY, 1) + str(uuid.UUID(bytes=digest.digest())).encode())
    file.write(struct.pack("<II", 0, len(grids)))
    for part in parts:
        file.write(part)


def _encode_vdb_grid(grid: VdbGrid, at: int) -> list[bytes]:
    """Bytes of a grid that stands at an offset in the file."""
    _check_vdb_grid(grid)
    leaves, places = _active_leaves(grid)
    head = _encode_vdb_text(grid.name) + _encode_vdb_text(TYPES[grid.components] + HALF
                                                          * (grid.values.dtype == np.float16)) + _encode_vdb_text("")
    active = (leaves != 0).reshape(len(leaves), 512, grid.components).any(2)
    masks = np.packbits(active, axis=1, bitorder="little")
    order, lowers = _group_leaves_by_node(places)
    leaves, active, masks = leaves[order], active[order], masks[order]
    info = struct.pack("<I", ACTIVE_MASK) + _encode_vdb_metadata(grid, active, places[order]) + _encode_vdb_transform(grid)
    tree, values = _encode_vdb_tree(grid, lowers, masks), _encode_leaf_values(leaves, active, masks)
    begin = at + len(head) + 24
    block = begin + len(info) + sum(map(len, tree))
    return [head, struct.pack("<qqq", begin, block, block + len(values)), info, *tree, values]


def _check_vdb_grid(grid: VdbGrid) -> None:
    wrong = None
    if grid.values.ndim not in (3, 4) or grid.components not in TYPES or 0 in grid.values.shape:
        wrong = f"has values of shape {grid.values.shape}; allowed are (nx, ny, nz) and (nx, ny, nz, 3)"
    elif max(grid.values.shape[:3]) > MOST:
        wrong = f"has {max(grid.values.shape[:3])} voxels along an axis; a file holds {MOST}"
    elif grid.values.dtype not in (np.float32, np.float16):
        wrong = f"has values of {grid.values.dtype}; allowed are float32 and float16"
    elif grid.kind not in CLASSES or not all(np.ravel(grid.voxel) > 0.0) or any(np.ravel(grid.first)):
        wrong = f"is of class {grid.kind}, voxel {grid.voxel} and first index {grid.first}; allowed are {CLASSES}, > 0 and 0"
    if wrong:
        raise ValueError(f"grid {grid.name} {wrong}")


def _active_leaves(grid: VdbGrid) -> tuple[np.ndarray, np.ndarray]:
    """Values (leaves, 512 components) of leaves with an active voxel, and their places (leaves, 3) in leaves."""
    shape, c = np.array(grid.values.shape[:3]), grid.components
    blocks = (shape + 7) // 8
    padded = np.zeros((*(8 * blocks), c), grid.values.dtype)
    padded[tuple(slice(n) for n in shape)] = grid.values.reshape(*shape, c)
    x, y, z = blocks
    cut = padded.reshape(x, 8, y, 8, z, 8, c).transpose(0, 2, 4, 1, 3, 5, 6)
    used = np.argwhere(cut.any(axis=(3, 4, 5, 6)))
    return np.ascontiguousarray(cut[tuple(used.T)]).reshape(len(used), 512 * c), used


def _group_leaves_by_node(places: np.ndarray) -> tuple[np.ndarray, list[tuple[int, np.ndarray]]]:
    """Order of leaves by lower node and place in it; (place of the lower node, places of its leaves) in that order."""
    def tree_node_offset(ijk: np.ndarray, log: int) -> np.ndarray:
        return (ijk[:, 0] << 2 * log) + (ijk[:, 1] << log) + ijk[:, 2]

    node, leaf = tree_node_offset(places >> LOWER, UPPER), tree_node_offset(places & 15, LOWER)
    order = np.lexsort((leaf, node))
    found, begin = np.unique(node[order], return_index=True)
    return order, [(int(k), own) for k, own in zip(found, np.split(leaf[order], begin[1:]), strict=False)]


def _encode_child_mask(places, log: int) -> bytes:
    mask = np.zeros(1 << 3 * log, bool)
    mask[places] = True
    return np.packbits(mask, bitorder="little").tobytes()


def _encode_vdb_tree(grid: VdbGrid, lowers: list, masks: np.ndarray) -> list[bytes]:
    """Masks of all nodes. A node: that of its children, of its tiles (none), and 0: all tiles are the background."""
    c = grid.components
    parts = [struct.pack("<i", 1), np.zeros(c, np.float32).tobytes(), struct.pack("<II", 0, int(bool(lowers)))]
    if lowers:
        parts += [struct.pack("<iii", 0, 0, 0), _encode_child_mask([k for k, _ in lowers], UPPER), bytes(4096), b"\0"]
    done = 0
    for _, own in lowers:
        parts += [_encode_child_mask(own, LOWER), bytes(512), b"\0", masks[done:done + len(own)].tobytes()]
        done += len(own)
    return parts


def _encode_leaf_values(leaves: np.ndarray, active: np.ndarray, masks: np.ndarray) -> bytes:
    """Of each leaf its mask, 0 (inactive values are the background), and the active values."""
    if not len(leaves):
        return b""
    raw = leaves.view(np.uint8)
    rows = np.zeros((len(leaves), 65 + raw.shape[1]), np.uint8)
    rows[:, :64], rows[:, 65:] = masks, raw
    if active.all():
        return rows.tobytes()
    keep = np.ones(rows.shape, bool)
    keep[:, 65:] = np.repeat(active, raw.shape[1] // 512, axis=1)
    return rows[keep].tobytes()


def _encode_vdb_text(text: str) -> bytes:
    data = text.encode()
    return struct.pack("<I", len(data)) + data


def _encode_vdb_metadata(grid: VdbGrid, active: np.ndarray, places: np.ndarray) -> bytes:
    low, high = np.zeros(3, int), np.zeros(3, int)
    for axis in range(3) if len(places) else ():
        used = active.reshape(-1, 8, 8, 8).any(axis=tuple(a + 1 for a in range(3) if a != axis))
        index = (8 * places[:, axis, None] + np.arange(8))[used]
        low[axis], high[axis] = index.min(), index.max()
    texts = {"class": grid.kind, "name": grid.name, "file_compression": "active values"} | dict(grid.metadata)
    found = [_encode_vdb_text(name) + _encode_vdb_text("string") + _encode_vdb_text(value) for name, value in texts.items()]
    found += [_encode_vdb_text(f"file_bbox_{end}") + _encode_vdb_text("vec3i") + struct.pack("<Iiii", 12,
                                                                                             *(int(v) for v in corner))
              for end, corner in (("min", low), ("max", high))]
    found.append(_encode_vdb_text("file_voxel_count") + _encode_vdb_text("int64") + struct.pack("<Iq", 8, int(active.sum())))
    if grid.values.dtype == np.float16:
        found.append(_encode_vdb_text("is_saved_as_half_float") + _encode_vdb_text("bool") + struct.pack("<I?", 1, True))
    return struct.pack("<I", len(found)) + b"".join(found)


def _encode_vdb_transform(grid: VdbGrid) -> bytes:
    """Index i stands at place + voxel i. The map keeps what it derives from its scale too."""
    s = np.array(grid.voxel, np.float64)
    rows = [np.array(grid.place, np.float64), s, np.abs(s), 1.0 / s, 1.0 / (s * s), 0.5 / s]
    return _encode_vdb_text(UNIFORM if s[0] == s[1] == s[2] else SCALED) + np.concatenate(rows).astype("<f8").tobytes()
