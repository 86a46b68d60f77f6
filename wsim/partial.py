"""A layer file that grows frame by frame beside its final name and takes that name only when it is whole.

`out.usdc` is written as `out.partial.usdc` (always crate: saving what is new costs no more than its bytes) and renamed
when it is finished. A kill leaves the partial file with every frame saved so far.

Saving a crate in place writes new values over its old index (the sections from the first one on, and the offset in the
header; values are never moved). A kill in the middle, or a full disk, would leave neither index. So the index, a few
kilobytes, is copied to `out.partial.usdc.index` before each save and removed after it; whoever finds that copy puts it
back and has the file as it was before that save. (Crate layout: OpenUSD, pxr/usd/sdf/crateFile.h, _BootStrap and
_TableOfContents.)
"""

import os
import struct
from time import perf_counter
from typing import Any

from pxr import Sdf, Tf

from wsim.usd.stage import reason

ENDINGS = (".usdc", ".usda", ".usd")
SHARE = 0.05           # of the wall time may go into saving; 0 saves only at the end, 1 after every frame
HEADER = 88            # bytes of a crate's bootstrap: magic (8), version (8), where the table of contents is (8), spare


def partial_path(path: str) -> str:
    """Name under which the result `path` is written until it is whole."""
    return os.path.splitext(path)[0] + ".partial.usdc"


def whole_path(path: str) -> str:
    """Name under which an export of the result `path` is written until it is whole."""
    stem, ending = os.path.splitext(path)
    return stem + ".whole" + (".usda" if ending == ".usda" else ".usdc")


def index(path: str) -> tuple[int, bytes, bytes]:
    """(offset of the first section, header, everything from that offset on) of a crate file."""
    with open(path, "rb") as file:
        header = file.read(HEADER)
        if header[:8] != b"PXR-USDC":
            raise OSError(f"{path} is not a usdc file")
        file.seek(struct.unpack_from("<q", header, 16)[0])
        sections = struct.unpack("<Q", file.read(8))[0]
        starts = [struct.unpack_from("<16sqq", file.read(32))[1] for _ in range(sections)]
        file.seek(min(starts))
        return min(starts), header, file.read()


def keep_index(path: str) -> None:
    """Copies the index aside, whole or not at all."""
    start, header, tail = index(path)
    with open(path + ".index~", "wb") as file:
        file.write(struct.pack("<q", start) + header + tail)
    os.replace(path + ".index~", path + ".index")


def put_index_back(path: str) -> bool:
    """Undoes a save that did not end; whether there was one. Needs no new space on the disk."""
    _remove(path + ".index~")
    if not os.path.exists(path + ".index"):
        return False
    with open(path + ".index", "rb") as file:
        start = struct.unpack("<q", file.read(8))[0]
        header, tail = file.read(HEADER), file.read()
    with open(path, "r+b") as file:
        file.write(header)
        file.seek(start)
        file.write(tail)
        file.truncate()
    _remove(path + ".index")
    return True


def recover(path: str) -> str | None:
    """Puts aside what a killed run left of the result `path`; returns the file with its frames, None if there is none.

    That file is a complete result layer (`NAME.recovered.usdc`): it can be viewed, and a run can be restarted from it.
    """
    partial = partial_path(path)
    put_index_back(partial)
    _remove(whole_path(path))
    if not os.path.exists(partial):
        return None
    if not _frames(partial):
        _remove(partial)
        return None
    stem, k = os.path.splitext(path)[0], 1
    while os.path.exists(kept := f"{stem}.recovered{'' if k == 1 else k}.usdc"):
        k += 1
    os.replace(partial, kept)
    return kept


def _frames(path: str) -> bool:
    """Whether the layer holds any time sample; True too if it cannot be read: nothing unknown is thrown away."""
    try:
        return bool(Sdf.Layer.OpenAsAnonymous(path).ListAllTimeSamples())
    except Tf.ErrorException:
        return True


def _remove(path: str) -> None:
    if os.path.exists(path):
        os.remove(path)


def check_output(path: str) -> str:
    """The absolute output path. Raises ValueError for another ending, OSError where no file can be written."""
    if not str(path).endswith(ENDINGS):
        raise ValueError(f"{path}: a result is written as {', '.join(ENDINGS)}; give it one of these endings")
    path = os.path.abspath(path)
    folder = os.path.dirname(path)
    if not os.path.isdir(folder):
        raise FileNotFoundError(f"{path}: the folder {folder} is not there; make it, or write elsewhere")
    if os.path.isdir(path):
        raise IsADirectoryError(f"{path} is a folder; give the name of a file")
    if not os.access(folder, os.W_OK) or (os.path.exists(path) and not os.access(path, os.W_OK)):
        raise PermissionError(f"{path} cannot be written (no permission); write elsewhere with -o")
    return path


class Partial:
    """The growing file. `layer` takes the opinions; `save` keeps them; `finish` gives the file its name.

    Raises OSError, with the path and the mend, where the folder or the disk does not take it.
    """

    def __init__(self, path: str):
        self.final, self.path = path, partial_path(path)
        if Sdf.Layer.Find(self.path):
            raise OSError(f"{path} is being written by another Recorder of this process; close that one first")
        self.cost = 0.0                   # [s] of the last save
        self.saved = float("-inf")        # [s] when it ended
        self.good = True                  # the file on the disk and the layer hold the same or the layer holds more
        try:
            self.layer: Any = Sdf.Layer.CreateNew(self.path)
        except (Tf.ErrorException, OSError) as error:
            raise _failure(self.path, error) from None

    def due(self) -> bool:
        """Whether a save now keeps saving within its share of the wall time."""
        return self.good and perf_counter() - self.saved >= self.cost * (1.0 / SHARE - 1.0)

    def save(self) -> None:
        """What the layer holds is on the disk when this returns, whatever kills the process later."""
        began = perf_counter()
        try:
            keep_index(self.path)
            if not self.layer.Save():
                raise OSError("USD refused to save it")
            _remove(self.path + ".index")
        except (Tf.ErrorException, OSError) as error:
            self.good = False
            put_index_back(self.path)
            raise _failure(self.path, error, "; the frames saved so far are in that file") from None
        self.saved = perf_counter()
        self.cost = self.saved - began

    def finish(self, flat=None) -> None:
        """The final file: the partial one renamed, or (`flat` a layer, or another format) exported whole and renamed.

        The caller must have let go of every stage and prim of the layer.
        """
        if flat is None and self.final.endswith(".usda"):
            flat = self.layer
        if flat is None:
            self.layer = None
            os.replace(self.path, self.final)
        else:
            self._export(flat)
            self.discard()
        stale = Sdf.Layer.Find(self.final)
        if stale:
            stale.Reload(True)

    def _export(self, layer) -> None:
        whole = whole_path(self.final)
        try:
            if not layer.Export(whole):
                raise OSError("USD refused to write it")
            os.replace(whole, self.final)
        except (Tf.ErrorException, OSError) as error:
            _remove(whole)
            raise _failure(self.final, error, f"; the frames are kept in {self.path}") from None

    def discard(self) -> None:
        self.layer = None
        for path in (self.path, self.path + ".index", self.path + ".index~"):
            _remove(path)


def _failure(path: str, error: Exception, more: str = "") -> OSError:
    """A write error in one line: the cause that the system named, without USD's call stack."""
    text = reason(error)
    for cause in ("No space left on device", "File too large", "Permission denied", "Read-only file system",
                  "Disk quota exceeded", "Input/output error"):
        if cause in str(error):
            text = cause
    return OSError(f"{path} could not be written: {text[:300]}{more}. Free space, or write elsewhere "
                   "with -o")
