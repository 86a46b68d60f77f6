"""What tests of two folders compare the example scenes with, and the solid angle of a surface."""

import numpy as np

GRAINS = {"snowball": 2156, "jelly_cubes": 4896, "hourglass": 4216, "sand_castle": 5340,
          "sand_on_cloth": 464}                        # particles
CLUSTERS = {"jelly_clusters_on_cloth": (125, 216, 125)}      # points of each body
PARTICLES = {"sand_shovel": (1960,), "beads_in_bowl": (0, 0, 0), "two_waters": (2400,)}       # of each prim, at the start


def solid_angle(points, triangles, places) -> np.ndarray:
    """Of a closed surface as seen from places, over 4 pi: 1 inside, 0 outside (van Oosterom, Strackee 1983)."""
    inside = np.empty(len(places))
    for k, place in enumerate(places):
        a, b, c = (points[triangles] - place).transpose(1, 0, 2)
        la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
        above = np.einsum("ij,ij->i", a, np.cross(b, c))
        below = (la * lb * lc + np.einsum("ij,ij->i", a, b) * lc + np.einsum("ij,ij->i", b, c) * la
                 + np.einsum("ij,ij->i", c, a) * lb)
        inside[k] = np.sum(np.arctan2(above, below)) / (2.0 * np.pi)
    return inside
