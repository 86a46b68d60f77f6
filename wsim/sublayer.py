"""A layer over an untouched source: how it names the source, what it must copy from it, how both become one file.

Root metadata (units, up axis, rate, default prim) does not come from sublayers, so it is copied; where the source
authors none, USD's fallback is written out.
"""

import os

from pxr import Sdf, Tf, Usd, UsdGeom, UsdPhysics, UsdUtils

from wsim.scene import Scene

METADATA = ("defaultPrim", "framePrecision", "colorConfiguration", "colorManagementSystem", "renderSettingsPrimPath",
            "expressionVariables")
MADE_FOR = "wsim:madeFor"       # custom data of a scene file that was written for a result: it may be written again


def put_over(source: str, layer: Sdf.Layer, folder: str) -> None:
    """Makes `layer`, to lie in `folder`, a layer over the file `source`."""
    layer.subLayerPaths.append(relative(source, folder))
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


def relative(path: str, folder: str) -> str:
    """`path` as seen from `folder`, in USD's spelling; absolute if it lies on another drive."""
    try:
        path = os.path.relpath(path, folder)
    except ValueError:
        return path.replace(os.sep, "/")
    path = path.replace(os.sep, "/")
    return path if path.startswith("../") else "./" + path


def choose(stage: Usd.Stage, variants: dict[str, dict[str, str]]) -> None:
    """Writes the variants that a scene was loaded with, {prim path: {variant set: variant}}, outer prims first."""
    for path in sorted(variants):
        for name, variant in variants[path].items():
            stage.OverridePrim(path).GetVariantSets().SetSelection(name, variant)


def refuse_layers_of(stage: Usd.Stage, path: str) -> None:
    """ValueError if writing `path` would overwrite a file that the stage of the source is made of."""
    for layer in stage.GetUsedLayers() if os.path.exists(path) else ():
        file = layer.realPath.split("[")[0]                   # a layer in a package: the package
        if os.path.exists(file) and os.path.samefile(file, path):
            what = "the scene itself" if layer == stage.GetRootLayer() else "a layer of the scene"
            raise ValueError(f"{path} is {what}; a result never overwrites its source. Choose another output")


def write_source(scene: Scene, path: str) -> str:
    """Writes a scene that was made in Python beside its result `path`, as NAME_scene.usda; returns that file.

    A file of that name is only replaced if an earlier call wrote it (FileExistsError).
    """
    from wsim.usd import save

    stem = os.path.splitext(path)[0]
    target, whole = stem + "_scene.usda", stem + "_scene.whole.usda"
    if os.path.exists(target) and not _made_for_result(target):
        raise FileExistsError(f"{target} is in the way: a scene made in Python is written there, beside its result. "
                              "Save the scene yourself (wsim.save) and load that file, or choose another output")
    try:
        save(scene, whole)
        layer = Sdf.Layer.OpenAsAnonymous(whole)
        layer.customLayerData = {MADE_FOR: os.path.basename(path)}
        layer.Export(whole)
        os.replace(whole, target)
    except Tf.ErrorException as error:
        raise OSError(f"{target} could not be written: {error}") from None
    finally:
        if os.path.exists(whole):
            os.remove(whole)
    stale = Sdf.Layer.Find(target)
    if stale:
        stale.Reload(True)
    return target


def _made_for_result(path: str) -> bool:
    try:
        return MADE_FOR in Sdf.Layer.OpenAsAnonymous(path).customLayerData
    except Tf.ErrorException:
        return False


def flattened(stage: Usd.Stage, folder: str) -> Sdf.Layer:
    """The stage as one layer to lie in `folder`; the absolute asset paths that flattening makes become relative."""
    flat = stage.Flatten(addSourceFileComment=False)
    UsdUtils.ModifyAssetPaths(flat, lambda path: relative(path, folder) if os.path.isabs(path) else path)
    return flat
