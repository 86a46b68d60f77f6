"""How much memory a fluid takes, known before any is taken; and the cells that fit where it is too much."""

import os
from math import ceil

from wsim.physics.fluid.objects import Fluid
from wsim.scene import Problem, SceneError

SPARE = 0.9              # of what is free that fluids may take


def numbers_per_cell(fluid: Fluid, obstacles: bool) -> float:
    """Numbers of the run's precision for each cell: fields and their snapshot, what a step works with, levels of the
    pressure."""
    dim = len(fluid.axes)
    levels = 2.0 / (2 ** dim - 1)
    vectors = 2 * (fluid.vorticity > 0.0) + (fluid.acceleration is not None)
    found = dim * (2 + 2) + 2 * 2 + 6 + levels + 3 * vectors
    if fluid.margin > 0.0:
        return dim * 2 + 2 * 2                   # fields and their snapshot: what is solved is a part that nobody knows yet
    return found + (1 + dim * (2 + levels) if obstacles else 0)


def fluid_memory(fluid: Fluid, obstacles: bool, width: int) -> int:
    """Bytes. width: of a number."""
    return ceil(numbers_per_cell(fluid, obstacles) * width * fluid.cells)


def free_device_bytes(device) -> int:
    """Bytes that are free on a device."""
    if device.is_cuda:
        return int(device.free_memory)
    try:
        return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (ValueError, OSError):
        return 1 << 62


def refuse_large_fluids(fluids: list[Fluid], b) -> None:
    """Raises SceneError, by the path of the greatest, where they do not fit."""
    width = b.model.dtype().nbytes
    need = {id(f): fluid_memory(f, bool(b.scene.colliders), width) for f in fluids}
    total, there = sum(need[id(f)] for f in fluids), free_device_bytes(b.model.device)
    if total > SPARE * there:
        most = max(fluids, key=lambda f: need[id(f)])
        cell = most.cell * (total / (SPARE * there)) ** (1.0 / max(len(most.axes), 1))
        raise SceneError(Problem(most.path, f"{'x'.join(map(str, most.shape))} cells take {need[id(most)] / 1e9:.3g} GB"
                                 f"{f', all fluids {total / 1e9:.3g} GB' * (len(fluids) > 1)}; free on {b.model.device} are "
                                 f"{there / 1e9:.3g} GB; give cells of {cell:.3g} m or more, or a smaller box"))
