"""What tests/physics/fluid/liquid/test_cups.py shares with other tests: Cup, FPS, KINDS, pose, still, tilted."""

import numpy as np

from tests.physics.fluid.liquid.tanks import particles
from wsim.physics.fluid.liquid.objects import Liquid, LiquidSource
from wsim.scene import Collider, Motion, Scene, Surface
from wsim.scene.solids import Box
from wsim.simulation.simulation import Simulation

FPS = 24


def pose(degrees: float, at) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    M = np.eye(4)
    M[:2, :2], M[:3, 3] = [[c, -s], [s, c]], at
    return M


def boxes(size, wall: float, lid: bool = False) -> list:
    """Walls of a cup with that room within (width, height, depth): (shape, its place in the cup's frame)."""
    W, H, D = size
    t = 0.5 * wall
    floor = Box((0.5 * W + wall, t, 0.5 * D + wall))
    found = [(floor, (0.0, -t, 0.0)), *[(floor, (0.0, H + t, 0.0))] * lid]
    found += [(Box((t, 0.5 * H + t, 0.5 * D + wall)), (s * (0.5 * W + t), 0.5 * H - t, 0.0)) for s in (-1, 1)]
    found += [(Box((0.5 * W + wall, 0.5 * H + t, t)), (0.0, 0.5 * H - t, s * (0.5 * D + t))) for s in (-1, 1)]
    return found


def ring(width: float, depth: float, y: float) -> list:
    return [(0.5 * x * width, y, 0.5 * z * depth) for x, z in ((-1, -1), (1, -1), (1, 1), (-1, 1))]


def mesh(size, wall: float) -> list:
    """The cup as one closed mesh; without a wall as an open sheet, floor and four sides."""
    W, H, D = size
    if wall == 0.0:
        points = ring(W, D, 0.0) + ring(W, D, H)
        faces = [(3, 2, 1, 0)] + [(k, (k + 1) % 4, 4 + (k + 1) % 4, 4 + k) for k in range(4)]
    else:
        outer = ring(W + 2 * wall, D + 2 * wall, -wall) + ring(W + 2 * wall, D + 2 * wall, H)
        points = outer + ring(W, D, H) + ring(W, D, 0.0)
        faces = [(0, 1, 2, 3), (12, 15, 14, 13)]
        for k in range(4):
            faces += [(4 * n + k, 4 * n + 4 + k, 4 * n + 4 + (k + 1) % 4, 4 * n + (k + 1) % 4) for n in range(3)]
    return [(Surface(np.array(points), [4] * len(faces), np.array(faces).ravel()), (0.0, 0.0, 0.0))]


class Cup:
    """A cup in a tank of 1 m, flat or not. cells: its walls; off: of the grid's planes, in cells; path: (seconds) -> pose."""

    def __init__(self, make, cells: float, off: float, path, *, dim: int = 2, n: int = 32, fill: float = 0.2, frames: int = FPS,
                 size=(0.5, 0.5), **more):
        cell = 1.0 / n
        self.wall, self.size, self.frames, self.dim = cells * cell, (*size, 0.4 if dim == 3 else 3.0), frames, dim
        at = np.array([0.5, 0.25, 0.5]) + off * cell
        self.path = lambda t: path(t, at)
        scene = Scene(fps=FPS, frames=frames)
        scene.add(Liquid("/tank", (0, 0, 0), (1, 1, 1 if dim == 3 else cell), cell))
        water = self.path(0.0) @ pose(0.0, (0.0, 0.5 * fill, 0.0))
        scene.add(LiquidSource("/water", Box((0.5 * self.size[0], 0.5 * fill, 0.5 * self.size[2])), Motion.still(water)))
        times = np.arange(frames + 1) / FPS
        for k, (shape, place) in enumerate(make(self.size, self.wall, **more)):
            M = np.array([self.path(t) @ pose(0.0, place) for t in times])
            scene.colliders.append(Collider(f"/cup{k}", shape, Motion(times, M)))
        self.sim = Simulation(scene, device="cpu")
        self.count = len(particles(self.sim)["x"])
        self.height = self.count * (0.5 * cell) ** dim / np.prod(self.size[:2 * dim - 3:2])
        self.most = 0                                          # of particles outside, at the end of any frame
        for k in range(frames):
            self.sim.step()
            self.most = max(self.most, self.outside(k + 1))

    def outside(self, frame: int | None = None) -> int:
        """Particles beyond the middle of a wall, over the rim, or gone, where a frame ends."""
        M, x = self.path((self.frames if frame is None else frame) / FPS), particles(self.sim)["x"]
        q = (x - M[:3, 3]) @ M[:3, :3]
        low = -0.5 * self.wall
        beyond = (q[:, 1] < low) | (q[:, 1] > self.size[1]) | (np.abs(q[:, 0]) > 0.5 * self.size[0] - low)
        if self.dim == 3:
            beyond |= np.abs(q[:, 2]) > 0.5 * self.size[2] - low
        return int(beyond.sum()) + self.count - len(x)

    def center(self) -> float:
        """Mean height over the origin of the cup [m]."""
        return float(particles(self.sim)["x"][:, 1].mean() - self.path(self.frames / FPS)[1, 3])

    def stands(self, degrees: float) -> float:
        """What that is of a level surface [m]."""
        a, h = np.radians(degrees), self.height
        return (np.cos(a) * (0.5 * h + (self.size[0] * np.tan(a)) ** 2 / (24.0 * h))
                - np.sin(a) * np.tan(a) * self.size[0] ** 2 / (12.0 * h))


def still(degrees: float):
    return lambda t, at: pose(degrees, at)


def tilted(seconds: float):
    """By 30 degrees."""
    return lambda t, at: pose(30.0 * min(t / seconds, 1.0), at)


KINDS = {"box": boxes, "mesh": mesh, "sheet": mesh}
