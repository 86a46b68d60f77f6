"""Many substeps in one launch: the same functions over the same arrays in the same order, so the same bits as launch by launch.
On a CPU the kernel has one thread; the phases, the numbers that change and what is launched apart are those of a GPU."""

from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp

import wsim
from tests.make.physics.motion.fused.kernel_fusion import SCENES, cube, everything, many, sheet
from wsim.model import model as models
from wsim.model.launches import KernelLaunches
from wsim.physics.cloth.constraints import fill_constraints
from wsim.physics.motion.fused import kernel_fusion
from wsim.physics.motion.fused.persistent_kernel import Numbers, group_phases
from wsim.physics.motion.fused.recorder import LaunchRecorder, recorded_launches
from wsim.scene import Scene, Surface, shapes
from wsim.scene.curve import Curve


def run(scene: Scene, precision: str, monkeypatch, fused: bool, frames: int = 3):
    """Positions and velocities after some frames, and the simulation."""
    monkeypatch.setattr(KernelLaunches, "fuses", fused)
    sim = wsim.Simulation(scene, device="cpu", precision=precision)
    for _ in range(frames):
        sim.step()
    monkeypatch.undo()
    return sim.state.x.numpy(), sim.state.v.numpy(), sim


@pytest.mark.parametrize("name, precision", [("everything", "float32"), ("mesh", "float32"), ("sail", "float32"),
                                             *(pytest.param(*more, marks=pytest.mark.slow) for more in (
                                                 ("staged", "float32"), ("cube", "float32"), ("jelly", "float32"),
                                                 ("sheet", "float64"), ("blown", "float32"), ("everything", "float64"),
                                                 ("cube", "float64")))])
def test_one_launch_of_many_substeps_leaves_the_bits(name, precision, monkeypatch):
    x, v, _ = run(SCENES[name](), precision, monkeypatch, False)
    x1, v1, sim = run(SCENES[name](), precision, monkeypatch, True)
    assert sim.model.fuser.why.startswith("substeps in one launch"), sim.model.fuser.why
    assert sim.model.fuser.launched > 0
    assert np.array_equal(x, x1) and np.array_equal(v, v1)
    assert np.abs(v1).max() > 1e-3                                   # something moves


def test_numbers_go_by_a_step_take_turns_or_begin_otherwise():
    def fits(*values) -> bool:
        return Numbers(int, np.array(values, np.float64)).fit()
    assert fits(3, 3, 3, 3) and fits(5, 3, 3, 3) and fits(0, 1, 0, 1, 0) and fits(7, 8, 9, 10, 11) and fits(9, 2, 4, 6, 8)
    assert not fits(0, 1, 3, 7, 10) and not fits(0, 1, 1, 2, 1)


def test_what_writes_only_its_own_point_needs_no_wait(monkeypatch):
    """Leap, search, projection and correction of a cube's points stand in one phase behind that of its tets."""
    _, _, sim = run(cube(), "float32", monkeypatch, True, frames=0)
    assert sim.model.fuser.phases == 2
    _, _, sim = run(sheet(), "float32", monkeypatch, True, frames=0)
    assert sim.model.fuser.phases == 4                               # angles and membranes, curvatures, moments, points


def test_phases_go_by_marks_of_kernels_and_not_by_their_names(monkeypatch):
    """The functions of a scene's kernels are renamed, some to what others are called; so are their keys."""
    _, _, sim = run(everything(), "float32", monkeypatch, True, frames=0)
    (step, *_) = recorded_launches(sim.model, sim.plan.substep, 0, 1)
    want = [(p.ops, p.lanes) for p in group_phases(step)]
    assert any(len(ops) > 2 and lanes for ops, lanes in want)
    kernels, names = list({op.kernel for op in step}), ("search", "settle", "begin", "any")
    for n, kernel in enumerate(kernels):
        monkeypatch.setattr(kernel.func, "__name__", names[n % 4])
        monkeypatch.setattr(kernel, "key", f"{names[n % 4]}{n}")
    assert [(p.ops, p.lanes) for p in group_phases(step)] == want

    @wp.kernel(module="test_marks", enable_backward=False)
    def search(points: wp.array(dtype=float), next_out: wp.array(dtype=float)):
        i = wp.tid()
        next_out[i] = points[(i + 1) % points.shape[0]]                # of another point: threads have to wait
    recorder = LaunchRecorder(None)
    for _ in range(2):
        recorder.launch(search, 4, [], [])
    assert [p.ops for p in group_phases(recorder.ops)] == [[0], [1]]


def test_launches_beside_each_other_share_a_phase():
    recorder = LaunchRecorder(None)
    recorder.opaque(print)
    with recorder.together():
        recorder.opaque(print)
        recorder.opaque(print)
    recorder.opaque(print)
    assert [p.ops for p in group_phases(recorder.ops)] == [[0], [1, 2], [3]]


def test_a_substep_that_differs_is_launched_apart(monkeypatch):
    """With other numbers than a kernel knows, the frame is launched as ever, and says so."""
    monkeypatch.setattr(Numbers, "fit", lambda self: False)
    x, _, sim = run(cube(), "float32", monkeypatch, True, frames=1)
    assert sim.model.fuser.launched == 0 and "substep to substep" in sim.model.fuser.why
    want, _, _ = run(cube(), "float32", monkeypatch, False, frames=1)
    assert np.array_equal(x, want)


def test_elements_of_some_points_are_fused_on_a_gpu_but_not_on_a_mesh(monkeypatch):
    gpu = SimpleNamespace(is_cuda=True)

    def paid(scene: Scene, elements: bool = True) -> bool:
        model = models.build_model(scene, 1, wp.get_device("cpu"), wp.float32)
        fill_constraints(model)
        assert kernel_fusion.fusing_pays(model) == elements      # on a CPU
        model.device = gpu
        return kernel_fusion.fusing_pays(model)
    on_mesh, net = cube(), Scene(solver="explicit")
    net.net("/net", np.eye(3), [(0, 1), (1, 2)], 100.0, 0.1)
    points, counts, indices = shapes.sphere(0.1, 4)
    on_mesh.collider("/mesh", Surface(points, counts, indices))
    assert paid(cube()) and paid(sheet()) and not paid(on_mesh) and not paid(net, False)
    monkeypatch.setattr(kernel_fusion, "MOST", 10)
    assert not paid(cube())


def test_a_mesh_that_deforms_is_launched_apart_on_a_gpu():
    """Its tree is refitted by Warp, which is no kernel."""
    points, counts, indices = shapes.sphere(0.1, 4)
    for poses in (None, Curve([0.0, 1.0], [points, 1.1 * points])):
        scene = cube()
        scene.collider("/mesh", Surface(points, counts, indices, poses=poses))
        model = models.build_model(scene, 1, wp.get_device("cpu"), wp.float32)
        assert kernel_fusion.why_not_fused(model, {}) == ""
        model.device = SimpleNamespace(is_cuda=True)
        assert ("deforms" in kernel_fusion.why_not_fused(model, {})) == (poses is not None)


def test_colliders_that_a_tree_finds_are_launched_substep_by_substep(monkeypatch):
    """With the bits of one launch that looks at each."""
    from wsim.physics.contact import contacts
    found = []
    for most in (contacts.MANY, 10**9):
        monkeypatch.setattr(contacts, "MANY", most)
        sim = wsim.Simulation(many(), device="cpu")
        for _ in range(4):
            sim.step()
        assert (sim.model.fuser is None) == (most < 10**9) and (sim.plan.ports.contacts.mark.numpy() & 1).any()
        found.append(sim.state.x.numpy())
    assert np.array_equal(*found)
