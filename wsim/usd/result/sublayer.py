"""A layer over an untouched source: how it names the source, what it must copy from it, how both become one file.

Root metadata (units, up axis, rate, default prim) does not come from sublayers, so it is copied; where the source
authors none, USD's fallback is written out.
"""

import os
import re

from pxr import Sdf, Tf, Usd, UsdGeom, UsdPhysics, UsdUtils

from wsim.scene import Scene
from wsim.usd.result import atomic
from wsim.usd.result.dependencies import describe_overwrite
from wsim.usd.result.kinds.siblings import is_referenced_by_sibling

METADATA = ("defaultPrim", "framePrecision", "colorConfiguration", "colorManagementSystem", "renderSettingsPrimPath",
            "expressionVariables")
MADE_FOR = "wsim:madeFor"       # custom data of a scene file that was written for a result


def set_source_sublayer(source: str, layer: Sdf.Layer, folder: str) -> None:
    """Makes `layer`, to lie in `folder`, a layer over the file `source`."""
    layer.subLayerPaths.append(relative_usd_path(source, folder))
    root = Sdf.Layer.FindOrOpen(source)
    for key in METADATA:
        if root.pseudoRoot.HasInfo(key):
            layer.pseudoRoot.SetInfo(key, root.pseudoRoot.GetInfo(key))
    stage = Usd.Stage.OpenMasked(root, Usd.StagePopulationMask())
    layer.timeCodesPerSecond = stage.GetTimeCodesPerSecond()
    layer.framesPerSecond = stage.GetFramesPerSecond()
    mine = Usd.Stage.OpenMasked(layer, Usd.StagePopulationMask())
    UsdGeom.SetStageMetersPerUnit(mine, UsdGeom.GetStageMetersPerUnit(stage))
    UsdGeom.SetStageUpAxis(mine, UsdGeom.GetStageUpAxis(stage))
    UsdPhysics.SetStageKilogramsPerUnit(mine, UsdPhysics.GetStageKilogramsPerUnit(stage))


def relative_usd_path(path: str, folder: str) -> str:
    """`path` as seen from `folder`, in USD's spelling; absolute if it lies on another drive."""
    try:
        path = os.path.relpath(path, folder)
    except ValueError:
        return path.replace(os.sep, "/")
    path = path.replace(os.sep, "/")
    return path if path.startswith("../") else "./" + path


def write_variant_selections(stage: Usd.Stage, variants: dict[str, dict[str, str]]) -> None:
    """Writes the variants that a scene was loaded with, {prim path: {variant set: variant}}, outer prims first."""
    for path in sorted(variants):
        for name, variant in variants[path].items():
            stage.OverridePrim(path).GetVariantSets().SetSelection(name, variant)


def refuse_source(source: str, path: str) -> None:
    """ValueError if writing `path` would overwrite a file that the scene is made of, in whatever variant."""
    found = describe_overwrite(path, source)
    if found:
        what = "the scene itself" if found == "itself" else "a file that the scene depends on"
        raise ValueError(f"{path} is {what}; a result never overwrites its source. Choose another output")


def write_source(scene: Scene, path: str) -> tuple[str, bool]:
    """Writes a scene that was made in Python beside its result `path`, as NAME_scene.usda; returns that file, and whether it is
    new. Where an earlier result of this name lies over another scene, this one is NAME_scene2.usda, and so on.

    Raises FileExistsError where NAME_scene.usda is there and no run wrote it.
    """
    from wsim.usd import save

    target = _scene_copy_name(path, 1)
    if os.path.lexists(target) and not _source_made_for(target):
        raise FileExistsError(f"{target} is in the way: a scene made in Python is written there, beside its result. "
                              "Save the scene yourself (wsim.save) and load that file, or choose another output")
    try:
        with atomic.draft_file(target) as draft:
            save(scene, draft)
            layer = Sdf.Layer.OpenAsAnonymous(str(draft))
        return _place_scene_copy(layer, path)
    except Tf.ErrorException as error:
        raise OSError(f"{target} could not be written: {error}") from None


def copy_source(source: str, result: str, copy: str) -> tuple[str, bool]:
    """A scene of `write_source` for `result` as one of its copy; returns that file, and whether it is new. Any other file is
    returned itself."""
    if not source.endswith(".usda") or _source_made_for(source) != os.path.basename(result):
        return source, False
    layer, folder = Sdf.Layer.OpenAsAnonymous(source), os.path.dirname(source)
    UsdUtils.ModifyAssetPaths(layer, lambda path: relative_usd_path(os.path.normpath(os.path.join(folder, path)),
                                                                    os.path.dirname(copy))
                              if path.startswith(("./", "../")) else path)
    return _place_scene_copy(layer, copy)


def _place_scene_copy(layer: Sdf.Layer, path: str) -> tuple[str, bool]:
    """The file beside the result `path` that holds its scene, and whether it is new."""
    layer.customLayerData = {MADE_FOR: os.path.basename(path)}
    text, k = layer.ExportToString(), 1
    while os.path.lexists(target := _scene_copy_name(path, k)) and not _file_has_text(target, text):
        k += 1
    new = not os.path.lexists(target)
    if new:
        atomic.replace_text(target, text)
    return target, new


def remove_sources(path: str, keep: str | None) -> None:
    """Removes scenes of `write_source` for the result `path` that no layer beside it lies over any more."""
    stem, place = re.escape(os.path.basename(os.path.splitext(path)[0])), os.path.dirname(path)
    for entry in list(os.scandir(place)):
        if (re.fullmatch(rf"{stem}_scene\d*\.usda", entry.name) and entry.path != keep
                and _source_made_for(entry.path) == os.path.basename(path)
                and not is_referenced_by_sibling(place, entry.name, growing=True)):
            os.remove(entry.path)


def _scene_copy_name(path: str, k: int) -> str:
    return f"{os.path.splitext(path)[0]}_scene{'' if k == 1 else k}.usda"


def _file_has_text(path: str, text: str) -> bool:
    try:
        with open(path, encoding="utf-8") as file:
            return not os.path.islink(path) and file.read() == text
    except (OSError, ValueError):
        return False


def _source_made_for(path: str) -> str:
    """The result that a scene was written for; "" if none."""
    try:
        return str(Sdf.Layer.OpenAsAnonymous(path).customLayerData.get(MADE_FOR, ""))
    except Tf.ErrorException:
        return ""


def flatten_stage(stage: Usd.Stage, folder: str) -> Sdf.Layer:
    """The stage as one layer to lie in `folder`; the absolute asset paths that flattening makes become relative."""
    flat = stage.Flatten(addSourceFileComment=False)
    UsdUtils.ModifyAssetPaths(flat, lambda path: relative_usd_path(path, folder) if os.path.isabs(path) else path)
    return flat
