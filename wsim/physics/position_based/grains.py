"""Contacts of grains in a plan, with each other and with points of other bodies (meeting.py): found in phase collide, solved in
every iteration. See kernels/position_based/grains.py."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from wsim.kernels.math.real import types
from wsim.kernels.position_based import grain_contacts as pairs
from wsim.kernels.position_based import grains as kernels
from wsim.kernels.position_based import rigid_clouds
from wsim.model.stage import Clock, Method, Remedy, Stage
from wsim.model.state import StateField, StatePart
from wsim.model.status import FrameStatus
from wsim.model.structs import fill_struct
from wsim.physics.position_based.meeting import ball_groups, ball_radii, meeting_bodies, rigid_pieces
from wsim.physics.position_based.neighbours import NeighbourSearch, ParticleLaunches, SearchedPoints
from wsim.physics.position_based.objects import TURNING
from wsim.scene import Problem

if TYPE_CHECKING:
    from wsim.simulation.methods import Build

SKIN = 0.3                       # of the diameter: what a pair may come nearer before lists are made anew
NEIGHBOURS, TOUCHED = 20, 13     # entries of a list, and contacts of a grain, that there is room for at first
NEAR_WORD, TOUCH_WORD, FAST_WORD, DEEP_WORD = ("grains: neighbours wanted", "grains: contacts wanted", "grains: fast",
                                               "grains: overlap")
SWEPT, SMOOTH, ROLLED = 10.0, 4.0, 2.5       # iterations a layer; with less friction than RUBBED; of grains that turn
RUBBED = 0.1                     # without friction wedges lose some of the load of carried grains
SHARED = 1.3                     # iterations a layer: see `most_share`
DEEP = 0.05                      # of the distance of two centres: overlap that is warned of
FIELDS = (StateField("f", "N", True, "force of a contact on the grain, without what lies on the other"),
          StateField("id", "1", True, "number of the other grain, ascending; -1: no more", "int"))
SUPPORT = (StateField("felt", "1", True, "upward acceleration by contacts over gravity", "scalar"),
           StateField("part", "1", True, "of its weight that grains carry", "scalar"),
           StateField("load", "N", True, "of the grains that it carries"),
           StateField("due", "1", True, "its weight and what it feels of grains on it, over its weight", "scalar"),
           StateField("share", "1", True, "part of what stands on it that it feels", "scalar"),
           StateField("ground", "1", True, "substeps that it has rested on something else than grains", "scalar"))


def iterations_a_layer(points: SearchedPoints, gravity: Any, rate: float) -> float:
    """Of `rate` iterations a second: how many a layer of a pile gets while a grain falls by its radius; inf without gravity."""
    size, radius = float(np.linalg.norm(gravity)), float(np.mean(points.reach))
    if size == 0.0:
        return float("inf")
    height = float(np.ptp(points.start @ np.asarray(gravity, np.float64) / size))
    layers = max(height / (2.0 * radius), len(points.reach) ** (1.0 / 3.0))
    return float(rate * np.sqrt(2.0 * radius / size) / layers)


def stands_deep(points: SearchedPoints, gravity: Any, rate: float, swept: float = SWEPT) -> bool:
    """Whether iterations, `rate` of them a second, are too few to carry the load of a pile from layer to layer as it lands:
    fewer than `swept` a layer while a grain falls by its radius. Then what stands on others is carried
    (kernels/position_based/stacks.py). Else both sides answer all contacts from the start, and momentum is kept to rounding:
    carried grains that a collider pushes are thrown. With 4 to 10 a layer, 1 % of pairs would overlap by up to 16 % as they
    land."""
    return iterations_a_layer(points, gravity, rate) < swept


def most_share(points: SearchedPoints, gravity: Any, rate: float) -> float:
    """Part of what stands on it that a carried grain comes to feel once it has landed: all, from SHARED iterations a layer on,
    since heaps creep without. With fewer, columns that feel it lose a tenth of their height and more."""
    return float(iterations_a_layer(points, gravity, rate) >= SHARED)


def build(b: Build) -> GrainContacts:
    """The method of a scene with grains."""
    return GrainContacts(b)


class GrainContacts(Method):
    """`search`: who is near whom. `part`: forces that contacts have borne, slot behind slot."""

    def __init__(self, b: Build):
        super().__init__("grains")
        self.model, self.state, self.points, self.status = b.model, b.state, b.ports.points, b.status
        self.bodies = meeting_bodies(b.model)
        self.path = _paths_of_grains(self.bodies)
        piece, whole = rigid_pieces(self.bodies)
        self.rigid_count = int(piece.max(initial=-1)) + 1
        launches = self.launches = ParticleLaunches(b.model, "grains", *["rigid"] * (self.rigid_count > 0))
        radii, coarse = ball_radii(self.bodies)
        points = SearchedPoints.of(self.bodies, radii, ball_groups(self.bodies))
        said = "is a mesh too coarse to stop the smallest particles; give it more points, or larger particles"
        self.offers.start_warnings = [Problem(path, said, fatal=False) for path in dict.fromkeys(coarse)]
        self.most = pairs.FASTEST * float(points.reach.min())
        self.search = NeighbourSearch(launches, points, SKIN * 2.0 * float(points.reach.max()), NEIGHBOURS, b.ports.arrivals)
        self.offers.particle_searches, self.count = [self.search], self.search.count
        n, real, zeros = self.count, b.model.real, launches.zeros
        t, S = types(real), kernels.grain_structs(real)
        friction = np.concatenate([np.tile(body.friction, (body.count, 1)) for body in self.bodies])
        upload, dtype = b.model.upload, b.model.dtype
        self.table = fill_struct(S.GrainTable, piece=upload(piece, int), pressed=zeros(self.rigid_count, int),
                                 whole=upload(whole.astype(dtype), real), friction=upload(friction.astype(dtype), t.vec2),
                                 w=self.points.constants.w, y=zeros(n, t.vec3), u=zeros(n, t.vec3), split=zeros(n),
                                 rub=zeros(n, t.vec2), back=zeros(n, t.vec3), up=zeros(n, t.vec4), held=zeros(n, t.vec4),
                                 rise=zeros(n), felt=zeros(n, t.vec2), inverse=zeros(n), point=zeros(n, int),
                                 fast=zeros(1, int), deepest=zeros(1, int))
        self.structs, self.touched = S, None              # type: Any, Any
        self.part, self.rolling = StatePart("grains", 0, 0), self._make_rolling(b)         # None: no grain turns
        self._make_contacts(TOUCHED)
        b.state.add(self.part)
        rate = b.scene.fps * b.clock.substeps * b.clock.iterations
        swept = ROLLED if self.rolling else SWEPT if friction.min() >= RUBBED else SMOOTH
        self.deep = stands_deep(points, b.scene.gravity, rate, swept)
        shared = self.deep and not self.rolling                                            # rolling.py knows of no shares
        self.most_share = most_share(points, b.scene.gravity, rate) if shared else 0.0
        self.support_part = StatePart.allocate("grain support", SUPPORT, n, real, b.model.device)
        self.support_part.rows = _rows_of_bodies(self.bodies)
        self.support: Any = fill_struct(S.GrainSupport, **self.support_part.arrays)
        b.state.add(self.support_part)
        self.kernels = self._make_kernels(self.most_share > 0.0)
        for word in (NEAR_WORD, TOUCH_WORD, FAST_WORD, DEEP_WORD):
            b.status.reserve(word)
        size, calls = n * np.dtype(dtype).itemsize, self.search.launch_count + 4
        self.stages += [Stage("grain contacts", "collide", self.find, calls, 50 * size, what=f"{n} grains"),
                        Stage("grains", "solve", self.solve, 2, 120 * size, "iteration", f"contacts of {n} grains"),
                        Stage("grain forces", "finish", self.keep, 1, 100 * size, what="for the next substep")]

    def _make_kernels(self, shares: bool) -> dict[str, Any]:
        """Those of this scene, by name. shares: what stands on grains is felt in part."""
        rigid = self.rigid_count > 0
        makers: dict[str, Any] = {
            "gather": pairs.gather_kernel, "overlap": partial(pairs.overlap_kernel, rigid), "apart": pairs.stabilize_kernel,
            "contact": partial(pairs.contact_kernel, shares, rigid), "motion": kernels.motion_kernel,
            "solve": partial(kernels.grain_solve_kernel, shares),
            "force": partial(pairs.force_kernel, self.deep, shares),
            **({"count": rigid_clouds.rigid_count_kernel, "rigid": rigid_clouds.rigid_split_kernel} if rigid else {})}
        return {name: make(self.model.real, self.launches.module) for name, make in makers.items()}

    def _make_rolling(self, b: Build) -> Any:
        """Turns of grains; None where none turns, as beside Newton's method."""
        turning = [body.path for body in self.bodies if body.source.rolling_friction is not None]
        if turning and b.choice.solver == "implicit":
            said = "its grains do not turn, as Newton's method solves for contacts; take XPBD, or rolling_friction=inf"
            asked = [body.path for body in self.bodies if body.path in turning and not body.source.rolling_was_chosen]
            self.offers.start_warnings += [Problem(path, said, fatal=False) for path in dict.fromkeys(asked)]
        many = [body.path for body in self.bodies if body.source.rolling_was_chosen and body.path not in turning]
        said = f"its grains do not turn, as there are more than {TURNING}: heaps keep steep sides; give rolling_friction"
        self.offers.start_warnings += [Problem(path, said, fatal=False) for path in dict.fromkeys(many)]
        if not turning or b.choice.solver == "implicit":
            return None
        from wsim.physics.position_based.rolling import RollingContacts
        return RollingContacts(self, b)

    def _make_contacts(self, room: int) -> None:
        """Room for so many contacts of each grain, and for their forces; what was borne is forgotten."""
        launches, t, S, n = self.launches, types(self.model.real), self.structs, self.count
        zeros, wanted = launches.zeros, self.touched.wanted if self.touched else launches.zeros(1, int)
        whole = {name: zeros(room * n, int) for name in ("other", "id", "support")}
        self.touched = fill_struct(S.GrainContacts, room=room, size=n, count=zeros(n, int), n=zeros(room * n, t.vec3),
                                   b=zeros(room * n), L=zeros(room * n, t.vec3), share=zeros(room * n), wanted=wanted, **whole)
        fields = (*FIELDS, self.rolling.torque) if self.rolling else FIELDS
        made = StatePart.allocate("grains", fields, room * n, self.model.real, self.model.device)
        rows = {key: (own[:, None] + n * np.arange(room)).ravel()                     # author's order, slot behind slot
                for key, own in _rows_of_bodies(self.bodies).items()}
        made.arrays["id"].fill_(-1)
        for array, aside in made.copies():
            aside.assign(array)
        self.part.__dict__.update(made.__dict__, rows=rows)
        self.forces = fill_struct(S.GrainForces, id=self.part.arrays["id"], f=self.part.arrays["f"])
        if self.rolling:
            self.rolling.make_room(room, self.part.arrays["torque"])

    def connect_ports(self, others) -> None:
        """Colliders answer the forces that grains begin with before the first iteration: it would see the lowest ones fall."""
        self.search.lists.wanted, self.touched.wanted = self.status.word(NEAR_WORD), self.status.word(TOUCH_WORD)
        self.table.fast, self.table.deepest = self.status.word(FAST_WORD), self.status.word(DEEP_WORD)
        if others.ports.newton_sweeps is not None:
            others.ports.newton_sweeps.append(self.solve)
            self.stages = [stage for stage in self.stages if stage.name != "grains"]
        self.shapes = others.ports.shape_matching
        if self.rolling:
            self.rolling.connect_ports(others)
        if (contact := others.ports.contact) is not None:
            contact.stages.append(Stage("first contacts", "collide", contact.project, 1, self.model.points * 4,
                                        what="points that forces of grains press"))

    # stages

    def find(self, clock: Clock) -> None:
        """Neighbours, overlaps, contacts, and the forces of the substep before."""
        s, search = self.state, self.search
        rows, cells, lists, table, touched = search.rows, search.cells, search.lists, self.table, self.touched
        search.update(s.x, s.d)
        self._run("gather", [rows, cells, table, self.points.constants, self.support, s.x, s.d, self.points.anchor], [])
        self._run("overlap", [cells, lists, table, self.most], [])
        self._run("apart", [table], [s.x])
        if self.rigid_count:
            self.table.pressed.zero_()
        self._run("contact", [cells, lists, table, touched, self.forces, self.support, clock.h], [s.d])
        if self.rigid_count:
            self._run("count", [cells, table], [])
            self._run("rigid", [cells, table], [])
        if self.rolling:
            self.rolling.start(clock)

    def solve(self, clock: Clock) -> None:
        """One iteration of all contacts."""
        if self.rolling:
            self.rolling.solve(clock)
        else:
            self._solve_still(clock)
        if self.rigid_count and self.shapes is not None:
            self.shapes.project_shapes(clock)

    def _solve_still(self, clock: Clock) -> None:
        """An iteration of grains of which none turns."""
        self._run("motion", [self.table, self.state.d, self.points.anchor], [])
        self._run("solve", [self.table, self.touched], [self.state.d])

    def keep(self, clock: Clock) -> None:
        """Forces, for the next substep."""
        self._run("force", [self.search.cells, self.table, self.touched, self.forces, self.support, self.state.v, clock.h,
                            self.most_share], [])
        if self.rolling:
            self.rolling.keep(clock)

    def _run(self, name: str, inputs: list, outputs: list) -> None:
        self.launches.launch(self.kernels[name], self.count, inputs, outputs)

    # around a frame

    def before_frame(self, time: float, clock: Clock) -> None:
        if self.rolling:
            self.rolling.before_frame()

    def prepare_restart(self, fields: dict[str, dict[str, np.ndarray]]) -> None:
        """Room for as many contacts as an earlier run had."""
        rooms = [len(own["id"]) // body.count for body in self.bodies if "id" in (own := fields.get(body.path, {}))]
        if rooms and max(rooms) > self.touched.room:
            self._make_contacts(max(rooms))

    def find_remedies(self, status: FrameStatus) -> list[Remedy]:
        near, touched = int(status.said(NEAR_WORD)[0]), int(status.said(TOUCH_WORD)[0])

        def lengthen_lists() -> str:
            if near <= self.search.lists.room:
                return ""
            self.search.make_room(near + near // 4)
            return f"a grain has {near} others near it, more than there was room for"

        def more_contacts() -> str:
            if touched <= self.touched.room:
                return ""
            self._make_contacts(touched + touched // 4)
            return f"a grain touches {touched} others, more than there was room for"
        return [Remedy("grow", act) for act, most, room in ((lengthen_lists, near, self.search.lists.room),
                                                            (more_contacts, touched, self.touched.room)) if most > room]

    def frame_warnings(self, status: FrameStatus) -> list[tuple[tuple, float, str]]:
        deep, fast = int(status.said(DEEP_WORD)[0]), int(status.said(FAST_WORD)[0])
        found: list[tuple[tuple, float, str]] = []
        if deep > 1e6 * DEEP:
            found.append(((DEEP_WORD,), deep / 1e4, f"{self.path}: grains overlap by {{worst}} % of the distance of "
                          "their centres; give more substeps, or more iterations"))
        if fast:
            found.append(((FAST_WORD,), fast, f"{self.path}: {{worst}} times in a frame a grain moved more than two "
                          "diameters in a substep, and may have passed through others; give more substeps, or larger grains"))
        return found

    def indicators(self, x: np.ndarray, v: np.ndarray) -> dict[str, float]:
        """grain_overlap: the greatest in the last frame, over the distance of the centres of what touches [1]; 0 up to 2e-3."""
        return {"grain_overlap": int(self.status.said(DEEP_WORD)[0]) / 1e6}


def _paths_of_grains(bodies: list) -> str:
    """Paths of what meets as balls and is no fluid, or of the fluids where nothing else does."""
    balls = [body for body in bodies if body.source.meets_as_balls]
    return ", ".join(dict.fromkeys(body.path for body in [b for b in balls if not b.source.is_fluid] or balls))[:200]


def _rows_of_bodies(bodies: list) -> dict[tuple[str, int], np.ndarray]:
    """Number of each particle of a body, in the author's order, by path and world."""
    rows, first = {}, 0
    for body in bodies:
        rows[body.path, body.world] = first + (body.index - body.first)
        first += body.count
    return rows
