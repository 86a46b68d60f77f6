"""A layer file that grows frame by frame beside its final name and takes that name only when it is whole.

`out.usdc` is written as `out.partial.usdc` (always crate: saving what is new costs no more than its bytes) and renamed when
it is finished; what was at `out.usdc` stays until then. A kill, Ctrl-C or a failure leaves the partial file with every frame
saved so far. The next run to the same output puts that aside as `out.recovered.usdc`, and back if it comes to no frame.

One run at a time writes a result of a name, whatever its ending (`wsim.usd.result.lock`). Only files that wsim made are moved
or removed: layers that say so (`wsim.usd.result.crate.MADE`), and copies of an index (`wsim.usd.result.crate`).
"""

import os
import re
import stat
from contextlib import suppress
from time import perf_counter
from typing import Any

from pxr import Sdf, Tf

from wsim.usd import clips
from wsim.usd.result import atomic, crate
from wsim.usd.result.kinds import beside
from wsim.usd.result.kinds.siblings import ENDINGS
from wsim.usd.result.lock import OutputLock
from wsim.usd.stage import usd_error_text

CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f]")
SHARE = 0.05           # of the wall time may go into saving; 0 saves only at the end, 1 after every frame


def partial_path(path: str) -> str:
    """Name under which the result `path` is written until it is whole."""
    return os.path.splitext(path)[0] + crate.PARTIAL


def refuse_control_characters(path: str) -> None:
    """Raises ValueError for a path that no layer can name."""
    if control := CONTROL.search(path):
        raise ValueError(f"{path!r} has the control character {control[0]!r}, which no path of USD may have; "
                         "choose another name")


def check_output(path: str) -> str:
    """The absolute output path. Raises ValueError for another ending, OSError where no file can be written."""
    if not str(path).endswith(ENDINGS):
        raise ValueError(f"{path}: a result is written as {', '.join(ENDINGS)}; give it one of these endings")
    if str(path).endswith(crate.PARTIAL):
        raise ValueError(f"{path}: names in {crate.PARTIAL} are kept for results that are not whole; choose another")
    path = os.path.abspath(path)
    refuse_control_characters(path)
    folder = os.path.dirname(path)
    if not os.path.isdir(folder):
        raise FileNotFoundError(f"{path}: the folder {folder} is not there; make it, or write elsewhere")
    if os.path.isdir(path):
        raise IsADirectoryError(f"{path} is a folder; give the name of a file")
    if not os.access(folder, os.W_OK) or (os.path.exists(path) and not os.access(path, os.W_OK)):
        raise PermissionError(f"{path} cannot be written (no permission); write elsewhere with -o")
    return path


# What an earlier run left. All of it is for who holds the lock.

def recover_partial_result(path: str) -> str | None:
    """Puts aside what an earlier run left of the result `path`; returns the file with its frames, None if there is none.

    That file is a complete result layer (`NAME.recovered.usdc`): it can be viewed, and a run can be restarted from it.
    Raises FileExistsError for files under the names needed here that wsim did not make.
    """
    partial = partial_path(path)
    there = os.path.lexists(partial)
    if there:
        _refuse_link(partial)
    crate.undo_unfinished_save(partial)
    if there:
        _refuse_foreign(partial)
    for left in (*atomic.leftover_drafts(partial), *atomic.leftover_drafts(partial + crate.INDEX)):
        left.unlink(missing_ok=True)
    if not there:
        return None
    if not Sdf.Layer.OpenAsAnonymous(partial).ListAllTimeSamples():
        files = beside.owned_result_folder(partial, path)
        os.remove(partial)
        beside.remove_result_folder(path, files)
        return None
    stem, k = os.path.splitext(path)[0], 1
    while os.path.lexists(kept := f"{stem}.recovered{'' if k == 1 else k}.usdc"):
        k += 1
    os.rename(partial, kept)
    return kept


def _refuse_link(path: str) -> None:
    found = os.lstat(path)
    if not stat.S_ISREG(found.st_mode) or found.st_nlink > 1:
        raise _foreign_file_error(path, "it is a link, or no plain file")


def _refuse_foreign(path: str) -> None:
    try:
        if crate.is_wsim_result(Sdf.Layer.OpenAsAnonymous(path)):
            return
        why = "wsim did not make it"
    except Tf.ErrorException as error:
        why = usd_error_text(error)
    raise _foreign_file_error(path, why)


def _foreign_file_error(path: str, why: str) -> FileExistsError:
    return FileExistsError(f"{path} is in the way: a result is written under that name until it is whole, and this file is "
                           f"not of a run ({why}). Move it away, or choose another output")


class PartialFile:
    """The growing file. `layer` takes the opinions; `save` keeps them; `finish` gives the file its name, `leave` leaves it,
    `discard` removes it.

    beside       files of this run that the layer names, see `wsim.usd.result.kinds.beside`
    recovered    where the frames of an earlier run that did not end are now; None if there are none
    Raises OSError, with the path and the mend, where the folder or the disk does not take it, where another run writes it
    (BlockingIOError), and where files of others have the names that it needs (FileExistsError).
    """

    def __init__(self, path: str):
        self.final, self.path = path, partial_path(path)
        self.cost = 0.0                   # [s] of the last save
        self.saved = float("-inf")        # [s] when it ended
        self.good = True                  # the file on the disk and the layer hold the same or the layer holds more
        self.recovered: str | None = None
        self.put_back = False             # by `discard`: the partial file is that of the earlier run again
        self.beside = beside.SidecarFiles(path)
        self.lock = OutputLock(self.path + crate.LOCK, path)
        try:
            if Sdf.Layer.Find(self.path):
                raise OSError(f"{self.path} is open in this process; close its stage first")
            self.recovered = recover_partial_result(path)
            self.layer: Any = _create_crate_layer(self.path, self.beside.folder)
        except BaseException:
            self.discard()
            raise

    def due(self) -> bool:
        """True if a save now keeps saving within its share of the wall time."""
        return self.good and perf_counter() - self.saved >= self.cost * (1.0 / SHARE - 1.0)

    def save(self) -> None:
        """Saves the layer: what it holds is on the disk when this returns, whatever kills the process later."""
        began = perf_counter()
        try:
            crate.copy_crate_index(self.path)
            if not self.layer.Save():
                raise OSError("USD refused to save it")
            with suppress(FileNotFoundError):
                os.remove(self.path + crate.INDEX)
        except (Tf.ErrorException, OSError) as error:
            self.good = False
            crate.undo_unfinished_save(self.path)
            raise _write_error(self.path, error, "; the frames saved so far are in that file") from None
        self.beside.saved()
        self.saved = perf_counter()
        self.cost = self.saved - began

    def finish(self, flat=None, as_clips: bool = False) -> None:
        """The final file: the partial one renamed, or (`flat` a layer, or another format) exported whole and renamed; as_clips:
        with its samples in files beside it (`wsim.usd.clips`).

        The caller must have let go of every stage and prim of the layer.
        """
        if as_clips:
            flat = clips.split_into_clips(self.layer, self.final)
        if flat is None and self.final.endswith(".usda"):
            flat = self.layer
        before = beside.owned_result_folder(self.final, self.final)
        if flat is None:
            self.layer = None
            os.replace(self.path, self.final)
        else:
            self._export_final_file(flat)
            self.layer = None
            os.remove(self.path)
        beside.remove_result_folder(self.final, before)
        clips.remove_stale_clips(self.final)
        self.lock.release()
        stale = Sdf.Layer.Find(self.final)
        if stale:
            stale.Reload(True)

    def _export_final_file(self, layer) -> None:
        try:
            with atomic.replace_file_atomically(self.final, ".usda" if self.final.endswith(".usda") else ".usdc",
                                                self.path) as whole:
                if not layer.Export(str(whole)):
                    raise OSError("USD refused to write it")
        except (Tf.ErrorException, OSError) as error:
            raise _write_error(self.final, error, f"; the frames are kept in {self.path}") from None

    def leave(self) -> None:
        """Ends with the file as it was saved last, under its partial name."""
        self.layer = None
        self.lock.release()

    def discard(self) -> None:
        """Ends without a file: that of an earlier run has its partial name again."""
        if getattr(self, "layer", None) is not None:
            self.layer = None
            for path in (self.path, self.path + crate.INDEX):
                with suppress(FileNotFoundError):
                    os.remove(path)
            self.beside.discard()
        if self.recovered:
            with suppress(OSError):
                os.rename(self.recovered, self.path)
                self.recovered, self.put_back = None, True
        self.lock.release()


def _create_crate_layer(path: str, files: str) -> Any:
    """A new crate layer that says whose it is, and where its files are, from its first byte on."""
    try:
        with atomic.replace_file_atomically(path) as temporary:
            layer = Sdf.Layer.CreateAnonymous(".usdc")
            layer.customLayerData = {crate.MADE: True, beside.KEY: files}
            if not layer.Export(str(temporary)):
                raise OSError("USD refused to write it")
        return Sdf.Layer.FindOrOpen(path)
    except (Tf.ErrorException, OSError) as error:
        raise _write_error(path, error) from None


def _write_error(path: str, error: Exception, more: str = "") -> OSError:
    """A write error in one line: the cause that the system named, without USD's call stack."""
    text = usd_error_text(error)
    for cause in ("No space left on device", "File too large", "Permission denied", "Read-only file system",
                  "Disk quota exceeded", "Input/output error"):
        if cause in str(error):
            text = cause
    return OSError(f"{path} could not be written: {text[:300]}{more}. Free space, or write elsewhere "
                   "with -o")
