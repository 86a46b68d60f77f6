"""Inverse kinematics and inverse dynamics of trees of joints: round trips, limits, poses of rest, goals out of reach."""

import numpy as np
import pytest

from tests.physics.joints.trees.chains import chain_scene
from wsim import Box, Goal, JointTree, Scene, SceneError, Simulation
from wsim.geometry import rotation

END = np.array([0.0, 0.0, 0.1])
HAND = "/l6"


def arm_scene(count: int = 7, at=(0.0, 0.0, 0.0), size: float = 1.0) -> Scene:
    """Links of 0.2 m that stand on each other; hinges turn about z and y in turn, up to 2.6 and 2 rad."""
    scene = Scene(up="Z")
    last, place = None, np.array(at, np.float64)
    for k in range(count):
        body = scene.body(f"/l{k}", Box((0.02 * size, 0.03 * size, 0.1 * size)), at=place + [0, 0, 0.1 * size])
        low = 2.0 if k % 2 else 2.6
        scene.joint("revolute", f"/j{k}", last, body, at=place, axis=(0, 1, 0) if k % 2 else (0, 0, 1), low=-low, high=low)
        last, place = body, place + [0, 0, 0.2 * size]
    return scene


def reached_goals(tree: JointTree, q: np.ndarray, end=END, turned: bool = True) -> Goal:
    """The goal that the hand has at some coordinates."""
    M = tree.poses(q)[HAND]
    return Goal(HAND, M[:, :3, :3] @ end + M[:, :3, 3], rotation.matrix_quat(M[:, :3, :3]) if turned else None, end)


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(("at", "size"), [((0, 0, 0), 1.0), ((1000.0, -500.0, 20.0), 1.0), ((0, 0, 0), 100.0)])
def test_an_arm_reaches_places_that_it_can_reach(turned, at, size):
    """Coordinates within limits make goals; the hand then stands there to 1e-6 m, by forward kinematics of the solution."""
    tree = JointTree(arm_scene(at=at, size=size), device="cpu")
    q = np.random.default_rng(0).uniform(-1.9, 1.9, (200, 7))
    goal = reached_goals(tree, q, END * size, turned)
    found = tree.inverse_kinematics([goal], start=np.full(7, 0.3), starts=32)
    assert found.reached.all()
    M = tree.poses(found.q)[HAND]
    assert np.linalg.norm(M[:, :3, :3] @ (END * size) + M[:, :3, 3] - goal.at, axis=1).max() <= 1e-6 + 1e-12 * np.abs(at).max()
    assert (np.abs(found.q) <= np.where(np.arange(7) % 2, 2.0, 2.6)).all()
    if turned:
        left = rotation.quat_product(goal.turn, rotation.quat_conjugate(rotation.matrix_quat(M[:, :3, :3])))
        assert np.linalg.norm(rotation.quaternion_logarithm(left), axis=1).max() <= 1e-6


def test_a_solution_does_not_depend_on_how_many_there_are():
    tree = JointTree(arm_scene(), device="cpu")
    goal = reached_goals(tree, np.random.default_rng(1).uniform(-1.9, 1.9, (40, 7)))
    whole = tree.inverse_kinematics([goal])
    half = tree.inverse_kinematics([Goal(HAND, goal.at[10:20], goal.turn[10:20], END)])
    assert np.array_equal(whole.q[10:20], half.q) and np.array_equal(whole.q, tree.inverse_kinematics([goal]).q)


def test_the_pose_of_rest_is_nearest_among_solutions():
    """SLSQP, from the solution on, finds nothing nearer to rest that reaches the goal, but for what 40 linear steps leave."""
    tree = JointTree(arm_scene(), device="cpu")
    rest = np.array([0.2, 0.4, 0.0, 0.8, 0.0, 0.3, 0.0])
    goal = reached_goals(tree, np.random.default_rng(2).uniform(-1.5, 1.5, (4, 7)), turned=False)
    found = tree.inverse_kinematics([goal], start=rest, rest=rest)
    assert found.reached.all()
    for q, at in zip(found.q, goal.at, strict=True):
        def missed(x, at=at):
            M = tree.poses(x)[HAND][0]
            return M[:3, :3] @ END + M[:3, 3] - at
        minimize = pytest.importorskip("scipy.optimize").minimize
        best = minimize(lambda x: ((x - rest)**2).sum(), q, jac=lambda x: 2 * (x - rest), method="SLSQP",
                        constraints={"type": "eq", "fun": missed}, bounds=[(-2.6, 2.6), (-2.0, 2.0)] * 3 + [(-2.6, 2.6)],
                        options={"ftol": 1e-12, "maxiter": 200})
        assert best.success and ((q - rest)**2).sum() < best.fun + 1e-3


def test_a_goal_out_of_reach_is_missed_by_what_is_left():
    """1.2 m of arm above a shoulder 0.2 m high, 3 m away: 1.8 m are left."""
    tree = JointTree(arm_scene(), device="cpu")
    found = tree.inverse_kinematics([Goal(HAND, (1.8, 0.0, 2.6), point=END)], start=np.full(7, 0.2))
    assert not found.reached[0] and abs(found.off[0] - 1.8) < 1e-6 and np.isfinite(found.q).all()


def test_joints_that_are_fixed_stay_and_limits_hold_a_slide():
    scene = Scene(gravity=(0, 0, 0))
    rail = scene.body("/rail", Box((0.1, 0.1, 0.1)))
    tip = scene.body("/tip", Box((0.1, 0.1, 0.1)), at=(1.0, 0, 0))
    scene.joint("prismatic", "/slide", None, rail, axis=(1, 0, 0), low=-0.5, high=0.5)
    scene.joint("revolute", "/turn", rail, tip, at=(0, 0, 0), axis=(0, 0, 1))
    tree = JointTree(scene, device="cpu")
    found = tree.inverse_kinematics([Goal("/tip", (2.0, 0.0, 0.0))])
    assert np.allclose(found.q, [[0.5, 0.0]], atol=1e-6) and abs(found.off[0] - 0.5) < 1e-9
    still = tree.inverse_kinematics([Goal("/tip", (0.3, 0.8, 0.0))], fixed=["/slide"])
    assert still.q[0, 0] == 0.0 and abs(still.q[0, 1] - np.arctan2(0.8, 0.3)) < 1e-6


def test_two_hands_of_one_tree_reach_their_goals_at_once():
    """A trunk of two hinges with two arms, one of balls: what both hands have at random coordinates."""
    scene = Scene(up="Z", gravity=(0, 0, 0))
    trunk = [scene.body(f"/t{k}", Box((0.05, 0.05, 0.1)), at=(0, 0, 0.1 + 0.2 * k)) for k in range(2)]
    scene.joint("revolute", "/jt0", None, trunk[0], at=(0, 0, 0), axis=(0, 1, 0))
    scene.joint("revolute", "/jt1", trunk[0], trunk[1], at=(0, 0, 0.2), axis=(1, 0, 0))
    for side, name in ((1, "a"), (-1, "b")):
        last = trunk[1]
        for k in range(3):
            body = scene.body(f"/{name}{k}", Box((0.1, 0.02, 0.02)), at=(side * (0.1 + 0.2 * k), 0, 0.4))
            scene.joint("spherical" if name == "a" else "revolute", f"/j{name}{k}", last, body, at=(side * 0.2 * k, 0, 0.4),
                        axis=(0, (k + 1) % 2, k % 2))
            last = body
    tree = JointTree(scene, device="cpu")
    q = np.random.default_rng(3).normal(size=(5, len(tree.coordinates)))
    for k in range(3):
        own = tree.columns(f"/ja{k}")
        q[:, own] = rotation.unit_quat(q[:, own])
    M = tree.poses(q)
    found = tree.inverse_kinematics([Goal(path, M[path][:, :3, 3]) for path in ("/a2", "/b2")], starts=32)
    assert found.reached.all()
    now = tree.poses(found.q)
    assert max(np.abs(now[path][:, :3, 3] - M[path][:, :3, 3]).max() for path in ("/a2", "/b2")) < 2e-6


def test_forces_of_a_motion_give_its_accelerations_back():
    """tau of random q, qd, qdd, put on as torques of hinges by the reaction: forward dynamics of the same chain returns qdd."""
    scene = chain_scene(["revolute"] * 4)
    tree = JointTree(scene, device="cpu")
    random = np.random.default_rng(4)
    q, qd = random.normal(size=(2, 1, 4))
    simulation = Simulation(scene, device="cpu", precision="float64")
    simulation.load()
    trees = simulation.plan.method("rigid").joints
    trees.q.assign(q[0])
    trees.qd.assign(qd[0])
    trees.stale = False
    free = trees.accelerations()                        # no force of joints: tau is 0
    assert np.abs(tree.inverse_dynamics(q, qd, free[None])).max() < 1e-9 * np.abs(free).max()
    H = np.array([tree.inverse_dynamics(q, qd, free[None] + e)[0] for e in np.eye(4)])
    assert np.abs(H - H.T).max() < 1e-12 and np.linalg.eigvalsh(H).min() > 0.0


@pytest.mark.parametrize("kinds", [["revolute"] * 7, ["spherical", "prismatic", "fixed", "revolute"] * 2])
@pytest.mark.parametrize("free", [False, True])
def test_inverse_dynamics_is_that_of_mujoco(kinds, free):
    mujoco = pytest.importorskip("mujoco")
    from tools.bench.rigid import trees as bench
    scene = chain_scene(kinds, free)
    tree = JointTree(scene, device="cpu")
    model, data, frames = bench.mujoco_model(tree.trees, scene.gravity)
    links, random = tree.links, np.random.default_rng(5)
    q, (qd, qdd) = np.zeros(len(tree.coordinates)), random.normal(size=(2, len(tree.dofs)))
    data.qvel[:], data.qacc[:], balls = qd, qdd, []
    for link in range(len(links.body)):
        c, d = links.first_coordinate[link], links.first_dof[link]
        n = links.slides[link] if links.ball[link] else links.first_dof[link + 1] - d
        q[c:c + n] = data.qpos[c:c + n] = random.normal(size=n)
        if links.ball[link]:
            own, b = rotation.unit_quat(random.normal(size=4)), frames["turn_b"][link]
            q[c + n:c + n + 4] = own
            x, y, z, w = rotation.quat_product(rotation.quat_product(b, own), rotation.quat_conjugate(b))
            data.qpos[c + n:c + n + 4] = [w, x, y, z]
            balls.append((slice(d + n, d + n + 3), b))
    for own, b in balls:
        data.qvel[own], data.qacc[own] = rotation.quat_rotate(b, qd[own]), rotation.quat_rotate(b, qdd[own])
    mujoco.mj_inverse(model, data)
    right = data.qfrc_inverse.copy()
    for own, b in balls:
        right[own] = rotation.quat_rotate(rotation.quat_conjugate(b), right[own])
    assert np.abs(tree.inverse_dynamics(q, qd, qdd)[0] - right).max() < 1e-9 * np.abs(right).max()


@pytest.mark.parametrize(("call", "said"), [
    (lambda t: t.inverse_kinematics([Goal("/nobody", (0, 0, 0))]), "is no body of a tree"),
    (lambda t: t.inverse_kinematics([Goal(HAND, (0, np.nan, 0))]), "finite"),
    (lambda t: t.inverse_kinematics([Goal(HAND, (0, 0))]), "shape"),
    (lambda t: t.inverse_kinematics([Goal(HAND, (0, 0, 1), turn=(0, 0, 0, 2))]), "unit quaternion"),
    (lambda t: t.inverse_kinematics([]), "are none"),
    (lambda t: t.inverse_kinematics([Goal(HAND, (0, 0, 1))], start=np.zeros(3)), "start has the shape"),
    (lambda t: t.inverse_kinematics([Goal(HAND, (0, 0, 1))], fixed=["/j9"]), "has no coordinates"),
    (lambda t: t.inverse_kinematics([Goal(HAND, (0, 0, 1))], tolerance=(0, 1)), "above 0"),
    (lambda t: t.inverse_kinematics([Goal(HAND, np.zeros((2, 3))), Goal("/l3", np.zeros((3, 3)))]), "rows"),
    (lambda t: t.inverse_dynamics(np.zeros(7), np.zeros(7), np.zeros(6)), "qdd has the shape"),
    (lambda t: JointTree(Scene(), device="cpu"), "has no joints"),
])
def test_bad_input_is_told_in_a_line(call, said):
    tree = JointTree(arm_scene(), device="cpu")
    with pytest.raises(SceneError, match=said) as error:
        call(tree)
    assert len(str(error.value)) < 300


def test_a_loop_of_joints_is_refused():
    scene = chain_scene(["revolute"] * 2)
    scene.joint("spherical", "/loop", None, "/b1", at=(1.0, 0, 0))
    with pytest.raises(SceneError, match="close a loop"):
        JointTree(scene, device="cpu")
