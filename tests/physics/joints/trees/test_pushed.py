"""Trees in reduced coordinates that points and ropes push: closed forms, momentum, both coordinates, the same bits."""

import numpy as np
import pytest

from tests.physics.joints.trees.pushed import cube_on_link, loaded_bar, momenta, sheet_on_links, struck_rod
from wsim import Box, Scene, Simulation
from wsim.kernels.rigid.joint.tree.contact.link_star import solve_six

SOLVERS = [("xpbd", {"substeps": 20, "iterations": 4}), ("explicit", {"substeps": 60}), ("implicit", {"substeps": 8})]


def simulated(scene: Scene, **more) -> Simulation:
    simulation = Simulation(scene, **{"device": "cpu", "precision": "float64"} | more)
    assert "reduced coordinates" in simulation.plan.method("rigid").joints.what or scene.coordinates == "maximal"
    return simulation


def drift(scene: Scene, path: str, frames: int) -> tuple[float, float]:
    """Change of linear and angular momentum, over what there was behind the first frame."""
    simulation = simulated(scene)
    simulation.run(1)
    before = momenta(simulation, path)
    simulation.run(frames)
    now = momenta(simulation, path)
    return tuple(float(np.linalg.norm(b - a) / np.linalg.norm(a)) for a, b in zip(before, now, strict=True))


@pytest.mark.parametrize(("solver", "more"), SOLVERS)
@pytest.mark.parametrize("restitution", [0.0, 0.7])
def test_points_that_hit_a_hinged_rod_turn_it_by_their_angular_momentum(solver, more, restitution):
    """They stick by friction where they hit, then rebound: omega = m v x (1 / (I + m (x^2 + y^2)) + e / (I + m x^2))."""
    reach, mass = 0.2, 0.1
    simulation = simulated(struck_rod(reach, restitution, solver=solver, **more))
    simulation.run(8)
    inertia = 0.3 * ((0.4**2 + 0.04**2) / 12.0 + 0.2**2)
    spin = simulation.plan.method("rigid").spins()[0]
    expected = mass * reach * (1.0 / (inertia + mass * (reach**2 + 0.02**2)) + restitution / (inertia + mass * reach**2))
    assert spin == pytest.approx((0.0, 0.0, -expected), rel=1e-3, abs=1e-9)
    v = simulation.velocities("/points")[:, 1]
    assert v - spin[2] * reach == pytest.approx(restitution, abs=1e-3)


@pytest.mark.parametrize("tied", [True, False])
def test_a_soft_cube_and_two_links_in_flight_keep_their_momentum_by_leapfrog(tied):
    """Linear to rounding, angular to 1e-6: impulses act where a substep begins, as points have them."""
    linear, angular = drift(cube_on_link("reduced", tied, solver="explicit", substeps=30), "/cube", 12)
    assert linear < 1e-12 and angular < 1e-6


def test_cloth_that_hits_two_links_in_flight_keeps_momentum_with_them():
    linear, angular = drift(sheet_on_links("reduced", solver="explicit", substeps=30), "/sheet", 10)
    assert linear < 1e-12 and angular < 1e-5


@pytest.mark.parametrize(("solver", "more"), [("xpbd", {"substeps": 8, "iterations": 4}), ("implicit", {"substeps": 4})])
def test_linear_momentum_is_kept_by_implicit_solvers_too(solver, more):
    assert drift(sheet_on_links("reduced", solver=solver, **more), "/sheet", 10)[0] < 1e-10


def test_backward_euler_loses_less_angular_momentum_in_shorter_substeps():
    lost = [drift(cube_on_link("reduced", True, solver="implicit", substeps=n), "/cube", 12)[1] for n in (4, 8, 16)]
    assert lost[0] < 1e-2 and all(b < 0.6 * a for a, b in zip(lost, lost[1:], strict=False))


def test_both_coordinates_converge_to_the_same_motion():
    """Under gravity; the second link carries the cube. Bodies in maximal coordinates fall with order 1."""
    ends = {}
    for coordinates in ("maximal", "reduced"):
        for substeps in (15, 30):
            simulation = simulated(cube_on_link(coordinates, True, (0.0, -9.81, 0.0), solver="explicit", substeps=substeps))
            simulation.run(10)
            link = simulation.poses("/l0")["/l0"][:3, :3]
            ends[coordinates, substeps] = np.concatenate([simulation.positions("/cube"), link])
    apart = [np.abs(ends["maximal", n] - ends["reduced", n]).max() for n in (15, 30)]
    assert np.abs(ends["reduced", 15] - ends["reduced", 30]).max() < 0.1 * apart[1]
    assert apart[1] < 2e-3 and apart[1] == pytest.approx(0.5 * apart[0], rel=0.2)


def test_a_bar_of_welded_parts_bears_a_sheet_as_one_body_does():
    """Points push six links of a tree at once, each through all the others."""
    turned = []
    for parts, welded in ((1, False), (6, True)):
        simulation = simulated(loaded_bar(parts, welded))
        simulation.run(10)
        R = simulation.poses("/part0")["/part0"]
        turned.append(np.arctan2(R[1, 0], R[0, 0]))
    assert turned[0] < -0.1 and turned[1] == pytest.approx(turned[0], rel=1e-3)


def test_runs_restarts_resets_and_worlds_have_the_same_bits():
    def found(simulation: Simulation, world: int = 0) -> np.ndarray:
        link = simulation.poses("/l1", world=world)["/l1"]
        return np.concatenate([simulation.positions("/sheet", world=world).ravel(), link.ravel()])
    scene = sheet_on_links("auto", solver="xpbd", substeps=4, iterations=4)
    whole = simulated(scene, precision="float32")
    whole.run(8)
    first = found(whole)
    whole.reset()
    whole.run(4)
    again = simulated(scene, precision="float32")
    again.restart(4, {path: whole.fields(path) for path in whole.state.paths()})
    for simulation in (whole, again):
        simulation.run(4)
        assert np.array_equal(found(simulation), first)
    many = simulated(scene, precision="float32", worlds=2)
    many.run(8)
    assert all(np.array_equal(found(many, world), first) for world in (0, 1))


def test_six_equations_are_solved_with_pivots():
    """Zeros on the diagonal."""
    import warp as wp

    from wsim.kernels.rigid.joint.tree.tables import mat66d, vec6d

    @wp.kernel(module="unique", enable_backward=False)
    def solve(A: wp.array(dtype=mat66d), b: wp.array(dtype=vec6d), x: wp.array(dtype=vec6d)):
        x[0] = solve_six(A[0], b[0])
    A = np.random.default_rng(3).standard_normal((6, 6)) * (1.0 - np.eye(6))
    b, x = np.arange(6.0), wp.zeros(1, dtype=vec6d, device="cpu")
    given = [wp.array([A], dtype=mat66d, device="cpu"), wp.array([b], dtype=vec6d, device="cpu")]
    wp.launch(solve, 1, given, [x], device="cpu")
    assert x.numpy()[0] == pytest.approx(np.linalg.solve(A, b), abs=1e-12)


def test_a_rope_on_a_link_keeps_linear_momentum_and_hangs():
    """A rope of 8 edges between the end of two hinged rods in flight and nothing else."""
    scene = Scene(fps=60, gravity=(0.0, 0.0, 0.0), substeps=4)
    spin = np.array([0.0, 0.0, 6.0])
    rods = [scene.body(f"/l{k}", Box((0.15, 0.03, 0.03)), at=(x, 0.0, 0.0), mass=m, velocity=np.cross(spin, (x, 0.0, 0.0)),
                       spin=spin) for k, (x, m) in enumerate(((-0.16, 0.5), (0.16, 0.3)))]
    scene.joint("revolute", "/hinge", *rods, axis=(0, 0, 1))
    x = np.stack([np.linspace(0.31, 0.81, 9), np.zeros(9), np.zeros(9)], axis=1)
    rope = scene.rods("/rope", x, [9], diameters=0.01, young=1e7, velocities=np.cross(spin, x))
    scene.tie("/tie", rope, [0], rods[1])
    simulation = simulated(scene)
    strands, rigid = simulation.plan.method("rods"), simulation.plan.method("rigid")
    m = strands.table.values["m"].reshape(-1)[strands.table.place[0]]

    def linear() -> np.ndarray:
        return m @ strands.points(0)[1] + rigid.read("p").sum(0)
    simulation.run(1)
    before = linear()
    simulation.run(15)
    assert np.linalg.norm(linear() - before) < 1e-9 and simulation.indicators()["rod_tie_gap"] < 1e-7
