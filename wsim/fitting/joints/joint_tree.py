"""Trees of joints without time: places of links, coordinates that reach a goal, forces that an acceleration needs. Equations:
kernels/rigid/joint/inverse."""

from collections.abc import Sequence
from dataclasses import replace
from math import inf
from typing import Any

import numpy as np

from wsim.fitting.joints.goals import Goal, JointSolution, finite_rows
from wsim.model.kernel_cache import warp_device
from wsim.scene import Problem, Scene, SceneError
from wsim.scene.methods import method_file
from wsim.simulation.simulation import Simulation


class JointTree:
    """The joints of a scene as trees, as in `JointTree(scene).inverse_kinematics([Goal("/hand", (0.3, 1, 0))])`.

    A row of coordinates holds those of all joints, in the order of `coordinates`: lengths of slides [m], angles of hinges
    [rad], a quaternion (x, y, z, w) of a ball, and of a free root its shift [m] and a quaternion. A row of velocities is in the
    order of `dofs`: of a ball its angular velocity along the axes of the joint's frame on body 1. Everything is float64.

    scene    a `Scene`, the path of a USD file, or a `Usd.Stage`; only its bodies and joints count
    device   "cpu", "cuda:0", ...; None takes the GPU if there is one
    Raises SceneError where its joints form no trees: a loop, a drive along a distance.
    """

    def __init__(self, scene, device=None):
        if not isinstance(scene, Scene):
            from wsim.usd import load
            scene = load(scene)
        self.device = warp_device(device)
        try:
            bare = Simulation(bare_tree_scene(scene), device="cpu", precision="float64")
        except SceneError as error:
            raise SceneError([replace(p, text=p.text.replace("; fix: leave wsim:coordinates out", "")) for p in error.problems]
                             ) from None
        self.scene, self.method = bare.scene, bare.plan.ports.bodies
        self.trees = self.method.joints
        self.links = links = self.trees.links
        if links.loops.kind:
            said = "some of its joints close a loop" if max(links.loops.joint) >= 0 else "some of its joints mimic others"
            raise SceneError(Problem("/", f"{said}; allowed are trees without; fix: remove or disable such joints"))
        self.bodies = [self.method.bodies[row][0].path for row in links.body]
        self.start = np.array(self.trees._start_coordinates())
        self.coordinates, self.dofs = self._names()
        self._solvers: dict[Any, Any] = {}

    def _names(self) -> tuple[list[str], list[str]]:
        links, coordinates, dofs = self.links, list[str](), list[str]()
        AXES = method_file("Joint", "joints.joint").AXES
        for link, j in enumerate(links.joint):
            path = self.bodies[link] if j < 0 else self.trees.joints[j].path
            own = [f"{path}.{AXES[links.row[k]]}" for k in range(links.first_dof[link], links.first_dof[link + 1])]
            dofs += own
            coordinates += own[:links.slides[link]] if links.ball[link] else own
            coordinates += [f"{path}.{part}" for part in "xyzw"] if links.ball[link] else []
        return coordinates, dofs

    def columns(self, joint: str) -> slice:
        """Columns of a joint (of a free root: its body) in a row of coordinates. Raises SceneError for another path."""
        own = [k for k, name in enumerate(self.coordinates) if name.rpartition(".")[0] == joint]
        if not own:
            there = ", ".join(dict.fromkeys(name.rpartition(".")[0] for name in self.coordinates))
            raise SceneError(Problem(joint, f"has no coordinates; there are those of: {there}"))
        return slice(own[0], own[-1] + 1)

    def link_of(self, body: str) -> int:
        """Number of the link that a body is. Raises SceneError for another path."""
        if body not in self.bodies:
            raise SceneError(Problem(body, f"is no body of a tree of joints; there are: {', '.join(self.bodies)}"))
        return self.bodies.index(body)

    def rows(self, name: str, values, width: int, count: int | None = None) -> np.ndarray:
        """Rows of coordinates or velocities (n, width), repeated to `count`. Raises SceneError for others."""
        found = finite_rows(name, name, values, width)
        if count is not None and len(found) not in (1, count):
            raise SceneError(Problem(name, f"has {len(found)} rows beside {count} of others; allowed are 1 or {count}"))
        return np.repeat(found, count, axis=0) if count is not None and len(found) == 1 else found

    def poses(self, q) -> dict[str, np.ndarray]:
        """Local-to-world transforms (n, 4, 4) [m] of its bodies by path, at q (n, coordinates) or (coordinates,)."""
        from wsim.fitting.joints.arms import place_links
        return place_links(self, self.rows("q", q, len(self.coordinates)))

    def inverse_kinematics(self, goals: Sequence[Goal], start=None, rest=None, fixed: Sequence[str] = (),
                           tolerance=(1e-6, 1e-6), starts: int = 8, steps: int = 60) -> JointSolution:
        """Coordinates within the limits of slides and hinges at which bodies reach their goals, else the nearest found.

        goals      `Goal`s that hold at once; those with n rows ask for n solutions
        start      coordinates to begin from, (coordinates,) or (n, coordinates); None: those of the scene
        rest       coordinates that it is to be near, where the goals leave a choice: least sum of squares of what is between
        fixed      paths of joints that stay; a free root stays too
        tolerance  distance [m] and angle [rad] at which a goal counts as reached
        starts     places to begin from, one after the other, until one leads to the goal
        steps      Levenberg-Marquardt steps from each of them

        Levenberg and Marquardt's method with limits as an active set (Marquardt 1963; Bertsekas 1982): each arm ends in a local
        minimum of the weighted squares of what is left. Raises SceneError for paths, shapes and numbers that make no sense.
        """
        from wsim.fitting.joints.arms import solve_goals
        return solve_goals(self, list(goals), start, rest, tuple(fixed), tolerance, starts, steps)

    def inverse_dynamics(self, q, qd, qdd) -> np.ndarray:
        """Generalised forces (n, dofs) [N], [N m] that joints give when q (n, coordinates) and qd (n, dofs) have the
        accelerations qdd (n, dofs): against inertia, weight, armature and the forces of bodies. Springs, drives and
        dampers of joints are not taken off: it is the sum of what they and actuators give. Of a free root: the wrench that is
        missing. Raises SceneError for other shapes."""
        from wsim.fitting.joints.arms import forces_of_motion
        given = [self.rows(*each) for each in (("q", q, len(self.coordinates)), ("qd", qd, len(self.dofs)),
                                               ("qdd", qdd, len(self.dofs)))]
        n = max(map(len, given))
        return forces_of_motion(self, *(self.rows(name, values, values.shape[1], n)
                                        for name, values in zip(("q", "qd", "qdd"), given, strict=True)))


def bare_tree_scene(scene: Scene) -> Scene:
    """The bodies and joints of a scene, without what they touch; no joint breaks."""
    if not [joint for joint in scene.things("Joint") if joint.enabled]:
        raise SceneError(Problem(scene.source or "/", "has no joints; a tree of joints has one at least"))
    bodies = [replace(body, asleep=False, colliders=[replace(c, meets=False) for c in body.colliders])
              for body in scene.things("Body")]
    return Scene(gravity=scene.gravity, up=scene.up, fps=scene.fps, coordinates="reduced", source=scene.source,
                 objects={"Body": bodies, "Joint": [replace(j, force=inf, torque=inf) for j in scene.things("Joint")]})
