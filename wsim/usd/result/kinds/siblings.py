"""Layers beside a result: whether one of them still refers to a file or folder that a run is about to remove.

Such a layer may be a copy, a hard link or an older name of a result, a layer that a user wrote over it, or one that names a
volume itself. Of a crate the custom data and the asset paths are read, not the values; a text layer is searched for the name,
so that one of a gigabyte is not parsed. A layer that cannot be read counts as one that refers: nobody knows what it would lose.
"""

import mmap
import os
from typing import BinaryIO

from pxr import Sdf, Tf, UsdUtils

from wsim.usd.result import crate

KEY = "wsim:files"              # custom data of a layer: the folder of its files
ENDINGS = (".usdc", ".usda", ".usd")


def is_referenced_by_sibling(place: str, name: str, growing: bool = False) -> bool:
    """True if a layer in the folder `place` refers to `name`, a file or folder there (a path relative to `place`; that of a
    folder may end in /).

    growing    what the growing file of a run counts as: it names no files but its own, and is not read while it is written
    """
    layers = [entry.path for entry in os.scandir(place) if entry.name.endswith(ENDINGS) and entry.is_file()]
    return any(growing if crate.is_being_written(layer) else _layer_references_name(layer, place, name) for layer in layers)


def _layer_references_name(layer: str, place: str, name: str) -> bool:
    try:
        with open(layer, "rb") as file:
            if file.read(len(crate.CRATE)) != crate.CRATE:
                return _file_contains_text(file, name.encode())
        target = os.path.realpath(os.path.join(place, name))
        found = [os.path.realpath(os.path.join(place, each)) for each in layer_asset_paths(layer)]
        return any(each == target or each.startswith(target + os.sep) for each in found)
    except (Tf.ErrorException, OSError):
        return True


def _file_contains_text(file: BinaryIO, text: bytes) -> bool:
    if os.fstat(file.fileno()).st_size == 0:
        return False
    with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        return data.find(text) >= 0


def layer_asset_paths(path: str) -> list[str]:
    """Paths that a layer names: sublayers, references, clips, asset values and samples, and the folder of its files. Raises
    OSError or Tf.ErrorException where it cannot be read."""
    layer, found = Sdf.Layer.OpenAsAnonymous(path), list[str]()
    if not layer:
        raise OSError(f"{path} is no layer")

    def note_asset_path(name: str) -> str:
        found.append(name)
        return name

    UsdUtils.ModifyAssetPaths(layer, note_asset_path)
    return [*found, *filter(None, [str(layer.customLayerData.get(KEY, ""))])]
