"""Files that a stage is made of, and outputs that would overwrite one.

Counted are layers of every kind of composition arc and assets (textures, time samples of them, UDIM tiles), through the
variants that are not chosen too: what USD itself would copy to take the stage elsewhere (UsdUtils.ComputeAllDependencies).
"""

import os
from collections.abc import Mapping

from pxr import Tf, UsdUtils

from wsim.scene import Problem, SceneError
from wsim.usd.stage import collect_warnings


def stage_dependencies(path) -> set[str]:
    """Absolute paths of the file itself and of all that it depends on and is there, also of what cannot be read."""
    path = os.path.abspath(os.fspath(path))
    found = {path}

    def note_dependency(layer, info):
        found.update(layer.ComputeAbsolutePath(name) for name in (info.assetPath, *info.dependencies) if name)
        return info

    with collect_warnings([]):
        try:
            layers, assets, _ = UsdUtils.ComputeAllDependencies(path, note_dependency)
            found.update(layer.realPath for layer in layers)
            found.update(assets)
        except Tf.ErrorException:                    # a file of them is broken: the others were named on the way
            pass
    names = {file.split("[")[0] for file in found}                       # a layer in a package: the package
    return {file for file in names if os.path.lexists(file)}


def describe_overwrite(out, source) -> str:
    """Part that `out` is of the stage of `source`, "" if nothing: writing it would destroy that."""
    out, source = os.path.abspath(os.fspath(out)), os.path.abspath(os.fspath(source))
    if out == source or _is_same_file(out, source):
        return "itself"
    if os.path.lexists(out) and any(out == file or _is_same_file(out, file) for file in stage_dependencies(source)):
        return "a file that it depends on"
    return ""


def _is_same_file(one: str, other: str) -> bool:
    try:
        return os.path.samefile(one, other)
    except OSError:
        return False


def refuse_overwrite(option: str, out, inputs: Mapping[str, str]) -> None:
    """Raises SceneError where writing `out` would overwrite an input or a file that one depends on.

    inputs    {file: what it is, in words}; a file that is not there yet counts by its name
    """
    for path, what in inputs.items() if out is not None else ():
        found = describe_overwrite(out, path)
        if found:
            is_ = f"{what} itself" if found == "itself" else found.replace("it depends", f"{what} depends")
            raise SceneError(Problem(str(out), f"is {is_} ({path}), and {option} would overwrite it; give another name"))
