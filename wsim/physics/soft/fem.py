"""Tetrahedra of soft bodies on the device, a table for each material model: what kernels/soft/fem.py and fem10.py read."""

from math import inf, sqrt
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from wsim.geometry.tetra import tets as meshes
from wsim.kernels.math.real import types
from wsim.kernels.soft import fem
from wsim.model import kernel_cache, state
from wsim.model.model import Model
from wsim.physics.soft.parts import parts_of

if TYPE_CHECKING:
    from wsim.physics.soft.plastic import PlasticFlow

LANES = 4096           # threads that sum the energy
PACKETS = "corotational", "neo_hookean"         # materials that packets of tets know


class Tetrahedra:
    """All tets of one material model with so many nodes, in the order of the bodies."""

    noun = "tets"

    def __init__(self, material: str, model: Model, nodes: int = 4):
        self.material, self.model, t = material, model, types(model.real)
        self.name, self.maths, points = _tet_kind(material, nodes)
        self.parts = [p for b in model.bodies if b.tets.shape[1] == nodes for p in parts_of(b, material)]
        self.ids = np.concatenate([p.body.tets[p.rows] for p in self.parts]).astype(np.int32)
        self.size = len(self.ids)
        systems = [model.system(p.body.number) for p in self.parts]
        sizes = np.bincount(systems, [len(p.rows) for p in self.parts], len(model.starts) - 1)
        self.first = model.upload(np.r_[0, np.cumsum(sizes)].astype(np.int32), int)
        self.most = int(sizes.max())
        self.ids = model.shared(self.ids)
        self.data = self.maths.elements(model.real)()
        self.data.point = model.upload(self.ids, wp.vec4i if nodes == 4 else int)
        edge, gradient, volume = self.shapes()
        self.data.edge, self.data.gradient = model.upload(edge, t.mat33), model.upload(gradient, t.mat33)
        self.data.volume = model.upload(volume, t.scalar)
        mu, lam, tau = self.moduli()
        self.data.mu, self.data.lam, self.data.tau = (model.upload(a, t.scalar) for a in (mu, lam, tau))
        self.damped = bool(tau.any())
        self.q = wp.zeros(points * self.size, dtype=t.quat, device=model.device)
        self.plastic: PlasticFlow | None = None
        self.packet = 0                   # tets that a thread takes, where it takes several
        self.flows = True                 # where forces are asked for; with Newton's method where a step ends
        self.kept: state.StatePart | None = None  # of the state: what outlives a frame
        if any(m.yield_strain < inf for p in self.parts for m in p.soft.materials):
            from wsim.physics.soft import plastic
            self.plastic = plastic.PlasticFlow(self)
            self.kept = self.plastic.kept

    def shapes(self) -> tuple[np.ndarray, ...]:
        """Edges [m], gradients [1/m] and volumes [m^3] at rest, where every body is as it was cut."""
        ids = [p.body.tets[p.rows, :4] - p.body.first for p in self.parts]
        edges = [p.body.rest[i[:, 1:]] - p.body.rest[i[:, :1]] for p, i in zip(self.parts, ids, strict=True)]
        return (np.concatenate(edges),
                np.concatenate([meshes.barycentric_gradients(p.body.rest, i)[:, 1:]
                                for p, i in zip(self.parts, ids, strict=True)]),
                np.concatenate([meshes.signed_tet_volumes(p.body.rest, i) for p, i in zip(self.parts, ids, strict=True)]))

    def reshape(self) -> None:
        """Uploads them anew."""
        edge, gradient, volume = (values.astype(self.model.dtype) for values in self.shapes())
        start = self.plastic.data if self.plastic else self.data
        start.edge.assign(edge)
        start.gradient.assign(gradient)
        self.data.volume.assign(volume)
        if self.plastic:
            self.plastic.shape()

    def moduli(self) -> tuple[np.ndarray, ...]:
        return tuple(np.concatenate(columns) for columns in zip(*(p.lame() for p in self.parts), strict=True))

    def place(self, force: int, block: int) -> None:
        """Places where the forces of corners and the blocks of pairs begin."""
        self.data.force, self.data.block = force, block

    def need_forces(self) -> None:
        """Makes the kernel that `forces` launches: of a CPU over packets of tets, see kernels/soft/packets.py."""
        maths, model = self.maths, self.model
        if not (model.device.is_cuda or model.gradients) and maths is fem and self.material in PACKETS:
            from wsim.kernels.soft import packets
            maths, self.packet = packets, packets.EIGHT
        self.pull = maths.forces(self.material, self.damped, real=model.real, module=model.module)

    def forces(self, x: wp.array, d: wp.array, v: wp.array, force: wp.array | None) -> None:
        """Launches the forces of corners at displacements d and velocities v, where tets have flowed."""
        if self.plastic and self.flows:
            self.plastic.flow(x, d)
        size = [self.size] if self.packet else []
        self.model.launch(self.pull, -(-self.size // (self.packet or 1)), [self.data, *size, x, d, v, self.q], [force, self.q])

    def kernels(self) -> list:
        """Kernels of Newton's method: `linearise` and `energy_change`."""
        return [f(self.material, self.damped, real=self.model.real, module=self.model.step_modules[0])
                for f in (self.maths.linearise, self.maths.energy_change)]

    def forget(self) -> None:
        """Rotations are sought anew: a frame depends on nothing that a restart, or a frame that is repeated, does not have."""
        if self.model.tape:
            self.model.tape.do(self.q.zero_)
        else:
            self.q.zero_()
        if self.plastic:
            self.plastic.shape()

    @staticmethod
    def indicators(tables: list["Tetrahedra"], state) -> dict[str, float]:
        """solid_strain: largest |E|, E = sym(R^T F) - 1; rms_solid_strain, over the volume; plastic_strain: largest
        |F_p - 1|; solid_energy [J], with that of a pressure, -p (V - V at rest)."""
        each = np.array([t.statistics(state) for t in tables])
        volume = sum(float(t.data.volume.numpy().astype(np.float64).sum()) for t in tables if t.parts)
        flowed = [t.plastic.strain() for t in tables if t.plastic]
        return {"solid_strain": float(each[:, 0].max()), **({"plastic_strain": max(flowed)} if flowed else {}),
                "rms_solid_strain": sqrt(float(each[:, 1].sum()) / volume),
                "solid_energy": float(each[:, 2].sum())}

    def statistics(self, state) -> np.ndarray:
        """Largest |E|, sum of |E|^2 V [m^3], energy [J] at x + e."""
        from wsim.physics.soft import stored
        if self.plastic:
            self.plastic.shape()
        if self.maths is fem and self.size <= stored.FEW and self.material in stored.ENERGY:
            x = state.x.numpy().astype(np.float64) + state.e.numpy()
            return stored.stored_statistics(self.material, self.data, x)
        out = wp.zeros(min(LANES, self.size), dtype=wp.vec3d, device=self.model.device)
        module = kernel_cache.report_module(self.model, self.maths.__name__, str(self.material))
        kernel = self.maths.statistics(self.material, real=self.model.real, module=module)
        kernel_cache.load_module_of_kernel(kernel, self.model)
        self.model.launch(kernel, out.size, [self.data, self.size, 1, state.x, state.e, self.q], [out])
        each = out.numpy()
        return np.array([each[:, 0].max(), each[:, 1].sum(), each[:, 2].sum()])

    def set_value(self, path: str, name: str, value, world: int | None = None) -> bool:
        """young [Pa], poisson, damping [s] of a soft body, one for all or one for each tet in the author's order; damping and
        yield_strain cannot begin where there were none. A rest shape is that of the bodies already."""
        hit = False
        if name == "rest_shape" and any(p.body.path == path for p in self.parts):
            self.reshape()
            return True
        if name == "yield_strain" and self.plastic:
            return self.plastic.set_value(path, float(value), world)
        for p in self.parts:
            if p.body.path == path and world in (None, p.body.world) and name in p.values:
                p.values[name] = np.broadcast_to(np.asarray(value, np.float64), len(p.body.tets))[p.rows]
                hit = True
        if hit:
            self.send()
        return hit

    def send(self) -> None:
        """Uploads the materials."""
        for array, values in zip((self.data.mu, self.data.lam, self.data.tau), self.moduli(), strict=True):
            array.assign(values.astype(self.model.dtype))


def tet_tables(model: Model) -> list:
    """A table for each material model that some soft body has, by name; of quadratic tets tables of their own; last
    that of pressure."""
    found = {(b.tets.shape[1], m.model) for b in model.bodies if b.source.is_solid for m in b.source.materials
             if parts_of(b, m.model)}
    tables: list = [Tetrahedra(name, model, nodes) for nodes, name in sorted(found)]
    if any(body.pressure for body in model.scene.bodies()):
        from wsim.physics.soft.pressure import SoftPressure
        tables.append(SoftPressure(model))
    return tables


def _tet_kind(material: str, nodes: int) -> tuple[str, Any, int]:
    """Name of a table, module of its kernels, points of a tet where those evaluate the material."""
    if nodes == 4:
        return material, fem, 1
    from wsim.kernels.soft import fem10
    return f"quadratic {material}", fem10, fem10.POINTS
