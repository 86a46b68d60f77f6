"""Wind on cloth: two launches a substep, after prediction. See kernels/cloth/air.py for the law."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from wsim.geometry import topology
from wsim.kernels.cloth import air as kernels
from wsim.kernels.math.real import types
from wsim.model.model import Model
from wsim.model.stage import ByWorld, Clock, Method, Methods, Ports, Stage
from wsim.model.state import SimulationState
from wsim.model.structs import fill_struct
from wsim.scene import Scene
from wsim.scene.methods import feels_air

if TYPE_CHECKING:
    from wsim.simulation.methods import Build



def why_air_acts(scene: Scene) -> str:
    """Reason why this method is needed, or ""."""
    return "a cloth has drag or lift" if feels_air(scene) else ""


def build(b: Build) -> Aero:
    taken = "aero" in (b.ports.fused_effects or ())
    return Aero(b.model, b.state, b.ports.points, taken, b.ports.half_step)


class Aero(Method):
    """Drag and lift on the triangles of every cloth that has some."""

    alike = True

    def __init__(self, model: Model, state: SimulationState, points, taken: bool = False, half_step=None):
        """points: the method that owns the tables of points and the anchor; taken: explicit steps know the air themselves, see
        kernels/motion/fused/sheet.py; half_step: offer of explicit steps, the arrays of `halves` in kernels/cloth/air.py."""
        super().__init__("aero", by_world=True)
        self.model, self.state, self.points, self.constants = model, state, points, points.constants
        real, module, t = model.real, model.module, types(model.real)
        cloths = [b for b in model.bodies if b.source.feels_air]
        triangles = model.shared(np.concatenate([b.triangles for b in cloths]))
        starts, items = topology.incident_rows(triangles, model.points)
        self.triangle = model.upload(triangles, wp.vec3i)
        self.corners = fill_struct(kernels.air_gather_functions(real)[0], first=model.upload(starts.astype(np.int32), int),
                                   item=model.upload(items.astype(np.int32), int))
        c, fields = self.constants, dict[str, wp.array]()
        shares = {"drag": model.scene.air_density / 6.0, "lift": model.scene.air_density / 6.0, "normal_drag": 1.0 / 3.0}
        each = [b.count if model.by_point else 1 for b in model.bodies]        # rows, as of points
        fields["wind"] = model.upload(np.tile(np.asarray(model.scene.wind, model.dtype), (sum(each), 1)), t.vec3)
        for name, share in shares.items():
            values = np.repeat([share * b.source.air[name] for b in model.bodies], each)
            fields[name] = model.upload(values, t.scalar)
        # of velocities where substeps end, and of predicted ones: explicit steps have all forces in those
        self.ended, self.air = (fill_struct(kernels.air_tables(real), object=c.object, gravity=c.gravity, w=c.w, fall=fall,
                                            **fields)
                                for fall in (0.0, float(points.integrator.g > 0.0)))
        self.force = wp.zeros(len(triangles), dtype=t.vec3, device=model.device)
        self.k = wp.zeros(len(triangles), dtype=t.scalar, device=model.device)
        self.taken, self.offers = taken, Ports(air=self.air, wind=self)
        if taken:
            self.stages = list[Stage]()
            return
        self.half_step = half_step if len(points.integrator.steps) == 2 else None
        if self.half_step:
            self.press_leap, self.blow_leap = (kernels.leapfrog_drag_kernel(real, module),
                                               kernels.leapfrog_air_kernel(real, module))
        self.press, self.blow = kernels.triangle_drag_kernel(real, module), kernels.air_displacement_kernel(real, module)
        size = np.dtype(model.dtype).itemsize
        self.stages = [Stage("wind", "predict", self.launch, 2, len(triangles) * (12 + 22 * size)
                             + model.points * 11 * size, what=f"{len(triangles)} triangles")]

    def connect_ports(self, others: Methods) -> None:
        if self.taken:
            others.ports.force_gather.domains.meet(self.air)

    def launch(self, clock: Clock) -> None:
        s, w, forces = self.state, self.constants.w, [self.force, self.k]
        if not self.half_step:
            g = clock.effective_step
            self.model.launch(self.press, self.k.size, [self.triangle, self.air, s.x, self.points.anchor, s.d, g], forces)
            self.model.launch(self.blow, self.model.points, [self.corners, *forces, w, s.d, g], [s.d])
            return
        (at, pair, change), first, h = self.half_step(), clock.k == 0, clock.h
        half = fill_struct(kernels.leapfrog_halves(self.model.real), x=s.x, v=s.v, pair=pair, change=change, at=at,
                           known=float(not first), h=h, kick=0.5 * h if first and clock.halved else h)
        self.model.launch(self.press_leap, self.k.size, [self.triangle, self.air, half], forces)
        self.model.launch(self.blow_leap, self.model.points, [self.corners, *forces, w, s.d, half], [s.d, pair])

    def set_value(self, path: str, name: str, value, world: int | None = None) -> bool:
        """wind [m/s] over one cloth or, with path "/", over all."""
        rows = self.model.rows(path, world)
        if name != "wind" or not rows:
            return False
        values = self.air.wind.numpy()
        values[rows] = value.rows(self.model, path) if isinstance(value, ByWorld) else value
        self.air.wind.assign(values)
        return True
