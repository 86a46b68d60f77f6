"""Scenes of bodies that keep their shape in clusters, by shape matching."""

import numpy as np

from tools.scenes.cloth import cloth, material
from tools.scenes.grains import camera
from tools.usda import block, ground, listed, number, pin, said, scene, settings
from wsim.scene import shapes

HELD = '["PhysicsDeformableBodyAPI", "WsimShapeMatchingAPI"]'


def lattice(cells: int, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Points of a cube about the origin, inside too, and the quads of its surface, wound outward."""
    n = cells + 1
    a = np.arange(n)
    ids = np.stack(np.meshgrid(a, a, a, indexing="ij"), axis=-1).reshape(-1, 3)
    number_of = np.arange(n**3).reshape(n, n, n)
    quads = []
    for axis in range(3):
        for end, flip in ((0, True), (cells, False)):
            face = np.take(number_of, end, axis=axis)
            quad = np.stack([face[:-1, :-1], face[1:, :-1], face[1:, 1:], face[:-1, 1:]], axis=-1).reshape(-1, 4)
            quads.append(quad[:, ::-1] if flip != (axis == 1) else quad)
    return (ids / cells - 0.5) * size, np.concatenate(quads)


def rounded(points: np.ndarray, part: float) -> np.ndarray:
    """A cube's points drawn towards those of a ball, `part` of the way."""
    far = np.abs(points).max(axis=1)
    length = np.maximum(np.linalg.norm(points, axis=1), 1e-12)
    return points * (1.0 - part + part * far / length)[:, None]


def turned(points: np.ndarray, axis, angle: float) -> np.ndarray:
    """Points turned about an axis by an angle [rad] (Rodrigues)."""
    k = np.asarray(axis, float) / np.linalg.norm(axis)
    return points * np.cos(angle) + np.cross(k, points) * np.sin(angle) + np.outer(points @ k, k) * (1.0 - np.cos(angle))


def body(name: str, points: np.ndarray, quads: np.ndarray, color, mass: float, comment: str, **more) -> str:
    """The Mesh of a body of clusters; points inside its surface belong to it too."""
    stiffness = "double wsim:stiffness = inf\n" if more.pop("rigid", False) else ""
    lines = [f"float3[] extent = {listed(np.array([points.min(axis=0), points.max(axis=0)]))}",
             f"point3f[] points = {listed(points)}", f"int[] faceVertexCounts = {listed(np.full(len(quads), 4))}",
             f"int[] faceVertexIndices = {listed(quads.ravel())}", 'uniform token subdivisionScheme = "none"',
             f"color3f[] primvars:displayColor = [({', '.join(number(c) for c in color)})]",
             said("Body", 1.0, mass=mass), stiffness + said("Clusters", 1.0, radius=0.003, self_collision=True, **more)]
    return block("Mesh", name, "\n".join(lines), HELD, comment)


def jelly_clusters_on_cloth() -> str:
    surface = shapes.sheet(1.3, 1.3, 24, 24, horizontal=True)
    points = np.asarray(surface[0], float)
    points = points - points.mean(axis=0) + [0.0, 0.75, 0.0]
    corners = np.flatnonzero(np.abs(points[:, [0, 2]]).sum(axis=1) > 1.2)
    cube, quads = lattice(4, 0.22)
    ball, faces = lattice(5, 0.26)
    return scene("Two jellies and a rigid die fall on a cloth, and keep their shape by shape matching.", [
        settings(solver="xpbd", substeps=72, iterations=6, comment="Sweeps: clusters are projected among the constraints of "
                 "the cloth."),
        material("sailcloth", damping=1e-3),
        cloth("Cloth", (points, *surface[1:]), "sailcloth", (0.16, 0.26, 0.42), "1.3 m square, held at its corners. "
              "wsim:selfCollision: surfaces with it do not pass through each other.", self_collision=True),
        block("Xform", "Posts", ""),
        pin("Corners", "/World/Cloth", corners, "/World/Posts", "Three points of each corner."),
        body("Jelly", turned(cube, (1, 0.3, 0.5), 0.7) + [-0.2, 1.0, 0.05], quads, (0.72, 0.08, 0.07), 0.5,
             "Eight clusters that overlap: it bends, and wobbles at up to 10 Hz.", stiffness=4e3, damping=0.002, spacing=0.12),
        body("Ball", rounded(ball, 1.0) + [0.16, 1.12, -0.04], faces, (0.1, 0.5, 0.16), 0.4,
             "One cluster of all points: it stretches as a whole.", stiffness=2.5e3, damping=0.002),
        body("Die", turned(rounded(cube, 0.15) * 0.8, (0.2, 1.0, 0.6), 0.9) + [-0.02, 1.5, 0.0], quads, (0.85, 0.8, 0.68), 0.4,
             "A rigid cluster.", rigid=True),
        ground(), camera((1.2, 1.5, 1.55), 37.5, -29.0)], frames=72)


CLUSTER_SCENES = {"jelly_clusters_on_cloth": jelly_clusters_on_cloth}
