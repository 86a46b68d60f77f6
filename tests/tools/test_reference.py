"""The measuring instrument itself: order, energy, its own error estimate, closed forms."""

import numpy as np
import pytest

from tools.bench.nets import garments, membrane, reference
from tools.bench.nets.converged import converged
from tools.bench.nets.reference import Net, rms
from wsim.scene import Scene, shapes

FRAME = 1.0 / 60.0


@pytest.fixture(scope="module")
def small():
    """A 5 x 5 net, soft enough that 0.1 s is some fifty steps; and its exact position then, to 1e-12 m."""
    net = reference.net(reference.spring_cloth(5, stretch=100.0, diagonal=60.0, cross=2.0))
    positions, error = reference.exact(net, (0.1,), tolerance=1e-12)
    assert error < 1e-12
    return net, positions[0]


def chain(n=6, k=200.0, m=0.05):
    """A hanging chain of n springs and n masses under a pin."""
    points = np.stack([np.zeros(n + 1), -0.1 * np.arange(n + 1), np.zeros(n + 1)], axis=1)
    edges = np.stack([np.arange(n), np.arange(1, n + 1)], axis=1)
    return Net(points, edges, np.full(n, k), np.full(n + 1, m), np.array([0]))


def ratios(errors):
    return np.array(errors[:-1]) / np.array(errors[1:])


def test_runge_kutta_is_of_order_four(small):
    net, x = small
    errors = []
    for steps in (60, 120, 240):
        y, _ = reference.runge_kutta(net, net.points, np.zeros_like(x), 0.1 / steps, steps)
        errors.append(rms(y - x))
    assert np.all(np.abs(np.log2(ratios(errors)) - 4.0) < 0.2)


def test_energy_is_kept(small):
    """Runge-Kutta's relative energy error for a frequency w is (h w)^6 / 72 a step; the sum stays under its bound."""
    net, _ = small
    steps, energy = 480, []
    h = 0.1 / steps
    for count in (0, steps):
        energy.append(net.energy(*reference.runge_kutta(net, net.points, np.zeros_like(net.points), h, count)))
    drop = net.masses.sum() * 9.81 * 0.5 * 0.1 ** 2 * 9.81          # energy that gravity turns over in 0.1 s
    assert abs(energy[1] - energy[0]) < steps * (h * net.frequency()) ** 6 / 72.0 * drop + 1e-15


def test_the_error_estimate_is_the_error(small):
    net, x = small
    positions, error = reference.exact(net, (0.1,), tolerance=1e-6)
    assert 0.7 < rms(positions[0] - x) / error < 1.4                # what Richardson neglects is a power of h smaller


def test_pins_stay_and_the_centre_of_a_free_net_falls_freely():
    scene = reference.spring_cloth(4)
    net = reference.net(scene)
    positions, _ = reference.exact(net, (0.05, 0.1), tolerance=1e-7)
    assert np.array_equal(positions[:, :4], np.broadcast_to(net.points[:4], (2, 4, 3)))
    scene.pins.clear()
    x, _ = reference.runge_kutta(reference.net(scene), net.points, np.full_like(net.points, 0.1), 1e-4, 1000)
    fall = x.mean(axis=0) - net.points.mean(axis=0)
    assert np.allclose(fall, (0.01, 0.01 - 0.5 * 9.81 * 0.01, 0.01), atol=1e-13)


@pytest.mark.parametrize("integrator, order", [("backward_euler", 1), ("bdf2", 2)])
def test_converged_integrators_have_their_order(small, integrator, order):
    pytest.importorskip("scipy")
    net, x = small
    errors = [rms(converged(net, (0.1,), 0.1 / steps, integrator)[0] - x) for steps in (80, 160, 320)]
    assert np.all(np.abs(np.log2(ratios(errors)) - order) < 0.25)


def test_converged_backward_euler_solves_its_equation(small):
    """One step: M (v - h g) = h F(x + h v) to rounding, and the energy does not grow."""
    pytest.importorskip("scipy")
    net, _ = small
    h, seen = 1e-2, []
    converged(net, (h,), h, "backward_euler", each=lambda t, x, v: seen.append((x, v)))
    (x, v), free = seen[0], net.free
    residual = free * (net.masses[:, None] * (v - h * np.asarray(net.gravity)) - h * net.forces(x))
    assert np.max(np.abs(residual)) < 1e-12 * net.masses[0] / h
    assert net.energy(x, v) < net.energy(net.points, np.zeros_like(x))


def test_a_folder_keeps_the_result_and_another_net_is_another_result(tmp_path, small):
    net, _ = small
    first = reference.exact(net, (0.1,), 1e-6, folder=tmp_path)
    assert len(list(tmp_path.iterdir())) == 1
    again = reference.exact(net, (0.1,), 1e-6, folder=tmp_path)
    assert np.array_equal(first[0], again[0]) and first[1] == again[1]
    reference.exact(reference.net(reference.spring_cloth(5)), (0.1,), 1e-6, folder=tmp_path)
    assert len(list(tmp_path.iterdir())) == 2


def test_a_hanging_chain_rests_at_its_closed_form():
    net = chain()
    stretch = reference.chain_stretch(net.stiffness, net.masses[1:])
    assert np.isclose(stretch.sum(), 0.05 * 9.81 * 6 * 7 / 2 / 200.0, rtol=1e-14)
    x = net.points.copy()
    x[1:, 1] -= np.cumsum(stretch)
    assert np.max(np.abs(net.acceleration(x))) < 1e-11 * 9.81 * 200.0      # rounding of lengths times k / m


def test_a_chain_in_its_first_mode_turns_round_after_half_a_period():
    net = chain()
    omega = reference.chain_frequency(net.stiffness, net.masses[1:])
    assert np.isclose(omega, 2.0 * np.sqrt(200.0 / 0.05) * np.sin(np.pi / 26.0), rtol=1e-12)
    rest = net.points.copy()
    rest[1:, 1] -= np.cumsum(reference.chain_stretch(net.stiffness, net.masses[1:]))
    mode = np.zeros_like(rest)
    mode[:, 1] = 1e-3 * np.sin(np.pi * np.arange(7) / 13.0)                # the chain along y is linear: exact mode
    steps = 2000
    x, _ = reference.runge_kutta(net, rest + mode, np.zeros_like(rest), np.pi / omega / steps, steps)
    assert np.max(np.abs(x - (rest - mode))) < 1e-3 * np.pi * (np.pi / steps) ** 4


def test_a_light_cantilever_drops_by_the_beam_formula():
    """w L^4 / 8 B; the next term is of relative order (w L^3 / B)^2."""
    load = 1e-3
    reach, drop = reference.cantilever(1.0, load, 1.0)
    assert abs(drop / (load / 8.0) - 1.0) < load ** 2 and abs(reach - 1.0) < load ** 2


def test_a_heavy_cantilever_meets_peirces_angle():
    """Peirce 1930: an overhang of twice the bending length (B / w)^(1/3) hangs at 41.5 degrees; his fit is as good."""
    reach, drop = reference.cantilever(1.0, 1.0, 2.0)
    assert np.degrees(np.arctan2(drop, reach)) == pytest.approx(41.5, rel=0.02)
    assert reach ** 2 + drop ** 2 < 4.0


def test_what_the_reference_does_not_know_is_refused():
    scene = reference.spring_cloth(4)
    scene.springs[0].damping = 0.1
    with pytest.raises(ValueError, match="neither damping"):
        reference.net(scene)
    with pytest.raises(ValueError, match="one spring net"):
        reference.net(Scene())
    net = reference.net(reference.spring_cloth(4))
    with pytest.raises(ValueError, match="multiples of the step"):
        reference.exact(net, (0.02,))
    with pytest.raises(ValueError, match="allowed is"):
        converged(net, (0.1,), FRAME, "midpoint")


# membranes, and what garments are judged by

def test_a_stretched_triangle_is_pulled_down_its_energy():
    """The first step against differences of U = A (mu / 2 (tr F^T F - 2) + (lambda + mu) / 2 (J - a)^2)."""
    body = membrane.Membrane(np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.03, 0.08, 0.02]]), np.array([[0, 1, 2]]),
                             np.array([0]), (0.0, 0.0, 0.0))
    body.inverse = body.inverse @ np.array([[0.9, 0.05], [0.0, 0.8]])          # which it is not at rest with

    def energy(x):
        F = (x[1:] - x[0]).T @ body.inverse[0]
        J = np.linalg.norm(np.cross(F[:, 0], F[:, 1]))
        whole = body.lame + body.mu
        return body.areas[0] * (0.5 * body.mu * (np.trace(F.T @ F) - 2.0) + 0.5 * whole * (J - 1.0 - body.mu / whole)**2)
    steps = 1e-6 * np.eye(9).reshape(9, 3, 3)
    slope = np.array([energy(body.points + d) - energy(body.points - d) for d in steps]).reshape(3, 3) / 2e-6
    h = 1e-6
    moved = body.trajectory(1, 1, h, "cpu")[0] - body.points
    assert np.array_equal(moved[0], np.zeros(3))
    assert moved[1:] == pytest.approx(-0.5 * h * h * slope[1:] / body.masses[1:, None], rel=1e-4)


def test_a_peak_is_the_largest_strain_of_an_edge_in_the_authors_order():
    """One point of 81 goes up by half the spacing above it: that edge has strain 1/2, whatever order solvers have."""
    scene = Scene()
    points, counts, indices = shapes.sheet(0.8, 0.8, 8, 8, cut="quads")
    cloth = scene.cloth("/sheet", points, counts, indices)
    x = points.copy()
    x[13, 1] -= 0.05
    assert garments.peak(cloth, points) == pytest.approx(0.0, abs=1e-6)
    assert garments.peak(cloth, x) == pytest.approx(0.5, rel=1e-5)


def test_refined_shirts_hang_on_a_dummy_that_sways():
    found = garments.shirt(1)
    assert len(found.cloths[0].points) == 25610
    start, quarter, turn = (found.colliders[0].motion.at(t) for t in (0.0, 0.25 / garments.RATE, 3.0 / garments.RATE))
    assert quarter[0, 3] - start[0, 3] == pytest.approx(garments.SWAY) and np.allclose(turn, start, atol=1e-12)
