"""Files beside a result layer: what is too large for a layer, or has a format of its own.

A run keeps them in a folder of its own, NAME.files/1f2e3d4c beside NAME.usdc, which the layer names (custom data) from its
first byte on and by which it names each file, relative to itself. So they need no other name when the growing layer gets its
own, or is put aside for recovery. They go when a run replaces that layer, unless the folder has another result's name, or a
layer beside it still refers to it (a copy of the result does). A file is there whole or not at all.
"""

import math
import os
import re
import secrets
import shutil
from collections.abc import Callable
from contextlib import suppress
from typing import BinaryIO

from pxr import Sdf, Tf

from wsim.usd.result import atomic, crate
from wsim.usd.result.kinds.siblings import KEY, is_referenced_by_sibling

ROUND = 1e-6                    # of a time code that a sample may lie before its frame
FOLDER = re.compile(r"[^/\\]+\.files/[0-9a-f]{8}\Z")


class SidecarFiles:
    """Files of the run that writes the result `final`. folder: of them, relative to the layer's; made with the first one."""

    def __init__(self, final: str):
        self.final = os.path.abspath(final)
        self.place = os.path.dirname(self.final)
        self.folder = f"{files_folder_name(final)}/{secrets.token_hex(4)}"
        self.counts: dict[str, int] = {}          # files of each name and ending that are no frame's: part of their names
        self.owners: dict[str, str] = {}          # {prim path: name of the sequence of its files}
        self.taken: dict[str, str] = {}           # {file of an earlier run: what it is here}
        self.written: list[str] = []              # and not yet sure to stay, see `undo`
        self.old: list[str] = []                  # that the layer, once saved, does not name any more
        self.restart: dict[str, str] = {}         # {prim path: file of its restart fields}

    def write(self, name: str, suffix: str, write: bytes | Callable[[BinaryIO], object]) -> str:
        """A new file NAME.0001.SUFFIX, and so on; returns its path relative to the layer. write: its bytes, or what writes them
        into an open file. Raises OSError where it cannot be."""
        self.counts[name + suffix] = self.counts.get(name + suffix, 0) + 1
        return self._write(f"{name}.{self.counts[name + suffix]:04d}{suffix}", write)

    def write_frame(self, prim: str, code: float, suffix: str, write: Callable[[BinaryIO], object]) -> str:
        """The file of a prim at a time code, as `write` has it: NAME.0012.SUFFIX of frame 12, whatever frames came before."""
        return self._write(self._frame(prim, code, suffix), write)

    def _write(self, name: str, write: bytes | Callable[[BinaryIO], object]) -> str:
        target = os.path.join(self.place, self.folder, name)
        try:
            os.makedirs(os.path.dirname(target), exist_ok=True)
            with atomic.replace_file_atomically(target) as temporary, open(temporary, "xb") as file:
                if isinstance(write, bytes):
                    file.write(write)
                else:
                    write(file)
        except OSError as error:
            raise type(error)(f"{target} could not be written: {error.strerror or error}. Free space, or write elsewhere with "
                              "-o") from None
        return self._named(target)

    def take(self, source: str, prim: str, code: float) -> str:
        """The file of an earlier run, of a prim at a time code, as one of this run: linked where the file system can, else
        copied; the same each time."""
        if source in self.taken:
            return self.taken[source]
        target = os.path.join(self.place, self.folder, self._frame(prim, code, os.path.splitext(source)[1]))
        os.makedirs(os.path.dirname(target), exist_ok=True)
        try:
            os.link(source, target)
        except OSError:
            with atomic.replace_file_atomically(target) as temporary:
                shutil.copyfile(source, temporary)
        self.taken[source] = self._named(target)
        return self.taken[source]

    def _frame(self, prim: str, code: float, suffix: str) -> str:
        """Name of the file of a prim at a time code: its whole part as four digits, then the rest (motion blur)."""
        own = prim.rsplit("/", 1)[-1]
        if prim not in self.owners:
            k = sum(name.split("~")[0] == own for name in self.owners.values())
            self.owners[prim] = own if k == 0 else f"{own}~{k + 1}"
        whole = math.floor(code + ROUND)
        rest = f"{max(code - whole, 0.0):.6f}".rstrip("0")[2:]
        self.counts["frames"] = self.counts.get("frames", 0) + 1
        return f"{self.owners[prim]}.{whole:04d}{'.' + rest if rest else ''}{suffix}"

    def _named(self, target: str) -> str:
        name = f"./{self.folder}/{os.path.basename(target)}"
        self.written.append(name)
        return name

    def undo(self) -> None:
        """Removes what was written since `saved` or `keep`: the layer does not name it."""
        for name in self.written:
            self._remove_sidecar_file(name)
        self.written = []

    def keep(self) -> None:
        """Marks what was written since as belonging to a sample of the layer."""
        self.written = []

    def saved(self) -> None:
        """Removes what the layer, as it is on the disk now, does not name any more, unless a copy of it does."""
        if self.old and not is_referenced_by_sibling(self.place, self.folder):
            for name in self.old:
                self._remove_sidecar_file(name)
        self.old = []

    def forget_empty(self, layer: Sdf.Layer, whole: bool) -> None:
        """A layer that is whole names no folder where no file was written."""
        if whole and not self.counts:
            layer.customLayerData = {key: value for key, value in layer.customLayerData.items() if key != KEY}

    def _remove_sidecar_file(self, name: str) -> None:
        with suppress(OSError):
            os.remove(os.path.join(self.place, name))

    def discard(self) -> None:
        """All of them go, with their folder."""
        remove_result_folder(self.final, self.folder)


def remove_result_folder(final: str, folder: str) -> None:
    """Removes a folder that an earlier layer of the result `final` named as its own. It stays where it has not that result's
    name, where a layer beside it refers to it, and where it or the folder above is a link."""
    place = os.path.dirname(final)
    path = os.path.join(place, folder)
    own = os.path.dirname(folder) == files_folder_name(final)
    if not own or not FOLDER.match(folder) or not os.path.isdir(path) or os.path.islink(path) or os.path.islink(
            os.path.dirname(path)) or is_referenced_by_sibling(place, folder):
        return
    shutil.rmtree(path, ignore_errors=True)
    with suppress(OSError):
        os.rmdir(os.path.dirname(path))


def files_folder_name(final: str) -> str:
    """Name of the folder, beside the result `final`, in which each run to it has a folder of files."""
    return os.path.splitext(os.path.basename(final))[0] + ".files"


def owned_result_folder(path: str, final: str) -> str:
    """The folder that the layer file `path`, made by a run of the result `final`, names as its own; "" if none."""
    if not os.path.isdir(os.path.join(os.path.dirname(final), files_folder_name(final))) or not os.path.lexists(path):
        return ""
    try:
        layer = Sdf.Layer.OpenAsAnonymous(path, True)
    except Tf.ErrorException:
        return ""
    return str(layer.customLayerData.get(KEY, "")) if layer and crate.is_wsim_result(layer) else ""
