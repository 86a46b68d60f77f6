"""Samples of methods that an earlier result recorded, copied into the result of a run that goes on from it, with the files that
they name."""

import os
from collections.abc import Iterator, Sequence
from typing import Any

from pxr import Sdf, Usd

from wsim.scene import Problem, SceneError
from wsim.scene.samples import BESIDE
from wsim.usd.result.kinds.beside import SidecarFiles


def copy_earlier_samples(layer: Sdf.Layer, stage: Usd.Stage, restart: Any, things: Sequence[str],
                         beside: SidecarFiles) -> set[float]:
    """Copies all samples up to the restart at and below the prims `things`, and of their volumes and particles, into the
    stage's edit target; returns their codes.

    layer       that of the result `restart` (`wsim.usd.result.restart.RestartState`)
    Prims that the earlier result made are made again. Raises SceneError where a file that a sample names is missing.
    """
    codes: set[float] = set()
    for path in (thing + name for thing in things for name in BESIDE):
        for spec in _sampled_attributes_below(layer, Sdf.Path(path)):
            prim = stage.GetPrimAtPath(spec.path.GetPrimPath())
            for above in spec.path.GetPrimPath().GetPrefixes() if not prim else ():
                prim = stage.GetPrimAtPath(above) or stage.DefinePrim(above, layer.GetPrimAtPath(above).typeName)
            attribute = prim.GetAttribute(spec.name) or prim.CreateAttribute(spec.name, spec.typeName, spec.custom)
            times = [c for c in layer.ListTimeSamplesForPath(spec.path) if c <= restart.frame_time_code]
            for code in times:
                value = layer.QueryTimeSample(spec.path, code)
                if isinstance(value, Sdf.AssetPath):
                    value = _copy_volume_file(restart.path, spec.path, value, code, beside)
                attribute.Set(value, code)
            codes.update(times)
    beside.keep()
    return codes


def _sampled_attributes_below(layer: Sdf.Layer, path: Sdf.Path) -> Iterator[Sdf.AttributeSpec]:
    """Attributes with samples of a prim and of all below it, above ones first."""
    prim = layer.GetPrimAtPath(path)
    if prim:
        yield from (spec for spec in prim.attributes if layer.GetNumTimeSamplesForPath(spec.path))
        for child in prim.nameChildren:
            yield from _sampled_attributes_below(layer, child.path)


def _copy_volume_file(result: str, path: Sdf.Path, value: Sdf.AssetPath, code: float, beside: SidecarFiles) -> Sdf.AssetPath:
    """The file of a field of a volume, which stands below that."""
    source = os.path.normpath(os.path.join(os.path.dirname(os.path.abspath(result)), value.path))
    if not os.path.isfile(source):
        raise SceneError(Problem(str(path.GetPrimPath()), f"{source}, which {result} names, is missing; put it back, or "
                                 "restart from another result"))
    return Sdf.AssetPath(beside.take(source, str(path.GetPrimPath().GetParentPath()), code))
