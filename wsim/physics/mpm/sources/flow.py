"""What pours in and what sinks take, on the device (kernels/particles/mpm/actions/flow.py): the table of births, and launches.

Rows are reserved for all that comes while the scene's frames run. A run that goes on gets rows for half as many frames more,
before the first frame that needs them: that is the only frame which is captured anew.
"""

from typing import Any

import numpy as np

from wsim.kernels.particles.mpm.actions.flow import birth_kernels, birth_table, sink_kernel
from wsim.model.model import Model
from wsim.model.structs import fill_struct
from wsim.physics.contact.collider.table import ColliderTable
from wsim.physics.mpm.objects import MaterialPoints, MaterialSink
from wsim.physics.mpm.seeding import nearest_nodes
from wsim.physics.particles.pouring import PouredPoints

FURTHER, LEAST = 1.5, 16     # frames that rows are reserved for, over those before, and at least as many more
BESIDE = 8                   # particles of each source more than those frames take


class MaterialFlow:
    """`shapes`: columns of each thing that pours, by its number. frames: for which there are rows."""

    def __init__(self, model: Model, things: list[MaterialPoints], sinks: list[MaterialSink], fps: float, frames: int):
        self.model, self.fps, self.frames, self.sinks = model, fps, max(frames, 1), sinks
        self.shapes = {k: thing.pouring_shape() for k, thing in enumerate(things) if thing.pour}
        self.planned = dict.fromkeys(self.shapes, 0)           # particles of each that have rows
        self.births: Any = None
        self.threads = 0
        self.table: ColliderTable | None = None

    def plan(self, k: int) -> PouredPoints:
        """What of thing k comes further, as far as there are to be rows."""
        shape, first = self.shapes[k], self.planned[k]
        last = max(first, shape.count_until(self.frames / self.fps) + BESIDE)
        if shape.pour.end < np.inf:
            last = max(first, min(last, shape.count_until(shape.pour.end)))
        self.planned[k] = last
        return shape.pour_points(first, last, self.fps)

    def lacks_rows(self, frame: int) -> bool:
        """Whether a frame may bring what has no rows."""
        return frame >= self.frames and any(shape.pour.end * self.fps > self.frames for shape in self.shapes.values())

    def extend(self, frame: int) -> None:
        """Further frames are planned, `frame` among them."""
        while self.frames <= frame:
            self.frames = max(int(FURTHER * self.frames), self.frames + LEAST)

    def fill_births(self, rows: np.ndarray, times: np.ndarray) -> None:
        """The table of births: rows (n,) of particles of all worlds, and when each comes (n,) [s]."""
        frame = np.floor(times * self.fps + 1e-9).astype(np.int64)
        order = np.lexsort((rows, times))
        first = np.searchsorted(frame[order], np.arange(max(self.frames, int(frame.max(initial=0))) + 2))
        age = times - frame / self.fps
        model, now = self.model, np.zeros(1, np.int32) if self.births is None else self.births.now.numpy()
        self.births = fill_struct(birth_table(model.real), row=model.upload(rows[order].astype(np.int32), int),
                                  frame=model.upload(frame[order].astype(np.int32), int),
                                  age=model.upload(age[order].astype(model.dtype), model.real),
                                  first=model.upload(first.astype(np.int32), int), now=model.upload(now, int),
                                  dt=model.real(1.0 / self.fps))
        self.threads = int(np.max(first[2:] - first[:-2], initial=int(first[1])))

    def make_kernels(self, laws: tuple[str, ...], grid: Any, corner: np.ndarray) -> None:
        """Kernels of what there is."""
        module = grid.module
        if self.shapes:
            self.by_birth = birth_kernels(laws, grid.waves, self.model.real, module)
        if self.sinks:
            self.table = ColliderTable(self.model, self.sinks, corner)
            self.take = sink_kernel(self.table.kinds, self.model.real, module)

    def pose(self, time: float, dt: float) -> None:
        """A frame begins at a time [s]."""
        if self.births is not None:
            self.births.now.fill_(round(time * self.fps))
        if self.table:
            self.table.pose(time, dt)

    # launches, of a grid (`wsim.physics.mpm.grid`)

    def launch_frame(self, grid: Any) -> None:
        """What comes in a frame bounds its first step."""
        if self.threads:
            grid.launch(self.by_birth.measure_births, self.threads,
                        [grid.points, grid.materials, self.births, grid.real(grid.dx), grid.pace])

    def launch_step(self, grid: Any) -> None:
        """Particles come and go where a step begins."""
        dx = grid.real(grid.dx)
        if self.threads:
            grid.launch(self.by_birth.wake_particles, self.threads,
                        [grid.points, grid.materials, self.births, dx, grid.clock, grid.pace])
        if self.table:
            grid.launch(self.take, grid.count, [grid.points, self.table.rows, dx, grid.clock])


def tally_flow(things: list[MaterialPoints], sinks: list[MaterialSink], there: list[np.ndarray],
               mass: list[np.ndarray]) -> dict[str, float]:
    """Counts and masses [kg] of a world: what is there, what has come, and what sinks have taken. there, mass: of each
    thing."""
    found = {"mpm_particles": 0.0, "mpm_mass": 0.0, "mpm_poured_particles": 0.0, "mpm_poured_mass": 0.0,
             "mpm_taken_particles": 0.0, "mpm_taken_mass": 0.0}
    for thing, now, m in zip(things, there, mass, strict=True):
        for name, chosen in (("", now == 1), ("poured_", (now >= 1) & (thing.pour is not None)), ("taken_", now >= 2)):
            found[f"mpm_{name}particles"] += float(np.count_nonzero(chosen))
            found[f"mpm_{name}mass"] += float(m[chosen].sum())
    return found if sinks else {k: v for k, v in found.items() if "taken" not in k}


def reserve_further_rows(method: Any, frame: int) -> None:
    """Rows of an MPM method for what comes in further frames, `frame` among them: behind those that there are."""
    flow, model, part = method.flow, method.model, method.part
    flow.extend(frame)
    planned = [(k, flow.plan(k)) for k in flow.shapes]
    new = PouredPoints(*(np.concatenate([getattr(each, name) for _, each in planned]) for name in ("x", "v", "volume", "t")))
    of = np.repeat([k for k, _ in planned], [len(each.t) for _, each in planned])
    first = np.cumsum([0, *(len(thing.materials) for thing in method.things)])[of]
    worlds, before, count = model.worlds, part.count, len(of)
    part.enlarge_part(before + worlds * count, model.real, model.device)
    part.count = part.capacity
    method.volume = _with(method.volume, new.volume)
    node, offset = nearest_nodes(new.x, method.corner, method.cell)
    mu_lam = np.array([method.materials[n].numbers()[:2] for n in first])
    start = {"o": offset, "v": new.v, "a": 2.0 * mu_lam[:, 0] + mu_lam[:, 1], "i": node[:, 0], "j": node[:, 1], "k": node[:, 2]}
    for name, values in start.items():
        now = part.arrays[name].numpy()
        now[before:] = np.concatenate([values] * worlds)
        part.arrays[name].assign(now)
    for k in flow.shapes:
        own = np.flatnonzero(of == k)
        for world in range(worlds):
            key = method.things[k].path, world
            part.rows[key] = np.concatenate([part.rows[key], before + world * count + own])
    method.thing_of, method.times = _with(method.thing_of, of), _with(method.times, new.t)
    method.material_of = _with(method.material_of, first)
    rows = (np.arange(worlds)[:, None] * len(method.materials) + first).ravel()
    method.grid.make_particle_room(part.count, method.grid.blocks)
    method._fill_points(_with(method.constants[0], rows), _with(method.constants[1], np.tile(new.volume, worlds)))
    method._fill_births()


def _with(before: np.ndarray, new: np.ndarray) -> np.ndarray:
    return np.concatenate([before, new])


def fit_restored_rows(method: Any, fields: dict[str, dict[str, np.ndarray]]) -> None:
    """Makes rows and fields of an earlier run, which may have planned for more or fewer frames, as many: those behind are what
    comes later, as at the start."""
    part, flow = method.part, method.flow
    pours = [method.things[k].path for k in flow.shapes]
    while any(len(fields.get(path, {}).get("there", ())) > len(part.rows[path, 0]) for path in pours):
        reserve_further_rows(method, flow.frames)
        method.moved = True
    for path in pours:
        own = fields.get(path, {})
        for field in part.kept:
            now = part.arrays[field.name].numpy()[part.rows[path, 0]]
            given = own.get(field.name)
            if given is not None and len(given) < len(now):
                own[field.name] = np.concatenate([given, now[len(given):]])
