"""Rigid bodies on a GPU: they stand, bounce and throw as on a CPU, and the same to the bit from run to run."""

import numpy as np
import pytest
import warp as wp

from tests.physics.rigid.solver.test_colours import check_colours, heap
from tests.physics.rigid.test_contact import Seen, ball, box, world
from wsim.physics.rigid import forms

pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="needs a GPU")


@pytest.fixture(autouse=True)
def coloured(monkeypatch):
    """A CPU takes colours here too."""
    chosen = forms.chosen
    monkeypatch.setattr(forms, "chosen", lambda device, n: chosen(device, n) if device.is_cuda else forms.Form("coloured"))


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
        monkeypatch.setattr(forms, "chosen", lambda device, _: forms.named(name, device))
        sim = world(*heap(), device=device, precision="float64")
        sim.run(30)
        assert check_colours(sim) > 3
        return Seen(sim).poses
    assert np.abs(run(name, "cuda:0") - run("coloured", "cpu")).max() < 1e-6


@pytest.mark.parametrize("name", FORMS)
def test_a_heap_falls_the_same_to_the_bit_from_run_to_run(name, monkeypatch):
    monkeypatch.setattr(forms, "chosen", lambda device, _: forms.named(name, device))

    def run() -> bytes:
        sim = world(*heap(), device="cuda:0", precision="float32")
        sim.run(90)
        return b"".join(sim.plan.method("rigid").part.arrays[name].numpy().tobytes() for name in ("x", "q", "p", "L"))
    assert run() == run()


def test_gradients_of_a_free_body_are_those_of_a_cpu():
    from tests.gradient.test_bodies import VALUES, bodies, recorded, seeds
    poses, twists = seeds("/given")
    there, here = (recorded(bodies(), device=device).backward(poses=poses, twists=twists) for device in ("cuda:0", "cpu"))
    for name in VALUES:
        exact = np.asarray(here.value("/given", name))
        assert np.abs(np.asarray(there.value("/given", name)) - exact).max() < 1e-11 * max(1.0, np.abs(exact).max())
