"""Blocks that share sheets and solids, and how much shared memory each needs: sizes of the lists of
`wsim.physics.motion.fused.domain_decomposition`. See kernels/motion/fused/sheet.py."""

from dataclasses import dataclass

import numpy as np

from wsim.kernels.cloth.curvature import SLOTS
from wsim.kernels.motion.fused import tet_elements
from wsim.kernels.motion.fused.limits import limit_memory_words as limits

FOUR, LARGEST = 4, 16  # blocks of a cluster at most
MOST = 1024            # threads of a block
ROOM = 227 * 1024 - 4 * MOST - 1024        # bytes of shared memory of a block, less what Warp keeps there
SEARCHED = 128         # bytes of it in which a thread searches a mesh (Warp's stack, BVH_QUERY_STACK_SIZE of bvh.h)
SEARCHING = 352        # threads whose stacks fit in what a kernel may have without asking, 48 KB


@dataclass(frozen=True)
class BlockPlan:
    """Blocks, and the most that any has of each list (multiples of four)."""

    size: int
    own: int
    points: int
    triangles: int
    bent: int
    hinges: int
    curved: int
    moments: int
    forces: int
    pushes: int
    damped: bool
    air: bool = False
    tets: int = FOUR
    materials: tuple[str, ...] = ()      # of tets: those of kernels/motion/fused/tet_elements.py
    meshes: bool = False                 # colliders are met
    loaded: bool = False
    edges: int = 0                       # with a strain limit, and what else `wsim.physics.motion.fused.limits` has of them
    colours: int = 0
    inbox: int = 0
    guests: int = 0
    letters: int = 0
    firsts: int = 0

    @property
    def grid(self) -> bool:
        """True if blocks are a multiprocessor each and send through global memory, instead of a cluster."""
        return self.size > LARGEST

    @property
    def lanes(self) -> int:
        """Threads that gather the forces of a point."""
        return next(k for k in (8, 4, 2, 1) if k * self.own <= self.threads or k == 1)

    @property
    def threads(self) -> int:
        """Threads of a block: an element each, as far as there are registers, and room for how they search meshes."""
        return int(np.clip(-(-(self.hinges + self.triangles + self.tets) // 32) * 32, 256, SEARCHING if self.meshes else 640))

    @property
    def room(self) -> int:
        """Shared memory that there is [bytes]."""
        return ROOM - SEARCHED * self.threads * self.meshes

    @property
    def words(self) -> int:
        """Shared memory [4 bytes]."""
        vectors = (5 if self.damped or self.air else 3) * self.points + (SLOTS + 1) * self.curved + self.hinges
        reals = 12 * (self.triangles + self.bent) + self.triangles + 2 * self.bent + self.hinges + self.bent
        integers = 2 * (self.triangles + self.hinges) + self.bent + self.moments + 2 * self.own + self.forces + self.pushes
        reals += tet_elements.WORDS * self.tets
        return (FOUR * (vectors + (2 + self.air) * self.triangles) + reals + (1 + 3 * self.air) * self.triangles
                + integers + 4 * FOUR + (limits(self) if self.edges else 0))
