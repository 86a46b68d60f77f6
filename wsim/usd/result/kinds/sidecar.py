"""Restart fields of large prims, in a file beside the layer: a crate keeps what was overwritten, such a file does not.

    string wsim:restart:file     the file (numpy's .npz, not compressed), relative to the layer

The file holds the fields bit for bit, the prim's path and the time code; zip's checksums tell damage. A new one is written
under a new name, then the layer is saved, then the one before is removed: whatever kills the run, the layer names a whole file.
"""

import os
import zipfile
from collections.abc import Mapping
from typing import Any

import numpy as np
from pxr import Sdf, Usd

from wsim.scene import Problem, SceneError
from wsim.usd.result.kinds.beside import SidecarFiles

LARGE = 4 << 20             # bytes of a prim's fields from which they have a file: less is saved sooner than a file is made
FILE = "wsim:restart:file"
PATH, CODE, FIELD = "path", "code", "field."


def exceeds_layer_size(fields: Mapping[str, np.ndarray]) -> bool:
    return sum(value.nbytes for value in fields.values()) > LARGE


def store_restart_file(prim: Usd.Prim, code: float, fields: Mapping[str, np.ndarray], beside: SidecarFiles) -> None:
    """Writes the fields of a prim and names the file on it. Raises OSError where it cannot be written."""
    path = str(prim.GetPath())
    arrays: dict[str, Any] = {FIELD + name: value for name, value in fields.items()}
    arrays |= {PATH: np.array(path), CODE: np.array(float(code))}
    name = beside.write("restart", ".npz", lambda file: np.savez(file, **arrays))
    if path in beside.restart:
        beside.old.append(beside.restart[path])
    beside.restart[path] = name
    beside.keep()
    prim.CreateAttribute(FILE, Sdf.ValueTypeNames.String, True).Set(name)


def forget_restart_file(prim: Usd.Prim, beside: SidecarFiles) -> None:
    """The fields of a prim have no file any more."""
    if name := beside.restart.pop(str(prim.GetPath()), None):
        beside.old.append(name)
        prim.RemoveProperty(FILE)


def read_restart_file(prim: Usd.Prim, code: float, folder: str) -> dict[str, np.ndarray]:
    """Fields of a prim at a time code, of a layer in `folder`; {} where they have no file. Raises SceneError where it is
    missing, damaged, or of something else."""
    name = prim.GetAttribute(FILE).Get() if prim.HasAttribute(FILE) else None
    if not name:
        return {}
    path, file = str(prim.GetPath()), os.path.normpath(os.path.join(folder, name))
    try:
        with np.load(file, allow_pickle=False) as found:
            whose, when = str(found[PATH]), float(found[CODE])
            fields = {key.removeprefix(FIELD): found[key] for key in found.files if key.startswith(FIELD)}
    except FileNotFoundError:
        raise _unreadable_restart_error(path, file, "is missing") from None
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise _unreadable_restart_error(path, file, f"is damaged ({error})") from None
    if (whose, when) != (path, code):
        raise _unreadable_restart_error(path, file, f"is of {whose} at time code {when:g}, not {code:g}")
    return fields


def _unreadable_restart_error(path: str, file: str, why: str) -> SceneError:
    return SceneError(Problem(path, f"its restart fields are in {file}, which {why}; put back the one that was written with "
                                    "the result, or restart from another result"))
