"""Rods on the device: the part "rods", a row a point of each strand of every world, in float64 whatever the precision of a
simulation is: strains are differences of positions of 1e-9 of a strand's length. All substeps of a frame are one launch, a
thread a strand (kernels/rods/march.py); on a GPU a launch for each part of an iteration (gpu_elimination.py)."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from wsim.kernels.rods import tables
from wsim.kernels.rods.march import TOLERANCE, strand_march_kernel
from wsim.model.stage import Clock, Method, Ports, Remedy, Stage
from wsim.model.state import StateField, StatePart
from wsim.model.status import FrameStatus
from wsim.model.structs import fill_struct
from wsim.physics.rods.colliders import StrandObstacles, longest_strand_substep
from wsim.physics.rods.forces import StrandLoads, StrandReactions
from wsim.physics.rods.tables import StrandTable
from wsim.scene import Scene
from wsim.scene.attachments import body_ties
from wsim.scene.methods import has_self_collision, method_file
from wsim.scene.samples import PointSample, Sample

if TYPE_CHECKING:
    from wsim.simulation.methods import Build

FIELDS = (StateField("x", "m", True, "position relative to the strand's first point at the start", "vec3d"),
          StateField("v", "m/s", True, "velocity", "vec3d"), StateField("s", "m", True, "step before this one", "vec3d"),
          StateField("u", "m/s", True, "velocity before this one", "vec3d"),
          StateField("d", "", True, "material director of the edge behind a point", "vec3d"),
          StateField("w", "rad/s", True, "spin of that edge about itself, its turn before, its spin before", "vec3d"),
          StateField("stick", "m", True, "bristle of a point that touches a collider", "vec3d"),
          StateField("load", "N", True, "normal force of a collider on it", "double"),
          StateField("phi", "rad", True, "twist at a point", "double"),
          StateField("begun", "1", True, "1: it carries on the step before", "int"))
EDGES = tuple(field for k, which in ((1, "first"), (2, "second")) for field in (
    StateField(f"stick{k}", "m", True, f"bristle of the {which} place where an edge touches a collider between its points",
               "vec3d"), StateField(f"load{k}", "N", True, "normal force of a collider there", "double")))
DEEP = 0.5                    # of a diameter: from where on strands in colliders are told
APART: bool | None = None     # a launch for each part of an iteration; None: on a GPU
THREADS = 32                  # of a block: 10k strands are few, and fill all processors so


def build(b: "Build") -> Method:
    return RodMethod(b)


def signature(b) -> list:
    return []                                            # kernels stand in modules of their own


def rod_module_name(names: tuple[str, ...], airy: bool, touching: bool, apart: bool, closed: bool = False) -> str:
    """Module of the kernels that meet colliders of such kinds, air, other strands; closed: some strands are."""
    return "_".join(("wsim_rods", *names, *("air",) * airy, *("touch",) * touching, *("apart",) * apart, *("closed",) * closed))


def air_acts_on_rods(scene: Scene) -> bool:
    """True if the air acts on rods of a scene."""
    return bool(scene.air_drag) or any(v.name == "air_drag" for v in scene.varying) or any(
        rods.drag or rods.skin_drag for rods in scene.things("Rods"))


class RodMethod(Method):
    """`table`: strands of all rods and worlds. touching: what they are solved together by where they touch themselves or
    rigid bodies, else None; among: what they meet surfaces by, likewise."""

    threads, measures_worlds = THREADS, True

    def __init__(self, b: "Build"):
        super().__init__("rods")
        self.model, self.clock, device = b.model, b.clock, b.model.device
        rods = b.scene.things("Rods")
        self.table = t = StrandTable([(each, world) for world in range(b.model.worlds) for each in rods])
        touching = any(each.self_collision for each in rods)
        meeting = bool(touching and has_self_collision(b.scene) and b.model.bodies)  # surfaces: in their substeps
        bearing = bool(b.scene.things("Body") and method_file("Body", "solids").bodies_met_by_strands(b.scene))   # rigid bodies
        longest = longest_strand_substep(t, b.scene, b.clock.dt)
        self.shortest = 1 if meeting or bearing else max(1, math.ceil(b.clock.dt / b.clock.substeps / longest - 1e-9))
        self.substeps = b.clock.substeps * self.shortest
        self.obstacles = StrandObstacles(b.scene.colliders, device, self.substeps)
        names = self.obstacles.kinds
        self.airy, self.among, together = air_acts_on_rods(b.scene), None, touching or bearing  # type: bool, Any, bool
        apart = not (together or t.closed) and (self.model.device.is_cuda if APART is None else APART)
        own = rod_module_name(names, self.airy, touching, apart, t.closed) + "_among" * meeting
        if bearing:
            from wsim.physics.rods.bodies import body_module_suffix
            own += body_module_suffix(b.scene, self.model.real)
        b.model.modules[own] = THREADS
        self._allocate(b, meeting, bearing)
        self.strands, self.holds = t.strands_on(device), t.holds_on(device, self.substeps)
        self.loads = StrandLoads(b.scene, t, self.strands, self.substeps)
        self.trial = self._make_trial(together)
        self.said, self.left = b.status.mirrored_array((t.strands, 3), wp.float64)
        self.touching: Any = None
        if together:
            self.touching = self._make_coupled_solver(own, b.status, touching, bearing)
        b.state.add(*[self.touching.memory] if touching else [])
        if bearing:
            from wsim.physics.rods.bodies import StrandBodyContacts
            self.touching.join(StrandBodyContacts(self.touching, b.ports.bodies))
        self.weigh(np.tile(np.asarray(b.scene.gravity, np.float64), (b.model.worlds, 1)))
        if self.airy:
            self._set_air_tables(b.scene)
        if meeting:
            from wsim.physics.rods.with_surfaces import StrandSurfaceContacts
            self.among = StrandSurfaceContacts(self, own)
            self.stages, self.offers = self.among.stages, Ports(strands=self.among)
        else:
            self.stages = [self._make_rod_stage(own, apart)]
        if touching:
            self.offers.start_warnings = self.touching.told
        self.offers.rods, self.offers.strand_reactions = self, StrandReactions(self)

    def _make_rod_stage(self, own: str, apart: bool) -> Stage:
        """The stage that is a frame. own: name of the module of kernels; apart: a launch for each part of an iteration."""
        t = self.table
        what = f"{t.strands} strands of {sum(len(r.points) for r, _ in t.pairs)} points, {self.substeps} substeps of "
        if self.touching and self.touching.bodies:
            return Stage("rods", "predict", self.touching.substep, 40, self.part.bytes, what=what + "BDF2, or backward Euler "
                         "beside rigid bodies, float64; solved together with these")
        if self.touching:
            return Stage("rods", "predict", self.touching.advance, 30 * self.substeps, self.part.bytes, "frame",
                         what + "BDF2, or backward Euler where they touch, float64; contact of edges, and a proof")
        if apart:
            from wsim.physics.rods.gpu_elimination import StrandElimination
            return Stage("rods", "predict", StrandElimination(self, own, self.model.device).advance, 30 * self.substeps,
                         self.part.bytes, "frame", what + "BDF2, float64")
        self.kernel = strand_march_kernel(self.obstacles.kinds, self.airy, own, self.table.closed)
        return Stage("rods", "predict", self.advance, 1, self.part.bytes, "frame", what + "BDF2 in one launch, float64")

    def _make_coupled_solver(self, name: str, status: FrameStatus, edges: bool, bodies: bool) -> Any:
        """All strands together; edges: with contacts of their edges; bodies: of rigid bodies."""
        if edges:
            from wsim.physics.rods.touch import StrandSelfContact
            return StrandSelfContact(self, name, status, self.model.device, bodies)
        from wsim.physics.rods.coupled_newton import CoupledStrands
        return CoupledStrands(self, name, status, self.model.device, bodies)

    def _allocate(self, b, meeting: bool, bearing: bool) -> None:
        t, device, more = self.table, self.model.device, EDGES if self.obstacles.kinds else ()
        if meeting:
            from wsim.physics.rods.with_surfaces import PUSH
            more += PUSH
        if bearing:
            from wsim.physics.rods.bodies import CLING, TIED
            more += CLING + TIED * any(body_ties(b.scene, rods.path) for rods, _ in t.pairs)
        self.part = StatePart.allocate("rods", FIELDS + more, t.longest * t.strands, self.model.real, device)
        self.part.rows = {(rods.path, world): place for (rods, world), place in zip(t.pairs, t.place, strict=True)}
        for name, values in (("x", t.x), ("v", t.v), ("d", t.d), ("u", t.v), ("phi", t.phi[..., None])):
            self.part.arrays[name].assign(values.reshape(-1, values.shape[-1]).squeeze(-1) if name == "phi" else
                                          values.reshape(-1, 3))
        b.state.add(self.part)

    def moving(self) -> Any:
        """The state as kernels have it."""
        two = (self.table.longest, self.table.strands)
        fields = FIELDS + EDGES if self.obstacles.kinds else FIELDS
        return fill_struct(tables.RodMotion, **{f.name: self.part.arrays[f.name].reshape(two) for f in fields})

    def _make_trial(self, together: bool) -> Any:
        """together: strands are solved for as others are."""
        two, device = (self.table.longest, self.table.strands), self.model.device
        types = {"x": wp.vec3d, "d": wp.vec3d, "phi": wp.float64, "turn": wp.float64, "pull": wp.float64, "near": wp.mat44d,
                 "far": wp.mat44d, "z": wp.vec4d}
        more: dict = {}
        if self.obstacles.kinds:
            places: dict = {"inside": wp.vec3d, "bristle": wp.vec3d}
            if not together:
                places |= {"slip": wp.vec3d, "load": wp.float64, "change": wp.float64, "hit": wp.vec4d, "lean": wp.vec3d}
            more = {name: wp.zeros((3 * two[0], two[1]), dtype=kind, device=device) for name, kind in places.items()}
            more["edge"] = wp.zeros(two, dtype=int, device=device)
        if self.table.closed:
            types |= {"pivot": wp.mat44d, "b": wp.vec4d, "slack": wp.vec4d}
            more["seam"] = wp.zeros((two[1], 3), dtype=wp.mat44d, device=device)
        if self.obstacles.kinds and not together:
            more["drawn"] = wp.zeros(self.table.strands, dtype=wp.float64, device=device)
        return fill_struct(tables.RodTrial, **more, **{k: wp.zeros(two, dtype=v, device=device) for k, v in types.items()})

    def weigh(self, gravity: np.ndarray) -> None:
        """Sets gravity (worlds, 3) [m/s^2]."""
        self.gravity, found = gravity, np.zeros((self.table.strands, 3))
        for own, (_, world) in zip(self.table.own, self.table.pairs, strict=True):
            found[own] = gravity[world]
        if self.touching:
            self.touching.weigh(found)
        if self.strands.gravity is not None:
            self.strands.gravity.assign(found)
        else:
            self.strands.gravity = wp.array(found, dtype=wp.vec3d, device=self.model.device)

    def _set_air_tables(self, scene: Scene) -> None:
        """Tables of the air."""
        t, device, S = self.table, self.model.device, self.strands
        S.wind = wp.array(np.tile(np.asarray(scene.wind, np.float64), (t.strands, 1)), dtype=wp.vec3d, device=device)
        S.decay = wp.array(np.full(t.strands, scene.air_drag), dtype=wp.float64, device=device)
        S.across, S.along = (wp.array(v, dtype=wp.float64, device=device) for v in t.air(scene.air_density))

    # frames

    def before_frame(self, time: float, clock: Clock) -> None:
        n = clock.substeps * self.shortest
        if n != self.substeps:                           # a frame that is repeated with smaller steps
            self.substeps, self.holds = n, self.table.holds_on(self.model.device, n)
            self.obstacles.resize_pose_table(n)
            self.loads.put_tables(self.strands, n)
        times = time + clock.dt / n * np.arange(n + 1)
        self.evaluates["pins"] = self.table.moving_pins
        self.evaluates["poses"] = [c.path for c in self.obstacles.colliders if c.motion.moves]
        if self.table.pins:
            self.holds.frame.assign(self.table.frames(times[1:]))
        self.loads.upload(self.strands, times[1:])
        if self.obstacles.colliders:
            self.obstacles.pose(times)
        if self.touching:
            self.touching.before_frame()

    def choose_frame_form(self, clock: Clock) -> None:
        if self.touching:
            self.touching.often, self.touching.fresh = False, True

    def lengthen_lists(self) -> None:
        if self.touching and self.touching.memory:
            self.touching.fits(self.touching.near.capacity + 1, 0)

    def prepare_restart(self, fields) -> None:
        if self.touching and self.touching.memory:
            self.touching.memory.make_room(len(fields.get(self.table.pairs[0][0].path, {}).get("pair0", (0,))))

    def forget_worlds(self, worlds: set[int]) -> None:
        if self.touching:
            self.touching.forget_worlds()

    def resume_run(self, time: float) -> None:
        self.table.copy_rings(self.part.arrays)
        if self.touching and self.touching.memory:
            self.touching.memory.put_back()

    def find_remedies(self, status: FrameStatus) -> list[Remedy]:
        return self.touching.find_remedies() if self.touching else []

    def advance(self, clock: Clock) -> None:
        wp.launch(self.kernel, self.table.strands, [self.strands, self.holds, self.obstacles.table, self.moving(), self.trial,
                                                    clock.dt / self.substeps, self.substeps], [self.said],
                  device=self.model.device, block_dim=THREADS)

    def frame_warnings(self, status: FrameStatus) -> list[tuple[tuple, float, str]]:
        (left, deep), found = self.left[:, 1:3].T, []
        for own, (rods, world) in zip(self.table.own, self.table.pairs, strict=True):
            if (worst := float(left[own].max(initial=0.0))) > float(TOLERANCE):
                found.append((("rods", rods.path, world), worst, f"{rods.path}: Newton's method left corrections of "
                              "{worst} of an edge's length in a substep; give more substeps"))
            if (inside := float(deep[own].max(initial=0.0))) > DEEP * np.max(rods.diameters):
                found.append((("rods deep", rods.path, world), inside, f"{rods.path}: points were {{worst}} m deep in "
                              "colliders: these left no room there, came in one substep, or a tight rope pressed on them; "
                              "give more room, or smaller widths, or more substeps"))
        return found + self.touching.frame_warnings() if self.touching else found

    # what is told and set

    def points(self, k: int) -> tuple[np.ndarray, np.ndarray]:
        """Positions [m] and velocities [m/s] of rods k, world, (n, 3) float64, in the author's order."""
        place = self.table.place[k]
        x, v = (self.part.arrays[name].numpy()[place] for name in ("x", "v"))
        v = v + self.among.kick.numpy()[place] if self.among else v
        return x + self.table.origin[place % self.table.strands], v

    def samples(self, world: int = 0) -> list[Sample]:
        return [PointSample(rods.path, *self.points(k)) for k, (rods, of) in enumerate(self.table.pairs) if of == world]

    def indicators(self, x, v, world: int | None = None) -> dict[str, float]:
        """Of a world (None: the first): greatest strain, iterations and what they left, depth in colliders [m]."""
        t, own = self.table, [own for own, (_, of) in zip(self.table.own, self.table.pairs, strict=True) if of == (world or 0)]
        which = np.concatenate([np.arange(s.start, s.stop) for s in own])
        place = self.part.arrays["x"].numpy().reshape(t.longest, t.strands, 3)[:, which]
        length = t.values["length"][:-1, which]
        now, there = np.linalg.norm(np.diff(place, axis=0), axis=2), length > 0.0
        strain = np.abs(now / np.where(there, length, 1.0) - 1.0) * there
        said = self.said.numpy()[which]
        found = {"rod_strain": float(strain.max(initial=0.0)), "rod_iterations": float(said[:, 0].max(initial=0.0)),
                 "rod_residual": float(said[:, 1].max(initial=0.0))}
        if self.touching and world is None:
            found |= self.touching.indicators()
        return found | ({"rod_penetration": float(said[:, 2].max(initial=0.0))} if self.obstacles.colliders else {})

    def set_value(self, path: str, name: str, value, world: int | None = None) -> bool:
        if path == "/" and name == "gravity":
            self.gravity[slice(None) if world is None else world] = value
            self.weigh(self.gravity)
            return True
        if name == "motion" and self.table.move_pin(path, value, world) or self.loads.set_value(path, name, value, world):
            return True
        if (array := {"wind": self.strands.wind, "air_drag": self.strands.decay}.get(name) if path == "/" else None) is None:
            return False
        values = array.numpy()
        for own, (_, of) in zip(self.table.own, self.table.pairs, strict=True):
            if world in (None, of):
                values[own] = value
        array.assign(values)
        return True
