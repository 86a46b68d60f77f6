"""Mass for the points of slivers: how much, for how much longer steps, and what stays."""

from dataclasses import replace

import numpy as np
import pytest

import wsim
from wsim.physics.motion import frequency
from wsim.physics.motion.frequency import RowSums
from wsim.physics.motion.fused.mass_scaling import MOST, WORTH, add_sliver_mass
from wsim.scene import Scene, shapes
from wsim.scene.fabric import Fabric
from wsim.simulation.predicted.errors import SLIVERS

SIDE = 72              # points of a side: two of them weigh a 2500th of it
FABRIC = Fabric(stretch=500.0, shear=100.0, bend=1e-5, thickness=1e-3)


def pinched(share: float) -> Scene:
    """A sheet with one point moved towards its neighbour, to a share of their distance."""
    points, counts, indices = shapes.sheet(1.0, 1.0, SIDE, SIDE)
    a = 20 * (SIDE + 1) + 20
    b = a + 1
    points[b] = points[a] + share * (points[b] - points[a])
    scene = Scene(solver="explicit")
    scene.pin("/pin", scene.cloth("/cloth", points, counts, indices, material=FABRIC), range(SIDE + 1))
    return scene


def test_a_sliver_sets_the_step_no_more():
    sim, scene = wsim.Simulation(pinched(0.05), device="cpu"), pinched(0.05)
    scene.integrator, scene.substeps = "leapfrog", 2000              # a named integrator is taken as it is
    alone = wsim.Simulation(scene, device="cpu")
    (body,), (before,) = sim.model.bodies, alone.model.bodies
    assert 0.0 < body.masses.sum() / before.masses.sum() - 1.0 <= MOST
    assert (body.masses > before.masses).sum() < 20 and (body.masses >= before.masses).all()
    assert frequency.frequency_bound(sim.model)[0] < frequency.frequency_bound(alone.model)[0] / WORTH
    assert "more mass" in sim.plan.choice.why and "/cloth" in sim.plan.choice.why


def test_no_point_is_faster_than_the_bound_after():
    sim = wsim.Simulation(pinched(0.05), device="cpu")
    (body,) = sim.model.bodies
    square = (RowSums(sim.model).of(body)[0] / body.masses)[SIDE + 1:]
    assert square.max() == pytest.approx(frequency.frequency_bound(sim.model)[0]**2, rel=0.2)
    assert not add_sliver_mass(sim.model)                             # once is enough


def test_auto_takes_leapfrog_with_mass_at_slivers_where_they_alone_make_it_dear():
    """Without the pinch leapfrog is chosen as it is; with it, of fewer steps than its masses would need. What mass leaves is in
    the error that is said. Where a rate is to be held it is one of the ways."""
    like, pinch = (wsim.Simulation(replace(pinched(share), solver="auto"), device="cpu") for share in (1.0, 2e-3))
    rate = wsim.Simulation(replace(pinched(2e-3), solver="auto"), device="cpu", fps=0.5 / pinch.plan.seconds)
    own = wsim.Simulation(replace(pinched(2e-3), solver="xpbd"), device="cpu").model
    assert like.plan.choice.solver == "explicit" and not like.plan.choice.slowed
    assert pinch.plan.choice.solver == "explicit" and pinch.plan.choice.slowed and "more mass" in pinch.plan.choice.why
    assert 0.0 < pinch.model.bodies[0].masses.sum() / own.bodies[0].masses.sum() - 1.0 <= MOST
    assert pinch.plan.choice.error > SLIVERS > like.plan.choice.error
    assert rate.plan.choice.why.count("leapfrog") == 2
    assert frequency.frequency_bound(pinch.model)[0] < frequency.frequency_bound(own)[0] / WORTH


def test_every_world_has_the_mass_that_one_alone_is_given():
    scene = replace(pinched(2e-3), solver="auto", fps=2000.0)
    alone, both = (wsim.Simulation(scene, device="cpu", worlds=worlds) for worlds in (1, 2))
    assert alone.plan.choice == both.plan.choice and alone.plan.choice.slowed
    assert all(np.array_equal(body.masses, alone.model.bodies[0].masses) for body in both.model.bodies)


@pytest.mark.parametrize("settings", [{}, {"solver": "xpbd"}, {"integrator": "leapfrog", "substeps": 1000}])
def test_a_mesh_of_like_triangles_and_other_solvers_keep_their_masses(settings):
    scene = pinched(0.05 if settings else 1.0)
    for name, value in settings.items():
        setattr(scene, name, value)
    sim = wsim.Simulation(scene, device="cpu")
    assert sim.model.bodies[0].masses.sum() == pytest.approx(FABRIC.density * FABRIC.thickness, rel=1e-9)
    assert "more mass" not in sim.plan.choice.why


def test_the_highest_eigenvalue_of_symmetric_matrices_is_lapacks():
    B = np.random.default_rng(1).normal(size=(50, 3, 3))
    A = B @ B.swapaxes(1, 2)
    A[:3] = np.diag([2.0, 2.0, 2.0]), np.diag([1.0, 5.0, 5.0]), np.zeros((3, 3))
    root = 1e-8                                             # of rounding, by which an angle errs where two are equal
    assert frequency.largest_eigenvalue(A) == pytest.approx(np.linalg.eigvalsh(A)[:, -1], rel=root, abs=1e-300)


def test_curvatures_of_triangles_are_sums_over_their_hinges():
    """J of each triangle, place by place, against the sum over slots and corners; a point of two hinges stands once."""
    slot, ids = np.array([[0, 1, -1], [1, 2, 0]]), np.array([[0, 1, 2, 3], [2, 1, 4, 0], [4, 2, 5, 1]])
    rng = np.random.default_rng(2)
    value, J = rng.normal(size=(2, 3, 3)), rng.normal(size=(3, 4, 3))
    points, found = frequency.point_curvatures(slot, value, ids, J)
    for t in range(2):
        dense = np.zeros((3, 6, 3))
        for s, q in enumerate(slot[t]):
            for k in range(4 * (q >= 0)):
                dense[:, ids[q, k]] += value[t, s][:, None] * J[q, k]
        again = np.zeros_like(dense)
        for place, p in enumerate(points[t]):
            again[:, p] += found[t, :, place]
        assert again == pytest.approx(dense, rel=1e-12, abs=1e-14)
        used = points[t][np.abs(found[t]).sum(axis=(0, 2)) > 0]
        assert len(np.unique(used)) == len(used)
