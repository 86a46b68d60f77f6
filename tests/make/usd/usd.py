"""What tests/usd/test_usd.py shares with other tests: _cloth, _difference, _motion, _scene."""

from dataclasses import fields
from math import inf

import numpy as np

from wsim.geometry.rotation import axis_rotation_matrix
from wsim.scene import Box, Capsule, Cloth, Collider, Cone, Cylinder, Pin, Plane, Scene, Sphere, Springs, Surface
from wsim.scene.bodies import equal_values
from wsim.scene.curve import Curve, Motion
from wsim.scene.fabric import Fabric


def _turned(rng) -> np.ndarray:
    axis = rng.normal(size=3)
    return axis_rotation_matrix(axis / np.linalg.norm(axis), rng.uniform(0.0, 3.0))


def _matrix(rng, rigid: bool, far: float) -> np.ndarray:
    M = np.eye(4)
    M[:3, :3] = _turned(rng)
    if not rigid:                       # scaled, sheared and, half of the time, mirrored
        M[:3, :3] = M[:3, :3] @ np.diag(rng.uniform(0.5, 2.0, 3) * rng.choice([-1.0, 1.0])) @ _turned(rng)
    M[:3, 3] = rng.normal(size=3) + far
    return M


def _motion(rng, rigid: bool = True) -> Motion:
    far = rng.choice([0.0, 1000.0])
    kind = rng.integers(4)
    if kind == 0:
        return Motion.still()
    if kind == 1:
        return Motion.at_place(rng.normal(size=3) + far)
    keys = 1 if kind == 2 else int(rng.integers(2, 5))
    times = np.zeros(1) if keys == 1 else np.sort(rng.uniform(-0.2, 3.0, keys))
    return Motion(times, [_matrix(rng, rigid, far) for _ in range(keys)])


def _fabric(rng) -> Fabric:
    return Fabric(*rng.uniform(1e-6, 1e3, 3), thickness=rng.uniform(1e-4, 1e-2), density=rng.uniform(10, 900),
                  poisson=rng.choice([0.0, rng.uniform(-0.9, 0.49)]), damping=rng.uniform(0.0, 0.1),
                  strain_limit=rng.choice([inf, 0.1]), static_friction=rng.uniform(), dynamic_friction=rng.uniform())


def _sheet(rng):
    points = rng.normal(size=(9, 3)).astype(np.float32)       # two quads, a triangle, a pentagon
    return points, [4, 4, 3, 5], [0, 1, 4, 3, 1, 2, 5, 4, 3, 4, 7, 4, 5, 8, 7, 6]


def _cloth(rng, path: str) -> Cloth:
    def maybe(value):
        return value if rng.uniform() < 0.5 else None

    return Cloth(path, *_sheet(rng), material=_fabric(rng), motion=_motion(rng, rigid=False),
                 velocities=maybe(rng.normal(size=(9, 3))), rest_points=maybe(rng.normal(size=(9, 3))),
                 masses=maybe(rng.uniform(0.1, 1.0, 9)), mass=maybe(rng.uniform()),
                 thicknesses=maybe(rng.uniform(1e-3, 2e-3, 9)),
                 model=str(rng.choice(["membrane", "springs"])), flat=bool(rng.integers(2)), weld=rng.uniform(0.0, 0.1),
                 tethers=bool(rng.integers(2)), drag=rng.uniform(), lift=rng.uniform())


def _net(rng, path: str) -> Springs:
    edges = [(0, 1), (1, 2), (2, 0), (2, 4), (1, 4)]           # points shared; point 3 is held by nothing
    return Springs(path, rng.normal(size=(5, 3)), edges, rng.uniform(1.0, 9.0, rng.choice([1, 5])),
                   rng.uniform(0.1, 1.0, rng.choice([1, 5])),
                   lengths=rng.uniform(0.5, 1.0, 5) if rng.integers(2) else None,
                   damping=rng.uniform(), radius=rng.choice([0.0, 0.01]), motion=_motion(rng, rigid=False),
                   velocities=rng.normal(size=(5, 3)) if rng.integers(2) else None, static_friction=rng.uniform(),
                   **_muscles(rng))


def _muscles(rng) -> dict:
    """None, one group of all springs that does not change, or two of some that do, at keys that are no frames."""
    if not rng.integers(3):
        return {}
    if not rng.integers(2):
        return {"actuation": Curve(rng.choice([[0.0], [0.2]]), rng.uniform(0.5, 1.5, (1, 1)))}
    return {"actuation": Curve(np.cumsum(rng.uniform(0.01, 0.3, 4)), rng.uniform(0.5, 1.5, (4, 2))),
            "muscles": np.array([0, -1, 1, 1, -1])}


def _shapes(rng) -> list:
    points, counts, indices = _sheet(rng)
    poses = Curve([0.0, 0.31, 1.7], rng.normal(size=(3, 9, 3)).astype(np.float32))
    return [Plane(), Sphere(rng.uniform()), Box(tuple(rng.uniform(0.1, 1.0, 3))), Capsule(rng.uniform(), rng.uniform()),
            Cylinder(rng.uniform(), rng.uniform()), Cone(rng.uniform(), rng.uniform()),
            Surface(points, counts, indices), Surface(points, counts, indices, poses)]


def _scene(seed: int) -> Scene:
    rng = np.random.default_rng(seed)
    solver, integrator = rng.choice([("auto", "auto"), ("explicit", "rk4"), ("auto", "bdf2"), ("implicit", "auto")])
    scene = Scene(gravity=tuple(rng.normal(size=3)), wind=tuple(rng.normal(size=3)), air_density=rng.uniform(),
                  air_drag=rng.uniform(), up=str(rng.choice(["Y", "Z"])), fps=float(rng.choice([24.0, 29.97, 1000.0])),
                  start=float(rng.choice([0.0, 1.0, 1001.5])), frames=int(rng.integers(0, 50)),
                  substeps=int(rng.integers(1, 30)), iterations=int(rng.integers(1, 9)),
                  solver=str(solver), integrator=str(integrator), error=rng.uniform(1e-4, 0.1))
    scene.cloths = [_cloth(rng, "/World/a/cloth"), _cloth(rng, "/cloth"), _cloth(rng, "/World/b")]
    scene.springs = [_net(rng, "/net"), _net(rng, "/World/a/net")]
    scene.colliders = [Collider(f"/World/collider{i}", shape, _motion(rng), *rng.uniform(size=2),
                                thickness=rng.choice([0.0, 0.01]))
                       for i, shape in enumerate(_shapes(rng))]
    frame = _motion(rng)
    scene.pins = [Pin("/pins", "/cloth", [0, 3, 8], motion=_motion(rng)),
                  Pin("/cloth/pin", "/cloth", [5], target="/World/hook", motion=frame, places=rng.normal(size=(1, 3))),
                  Pin("/World/pin", "/net", [4, 3, 0], target="/World/hook", motion=frame, stiffness=rng.uniform(),
                      damping=rng.uniform())]
    return scene


def _difference(a, b, where="scene") -> str:
    """Path of the first field that differs, for a readable failure."""
    if hasattr(a, "__dataclass_fields__") and type(a) is type(b):
        for f in fields(a):
            if f.compare and f.name != "parts":
                found = _difference(getattr(a, f.name), getattr(b, f.name), f"{where}.{f.name}")
                if found:
                    return found
        return ""
    if isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        pairs = enumerate(zip(a, b, strict=True))
        return next(filter(None, (_difference(x, y, f"{where}[{i}]") for i, (x, y) in pairs)), "")
    return "" if equal_values(a, b) else f"{where}: {a!r} is not {b!r}"
