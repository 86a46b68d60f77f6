"""Conjugate gradients with a multilevel Schwarz preconditioner, for sheets and bodies that a step makes stiff: tables and
launches. Kernels: kernels/solver/schwarz/.

It pays where block Jacobi would take many iterations: about 5 kappa of them to 1e-2, kappa the points that a sound wave passes
in a step (`wsim.physics.solver.coarse_space`).
"""

from dataclasses import fields

import numpy as np
import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.solver.schwarz import cg, domains, residual, setup
from wsim.kernels.solver.schwarz.dense import SIDE
from wsim.model.model import Model, PointBody
from wsim.physics.solver.schwarz import tree as trees

# (points of a body from which on, least kappa). CPU, a shirt of 6436 points, a solve to 1e-2 with its matrices, beside block
# Jacobi: kappa 10: 21 iterations for 71, 135 ms for 84; 41: 50 for 221, 224 for 330; 163: 106 for 494, 433 for 800
# H100, the same: an iteration 60 us, as one of block Jacobi, and 1.2 ms for the matrices; kappa 41: 18 iterations for 38, 2.3
# ms for 2.5 with the matrices, to 1e-6 123 for 569 and 8.6 ms for 36. Bodies of 2000 points and less are iterated by a cluster
# of blocks (kernels/motion/fused/conjugate.py), 2.5 us an iteration
PAYS = {"cuda": (3000, 50.0), "cpu": (2000, 30.0)}
VECTORS = {"pair": wp.vec2i, "entry": wp.vec2i, "block": wp.vec3i, "about": wp.vec2i, "node": wp.vec4i, "above": wp.vec3i,
           "run": wp.vec3i, "joined": wp.vec3i}


def wants_schwarz(model: Model, h: float) -> tuple[bool, str]:
    """True if a step of h [s] makes a sheet stiff and large enough, and what the plan says of it."""
    least = PAYS["cuda" if model.device.is_cuda else "cpu"]
    found = max(((stretch_wave_edges(b, h), b.count) for b in model.bodies if b.source.is_sheet),
                default=(0.0, 0))
    if not found[1]:
        return False, ""
    pays = found[1] >= least[0] and found[0] >= least[1]
    words = f"a wave passes {found[0]:.3g} points a step"
    if pays:
        return True, f"; additive Schwarz with affine coarse spaces, since {words}"
    return False, f"; block Jacobi, since {words}, under {least[1]:g}" if found[1] >= least[0] else ""


def stretch_wave_edges(body: PointBody, h: float) -> float:
    """kappa of a sheet: edges that a wave of stretch passes in h [s], at most all there are."""
    p = body.rest[body.edges - body.first]
    edge = float(np.linalg.norm(p[:, 1] - p[:, 0], axis=1).mean())
    stiff = float(body.source.material_number("stretch"))
    area = np.linalg.norm(np.cross(*(body.rest[body.triangles[:, k] - body.first] - body.rest[body.triangles[:, 0] - body.first]
                                     for k in (1, 2))), axis=1).sum() / 2.0
    return min(h * (stiff * float(area) / float(body.masses.sum()))**0.5, float(np.ptp(body.rest, axis=0).max())) / edge


class Schwarz:
    """Tables and launches of one set of systems."""

    def __init__(self, model: Model, first: np.ndarray, column: np.ndarray):
        """first, column: blocks first[i] .. first[i + 1] of point i, each with its other point."""
        self.model = model
        places = np.concatenate([b.places + b.origin for b in model.bodies])
        self.tree = tree = trees.build_domain_tree(places, model.starts, first, column)
        o, real = setup.schwarz_tables(model.real), model.real
        self.table, self.blocks, self.work = o.Tree(), o.Blocks(), domains.schwarz_works(real)()
        for f in fields(tree):
            value = getattr(tree, f.name)
            if f.name == "levels":
                self.table.levels = value
            else:
                dtype = VECTORS.get(f.name, int)
                setattr(self.table, f.name, model.upload(value.reshape(-1, value.shape[-1]).astype(np.int32)
                                                         if dtype is not int else value.astype(np.int32), dtype))
        self.allocate(o)
        cuda = model.device.is_cuda
        self.module = f"{model.module}_schwarz" if cuda else f"wsim_schwarz_{types(real).name}"     # as `Model.step`
        model.modules[self.module] = cg.THREADS if cuda else 1
        self.filters, self.pairs, self.merge, self.sums, self.points = (f(real, self.module) for f in (
            setup.schwarz_filter_kernel, setup.leaf_pair_kernel, setup.node_block_kernel, setup.block_run_sum_kernel,
            setup.point_domain_kernel))
        self.factor, self.cg = (setup.domain_factor_kernel(real, self.module, cg.THREADS),
                                cg.schwarz_cg_kernel(real, self.module))
        self.measure = residual.schwarz_residual_kernel(real, self.module)

    def allocate(self, o) -> None:
        model, tree, m, k = self.model, self.tree, self.blocks, self.work
        t, real, groups = types(model.real), model.real, tree.groups

        def schwarz_zeros(count: int, dtype):
            return wp.zeros(count, dtype=dtype, device=model.device)
        m.W, m.scratch = schwarz_zeros(SIDE * SIDE * tree.matrices, real), schwarz_zeros(SIDE * tree.matrices, real)
        m.pair = schwarz_zeros(setup.TWELVE * len(tree.pair), o.vec12)
        m.run = schwarz_zeros(setup.TWELVE * int(tree.into.max(initial=-1) + 1), o.vec12)
        m.S, m.X = schwarz_zeros(model.points, t.mat33), schwarz_zeros(model.points, t.vec3)
        for name in ("into", "mid", "out"):
            setattr(k, name, schwarz_zeros(3 * SIDE * groups, real))
        k.moment, k.motion = schwarz_zeros(setup.TWELVE * groups, real), schwarz_zeros(SIDE * groups, real)
        k.upper, k.between = schwarz_zeros(SIDE * len(tree.node), real), schwarz_zeros(SIDE * len(tree.node), real)
        k.gamma, k.delta = schwarz_zeros(groups, wp.float64), schwarz_zeros(groups, wp.float64)
        k.systems, k.leaves = len(model.starts) - 1, setup.NODES * groups
        blocks = model.device.sm_count if model.device.is_cuda else 1
        most = int(np.diff(tree.group).max())
        teams = min(k.systems, blocks) if model.device.is_cuda else k.systems
        k.size = max(1, min(most, blocks // teams))
        k.gate = schwarz_zeros(teams, int)

    def launch(self, kernel, dim: int, inputs: list, outputs: list) -> None:
        if dim:
            wp.launch(kernel, dim, inputs, outputs, device=self.model.device,
                      block_dim=cg.THREADS if self.model.device.is_cuda else 256)

    def setup(self, rows, A, x: wp.array, d: wp.array) -> None:
        """Launches the filters and the matrices of all domains at displacements d."""
        tree, threads = self.tree, cg.THREADS if self.model.device.is_cuda else 1
        self.launch(self.filters, self.model.points, [A, x, d], [self.blocks])
        self.blocks.W.zero_()
        self.launch(self.pairs, 3 * len(tree.pair), [rows, A, self.table, self.blocks], [])
        self.launch(self.merge, setup.TWELVE * len(tree.run), [self.table, self.blocks], [])
        self.launch(self.sums, setup.TWELVE * len(tree.joined), [self.table, self.blocks], [])
        self.launch(self.points, self.model.points, [rows, A, self.table, self.blocks], [])
        self.launch(self.factor, tree.matrices * threads, [self.table, self.blocks], [])

    def solve(self, rows, A, f: wp.array, tolerance: float, cap: int, v, drop: wp.array, count: wp.array) -> None:
        """Launches conjugate gradients."""
        threads = cg.THREADS if self.model.device.is_cuda else 1
        k = self.work
        k.tolerance, k.cap, k.drop, k.count = tolerance, cap, drop, count
        k.gate.zero_()
        self.launch(self.cg, k.gate.size * k.size * threads, [rows, A, f, self.table, self.blocks, v], [k])

    def left(self, own, f: wp.array, out: wp.array) -> None:
        """Launches what is left of forces f of an `Assembly`, in the norm of energy, into out (systems,)."""
        s, v = own.system, own.v
        self.setup(own.rows, own.A, own.state.x, own.state.d)
        self.solve(own.rows, own.A, f, 1.0, 0, v, s.drop, s.count)
        threads = cg.THREADS if self.model.device.is_cuda else 1
        self.launch(self.measure, s.systems * threads, [own.points.constants, own.A, s.first, self.table.group, self.work.gamma,
                                                        own.state.d, own.b], [out])
