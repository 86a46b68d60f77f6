"""How much memory bodies of particles take, known before any is taken; and the cells that fit where it is too much."""

from collections.abc import Iterator
from math import ceil

import numpy as np

from wsim.physics.fluid.memory import SPARE, free_device_bytes
from wsim.physics.mpm.objects import ACROSS, MaterialPoints
from wsim.physics.mpm.seeding import coarsened, fill_shape
from wsim.scene import Problem, Scene, SceneError
from wsim.scene.check.objects import object_warning

HOST = 400               # bytes of a particle while they are placed
KEPT, CONSTANT = 32, 1   # numbers of a particle that outlive a frame, twice there; and that do not
INTEGERS = 12            # of a particle: nodes, twice, row, whether it is there, twice, order, block, rank
SAMPLES = 24             # cells across of the coarse lattice that counts particles beforehand


def estimated_particles(thing: MaterialPoints, scene: Scene) -> int:
    """Particles of a body, or that it pours in the frames of the scene."""
    if thing.points is not None:
        return len(thing.points)
    if thing.pour:
        return thing.pouring_shape().count_until(scene.frames / scene.fps)
    coarse = coarsened(thing, SAMPLES)
    return ceil(len(fill_shape(coarse)) * (coarse.cell / thing.cell) ** 3)


def particle_bytes(count: int, width: int, sides: bool) -> int:
    """Bytes of so many particles. width: of a number; sides: threads run side by side, and what nodes read is sorted."""
    return count * (width * (2 * KEPT + CONSTANT + 16 * sides) + 4 * INTEGERS)


def block_bytes(blocks: int, width: int, sides: bool) -> int:
    """Bytes of so many blocks of 64 cells with their table."""
    return blocks * (64 * (4 * width + 8) + 27 * 4 + 8 + 4 * 12 + 4 * width * (27 * 64 if sides else 216))


def refuse_large_bodies(things: list[MaterialPoints], b) -> None:
    """Raises SceneError, by the path of the greatest, where they do not fit."""
    width, device, sides = b.model.dtype().nbytes, b.model.device, b.model.device.is_cuda
    counts = [estimated_particles(thing, b.scene) for thing in things]
    blocks = [n // (64 * ACROSS**3) + 8 for n in counts]
    need = [b.model.worlds * (particle_bytes(n, width, sides) + block_bytes(2 * m, width, sides))
            for n, m in zip(counts, blocks, strict=True)]
    host = [HOST * n for n in counts]
    for total, there, where in ((sum(need) + (0 if sides else sum(host)), free_device_bytes(device), str(device)),
                                (sum(host), free_device_bytes(_Host), "the host")):
        if total > SPARE * there:
            k = int(np.argmax(need))
            cell = things[k].cell * (total / (SPARE * there)) ** (1.0 / 3.0)
            mend = f"give cells of {cell:.3g} m or more" if things[k].points is None else "give fewer points"
            raise SceneError(Problem(things[k].path, f"about {counts[k]:.3g} particles take {need[k] / 1e9:.3g} GB, all bodies "
                                     f"{sum(need) / 1e9:.3g} GB; allowed: {SPARE * there / 1e9:.3g} GB of what is free on "
                                     f"{where}; fix: {mend}, or a smaller shape"))


class _Host:
    is_cuda = False


def check_memory(thing: MaterialPoints, scene: Scene) -> Iterator[Problem]:
    """A warning of a body that takes more than is free here, in single precision; a GPU may have more."""
    count = estimated_particles(thing, scene)
    blocks, there = 2 * (count // (64 * ACROSS**3) + 8), free_device_bytes(_Host)
    need = particle_bytes(count, 4, False) + block_bytes(blocks, 4, False)
    if need + HOST * count > SPARE * there:
        yield object_warning(thing.path, f"about {count:.3g} particles take {(need + HOST * count) / 1e9:.3g} GB",
                             f"up to {SPARE * there / 1e9:.3g} GB, which are free here",
                             "give larger cells, or a smaller shape")
