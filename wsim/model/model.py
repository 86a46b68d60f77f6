"""A scene made ready for one device and precision: which point is where in the arrays, and what never changes in a run.

Points of all bodies of all worlds stand in one set of arrays, in locality order inside each body; `PointBody.index` leads from
the author's points to the arrays (welded duplicates share a place). Positions are relative to an origin per body.
"""

from dataclasses import dataclass, field
from math import isfinite
from typing import Any

import numpy as np

from wsim.geometry import topology
from wsim.geometry.ordering import row_order
from wsim.geometry.sheet_ordering import order_of_points
from wsim.model.launches import KernelLaunches
from wsim.model.midnodes import held_with_midnodes, memory_neighbours, with_midnode_values
from wsim.scene import Deformable, Problem, Scene, SceneError
from wsim.scene.nodal.masses import fill_loose_masses

CELL = 2.6             # edge of the rows of particles over their greatest radius: as of the cells that grains are searched in


@dataclass
class PointBody:
    """One cloth or spring net of one world, in solver order."""

    world: int
    source: Deformable
    number: int                          # row of this body in the tables per object
    first: int                           # first of its points in the arrays
    index: np.ndarray                    # author's point -> place in the arrays, (n,)
    origin: np.ndarray                   # [m] world, (3,), float64
    places: np.ndarray                   # initial positions [m] relative to origin, solver order, (points, 3)
    velocities: np.ndarray               # initial [m/s] world, (points, 3)
    rest: np.ndarray                     # rest positions [m], any frame of the same size, (points, 3)
    masses: np.ndarray                   # [kg], (points,)
    reach: np.ndarray                    # half thickness [m], (points,)
    friction: tuple[float, float]        # static, dynamic
    triangles: np.ndarray                # places in the arrays, (t, 3); empty for springs
    polygon: np.ndarray                  # author's polygon of each triangle, (t,)
    edges: np.ndarray                    # places in the arrays, (m, 2)
    tets: np.ndarray                     # places in the arrays, (t, 4), quadratic (t, 10); empty for all but soft bodies
    idle: np.ndarray                     # places of points that nothing holds and that stay where they are
    middles: np.ndarray                  # places of the middles of edges of quadratic tets, (m,); see `wsim.model.midnodes`
    ends: np.ndarray                     # author's points that each is between, (m, 2)
    own: np.ndarray                      # as index, but the idle places of points that are another body's (`shared_points`)

    @property
    def path(self) -> str:
        return self.source.path

    @property
    def count(self) -> int:
        return len(self.masses)

    @property
    def point_masses(self) -> np.ndarray:
        """Mass of each of the author's points [kg], (n,), in the order of `Simulation.positions` and `velocities`; points that
        are welded share theirs evenly. `masses` are in solver order. Nodes amid edges of quadratic tets are none of the
        author's points, and their masses are not among these."""
        place = self.own - self.first
        return self.masses[place] / np.bincount(place, minlength=self.count)[place]

    @property
    def last(self) -> int:
        return self.first + self.count


@dataclass
class Model(KernelLaunches):
    """Bodies of every world, and the tables over points and objects that every method reads."""
    scene: Scene
    worlds: int
    device: Any                          # warp device
    real: Any                            # wp.float32 or wp.float64
    module: str                          # name of the Warp module that holds the plan's kernels
    bodies: list[PointBody]
    modules: dict[str, int] = field(default_factory=dict)     # with blocks of their own, by name: threads of a block
    step: str = ""                       # module of kernels of a Newton step, which other scenes share; "": the plan's
    constraints: list = field(default_factory=list)       # `wsim.physics.cloth.constraints.Constraints` of every world
    tables: dict = field(default_factory=dict)  # `wsim.physics.cloth.table.ConstraintTable` of them by kind, of who has asked
    alias: np.ndarray | None = None      # place that stands for each place, (points,), where bodies share points
    by_point: bool = False               # gravity, wind, drag of the air stand once a point, not a body: gradients, loads
    gradients: bool = False              # kernels have adjoints, and no method works in place where those cannot follow
    tape: Any = None                     # `wsim.model.tape.Tape` that records what is launched
    vjp: dict = field(default_factory=dict)               # adjoints by hand, by kernel: see `wsim.model.vjp`
    plain: set[int] = field(default_factory=set)          # addresses of arrays that change, of which a tape keeps no gradients
    recorder: Any = None  # `wsim.physics.motion.fused.recorder.LaunchRecorder` that writes down what would be launched
    fuser: Any = None                    # `wsim.physics.motion.fused.kernel_fusion.Fuser`: many substeps in one launch

    @property
    def points(self) -> int:
        return self.bodies[-1].last if self.bodies else 0

    def shared(self, places: np.ndarray) -> np.ndarray:
        """Places with those of points that bodies share in one body's arrays only."""
        return places if self.alias is None else self.alias[places].astype(places.dtype)

    def of_world(self, world: int) -> str:
        """Words that name a world behind a path, where there are several."""
        return f" (world {world})" * (self.worlds > 1)

    @property
    def gone(self) -> np.ndarray:
        """Places that another stands for, (k,)."""
        return np.zeros(0, np.int64) if self.alias is None else np.flatnonzero(self.alias != np.arange(self.points))

    @property
    def starts(self) -> np.ndarray:
        """First place of each system and the end, (systems + 1,). A system shares no force with others: a body, or, where
        bodies share points, all of a world."""
        each = 1 if self.alias is None else len(self.bodies) // self.worlds
        return np.array([*(b.first for b in self.bodies[::each]), self.points])

    def system(self, number):
        """System of the body of that number, or of each of an array of numbers."""
        return number if self.alias is None else number // (len(self.bodies) // self.worlds)

    @property
    def dtype(self):
        return np.float32 if self.real.__name__ == "float32" else np.float64

    def body(self, path: str | None, world: int = 0) -> PointBody:
        """The body of that path (None: the only one). Raises SceneError that lists the paths there are."""
        found = [b for b in self.bodies if b.world == world and path in (None, b.path)]
        if len(found) != 1:
            there = f"{sorted({b.path for b in self.bodies})} in worlds 0 to {self.worlds - 1}"
            raise SceneError(Problem(path or "path", f"world {world} has {len(found)} bodies of that path; there are {there}"))
        return found[0]

    def rows(self, path: str, world: int | None = None) -> list[int]:
        """Rows in the tables per object (`by_point`: per point) of a body ("/": of all), in one world or in all (None)."""
        found = [b for b in self.bodies if path in ("/", b.path) and world in (None, b.world)]
        return [i for b in found for i in range(b.first, b.last)] if self.by_point else [b.number for b in found]

    def stack(self, name: str) -> np.ndarray:
        """One field of all bodies in solver order."""
        return np.concatenate([getattr(b, name) for b in self.bodies])

    def upload(self, values, dtype):
        """Device array of NumPy values, of the model's precision where dtype is a real type; with gradients if asked for."""
        import warp as wp
        real = getattr(dtype, "_wp_scalar_type_", dtype) in (wp.float32, wp.float64)
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device=self.device, requires_grad=self.gradients and real)


def edge_lengths(body: PointBody) -> np.ndarray:
    """Rest length of every edge of a body [m], (m,): the author's, or that of the rest shape."""
    lengths = body.source.lengths
    if lengths is not None:
        return lengths.astype(np.float64)
    p = body.rest[body.edges - body.first]
    return np.linalg.norm(p[:, 1] - p[:, 0], axis=1)


def hard_places(model: Model) -> np.ndarray:
    """Places in the arrays of every point that is pinned hard, or idle."""
    places = [b.idle for b in model.bodies] + [held_with_midnodes(b, p.points)[0] for p in model.scene.pins
                                               for b in model.bodies
              if b.path == p.body and not isfinite(p.stiffness)]
    return np.concatenate([np.zeros(0, np.int64), *places])


def make_body(source: Deformable, world: int, number: int, first: int) -> PointBody:
    """Welds, orders and measures one body. Every field but the motion is independent of the device."""
    places = source.motion.points(source.points, 0.0)
    n, shape = len(places), source.geometry(places)
    particle, places = shape.particle, with_midnode_values(places, shape.ends)
    count = int(particle.max()) + 1 if n else 0
    one = np.zeros(count, np.int64)
    one[particle[::-1]] = np.arange(len(places))[::-1]             # first author's point of each particle
    origin = 0.5 * (places.min(axis=0) + places.max(axis=0)) if n else np.zeros(3)
    origin = np.round(origin)                                      # whole metres: the origin itself is exact
    if source.is_particles:                                        # order[new] = old
        order = row_order(places[one] - origin, CELL * float(shape.reach.max(initial=0.0)) or 1.0)
    else:
        order = order_of_points(shape.rest[one], particle[memory_neighbours(shape)])
    place = np.empty(count, np.int64)
    place[order] = np.arange(count)
    index = first + place[particle]
    one = one[order]
    spin = source.motion.at(0.0)[:3, :3]
    velocities = with_midnode_values(np.zeros((n, 3)) if source.velocities is None else source.velocities @ spin.T,
                                     shape.ends)[one]
    whole = _corners_are_distinct(index[shape.triangles])
    triangles, polygon = index[shape.triangles[whole]], shape.polygon[whole]
    edges = topology.edges_of_triangles(triangles) if source.is_sheet else index[shape.edges]
    masses, idle = np.bincount(place[particle], shape.masses, count), index[shape.idle] - first
    if source.is_sheet:
        masses, idle = fill_loose_masses(masses, triangles - first)
    velocities[idle] = 0.0
    return PointBody(world, source, number, first, index[:n], origin, places[one] - origin, velocities, shape.rest[one], masses,
                     shape.reach[one], source.friction, triangles.astype(np.int32), polygon, edges.astype(np.int32),
                     index[shape.tets].astype(np.int32), first + idle, index[n:], shape.ends, index[:n])


def _corners_are_distinct(triangles: np.ndarray) -> np.ndarray:
    """Whether the corners of each triangle are three different points: a weld may have joined some."""
    a, b, c = triangles.T
    return (a != b) & (b != c) & (c != a)


def build_model(scene: Scene, worlds: int, device, real, module: str = "") -> Model:
    """Bodies of all worlds; worlds are copies of one scene standing behind each other in the arrays."""
    from dataclasses import replace
    first, single, bodies = 0, [], list[PointBody]()
    for number, source in enumerate(scene.bodies()):
        single.append(make_body(source, 0, number, first))
        first = single[-1].last
    alias = None
    if shared := [tie for tie in scene.ties if tie.others is not None]:
        from wsim.model.shared_points import join_tied_points
        alias = join_tied_points(single, shared)
    for world in range(worlds):
        shift, rows = world * first, world * len(single)
        bodies += [replace(b, world=world, number=b.number + rows, first=b.first + shift, index=b.index + shift,
                           triangles=b.triangles + shift, edges=b.edges + shift, tets=b.tets + shift, idle=b.idle + shift,
                           middles=b.middles + shift, own=b.own + shift)
                   for b in single]
    if alias is not None:
        alias = np.concatenate([alias + world * first for world in range(worlds)])
    return Model(scene, worlds, device, real, module, bodies, alias=alias)
