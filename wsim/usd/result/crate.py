"""A crate (usdc) file that grows: what makes a save in place undone, and what lets others read the file meanwhile.

Saving a crate in place writes new values over its old index (the sections from the first one on, and the offset in the
header; values are never moved). A kill in the middle, or a full disk, would leave neither index. So the index, a few
kilobytes, is copied to NAME.index before each save and removed after it. The writer's next run puts that copy back and has the
file as it was before that save; a reader never writes: it puts the copy into a private copy of the file. (Crate layout:
OpenUSD, pxr/usd/sdf/crateFile.h, _BootStrap and _TableOfContents.)

Only a copy that fits is put back: it begins with MAGIC, its checksum is right, and so is that of the values before the index.
"""

import os
import stat
import struct
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import BinaryIO
from zlib import crc32

from pxr import Sdf

from wsim.usd.result.atomic import replace_bytes

CRATE, MAGIC = b"PXR-USDC", b"wsim index 1\n"
PARTIAL, INDEX, LOCK = ".partial.usdc", ".index", ".lock"     # endings: of a growing file; and beside it, while it grows
MADE = "wsim:recorder"     # custom data of every layer that a run has written
HEADER = 88                # bytes of a crate's bootstrap: magic (8), version (8), where the table of contents is (8), spare
BEFORE = 4096              # bytes before the index that show whose it is
FORMAT = "<QQII"           # offset and length of the index; checksums of header and index, and of the values before it
CHUNK = 1 << 22            # bytes copied at once
TRIES, PAUSE = 50, 0.02    # [s] a reader waits for a save that comes between


@dataclass(frozen=True)
class CrateIndex:
    """Offset of the first section, header, everything from that offset on, and the checksum of what is before it."""

    start: int
    header: bytes
    tail: bytes
    before: int

    @staticmethod
    def of(file: BinaryIO) -> "CrateIndex":
        """Index of a crate file. Raises OSError where it is none, or none that is whole."""
        size = os.fstat(file.fileno()).st_size
        file.seek(0)
        header = file.read(HEADER)
        if len(header) < HEADER or header[:8] != CRATE:
            raise OSError("it is not a usdc file")
        contents = struct.unpack_from("<q", header, 16)[0]
        if not HEADER <= contents <= size - 8:
            raise OSError("it is no whole usdc file")
        file.seek(contents)
        sections = struct.unpack("<Q", file.read(8))[0]
        if not 0 < sections <= (size - contents - 8) // 32:
            raise OSError("it is no whole usdc file")
        start = min(struct.unpack_from("<16sqq", file.read(32))[1] for _ in range(sections))
        if not HEADER <= start <= contents:
            raise OSError("it is no whole usdc file")
        before = _crate_checksum(file, start)
        file.seek(start)
        return CrateIndex(start, header, file.read(), before)

    @staticmethod
    def kept(path: str) -> "CrateIndex | None":
        """Index that was copied aside for a crate file; None where there is none that this module wrote, or a link."""
        with suppress(OSError, struct.error), _open_regular_file(path + INDEX, os.O_RDONLY) as file:
            if file.read(len(MAGIC)) != MAGIC:
                return None
            start, length, check, before = struct.unpack(FORMAT, file.read(struct.calcsize(FORMAT)))
            header, tail = file.read(HEADER), file.read()
            if len(tail) == length and crc32(header + tail) == check and header[:8] == CRATE and start >= HEADER:
                return CrateIndex(start, header, tail, before)
        return None

    def keep(self, path: str) -> None:
        """Copies it aside, whole or not at all."""
        head = struct.pack(FORMAT, self.start, len(self.tail), crc32(self.header + self.tail), self.before)
        replace_bytes(path + INDEX, MAGIC + head + self.header + self.tail)

    def fits(self, file: BinaryIO) -> bool:
        """True if the values before it are those of this file."""
        file.seek(0)
        return (file.read(8) == CRATE and os.fstat(file.fileno()).st_size >= self.start
                and _crate_checksum(file, self.start) == self.before)


def _crate_checksum(file: BinaryIO, start: int) -> int:
    first = max(HEADER, start - BEFORE)
    file.seek(first)
    return crc32(file.read(start - first))


@contextmanager
def _open_regular_file(path: str, flags: int) -> Iterator[BinaryIO]:
    """A file of one name, opened without following a link. Raises OSError for all else."""
    handle = os.open(path, flags | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    with os.fdopen(handle, "rb" if flags == os.O_RDONLY else "r+b") as file:
        found = os.fstat(handle)
        if not stat.S_ISREG(found.st_mode) or found.st_nlink > 1:
            raise OSError(f"{path} is no file of one name")
        yield file


def copy_crate_index(path: str) -> None:
    """Copies the index of a crate file aside before it is saved."""
    with open(path, "rb") as file:
        CrateIndex.of(file).keep(path)


def undo_unfinished_save(path: str) -> bool:
    """Undoes a save that did not end; whether there was one. Only for who alone may write the file. Needs no new space on the
    disk. Raises FileExistsError where the copy is not of this file, or either is a link."""
    if not os.path.lexists(path + INDEX):
        return False
    kept = CrateIndex.kept(path)
    if kept and os.path.lexists(path):
        try:
            with _open_regular_file(path, os.O_RDWR) as file:
                kept = kept if kept.fits(file) else None
                if kept:
                    file.seek(0)
                    file.write(kept.header)
                    file.seek(kept.start)
                    file.write(kept.tail)
                    file.truncate()
        except OSError as error:
            raise FileExistsError(f"{path} cannot be brought back from {path + INDEX} ({error.strerror or error}). Move both "
                                  "away, or choose another output") from None
    if not kept:
        raise FileExistsError(f"{path + INDEX} is in the way: it is no copy that wsim made of the index of {path}. Move it "
                              "away, or choose another output")
    os.remove(path + INDEX)
    return True


# Reading

def is_being_written(path: str) -> bool:
    """True if a file is written now, or its writer was killed: then only `read_crate_layer` reads it safely."""
    return os.path.lexists(path + LOCK) or os.path.lexists(path + INDEX)


def is_wsim_result(layer: Sdf.Layer) -> bool:
    """True if a run has written the layer."""
    return MADE in layer.customLayerData


def read_crate_layer(path) -> Sdf.Layer:
    """The layer of a file that a run writes or wrote, as it was after some save; nothing is written to it or beside it.

    It is anonymous, so that neither the writer of this process nor what USD knows of the path has a part in it; its sublayers
    are found as from the file. Raises OSError where none could be read, Tf.ErrorException where it is no USD file.
    """
    path = os.path.realpath(path)
    for _ in range(TRIES):
        grows = is_being_written(path)
        layer = _read_private_copy(path) if grows else Sdf.Layer.OpenAsAnonymous(path)
        if layer and (grows or not is_being_written(path)):
            _absolutize_sublayers(layer, os.path.dirname(path))
            return layer
        time.sleep(PAUSE)
    raise OSError(f"{path} is being written just now and could not be read; try again, or wait until the run ends")


def _read_private_copy(path: str) -> Sdf.Layer | None:
    """The layer of a private copy; None if a save came between. Values are never moved, so that those of an index stay."""
    with open(path, "rb") as file, tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        index = _current_crate_index(path, file)
        if index is None:
            return None
        copy = os.path.join(folder, "layer.usdc")
        with open(copy, "wb") as out:
            out.write(index.header)
            file.seek(HEADER)
            while (left := index.start - out.tell()) > 0:
                data = file.read(min(left, CHUNK))
                if not data:
                    return None
                out.write(data)
            out.write(index.tail)
        return Sdf.Layer.OpenAsAnonymous(copy)               # stays open when the copy has no name any more


def _current_crate_index(path: str, file: BinaryIO) -> CrateIndex | None:
    """An index that the values of the file belong to: that before the save under way, else its own; None in between."""
    kept = CrateIndex.kept(path)
    if kept and kept.fits(file):
        return kept
    before = os.fstat(file.fileno())
    try:
        index = CrateIndex.of(file)
    except (OSError, struct.error):
        return None
    after, kept = os.fstat(file.fileno()), CrateIndex.kept(path)
    still = (before.st_size, before.st_mtime_ns) == (after.st_size, after.st_mtime_ns)
    return index if still and not (kept and kept.fits(file)) else None


def _absolutize_sublayers(layer: Sdf.Layer, folder: str) -> None:
    """Sublayers by absolute paths: an anonymous layer has no place."""
    layer.subLayerPaths[:] = [os.path.normpath(os.path.join(folder, p)) if p.startswith(("./", "../")) else p
                              for p in layer.subLayerPaths]
