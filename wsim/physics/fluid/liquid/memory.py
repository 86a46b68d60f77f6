"""How much memory a liquid takes, known before any is taken; and the cells that fit where it is too much."""

from math import ceil

from wsim.physics.fluid.liquid.objects import Liquid
from wsim.physics.fluid.liquid.seeds import estimated_particles
from wsim.physics.fluid.memory import SPARE, free_device_bytes
from wsim.scene import Problem, SceneError

HOST = 64                # bytes of a particle while they are placed


def liquid_memory(liquid: Liquid, particles: int, obstacles: bool, width: int) -> int:
    """Bytes of so many particles and of the grid. width: of a number."""
    dim, affine = len(liquid.axes), liquid.transfer == "apic"
    row = width * 3 * ((2 + 3 * affine) * 3) + 4 * 6 + HOST
    levels = 2 ** dim / (2 ** dim - 1)
    cell = 2 * dim + dim * (liquid.transfer == "flip") + 9 + (dim + 3) * levels + obstacles * (1 + 2 * dim)
    return ceil(row * particles + (width * cell + 4 * (dim + 3)) * liquid.cells)


def refuse_large_liquids(liquids: list[Liquid], b) -> None:
    """Raises SceneError, by the path of the greatest, where they do not fit."""
    width, there = b.model.dtype().nbytes, free_device_bytes(b.model.device)
    of = {id(x): estimated_particles(x, b.scene) for x in liquids}
    need = {id(x): liquid_memory(x, of[id(x)], bool(b.scene.colliders), width) for x in liquids}
    total = sum(need[id(x)] for x in liquids)
    if total > SPARE * there:
        most = max(liquids, key=lambda x: need[id(x)])
        cell = most.cell * (total / (SPARE * there)) ** (1.0 / max(len(most.axes), 1))
        raise SceneError(Problem(most.path, f"about {of[id(most)]:.3g} particles in {'x'.join(map(str, most.shape))} cells take"
                                 f" {need[id(most)] / 1e9:.3g} GB{f', all liquids {total / 1e9:.3g} GB' * (len(liquids) > 1)}; "
                                 f"free on {b.model.device} are {there / 1e9:.3g} GB; give cells of {cell:.3g} m or more, or a "
                                 "smaller box"))
