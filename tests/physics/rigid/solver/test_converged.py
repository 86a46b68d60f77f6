"""Contacts solved to a residual, against an independent solution of the same problem in NumPy."""

from dataclasses import replace

import numpy as np

from tests.make.physics.rigid.contact import G, Seen, box, world
from wsim.kernels.rigid import soft_step
from wsim.simulation.simulation import Simulation

TOLERANCE, RUB = 1e-11, 0.5
OVERLAP = 1e-6             # [m] of each contact at the start, so that rounding does not decide which of them give way


def pushed(tolerance: float, frames: int, push=(2.0, 0.0, 0.7), n: int = 3, **more) -> Simulation:
    """A column of boxes, the second of which starts with a velocity: it slips on both neighbours, or takes them along."""
    boxes = [box(f"/box{k}", (0.0, 0.5 + k - (k + 1) * OVERLAP, 0.0), velocity=np.array(push) * (k == 1)) for k in range(n)]
    scene = replace(world(*boxes, **more).given, contact_tolerance=tolerance)
    sim = Simulation(scene, device="cpu", precision="float64")
    sim.run(frames)
    return sim


def reference(n: int, velocity: np.ndarray, h: float) -> np.ndarray:
    """Velocities (n, 6) of boxes of 1 m and 1000 kg after one substep with bias from a column at rest: corner by corner
    projected Gauss-Seidel, with Coulomb friction, until nothing changes by 1e-13."""
    bias = -soft_step.RATE * OVERLAP / h
    mass, spin = 1000.0, 1000.0 / 6.0
    W = np.diag(np.tile([1 / mass] * 3 + [1 / spin] * 3, n))
    v = np.zeros(6 * n)
    v.reshape(n, 6)[1, :3] = velocity
    v.reshape(n, 6)[:, 1] -= G * h
    rows = []
    for upper in range(n):
        for x in (-0.5, 0.5):
            for z in (-0.5, 0.5):
                J = np.zeros((3, 6 * n))
                for body, arm, sign in ((upper, (x, -0.5, z), 1.0), (upper - 1, (x, 0.5, z), -1.0)):
                    if body >= 0:
                        for axis in range(3):
                            e = np.eye(3)[axis]
                            J[axis, 6 * body:6 * body + 6] += sign * np.concatenate([e, np.cross(arm, e)])
                rows.append(J)
    P = np.zeros((len(rows), 3))
    for _sweep in range(20000):
        most = 0.0
        for k, J in enumerate(rows):
            K = J @ W @ J.T
            u = J @ v
            A = K[1, 1]
            push = max(0.0, P[k, 1] - (u[1] + soft_step.GIVES * A * P[k, 1] + bias) / (A * (1.0 + soft_step.GIVES)))
            more = np.array([0.0, push - P[k, 1], 0.0])
            v += W @ J.T @ more
            P[k] += more
            u = (J @ v)[[0, 2]]
            Kt = K[np.ix_([0, 2], [0, 2])]
            rub = P[k, [0, 2]] - (u * (u @ u) / (u @ Kt @ u) if u @ u > 0.0 else 0.0)
            if np.linalg.norm(rub) > RUB * push:
                rub *= RUB * push / np.linalg.norm(rub)
            rest = np.array([rub[0] - P[k, 0], 0.0, rub[1] - P[k, 2]])
            v += W @ J.T @ rest
            P[k] += rest
            most = max(most, np.abs(more).max() / mass, np.abs(rest).max() / mass)
        if most < 1e-13:
            return v.reshape(n, 6)
    raise AssertionError("the reference did not converge")


def test_a_substep_solves_for_the_velocities_of_an_independent_solution():
    """A frame of one substep, from rest: places tell the velocities with which boxes were placed."""
    h = 1.0 / 480.0
    for push in ((2.0, 0.0, 0.7), (0.02, 0.0, 0.0)):
        sim = pushed(TOLERANCE, 1, push, fps=480.0, substeps=1)
        assert 0.0 < sim.indicators()["rigid_residual"] <= TOLERANCE
        method = sim.plan.method("rigid")
        expected = reference(3, np.array(push), h)
        moved = (method.get("x") + method.get("e"))[:3] / h
        assert np.abs(moved - expected[:, :3]).max() < 1e-8 * np.abs(expected).max()
        turned = 2.0 * method.turns()[:3, :3] / h
        assert np.abs(turned - expected[:, 3:]).max() < 1e-6 * max(1.0, np.abs(expected).max())


def test_fixed_sweeps_come_near_to_the_converged_motion():
    """More sweeps, nearer."""
    exact = Seen(pushed(1e-9, 20)).poses
    apart = []
    for sweeps in (1, 4, 16):
        boxes = [box(f"/box{k}", (0.0, 0.5 + k, 0.0), velocity=(2.0 * (k == 1), 0.0, 0.7 * (k == 1))) for k in range(3)]
        sim = Simulation(replace(world(*boxes).given, iterations=sweeps), device="cpu", precision="float64")
        sim.run(20)
        apart.append(np.abs(Seen(sim).poses - exact).max())
    assert apart[2] < 0.5 * apart[0] and apart[2] < 2e-3


def test_a_column_in_the_converged_mode_sinks_as_statics_says():
    """The lowest contact of n boxes bears n weights: each corner sinks by what its share of the impulse gives way by."""
    n, h = 6, 1.0 / 480.0
    sim = pushed(1e-9, 240, (0.0, 0.0, 0.0), n)
    own = 1.0 / 1000.0 * (1.0 + 2.0 * 0.25 * 6.0)                # A_ii of a corner of a box on the ground
    share = 1000.0 * G * h / 4.0
    sinks = [(n - k) * share * own * (1.0 if k == 0 else 2.0) * soft_step.GIVES * h / soft_step.RATE for k in range(n)]
    assert abs((n - 0.5 - Seen(sim).at(f"/box{n - 1}")[1]) / sum(sinks) - 1.0) < 1e-3


def test_a_residual_over_the_tolerance_is_warned_of_and_one_under_it_is_not():
    """Of a box that slips between others 4000 sweeps leave some 1e-7 m/s."""
    assert not any("residual" in w for w in pushed(1e-5, 2, n=4).warnings)
    sim = pushed(1e-9, 2, n=4)
    left = sim.indicators()["rigid_residual"]
    assert left > 1e-9 and any("left with a residual of" in w and "contact_tolerance is 1e-09" in w for w in sim.warnings)
