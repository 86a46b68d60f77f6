"""Impulses between carriers: inverse masses, momentum, and what a pair does that theory can say. float64, CPU."""

import numpy as np
import pytest
import warp as wp

from tests.physics.carrier.rig import INTEGRATORS, REAL, Bodies, H, Points, Rig, T, Walls, array, feature, matrix, rotation
from wsim.kernels.carrier.body import body, kinematic, turned
from wsim.kernels.carrier.points import points
from wsim.model.stage import Clock
from wsim.scene.integrator import TABLE

CLOCK = Clock(H, 1, 1, TABLE["backward_euler"], starting=False)
FEATURES = {"point": feature(1), "edge": feature((0, 1), (0.3,)), "triangle": feature((0, 1, 2), (0.2, 0.5)),
            "tet": feature((0, 1, 2, 3), (0.2, 0.3, 0.4)), "body": feature(0, (0.3, -0.2, 0.4))}


def some(name: str, rng, integrator: str = "backward_euler", at=None):
    """A side with a feature of this kind, its place [m] at `at`, moving at random."""
    at = np.zeros(3) if at is None else at
    if name == "body":
        arm = rng.normal(size=3)
        side = Bodies([1.7], [(0.3, 0.5, 0.7)], [at - arm], [rng.normal(size=3)], [rng.normal(size=3)], [rotation(rng)])
        return side, feature(0, arm), at
    if name == "kinematic":
        return Walls([at], [rng.normal(size=3)]), feature(0, np.zeros(3)), at
    ids, where = FEATURES[name]
    weights = np.array([1.0 - where.sum(), *where])
    x = rng.normal(size=(4, 3))
    x += at - sum(b * x[i] for b, i in zip(weights, ids, strict=True))
    return Points(rng.uniform(0.5, 3.0, 4), x, rng.normal(size=(4, 3)), integrator, (0.3, -0.2, 0.1)), (ids, where), at


def pushing(formulas):
    """Kernel: one feature takes the impulse p; W of it."""
    F = formulas(REAL)

    def push_one(data: F.Data, id: wp.vec4i, at: T.vec3, p: T.vec3, out: F.Pushed, W_out: wp.array(dtype=T.mat33)):
        W_out[0] = F.mass(data, id, at)
        F.take(data, id, at, p, out)
    return wp.kernel(push_one, name=f"push_one_{F.name}", module="unique", enable_backward=False)


PUSHING = {"points": pushing(points), "body": pushing(body)}


@pytest.mark.parametrize(("name", "integrator"), [(name, i) for name in FEATURES for i in INTEGRATORS
                                                  if name != "body" or i == "backward_euler"])
def test_inverse_mass_is_the_second_difference_of_the_kinetic_energy_by_the_impulse(name, integrator):
    """Energy is quadratic in p: E(n) - 2 E(0) + E(-n) = n.W n, and E of the side's own velocities knows nothing of W. It holds
    whatever the integrator, so that each turns p into the same change of velocity."""
    n = np.array((2.0, -1.0, 2.0)) / 3.0
    energies, W = [], np.zeros((3, 3))
    for size in (1.0, 0.0, -1.0):
        side, (ids, where), _ = some(name, np.random.default_rng(3), integrator)
        side.predict()
        data, out = side.at(CLOCK, 0)
        found = wp.zeros(1, dtype=T.mat33, device="cpu")
        wp.launch(PUSHING["body" if name == "body" else "points"], 1,
                  [data, wp.vec4i(*map(int, ids)), T.vec3(*where), T.vec3(*(size * n))], [out, found], device="cpu")
        side.finish()
        energies.append(side.energy())
        W = found.numpy()[0]
    assert abs(energies[0] - 2.0 * energies[1] + energies[2] - n @ W @ n) < 64 * 2.2e-16 * max(energies)
    assert n @ W @ n > 0.1


PAIRS = [("point", "triangle"), ("edge", "edge"), ("point", "body"), ("triangle", "body"), ("body", "body"), ("point", "tet")]
MIXED = [("backward_euler", "backward_euler"), ("backward_euler", "bdf2"), ("bdf2", "implicit_midpoint"),
         ("bdf2", "bdf2"), ("implicit_midpoint", "backward_euler")]


def together(a: str, b: str, integrators, seed: int = 0):
    """Two sides that touch at the origin and approach at random, the pair between them with friction and a rebound."""
    rng = np.random.default_rng(seed)
    side_a, feature_a, _ = some(a, rng, integrators[0])
    side_b, feature_b, _ = some(b, rng, integrators[1])
    n = rng.normal(size=3)
    n /= np.linalg.norm(n)
    rows = [{"a": feature_a, "b": feature_b, "n": n * sign, "gap": -1e-3, "friction": (0.4, 0.3), "bounce": (0.5, -1.0),
             "keys": (k, k)} for k, sign in enumerate((1.0, -1.0))]
    return side_a, side_b, rows


@pytest.mark.parametrize("integrators", MIXED, ids="-".join)
@pytest.mark.parametrize(("a", "b"), PAIRS)
def test_linear_and_angular_momentum_are_kept_to_rounding(a, b, integrators):
    """Of both together, beside what they have without each other; with friction, a rebound and few sweeps."""
    momenta = []
    for alone in (True, False):
        side_a, side_b, rows = together(a, b, integrators)
        about = [side_a.place(), side_b.place()]
        rig = Rig((side_a, side_b))
        rig.substep([] if alone else rows, sweeps=2)
        momenta.append(rig.momentum(about))
    given = np.linalg.norm(rig.total(), axis=1).max()
    assert given > 0.1, "nothing was exchanged"
    assert np.abs(momenta[1] - momenta[0]).max() < 1e-13 * (10.0 + given)


def test_a_kinematic_partner_takes_nothing_and_is_not_moved():
    """What a triangle has gained is the impulse of the pair; the triangle does not go into the wall."""
    rng = np.random.default_rng(1)
    wall, of_wall, _ = some("kinematic", rng)
    side, of_side, _ = some("triangle", rng)
    n = np.array((0.0, 0.0, 1.0))
    side.state.v.assign(side.velocity() - (0.0, 0.0, 5.0))
    other = Points(side.masses, side.place(), side.velocity(), gravity=side.gravity)
    rig = Rig((side, wall))
    rig.substep([{"a": of_side, "b": of_wall, "n": n, "gap": 0.0}])
    other.predict()
    other.finish()
    gained = side.masses @ (side.velocity() - other.velocity())
    assert np.abs(gained - rig.total()[0]).max() < 1e-13 * np.abs(gained).max() and gained[2] > 1.0
    ids, where = of_side
    weights = np.array([1.0 - where.sum(), *where])
    end = sum(b * side.place()[i] for b, i in zip(weights, ids, strict=True))
    step = wall.contacts.table.step.numpy()[0, 0, :3]
    assert abs(end[2] - step[2]) < 1e-14


@pytest.mark.parametrize("integrators", MIXED, ids="-".join)
def test_momentum_stays_what_it_was_in_the_steps_after(integrators):
    """A multistep formula would multiply the impulse by 3/2 in the steps that follow: its history is put right. Without gravity
    the velocities of the substep of the impact stay for ever."""
    a, b = (Points([m], [[x, 0.0, 0.0]], [-u, 0.0, 0.0], i) for m, x, u, i in
            zip((1.0, 3.0), (0.001, 0.0), (1.0, -0.5), integrators, strict=True))
    rig = Rig((a, b))
    rig.substep([{"a": feature(0), "b": feature(0), "n": (1.0, 0.0, 0.0), "gap": 0.001}])
    first = [a.velocity()[0, 0], b.velocity()[0, 0]]
    for _ in range(5):
        rig.substep([])
    assert abs(1.0 * first[0] + 3.0 * first[1] - 0.5) < 1e-14
    assert max(abs(a.velocity()[0, 0] - first[0]), abs(b.velocity()[0, 0] - first[1])) < 1e-13


@pytest.mark.parametrize("integrators", MIXED, ids="-".join)
@pytest.mark.parametrize("restitution", [0.0, 0.4, 1.0])
def test_a_head_on_pair_leaves_as_newton_says(integrators, restitution):
    """v = (sum m u - e m' (u - u')) / sum m; e = 1 keeps the energy. Touching when the substep begins."""
    m, u = np.array((1.0, 3.0)), np.array((-1.0, 0.5))
    a, b = (Points([m[k]], [[0.0, 0.0, 0.0]], [u[k], 0.0, 0.0], integrators[k]) for k in range(2))
    rig = Rig((a, b))
    rig.substep([{"a": feature(0), "b": feature(0), "n": (1.0, 0.0, 0.0), "gap": 0.0,
                  "bounce": (restitution, u[0] - u[1])}])
    mean, apart = m @ u / m.sum(), -restitution * (u[0] - u[1])
    assert abs(a.velocity()[0, 0] - (mean + m[1] * apart / m.sum())) < 1e-14
    assert abs(b.velocity()[0, 0] - (mean - m[0] * apart / m.sum())) < 1e-14


def test_two_equal_masses_meet_half_way():
    """One visit, and by the inverse of their masses where these are not equal."""
    for masses in ((1.0, 1.0), (1.0, 4.0)):
        a = Points(masses[:1], [[0.01, 0.0, 0.0]], [-3.0, 0.0, 0.0])
        b = Points(masses[1:], [[-0.01, 0.0, 0.0]], [3.0, 0.0, 0.0])
        rig = Rig((a, b))
        rig.substep([{"a": feature(0), "b": feature(0), "n": (1.0, 0.0, 0.0), "gap": 0.02}])
        meet = masses[0] * -0.02 / sum(masses) + masses[1] * 0.02 / sum(masses)       # of the predicted places, weighted
        assert abs(a.place()[0, 0] - b.place()[0, 0]) < 1e-16 and abs(a.place()[0, 0] - meet) < 1e-16


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_friction_is_coulombs(integrator):
    """Pressed by N, pushed aside by S, h together: sticks for S <= mu_s N, else is held back by mu_d N."""
    mu, g = (0.5, 0.4), 10.0
    for slope, sticks in ((0.49, True), (0.51, False), (2.0, False)):
        a = Points([2.0], [[0.0, 0.0, 0.0]], [0.0, 0.0, 0.0], integrator, (slope * g, 0.0, -g))
        a.state.s.assign(np.zeros((1, 3)))
        a.state.u.assign(np.zeros((1, 3)))
        wall = Walls([(0.0, 0.0, 0.0)], [(0.0, 0.0, 0.0)])
        rig = Rig((a, wall), sweeps=8)
        rig.substep([{"a": feature(0), "b": feature(0, np.zeros(3)), "n": (0.0, 0.0, 1.0), "gap": 0.0, "friction": mu}])
        P = rig.total()[0]
        if sticks:
            assert np.abs(a.velocity()).max() < 1e-15
        else:
            assert abs(P[0] + mu[1] * P[2]) < 1e-14 and P[1] == 0.0 and a.velocity()[0, 0] > 0.0
            assert abs(2.0 * a.velocity()[0, 0] - (2.0 * slope * g * H * share(integrator) + P[0])) < 1e-14


def share(integrator: str) -> float:
    """Of h that a force adds to the velocity in the first substep from rest, without a history."""
    return 2.0 / 3.0 if integrator == "bdf2" else 1.0


def test_a_body_is_hit_off_its_centre_as_newton_and_euler_say():
    """A rod on a peg: m 1, L 2, falls at 4, its end meets what does not move, e = 1/2: impulse 1.5, v -2.5, spin 4.5."""
    rod = Bodies([1.0], [(1.0, 1.0 / 3.0, 1.0 / 3.0)], [(0.0, 0.0, 0.0)], [(0.0, 0.0, -4.0)], [(0.0, 0.0, 0.0)],
                 [(0.0, 0.0, 0.0, 1.0)])
    peg = Walls([(-1.0, 0.0, 0.0)], [(0.0, 0.0, 0.0)])
    rig = Rig((rod, peg))
    rig.substep([{"a": feature(0, (-1.0, 0.0, 0.0)), "b": feature(0, np.zeros(3)), "n": (0.0, 0.0, 1.0), "gap": 0.0,
                  "bounce": (0.5, -4.0)}], sweeps=8)
    assert np.abs(rig.total()[0] - (0.0, 0.0, 1.5)).max() < 1e-12
    assert abs(rod.v[0, 2] + 2.5) < 1e-12 and abs(rod.omega[0, 1] - 4.5) < 1e-12 and abs(rod.energy() - 6.5) < 1e-11


def test_a_body_that_turns_far_carries_its_places_along():
    """exp([t]x) r - r against a rotation matrix, from 1e-9 to 3 rad: to rounding of r t."""
    rotate = turned(REAL)

    def turn_places(t: wp.array(dtype=T.vec3), r: wp.array(dtype=T.vec3), out: wp.array(dtype=T.vec3)):
        i = wp.tid()
        out[i] = rotate(t[i], r[i])
    rng = np.random.default_rng(0)
    axes, r, angles = rng.normal(size=(40, 3)), rng.normal(size=(40, 3)), np.geomspace(1e-9, 3.0, 40)
    t = angles[:, None] * axes / np.linalg.norm(axes, axis=1)[:, None]
    out = wp.zeros(40, dtype=T.vec3, device="cpu")
    wp.launch(wp.kernel(turn_places, name="turn_places", module="unique", enable_backward=False), 40,
              [array(t), array(r)], [out], device="cpu")
    for angle, rotation_vector, arm, found in zip(angles, t, r, out.numpy(), strict=True):
        half = rotation_vector / angle * np.sin(0.5 * angle)
        expected = 2.0 * (np.cos(0.5 * angle) * np.cross(half, arm) + np.cross(half, np.cross(half, arm)))
        assert np.abs(found - expected).max() < 1e-14 * angle * np.linalg.norm(arm)


def test_a_kinematic_body_that_turns_and_goes_far_carries_its_places_along():
    """T1 q - T0 q of two poses 3 km away, without their rounding."""
    F, rng = kinematic(REAL), np.random.default_rng(2)
    p0, q0, q = 3000.0 * rng.normal(size=3), rotation(rng), rng.normal(size=3)
    turn, moved = np.array((0.1, -0.2, 0.05, 0.0)), rng.normal(size=3)
    turn[3] = np.sqrt(1.0 - turn[:3] @ turn[:3])
    R0, R = matrix(q0), matrix(turn)
    v, w = turn[:3], turn[3]
    q1 = np.append(w * q0[:3] + q0[3] * v + np.cross(v, q0[:3]), w * q0[3] - v @ q0[:3])        # turn q0

    def carried(data: F.Data, at: T.vec3, out: wp.array(dtype=T.vec3)):
        out[0] = F.way(data, wp.vec4i(0), at)
        out[1] = F.place(data, wp.vec4i(0), at)
    data = F.Data()
    data.pose = array([[np.append(p0, q0)], [np.append(p0 + moved, q1)]], T.transform)
    data.step = array([[np.append(moved, turn)]], T.transform)
    data.h = H
    out = wp.zeros(2, dtype=T.vec3, device="cpu")
    wp.launch(wp.kernel(carried, name="carried", module="unique", enable_backward=False), 1, [data, T.vec3(*q)], [out],
              device="cpu")
    assert np.abs(out.numpy()[0] - (moved + (R - np.eye(3)) @ R0 @ q)).max() < 4e-15
    assert np.abs(out.numpy()[1] - (p0 + R0 @ q)).max() < 1e-12
