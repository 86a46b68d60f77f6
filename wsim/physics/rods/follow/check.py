"""Problems of strands that follow guides. NumPy only."""

from collections.abc import Iterator

import numpy as np

from wsim.physics.rods.follow.objects import Followers
from wsim.scene import Problem, Scene
from wsim.scene.check.objects import thing_error
from wsim.scene.methods import object_at_path

MEND = "name simulated curves by wsim:guides"


def check(followers: Followers, scene: Scene) -> Iterator[Problem]:
    path, n = followers.path, len(followers.points)
    if followers.counts.min(initial=1) < 1 or followers.counts.sum() != n or not n:
        yield thing_error(path, f"counts sum to {followers.counts.sum()}, the least is {followers.counts.min(initial=0)}",
                           f"1 or more points a strand, {n} in all", "author curveVertexCounts again")
    elif not np.isfinite(followers.points).all():
        k = int(np.flatnonzero(~np.isfinite(followers.points).all(axis=1))[0])
        yield thing_error(path, f"points[{k}] is {followers.points[k].tolist()}", "finite numbers", "author it again")
    yield from _check_guides(followers, scene)


def _check_guides(followers: Followers, scene: Scene) -> Iterator[Problem]:
    path, guides = followers.path, followers.guides
    found, rods = object_at_path(scene, guides), [rods.path for rods in scene.things("Rods")]
    there = f"rods, which are {', '.join(rods) or 'none here'}"
    if found is None:
        yield thing_error(path, f"follows {guides or 'nothing'}, which is not simulated", there, MEND)
    elif isinstance(found, Followers):
        way = [path, guides]
        while isinstance(found, Followers) and found.guides not in way:
            way.append(found.guides)
            found = object_at_path(scene, found.guides)
        circle = isinstance(found, Followers)
        yield thing_error(path, f"follows {guides}, which follows {'in a circle' if circle else 'others itself'} "
                           f"({' to '.join(way)})", there, MEND)
    elif guides not in rods:
        yield thing_error(path, f"follows {guides}, a {type(found).__name__}", there, MEND)
