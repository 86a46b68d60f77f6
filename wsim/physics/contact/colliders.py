"""The table of colliders: one row for each object and collider that may touch, in float64 on the host. NumPy only.

Objects are the bodies of all worlds, each with an origin of its own [m]; a row holds its collider relative to the
origin of its object, so that nothing is lost far from the scene's origin. Rows of an object stand together, in the
order of the colliders: the order of contacts follows from it.
"""

from dataclasses import dataclass, replace
from math import inf

import numpy as np

from wsim.geometry.rotation import matrix_quat
from wsim.physics.contact.collider.mesh import ColliderMesh
from wsim.physics.contact.collider.rows import foot_of_planes
from wsim.scene import Collider, Problem, SceneError, Surface
from wsim.scene.check import chord
from wsim.scene.check.sharp import has_sharp_edges
from wsim.scene.solids import shape_row

RIGID = 1e-4           # how far a collider's axes may be from orthonormal: float32 matrices of a stage reach 1e-6


def collider_kernel_size(collider: Collider, mesh: ColliderMesh | None) -> tuple[str, tuple[float, float, float], float]:
    """Kind, sizes as the kernels have them and radius of the bounding ball about the shape's own origin [m].
    Raises SceneError naming the collider whose size is not positive and finite."""
    shape = collider.shape
    if isinstance(shape, Surface):
        assert mesh is not None
        return ("solid" if mesh.closed else "sheet"), (mesh.depth, 0.0, 0.0), mesh.radius
    solid = shape_row(shape)
    found, ball = solid.lengths(shape), solid.ball(shape)
    least = [v for name, value in solid.named(shape).items() if name not in solid.vanishing for v in np.atleast_1d(value)]
    if not (np.isfinite(found).all() and min(least, default=1.0) > 0.0 and min(found, default=0.0) >= 0.0):
        raise SceneError(Problem(collider.path, f"the {type(shape).__name__.lower()} has sizes {found} m; every one "
                                 "must be finite and positive; give it a size, or remove the collider"))
    return solid.kind, solid.size(shape), ball


def check_collider_values(collider: Collider) -> None:
    """Raises SceneError where friction, thickness, restitution or motion of a collider make no sense."""
    for name in ("static_friction", "dynamic_friction", "thickness"):
        value = getattr(collider, name)
        if value is not None and not (np.isfinite(value) and value >= 0.0):
            raise SceneError(Problem(collider.path, f"{name} is {value}; allowed is a finite number >= 0"))
    if not 0.0 <= collider.restitution <= 1.0:
        raise SceneError(Problem(collider.path, f"restitution is {collider.restitution}; allowed is a number from 0 to 1"))
    R = collider.motion.values[:, :3, :3]
    off = np.abs(np.swapaxes(R, 1, 2) @ R - np.eye(3)).max(initial=0.0)
    if not np.isfinite(collider.motion.values).all() or off > RIGID or (np.linalg.det(R) < 0).any():
        raise SceneError(Problem(collider.path, f"the collider's motion is not rigid (its axes are {off:.2g} from "
                                 "orthonormal, or mirrored); put scale and mirror into the shape's sizes or points"))


@dataclass
class ColliderRowTable:
    """Columns of the table; `collider[r]` numbers `colliders`, the distinct ones."""

    colliders: list[Collider]            # copies: a live parameter does not change the scene
    meshes: list[ColliderMesh | None]    # of each distinct collider
    first: np.ndarray                    # (objects + 1,) int32
    collider: np.ndarray                 # (rows,) int
    origin: np.ndarray                   # of each row's object [m], (rows, 3)
    kind: list[str]                      # of each distinct collider
    size: np.ndarray                     # [m], (distinct, 3)
    radius: np.ndarray                   # of the bounding ball [m], (distinct,)
    feet: bool = True                    # planes at rest are placed by `foot_of_planes`; gradients turn about their own places

    @staticmethod
    def build(of_objects: list[list[Collider]], origins: np.ndarray, meshes: dict[int, ColliderMesh],
              feet: bool = True) -> "ColliderRowTable":
        """of_objects: colliders of each object; origins [m], (objects, 3); meshes by id of their Surface."""
        number: dict[int, int] = {}
        distinct: list[Collider] = []
        for collider in (c for group in of_objects for c in group):
            if number.setdefault(id(collider), len(distinct)) == len(distinct):
                check_collider_values(collider)
                distinct.append(replace(collider))
        counts = [len(group) for group in of_objects]
        found = [meshes.get(id(c.shape)) for c in distinct]
        shapes = [collider_kernel_size(c, m) for c, m in zip(distinct, found, strict=True)]
        return ColliderRowTable(distinct, found, np.concatenate([[0], np.cumsum(counts)]).astype(np.int32),
                                np.array([number[id(c)] for group in of_objects for c in group], np.int64),
                                np.repeat(np.asarray(origins, np.float64).reshape(-1, 3), counts, axis=0),
                                [s[0] for s in shapes], np.array([s[1] for s in shapes]).reshape(-1, 3),
                                np.array([s[2] for s in shapes], np.float64), feet)

    def live(self, breadth: np.ndarray, reach: np.ndarray, whole: np.ndarray | None = None,
             edged: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Distance kept [m], (rows,), and friction, (rows, 2), which may change while a scene runs. breadth and reach [m] of
        objects, (objects,): what `wsim.scene.check.chord` takes where no thickness is authored. whole: objects of which no
        chord cuts into a mesh, (objects,). edged: rows whose object meets them by its edges, (rows,)."""
        radius = [chord.least_curvature_radius(c) if c.thickness is None else inf for c in self.colliders]
        least = [0.0 if m is None else m.least_gap for m in self.meshes]
        objects = np.repeat(np.arange(len(self.first) - 1), np.diff(self.first))
        gap = []
        for r, (o, k) in enumerate(zip(objects, self.collider, strict=True)):
            own, met = self.colliders[k].thickness, whole is not None and whole[o] and self.meshes[k] is not None
            met = met or (edged is not None and bool(edged[r]))
            gap.append(max(least[k],
                           (0.0 if met else chord.chord_sagitta(breadth[o], radius[k]) - reach[o]) if own is None else own))
        friction = np.array([(c.static_friction, c.dynamic_friction) for c in self.colliders]).reshape(-1, 2)
        return np.array(gap, np.float64), friction[self.collider]

    def sharp(self, edged: np.ndarray | None) -> np.ndarray:
        """Rows of sharp colliders (`wsim.scene.check.sharp`) and objects whose edges meet them, (rows,). edged: these objects,
        (objects,), or None."""
        known = np.array([edged is not None and edged.any() and has_sharp_edges(c) for c in self.colliders],
                         bool)[self.collider]
        return known if edged is None else known & np.repeat(edged, np.diff(self.first))

    def of(self, path: str, objects: list[int]) -> list[int]:
        """Rows of the collider of that path among these objects."""
        return [r for o in objects for r in range(self.first[o], self.first[o + 1])
                if self.colliders[self.collider[r]].path == path]

    @property
    def moves(self) -> bool:
        """True if any collider goes somewhere or deforms."""
        return any(c.motion.moves for c in self.colliders) or any(m is not None and m.moves for m in self.meshes)

    @property
    def most(self) -> int:
        """Rows of the object that has most."""
        return int(np.diff(self.first).max(initial=0))

    @property
    def balls(self) -> int:
        """Rows with a finite bounding ball of the object that has most."""
        before = np.concatenate([[0], np.cumsum(np.isfinite(self.radius)[self.collider])])
        return int(np.diff(before[self.first]).max(initial=0))

    def centers(self) -> np.ndarray:
        """Centres of the bounding balls, in the shapes' own frames [m], (distinct, 3)."""
        return np.array([np.zeros(3) if m is None else m.center for m in self.meshes])

    @staticmethod
    def _turns(R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Quaternions of rotations (n, ..., 3, 3), and of what leads from each to the next, of one of them where none turns."""
        if (R[1:] == R[:1]).all():
            both = matrix_quat(np.stack([R[0], R[0] @ np.swapaxes(R[0], -1, -2)]))
            return np.broadcast_to(both[0], (len(R), *both[0].shape)), np.broadcast_to(both[1], (len(R) - 1, *both[1].shape))
        both = matrix_quat(np.concatenate([R, R[1:] @ np.swapaxes(R[:-1], -1, -2)]))
        return both[:len(R)], both[len(R):]

    def poses(self, times: np.ndarray, number: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(pose, step, ball) at substep times (substeps + 1,) [s]: transforms (substeps + 1, rows, 7) as translation
        and quaternion (x, y, z, w), motions from one to the next (substeps, rows, 7), bounding balls
        (substeps, rows, 4). number: distinct colliders whose rows are wanted, ascending; None: all."""
        number = np.arange(len(self.colliders)) if number is None else number
        motions = [self.colliders[k].motion for k in number]
        M = np.stack([motion.sampled(times) if motion.moves
                      else np.broadcast_to(motion.at(0.0), (len(times), 4, 4)) for motion in motions], axis=1)
        R, p = M[..., :3, :3], M[..., :3, 3]
        turned, turn = self._turns(R)
        middle = (R @ self.centers()[number, :, None])[..., 0] + p
        way = np.linalg.norm(middle[1:] - middle[:-1], axis=-1)
        own = np.flatnonzero(np.isin(self.collider, number))
        row, origin = np.searchsorted(number, self.collider[own]), self.origin[own]
        flat = np.array([self.feet and self.kind[k] == "plane" and not self.colliders[k].motion.moves for k in number],
                        bool)[row]
        pose = np.concatenate([foot_of_planes(p[:, row] - origin, R[:, row], flat), turned[:, row]], axis=-1)
        step = np.concatenate([p[1:, row] - p[:-1, row], turn[:, row]], axis=-1)
        ball = np.concatenate([0.5 * (middle[1:] + middle[:-1])[:, row] - origin,
                               (self.radius[number] + 1.5 * way)[:, row, None]], axis=-1)
        return pose, step, ball
