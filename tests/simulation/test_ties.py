"""Points that a cloth shares with a soft body: one particle for both, whatever solves, in USD and out of it."""

import numpy as np
import pytest

from tests.make.physics.soft.soft_bar import bar, ran
from tests.make.simulation.ties import laid
from wsim import Box, Scene, SceneError, Simulation, load, save
from wsim.scene import shapes
from wsim.scene.check.scene import check_scene
from wsim.scene.curve import Motion


def test_shared_points_are_one_and_the_rest_hangs_on_them():
    scene, mine, others = laid()
    sim = ran(scene, 10, worlds=2)
    cloth, body = sim.positions("/blanket", 1), sim.positions("/bar", 1)
    assert len(mine) == 21 and np.array_equal(cloth[mine], body[others])
    assert np.array_equal(sim.positions("/bar", 0), body)                             # worlds do not see each other
    edges = sim.model.body("/blanket").edges
    assert sim.indicators()["max_strain"] < 0.5 and len(edges) and not [w for w in sim.warnings if "blanket" in w]


def test_explicit_and_implicit_steps_agree_on_what_shares_points():
    fast = ran(laid(solver="auto", integrator="auto")[0], 6)
    slow = ran(laid(integrator="implicit_midpoint", substeps=16)[0], 6)
    assert fast.plan.choice.solver == "explicit"
    for path in ("/bar", "/blanket"):
        assert np.abs(fast.positions(path) - slow.positions(path)).max() < 1e-4
    assert fast.indicators()["energy"] == pytest.approx(Simulation(laid()[0], device="cpu").indicators()["energy"], abs=0.05)


def test_the_mass_of_both_is_kept_and_momentum_goes_through_the_shared_points():
    """Free, without gravity: only the cloth moves at first; the total momentum stays."""
    scene, mine, _ = laid(held=False, gravity=(0, 0, 0), iterations=4)
    cloth = scene.cloths[0]
    cloth.velocities = np.tile([0.0, 0.0, 0.3], (len(cloth.points), 1))
    scene.softs[0].velocities = np.zeros_like(scene.softs[0].points)
    sim = Simulation(scene, device="cpu", precision="float64")
    w, model = sim.plan.methods[0].constants.w.numpy(), sim.model
    free = w > 0.0
    assert (~free).sum() == len(mine)
    own = Simulation(bar(held=False), device="cpu").model.bodies[0].masses.sum()
    sheet = scene.cloths[0].material
    assert np.sum(1.0 / w[free]) == pytest.approx(own + 0.6 * 0.4 * sheet.thickness * sheet.density, rel=1e-6)
    before = (sim.state.v.numpy()[free] / w[free, None]).sum(axis=0)
    sim.run(10)
    after = (sim.state.v.numpy()[free] / w[free, None]).sum(axis=0)
    assert before[2] > 0.0 and np.abs(after - before).max() < 1e-6 * before[2] and model.gone.size == len(mine)


def test_a_pin_on_a_shared_point_holds_both():
    scene, mine, others = laid(held=False)
    scene.pin("/nail", "/blanket", mine[:3], motion=Motion.still())
    sim = ran(scene, 5)
    np.testing.assert_allclose(sim.positions("/bar")[others[:3]], scene.softs[0].points[others[:3]], atol=1e-6)


def test_ties_are_saved_and_loaded(tmp_path):
    scene, _, _ = laid()
    save(scene, str(tmp_path / "a.usda"))
    again = load(str(tmp_path / "a.usda"))
    assert again == scene
    save(again, str(tmp_path / "b.usda"))
    assert (tmp_path / "a.usda").read_text() == (tmp_path / "b.usda").read_text()


@pytest.mark.parametrize("change, words", [
    (lambda tie, scene: setattr(tie, "other", "/nothing"), "'/nothing', which is no cloth"),
    (lambda tie, scene: setattr(tie, "other", "/blanket"), "another that is soft"),
    (lambda tie, scene: setattr(tie, "others", tie.others[:-1]), "as many, at least one"),
    (lambda tie, scene: tie.others.__setitem__(0, 999), "point 999 of /bar; allowed: 0 to 62"),
    (lambda tie, scene: tie.points.__setitem__(1, tie.points[0]), "more than one partner"),
    (lambda tie, scene: setattr(tie, "others", tie.others[::-1].copy()), "m from point"),
    (lambda tie, scene: setattr(scene.cloths[0], "tethers", True), "tethers"),
])
def test_a_bad_tie_is_told_by_its_path(change, words):
    scene, _, _ = laid()
    change(scene.ties[0], scene)
    problems = [p for p in check_scene(scene) if p.fatal]
    assert problems and any(words in str(p) and p.path in ("/tie", "/blanket") for p in problems)
    with pytest.raises(SceneError, match="tie|blanket"):
        Simulation(scene, device="cpu")


def test_two_soft_blocks_that_share_a_face_are_one():
    """Halves of a bar, tied, hang as the bar does: the same tets, by cells that mirror alike on both sides of the cut."""
    whole, halves = bar((4, 2, 2), (0.4, 0.2, 0.2), iterations=4), Scene(
        solver="implicit", integrator="backward_euler", substeps=2, iterations=4, fps=60.0)
    material = whole.softs[0].material
    left, right = (halves.soft(f"/{name}", *shapes.block((0.2, 0.2, 0.2), (2, 2, 2), at=(x, 0.0, 0.0)), material=material)
                   for name, x in (("left", -0.1), ("right", 0.1)))
    halves.pin("/wall", left, np.flatnonzero(left.points[:, 0] < -0.1999))
    own, other = np.flatnonzero(right.points[:, 0] < 1e-6), np.flatnonzero(left.points[:, 0] > -1e-6)
    halves.tie("/cut", right, own, left, other)
    together, apart = ran(whole, 8, precision="float64"), ran(halves, 8, precision="float64")
    end = whole.softs[0].points[:, 0] > -1e-6
    np.testing.assert_allclose(apart.positions("/right"), together.positions()[end], atol=1e-7)


def test_cloth_tied_to_a_link_has_finite_contacts_and_its_tie_says_what_is_read():
    """Tied points have no inverse mass of their own: a contact of theirs gave 0 / 0."""
    scene = Scene(coordinates="reduced", frames=2, fps=60)
    arm = scene.body("/arm", Box((0.2, 0.03, 0.03)), at=(0.2, 1, 0))
    scene.joint("revolute", "/shoulder", None, arm, at=(0, 1, 0), axis=(0, 0, 1))
    scene.tie("/seam", scene.cloth("/cape", *shapes.sheet(0.4, 0.4, 4, 4, at=(0.2, 0.77, 0))), range(5), arm)
    simulation = Simulation(scene, device="cpu")
    simulation.run()
    with np.errstate(all="raise"):
        assert np.isfinite(simulation.contacts().force).all()
    with pytest.raises(SceneError, match="/seam: is a tie of cloth.*; allowed: pins, .*; fix: "):
        simulation.reactions("/seam")
