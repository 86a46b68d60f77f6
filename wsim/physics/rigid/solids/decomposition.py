"""Convex parts of a mesh, by coacd, and a cache of them. NumPy only. (Wei, Liu, Ling, Su 2022, Approximate convex decomposition
for 3D meshes with collision-aware concavity and tree search.)

coacd is an extra (`pip install wsim[decompose]`): 2.7 MB that need NumPy alone. Parts are kept in this user's place for caches,
beside those of benches, under a digest of points, triangles and settings, and in memory. XDG_CACHE_HOME or WSIM_PARTS names
another folder. A file there that is not whole is made anew.
"""

import hashlib
import os
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from wsim.geometry.memo import digest_of_arguments
from wsim.physics.rigid.mass import MOST

FORMAT = 1
THRESHOLD = 0.05           # concavity that a part may have, of the mesh scaled to 2 across: coacd's own
INSTALL = "pip install wsim[decompose]"
kept: dict[bytes, list] = {}


class NoParts(ValueError):
    """A mesh could not be decomposed; the message says why."""


@cache
def coacd_is_installed() -> bool:
    return find_spec("coacd") is not None


def parts_folder() -> Path:
    """Folder of this user's parts."""
    if named := os.environ.get("WSIM_PARTS"):
        return Path(named)
    base = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(base) if os.path.isabs(base) else Path.home() / ".cache") / "wsim" / "parts"


def convex_parts(points: np.ndarray, triangles: np.ndarray) -> list[np.ndarray]:
    """Vertices (n, 3) [m] of the convex parts of a mesh. Raises NoParts where coacd finds none; asks for coacd alone if parts
    are not known."""
    key = digest_of_arguments(FORMAT, THRESHOLD, MOST, np.asarray(points, np.float32), np.asarray(triangles, np.int32))
    if key not in kept:
        try:
            place = parts_folder() / f"{hashlib.sha256(key).hexdigest()}.npz"
        except RuntimeError:                                        # no home folder
            place = None
        found = _read_parts(place) if place else None
        if found is None:
            found = _run_coacd(points, triangles)
            if place:
                _write_parts(place, found)
        kept[key] = found
    return kept[key]


def _run_coacd(points: np.ndarray, triangles: np.ndarray) -> list[np.ndarray]:
    import coacd
    coacd.set_log_level("error")
    low, high = points.min(axis=0), points.max(axis=0)
    size = float((high - low).max())
    try:
        mesh = coacd.Mesh((points - low) / size, np.asarray(triangles, np.int32))         # its tolerances know no unit
        found = coacd.run_coacd(mesh, threshold=THRESHOLD, seed=0, decimate=True, max_ch_vertex=MOST)
    except Exception as error:                     # of a library in C++, any
        raise NoParts(f"coacd says {str(error).splitlines()[0][:120] if str(error) else type(error).__name__}") from None
    return [np.asarray(vertices) * size + low for vertices, _ in found if len(vertices) > 3]


def _read_parts(place: Path) -> list[np.ndarray] | None:
    try:
        with np.load(place, allow_pickle=False) as data:
            return np.split(data["points"], data["ends"])
    except (OSError, ValueError, KeyError, EOFError, BadZipFile):
        return None


def _write_parts(place: Path, found: list[Any]) -> None:
    """Whole or not at all; a cache that cannot be written is none."""
    whole = place.with_name(f"{place.stem}.{os.getpid()}.tmp.npz")
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        np.savez(whole, points=np.concatenate([np.zeros((0, 3)), *found]), ends=np.cumsum([len(part) for part in found])[:-1])
        os.replace(whole, place)
    except OSError:
        whole.unlink(missing_ok=True)
