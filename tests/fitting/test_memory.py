"""Memory for the copies that a fit takes differences by: what they hold, and what is said where there is too little."""

import gc

import numpy as np
import pytest
import warp as wp

from tests.make.gradient.gradients import sheet
from tests.make.physics.contact.project_adjoint import SOLVERS, dropped
from tests.make.physics.soft.plastic_adjoint import NEWTON, yielding
from wsim.fitting import Track
from wsim.fitting.memory import bytes_held_by
from wsim.fitting.observations.residuals import Misfit
from wsim.fitting.parameter import parameters_of_names
from wsim.gradient import checkpoints
from wsim.scene import SceneError
from wsim.simulation import plan
from wsim.simulation.simulation import Simulation

SCENES = {"sheet": lambda: sheet("membrane"), "flowing bar": lambda: yielding("neo_hookean", **NEWTON),
          "contacts": lambda: dropped("sphere", **SOLVERS["xpbd"])}


def alive() -> dict[int, int]:
    """Bytes of all of Warp's arrays that are no parts of others, by address."""
    arrays = [a for a in gc.get_objects() if isinstance(a, wp.array) and getattr(a, "ptr", None)]
    return {a.ptr: a.capacity for a in arrays if not isinstance(a._ref, wp.array)}


def misfit(differences="central") -> Misfit:
    """Of three parameters: seven copies, or four; by Newton's method, whose tables are as long as there are copies."""
    scene = sheet("membrane", **NEWTON)
    found, scenes = parameters_of_names("stretch,shear,bend", [scene])
    seen = [Track("/cloth", [3], np.zeros((1, 2, 3)), sigma=1e-3)]
    return Misfit([(scenes[0], seen)], found, device="cpu", differences=differences)


@pytest.mark.parametrize("scene", SCENES)
def test_what_a_simulation_holds_is_all_that_was_allocated(scene):
    """By walking its attributes, and by asking Python for every array that is new."""
    gc.collect()
    before = alive()
    sim = Simulation(SCENES[scene](), device="cpu", precision="float64")
    new = alive()
    assert bytes_held_by(sim) == sum(size for at, size in new.items() if at not in before) > 10_000


def test_where_the_copies_do_not_fit_the_bytes_and_how_many_would_are_said(monkeypatch):
    copies = misfit().batches[7].copies[0]
    whole = bytes_held_by(copies.sim) + sum(a.capacity for a in copies.saved)
    monkeypatch.setattr(checkpoints, "free_bytes", lambda device: 0.6 * whole)
    with pytest.raises(SceneError, match="memory: a fit of 3 parameters runs 7 copies .* free on cpu: 4 copies fit; "
                                         "differences=\"forward\" takes 4 of them") as said:
        misfit()
    assert float(str(said.value).split("hold about ")[1].split()[0]) == pytest.approx(whole, rel=0.01)
    assert misfit("forward").batches[4].copies[0].worlds == 4


@pytest.mark.parametrize("part, mend", [(0.3, "2 copies fit; fit 1 of the parameters at a time, with differences=\"forward\""),
                                        (0.1, "0 copies fit; take fewer points")])
def test_where_fewer_fit_the_parameters_that_would_are_said(part, mend, monkeypatch):
    copies = misfit().batches[7].copies[0]
    whole = bytes_held_by(copies.sim) + sum(a.capacity for a in copies.saved)
    monkeypatch.setattr(checkpoints, "free_bytes", lambda device: part * whole)
    with pytest.raises(SceneError, match=mend):
        misfit()


def test_an_allocation_that_fails_is_said_with_bytes(monkeypatch):
    """Though there seemed to be room."""
    build = plan.build_plan

    def fails(scene, worlds, **more):
        if worlds > 1:
            raise RuntimeError("Failed to allocate 1000 bytes on device 'cpu'")
        return build(scene, worlds=worlds, **more)
    monkeypatch.setattr(plan, "build_plan", fails)
    with pytest.raises(SceneError, match=r"runs 7 copies of the scene at once, which hold about [0-9]+ bytes .*, and .* "
                                         r"are free"):
        misfit()
