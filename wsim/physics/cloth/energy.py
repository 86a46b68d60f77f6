"""Elastic energy of constraints, whichever method solves for them: float64 sums of 1/2 C alpha^-1 C; of hinges that of the
curvatures of triangles."""

import numpy as np
import warp as wp

from wsim.kernels.cloth.energy import statistics
from wsim.kernels.cloth.terms import batch_of
from wsim.kernels.math.real import types
from wsim.model import kernel_cache
from wsim.model.model import Model
from wsim.model.state import State
from wsim.physics.cloth.constraints import HARD, Constraints

LANES = 4096          # threads that sum


def energy(model: Model, rows: list[Constraints], state: State) -> float:
    """Energy [J] of the soft rows at x + e. Tables are uploaded anew each time; kernels compile when first asked for."""
    total, t = 0.0, types(model.real)
    for kind in sorted({r.kind for r in rows if r.kind not in HARD}):
        same = [r for r in rows if r.kind == kind]
        data = batch_of(kind, model.real)()
        ids = model.shared(np.concatenate([r.ids for r in same]).astype(np.int32))
        rest = np.concatenate([r.rest for r in same])
        alpha = np.concatenate([np.broadcast_to(r.alpha, (len(r.ids), *r.alpha.shape[1:])) for r in same])
        data.point = model.upload(ids, wp.types.vector(ids.shape[1], int))
        data.rest = model.upload(rest, t.mat22 if rest.ndim == 3 else t.scalar)
        data.alpha = model.upload(alpha, t.vec4 if alpha.ndim == 2 else t.scalar)
        if kind == "dihedral":
            from wsim.physics.cloth.curvature import Curvature
            total += Curvature(model, same).energy(data, data.rest, state.x, state.e, kernel_cache.report_module(model, kind))
            continue
        out = wp.zeros(min(LANES, len(ids)), dtype=wp.vec3d, device=model.device)
        kernel = statistics(kind, real=model.real, module=kernel_cache.report_module(model, kind))
        kernel_cache.ready(kernel, model)
        model.launch(kernel, out.size, [data, state.x, len(ids), state.e], [out])
        total += float(out.numpy()[:, 2].sum())
    return total
