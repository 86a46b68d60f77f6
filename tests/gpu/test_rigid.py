"""Rigid bodies on a GPU: they stand, bounce and throw as on a CPU, and the same to the bit from run to run."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from tests.make.physics.rigid.contact import Seen, ball, box, world
from tests.make.physics.rigid.solver.colours import check_colours, heap
from wsim.physics.rigid import forms
from wsim.simulation.simulation import Simulation

pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="needs a GPU")


@pytest.fixture(autouse=True)
def coloured(monkeypatch):
    """A CPU takes colours here too."""
    chosen = forms.choose_pass_form
    monkeypatch.setattr(forms, "choose_pass_form", lambda device,
                        n: chosen(device, n) if device.is_cuda else forms.ContactPassForm("coloured"))


def ends(device: str, frames: int, precision: str = "float64") -> tuple[np.ndarray, bytes]:
    bodies = [box(f"/box{k}", (0.02 * k, 0.55 + 1.05 * k, 0.0)) for k in range(5)]
    sim = world(*bodies, ball("/ball", (5.0, 1.5, 0.0), rest=0.8), device=device, precision=precision)
    sim.run(frames)
    method = sim.plan.method("rigid")
    return Seen(sim).poses, b"".join(method.part.arrays[name].numpy().tobytes() for name in ("x", "q", "p", "L"))


def test_a_few_frames_are_those_of_a_cpu():
    """Until blows amplify what rounding left."""
    assert np.abs(ends("cuda:0", 12)[0] - ends("cpu", 12)[0]).max() < 1e-9


def test_runs_are_the_same_to_the_bit():
    assert ends("cuda:0", 60, "float32")[1] == ends("cuda:0", 60, "float32")[1]


def test_a_column_stands():
    sim = world(*[box(f"/box{k}", (0.0, 0.5 + k, 0.0)) for k in range(10)], device="cuda:0", precision="float32")
    sim.run(600)
    assert 9.5 - Seen(sim).at("/box9")[1] < 3e-3 and np.abs(Seen(sim).v).max() < 1e-3


FORMS = ("block", "cluster", "launches")


@pytest.mark.parametrize("name", FORMS)
def test_a_heap_falls_by_every_form_as_by_one_thread(name, monkeypatch):
    """Same colours, so the same sums in the same order; a blow amplifies what rounding left."""
    def run(name: str, device: str) -> np.ndarray:
        monkeypatch.setattr(forms, "choose_pass_form", lambda device, _: forms.form_by_name(name, device))
        sim = world(*heap(), device=device, precision="float64")
        sim.run(30)
        assert check_colours(sim) > 3
        return Seen(sim).poses
    assert np.abs(run(name, "cuda:0") - run("coloured", "cpu")).max() < 1e-6


@pytest.mark.parametrize("name", FORMS)
def test_a_heap_falls_the_same_to_the_bit_from_run_to_run(name, monkeypatch):
    monkeypatch.setattr(forms, "choose_pass_form", lambda device, _: forms.form_by_name(name, device))

    def run() -> bytes:
        sim = world(*heap(), device="cuda:0", precision="float32")
        sim.run(90)
        return b"".join(sim.plan.method("rigid").part.arrays[name].numpy().tobytes() for name in ("x", "q", "p", "L"))
    assert run() == run()


@pytest.mark.parametrize("name", FORMS)
def test_two_columns_sleep_and_a_ball_wakes_one(name, monkeypatch):
    monkeypatch.setattr(forms, "choose_pass_form", lambda device, _: forms.form_by_name(name, device))
    columns = [box(f"/box{x}_{k}", (20.0 * x, 0.5 + k, 0.0)) for x in range(2) for k in range(3)]
    scene = replace(world(*columns, ball("/ball", (0.0, 8.0, 0.0), rest=0.0), device="cuda:0").given, sleep_speed=0.05)
    sim = Simulation(scene, device="cuda:0")
    method = sim.plan.method("rigid")

    def asleep() -> np.ndarray:
        return method.part.arrays["asleep"].numpy()[:6] == 1
    sim.run(45)
    assert asleep().all()
    woken = False
    for _ in range(40):
        sim.step()
        woken |= not asleep()[:3].any()
        assert asleep()[3:].all()
    sim.run(90)
    assert woken and asleep().all()


@pytest.mark.parametrize("name", FORMS)
def test_the_converged_mode_reaches_its_residual(name, monkeypatch):
    """Of a box that slips between others: 6e-7 m/s is the most that 4000 sweeps leave in these frames on a CPU."""
    monkeypatch.setattr(forms, "choose_pass_form", lambda device, _: forms.form_by_name(name, device))
    boxes = [box(f"/box{k}", (0.0, 0.5 + k, 0.0), velocity=(2.0 * (k == 1), 0.0, 0.0)) for k in range(4)]
    scene = replace(world(*boxes, device="cuda:0").given, contact_tolerance=1e-6)
    sim = Simulation(scene, device="cuda:0", precision="float64")
    sim.run(5)
    assert 0.0 < sim.indicators()["rigid_residual"] <= 1e-6


def test_gradients_of_a_free_body_are_those_of_a_cpu():
    from tests.make.gradient.bodies import VALUES, bodies, recorded, seeds
    poses, twists = seeds("/given")
    there, here = (recorded(bodies(), device=device).backward(poses=poses, twists=twists) for device in ("cuda:0", "cpu"))
    for name in VALUES:
        exact = np.asarray(here.value("/given", name))
        assert np.abs(np.asarray(there.value("/given", name)) - exact).max() < 1e-11 * max(1.0, np.abs(exact).max())
