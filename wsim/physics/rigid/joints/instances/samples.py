"""What results hold of bodies that are instances of a PointInstancer."""

import numpy as np

from wsim.scene.samples import InstanceSample, Sample


def instancer_samples(method, poses: np.ndarray, rows: list[int]) -> list[Sample]:
    """An instancer each. method: of rigid bodies; poses: of all with their stretch (n, 4, 4) [m]; rows: those of instances."""
    where: dict[str, list[int]] = {}
    for k in rows:
        where.setdefault(method.bodies[k][0].instancer, []).append(k)
    first = np.array([_stretched_start_pose(body) for body, _ in method.bodies])
    moved, centers = poses @ np.linalg.inv(first), method.origin + method.get("x") + method.get("e")
    v, w = method.velocities(), method.spins()
    return [InstanceSample(path, np.array([method.bodies[k][0].instance for k in own]), moved[own], centers[own], v[own],
                           w[own])
            for path, own in where.items()]


def _stretched_start_pose(body) -> np.ndarray:
    M = body.motion.at(0.0).copy()
    if body.stretch is not None:
        M[:3, :3] = M[:3, :3] @ body.stretch
    return M
