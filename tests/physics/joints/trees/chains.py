"""Chains of boxes, and the equations of constrained bodies that accelerations of trees are compared with."""

import numpy as np

from wsim import Box, Scene
from wsim.geometry import rotation


def chain_scene(kinds, free=False, **settings) -> Scene:
    """A chain of boxes of 0.5 m along x, which touch nothing, whose joints are of these kinds about a skew axis."""
    scene = Scene(**({"coordinates": "reduced", "fps": 60} | settings))
    last = scene.body("/root", Box((0.1, 0.2, 0.3)), spin=(1.0, 2.0, -1.0)) if free else None
    for k, kind in enumerate(kinds):
        body = scene.body(f"/b{k}", Box((0.25, 0.02, 0.03)), at=(0.25 + 0.5 * k, 0, 0))
        scene.joint(kind, f"/j{k}", last, body, at=(0.5 * k, 0, 0), axis=(0, 0.6, 0.8))
        last = body
    for body in scene.things("Body"):
        for collider in body.colliders:
            collider.meets = False
    return scene


def trees_of(simulation):
    """(method, trees) of a simulation that has been loaded."""
    method = next(m for m in simulation.plan.methods if m.name == "rigid")
    return method, method.joints


def constrained_accelerations(x, R, v, omega, mass, inertia, gravity, joints):
    """Linear and angular accelerations of bodies (n, 6), from M a + G^T lam = f, G a = -G' u: the Lagrange multipliers of all
    joints at once. joints: (body a or -1, body b, place, axes that neither body may turn about against the other (k, 3), axes
    along which their points may not part (m, 3)), all in the world; axes are fixed in a."""
    n = len(mass)
    M, f, rows, right = np.zeros((6 * n, 6 * n)), np.zeros(6 * n), [], []
    for i in range(n):
        K = R[i] @ np.diag(inertia[i]) @ R[i].T
        M[6 * i:6 * i + 3, 6 * i:6 * i + 3], M[6 * i + 3:6 * i + 6, 6 * i + 3:6 * i + 6] = mass[i] * np.eye(3), K
        f[6 * i:6 * i + 3], f[6 * i + 3:6 * i + 6] = mass[i] * np.asarray(gravity), -np.cross(omega[i], K @ omega[i])
    zero = np.zeros(3)
    for a, b, at, turns, shifts in joints:
        o_a, o_b = omega[a] if a >= 0 else zero, omega[b]
        arms = [at - x[k] if k >= 0 else at for k in (a, b)]
        for e in shifts:
            # n . (p_b - p_a): p_b the point of b, p_a that of a at the same place; n turns with a
            row = np.zeros(6 * n)
            row[6 * b:6 * b + 6] = np.concatenate([e, np.cross(arms[1], e)])
            u = v[b] + np.cross(o_b, arms[1]) - ((v[a] + np.cross(o_a, arms[0])) if a >= 0 else zero)
            rest = e @ np.cross(o_b, np.cross(o_b, arms[1])) - 2.0 * e @ np.cross(o_a, u)
            if a >= 0:
                row[6 * a:6 * a + 6] = -np.concatenate([e, np.cross(arms[0], e)])
                rest -= e @ np.cross(o_a, np.cross(o_a, arms[0]))
            rows.append(row)
            right.append(-rest)
        for e in turns:
            row = np.zeros(6 * n)
            row[6 * b + 3:6 * b + 6] = e
            if a >= 0:
                row[6 * a + 3:6 * a + 6] = -e
            rows.append(row)
            right.append(-np.cross(o_a, e) @ (o_b - o_a))
    G = np.array(rows)
    A = np.block([[M, G.T], [G, np.zeros((len(G), len(G)))]])
    return np.linalg.solve(A, np.concatenate([f, right]))[:6 * n].reshape(n, 6)


def body_frames(simulation):
    """Centres, rotations of principal axes, velocities and angular velocities of the bodies now."""
    method, _ = trees_of(simulation)
    places = method.origin + method.get("x") + method.get("e")
    return places, rotation.quaternion_to_matrix(method.turns()), method.velocities(), method.spins()
