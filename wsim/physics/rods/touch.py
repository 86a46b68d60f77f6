"""Strands that touch themselves and each other: contacts of edges in the substeps of all strands of a world at once
(coupled_newton.py), which end with the proof that surfaces have (wsim/physics/contact/selfcontact/guarantee.py), of centre
lines: no edge passes through another. Built where rods say `self_collision`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np
import warp as wp

from wsim.kernels.contact.selfcontact import pairs, rows
from wsim.kernels.contact.selfcontact import step_clamp as clamp
from wsim.kernels.motion.points import point_states
from wsim.kernels.rods.coupled_newton import coupled
from wsim.kernels.rods.edges import touch
from wsim.model.stage import Clock, Remedy
from wsim.model.state import StateField, StatePart
from wsim.model.structs import fill_struct
from wsim.physics.contact.selfcontact.guarantee import StepGuarantee
from wsim.physics.contact.selfcontact.method import LOSS, MORE, ROUNDS
from wsim.physics.contact.selfcontact.near import NearPairList
from wsim.physics.rods.coupled_newton import CoupledStrands
from wsim.physics.rods.edges import StrandEdges

if TYPE_CHECKING:
    from wsim.model.status import FrameStatus
    from wsim.physics.rods.method import RodMethod

SAID = "rods' contact"           # status words, see kernels/contact/selfcontact/step_clamp.py, and behind them the one below
FULL = clamp.SAID                  # pairs of a point that there was no room for
ROOM, WIDE, ENTRIES = 48, 256, 1 << 18     # pairs of a point that there is room for at first: of few WIDE, ENTRIES in all
MEMORY = ("kept", "stick", "load", "many", "of")         # what pairs remember from a substep to the next


class RememberedPairs(StatePart):
    """What pairs of edges of the first world remember from a frame to the next, made of their lists when a run is written, and
    put back where one goes on. A point is named by its number in its strand times the strands of that world, and its strand;
    the first row is no pair. A frame that is repeated has copies of its own (`StrandSelfContact.before_frame`)."""

    FIELDS = (*(StateField(f"pair{k}", "", True, f"point {k} of two edges that are near each other, -1 for none", "int")
                for k in range(4)), StateField("pair_kept", "m", True, "distance that they keep", "double"),
              StateField("pair_load", "N", True, "what presses them", "double"),
              StateField("pair_stick", "m", True, "bristle of their friction", "vec3d"))

    def __init__(self, touching: StrandSelfContact):
        super().__init__("rod pairs", 0, 0, self.FIELDS, common=True)
        self.touching, self.held = touching, False        # held: what an earlier run has left, until a frame begins
        t = touching.table
        self.all, self.own = t.strands, sum(world == 0 for world in touching.worlds_of)
        self.place = t.pairs[0][0].path, 0
        self.fill(np.full((1, 4), -1), np.zeros(1), np.zeros(1), np.zeros((1, 3)))

    def fill(self, ids: np.ndarray, kept: np.ndarray, load: np.ndarray, stick: np.ndarray) -> None:
        device = self.touching.ground.device
        each: list = [(f"pair{k}", ids[:, k], int) for k in range(4)]
        each += [("pair_kept", kept, wp.float64), ("pair_load", load, wp.float64), ("pair_stick", stick, wp.vec3d)]
        self.arrays = {name: wp.array(np.ascontiguousarray(values), dtype=kind, device=device) for name, values, kind in each}
        self.count = self.capacity = len(ids)
        self.rows = {self.place: np.arange(len(ids))}

    def refresh(self) -> None:
        if self.held:
            return
        near, P = self.touching.near.pairs, self.touching.pressed
        ids = near.ids.numpy()[:min(int(near.count.numpy()[0]), near.capacity)]
        i, k = np.divmod(ids.astype(np.int64), self.all)
        some = np.flatnonzero(k[:, 0] < self.own) if len(ids) else np.zeros(0, int)
        ids = i[some] * self.own + k[some]
        some, ids = some[order := np.lexsort(ids.T[::-1])], ids[order]
        kept, load, stick = (a.numpy()[some] for a in (P.kept, P.load, P.stick))
        none = [np.full((1, 4), -1), np.zeros(1), np.zeros(1), np.zeros((1, 3))]
        self.fill(*(np.concatenate(two) for two in zip(none, (ids, kept, load, stick), strict=True)))

    def make_room(self, rows: int) -> None:
        """For so many rows of an earlier run."""
        self.fill(np.full((rows, 4), -1), np.zeros(rows), np.zeros(rows), np.zeros((rows, 3)))
        self.held = True

    def put_back(self) -> None:
        """Into the lists of pairs, what the first search of the run to come carries over."""
        T, values = self.touching, {name: a.numpy()[1:] for name, a in self.arrays.items()}
        i, k = np.divmod(np.stack([values[f"pair{c}"] for c in range(4)], axis=1), self.own)
        ids = (i * self.all + k).astype(np.int32)
        if len(ids):
            T.fits(len(ids), int(np.bincount(ids.ravel()).max()))
            near, P = T.near.pairs, T.pressed
            near.ids[:len(ids)].assign(ids)
            near.count.fill_(len(ids))
            T.index()
            for name in ("kept", "load", "stick"):
                getattr(P, name)[:len(ids)].assign(values[f"pair_{name}"])
        self.held, T.went_on = False, True


class StrandSelfContact(CoupledStrands):
    def __init__(self, strands: RodMethod, module: str, status: FrameStatus, device, bodies: bool = False):
        super().__init__(strands, module, status, device, bodies)
        status.reserve(SAID, clamp.SAID + 1)
        self.edges = StrandEdges(self.table, self.ground)
        self.told = self.edges.told()
        self.near = NearPairList(cast(Any, self.ground), cast(Any, self.edges))
        self.guarantee = StepGuarantee(cast(Any, self.ground), self.near, whole=True)
        self.enlist, self.order, self.drop, self.recall = touch.edge_list_kernels(module)
        self.ready, self.press, self.gather = (touch.ready_pair_kernel(module), touch.edge_press_kernel(module),
                                               touch.edge_gather_kernel(module))
        self.across, self.keep = touch.edge_cross_kernel(module), touch.edge_memory_kernel(module)
        self.sides = fill_struct(touch.EdgePointConstants, **{k: self.ground.upload(v, int if k == "strand" else wp.float64)
                                                              for k, v in vars(self.edges.sides()).items()})
        self.none = self.zeros(self.ground.points, dtype=wp.vec3d)
        self.row = self.ground.upload(self.edges.rows, int)
        self.deep, self.total = max(ROOM, min(WIDE, ENTRIES // self.ground.points)), np.zeros(clamp.SAID + 1, np.int64)
        self.frames = self.repeats = 0
        self.went_on = False                 # True: an earlier run has left what pairs remember
        self.room()
        self.memory = RememberedPairs(self)

    def fits(self, pairs: int, each: int) -> None:
        """Room for so many pairs, of a point and of all."""
        if pairs > self.near.pairs.capacity:
            self.near.grow(pairs)
        if pairs > len(self.pressed.kept) or each > self.deep:
            self.deep = max(self.deep, each)
            self.room()

    def room(self) -> None:
        """Arrays of pairs, as many as the list has room for."""
        n, zeros, points = self.near.pairs.capacity, self.zeros, self.ground.points
        scalars = {"kept": wp.float64, "k": wp.float64, "load": wp.float64, "N": wp.float64, "stick": wp.vec3d, "f": wp.vec3d,
                   "s": wp.vec3d, "K": wp.mat33d}
        def pressed_pairs(names) -> Any:
            return fill_struct(touch.EdgePairs, of=zeros((points, self.deep), dtype=int), many=zeros(points, dtype=int),
                               **{k: zeros(n, dtype=kind) for k, kind in scalars.items() if k in names})
        self.pressed = pressed_pairs(tuple(scalars))
        self.pressed.cross, self.pressed.rough = zeros((n, 2), dtype=wp.vec3d), self.group.rough
        self.pressed.on, self.pressed.ons = zeros((points, self.deep), dtype=int), zeros(points, dtype=int)
        self.corners = self.near.pairs.b
        if self.team:
            self.team.ids, self.team.b, self.team.number = self.near.pairs.ids, self.corners, zeros(n, dtype=int)
        self.old, self.saved = pressed_pairs(MEMORY), pressed_pairs(MEMORY)
        self.old_ids, self.saved_ids = (zeros(n, dtype=wp.vec4i) for _ in range(2))

    def weigh(self, gravity: np.ndarray) -> None:
        """Sets gravity [m/s^2], (strands, 3)."""
        if self.sides.gravity is None:
            self.sides.gravity = wp.zeros(len(gravity), dtype=wp.vec3d, device=self.ground.device)
        self.sides.gravity.assign(gravity)

    # substeps

    def begin_frame(self, clock: Clock) -> None:
        super().begin_frame(clock)
        s, Q = self.strands, self.strands.part.arrays
        self.at = fill_struct(point_states(wp.float64), x=Q["x"], e=self.none, d=self.d, a=self.none)
        self.way = fill_struct(touch.PointPaths, x=s.trial.x.reshape(-1), x0=Q["x"], v=Q["v"], h=self.h)

    def solve(self, k: int) -> None:
        """Displacements of a substep, proven."""
        super().solve(k)
        self.guarantee.keep(self.at, self.d, self.again, self.said)

    def look(self) -> None:
        """A list where it is time for one, and its pairs where the substep begins."""
        wp.capture_if(self.near.word(pairs.SOON), self.search)
        wp.capture_if(self.near.word(pairs.NEAR), self.listed)

    def lean(self) -> None:
        wp.capture_if(self.near.word(pairs.NEAR), self.gathered)

    def hold(self) -> None:
        wp.capture_if(self.near.word(pairs.NEAR), self.held)

    def cross(self) -> None:
        p, near = self.group.p.reshape(-1), self.near
        self.ground.launch(self.across, near.capacity, [self.edges.data, near.table, p], [self.pressed])

    @property
    def said(self) -> wp.array:
        """Words of a frame, on the device."""
        return self.status.word(SAID)

    def search(self, begins: int = 1) -> None:
        """The list, and the pairs of every point; what was listed before is remembered. begins: as `NearPairList.search`."""
        near, P, old, launch = self.near, self.pressed, self.old, self.ground.launch
        self._copy(P, near.pairs.ids, old, self.old_ids)
        near.search(self.at, begins=begins)
        for name in ("press", "stiff", "along"):
            getattr(self.strands.trial, name).zero_()
        self.index()
        launch(self.recall, near.pairs.capacity, [near.table, old, self.old_ids], [P])

    def index(self) -> None:
        """The pairs of every point, of a list in which none remembers anything yet."""
        near, P, launch, row = self.near, self.pressed, self.ground.launch, self.row
        P.many.zero_()
        P.ons.zero_()
        launch(self.enlist, near.pairs.capacity, [near.table, self.table.strands], [P])
        launch(self.order, len(row), [row, near.table, FULL], [P, self.said, near.words])
        launch(self.drop, len(row), [row], [near.table, P, near.words])

    def again(self) -> None:
        """A list along the path that was solved for, and where its pairs are."""
        self.search(0)
        self.listed()

    def listed(self) -> None:
        """Pairs where the substep begins."""
        self.guarantee.begin(self.at)
        near, climb = self.near, rows.RECOVERY * self.h
        self.ground.launch(self.ready, near.capacity, [near.table, self.sides, climb, self.h * self.h,
                                                       self.word(coupled.FIRST)], [self.pressed])

    def forces(self) -> None:
        """Forces of pairs."""
        near = self.near
        self.ground.launch(self.press, near.capacity, [self.edges.data, near.table, self.sides, self.way],
                           [self.pressed, self.word(coupled.ACTIVE)])

    def gathered(self) -> None:
        T = self.strands.trial
        self.forces()
        self.ground.launch(self.gather, len(self.row), [self.row, self.edges.data, self.near.table, self.pressed],
                           [T.press.reshape(-1), T.stiff.reshape(-1), T.along.reshape(-1)])

    def held(self) -> None:
        """Pairs where the substep ends."""
        self.forces()
        self.ground.launch(self.keep, self.near.pairs.capacity, [self.near.table], [self.pressed])

    def _copy(self, P, ids: wp.array, into, into_ids: wp.array) -> None:
        for name in MEMORY:
            wp.copy(getattr(into, name), getattr(P, name))
        wp.copy(into_ids, ids)

    def before_frame(self) -> None:
        ids, self.memory.held = self.near.pairs.ids, False
        if self.fresh:
            self.near.build()
            self._copy(self.pressed, ids, self.saved, self.saved_ids)
        else:
            self.near.anew()
            self._copy(self.saved, self.saved_ids, self.pressed, ids)
        self.words.fill_(int(self.frames == 0 and not self.went_on))            # FIRST; the others are set before they are read
        self.near.set_projection_rounds(ROUNDS * MORE if self.often else ROUNDS)
        self.fresh = False

    def find_remedies(self) -> list[Remedy]:
        said = self.status.said(SAID)
        wanted, full = int(said[clamp.WANTED]), int(said[FULL])
        if wanted or full:
            return [*super().find_remedies(), Remedy("room", lambda: self.grow(wanted, full))]
        if said[clamp.LOST] > LOSS and not self.often:
            self.often = True
            self.repeats += 1
            return [*super().find_remedies(), Remedy("again")]
        return super().find_remedies()

    def grow(self, wanted: int, full: int) -> str:
        before, ids = self.near.pairs.capacity, self.saved_ids
        saved = self.saved
        if wanted > before:
            self.near.grow(wanted)
        self.deep = max(self.deep, full + full // 2)
        self.room()
        for name in ("kept", "stick", "load"):
            wp.copy(getattr(self.saved, name), getattr(saved, name), count=before)
        wp.copy(self.saved_ids, ids, count=before)
        self.saved.many.assign(saved.many)
        of = np.zeros(self.saved.of.shape, np.int32)
        of[:, :saved.of.shape[1]] = saved.of.numpy()
        self.saved.of.assign(of)
        return f"{max(wanted, full)} pairs of edges of rods were near each other, and there was less room"

    def frame_warnings(self) -> list[tuple[tuple, float, str]]:
        said, found = self.status.said(SAID), []
        self.total += said
        self.frames += 1
        if said[clamp.CLOSE]:
            found.append((("rods", "close"), float(said[clamp.CLOSE]), "{worst} pairs of edges of rods began a substep closer "
                          "than what a file can tell apart; nothing is proven of them"))
        if said[clamp.LOST] > LOSS:
            found.append((("rods", "cut"), float(said[clamp.LOST]), "rods were about to pass through each other, and a point "
                          "lost {worst} % of its motion in a substep; give more substeps"))
        if said[clamp.STAYED]:
            found.append((("rods", "held"), float(said[clamp.STAYED]), "rods were held where they were in {worst} substeps: "
                          "nothing else kept them from passing through each other; is something pinched?"))
        return found

    def indicators(self) -> dict[str, float]:
        """Pairs of edges in the last list, least distance of their centre lines [m], how deep they press (over what they keep);
        searches, projected, cut and held substeps of all frames; repeated frames."""
        near = self.near.pairs
        count = min(int(near.count.numpy()[0]), near.capacity)
        found = {f"rod_{name}": float(self.total[k]) for name, k in (
            ("searches", clamp.SEARCHES), ("projected", clamp.PROJECTED), ("cut", clamp.CUT), ("held", clamp.STAYED))}
        if count:
            found["rod_gap"] = float(near.away.numpy()[:count].min())
            k, N = self.pressed.k.numpy()[:count], self.pressed.load.numpy()[:count]
            found["rod_pressed"] = float((N / np.maximum(k * near.keep.numpy()[:count], 1e-300)).max())
        return super().indicators() | found | {"rod_pairs": float(count), "rod_repeated": float(self.repeats)}
