"""What contacts of trees may be asked for: restitution, a residual, and MuJoCo's soft model."""

import numpy as np
import pytest

import wsim
from tests.physics.joints.trees.chains import trees_of
from wsim import Box, Plane, Scene, Sphere
from wsim.usd import load, save

SOLREF, SOLIMP = (0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0)             # MuJoCo's defaults


def arm_and_ball(**settings) -> Scene:
    """A ball 1 m above a floor, beside an arm of two links that lies on it."""
    scene = Scene(**({"coordinates": "reduced", "fps": 60, "substeps": 4} | settings))
    scene.collider("/floor", Plane(), restitution=0.6)
    scene.body("/ball", Sphere(0.1), at=(0.0, 1.1, 0.0), restitution=0.6)
    first = scene.body("/a", Box((0.2, 0.02, 0.05)), at=(3.0, 0.02, 0.0))
    second = scene.body("/b", Box((0.2, 0.02, 0.05)), at=(3.45, 0.02, 0.0))
    scene.joint("revolute", "/hinge", first, second, at=(3.225, 0.02, 0.0), axis=(0, 0, 1))
    return scene


@pytest.mark.parametrize("substeps", [2, 8])
def test_a_ball_beside_a_tree_rebounds_to_e_squared_of_its_height(substeps):
    """h' = e^2 h, whatever the step; a frame may miss the top by g / 8 of its square."""
    simulation = wsim.Simulation(arm_and_ball(substeps=substeps), device="cpu", precision="float64")
    heights = [simulation.poses()["/ball"][1, 3] - 0.1 for _ in simulation.frames(60)]
    assert max(heights[28:]) == pytest.approx(0.36, abs=9.81 / 8 / 60**2)
    assert "reduced coordinates" in simulation.plan.describe()


def test_sweeps_over_trees_end_at_the_residual_that_is_asked_for():
    simulation = wsim.Simulation(arm_and_ball(contact_tolerance=1e-5), device="cpu", precision="float64")
    simulation.run(20)
    assert 0.0 < simulation.report()["error"]["rigid_residual"] <= 1e-5
    assert not simulation.report()["warnings"]


def soft_box(shape, at: float = 0.1, solref=SOLREF, solimp=SOLIMP) -> Scene:
    """8 kg of a half size of 0.1 m over a floor, stepped as MuJoCo's Euler does."""
    scene = Scene(fps=480, substeps=1, up="Z", contact_model="mujoco", contact_tolerance=1e-10, integrator="symplectic_euler")
    floor = scene.collider("/floor", Plane())
    body = scene.body("/b", shape, at=(0.0, 0.0, at), mass=8.0)
    for collider in (floor, *body.colliders):
        collider.solref, collider.solimp = solref, solimp
    return scene


def heights(scene: Scene, frames: int) -> np.ndarray:
    simulation = wsim.Simulation(scene, device="cpu", precision="float64")
    return np.array([simulation.poses()["/b"][2, 3] for _ in simulation.frames(frames)])


@pytest.mark.parametrize("shape, points", [(Box((0.1, 0.1, 0.1)), 4), (Sphere(0.1), 1)])
def test_a_soft_contact_rests_where_its_spring_bears_the_weight(shape, points):
    """At rest R f = -k r, f = m g / n, R = (1 - d) / (d m), k = d / (d_max t)^2: a depth of g (1 - d) (d_max t / d)^2 / n."""
    depth = 0.1 - heights(soft_box(shape), 240)[-1]
    x = depth / SOLIMP[2]
    d = SOLIMP[0] + (SOLIMP[1] - SOLIMP[0]) * (2.0 * x * x if x < 0.5 else 1.0 - 2.0 * (1.0 - x)**2)
    assert depth == pytest.approx(9.81 * (1.0 - d) * (SOLIMP[1] * SOLREF[0])**2 / (points * d * d), rel=1e-6)


@pytest.mark.parametrize("shape", ["box", "sphere"])
@pytest.mark.parametrize("settings", [{}, {"solref": (0.05, 0.7)}, {"solref": (-5000.0, -50.0)},
                                      {"solimp": (0.5, 0.9, 0.01, 0.5, 2.0)}, {"at": 0.15}])
def test_a_soft_contact_moves_as_in_mujoco(shape, settings):
    mujoco = pytest.importorskip("mujoco")
    given = {"solref": SOLREF, "solimp": SOLIMP, "at": 0.1} | settings
    softness = f'solref="{" ".join(map(str, given["solref"]))}" solimp="{" ".join(map(str, given["solimp"]))}"'
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{1 / 480}" cone="elliptic" tolerance="1e-12" iterations="200"/><worldbody>'
        f'<geom type="plane" size="5 5 1" {softness}/><body pos="0 0 {given["at"]}"><freejoint/>'
        f'<geom type="{shape}" size="0.1 0.1 0.1" mass="8" {softness}/></body></worldbody></mujoco>')
    data, theirs = mujoco.MjData(model), []
    for _ in range(120):
        mujoco.mj_step(model, data)
        theirs.append(data.qpos[2])
    ours = heights(soft_box(Box((0.1, 0.1, 0.1)) if shape == "box" else Sphere(0.1), **settings), 120)
    assert np.abs(ours - theirs).max() < 1e-9 * (0.1 - min(theirs))


def creeping_box(angle: float, frames: int, **softness) -> np.ndarray:
    """Poses of a box on a slope of friction 0.8 that it does not slip on, (frames, 4, 4): x down the slope, z across."""
    scene = soft_box(Box((0.1, 0.1, 0.1)), **softness)
    scene.gravity = (9.81 * np.sin(angle), 0.0, -9.81 * np.cos(angle))
    for collider in (*scene.colliders, *scene.things("Body")[0].colliders):
        collider.static_friction = collider.dynamic_friction = 0.8
    simulation = wsim.Simulation(scene, device="cpu", precision="float64")
    return np.array([simulation.poses()["/b"] for _ in simulation.frames(frames)])


def test_a_box_creeps_down_a_slope_as_its_regulariser_says():
    """Corners i of depth r_i move alike, b u = R_i f_i, and their f_i sum to m g sin(angle): b = 2 / (d_max t),
    R_i = (1 - d_i) / (d_i m), d_i the impedance at r_i. So b u = g sin(angle) / sum_i d_i / (1 - d_i). It tells u
    to 1e-12 after a second; after 0.75 s the start has left less than 1e-10."""
    poses = creeping_box(0.2, 360)
    corners = 0.1 * np.array([(x, y, -1.0) for x in (-1, 1) for y in (-1, 1)])
    depth = -(poses[-1, :3, :3] @ corners.T + poses[-1, :3, 3:])[2]
    d = SOLIMP[0] + (SOLIMP[1] - SOLIMP[0]) * 2.0 * (depth / SOLIMP[2])**2
    creep = 9.81 * np.sin(0.2) / (d / (1.0 - d)).sum() * SOLIMP[1] * SOLREF[0] / 2.0
    assert depth.min() > 0.0 and depth.max() < 0.5 * SOLIMP[2]
    assert (poses[-1] - poses[-2])[0, 3] * 480 == pytest.approx(creep, rel=1e-9)


@pytest.mark.parametrize("settings", [{}, {"solref": (0.05, 0.7)}, {"solimp": (0.5, 0.9, 0.01, 0.5, 2.0)}])
def test_a_box_creeps_down_a_slope_as_in_mujoco(settings):
    mujoco = pytest.importorskip("mujoco")
    softness = " ".join(f'{name}="{" ".join(map(str, value))}"' for name, value in settings.items()) + ' friction="0.8"'
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{1 / 480}" cone="elliptic" tolerance="1e-13" iterations="300" '
        f'gravity="{9.81 * np.sin(0.3)} 0 {-9.81 * np.cos(0.3)}"/><worldbody>'
        f'<geom type="plane" size="50 50 1" {softness}/>'
        f'<body pos="0 0 0.1"><freejoint/><geom type="box" size="0.1 0.1 0.1" mass="8" {softness}/></body>'
        '</worldbody></mujoco>')
    data, theirs = mujoco.MjData(model), []
    for _ in range(120):
        mujoco.mj_step(model, data)
        theirs.append(data.qpos[0])
    ours, way = creeping_box(0.3, 120, **settings)[:, 0, 3], theirs[-1]
    assert way > 1e-5 and np.abs(ours - theirs).max() < 2e-3 * way


def test_softness_is_saved_and_loaded(tmp_path):
    scene = soft_box(Sphere(0.1), solref=(0.05, 0.7))
    save(scene, tmp_path / "soft.usda")
    again = load(tmp_path / "soft.usda")
    assert again.contact_model == "mujoco"
    assert again.colliders[0].solref == again.things("Body")[0].colliders[0].solref == (0.05, 0.7)
    assert again.colliders[0].solimp == SOLIMP


def test_a_soft_model_that_a_scene_cannot_have_is_refused():
    scene = soft_box(Sphere(0.1))
    scene.coordinates = "maximal"
    with pytest.raises(wsim.SceneError, match="contact_model is mujoco, which bodies have in reduced coordinates alone"):
        wsim.Simulation(scene, device="cpu")
    scene.contact_model = "newton"
    with pytest.raises(wsim.SceneError, match="contact_model is 'newton'; allowed: rigid, mujoco"):
        wsim.Simulation(scene, device="cpu")


@pytest.mark.parametrize("values, said", [({"solref": (0.0, 1.0)}, r"/floor: solref is \(0.0, 1.0\)"),
                                          ({"solref": (0.02,)}, "/floor: solref is"),
                                          ({"solimp": (0.9, float("nan"), 0.001, 0.5, 2.0)}, "/floor: solimp is"),
                                          ({"solimp": (0.9, 0.95)}, "/floor: solimp is")])
def test_softness_that_cannot_be_is_refused(values, said):
    scene = soft_box(Sphere(0.1))
    for name, value in values.items():
        setattr(scene.colliders[0], name, value)
    with pytest.raises(wsim.SceneError, match=said):
        wsim.Simulation(scene, device="cpu")


def test_a_tree_keeps_its_contacts_residual_warning_for_maximal_coordinates():
    scene = arm_and_ball(contact_tolerance=1e-9, coordinates="maximal")
    simulation = wsim.Simulation(scene, device="cpu")
    simulation.run(1)
    assert any("sweeps are counted where joints take maximal coordinates" in text for text in simulation.report()["warnings"])
    assert trees_of(simulation)[0].joints.what.startswith("1 joints")
