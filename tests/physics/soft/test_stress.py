"""Stress and strain of soft bodies: numbers against formulas, and primvars in results."""

import numpy as np
import pytest

from tests.make.cli.cli import run
from tests.make.physics.soft.tet_box import turn
from wsim import Bulk, Fabric, Scene, SceneError, Simulation
from wsim.kernels.soft.material import lame_parameters
from wsim.scene import shapes
from wsim.usd import save

E, NU = 1e5, 0.3


def block(model: str = "corotational", **more) -> Scene:
    scene = Scene(solver="implicit", integrator="backward_euler", substeps=1, iterations=1, **more)
    scene.soft("/block", *shapes.block((0.2, 0.2, 0.2), (2, 2, 2)), material=Bulk(E, NU, 1e3, model))
    return scene


def deformed(scene: Scene, F: np.ndarray) -> Simulation:
    sim = Simulation(scene, device="cpu", precision="float64")
    sim.set("/block", "positions", scene.softs[0].points.astype(np.float64) @ F.T)
    return sim


def of_stretches(model: str, s: np.ndarray) -> float:
    """Von Mises stress [Pa] of the principal stresses sigma_i = s_i dPsi/ds_i / J, by differences of the energy."""
    mu, lam = lame_parameters(E, NU)

    def energy(s):
        if model == "corotational":
            return mu * np.sum((s - 1.0)**2) + 0.5 * lam * np.sum(s - 1.0)**2
        J, I_c = np.prod(s), np.sum(s**2)                               # Smith, de Goes, Kim 2018, eq. 13 and 14
        m = 4.0 / 3.0 * mu
        k = lam + 5.0 / 6.0 * mu
        return 0.5 * m * (I_c - 3.0) + 0.5 * k * (J - 1.0 - 0.75 * m / k)**2 - 0.5 * m * np.log(I_c + 1.0)
    h = 1e-6 * np.eye(3)
    sigma = np.array([s[i] * (energy(s + h[i]) - energy(s - h[i])) / 2e-6 for i in range(3)]) / np.prod(s)
    return float(np.sqrt(0.5 * sum((sigma[i] - sigma[i - 1])**2 for i in range(3))))


@pytest.mark.parametrize("model, quadratic", [("corotational", False), ("neo_hookean", False), ("corotational", True)])
def test_stress_and_strain_are_those_of_the_stretches_in_any_pose(model, quadratic):
    s, scene = np.array([1.2, 0.95, 1.05]), block(model)
    scene.softs[0].quadratic = quadratic
    found = deformed(scene, turn() @ np.diag(s) @ turn().T).stress("/block")
    np.testing.assert_allclose(found.von_mises, of_stretches(model, s), rtol=1e-6)
    np.testing.assert_allclose(found.strain, np.linalg.norm(s - 1.0), rtol=1e-6)
    for values in (found.at_points()["vonMises"] / found.von_mises[0], found.at_points()["strain"] / found.strain[0]):
        np.testing.assert_allclose(values, np.ones(len(found.body.index)), rtol=1e-6)


def test_simple_tension_is_youngs_modulus_times_strain():
    """A bar of small strain e along x and -nu e across: sigma = E e."""
    e = 1e-4
    found = deformed(block(), np.diag([1.0 + e, 1.0 - NU * e, 1.0 - NU * e])).stress()
    np.testing.assert_allclose(found.von_mises, E * e, rtol=3 * e)


@pytest.mark.parametrize("s", [(1.0, 1.0, 0.0), (0.0, 0.0, 0.0), (-1.0, 1.0, 1.0), (1e9, 1e9, 1e9)])
def test_flat_and_inverted_tets_have_finite_stress(s):
    found = deformed(block(), np.diag(s)).stress()
    assert np.isfinite(found.von_mises).all() and np.isfinite(found.strain).all()


def test_stress_at_points_is_the_mean_by_volume():
    """Every other material is none: the points between have the mean of their tets, seen by a loop over them."""
    scene = block()
    soft = scene.softs[0]
    soft.which, soft.others = (np.arange(len(soft.tets)) % 2).astype(np.int32), [Bulk(3.0 * E, NU, 1e3)]
    found = deformed(scene, np.diag([1.1, 1.0, 1.0])).stress()
    corners = soft.points[soft.tets].astype(np.float64)
    volume = np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6.0
    wanted = [np.average(found.von_mises[at], weights=volume[at]) for at in
              ((soft.tets == i).any(axis=1) for i in range(len(soft.points)))]
    assert np.ptp(found.von_mises) > 0.5 * found.von_mises.max()
    np.testing.assert_allclose(found.at_points()["vonMises"], wanted, rtol=1e-12)


def test_what_is_no_soft_body_has_no_stress():
    scene = block()
    scene.cloth("/cloth", *shapes.sheet(0.5, 0.5, 2, 2), material=Fabric())
    with pytest.raises(SceneError, match="/cloth: is a cloth; stress is that of soft bodies"):
        Simulation(scene, device="cpu").stress("/cloth")


def values(path, name: str) -> dict:
    from pxr import Usd, UsdGeom
    stage = Usd.Stage.Open(str(path))
    primvar = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/block")).GetPrimvar(name)
    assert primvar.GetInterpolation() == "vertex"
    return {code: primvar.Get(code) for code in primvar.GetTimeSamples()}


def test_a_result_has_stress_where_it_is_asked_for(tmp_path):
    """A block that begins stretched. In a stage of centimetres E is 1e5 kg / (cm s^2), and so is the stress; a restart keeps
    the frames before it, and where it writes none, none is held."""
    scene = block(frames=3)
    scene.iterations, soft = 2, scene.softs[0]
    scene.pin("/wall", soft, [0])                                       # as most soft scenes of the tests: a module less
    soft.rest_points, soft.points = soft.points, soft.points * np.float32([1.1, 1.0, 1.0])
    stage, half, rest, bare = (str(tmp_path / name) for name in ("scene.usda", "half.usdc", "rest.usdc", "bare.usdc"))
    save(scene, stage)
    text = (tmp_path / "scene.usda").read_text(encoding="utf-8")
    assert "metersPerUnit = 1\n" in text
    (tmp_path / "scene.usda").write_text(text.replace("metersPerUnit = 1\n", "metersPerUnit = 0.01\n"), encoding="utf-8")
    assert run(stage, half, "--frames", "2", "--stress", "--quiet") == 0
    assert run(stage, rest, "--restart", half, "--stress", "--quiet") == 0
    assert run(stage, bare, "--restart", half, "--quiet") == 0
    found = values(half, "vonMises")
    assert list(found) == [0.0, 1.0, 2.0] and list(values(rest, "strain")) == [0.0, 1.0, 2.0, 3.0]
    np.testing.assert_allclose(found[0.0], of_stretches("corotational", np.array([1.1, 1.0, 1.0])), rtol=1e-5)
    np.testing.assert_allclose(values(half, "strain")[0.0], 0.1, rtol=1e-5)
    assert values(bare, "vonMises")[3.0] is None and values(bare, "vonMises")[2.0] == found[2.0]
