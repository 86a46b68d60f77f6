"""A copy of a result that shares no file with it: the layer, its volumes, restart fields and clips, and the scene that was
written for it. A plain copy of the layer names the files of the first result instead, in that result's folder.
"""

import os
import secrets
import shutil

from pxr import Sdf, Tf, UsdUtils

from wsim.scene import Problem, SceneError
from wsim.usd import clips
from wsim.usd.result import atomic, crate
from wsim.usd.result.dependencies import describe_overwrite
from wsim.usd.result.kinds import beside, sidecar
from wsim.usd.result.kinds.siblings import KEY
from wsim.usd.result.lock import OutputLock
from wsim.usd.result.partial import check_output, partial_path
from wsim.usd.result.sublayer import copy_source, relative_usd_path
from wsim.usd.stage import usd_error_text


def copy_result(source, target) -> str:
    """Copies the result `source` to `target` (.usdc, .usda, .usd), in any folder; returns the path of the copy.

    A result that is being written is copied as it was saved last. What was at `target` stays until the copy is whole. Raises
    SceneError for a source that is no result, a target that it is made of, or a file of it that is missing; ValueError for
    another ending; OSError where the copy cannot be written. Nothing of the copy stays then.
    """
    source, target = os.path.abspath(os.fspath(source)), check_output(os.fspath(target))
    if found := describe_overwrite(target, source):
        what = "the result itself" if found == "itself" else f"a file that {source} depends on"
        raise SceneError(Problem(target, f"is {what}; give the copy another name"))
    lock = OutputLock(partial_path(target) + crate.LOCK, target)
    try:
        before = beside.owned_result_folder(target, target)
        copy = _ResultCopy(_read_result_layer(source), source, target)
        try:
            copy.write()
        except BaseException as error:
            copy.undo()
            if isinstance(error, Tf.ErrorException):
                raise OSError(f"{target} could not be written: {usd_error_text(error)}. Free space, or give another "
                              "name") from None
            raise
        beside.remove_result_folder(target, before)
        clips.remove_stale_clips(target)
    finally:
        lock.release()
    return target


def _read_result_layer(source: str) -> Sdf.Layer:
    try:
        layer = crate.read_crate_layer(source) if os.path.isfile(source) else None
    except Tf.ErrorException as error:
        raise SceneError(Problem(source, f"cannot be read: {usd_error_text(error)}")) from None
    if not layer or not crate.is_wsim_result(layer):
        raise SceneError(Problem(source, "is no result that a run has written" if layer else "is no file"))
    return layer


class _ResultCopy:
    """A layer that is changed to lie at `target`, and the files that it names there."""

    def __init__(self, layer: Sdf.Layer, source: str, target: str):
        self.layer, self.source, self.target = layer, source, target
        self.place = os.path.dirname(source)
        self.old = str(layer.customLayerData.get(KEY, ""))
        self.new = f"{beside.files_folder_name(target)}/{secrets.token_hex(4)}"
        self.files: dict[str, str] = {}                       # {file of the source: file of the copy}, absolute
        self.made: list[str] = []                             # scenes and clips, to be undone

    def write(self) -> None:
        """All files, then the layer."""
        if folder := clips.copy_clips(self.layer, self.place, self.target):
            self.made.append(folder)
        UsdUtils.ModifyAssetPaths(self.layer, self._path)
        self._move_restart()
        data = {key: value for key, value in self.layer.customLayerData.items() if key != KEY}
        self.layer.customLayerData = data | ({KEY: self.new} if self.files else {})
        for old, new in self.files.items():
            if not os.path.isfile(old):
                raise SceneError(Problem(self.source, f"names {old}, which is missing; put it back, or run the scene again"))
            os.makedirs(os.path.dirname(new), exist_ok=True)
            shutil.copyfile(old, new)
        with atomic.replace_file_atomically(self.target, ".usda" if self.target.endswith(".usda") else ".usdc") as whole:
            if not self.layer.Export(str(whole)):
                raise OSError("USD refused to write it")

    def undo(self) -> None:
        """Removes the files of the copy."""
        beside.remove_result_folder(self.target, self.new)
        for path in self.made:
            if os.path.isdir(path):
                shutil.rmtree(path, ignore_errors=True)
            else:
                os.remove(path)

    def _path(self, name: str) -> str:
        """A path that the layer names, as the copy names it."""
        path = os.path.normpath(os.path.join(self.place, name))
        if not name.startswith(("./", "../", "/")) and not os.path.lexists(path):       # found by a search, not beside it
            return name
        if self.old and path.startswith(os.path.join(self.place, os.path.normpath(self.old)) + os.sep):
            self.files[path] = os.path.join(os.path.dirname(self.target), self.new, os.path.basename(path))
            path = self.files[path]
        else:
            path, new = copy_source(path, self.source, self.target)
            self.made += [path] * new
        return relative_usd_path(path, os.path.dirname(self.target))

    def _move_restart(self) -> None:
        def move_restart_path(path: Sdf.Path) -> None:
            spec = self.layer.GetAttributeAtPath(path) if path.IsPropertyPath() and path.name == sidecar.FILE else None
            if spec and spec.default:
                spec.default = self._path(spec.default)

        self.layer.Traverse(Sdf.Path.absoluteRootPath, move_restart_path)
