"""Limits, drives of bounded force and locked rows that act at once, against projected Gauss-Seidel sweeps in NumPy."""

from math import inf

import numpy as np
import pytest
import warp as wp

from tests.physics.joints.make import coordinates, errors, rod, start
from wsim.kernels.rigid.joint.elimination import EASE
from wsim.kernels.rigid.joint.parts import jointed_parts
from wsim.kernels.rigid.joint.tables import LIMITED, LOCKED
from wsim.physics.rigid.joints.joint import AXES, Drive, joint_between

NARROW = 1e-3
MOMENTS = (0.03, 0.05, 0.02)


def thrown(rng, path: str, at) -> object:
    motion = {"velocity": rng.normal(size=3), "spin": 4.0 * rng.normal(size=3)}
    return rod(path, at, mass=rng.uniform(0.5, 3.0), moments=MOMENTS, **motion)


def rows(rng, limited: int, driven: int) -> dict:
    """limits and drives of so many rows; the others are locked."""
    names = rng.permutation(AXES)
    limits = {name: (0.0, 0.0) for name in names}
    limits |= {name: tuple(NARROW * rng.uniform((-1, 0), (0, 1))) for name in names[:limited]}
    drives = {name: Drive(rng.uniform(0.0, 300.0), rng.uniform(1.0, 30.0), rng.normal(), rng.normal(),
                          rng.choice([0.5, 5.0, 50.0, inf])) for name in names[:driven]}
    return {"limits": limits, "drives": drives}


def swept(sim) -> dict:
    """One sweep of one substep; what rows asked for, and what they gave."""
    method = sim.plan.method("rigid")
    method.before_frame(0.0, sim.plan.clock)
    held, _ = jointed_parts(sim.plan.model.real, "test_pivots")
    steps, joints = wp.vec3i(0, 1, 1), method.joints
    wp.launch(held, joints.islands, [steps, 1.0 / 480.0, method.table, joints.linked, method.moving()], device="cpu")
    names = ("axis", "turn", "r_a", "r_b", "S", "under", "over", "much", "soft", "give", "hold", "push")
    t = {name: getattr(joints.linked.t, name).numpy() for name in ("a", "b", "w", "kind", "drive")}
    return {name: getattr(joints.linked, name).numpy() for name in names} | t


def matrix(f: dict) -> np.ndarray:
    """J M^-1 J^T of all rows."""
    n, bodies = len(f["a"]), len(f["w"])
    J, M = np.zeros((6 * n, 6 * bodies)), np.zeros((6 * bodies, 6 * bodies))
    for i in range(bodies):
        M[6 * i:6 * i + 3, 6 * i:6 * i + 3] = f["w"][i] * np.eye(3)
        M[6 * i + 3:6 * i + 6, 6 * i + 3:6 * i + 6] = f["S"][i]
    for j in range(n):
        for sign, body, r in ((-1.0, f["a"][j], f["r_a"][j]), (1.0, f["b"][j], f["r_b"][j])):
            if body >= 0:
                arm = np.cross(np.eye(3), r)                          # rows e_k x r: omega x r by omega
                J[6 * j:6 * j + 3, 6 * body:6 * body + 3] = sign * f["axis"][j]
                J[6 * j:6 * j + 3, 6 * body + 3:6 * body + 6] = sign * f["axis"][j] @ arm.T
                J[6 * j + 3:6 * j + 6, 6 * body + 3:6 * body + 6] = sign * f["turn"][j]
    return J @ M @ J.T


def gauss_seidel(f: dict) -> tuple[np.ndarray, float]:
    """Impulses of all rows, and what the last sweep changed of the largest, as a part."""
    A, z, more = matrix(f), np.zeros(f["kind"].size), 0.0
    names = ("under", "over", "much", "soft", "kind", "drive", "give")
    under, over, much, soft, kind, drive, most = (f[name].ravel() for name in names)
    for _ in range(40000):
        more = 0.0
        for r, own in enumerate(np.diag(A)):
            rest = A[r] @ z - own * z[r]
            new = np.clip((much[r] - rest) / (own + soft[r]), -most[r], most[r]) if drive[r] else 0.0
            if kind[r] == LOCKED or kind[r] == LIMITED and under[r] + rest + own * new < 0.0:
                new = (-under[r] - rest) / (own * (1.0 + float(EASE)))
            elif kind[r] == LIMITED and over[r] + rest + own * new > 0.0:
                new = (-over[r] - rest) / (own * (1.0 + float(EASE)))
            more, z[r] = max(more, abs(new - z[r])), new
        if more < 1e-14 * np.abs(z).max():
            break
    return z, more / np.abs(z).max()


@pytest.mark.parametrize("limited, driven", [(2, 0), (3, 0), (6, 0), (3, 2), (6, 6), (2, 6)])
def test_one_sweep_is_where_sweeps_of_single_rows_end(limited, driven):
    """Rows of a joint of the world, and of one behind it; thrown so that most limits are met at once."""
    rng, met = np.random.default_rng(10 * limited + driven), []
    for _ in range(6):
        a, b = thrown(rng, "/a", (0.3, 0.0, 0.0)), thrown(rng, "/b", (0.9, 0.1, 0.0))
        joints = [joint_between("/j", None, a, **rows(rng, limited, driven)),
                  joint_between("/k", a, b, at=(0.6, 0.1, 0.1), **rows(rng, limited, driven))]
        f = swept(start(a, b, *joints))
        z, left = gauss_seidel(f)
        found = (f["hold"] + f["push"]).ravel()
        assert left < 1e-13 and np.abs(found - z).max() < 1e-9 * np.abs(z).max()
        assert (np.abs(f["push"].ravel()) <= f["give"].ravel() * (1 + 1e-12)).all()
        met.append(np.sum((f["hold"] != 0.0) & (f["kind"] == LIMITED)))
    assert np.mean(met) >= 0.5 * limited                               # of both joints together


@pytest.mark.parametrize("names", [("rotY", "rotZ"), ("rotX", "rotY", "rotZ"), ("transX", "transY", "rotZ")])
def test_a_rod_in_narrow_limits_stays_in_all_of_them(names):
    """Each is met in the first substep, two or three at once; it comes to rest where gravity presses it."""
    body = rod("/b", (0.4, 0.1, 0.2), mass=2.0, moments=MOMENTS, velocity=(0.3, -0.5, 0.4), spin=(2.0, -3.0, 4.0))
    limits = {name: (0.0, 0.0) for name in AXES} | {name: (-NARROW, NARROW) for name in names}
    sim = start(body, joint_between("/j", None, body, at=(0.1, 0.2, -0.1), limits=limits), gravity=(1.0, -9.81, 3.0))
    k = [AXES.index(name) for name in names]
    for _ in range(60):
        sim.step()
        assert np.abs(coordinates(sim)[0, k]).max() < NARROW + 1e-9 and max(errors(sim)) < 1e-9
    assert np.abs(sim.plan.method("rigid").velocities()).max() < 1e-7               # EASE of the weight of a substep, 0.02 m/s
    assert (NARROW - np.abs(coordinates(sim)[0, k])).min() < 1e-9


def test_a_drive_at_a_limit_gives_what_it_gives_at_rest():
    """k (target - g) where its limit holds it, its most if that is less; the limit bears the difference to the weight."""
    found = []
    for most in (inf, 3.0):
        body = rod("/b", (1.0, 0.0, 0.0), mass=2.0)
        drives = {"rotX": Drive(20.0, 1.0, 0.5, most=most)}
        limits = {name: (0.0, 0.0) for name in AXES if name != "rotX"} | {"rotX": (-0.2, 0.1)}
        joint = joint_between("/j", None, body, axis=(0.0, 0.0, 1.0), limits=limits, drives=drives)
        sim = start(body, joint, gravity=(0.0, -1.0, 0.0))
        sim.run(240)
        J = sim.plan.method("rigid").joints.linked
        found.append((coordinates(sim)[0, 3], J.push.numpy()[0, 3] * 480.0, J.hold.numpy()[0, 3] * 480.0))
    (g, push, hold), (other, less, more) = found
    turn = 2.0 * np.cos(0.1)
    assert g == pytest.approx(0.1, abs=1e-9) and push == pytest.approx(20.0 * 0.4, rel=1e-6)
    assert hold == pytest.approx(turn - push, rel=1e-6)
    assert other == pytest.approx(0.1, abs=1e-9) and less == pytest.approx(3.0, rel=1e-12)
    assert more == pytest.approx(turn - 3.0, rel=1e-6)
