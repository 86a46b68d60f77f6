"""Scenes of random draws: draw k is of kind k mod 7, its prims are placed as k mod 3 says, and its number seeds all else.

    drop       a sheet falls on a floor                        throw    two sheets meet at 20 m/s, and turn
    scrunch    all points of a sheet fly inwards               drape    a sheet on a mesh collider that goes and turns
    solids     a sheet on a ball, a box and a capsule          stack    three sheets at angles fall on each other on a floor
    soft       a sheet between two soft blocks that meet at 8 m/s; not by XPBD


Prims (k mod 3): 0 those of the world; 1 turned, scaled (by 0.01 to 100, and by up to 2 along axes) and up to 1 km away with all
that is near; 2 turned and scaled alike, their points up to 1 km from their origins. Of nine in a hundred (k mod 11 = 5) sheets
have 2000 to 5000 points together, of the others 64 to 300 each.
"""

import numpy as np

from wsim.scene import Box, Capsule, Motion, Plane, Scene, Sphere, Surface, shapes
from wsim.scene.fabric import Fabric

SOLVERS = {
    "xpbd": {"solver": "xpbd", "integrator": "backward_euler", "iterations": 4},
    "xpbd bdf2": {"solver": "xpbd", "integrator": "bdf2", "iterations": 4},
    "newton": {"solver": "implicit", "integrator": "backward_euler", "iterations": 2},
    "newton bdf2": {"solver": "implicit", "integrator": "bdf2", "iterations": 2},
    "newton midpoint": {"solver": "implicit", "integrator": "implicit_midpoint", "iterations": 6},
    "leapfrog": {"solver": "explicit", "integrator": "leapfrog"},
    "rk4": {"solver": "explicit", "integrator": "rk4"}}
KINDS = ("drop", "throw", "scrunch", "drape", "solids", "stack", "soft")
LARGE, EDGE, SPEED, FAR = 11, 0.03, 20.0, 3.0              # every so many; [m]; [m/s]; decades of metres


def turn(rng) -> np.ndarray:
    """A random rotation, (3, 3)."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return q * np.linalg.det(q)


class Draw:
    """The scene of a draw. counts of points: `side` of a sheet; places and speeds are those of the middle of the scene."""

    def __init__(self, k: int, solver: str):
        self.rng, self.kind, self.prims = np.random.default_rng(k), KINDS[k % len(KINDS)], k % 3
        self.sheets = {"throw": 2, "stack": 3}.get(self.kind, 1)
        large = k % LARGE == LARGE // 2
        self.side = int((self.rng.uniform(2000.0, 5000.0) / self.sheets) ** 0.5 if large else self.rng.uniform(8.0, 17.5))
        self.edge = EDGE if not large else 0.4 * EDGE
        self.size = self.edge * (self.side - 1)
        self.fabric = Fabric(stretch=300.0, shear=80.0, bend=1e-6, thickness=0.1 * self.edge, density=100.0)
        self.centre = self.way() if self.prims == 1 else np.zeros(3)
        steps = {"explicit": 150 if large else 60}              # shorter edges, higher frequencies
        falls = self.kind in ("drop", "drape", "solids", "stack")
        settings = {"substeps": steps.get(SOLVERS[solver]["solver"], 12)} | SOLVERS[solver]
        self.scene = Scene(gravity=(0.0, -9.81 if falls else 0.0, 0.0), fps=60.0, **settings)
        getattr(self, self.kind)()

    @property
    def able(self) -> bool:
        """Whether its solver has what the draw needs: XPBD has no tetrahedra."""
        return not (self.scene.softs and self.scene.solver == "xpbd")

    def way(self) -> np.ndarray:
        """1 m to 1 km, anywhere."""
        v = self.rng.normal(size=3)
        return v / np.linalg.norm(v) * 10.0 ** self.rng.uniform(0.0, FAR)

    def frame(self) -> np.ndarray:
        """Frame of a prim."""
        M = np.eye(4)
        if self.prims:
            stretch = 10.0 ** self.rng.uniform(-2.0, 2.0) * 2.0 ** self.rng.uniform(-0.5, 0.5, size=3)
            M[:3, :3] = turn(self.rng) * stretch
            M[:3, 3] = self.centre + (self.rng.normal(size=3) if self.prims == 1 else self.way())
        return M

    def local(self, points, velocities) -> tuple:
        """Points and velocities of the scene's middle, as a prim of its own has them."""
        M = self.frame()
        inverse = np.linalg.inv(M[:3, :3]).T
        return (points + self.centre - M[:3, 3]) @ inverse, np.asarray(velocities) @ inverse, Motion.still(M)

    def sheet(self, place=None) -> tuple:
        """A flat sheet about the origin: points, turned at random or as `place` says (3, 3), and faces."""
        points, counts, indices = shapes.sheet(self.size, self.size, self.side - 1, self.side - 1, horizontal=True)
        points = np.array(points, np.float64)
        return (points - points.mean(axis=0)) @ (turn(self.rng) if place is None else place).T, counts, indices

    def cloth(self, name: str, points, faces, velocities) -> None:
        local, v, motion = self.local(points, velocities)
        self.scene.cloth(name, local, *faces, material=self.fabric, self_collision=True, velocities=v, motion=motion)

    def collider(self, name: str, shape, at=(0.0, 0.0, 0.0), turned=None, goes=(0.0, 0.0, 0.0), rate: float = 0.0) -> None:
        """A collider that goes [m/s] and turns about y [rad/s]."""
        times = np.linspace(0.0, 1.0, 61) if rate or any(goes) else np.zeros(1)
        M = np.tile(np.eye(4), (len(times), 1, 1))
        c, s = np.cos(rate * times), np.sin(rate * times)
        M[:, 0, 0], M[:, 2, 2], M[:, 0, 2], M[:, 2, 0] = c, c, s, -s
        M[:, :3, :3] = M[:, :3, :3] @ (np.eye(3) if turned is None else turned)
        M[:, :3, 3] = self.centre + np.asarray(at) + times[:, None] * np.asarray(goes)
        self.scene.collider(name, shape, motion=Motion(times, M))

    def above(self, points, height: float) -> np.ndarray:
        points[:, 1] += height - points[:, 1].min()
        return points

    def falling(self, height: float, points=None, faces=None) -> None:
        """A sheet that falls from a height, at 1 to 5 m/s."""
        if points is None:
            points, *faces = self.sheet()
        speed = self.rng.uniform(1.0, 5.0)
        self.cloth(f"/sheet{len(self.scene.cloths)}", self.above(points, height), faces,
                   np.tile((0.0, -speed, 0.0), (len(points), 1)))

    def drop(self) -> None:
        self.falling(5e-3)
        self.collider("/floor", Plane("Y"))

    def throw(self) -> None:
        apart = 0.5 * self.size * 2.0 ** 0.5 + 0.02        # half the way between two, whichever way they turn
        for sign in (-1.0, 1.0):
            points, *faces = self.sheet()
            spin, aside = self.rng.normal(size=3) * 10.0, self.rng.normal(size=3) * 0.1 * self.size * (0.0, 1.0, 1.0)
            v = np.array((0.5 * SPEED * -sign, 0.0, 0.0)) + np.cross(spin, points)
            self.cloth(f"/sheet{len(self.scene.cloths)}", points + aside + (sign * apart, 0.0, 0.0), faces, v)

    def scrunch(self) -> None:
        rng, (points, *faces) = self.rng, self.sheet()
        speed = rng.uniform(2.0, SPEED)
        waves = sum(np.outer(np.sin(points @ (rng.normal(size=3) * 9.0 / self.size) + rng.uniform(0, 6)), rng.normal(size=3))
                    for _ in range(4))
        self.cloth("/sheet0", points, faces, -speed * points / (0.5 * self.size) + 0.25 * speed * waves)

    def drape(self) -> None:
        r, rng = 0.3 * self.size, self.rng
        mesh = (shapes.sphere(r, 8), shapes.cone(0.6 * r, r, 5), shapes.box((0.5 * r, 0.9 * r, 0.4 * r)))[rng.integers(3)]
        solid = Surface(np.array(mesh[0], np.float32), *mesh[1:])
        self.collider("/under", solid, turned=turn(rng), goes=rng.normal(size=3) * 0.3, rate=rng.uniform(-4.0, 4.0))
        self.falling(r * 2.0 ** 0.5 + 0.02, *self.tilted())

    def solids(self) -> None:
        r, rng = 0.12 * self.size, self.rng
        for j, shape in enumerate((Sphere(r), Box((r, 0.6 * r, 0.8 * r)), Capsule(0.5 * r, r))):
            at = (0.3 * self.size * np.cos(2.1 * j), 0.0, 0.3 * self.size * np.sin(2.1 * j))
            self.collider(f"/solid{j}", shape, at, turn(rng), (0.0, rng.uniform(0.0, 0.5) * (j == 1), 0.0))
        self.falling(r * 2.0 + 0.02, *self.tilted())

    def tilted(self) -> tuple:
        """A sheet that lies, but for a fifth of a radian at most about an axis."""
        a = self.rng.uniform(-0.2, 0.2)
        points, *faces = self.sheet(np.array([[np.cos(a), -np.sin(a), 0.0], [np.sin(a), np.cos(a), 0.0], [0.0, 0.0, 1.0]]))
        return points, faces

    def stack(self) -> None:
        height = 5e-3
        for _ in range(self.sheets):
            points, faces = self.tilted()
            self.falling(height, points, faces)
            height = points[:, 1].max() + 5e-3
        self.collider("/floor", Plane("Y"))

    def soft(self) -> None:
        half = 0.3 * self.size
        for sign in (-1.0, 1.0):
            points, tets = shapes.block((2.0 * half,) * 3, (3, 3, 3))
            points = (np.array(points) - np.mean(points, axis=0)) @ turn(self.rng).T
            v = np.tile((-4.0 * sign, 0.0, 0.0), (len(points), 1))
            local, v, motion = self.local(points + (sign * (half * 3.0 ** 0.5 + 0.02), 0.0, 0.0), v)
            self.scene.soft(f"/block{len(self.scene.softs)}", local, tets, self_collision=True, velocities=v, motion=motion)
        points, *faces = self.sheet(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
        self.cloth("/sheet0", points, faces, np.zeros_like(points))


def drawn(k: int, solver: str) -> Scene:
    """The scene of draw k, stepped by one of SOLVERS."""
    return Draw(k, solver).scene
