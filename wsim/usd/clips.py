"""A result as value clips: one file a frame, a manifest, and a layer that any viewer opens (`UsdClipsAPI`).

    out.usdc                      over the scene, as a result in one layer, but for the samples; restart fields are here
    out.clips/manifest.usda       declares what the clips hold
    out.clips/frame.0001.usdc     the samples of one frame, named by its whole time code

The clips are cut from the finished layer of a run (`wsim.usd.result.partial`), so that a run that is killed leaves the same
partial file as without them. The folder is written under a name of its own and renamed before the layer that names it is; an
earlier result keeps its folder until then: the new one is out.clips2, and so on. Between frames USD interpolates from one clip
to the next. Samples that name files (of volumes) stay in the layer, from which their paths are. Every root prim with samples
has the clips of the whole stage, at its own path.
"""

import os
import re
import secrets
import shutil
from collections.abc import Iterable
from contextlib import suppress
from math import floor

from pxr import Sdf, Tf, UsdUtils, Vt

from wsim.usd.result.atomic import PART
from wsim.usd.result.crate import MADE
from wsim.usd.result.kinds.siblings import is_referenced_by_sibling

SET, MANIFEST = "wsim", "manifest.usda"
MADE_FOR = "wsim:clipsOf"      # custom data of a manifest: the result that its folder belongs to
ROUND = 1e-6                   # of a time code that a sample may lie before its frame


def split_into_clips(layer: Sdf.Layer, path: str) -> Sdf.Layer:
    """Writes the samples of a result layer, to lie at `path`, as clips beside it; returns the layer without them that names the
    clips. Raises OSError where the folder cannot be written; nothing of it stays then."""
    remove_stale_clips(path)
    codes = {name: times for name, times in time_samples_by_path(layer).items()
             if layer.GetAttributeAtPath(name).typeName not in (Sdf.ValueTypeNames.Asset, Sdf.ValueTypeNames.AssetArray)}
    folder = _free_clip_folder(path)
    draft = os.path.join(os.path.dirname(path), f".{os.path.basename(path)}.{secrets.token_hex(4)}.{PART}")
    frames: dict[int, list[float]] = {}
    for code in sorted({c for times in codes.values() for c in times}):
        frames.setdefault(floor(code + ROUND), []).append(code)
    try:
        os.mkdir(draft)
        _export_layer(_clip_manifest(layer, codes, path), os.path.join(draft, MANIFEST))
        for number, own in frames.items():
            _export_layer(_make_clip(layer, codes, own), os.path.join(draft, _clip_file_name(number)))
        os.rename(draft, folder)
    finally:
        shutil.rmtree(draft, ignore_errors=True)
    return _stitch_clips(layer, codes, frames, os.path.basename(folder))


def time_samples_by_path(layer: Sdf.Layer) -> dict[str, list[float]]:
    """Time codes of the samples of each attribute that has some, by path."""
    found: dict[str, list[float]] = {}

    def collect_time_samples(path) -> None:
        if path.IsPropertyPath() and (times := layer.ListTimeSamplesForPath(path)):
            found[str(path)] = list(times)

    layer.Traverse(Sdf.Path.absoluteRootPath, collect_time_samples)
    return found


def _clip_file_name(number: int) -> str:
    return f"frame.{number:04d}.usdc"


def _export_layer(layer: Sdf.Layer, path: str) -> None:
    try:
        if not layer.Export(path):
            raise OSError(f"{path} could not be written: USD refused to")
    except Tf.ErrorException as error:
        text = str(error).strip().splitlines()[0]
        raise OSError(f"{path} could not be written: {text[:300]}. Free space, or write elsewhere with -o") from None


def _declare_attribute(layer: Sdf.Layer, made: Sdf.Layer, path: str) -> Sdf.AttributeSpec:
    """An attribute of `made` as `layer` has it, without values."""
    spec, at = layer.GetAttributeAtPath(path), Sdf.Path(path)
    prim = made.GetPrimAtPath(at.GetPrimPath()) or Sdf.CreatePrimInLayer(made, at.GetPrimPath())
    return Sdf.AttributeSpec(prim, at.name, spec.typeName, Sdf.VariabilityVarying, spec.custom)


def _clip_manifest(layer: Sdf.Layer, paths: Iterable[str], result: str) -> Sdf.Layer:
    made = Sdf.Layer.CreateAnonymous(".usda")
    made.customLayerData = {MADE: True, MADE_FOR: os.path.basename(result)}
    for path in paths:
        _declare_attribute(layer, made, path)
    return made


def _make_clip(layer: Sdf.Layer, codes: dict[str, list[float]], own: list[float]) -> Sdf.Layer:
    """The samples at the time codes of one frame."""
    made = Sdf.Layer.CreateAnonymous(".usdc")
    made.customLayerData = {MADE: True}
    made.startTimeCode, made.endTimeCode = own[0], own[-1]
    made.timeCodesPerSecond, made.framesPerSecond = layer.timeCodesPerSecond, layer.framesPerSecond
    for path, times in codes.items():
        if mine := [code for code in own if code in times]:
            _declare_attribute(layer, made, path)
            for code in mine:
                made.SetTimeSample(path, code, layer.QueryTimeSample(path, code))
    return made


def _stitch_clips(layer: Sdf.Layer, codes: dict[str, list[float]], frames: dict[int, list[float]], folder: str) -> Sdf.Layer:
    """The layer without its samples, and with the clips on every root prim that had some."""
    made = Sdf.Layer.CreateAnonymous(".usdc")
    made.TransferContent(layer)
    for path in codes:
        made.GetAttributeAtPath(path).ClearInfo("timeSamples")
    every = sorted({code for times in codes.values() for code in times})
    active = [(own[0] if k else min(own[0], every[0]), k) for k, own in enumerate(frames.values())]
    for root in sorted({str(Sdf.Path(path).GetPrefixes()[0]) for path in codes}):
        made.GetPrimAtPath(root).SetInfo("clips", {SET: {
            "assetPaths": Sdf.AssetPathArray([Sdf.AssetPath(f"./{folder}/{_clip_file_name(number)}") for number in frames]),
            "manifestAssetPath": Sdf.AssetPath(f"./{folder}/{MANIFEST}"), "primPath": root,
            "active": Vt.Vec2dArray(active), "times": Vt.Vec2dArray([(code, code) for code in every])}})
    return made


# What is there already

def clip_asset_paths(layer: Sdf.Layer) -> list[str]:
    """Asset paths of the clips that a layer names, each once; none where it is no result as clips."""
    found: list[str] = []
    for prim in layer.rootPrims:
        clips = prim.GetInfo("clips") if prim.HasInfo("clips") else {}
        found += [asset.path for asset in clips.get(SET, {}).get("assetPaths", ())]
    return list(dict.fromkeys(found))


def join_clips(layer: Sdf.Layer, folder: str) -> Sdf.Layer:
    """A result layer of `folder` with the samples of its clips, in one layer; itself where it has none. Raises OSError where a
    clip is missing."""
    names = clip_asset_paths(layer)
    if not names:
        return layer
    made = Sdf.Layer.CreateAnonymous(".usdc")
    made.TransferContent(layer)
    for name in names:
        clip = Sdf.Layer.OpenAsAnonymous(os.path.join(folder, name))
        if not clip:
            raise OSError(f"{os.path.join(folder, name)}, a clip of it, is missing; bring it back, or run the scene again")
        for path, times in time_samples_by_path(clip).items():
            for code in times:
                made.SetTimeSample(path, code, clip.QueryTimeSample(path, code))
    return made


def copy_clips(layer: Sdf.Layer, place: str, target: str) -> str:
    """Copies the clips of a result layer of the folder `place` for its copy `target`, which the layer then names; returns their
    new folder, "" where there are none. Raises OSError where one is missing or cannot be written; nothing stays then."""
    names = clip_asset_paths(layer)
    if not names:
        return ""
    folder = _free_clip_folder(target)
    draft = os.path.join(os.path.dirname(target), f".{os.path.basename(target)}.{secrets.token_hex(4)}.{PART}")
    try:
        os.mkdir(draft)
        manifest = Sdf.Layer.OpenAsAnonymous(os.path.join(place, os.path.dirname(names[0]), MANIFEST))
        manifest.customLayerData = {MADE: True, MADE_FOR: os.path.basename(target)}
        _export_layer(manifest, os.path.join(draft, MANIFEST))
        for name in names:
            shutil.copyfile(os.path.join(place, name), os.path.join(draft, os.path.basename(name)))
        os.rename(draft, folder)
    finally:
        shutil.rmtree(draft, ignore_errors=True)
    UsdUtils.ModifyAssetPaths(layer, lambda path: os.path.join(folder, os.path.basename(path))
                              if path in names or os.path.basename(path) == MANIFEST else path)
    return folder


def _clip_folders(path: str) -> dict[str, str]:
    """Names and paths of the folders of clips that may be those of the result `path`."""
    name = re.compile(rf"{re.escape(os.path.splitext(os.path.basename(path))[0])}\.clips\d*\Z")
    return {e.name: e.path for e in os.scandir(os.path.dirname(path)) if name.match(e.name) and e.is_dir(follow_symlinks=False)}


def _free_clip_folder(path: str) -> str:
    stem, k = os.path.splitext(path)[0], 1
    while os.path.lexists(folder := f"{stem}.clips{'' if k == 1 else k}"):
        k += 1
    return folder


def remove_stale_clips(path: str) -> None:
    """Removes what earlier runs to `path` left that no layer beside it names any more: clips of a result that was replaced, and
    drafts of clips. Only files that a run has written; a folder with anything else in it stays."""
    draft = re.compile(rf"\.{re.escape(os.path.basename(path))}\.[0-9a-f]{{8}}\.{PART}\Z")
    for entry in list(os.scandir(os.path.dirname(path))):
        if draft.match(entry.name) and entry.is_dir(follow_symlinks=False):
            shutil.rmtree(entry.path, ignore_errors=True)
    for name, folder in _clip_folders(path).items():
        if _clips_made_for(folder) == os.path.basename(path) and not is_referenced_by_sibling(os.path.dirname(path),
                                                                                              name + "/"):
            for file in list(os.scandir(folder)):
                if re.fullmatch(rf"frame\.-?\d+\.usdc|{re.escape(MANIFEST)}", file.name):
                    os.remove(file.path)
            with suppress(OSError):
                os.rmdir(folder)


def _clips_made_for(folder: str) -> str:
    try:
        layer = Sdf.Layer.OpenAsAnonymous(os.path.join(folder, MANIFEST))
        return str(layer.customLayerData.get(MADE_FOR, "")) if layer else ""
    except Tf.ErrorException:
        return ""
