"""Springs as a solver has them on the device, for whoever changes their rest lengths (`wsim.physics.cloth.nets.muscles`)."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import warp as wp

from wsim.physics.cloth.constraints import Constraints


@dataclass
class SpringTable:
    """length: rest lengths [m] that kernels read; entry: number in the rows of each, -1: padding; given: takes the array of
    rest lengths as they are without what changes them."""

    rows: list[Constraints]
    length: wp.array
    entry: np.ndarray
    given: Callable[[wp.array], None]
