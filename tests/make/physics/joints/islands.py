"""What tests/physics/joints/test_islands.py shares with other tests: chain."""

from tests.physics.joints.make import rod, start
from wsim.physics.rigid.joints.joint import spherical_joint


def chain(heavy: float, **more):
    things, last = [], None
    for k in range(20):
        mass, inertia = (heavy, 0.4) if k == 19 else (1.0, 4e-3)
        body = rod(f"/b{k}", (0.2 * k + 0.1, 0.0, 0.0), mass=mass, moments=(0.25 * inertia, inertia, inertia))
        things += [body, spherical_joint(f"/j{k}", last, body, at=(0.2 * k, 0.0, 0.0))]
        last = body
    return start(*things, **more)
