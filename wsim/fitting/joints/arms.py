"""Arms of a `JointTree` on a device: tables, and launches (kernels/rigid/joint/inverse)."""

from collections.abc import Sequence
from math import inf
from typing import Any

import numpy as np
import warp as wp

from wsim.fitting.joints.goals import Goal, JointSolution
from wsim.geometry import rotation
from wsim.kernels.rigid.joint.inverse import dynamics, levenberg
from wsim.kernels.rigid.joint.inverse.tables import ArmGoals, ArmStarts, ArmTable, ArmWork
from wsim.model.structs import fill_struct
from wsim.scene import Problem, SceneError
from wsim.scene.check.counts import checked_count
from wsim.scene.methods import method_file

BLOCK = 32             # threads: 4096 arms are few, and fill all processors so
RESTS = 40             # steps towards a pose of rest


class DeviceArms:
    """Links of a tree, by their numbers, parents first; n arms."""

    def __init__(self, tree: Any, which: list[int], n: int, fixed: tuple[str, ...] = ()):
        self.tree, self.which, self.n, links = tree, which, n, tree.links
        number = {link: k for k, link in enumerate(which)}
        self.dof_rows = [k for link in which for k in range(links.first_dof[link], links.first_dof[link + 1])]
        self.rows = [c for link in which for c in range(links.first_coordinate[link], links.first_coordinate[link + 1])]
        sizes = [(links.first_dof[k + 1] - links.first_dof[k], links.first_coordinate[k + 1] - links.first_coordinate[k])
                 for k in which]
        first = np.concatenate([np.zeros((1, 2), int), np.cumsum(np.reshape(sizes, (-1, 2)), axis=0)])
        self.links, self.dofs, self.size = len(which), len(self.dof_rows), len(self.rows)
        parent = [number.get(links.parent[link], -1) for link in which]
        frames, masses = tree.trees._link_frames(), [tree.method.masses[links.body[link]] for link in which]
        bodies = [tree.method.bodies[links.body[link]][0] for link in which]
        gravity = np.asarray(tree.scene.gravity, np.float64)
        turns, coordinate, moves, low, high = self._degrees(first, set(fixed))
        up = self.upload
        self.table = fill_struct(
            ArmTable, parent=up(parent, int), first_dof=up(first[:, 0], int), first_coordinate=up(first[:, 1], int),
            **{name: up(rows[which], wp.vec3d if "at" in name else wp.quatd) for name, rows in frames.items()},
            mass=up([m.mass for m in masses], wp.float64), moments=up([m.moments for m in masses], wp.vec3d),
            force=up([m.mass * gravity + body.force for m, body in zip(masses, bodies, strict=True)], wp.vec3d),
            torque=up([body.torque for body in bodies], wp.vec3d),
            slides=up([links.slides[k] for k in which], int), ball=up([links.ball[k] for k in which], int),
            **{name: up(np.reshape(getattr(links, name), (-1, 3))[self.dof_rows], wp.vec3d) for name in ("axis", "point")},
            turns=up(turns, int), moves=up(moves, int),
            armature=up(tree.trees.trees.t.armature.numpy()[self.dof_rows], wp.float64), low=up(low, wp.float64),
            high=up(high, wp.float64), coordinate=up(coordinate, int))
        self.parent, self.first, self.low, self.high = parent, first, low, high
        self.work = self._allocate()

    def upload(self, values, dtype) -> wp.array:
        kind = np.int32 if dtype is int else np.float64
        values = np.ascontiguousarray(values, kind)
        if not values.size:
            return wp.zeros(values.shape[:1], dtype=dtype, device=self.tree.device)
        return wp.array(values, dtype=dtype, device=self.tree.device)

    def _degrees(self, first: np.ndarray, fixed: set[str]) -> tuple:
        """Of dofs: whether they turn, their coordinate, whether they move; of coordinates: limits."""
        links, joints, AXES = self.tree.links, self.tree.trees.joints, method_file("Joint", "joints.joint").AXES
        turns, coordinate, moves = [], [], []
        low, high = np.full(self.size, -inf), np.full(self.size, inf)
        for k, link in enumerate(self.which):
            j, slides, ball = links.joint[link], links.slides[link], links.ball[link]
            for d, row in enumerate(links.row[links.first_dof[link]:links.first_dof[link + 1]]):
                turns.append(int(d >= slides))
                moves.append(int(j >= 0 and joints[j].path not in fixed))
                coordinate.append(-1 if ball and d >= slides else int(first[k, 1]) + d)
                if coordinate[-1] >= 0 and j >= 0 and AXES[row] in joints[j].limits:
                    low[coordinate[-1]], high[coordinate[-1]] = joints[j].limits[AXES[row]]
        return turns, coordinate, moves, low, high

    def _allocate(self) -> Any:
        def zeros(rows: int, dtype=wp.float64):
            return wp.zeros((max(rows, 1), self.n), dtype=dtype, device=self.tree.device)
        triangle, n = self.dofs * (self.dofs + 1) // 2, self.dofs
        coordinates = wp.zeros((self.size, self.n), dtype=wp.float64, device=self.tree.device)
        return fill_struct(ArmWork, X=zeros(self.links, wp.vec3d), Q=zeros(self.links, wp.quatd),
                           **{name: zeros(n, wp.vec3d) for name in ("S", "pivot", "J_p", "J_r")},
                           **{name: zeros(triangle) for name in ("A", "A_trial", "L")},
                           **{name: zeros(n) for name in ("g", "g_trial", "step")},
                           q=coordinates, trial=wp.zeros_like(coordinates),
                           arm=wp.zeros(self.n, dtype=int, device=self.tree.device))

    def put_columns(self, values: np.ndarray) -> wp.array:
        """Rows (n, ...) of the whole tree as the device has them, of these links."""
        return self.upload(values[:, self.rows].T, wp.float64)

    def launch(self, kernel, inputs: list) -> None:
        wp.launch(kernel, self.n, inputs, device=self.tree.device, block_dim=BLOCK if self.tree.device.is_cuda else 1)

    def origin(self) -> np.ndarray:
        """The places of each link count from here [m], (links, 3)."""
        roots = self.tree.trees.root_of()[self.which]
        return self.tree.method.origin[np.array(self.tree.links.body)[roots]]


class GoalSolver:
    """Goals of bodies on a device, for n arms."""

    def __init__(self, tree: Any, goals: list[Goal], n: int, fixed: tuple[str, ...]):
        ends = [tree.link_of(goal.body) for goal in goals]
        paths = [_links_to_root(tree, link) for link in ends]
        which = sorted(set().union(*paths))
        self.arms = arms = DeviceArms(tree, which, n, fixed)
        masses = [tree.method.masses[tree.links.body[link]] for link in ends]
        places = [which.index(link) for link in ends]
        self.centre = arms.origin()[places]
        on_path = np.zeros((len(goals), max(arms.dofs, 1)), np.int32)
        for k, path in enumerate(paths):
            for link in path:
                own = which.index(link)
                on_path[k, arms.first[own, 0]:arms.first[own + 1, 0]] = 1
        axes = [rotation.quat_conjugate(m.axes) for m in masses]
        up = arms.upload
        self.goals = fill_struct(
            ArmGoals, link=up(places, int), own=up(axes, wp.quatd), on_path=up(on_path, int),
            point=up([rotation.quat_rotate(q, g.point - m.center) for q, g, m in zip(axes, goals, masses, strict=True)],
                     wp.vec3d), length=up([(1.0, 0.0 if g.turn is None else g.radius) for g in goals], wp.vec2d),
            at=wp.zeros((len(goals), n), dtype=wp.vec3d, device=tree.device),
            turn=wp.zeros((len(goals), n), dtype=wp.quatd, device=tree.device))
        self.reach = float(np.linalg.norm(arms.table.at_a.numpy(), axis=1).sum())
        self.starts: dict[int, Any] = {}

    def starts_of(self, others: int) -> Any:
        """Room for solutions from so many other starts."""
        arms, n, device = self.arms, self.arms.n, self.arms.tree.device
        if others not in self.starts:
            numbers = {name: wp.zeros(n, dtype=int, device=device) for name in ("failed", "rank", "who")}
            self.starts = {others: fill_struct(
                ArmStarts, **numbers, best=wp.zeros_like(arms.work.q),
                ratio=arms.upload(_sequence_ratios(arms.dofs), wp.float64),
                found=wp.zeros(n, dtype=wp.vec4d, device=device), tries=wp.zeros(n * others, dtype=wp.vec4d, device=device),
                tried=wp.zeros((arms.size, n * others), dtype=wp.float64, device=device))}
        return self.starts[others]

    def put_goals(self, goals: list[Goal]) -> None:
        n, one = self.arms.n, np.array([[0.0, 0.0, 0.0, 1.0]])
        at = [np.broadcast_to(g.at - centre, (n, 3)) for g, centre in zip(goals, self.centre, strict=True)]
        turn = [np.broadcast_to(one if g.turn is None else g.turn / np.linalg.norm(g.turn, axis=1, keepdims=True), (n, 4))
                for g in goals]
        self.goals.at.assign(np.array(at))
        self.goals.turn.assign(np.array(turn))

    def launch(self, B: Any, rest: wp.array, settings: Any) -> None:
        """All of a solution: launches, and nothing else."""
        arms = self.arms
        given = [arms.table, self.goals, arms.work, settings, B]
        arms.launch(levenberg.first_start_kernel, given)
        if settings.starts > 1:
            wp.utils.array_scan(B.failed, B.rank, True)
            arms.launch(levenberg.failed_arm_kernel, [B])
            arms.launch(levenberg.other_start_kernel, given)
        arms.launch(levenberg.best_start_kernel, [*given, rest])


def _links_to_root(tree: Any, link: int) -> list[int]:
    found = [link]
    while tree.links.parent[found[-1]] >= 0:
        found.append(tree.links.parent[found[-1]])
    return found


def _sequence_ratios(dofs: int) -> np.ndarray:
    """Steps of the R sequence of so many dimensions: powers of 1 / phi, phi^(dofs + 1) = phi + 1 (Roberts 2018)."""
    phi = 1.5
    for _ in range(60):
        phi = (1.0 + phi) ** (1.0 / (dofs + 1.0))
    return (1.0 / phi) ** np.arange(1, dofs + 1)


def _rows_of_goals(goals: list[Goal]) -> int:
    """n of the goals. Raises SceneError where they disagree."""
    if not goals or not all(isinstance(goal, Goal) for goal in goals):
        raise SceneError(Problem("goals", 'are none, or are no Goal; allowed is a list of them, as in [Goal("/arm/hand", '
                                 "(0.3, 1, 0))]"))
    counts = {len(values) for g in goals for values in (g.at, g.turn) if values is not None and len(values) != 1}
    if len(counts) > 1:
        raise SceneError(Problem(goals[0].body, f"goals have {sorted(counts)} rows; allowed is one number of rows, or 1"))
    return counts.pop() if counts else 1


def solve_goals(tree: Any, goals: list[Goal], start, rest, fixed: tuple[str, ...], tolerance, starts: int,
                steps: int) -> JointSolution:
    """See `JointTree.inverse_kinematics`."""
    n = _rows_of_goals(goals)
    for path in fixed:
        tree.columns(path)
    size = len(tree.coordinates)
    if start is not None and n == 1:
        n = len(tree.rows("start", start, size))
    begin = tree.rows("start", tree.start if start is None else start, size, n)
    near = None if rest is None else tree.rows("rest", rest, size, n)
    wanted = np.array(tolerance, np.float64)
    if wanted.shape != (2,) or not (wanted > 0.0).all():
        raise SceneError(Problem("tolerance", f"is {tolerance}; allowed are a distance [m] and an angle [rad] above 0"))
    key = (tuple((g.body, tuple(g.point), g.turn is None, g.radius) for g in goals), n, fixed)
    if key not in tree._solvers:
        tree._solvers = {key: GoalSolver(tree, goals, n, fixed)}             # the last one stays
    solver = tree._solvers[key]
    if n == 0:
        return JointSolution(begin, np.zeros(0), np.zeros(0), np.zeros(0, bool), np.zeros(0, int))
    solver.put_goals(goals)
    settings = fill_struct(levenberg.ArmSettings, tolerance=wp.vec2d(*wanted), most=checked_count("steps", steps, 1),
                           starts=checked_count("starts", starts, 1), rests=0 if near is None else RESTS,
                           reach=max(solver.reach, 1e-3))
    B = solver.starts_of(settings.starts - 1)
    B.start = solver.arms.put_columns(begin)
    solver.launch(B, B.start if near is None else solver.arms.put_columns(near), settings)
    q = begin.copy()
    q[:, solver.arms.rows] = B.best.numpy().T
    _, off, turned, count = B.found.numpy().T
    return JointSolution(q, off, turned, (off <= wanted[0]) & (turned <= wanted[1]), count.astype(int))


def whole_arms(tree: Any, q: np.ndarray) -> DeviceArms:
    """All links, at coordinates q (n, coordinates)."""
    arms = DeviceArms(tree, list(range(len(tree.links.body))), len(q))
    arms.work.q.assign(np.ascontiguousarray(q.T))
    return arms


def place_links(tree: Any, q: np.ndarray) -> dict[str, np.ndarray]:
    """See `JointTree.poses`."""
    arms = whole_arms(tree, q)
    arms.launch(dynamics.arm_pose_kernel, [arms.table, arms.work])
    X, Q, origin = arms.work.X.numpy(), arms.work.Q.numpy(), arms.origin()
    found = {}
    for link, path in enumerate(tree.bodies):
        m = tree.method.masses[tree.links.body[link]]
        R = rotation.quaternion_to_matrix(rotation.quat_product(Q[link], rotation.quat_conjugate(m.axes)))
        M = np.tile(np.eye(4), (len(q), 1, 1))
        M[:, :3, :3], M[:, :3, 3] = R, origin[link] + X[link] - R @ m.center
        found[path] = M
    return found


def forces_of_motion(tree: Any, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    """See `JointTree.inverse_dynamics`."""
    arms = whole_arms(tree, q)
    names: Sequence[str] = ("w", "v", "dw", "dv", "n", "f")
    forces = fill_struct(dynamics.ArmForces, **{name: wp.zeros((arms.links, len(q)), dtype=wp.vec3d, device=tree.device)
                                                for name in names})
    tau = wp.zeros((max(arms.dofs, 1), len(q)), dtype=wp.float64, device=tree.device)
    rates = [arms.upload(values.T, wp.float64) for values in (qd, qdd)]
    arms.launch(dynamics.inverse_dynamics_kernel, [arms.table, arms.work, forces, *rates, tau])
    return tau.numpy()[:arms.dofs].T.copy()
