"""What clusters refuse, in one line each, and gradients by name."""

import numpy as np
import pytest

from tests.physics.soft.clusters.lattice import cube_points
from wsim.scene import Scene, SceneError, shapes
from wsim.simulation.simulation import Simulation

CUBE = cube_points(3, 0.1)
LINE = np.arange(5)[:, None] * np.array([0.1, 0.0, 0.0])


@pytest.mark.parametrize(("points", "more", "said"), [
    (np.zeros((0, 3)), {"mass": 1.0}, "it has no points"),
    (LINE, {"mass": 1.0}, "5 points in a line"),
    (LINE[:1], {"mass": 1.0}, "1 point, whose rotation is not determined"),
    (np.zeros((4, 3)), {"mass": 1.0}, "in a line (or in one place)"),
    (CUBE, {}, "it has no mass"),
    (CUBE, {"mass": 0.0}, "a mass of 0 kg"),
    (CUBE, {"masses": np.r_[0.0, np.ones(26)]}, "1 of 27 masses are too small"),
    (CUBE, {"mass": 1.0, "stiffness": -1.0}, "stiffness is -1.0; allowed: > 0, or inf"),
    (CUBE, {"mass": 1.0, "stiffness": float("nan")}, "stiffness is nan"),
    (CUBE, {"mass": 1.0, "overlap": 2.0}, "overlap is 2"),
    (CUBE, {"mass": 1.0, "sizes": [26, 1], "members": range(27)}, "cluster 1 of 2 has 1 point"),
    (CUBE, {"mass": 1.0, "sizes": [26], "members": range(26)}, "1 of its points are in no cluster, first point 26"),
    (CUBE, {"mass": 1.0, "sizes": [27], "members": [*range(26), 27]}, "members[26] is 27"),
    (CUBE, {"mass": 1.0, "sizes": [27], "members": [*range(26), 0]}, "names a point twice"),
    (CUBE * [1, 1, 0], {"mass": 1.0, "yield_strain": 0.1, "creep": 1.0}, "its clusters are flat, and it has a yield_strain"),
    (CUBE, {"mass": 1.0, "self_collision": True}, "self_collision is on, and it has neither a surface nor a radius"),
])
def test_bad_input_is_one_line(points, more, said):
    scene = Scene(gravity=(0, 0, 0))
    scene.clusters("/jelly", points, **{k: list(v) if isinstance(v, range) else v for k, v in more.items()})
    with pytest.raises(SceneError) as error:
        Simulation(scene, device="cpu")
    lines = str(error.value).splitlines()
    assert len(lines) == 1 and said in lines[0] and lines[0].startswith("/jelly") and "fix:" in lines[0], lines


def test_explicit_steps_are_refused():
    scene = Scene(solver="explicit")
    scene.clusters("/jelly", CUBE, mass=1.0)
    with pytest.raises(SceneError, match="explicit steps have no shape matching, which holds /jelly together"):
        Simulation(scene, device="cpu")


def test_gradients_raise_by_name():
    scene = Scene()
    scene.clusters("/jelly", CUBE, mass=1.0)
    with pytest.raises(SceneError, match="/jelly.*gradients do not go through shape matching"):
        Simulation(scene, device="cpu", gradients=True)


@pytest.mark.parametrize("spacing, parts", [(0.08, True), (0.1, False)])
def test_clusters_without_common_points_are_told_to_part(spacing, parts):
    scene = Scene()
    scene.clusters("/jelly", shapes.block((0.12, 0.12, 0.12), 3, at=(0, 0.3, 0))[0], mass=1.0, spacing=spacing)
    told = [w for w in Simulation(scene, device="cpu").warnings if "share no points" in w]
    assert len(told) == parts and all("wsim:clusterOverlap" in w for w in told)


def test_clusters_that_pass_through_cloth_are_told():
    scene = Scene()
    scene.cloth("/sheet", *shapes.sheet(1.0, 1.0, 4, 4, horizontal=True), self_collision=True)
    scene.clusters("/jelly", CUBE + [0, 1, 0], mass=1.0)
    told = Simulation(scene, device="cpu").warnings
    assert any("/jelly: it has no self_collision: it passes through /sheet" in w for w in told)
