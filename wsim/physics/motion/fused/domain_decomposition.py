"""Domains of sheets and solids that a cluster of blocks shares: the points of each block, and what it computes for them.
See kernels/motion/fused/sheet.py.

    own       the points of a block: halves of equal numbers across the longest side at rest, again and again
    flat      triangles with an own point                  bent      hinges with an own point
    curved    triangles whose curvature they need          hinges    those, and all that these curvatures need
    tets      with an own point
    points    own points, then those of other blocks that any of these has
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp

from wsim.geometry.topology import incident_positions, incident_rows
from wsim.kernels.cloth.curvature import SLOTS
from wsim.kernels.math.real import types
from wsim.kernels.motion.fused.domain_decomposition import LISTS, sheet_patch_table
from wsim.kernels.motion.fused.tet_elements import STRESS
from wsim.kernels.soft import fem
from wsim.model.launches import LARGE_CLUSTER_ARCH, has_large_clusters
from wsim.model.structs import fill_struct
from wsim.physics.cloth.elements import CornerElements
from wsim.physics.motion.fused.plan import FOUR, BlockPlan
from wsim.physics.soft.fem import Tetrahedra
from wsim.scene import Surface
from wsim.scene.check import sharp
from wsim.scene.methods import method_colliders

KINDS = {"membrane", "dihedral"}
BALLS = 256            # colliders that each point looks at, one after the other
NONE = np.zeros((0, 4), int)
# Points for which a block of a cluster has memory, and all of a grid; beyond FEW a block a grid is faster, save where limits
# meet after each colour (tools/bench/choice/blocks.py; H200, 1089 points: 3.2 and 2.4 us a substep, with limits 8 and 11)
OWN, SHARED, FEW = 140, 12_000, 40


def halved_points(x: np.ndarray, index: np.ndarray, size: int) -> list[np.ndarray]:
    """The points of an index in `size` parts, a power of 2. x (n, 3): [m]."""
    if size == 1:
        return [np.sort(index)]
    axis = np.ptp(x[index], axis=0).argmax() if len(index) else 0
    order = index[np.argsort(x[index, axis], kind="stable")]
    middle = len(order) // 2
    return [*halved_points(x, order[:middle], size // 2), *halved_points(x, order[middle:], size // 2)]


class Domains:
    """Lists of every block. `plan`: None where a block's memory does not suffice."""

    def __init__(self, x: np.ndarray, triangles: np.ndarray, hinges: np.ndarray, curvature: dict[str, np.ndarray], size: int,
                 damped: bool, tets: np.ndarray = NONE, **more: Any):
        """x (n, 3) at rest [m]; triangles (t, 3), hinges (h, 4) and tets (m, 4): points; curvature: `Curvature.tables`, or
        nothing; more: what else the plan says."""
        n = len(x)
        self.ids = [triangles, hinges, tets]
        self.own = halved_points(x, np.arange(n), size)
        self.block = np.empty(n, int)
        for b, own in enumerate(self.own):
            self.block[own] = b
        slot = curvature["slot"].reshape(-1, SLOTS) if curvature else np.zeros((0, SLOTS), int)
        used = np.arange(SLOTS) < curvature["count"][:, None] if curvature else slot > 0
        self.slot = np.where(used, slot, -1)
        self.moment = np.append(curvature["begin"], curvature["end"][-1:]) if curvature else np.zeros(len(hinges) + 1, int)
        self.moment_item = curvature["item"].astype(np.int64) if curvature else np.zeros(0, int)
        self.start, self.item = incident_rows(np.concatenate([ids.ravel() for ids in self.ids])[:, None], n)
        self.of = [incident_rows(self.block[ids], size) for ids in self.ids]     # elements at the points of each block
        self.blocks = [self.domain(b) for b in range(size)]
        self.share()
        self.push()
        most = {name: max(len(each[name]) for each in self.blocks) for name in LISTS}
        found: dict[str, Any] = {
            "own": max(map(len, self.own)), "points": most["point"], "triangles": most["triangle"], "tets": most["tet"],
            "bent": most["moment_begin"] - 1, "hinges": most["hinge"], "curved": most["slot"] // SLOTS,
            "moments": most["moment"], "forces": most["force"], "pushes": most["push"]}
        plan = BlockPlan(size, damped=damped, **more, **{k: max(FOUR, -(-v // FOUR) * FOUR) for k, v in found.items()})
        fits = 4 * plan.words <= plan.room and plan.own <= plan.threads
        if plan.grid:
            guests = (len(d["point"]) - len(own) for d, own in zip(self.blocks, self.own, strict=True))
            fits = fits and max(most["near"], *guests) <= plan.threads
        self.plan = plan if fits else None

    def domain(self, b: int) -> dict[str, np.ndarray]:
        """Lists of a block, but for those of what it sends."""
        own, (triangles, hinges, tets) = self.own[b], self.ids
        flat, near, solid = (np.unique(listed_items(*rows, np.array([b]))[0]) for rows in self.of)
        moment, moment_begin = listed_items(self.moment, self.moment_item, near)
        curved = np.unique(moment // SLOTS)
        needed = np.setdiff1d(self.slot[curved], [-1])
        each = np.concatenate([near, np.setdiff1d(needed, near)]).astype(int)
        points = np.unique(np.concatenate([triangles[flat].ravel(), hinges[each].ravel(), tets[solid].ravel()]))
        points = np.concatenate([own, points[self.block[points] != b]])
        at, hinge_at, curved_at = np.full(len(self.block), -1), np.full(len(hinges) + 1, -1), np.full(len(self.slot), -1)
        at[points], hinge_at[each], curved_at[curved] = np.arange(len(points)), np.arange(len(each)), np.arange(len(curved))
        force, begin = self.forces(own, [flat, near, solid])
        return {"point": points, "hinge": each, "hinge_corner": packed_corners(at[hinges[each]]), "triangle": flat,
                "corner": packed_corners(at[triangles[flat]]), "tet": solid, "tet_corner": packed_corners(at[tets[solid]]),
                "slot": hinge_at[self.slot[curved]].ravel(),
                "value": (SLOTS * curved[:, None] + np.arange(SLOTS)).ravel(),
                "moment_begin": moment_begin,
                "moment": SLOTS * curved_at[moment // SLOTS] + moment % SLOTS,
                "force_begin": begin, "force": force}

    def forces(self, own: np.ndarray, of: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Element << 2 | corner of each force of own points, kind by kind, and where those of a point begin. of: elements of
        each kind that the block computes."""
        item, begin = listed_items(self.start, self.item, own)
        first = np.cumsum([0, *(ids.size for ids in self.ids)])
        kind = np.searchsorted(first, item, side="right") - 1
        row, corner = np.divmod(item - first[kind], np.array([ids.shape[1] for ids in self.ids])[kind])
        element, before = np.full(len(item), -1), 0
        for k, some in enumerate(of):
            element[kind == k] = before + np.searchsorted(some, row[kind == k])
            before += len(some)
        return element << 2 | corner, begin

    def push(self) -> None:
        """block << 16 | place of each copy of an own point in others' memory, and where those of a point begin."""
        holder = np.concatenate([np.full(len(d["point"]) - len(own), b)
                                 for b, (d, own) in enumerate(zip(self.blocks, self.own, strict=True))])
        guest = np.concatenate([d["point"][len(own):] for d, own in zip(self.blocks, self.own, strict=True)])
        slot = np.concatenate([np.arange(len(own), len(d["point"])) for d, own in zip(self.blocks, self.own, strict=True)])
        start, item = incident_rows(guest[:, None], len(self.block))
        word = (holder << 16 | slot)[item]
        for d, own in zip(self.blocks, self.own, strict=True):
            d["push"], d["push_begin"] = listed_items(start, word, own)

    def share(self) -> None:
        """Blocks that each needs points of. Who is sent something sends something: so neither gets ahead by two substeps."""
        needs = np.zeros((len(self.own), len(self.own)), bool)
        for b, d in enumerate(self.blocks):
            needs[b, self.block[d["point"]]] = True
        np.fill_diagonal(needs, False)
        for b, other in zip(*np.nonzero(needs.T & ~needs), strict=True):
            self.blocks[b]["point"] = np.append(self.blocks[b]["point"], self.own[other][:1])
        for row, d in zip(needs | needs.T, self.blocks, strict=True):
            d["near"] = np.flatnonzero(row)

    def lists(self) -> tuple[np.ndarray, np.ndarray]:
        """First place and size of every list of every block, and all of them."""
        each = [d[name] for d in self.blocks for name in LISTS]
        count = np.array([len(a) for a in each])
        return np.stack([np.cumsum(count) - count, count], axis=1).ravel(), np.concatenate(each)


def listed_items(start: np.ndarray, items: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Items of some rows of lists, items[start[i]:start[i + 1]], one behind the other, and where those of a row begin."""
    return items[incident_positions(start, rows)[0]].astype(np.int64), np.append(0, np.cumsum(start[rows + 1] - start[rows]))


def packed_corners(corners: np.ndarray) -> np.ndarray:
    """Places of the corners of elements (m, 3 or 4) in two words each."""
    four = np.pad(corners, ((0, 0), (0, 4 - corners.shape[1])))
    return (four[:, ::2] | four[:, 1::2] << 16).ravel()


def blocks_of(device, points: int, limited: bool) -> list[int]:
    """Blocks to try: a cluster, then a grid of no more than there are multiprocessors. limited: there are strain limits."""
    cluster = 16 if has_large_clusters(device) else 8
    return [cluster] * (points <= few_block_points(limited) * cluster) + [1 << device.sm_count.bit_length() - 1]


def few_block_points(limited: bool) -> int:
    """Points of a block, up to which a cluster takes a model."""
    return OWN if limited else FEW


def shared_elements(pull, taken: frozenset[str]) -> ClusterSheets | None:
    """Elements of a `wsim.physics.motion.forces.ForceGather` that nothing acts on but methods of these names; None where blocks
    cannot take them."""
    scene, air = pull.model.scene, "aero" in taken
    if cluster_cannot_take(pull) or air and not air_on_membranes_only(pull):
        return None
    found = ClusterSheets(pull, air, "contact" in taken and any(isinstance(c.shape, Surface) for c in scene.colliders))
    return found if found.plan else None


def blocks_take_acts(model) -> bool:
    """True if blocks may take along what acts within substeps of a model: tethers, strain limits, contacts of points with what
    keeps its shape. Contacts of edges read what other points do within a substep, which blocks do not know."""
    from wsim.physics.contact.free_flight_test import count_bounded_colliders, has_deforming_mesh
    scene, hard = model.scene, {r.kind for r in model.constraints if r.hard}
    return (hard <= {"tether", "limit"} and not (has_deforming_mesh(scene) or method_colliders(scene))
            and count_bounded_colliders(scene) <= BALLS and not (sharp.has_edge_contacts(scene) and not model.gradients))


def cluster_cannot_take(pull) -> bool:
    """True if a cluster cannot take the elements of a model: see kernels/motion/fused/sheet.py."""
    model, device = pull.model, pull.model.device
    return (model.fuses is False or not device.is_cuda or min(device.arch, device.get_cuda_compile_arch()) < LARGE_CLUSTER_ARCH
            or model.gradients or model.worlds > 1 or model.real is not wp.float32 or bool(pull.springs)
            or not {e.kind for e in pull.elements if isinstance(e, CornerElements)} <= KINDS
            or not all(isinstance(table, Tetrahedra) and table.maths is fem and table.material in STRESS and not table.plastic
                       for table in pull.tables))


def air_on_membranes_only(pull) -> bool:
    """True if all triangles that air acts on are membranes."""
    triangles = [b.triangles for b in pull.model.bodies if b.source.feels_air]
    have = [e.ids for e in pull.elements if isinstance(e, CornerElements) and e.kind == "membrane"]
    return bool(have) and {*map(tuple, np.sort(np.concatenate(triangles), axis=1).tolist())} <= {
        *map(tuple, np.sort(have[0], axis=1).tolist())}


class ClusterSheets:
    """Membranes, hinges and tets of a model that a cluster takes. `plan` is None where it cannot."""

    def __init__(self, pull, air: bool, meshes: bool):
        """air: it acts, and on nothing but triangles; meshes: points meet some."""
        self.model = model = pull.model
        self.limits: Any = None              # `wsim.physics.motion.fused.limits.BlockLimits`
        of = {e.kind: e for e in pull.elements if isinstance(e, CornerElements)}
        flat, bent, solid = of.get("membrane"), of.get("dihedral"), pull.tables
        limited = any(r.kind == "limit" for r in model.constraints)
        for size in blocks_of(model.device, model.points, limited):
            found = Domains(model.stack("rest"), flat.ids if flat else NONE[:, :3], bent.ids if bent else NONE,
                            bent.curvature.tables() if bent else {}, size, pull.damped,
                            np.concatenate([NONE, *(table.ids for table in solid)]), air=air, meshes=meshes,
                            loaded=bool(model.scene.loads))
            if found.plan and limited:
                from wsim.physics.motion.fused.limits import BlockLimits, edges_of
                self.limits = BlockLimits(found, *edges_of(model))
                found.plan = self.limits.plan
            if found.plan:
                break
        if found.plan is None:
            self.plan: Any = None
            return
        self.plan = replace(found.plan, materials=tuple(table.material for table in solid))
        head, every = found.lists()
        self.data: Any = fill_struct(sheet_patch_table(model.real, self.plan.materials),
                                     **{table.material: table.data for table in solid},
                                     head=model.upload(head, int), list=model.upload(every, int))
        if flat:
            for name in ("rest", "stiffness", "tau"):
                setattr(self.data, name, getattr(flat.data, name))
        if bent:
            for name, own in (("angle", "rest"), ("bend", "stiffness"), ("relax", "tau")):
                setattr(self.data, name, getattr(bent.data, own))
            self.data.own, self.data.value = bent.curvature.data.own, bent.curvature.data.value
        if self.plan.grid:
            self.data.mail = wp.zeros(4 * model.points, dtype=types(model.real).vec4, device=model.device)

    def meet(self, air) -> None:
        """air: struct of kernels/cloth/air.py."""
        for name in ("wind", "drag", "lift", "normal_drag"):
            setattr(self.data, name, getattr(air, name))

    def bear(self, loads) -> None:
        """loads: `wsim.physics.motion.loads.Loads`, whose table is another one with other substeps."""
        from wsim.kernels.motion.load import borne_loads
        place = np.full(self.model.points, -1, np.int32)
        place[loads.point] = np.arange(len(loads.point))
        self.data.borne = fill_struct(borne_loads(self.model.real), place=self.model.upload(place, int), entries=loads.entries,
                                      own=loads.own, value=loads.value)

    def begin(self) -> None:
        """Launches before a frame."""
        if self.plan.grid:
            self.model.zero(self.data.mail)
