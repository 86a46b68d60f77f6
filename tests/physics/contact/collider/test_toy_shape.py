"""A collider shape of one file and one row (tests/make/rows/rounded.py) goes through all that those of wsim go through."""

import numpy as np
import pytest
import warp as wp
from pxr import Sdf, Usd, UsdGeom

from tests.make.gradient.gradients import Run
from tests.make.rows import rounded
from tests.make.rows.rounded import ROW, Rounded
from wsim.kernels.contact import collide
from wsim.kernels.contact.collider import shape
from wsim.kernels.math.real import types
from wsim.scene import Cylinder, Scene, SceneError, Sphere, Surface, shapes, solids
from wsim.scene.check.scene import check_scene
from wsim.scene.curve import Motion
from wsim.scene.fabric import Fabric
from wsim.show.prim import triangulate_prim
from wsim.simulation.simulation import Simulation
from wsim.usd import load, save

TABLE = Rounded(0.2, 0.1, 0.04)
KEPT = 0.01                # [m]: what the chords of the cloth's mesh hide about a rim of 4 cm is 7.2 mm
UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])       # its axis along y


@pytest.fixture(autouse=True)
def row(monkeypatch):
    monkeypatch.setattr(solids, "SOLIDS", [*solids.SOLIDS, ROW])


def table(damping: float = 2e-3, **more) -> Scene:
    """A cloth just above the rounded table, which is smaller than it, and a ball further down."""
    scene = Scene(**{"fps": 60.0, "substeps": 10, "iterations": 6} | more)
    scene.cloth("/World/cloth", *shapes.sheet(0.5, 0.5, 12, 12, horizontal=True),
                material=Fabric(stretch=200.0, bend=1e-4, damping=damping), motion=Motion.at_place((0.0, 0.112, 0.0)))
    scene.collider("/World/table", TABLE, motion=Motion.still(UP), thickness=KEPT)
    scene.collider("/World/ball", Sphere(0.1), at=(0.0, -1.0, 0.0))
    return scene


@pytest.mark.parametrize("real", [wp.float32, wp.float64])
def test_its_distance_is_that_of_a_rounded_cylinder_on_the_device_too(real):
    """And its normal the gradient; below it the shapes of wsim are found by their own numbers."""
    shape.add_convex_shape(ROW.kind, rounded.formula)
    t, formula = types(real), shape.convex_distance_func(("cylinder", "rounded"))

    @wp.kernel(module="unique", enable_backward=False)
    def evaluate(kind: int, size: t.vec3, q: wp.array(dtype=t.vec3), phi: wp.array(dtype=real), n: wp.array(dtype=t.vec3)):
        i = wp.tid()
        f, m = formula(kind, size, q[i])
        phi[i] = f
        n[i] = m

    q = np.random.default_rng(0).uniform(-0.4, 0.4, (4000, 3))
    eps = float(np.finfo(np.float32 if real is wp.float32 else np.float64).eps)
    for each in (TABLE, Cylinder(0.2, 0.1)):
        own = solids.shape_row(each)
        phi, n = wp.zeros(len(q), dtype=real, device="cpu"), wp.zeros(len(q), dtype=t.vec3, device="cpu")
        wp.launch(evaluate, len(q),
                  [collide.collider_kind_code(own.kind), t.vec3(*own.size(each)), wp.array(q, dtype=t.vec3, device="cpu")],
                  [phi, n], device="cpu")
        exact = own.distance(each, q)
        where = slice(None) if each is TABLE else exact < 0.0                 # of ours a bound outside
        assert np.abs(phi.numpy() - exact)[where].max() < 8 * eps
        if each is TABLE:
            on = q - phi.numpy().astype(np.float64)[:, None] * n.numpy()
            assert np.abs(own.distance(each, on)).max() < 32 * eps
            assert np.abs(np.linalg.norm(n.numpy(), axis=1) - 1.0).max() < 8 * eps
    assert collide.collider_kind_code("rounded") < 0 and collide.collider_kind_code("cone") == 5
    assert collide.split_convex_and_meshes(("sheet", "rounded"))[0] == ("rounded",)


@pytest.mark.parametrize("solver, more", [("xpbd", {}), ("implicit", {"iterations": 4}),
                                          ("explicit", {"substeps": 96, "integrator": "leapfrog", "damping": 2e-4})])
def test_cloth_rests_on_it(solver, more):
    """On the flat top at the distance that both keep; around the rim no point is nearer."""
    scene = table(solver=solver, **more)
    sim = Simulation(scene, device="cpu")
    sim.run(30)
    x, cloth = sim.positions(), scene.cloths[0]
    away = rounded.distance(TABLE, (x - UP[:3, 3]) @ UP[:3, :3])
    keeps = KEPT + 0.5 * cloth.material.thickness
    middle = np.hypot(x[:, 0], x[:, 2]) < 0.1
    assert away.min() > 0.99 * keeps - 1e-5
    assert np.abs(away[middle] - keeps).max() < 0.05 * keeps
    assert x[:, 1].min() < 0.05 and "rounded" in sim.plan.describe()
    assert sim.indicators()["penetration"] == 0.0


@pytest.mark.slow
def test_gradients_go_through_it():
    """By the initial positions, against differences of order 8 that are small enough for no contact to come or go."""
    scene = table(solver="xpbd", substeps=4, iterations=2)
    cloth = scene.cloth("/World/one", *shapes.sheet(0.2, 0.2, 3, 3, horizontal=True), material=Fabric(stretch=200.0, bend=1e-4),
                        motion=Motion.at_place((0.1, 0.113, 0.03)), velocities=np.tile([0.1, -1.0, 0.05], (16, 1)))
    scene.cloths, scene.colliders[1:] = [cloth], []
    found = Run(scene)
    start = found.recording.positions(0, cloth.path)
    way = np.random.default_rng(6).normal(size=start.shape)
    found.check((found.gradient.positions(cloth.path) * way).sum(), lambda s: (cloth.path, "positions", start + s * way), 1e-8,
                within=1e-8)


def test_it_is_checked_saved_and_loaded_and_takes_a_scale_or_becomes_a_mesh(tmp_path):
    scene = table()
    scene.colliders[0].motion = Motion.at_place((0.1, 0.2, 0.3))
    assert not [p for p in check_scene(scene) if p.fatal]
    save(scene, tmp_path / "s.usda")
    again = load(tmp_path / "s.usda")
    assert again == scene and again.colliders[0].shape == TABLE and not again.notes
    for scale, expected in (((2.0, 2.0, 2.0), Rounded(0.4, 0.2, 0.08)), ((2.0, 2.0, 1.0), Surface)):
        stage = Usd.Stage.Open(Sdf.Layer.OpenAsAnonymous(str(tmp_path / "s.usda")))
        UsdGeom.Xformable(stage.GetPrimAtPath("/World/table")).AddScaleOp().Set(scale)
        stage.Export(str(tmp_path / "scaled.usda"))
        found = load(tmp_path / "scaled.usda").colliders[0].shape
        if isinstance(expected, Rounded):
            assert np.allclose(ROW.given(found), ROW.given(expected), rtol=1e-12)
        else:
            assert isinstance(found, Surface) and np.abs(rounded.distance(TABLE, found.points / scale)).max() < 1e-6
    scene.colliders[0].shape = Rounded(0.2, 0.1, -0.04)
    (problem,) = [p for p in check_scene(scene) if p.fatal]
    assert problem.path == "/World/table" and "rim is -0.04" in problem.text
    with pytest.raises(SceneError, match="/World/table"):
        Simulation(scene, device="cpu")


def test_it_is_drawn(tmp_path):
    """By pictures of stages and by the viewer, as what it is and not as the cylinder of its prim."""
    save(table(), tmp_path / "s.usda")
    stage = Usd.Stage.Open(str(tmp_path / "s.usda"))
    points = triangulate_prim(stage.GetPrimAtPath("/World/table"), "collider", 0, 0.0, 1.0).points(0.0)
    on = (points - UP[:3, 3]) @ UP[:3, :3]
    assert np.abs(rounded.distance(TABLE, on)).max() < 1e-12 and np.hypot(on[:, 0], on[:, 1]).max() == pytest.approx(0.2)
    pytest.importorskip("rerun")
    from wsim.show.viewer import _outline_of_collider
    assert np.abs(rounded.distance(TABLE, _outline_of_collider(TABLE, "/World/table", 0)[0])).max() < 1e-12


def test_a_shape_without_a_row_is_named():
    with pytest.raises(KeyError, match="no shape of colliders is a str; there are Plane, Sphere"):
        solids.shape_row("torus")
    with pytest.raises(ValueError, match="another shape of colliders called rounded"):
        shape.add_convex_shape("rounded", rounded.formula)
        shape.add_convex_shape("rounded", shape.sphere_distance)
