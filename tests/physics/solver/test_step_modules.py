"""Kernels of a Newton step are compiled once for all scenes of a CPU whose forces are of the same kinds."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from tests.conftest import grid
from tests.make.physics.solver.coarse_space import bar
from wsim.physics.solver import assembly
from wsim.scene import Plane, Scene
from wsim.scene.fabric import Fabric
from wsim.simulation.simulation import Simulation


def sheet(model="membrane", pin=True, floor=False, stiffness=np.inf, integrator="backward_euler", **more) -> Scene:
    scene = Scene(frames=2, substeps=2, iterations=2, solver="implicit", integrator=integrator)
    cloth = scene.cloth("/cloth", *grid(), model=model, material=Fabric(**more))
    if pin:
        scene.pin("/pin", cloth, points=[0, 3], stiffness=stiffness)
    if floor:
        scene.collider("/floor", Plane(), at=(0.0, -0.2, 0.0))
    return scene


def made(scene: Scene, **more) -> Simulation:
    return Simulation(scene, device="cpu", **more)


def kernels(module: str) -> set[str]:
    return set(wp.get_module(module).kernels)


def with_bar(scene: Scene, **more) -> Scene:
    """more: of the bar's material."""
    soft = bar()
    soft.softs[0].material = replace(soft.softs[0].material, **more)
    scene.softs, scene.pins = soft.softs, scene.pins + soft.pins
    return scene


SAME = {     # of each list all scenes need the same kernels, whatever else they have
    "membrane": [dict(), dict(pin=False), dict(floor=True), dict(stiffness=1e3), dict(integrator="bdf2"), dict(damping=0.1),
                 dict(integrator="implicit_midpoint"), dict(strain_limit=0.1), dict(weft=50.0)],
    "springs": [dict(), dict(pin=False), dict(floor=True), dict(integrator="sdirk3"), dict(damping=0.1)]}

SUMS = {"curvature"}     # of hinges at an edge, which forces that are weighed outside of a step have too


@pytest.mark.parametrize("model", SAME)
def test_a_scene_adds_no_kernel_to_a_module_that_another_has_filled(model, monkeypatch):
    monkeypatch.setattr(assembly, "newton_module", lambda model, what: "_".join(("test_step", *sorted(what))))
    ways = SAME[model]
    names = [made(sheet(model, **way)).model.step for way in ways]
    first, *others = set(names)
    known = kernels(first)
    assert known and not others
    for way in ways:
        for sim in (made(sheet(model, **way), worlds=2), made(with_bar(sheet(model, **way)))):
            assert kernels(first) == known and (sim.model.step == first) is (sim.worlds == 2)
            assert kernels(sim.model.module) & known <= SUMS


def test_what_needs_other_kernels_has_another_module():
    ways = (dict(), dict(model="springs"), dict(bend=0.0))
    assert len({made(sheet(**way)).model.step for way in ways}) == 3
    assert made(sheet(), precision="float64").model.step != made(sheet()).model.step
    bars = [made(with_bar(sheet(), **material)) for material in (dict(), dict(damping=1e-3), dict(model="neo_hookean"))]
    assert len({sim.model.step for sim in bars}) == 3
    for sim in bars:
        assert [sum(word in k for k in kernels(name)) for name in (sim.model.module, sim.model.step)
                for word in ("fem_linearise", "fem_change")] == [0, 0, 1, 1]


def test_another_scene_finds_what_the_first_has_loaded():
    """The module stays as it is; only the plan's own is loaded beside it."""
    first = made(sheet())
    first.load()
    module = wp.get_module(first.model.step)
    loaded, digest = dict(module.execs), module.get_module_hash(1)
    assert loaded
    other = made(sheet(integrator="bdf2", floor=True))
    other.step()
    assert other.model.module != first.model.module and other.model.step == first.model.step
    assert module.execs == loaded and module.get_module_hash(1) == digest


def test_kernels_of_a_step_and_of_its_adjoint_have_none_themselves():
    sim = made(sheet(), precision="float64", gradients=True)
    shared = [name for name in sim.model.modules if name.startswith("wsim_newton")]
    assert shared == [sim.model.step, "wsim_newton_adjoint_f64"]
    for name in shared:
        assert not any(k.options["enable_backward"] for k in wp.get_module(name).kernels.values())
