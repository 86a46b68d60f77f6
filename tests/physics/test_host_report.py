"""What a report measures on the host is what its kernels find, and compiles nothing."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import warp as wp

from wsim.model.compiler import variants
from wsim.physics.cloth.kinds import stored as cloth
from wsim.physics.contact import CollidablePoints, ColliderContacts, depth
from wsim.physics.soft import stored as soft
from wsim.scene import Box, Capsule, Collider, Cone, Cylinder, Plane, Scene, Sphere, shapes
from wsim.scene.curve import Motion
from wsim.scene.fabric import Fabric
from wsim.scene.solid import Bulk
from wsim.simulation.simulation import Simulation

ROOT = Path(__file__).resolve().parents[2]
TURNED = np.array([[0.36, 0.48, -0.8, 0.1], [-0.8, 0.6, 0.0, -0.2], [0.48, 0.64, 0.6, 0.05], [0.0, 0.0, 0.0, 1.0]])
SHAPES = {"plane": Plane("Z"), "sphere": Sphere(0.3), "box": Box((0.3, 0.2, 0.1)), "capsule": Capsule(0.15, 0.2),
          "cylinder": Cylinder(0.2, 0.15), "cone": Cone(0.25, 0.2)}
LOOKS = (cloth, soft, depth)


def both(monkeypatch, measure) -> tuple[dict, dict]:
    """What `measure` finds on the host, and by kernels."""
    host = measure()
    with monkeypatch.context() as patch:
        for place in LOOKS:
            patch.setattr(place, "FEW", -1)
        return host, measure()


@pytest.mark.parametrize("kind", SHAPES)
def test_depths_on_the_host_are_those_of_kernels(kind, monkeypatch):
    """200 triangles about a turned collider, one in ten of them a spring. Kernels are right to 5e-4 of the longest edge, the
    host to a tenth of that, and neither is too great."""
    rng = np.random.default_rng(7)
    x = (TURNED[:3, 3] + rng.normal(size=(200, 1, 3)) * 0.25 + rng.normal(size=(200, 3, 3)) * 0.08)
    x[::10, 2] = x[::10, 1]
    x, faces, w = x.reshape(-1, 3), np.arange(600, dtype=np.int32).reshape(-1, 3), (rng.random(600) > 0.1).astype(float)
    for n in range(0, 200, 20):                          # a few at a time: each has a deepest of its own
        some = slice(3 * n, 3 * n + 60)
        bodies = CollidablePoints([[Collider("/solid", SHAPES[kind], Motion.still(TURNED), thickness=0.01)]], np.zeros((1, 3)),
                                  np.zeros(60, np.int32), w[some], np.full(60, 0.02), np.zeros((60, 2)), faces[:20],
                                  np.zeros(1), np.full(1, 0.02))
        contacts = ColliderContacts(bodies, device="cpu", real=wp.float64, substeps=1, dt=0.1)
        contacts.prepare(0.0)
        X = x[some].reshape(-1, 3, 3)
        edge = np.linalg.norm(X - np.roll(X, 1, axis=1), axis=2).max()
        at = wp.array(x[some], dtype=wp.vec3d, device="cpu")
        host, kernels = both(monkeypatch, lambda contacts=contacts, at=at: contacts.indicators(at))
        assert host["too_near"] == pytest.approx(kernels["too_near"], abs=1e-12)
        assert -6e-4 * edge < kernels["penetration"] - host["penetration"] < 5e-5 * edge
        assert host["contacts"] == kernels["contacts"]


def sheet(**more) -> Scene:
    scene = Scene(frames=4, solver="implicit", substeps=4, iterations=4)
    scene.cloth("/cloth", *shapes.sheet(1.0, 0.6, 7, 5, cut="quads"), material=more.pop("material", Fabric(bend=1e-4)), **more)
    scene.pin("/pin", scene.cloths[0], [0])
    return scene


def solid(model: str) -> Scene:
    scene = Scene(frames=4, substeps=8)
    points, tets = shapes.block((0.3, 0.2, 0.2), 3, at=(0.0, 0.2, 0.0))
    scene.soft("/block", points, tets, material=Bulk(young=2e3, poisson=0.4, model=model))
    scene.pin("/pin", scene.softs[0], [0, 1, 2])
    return scene


SCENES = {"membrane": sheet, "springs": lambda: sheet(model="springs"), "orthotropic": lambda: sheet(
    material=Fabric(stretch=900.0, weft=300.0, shear=40.0, poisson=0.3, bend=1e-3, density=0.1)),
    **{name: lambda name=name: solid(name) for name in soft.ENERGY}}


@pytest.mark.parametrize("name", SCENES)
def test_strain_and_energy_on_the_host_are_those_of_kernels(name, monkeypatch):
    sim = Simulation(SCENES[name](), device="cpu", precision="float64")
    rng = np.random.default_rng(1)
    (body,) = sim.model.bodies
    sim.set(body.path, "positions", sim.positions() + rng.normal(size=sim.positions().shape) * 0.02)
    host, kernels = both(monkeypatch, sim.indicators)
    assert host.keys() == kernels.keys() and host["elastic_energy"] > 1e-6
    for key, value in kernels.items():
        assert host[key] == pytest.approx(value, rel=1e-9, abs=1e-12), key


@pytest.mark.parametrize("name", ["membrane", "springs", "orthotropic"])
def test_residuals_on_the_host_are_those_of_kernels(name, monkeypatch):
    """Of sweeps that have not converged: the largest of all, and that of each kind."""
    scene = SCENES[name]()
    scene.solver, scene.iterations = "xpbd", 3
    sim = Simulation(scene, device="cpu", precision="float64")
    sim.run(2)
    host, kernels = both(monkeypatch, sim.indicators)
    assert host["residual"] > 1e-6 and host["residual"] == pytest.approx(kernels["residual"], rel=1e-9)
    method, h = sim.plan.method("xpbd"), sim.plan.clock.effective_step
    for batch, kernel in zip(method.batches, method.residual_kernels("residuals"), strict=True):
        largest = wp.zeros(1, dtype=wp.float64, device="cpu")
        wp.launch(kernel, batch.size, [batch.data, sim.state.x, sim.state.e, batch.lam, 1.0 / h, 0], [largest], device="cpu")
        assert batch.left(sim.state.x, sim.state.e, 1.0 / h) == pytest.approx(float(largest.numpy()[0]), rel=1e-9), batch.kind


STEP = """
import sys
from wsim.simulation.simulation import Simulation
from wsim.usd import load
scene = load(sys.argv[1])
scene.solver = sys.argv[2]
sim = Simulation(scene, device="cpu")
sim.step()
assert sim.report()["error"]
"""


# modules of what is in them and of no scene, which the cache has once for all scenes: energies, the balance of every frame,
# where colliders and pins are
SHARED = "wp_wsim_report_", "wp_wsim_balance_f32_", "wp_wsim_ledger_", "wp_wsim_poses_", "wp_wsim_pins_"


def own(cache: Path) -> list[str]:
    """Names of the compiled sources that are a scene's own."""
    return [source.name for source in cache.rglob("*.cpp") if not source.name.startswith(SHARED)]


@pytest.mark.parametrize("scene, solver", [("cape", "auto"), ("hanging_cloth", "xpbd")])
def test_a_first_frame_and_its_report_compile_one_module_and_each_kernel_once(scene, solver, tmp_path):
    """The cape has pins, wind, contacts, strain and bending; the hanging cloth sweeps that leave a residual."""
    subprocess.run([sys.executable, "-c", STEP, str(ROOT / "scenes" / f"{scene}.usda"), solver], cwd=ROOT, check=True,
                   capture_output=True, env=os.environ | {"WARP_CACHE_PATH": str(tmp_path)})
    assert len(own(tmp_path)) == 1
    for text in (source.read_text() for source in tmp_path.rglob("*.cpp")):
        assert "cpu_forward_tasks<false>" in text and "cpu_forward_tasks<true>" not in text


FIRST = """
import sys
from wsim.simulation.simulation import Simulation
sim = Simulation(sys.argv[1], device="cpu")
sim.step()
"""


def test_a_first_frame_compiles_one_module_though_half_of_its_stretches_launch_nothing(tmp_path):
    """Frames without contacts launch no correction: what is launched in one with the others is not compiled by itself."""
    subprocess.run([sys.executable, "-c", FIRST, str(ROOT / "scenes" / "bear.usda")], cwd=ROOT, check=True,
                   capture_output=True, env=os.environ | {"WARP_CACHE_PATH": str(tmp_path)})
    assert len(own(tmp_path)) == 1


def test_warp_still_asks_whether_a_kernel_may_have_two_variants():
    """Where it does not, nothing is left out, and each scene takes a third longer to compile."""
    from warp._src import codegen
    assert callable(getattr(codegen, variants.QUESTION))
    with variants.single_variant():
        assert getattr(codegen, variants.QUESTION)(None, 1) is False
