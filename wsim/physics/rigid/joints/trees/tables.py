"""Trees of joints in reduced coordinates on the device: tables, the parts of the state, and the launch of a frame."""

from typing import Any

import numpy as np
import warp as wp

from wsim.geometry import rotation
from wsim.kernels.math.real import types
from wsim.kernels.rigid.joint.tree.alone import tree_velocity_kernel
from wsim.kernels.rigid.joint.tree.lanes import LANES, tree_launch_bounds
from wsim.kernels.rigid.joint.tree.tables import tree_structs
from wsim.model.stage import Clock
from wsim.model.state import StateField, StatePart
from wsim.model.structs import fill_struct
from wsim.physics.rigid.joints.joint import PASSIVE
from wsim.physics.rigid.joints.tables import DeviceJoints
from wsim.physics.rigid.joints.trees.bases import base_tables
from wsim.physics.rigid.joints.trees.break_tables import break_tables, dof_values, some_joint_breaks
from wsim.physics.rigid.joints.trees.contact_tables import add_soft_tables, contact_tables
from wsim.physics.rigid.joints.trees.links import FITS, tree_links
from wsim.physics.rigid.joints.trees.loop_tables import loop_tables, tree_loop_frames
from wsim.physics.rigid.joints.trees.loops import MIMIC, TURN, loop_gaps, start_violations
from wsim.physics.rigid.joints.trees.strings import some_distance_ranges, string_frames, string_tables

COORDINATES = (StateField("joint_q", "", True, "joint coordinates [m], [rad]; of balls quaternions (x, y, z, w)", "double"),)
SPEEDS = (StateField("joint_qd", "", True, "generalised velocities [m/s], [rad/s]", "double"),)
OFFSETS = {"first_link": "links", "body": "bodies", "parent": "links", "joint": "joints", "first_dof": "dofs",
           "first_coordinate": "coordinates", "dof_parent": "dofs", "first_entry": "entries", "first_column": "columns",
           "first_level": "levels", "level_start": "links", "by_level": "links", "first_child": "children", "child": "links",
           "last_dof": "dofs", "dof_link": "links", "dof_end": "dofs", "entry_dof": "dofs", "entry_row": "dofs",
           "first_step": "steps", "step_start": "entries", "step_entry": "entries"}
SCHEMES = {"rk4": 1, "symplectic_euler": 2, "backward_euler": 3}       # by name of the scene's integrator; others: -1
ENDED = ("first_link", "first_dof", "first_coordinate", "first_entry", "first_level", "level_start", "first_child",
         "first_step", "step_start")


class DeviceTrees(DeviceJoints):
    """The joints of a method whose islands are all trees. Raises ValueError, with the reason, where one is not."""

    reduced = True

    def __init__(self, b, method, touching: bool = False, pushed: bool = False):
        """touching: its bodies meet something; pushed: points or strands push them."""
        super().__init__(b, method)
        self.touching, self.pushed = touching, pushed
        n = len(self.order.first_joint) - 1
        per = n // self.model.worlds
        one = {name: np.asarray(getattr(self.order, name)) for name in ("first_joint", "first_body", "body")}
        found, why = tree_links(self.joints, self.pairs, one["first_joint"][:per + 1], one["first_body"][:per + 1], one["body"],
                                touching, frozenset(a.joint for a in b.scene.things("Actuator")))
        if found is None:
            raise ValueError(why)
        self.links, self.time = found, 0.0
        self._make_tree_parts(b)
        self._make_tree_tables()
        self.q.assign(np.tile(self._start_coordinates(), self.model.worlds))
        self.lost = False                                     # coordinates are older than the poses of the bodies
        self.project = tree_velocity_kernel(b.model.real, self._tree_module("tree_velocities"))
        self.stale = set(range(b.model.worlds))               # where generalised velocities are older than momenta of bodies

    def _make_tree_parts(self, b) -> None:
        self.tree_parts: list[StatePart] = []
        path, worlds, device = b.scene.things("Body")[0].written, self.model.worlds, self.device
        parts = []
        for name, fields, n in (("tree coordinates", COORDINATES, self.links.first_coordinate[-1]),
                                ("tree velocities", SPEEDS, self.links.first_dof[-1])):
            part = StatePart.allocate(name, fields, n * worlds, b.model.real, device)
            part.rows = {(path, world): np.arange(n) + world * n for world in range(worlds)}
            self.tree_parts.append(part)
            parts.append(part.arrays[fields[0].name])
        self.q, self.qd = parts

    def _make_tree_tables(self) -> None:
        links, worlds, up = self.links, self.model.worlds, self._to_device
        Table, Trees = tree_structs()
        sizes = {"links": len(links.body), "bodies": len(self.method.bodies) // worlds, "joints": len(self.joints),
                 "dofs": links.first_dof[-1], "coordinates": links.first_coordinate[-1], "entries": links.first_entry[-1],
                 "columns": links.columns, "levels": links.first_level[-1], "children": len(links.child),
                 "steps": links.first_step[-1]}

        def of_worlds(name: str):
            own = np.array(getattr(links, name), np.int64).reshape(-1)
            if name not in OFFSETS:
                return np.tile(own, worlds)
            first, size = name in ENDED, sizes[OFFSETS[name]]
            rows = [np.where(own < 0, -1, own + size * w)[:len(own) - first] for w in range(worlds)]
            return np.concatenate(rows + [own[-1:] + size * (worlds - 1)] * first)
        whole = ("first_link", "body", "parent", "joint", "slides", "ball", "first_dof", "first_coordinate", "row",
                 "dof_parent", "first_entry", "first_level", "level_start", "by_level", "first_child", "child", "last_dof",
                 "dof_link", "dof_end", "entry_dof", "entry_row", "first_step", "step_start", "step_entry")
        arrays = {name: up(of_worlds(name), int) for name in whole}
        frames = self._link_frames()
        masses = [self.method.masses[row] for row in links.body]
        t = fill_struct(Table, **arrays, start=up(np.tile(self._link_starts(), (worlds, 1)), wp.vec3d),
                        **{name: up(np.tile(rows, (worlds, 1)), wp.vec3d if "at" in name else wp.quatd)
                           for name, rows in frames.items()},
                        mass=up(np.tile([m.mass for m in masses], worlds), wp.float64),
                        moments=up(np.tile([m.moments for m in masses], (worlds, 1)), wp.vec3d),
                        **{name: up(np.tile(np.reshape(getattr(links, name), (-1, 3)), (worlds, 1)), wp.vec3d)
                           for name in ("axis", "point")},
                        **{name: up(np.tile(dof_values(self, name), worlds), wp.float64) for name in PASSIVE})
        bases, parts = base_tables(self)
        self.tree_parts += parts
        more = bases | {"breaks": break_tables(self, t), "first_column": up(of_worlds("first_column"), int)}
        more |= contact_tables(self)
        loops, more["strings"] = loop_tables(self, sizes), string_tables(self, sizes)
        self.trees = fill_struct(Trees, t=t, q=self.q, qd=self.qd, loops=loops(), **more, **self._tree_work(sizes, worlds))
        if self.touching:                                     # a second place for what a prediction works with
            scratch = {name: wp.zeros_like(array) for name, array in (("q", self.q), ("qd", self.qd))}
            scratch |= self._tree_work(sizes, worlds) | {"mass": self.trees.mass}
            self.scratch = fill_struct(Trees, t=t, loops=loops(), **more, **scratch)

    def world_frame(self, j: int, swapped: bool, root: int) -> tuple[np.ndarray, np.ndarray]:
        """Frame of a joint on what does not move by forces, from where a tree's first link began. swapped: on side 1."""
        M, joint = self.joints[j].motion.at(self.time), self.joints[j]
        at = M[:3, :3] @ (joint.at1 if swapped else joint.at0) + M[:3, 3] - self.method.origin[self.links.body[root]]
        return at, rotation.quat_product(rotation.matrix_quat(M[:3, :3]), joint.turn1 if swapped else joint.turn0)

    def stored_energy(self, world: int = 0) -> float:
        """Kinetic energy [J] of the armature of a world."""
        armature, qd = (self.of_world(a.numpy()[:len(self.qd)], world) for a in (self.trees.t.armature, self.qd))
        return float(0.5 * (armature * qd**2).sum())

    def _tree_work(self, sizes: dict[str, int], worlds: int) -> dict[str, Any]:
        def zeros(size, dtype=wp.float64):
            return wp.zeros(max(1, sizes[size] * worlds), dtype=dtype, device=self.device)
        of_dofs = ("tau", "qd_start", "qd_before", "rate", "rates", "mean", "gains", "mass", "push", "rub", "rub_most",
                   "response", "u")
        vectors = dict.fromkeys(("X", "W", "V", "A_w", "A_v", "N", "F", "mc"), "links") | {"S_w": "dofs", "S_v": "dofs"}
        numbers = dict.fromkeys(of_dofs, "dofs") | dict.fromkeys(("H", "M", "H_before", "W_factors"), "entries")
        numbers |= {"m": "links", "q_before": "coordinates", "q_start": "coordinates", "column": "columns"}
        islands = len(self.order.first_joint) - 1
        return {**{name: zeros(size, wp.vec3d) for name, size in vectors.items()},
                **{name: zeros(size) for name, size in numbers.items()}, "Q": zeros("links", wp.quatd),
                "inertia": zeros("links", wp.mat33d), "left": wp.zeros(islands, dtype=wp.float64, device=self.device),
                "scheme": SCHEMES.get(self.model.scene.integrator, -1),
                "integrator": wp.zeros(islands, dtype=int, device=self.device)}

    def root_of(self) -> np.ndarray:
        """Link that is the root of each link's tree."""
        first = np.array(self.links.first_link)
        return first[np.searchsorted(first, np.arange(len(self.links.body)), side="right") - 1]

    def _link_starts(self) -> np.ndarray:
        """Centres of mass (links, 3) [m] at the start, from that of the tree's first link."""
        places = self.method.origin[self.links.body].reshape(-1, 3)
        return places - places[self.root_of()] if len(places) else places

    def _link_frames(self) -> dict[str, np.ndarray]:
        """Frames of the joints of links on the parent, a, and on the child, b; of a root those of the world."""
        links, one, roots = self.links, np.array([0.0, 0.0, 0.0, 1.0]), self.root_of()
        sides = self.side_frames(self.method.masses)
        rows = []
        for link, (j, swapped) in enumerate(zip(links.joint, links.swapped, strict=True)):
            if j < 0:
                rows.append((np.zeros(3), one, np.zeros(3), one))
                continue
            a, b = (2 * j + 1, 2 * j) if swapped else (2 * j, 2 * j + 1)
            at, turn = sides[a]
            if links.parent[link] < 0:
                at, turn = self.world_frame(j, swapped, int(roots[link]))
            rows.append((at, rotation.unit_quat(turn), *sides[b]))
        return {name: np.array([row[k] for row in rows]).reshape(len(rows), -1)
                for k, name in enumerate(("at_a", "turn_a", "at_b", "turn_b"))}

    def _start_coordinates(self, world: int = 0, shift: np.ndarray | None = None) -> np.ndarray:
        """Coordinates of the bodies as they stand, moved by `shift` (bodies, 3) [m] since the start. Raises ValueError where
        they stand off from what a joint allows."""
        from wsim.physics.rigid.joints.trees.start import start_coordinates
        rows = np.array(self.links.body, int) + world * (len(self.method.bodies) // self.model.worlds)
        places = self._link_starts() + (0.0 if shift is None else shift[rows])
        turns = self.method.turns()[rows].reshape(-1, 4)
        broken = self.of_world(self.linked.broken.numpy(), world)
        q = start_coordinates(self.links, self._link_frames(), places, turns, self.joints, broken)
        C, loops = start_violations(self.links.loops, tree_loop_frames(self), q, places, turns), self.links.loops
        for r, gap in enumerate(np.abs(C).tolist()):
            turns = int(loops.kind[r] == TURN)
            if loops.kind[r] != MIMIC and gap > FITS[turns]:
                raise ValueError(f"{self.joints[loops.joint[r]].path}: its bodies stand {gap:.3g} "
                                 f"{('m', 'rad')[turns]} off from what it allows")
        if (jump := np.abs(C[np.array(loops.kind, int) == MIMIC]).max(initial=0.0)) > FITS[1]:
            self.ignored = (f"a joint starts {jump:.3g} m or rad off from the joint that it mimics, and jumps there; fix: "
                            "author poses that agree with the mimics")
        return q

    def _tree_module(self, name: str, *of) -> str:
        return self.model.shared_module(name, *of, threads=LANES if self.device.is_cuda else 0)

    def launch_trees(self, kernel, inputs: list, outputs: list) -> None:
        """Launches the lanes of every tree: a warp each on a GPU, a thread on a CPU."""
        if self.device.is_cuda:
            self.model.launch_blocks(kernel, self.islands, LANES, inputs, outputs)
        else:
            self.model.launch(kernel, self.islands, inputs, outputs)

    def alone(self):
        """Kernel of trees whose bodies touch nothing."""
        from wsim.kernels.rigid.joint.tree.alone import tree_substep_kernel
        self.settle = self.method.sleep.alone() if self.method.sleep else None
        needs, bounds = (bool(self.trees.moves), some_joint_breaks(self), some_distance_ranges(self)), self.launch_bounds
        return tree_substep_kernel(self.model.real, self._tree_module("rigid_trees", *needs, bool(bounds)), *needs, **bounds)

    @property
    def launch_bounds(self) -> dict:
        return tree_launch_bounds(self.islands, self.device.sm_count) if self.device.is_cuda else {}

    def before_frame(self, time: float, clock: Clock) -> None:
        super().before_frame(time, clock)
        if self.lost:
            self.time = time
            moved = self.method.get("x") + self.method.get("e")
            self.q.assign(np.concatenate([self._start_coordinates(w, moved) for w in range(self.model.worlds)]))
        if self.stale:
            self._project_momenta()
            self.stale, self.lost = set(), False

    def _project_momenta(self) -> None:
        """Generalised velocities from momenta, where those are newer: in other worlds they would change by rounding."""
        kept = self.qd.numpy().copy() if len(self.stale) < self.model.worlds else None
        self.launch_trees(self.project, [self.method.moving(), self.linked], [self.trees])
        if kept is not None:
            now, of = self.qd.numpy(), np.repeat(np.arange(self.model.worlds), len(kept) // self.model.worlds)
            self.qd.assign(np.where(np.isin(of, sorted(self.stale)), now, kept))

    def prepare_restart(self, fields: dict[str, np.ndarray]) -> None:
        """Goes on from fields of the first body, which may be those of maximal coordinates."""
        self.lost, self.stale = "joint_q" not in fields, set(range(self.model.worlds)) if "joint_qd" not in fields else set()

    def colour_nodes(self, rows: np.ndarray) -> np.ndarray:
        """The root of each body's tree."""
        per, found = len(self.method.bodies) // self.model.worlds, rows.astype(np.int32)
        for world in range(self.model.worlds):
            found[np.array(self.links.body, int) + per * world] = np.array(self.links.body)[self.root_of()] + per * world
        return found

    def contact_form(self, contacts) -> Any:
        add_soft_tables(self, contacts)
        from wsim.physics.rigid.joints.trees.form import TreeContactForm
        return TreeContactForm(self)

    def contact_arrays(self, room: int) -> dict[str, wp.array]:
        """What kernels note of so many manifolds, for `Work` of kernels/rigid/contact.py."""
        t = types(self.model.real)
        return {"slip_by_push": wp.zeros(16 * room, dtype=t.vec2, device=self.device),
                "slip_by_rub": wp.zeros(6 * room, dtype=t.mat22, device=self.device)}

    def renew_velocities(self, changed: set[int]) -> None:
        self.stale |= changed

    def weigh(self, masses: list, changed: set[int]) -> None:
        super().weigh(masses, changed)
        t, rows = self.trees.t, np.concatenate([np.array(self.links.body, int) + w * len(masses) // self.model.worlds
                                                for w in range(self.model.worlds)])
        t.mass.assign(np.array([masses[k].mass for k in rows]))
        t.moments.assign(np.array([masses[k].moments for k in rows]))
        for table, frames in ((t, self._link_frames()), (self.trees.loops, tree_loop_frames(self)),
                              (self.trees.strings, string_frames(self))):
            for name, values in frames.items():
                getattr(table, name).assign(np.tile(values, (self.model.worlds, 1)))
        self.stale |= changed

    def advance(self, kernel, clock: Clock, bodies, now) -> None:
        """All substeps of a frame."""
        asleep = self.settle(clock.dt, bodies, self, now) if self.settle else None
        self.launch_trees(kernel, [wp.vec2i(0, clock.substeps), clock.h, bodies, self.linked, self.trees, asleep], [now])

    def accelerations(self, h: float = 1e-9) -> np.ndarray:
        """Accelerations qdd (dofs of all worlds,) [m/s^2], [rad/s^2] at the coordinates and velocities now, without limits and
        dry friction."""
        from wsim.kernels.rigid.joint.tree.alone import tree_acceleration_kernel
        needs = bool(self.trees.moves), some_joint_breaks(self)
        kernel = tree_acceleration_kernel(self.model.real, self._tree_module("tree_accelerations", *needs), *needs)
        self.launch_trees(kernel, [h, self.method.table, self.linked], [self.trees])
        return self.trees.tau.numpy()[:len(self.qd)]

    def indicators(self, world: int | None = None) -> dict[str, float]:
        """joint_residual: change of rates in the last sweep over limits and dry friction, over the largest rate, at most."""
        left = float(self.of_world(self.trees.left.numpy(), world).max(initial=0.0)) if not self.touching else 0.0
        return super().indicators(world) | ({"joint_residual": left} if left > 0.0 else {})

    def error(self, world: int | None = None) -> tuple[float, float]:
        """Gaps of joints that close loops now, at most: [m], [rad]. Other locked axes have no error."""
        rows = len(self.links.loops.kind) * self.model.worlds
        return loop_gaps(self.links.loops, self.of_world(self.trees.loops.C.numpy()[:rows], world))

    @property
    def what(self) -> str:
        trees = int((np.diff(self.order.first_joint) > 0).sum())
        rows, strings = (n * self.model.worlds for n in (len(self.links.loops.kind), len(self.links.strings.joint)))
        return (f"{trees} trees of {self.links.first_dof[-1] * self.model.worlds} degrees of freedom in reduced coordinates"
                + f", {rows} equations of loops and mimics" * (rows > 0)
                + f", {strings} strings" * (strings > 0))
