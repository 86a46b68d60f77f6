"""Elements on the device, a table for each kind: constraints of cloths and nets, tets of soft bodies by material model."""

from dataclasses import dataclass, field
from math import sqrt

import numpy as np
import warp as wp

from wsim.cloth import Rows
from wsim.kernels import fem, tangent
from wsim.kernels.material import lame
from wsim.kernels.real import types
from wsim.model import Body, Model, soft_share
from wsim.scene import Soft
from wsim.tetra import tets as meshes

LANES = 4096           # threads that sum the energy


class Table:
    """All constraints of one kind, on the device, in the order of the bodies."""

    def __init__(self, kind: str, rows: list[Rows], model: Model):
        self.kind, self.rows, self.model, self.stale = kind, rows, model, False
        self.ids = np.concatenate([r.ids for r in rows]).astype(np.int32)
        self.size = len(self.ids)
        sizes = np.bincount([r.body.number for r in rows if r.body is not None], [len(r.ids) for r in rows], len(model.bodies))
        self.first = model.upload(np.r_[0, np.cumsum(sizes)].astype(np.int32), int)
        self.most = int(sizes.max())
        t = types(model.real)
        self.data = tangent.batch_of(kind, model.real)()
        self.data.point = model.upload(self.ids, wp.types.vector(self.ids.shape[1], int))
        rest = np.concatenate([r.rest for r in rows])
        self.data.rest = model.upload(rest, t.mat22 if rest.ndim == 3 else t.scalar)
        alpha, tau = self.values()
        self.data.alpha = model.upload(alpha, t.vec3 if alpha.ndim == 2 else t.scalar)
        self.data.tau = model.upload(tau, t.scalar)

    def values(self) -> tuple[np.ndarray, np.ndarray]:
        """Compliance and relaxation time [s] of each constraint."""
        return (np.concatenate([np.broadcast_to(r.alpha, (len(r.ids), *r.alpha.shape[1:])) for r in self.rows]),
                np.concatenate([np.full(len(r.ids), r.tau) for r in self.rows]))

    def refresh(self) -> None:
        """Uploads the rows' compliances and relaxation times anew, into the same arrays."""
        if self.stale:
            alpha, tau = self.values()
            self.data.alpha.assign(alpha.astype(self.model.dtype))
            self.data.tau.assign(tau.astype(self.model.dtype))
            self.stale = False


@dataclass
class Part:
    """Tets of one material model in one body."""

    body: Body
    rows: np.ndarray              # of `Body.tets`, in the order of memory
    material: np.ndarray          # number of each in `Soft.materials`, (t,)
    values: dict = field(default_factory=dict)       # live: {name: (t,)} of young, poisson, damping

    def lame(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """mu, lam [Pa] times the part of a tet that is body, and tau [s], each (t,)."""
        young, poisson = self.values["young"], self.values["poisson"]
        pairs, which = np.unique(np.stack([young, poisson]), axis=1, return_inverse=True)
        found = np.array([lame(float(E), float(nu)) for E, nu in pairs.T])[which.reshape(-1)]
        share = np.broadcast_to(soft_share(self.soft), len(self.body.tets))[self.rows]
        return found[:, 0] * share, found[:, 1] * share, self.values["damping"]

    @property
    def soft(self) -> Soft:
        assert isinstance(self.body.source, Soft)
        return self.body.source


def parts_of(body: Body, model: str) -> list[Part]:
    """The tets of a body that are of that model; none for what is no soft body."""
    if not isinstance(body.source, Soft):
        return []
    soft = body.source
    which = np.zeros(len(body.tets), np.int32) if soft.which is None else soft.which
    mine = np.array([m.model == model for m in soft.materials])[which]
    rows = np.flatnonzero(mine)
    rows = rows[np.argsort(body.tets[rows].min(axis=1), kind="stable")]
    if not len(rows):
        return []
    part = Part(body, rows, which[rows])
    for name in ("young", "poisson", "damping"):
        part.values[name] = np.array([getattr(m, name) for m in soft.materials])[part.material]
    return [part]


class Tetrahedra:
    """All tets of one material model, in the order of the bodies."""

    def __init__(self, name: str, model: Model):
        self.name, self.model, t = name, model, types(model.real)
        self.parts = [p for b in model.bodies for p in parts_of(b, name)]
        self.ids = np.concatenate([p.body.tets[p.rows] for p in self.parts]).astype(np.int32)
        self.size = len(self.ids)
        sizes = np.bincount([p.body.number for p in self.parts], [len(p.rows) for p in self.parts], len(model.bodies))
        self.first = model.upload(np.r_[0, np.cumsum(sizes)].astype(np.int32), int)
        self.most = int(sizes.max())
        rest = np.zeros((model.points, 3))
        for b in model.bodies:
            rest[b.first:b.last] = b.rest
        corners = rest[self.ids]
        self.data = fem.elements(model.real)()
        self.data.point = model.upload(self.ids, wp.vec4i)
        self.data.edge = model.upload(corners[:, 1:] - corners[:, :1], t.mat33)
        self.data.gradient = model.upload(meshes.gradients(rest, self.ids)[:, 1:], t.mat33)
        self.data.volume = model.upload(meshes.volumes(rest, self.ids), t.scalar)
        mu, lam, tau = self.moduli()
        self.data.mu, self.data.lam, self.data.tau = (model.upload(a, t.scalar) for a in (mu, lam, tau))
        self.damped = bool(tau.any())
        self.q = wp.zeros(self.size, dtype=t.quat, device=model.device)

    def moduli(self) -> tuple[np.ndarray, ...]:
        return tuple(np.concatenate(columns) for columns in zip(*(p.lame() for p in self.parts), strict=True))

    def place(self, force: int, block: int) -> None:
        """Where the forces of corners and the blocks of pairs begin."""
        self.data.force, self.data.block = force, block

    def statistics(self, state) -> np.ndarray:
        """Largest |E|, sum of |E|^2 V [m^3], energy [J] at x + e."""
        out = wp.zeros(min(LANES, self.size), dtype=wp.vec3d, device=self.model.device)
        kernel = fem.statistics(self.name, real=self.model.real, module=f"{self.model.module}_report")
        self.model.launch(kernel, out.size, [self.data, self.size, state.x, state.e, self.q], [out])
        each = out.numpy()
        return np.array([each[:, 0].max(), each[:, 1].sum(), each[:, 2].sum()])

    def set(self, path: str, name: str, value, world: int | None = None) -> bool:
        """young [Pa], poisson, damping [s] of a soft body; damping cannot begin where there was none."""
        hit = False
        for p in self.parts:
            if p.body.path == path and world in (None, p.body.world) and name in p.values:
                p.values[name] = np.full(len(p.rows), float(value))
                hit = True
        if hit:
            for array, values in zip((self.data.mu, self.data.lam, self.data.tau), self.moduli(), strict=True):
                array.assign(values.astype(self.model.dtype))
        return hit


def tables_of(model: Model) -> list[Tetrahedra]:
    """A table for each material model that some soft body has, by name."""
    names = {m.model for b in model.bodies if isinstance(b.source, Soft) for m in b.source.materials}
    return [Tetrahedra(name, model) for name in sorted(names) if any(parts_of(b, name) for b in model.bodies)]


def indicators(tables: list[Tetrahedra], state) -> dict[str, float]:
    """solid_strain: largest |E|, E = sym(R^T F) - 1; rms_solid_strain, over the volume; solid_energy [J]."""
    if not tables:
        return {}
    each = np.array([t.statistics(state) for t in tables])
    volume = sum(float(t.data.volume.numpy().astype(np.float64).sum()) for t in tables)
    return {"solid_strain": float(each[:, 0].max()), "rms_solid_strain": sqrt(float(each[:, 1].sum()) / volume),
            "solid_energy": float(each[:, 2].sum())}
