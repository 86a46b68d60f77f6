"""Forces by which explicit steps are taken: springs of each point, and elements with their corners.

On a GPU, and where gradients are asked for, a point's springs stand together, padded to equal numbers where that does not cost
much, and are gathered by a few threads; else on a CPU every spring stands once, at its lower end, and is added to both
(kernels/cloth/spring.py, kernels/motion/fast_paths/march_cpu.py). In which order a point's forces are added follows from the
points of one world, so that worlds have the bits of one alone; how many threads share a point, from all.
"""

from itertools import zip_longest
from typing import Any

import numpy as np
import warp as wp

from wsim.geometry.topology import incident_rows
from wsim.kernels.cloth import spring as kernels
from wsim.kernels.math.real import types
from wsim.kernels.motion.fast_paths import march_cpu
from wsim.kernels.motion.fast_paths import simd_springs as lots
from wsim.kernels.motion.fast_paths.cluster import Shares
from wsim.model.launches import has_large_clusters
from wsim.model.model import Model
from wsim.model.vjp import beside
from wsim.physics.cloth.constraints import Constraints
from wsim.physics.cloth.elements import CornerElements, SolidElements
from wsim.physics.cloth.kind import SPRINGS
from wsim.physics.motion.fast_paths.cluster import cluster_for, exchange_halo
from wsim.physics.motion.fast_paths.simd_springs import Packets
from wsim.physics.motion.fast_paths.threads import Abreast, count_cores, march_orders, net_parts
from wsim.scene.methods import has_tets

FEW = 20_000           # points up to which padding to the largest number of springs is free: launches are all that counts
PADDED = 1.5           # entries over springs' ends that padding may cost above
class ForceGather:
    """Every force on the points, on the device. `columns`: of the pins' targets, see `Pins.columns`."""

    def __init__(self, model: Model, constants, rows: list[Constraints], columns: np.ndarray | None,
                 alone: bool | frozenset[str] = False, staged: bool = False, shared: bool = True, packed: bool = False):
        """alone: nothing else acts within a frame, so that a cluster of blocks, or CPU threads abreast, may take all of it;
        names: nothing but these methods. staged: integrators of several stages, whose adjoints are Warp's. shared: several
        threads may take a point. packed: who asks steps by a march where there is one, see `march`."""
        self.model = model
        self.exact = model.gradients and not staged and model.real is wp.float32      # see kernels/math/compensated.py
        self.shared = shared and model.device.is_cuda and not (staged and model.gradients)
        self.cluster: Any = None         # `fast_paths.cluster.SpringCluster`, of sheets `fused.domain_decomposition.BlockPlan`
        self.made, taken = False, alone if isinstance(alone, frozenset) else frozenset[str]()
        alone = bool(alone) and not taken
        self.springs = [r for r in rows if r.row.gather == SPRINGS]
        self.tables: list = []
        if has_tets(model.scene):
            from wsim.physics.soft.fem import tet_tables
            self.tables = tet_tables(model)
        self.damped = any(r.tau > 0.0 for r in rows) or any(table.damped for table in self.tables)
        self.added = bool(self.springs) and not (model.device.is_cuda or model.gradients)
        self.force: wp.array | None = None            # at the corners of elements
        self.lengths: wp.array | None = None          # rest lengths of the entries before muscles shorten them
        alone = alone and not any(r.body and getattr(r.body.source, "actuation", None) for r in rows) and not model.scene.loads
        self.only = not (self.damped or has_tets(model.scene)) and len(self.springs) == len(rows)
        self.whole = alone and len(self.springs) == len(rows) and not has_tets(model.scene)
        self.alone = alone and self.only and _forms_clusters(model.device) and not model.gradients
        self.net = kernels.spring_nets(model.real)()
        for name in ("w", "object", "gravity", "decay"):
            setattr(self.net, name, getattr(constants, name))
        self.net.pin = model.upload(np.full(model.points, -1, np.int32) if columns is None else columns, int)
        self.table, self.lanes, self.sums, self.width = self.net, 1, 1, 0
        if self.springs:
            self.place(model.shared(np.concatenate([r.ids for r in self.springs]).astype(np.int32)))
            self.values()
        kinds = sorted({r.kind for r in rows if r.row.gather != SPRINGS})
        flat = [CornerElements(model, kind, [r for r in rows if r.kind == kind]) for kind in kinds]
        self.elements: list[CornerElements | SolidElements] = [*flat, *(SolidElements(table) for table in self.tables)]
        # adjoints of elements ask p, the gradient by forces on points; those of stages, which are Warp's, leave it at corners
        self.direct = bool(self.elements) and not staged
        self.p = wp.zeros(model.points, dtype=types(model.real).vec3, device=model.device) if model.gradients else None
        self.by_corners: wp.array | None = None       # gradients by their positions, where p is all that is to be known
        self.rates: wp.array | None = None            # and by their velocities
        self.sheets: Any = None
        self.domains: Any = None
        if packed and not self.why_unpacked():
            self.pack(flat, alone)
        else:
            self.divide(alone, taken)

    def pack(self, flat: list[CornerElements], alone: bool) -> None:
        """Elements in packets."""
        from wsim.physics.motion.fast_paths.simd_sheets import PacketSheets
        self.sheets = PacketSheets(self.model, flat, self.damped, count_cores() if alone else 1)
        self.table, self.space, self.abreast = self.sheets.table, self.sheets.space, self.sheets.abreast
        self.blocks = self.sheets.blocks

    def divide(self, alone: bool, taken: frozenset[str]) -> None:
        """Sheets among blocks that take whole frames; else elements, launch by launch."""
        if (alone or taken) and self.elements:
            from wsim.physics.motion.fused.domain_decomposition import shared_elements
            self.domains = shared_elements(self, taken)
        if self.domains:
            self.cluster, self.shares = self.domains.plan, self.domains.data
        else:
            self.make()

    def make(self) -> None:
        """Kernels of elements, before the module is compiled, and where points find their forces."""
        self.made = True
        for e in self.elements:
            e.make(self.damped)
        self.corners()

    def frames(self, bounded: bool = False):
        """Kernel that takes whole frames by a cluster. bounded: frames are watched."""
        plan, real = self.cluster, self.model.real
        if self.domains:
            from wsim.kernels.motion.fused import march
            return march.frame_march_kernel(real, self.model.module_of(plan.threads), plan, self.damped, bounded)
        from wsim.kernels.motion.fast_paths import cluster
        return cluster.cluster_frame_kernel(real, self.model.module_of(plan.threads), plan, bounded)

    def why_unpacked(self) -> str:
        """What keeps elements from being taken in packets, or ""."""
        kinds = sorted({e.kind for e in self.elements if isinstance(e, CornerElements) and not e.row.packets})
        why = {"gradients": self.model.gradients, "a GPU": self.model.device.is_cuda, "no elements": not self.elements,
               "Launches.fuses": self.model.fuses is not None, "springs beside them": bool(self.springs),
               "tets": bool(self.tables), ", ".join(kinds): bool(kinds)}
        return ", ".join(what for what, there in why.items() if there)

    def form(self) -> str:
        """How elements are taken, in words of the plan."""
        if self.domains:
            return f" shared by {self.cluster.size} blocks"
        if self.model.device.is_cuda or self.model.gradients or not self.elements:
            return ""
        return " in packets" if self.sheets else f", no packets: {self.why_unpacked() or 'stages, muscles or loads'}"

    def march(self, module, bounded: bool):
        """Kernel that takes whole frames or substeps, of springs or sheets alone; bounded: frames are watched. None where
        forces are launched by themselves."""
        if self.sheets:
            return self.sheets.march(module, bounded)
        if self.added and not self.elements:
            return march_cpu.cpu_march_kernel(self.model.real, module, self.damped, bounded)
        return None

    def place(self, ids: np.ndarray) -> None:
        """Entries: which spring stands where."""
        model, n, own = self.model, self.model.points, self.model.points // self.model.worlds
        if self.added:
            self.packets(ids, march_orders(self.springs, model.bodies))
            return
        start, spring = incident_rows(ids, n)
        point = np.repeat(np.arange(n), np.diff(start))
        self.entry, other = spring, ids[spring].sum(1) - point
        most = int(np.diff(start).max())
        if self.alone:
            self.cluster = cluster_for(own, most, 16 if has_large_clusters(model.device) else 8, np.dtype(model.dtype).itemsize)
        self.share_points(most)
        width = -(-most // self.sums) * self.sums
        if self.cluster or n <= FEW or n * width <= PADDED * len(spring):
            self.width = width
            into = point * width + np.arange(len(point)) - start[point]
            self.entry, filled = np.full(n * width, -1), np.repeat(np.arange(n), width)
            self.entry[into], filled[into] = spring, other
            other = filled
        if self.cluster:
            self.share(np.repeat(np.arange(own), width), other[:own * width])
        self.table.start = model.upload(start.astype(np.int32), int)
        self.table.other = model.upload(other.astype(np.int32), int)

    def share_points(self, most: int) -> None:
        """Parts of a point's sum, of which there are `most` at most, and the threads that share them."""
        if self.shared:
            n, worlds = self.model.points, self.model.worlds
            self.sums = self.cluster.lanes if self.cluster else _lanes_for(n // worlds, most)
            self.lanes = min(self.sums, _lanes_for(n, most))

    def packets(self, ids: np.ndarray, order: np.ndarray) -> None:
        """The same on a CPU. order: of the points."""
        model, found = self.model, Packets(ids, order, self.model.worlds)
        self.entry, self.table = found.entry, lots.list_of(model.real)()
        for name in ("order", "group", "runs", "start"):
            setattr(self.table, name, model.upload(getattr(found, name).astype(np.int32), int))
        self.table.ends = model.upload(found.words(), wp.uint64)
        self.blocks = len(found.cost)
        self.abreast = Abreast(model, net_parts(found, count_cores() if self.whole else 1))
        self.table.row = lots.padded_row_length(len(found.order))
        self.space = lots.march_buffer(model.real, self.table.row, len(found.entry), model.device)

    def share(self, point: np.ndarray, other: np.ndarray) -> None:
        """What each block of a world's cluster keeps; no cluster where points hang together too widely for that. point, other:
        ends of the springs of a world."""
        n, plan = self.model.points // self.model.worlds, self.cluster
        found = plan and exchange_halo(plan, n, point, other, np.dtype(self.model.dtype).itemsize)
        self.cluster = found[0] if found else None
        if found:
            self.shares = Shares()
            self.shares.points = n
            for name in ("slot", "push", "guests"):
                setattr(self.shares, name, self.model.upload(getattr(found[1], name), int))

    def values(self, again: bool = False) -> None:
        """Uploads rest lengths, stiffness and damping of the entries; again: into the same arrays."""
        each = [np.broadcast_to(1.0 / r.alpha, len(r.ids)) for r in self.springs]
        tables = {"rest": np.concatenate([r.rest for r in self.springs]), "k": np.concatenate(each)}
        if self.damped:
            tables["damping"] = np.concatenate([r.tau * k for r, k in zip(self.springs, each, strict=True)])
        if self.exact:                               # of muscles, whose lengths are products, it is not known
            tables["left"] = (tables["rest"] - tables["rest"].astype(np.float32)) * (self.lengths is None)
        for name, values in tables.items():
            spread = np.append(values, 0.0)[self.entry].astype(self.model.dtype)        # padding pulls at nothing
            if again:
                (self.lengths if name == "rest" and self.lengths else getattr(self.table, name)).assign(spread)
            else:
                setattr(self.table, name, self.model.upload(spread, self.model.real))

    def corners(self) -> None:
        """Places of each point's forces among the corners of all elements; before those come sums of the points."""
        model, first = self.model, self.model.points if self.added else 0
        size = first + sum(e.ids.size for e in self.elements)
        self.force = wp.zeros(size, dtype=types(model.real).vec3, device=model.device) if size else None
        if model.gradients and self.direct and self.force:
            model.plain.add(self.force.ptr)
            self.by_corners = wp.zeros_like(self.force)              # where their gradients stand until points take them
        if model.gradients and any(e.damped for e in self.elements):
            self.rates = wp.zeros(size, dtype=types(model.real).vec3, device=model.device)
        if self.elements:
            starts, items = incident_rows(np.concatenate([e.ids.ravel() for e in self.elements])[:, None], model.points)
            self.net.first, self.net.item = model.upload(starts.astype(np.int32), int), model.upload(items + first, int)
            if self.shared and not self.springs:
                self.share_points(int(np.diff(starts).max()))
        for e in self.elements:
            e.first, first = first, first + e.ids.size
            beside(model, __name__, "element_adjoint", self, e)

    def need_springs(self) -> None:
        """Makes the kernels that `launch` needs, of springs on a CPU."""
        if not (self.made or self.sheets):
            self.make()
        if self.added:
            self.pull = march_cpu.spring_pull_kernel(self.model.real, self.model.module, self.damped)

    def flags(self) -> tuple:
        """Flags that `wsim.kernels.cloth.spring.acceleration_function` is made of."""
        return tuple({"springs": bool(self.springs), "corners": bool(self.elements), "damped": self.damped, "added": self.added,
                      "lanes": self.lanes, "sums": self.sums, "width": self.width, "exact": self.exact}.items())

    def launch(self, source: int, x: wp.array, pair: wp.array) -> None:
        """Forces that are not gathered on the way: those of elements, and on a CPU of springs."""
        if self.added:
            self.model.launch(self.pull, 1, [self.table, x, pair, source], [self.force, self.space])
        passes = [e.passes(x, pair, source, self.force) for e in self.elements]
        for each in zip_longest(*passes) if self.model.recorder else zip([launch for e in passes for launch in e]):
            with self.model.together():
                for launch in filter(None, each):
                    launch()

    def given(self, lengths: wp.array) -> None:
        """Rest lengths as they are without muscles, which change `table.rest` from now on."""
        self.lengths = lengths
        self.values(again=True)

    def spring_tables(self) -> list:
        from wsim.physics.cloth.nets.springs import SpringTable
        return [SpringTable(self.springs, self.table.rest, self.entry, self.given)]

    def refresh(self) -> bool:
        """Uploads rest values, stiffness and damping anew; True if launches have other arguments from now on."""
        if self.springs:
            self.values(again=True)
        for e in self.elements:
            e.refresh()
        return self.sheets.refresh() if self.sheets else False

    @property
    def count(self) -> int:
        """Springs."""
        return sum(len(r.ids) for r in self.springs)

    @property
    def launches(self) -> int:
        if self.sheets:
            return 0
        return len(self.elements) + self.added + 2 * any(getattr(e, "curvature", None) is not None for e in self.elements)

    @property
    def bytes(self) -> int:
        """Bytes moved by one evaluation of all forces, when every gather hits the cache once."""
        real, n = np.dtype(self.model.dtype).itemsize, self.model.points
        entries = len(self.entry) if self.springs else 0
        return (entries * (4 + real * (2 + self.damped)) + n * real * (21 + 6 * self.damped) + n * 12
                + sum(e.ids.size * (4 + 3 * 2 * real) for e in self.elements))


def _forms_clusters(device) -> bool:
    """Whether blocks can form clusters: on the device, and in what Warp compiles for it (PTX may be for an older one)."""
    return device.is_cuda and min(device.arch, device.get_cuda_compile_arch()) >= 90


def _lanes_for(n: int, most: int) -> int:
    """Threads that share a point on a GPU. H200, 12 springs a point, a launch: 1k points 4.3 us with 16, 4.6 with 4 and 10.3
    with 1; 10k points 5.5 with 8, 5.9 with 4; 100k points 13.8 with 4, 23.7 with 8; 1M points 103 with 2, 120 with 1."""
    few = 16 if n <= 8_000 else 8 if n <= 30_000 else 4 if n <= 100_000 else 2
    return min(few, 1 << max(most - 1, 0).bit_length())
