"""The triangles of a cloth that hold explicit steps down. NumPy only.

    omega^2 = 3 s / (rho t (1 - nu^2)) max eigenvalue of sum_k g_k g_k^T       a triangle alone, a third of its mass a corner

g_k [1/m] are the gradients of its barycentric coordinates, s the stiffness along or across the warp [N/m], the greater. No mode
of a mesh is faster than the fastest of its triangles alone (Irons, Treharne 1971), bending apart; a step is stable up to
2 / omega. A sliver of height a has omega about sqrt(6 s / (rho t)) / a.
"""

import numpy as np

from wsim.geometry.triangulate import triangulate_polygons
from wsim.scene import Cloth, Problem, Scene

FEW = 5                # faces that are named
WORSE = 4.0            # times the median frequency from which the fastest triangles are told of, by `wsim check`, and by a run
FAR_WORSE = 10.0       # that takes more substeps than its scene names


def triangle_frequencies(cloth: Cloth) -> tuple[np.ndarray, np.ndarray]:
    """Frequency of each triangle at rest [rad/s], and its face, both (t,); infinite without an area."""
    triangles, face = triangulate_polygons(cloth.points, cloth.counts, cloth.indices)
    p = cloth.motion.points(cloth.points if cloth.rest_points is None else cloth.rest_points, 0.0)[triangles]
    edges = p[:, [2, 0, 1]] - p[:, [1, 2, 0]]                    # opposite of each corner; |g_k| = |edge_k| / (2 area)
    twice = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    m, each = cloth.material, np.einsum("tki,tki->tk", edges, edges)
    trace = each.sum(axis=1)                                     # g g^T turns as the edges do, and has det = 3 / (2 area)^2
    top = 0.5 * (trace + np.sqrt(np.maximum(trace**2 - 12.0 * twice**2, 0.0)))
    fabric = 3.0 * max(m.stretch, m.weft) / (m.density * m.thickness * (1.0 - m.poisson**2))
    with np.errstate(divide="ignore"):
        return np.sqrt(fabric * top) / twice, face


def warn_of_slivers(scene: Scene, steps: int) -> list[Problem]:
    """Warnings of cloths whose fastest triangles are FAR_WORSE than their median, where a frame takes so many steps, more than
    the scene names."""
    return [Problem(path, f"a frame takes {steps} substeps, the scene names {scene.substeps}: {text}", False)
            for path, text in worst_triangles(scene, FAR_WORSE)]


def describe_slivers(scene: Scene) -> list[str]:
    """Words about what the worst triangles of each cloth do to explicit steps."""
    return [f"{path}: {text}" for path, text in worst_triangles(scene, WORSE)]


def worst_triangles(scene: Scene, worse: float) -> list[tuple[str, str]]:
    """Path of each cloth some triangles of which are over so many times as fast as the median one, and words about them."""
    texts = []
    for cloth in scene.cloths:
        omega, face = triangle_frequencies(cloth)
        if not len(omega):
            continue
        top, median = float(omega.max()), float(np.median(omega))
        if top <= worse * median:
            continue
        count = int((omega > worse * median).sum())
        named = list(dict.fromkeys(face[np.argsort(-omega, kind="stable")][:count].tolist()))[:FEW]
        texts.append((cloth.path, f"{count} of {len(omega)} triangles are over {worse:g} times as fast as the median one: "
                      f"alone, the fastest stands explicit steps of {2e6 / top:.3g} us, the median {2e6 / median:.3g} us; the "
                      f"worst are faces {', '.join(map(str, named))} (move their corners apart, or merge short edges)"))
    return texts
