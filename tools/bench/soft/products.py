"""Products with the stiffness of corotational tets: assembled blocks beside matrix-free, and from how many on assembly pays.

    python tools/bench/soft/products.py [--tets 25000,200000,1000000] [--device cuda:0|cpu] [--precision float32]

assembled     kernels/soft/fem.py `linearise` and kernels/solver/newton.py `assemble`; a product is a pass over points and their
              blocks
sliced        the same blocks, those of 32 points next to each other interleaved, so that neighbouring threads read
              neighbouring numbers; a copy more to set up
matrix-free   `forces` and the twist T (kernels/soft/material.py); a product takes dP of each tet to its corners, then gathers

ms of setting up (both with the forces; the inverses of the diagonal, which the solver wants too, come with the assembled
ones only) and of a product, replayed from graphs; apart: largest difference of the products over the largest entry. A body
turned and strained by a few percent.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
import warp as wp

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))
from tools.bench.soft.substeps import cube  # noqa: E402
from tools.bench.speed import hardware, timed  # noqa: E402
from wsim import Simulation  # noqa: E402
from wsim.kernels.cloth import hessian  # noqa: E402
from wsim.kernels.cloth.constraint import DISTANCE  # noqa: E402
from wsim.kernels.math.real import types  # noqa: E402
from wsim.kernels.soft import fem, material  # noqa: E402
from wsim.kernels.solver import newton, pcg  # noqa: E402
from wsim.physics.solver import coarse_space  # noqa: E402

SLICE = 32             # points whose blocks are interleaved: a warp
MODULE = "wsim_bench_product"


def assembled(real):
    """Kernel over points: y = A z by the assembled blocks."""
    t, s, product = types(real), newton.structs(real), pcg.parts(real, False, True).product

    @wp.kernel(module=MODULE, enable_backward=False)
    def assembled(rows: s.Rows, A: s.Matrix, z: wp.array(dtype=t.vec3), y_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        y_out[i] = product(i, rows, A, z)

    return assembled


def sliced(real):
    """Kernels over points: copy of the blocks, and y = A z. first (slices + 1,): columns of each slice; number k of column e of
    lane l stands at 9 SLICE e + SLICE k + l, its point at SLICE e + l."""
    t, s = types(real), newton.structs(real)

    @wp.kernel(module=MODULE, enable_backward=False)
    def copy(rows: s.Rows, A: s.Matrix, first: wp.array(dtype=int), value_out: wp.array(dtype=real),
             column_out: wp.array(dtype=int)):
        i = wp.tid()
        lane = i % wp.static(SLICE)
        begin = first[i // wp.static(SLICE)]
        for n in range(first[i // wp.static(SLICE) + 1] - begin):
            e = rows.pair[i] + n
            column_out[wp.static(SLICE) * (begin + n) + lane] = i
            if e < rows.pair[i + 1]:
                column_out[wp.static(SLICE) * (begin + n) + lane] = rows.column[e]
                for k in range(9):
                    value_out[wp.static(9 * SLICE) * (begin + n) + wp.static(SLICE) * k + lane] = A.block[e][k // 3, k % 3]

    @wp.kernel(module=MODULE, enable_backward=False)
    def product(rows: s.Rows, A: s.Matrix, first: wp.array(dtype=int), value: wp.array(dtype=real),
                column: wp.array(dtype=int), z: wp.array(dtype=t.vec3), y_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        lane = i % wp.static(SLICE)
        zi = z[i]
        y = A.own[i] * zi
        for n in range(first[i // wp.static(SLICE)], first[i // wp.static(SLICE) + 1]):
            d = z[column[wp.static(SLICE) * n + lane]] - zi
            at = wp.static(9 * SLICE) * n + lane
            M = t.mat33()
            for k in range(9):
                M[k // 3, k % 3] = value[at + wp.static(SLICE) * k]
            y += M * d
        if rows.w[i] == real(0.0):
            y = t.vec3()
        y_out[i] = y

    return copy, product


def free(real):
    """Kernels: twists of tets, forces of their corners under z, and their sums over points with what inertia adds."""
    t, s, Tets = types(real), newton.structs(real), fem.elements(real)
    gradient, change = fem.displaced(real, real)
    vec3, quat, sym = wp.array(dtype=t.vec3), wp.array(dtype=t.quat), wp.types.vector(6, real)

    @wp.kernel(module=MODULE, enable_backward=False)
    def twist(tets: Tets, x: vec3, d: vec3, q: quat, T_out: wp.array(dtype=sym)):
        c = wp.tid()
        T = material.twist(gradient(tets, c, x, d), q[c], tets.mu[c], tets.lam[c], real(0.0))
        T_out[c] = sym(T[0, 0], T[1, 1], T[2, 2], T[1, 2], T[2, 0], T[0, 1])

    @wp.kernel(module=MODULE, enable_backward=False)
    def forces(tets: Tets, q: quat, T: wp.array(dtype=sym), z: vec3, f_out: vec3):
        c = wp.tid()
        v = T[c]
        M = t.mat33(v[0], v[5], v[4], v[5], v[1], v[3], v[4], v[3], v[2])
        P = material.corotational_response(q[c], M, change(tets, c, z), tets.mu[c], tets.lam[c])
        fem.spread(tets.force + 4 * c, tets.volume[c] * P, tets.gradient[c], f_out)

    @wp.kernel(module=MODULE, enable_backward=False)
    def gather(rows: s.Rows, own: wp.array(dtype=real), f: vec3, z: vec3, y_out: vec3):
        i = wp.tid()
        y = t.vec3()
        if rows.w[i] > real(0.0):
            y = own[i] * z[i]
            for e in range(rows.corner[i], rows.corner[i + 1]):
                y += f[rows.pull[e]]
        y_out[i] = y

    return twist, forces, gather


def strained(cells: int, device: str, precision: str) -> Simulation:
    """A cube turned by one radian and strained, its rotations found."""
    sim = Simulation(cube(cells, "corotational", 1, 1, "backward_euler"), device=device, precision=precision)
    sim.step()
    x = sim.state.x.numpy().astype(np.float64)
    c, s = np.cos(1.0), np.sin(1.0)
    turned = x @ (np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]]) + 0.02 * np.random.default_rng(1).normal(size=(3, 3)))
    sim.state.d.assign((turned - x).astype(sim.model.dtype))
    return sim


def measure(cells: int, device: str, precision: str) -> dict[str, tuple[float, float, float]]:
    """(ms to set up, ms a product, largest relative difference) of each way."""
    sim = strained(cells, device, precision)
    m, model, s = sim.plan.ports.newton_assembly, sim.model, sim.state
    real, n, table, rate = model.real, model.points, m.solids[0], 1.0 / sim.plan.clock.g
    t, launch, on = types(real), model.launch, wp.get_device(device)
    z = model.upload(np.random.default_rng(2).normal(size=(n, 3)) * (m.rows.w.numpy() > 0.0)[:, None], t.vec3)
    y = {name: wp.zeros(n, dtype=t.vec3, device=on) for name in ("assembled", "sliced", "matrix-free")}
    product, (copy, sell), (twist, push, gather) = assembled(real), sliced(real), free(real)
    lengths = np.diff(m.rows.pair.numpy())
    each = np.maximum.reduceat(lengths, np.arange(0, n, SLICE))
    first = model.upload(np.r_[0, np.cumsum(each)].astype(np.int32), int)
    value = wp.zeros(int(each.sum()) * SLICE * 9, dtype=real, device=on)
    column = wp.zeros(int(each.sum()) * SLICE, dtype=int, device=on)
    pulls = fem.forces("corotational", table.damped, real=real, module=MODULE)
    f, T = wp.zeros(4 * table.size, dtype=t.vec3, device=on), wp.zeros(table.size, dtype=wp.types.vector(6, real), device=on)
    springs = hessian.batch_of(DISTANCE, real)()

    def assemble():
        a = m.points.anchor
        launch(m.stressed[table.name][0], table.size, [table.data, s.x, s.d, a, table.q, rate], [table.q, m.element])
        if m.apart:
            launch(m.gather, newton.LANES * n, [m.rows, m.element], [m.A])
        launch(m.assemble, n, [m.rows, springs, m.element, m.points.at(d=s.d, a=a), m.b, rate], [m.f, m.A])

    def prepare():
        launch(pulls, table.size, [table.data, s.x, s.d, s.d, table.q], [f, table.q])
        launch(twist, table.size, [table.data, s.x, s.d, table.q], [T])

    def apply():
        launch(push, table.size, [table.data, table.q, T, z], [f])
        launch(gather, n, [m.rows, m.A.own, f, z], [y["matrix-free"]])

    def slices():
        assemble()
        launch(copy, n, [m.rows, m.A, first], [value, column])
    ways = {"assembled": (assemble, lambda: launch(product, n, [m.rows, m.A, z], [y["assembled"]])),
            "sliced": (slices, lambda: launch(sell, n, [m.rows, m.A, first, value, column, z], [y["sliced"]])),
            "matrix-free": (prepare, apply)}
    inner, found = (10 if on.is_cuda else 1), {}
    for name, (setup, once) in ways.items():
        found[name] = [1e3 * timed(setup, on, 5, inner), 1e3 * timed(once, on, 5, inner)]
    right = y["assembled"].numpy().astype(np.float64)
    return {name: (*ms, float(np.abs(y[name].numpy() - right).max() / np.abs(right).max())) for name, ms in found.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default=None)
    parser.add_argument("--tets", default="25000,200000,1000000")
    parser.add_argument("--precision", default="float32", choices=("float32", "float64"))
    args = parser.parse_args()
    wp.config.quiet = True
    coarse_space.PAYS |= dict.fromkeys(coarse_space.PAYS, ((0, np.inf),))   # nothing of it is needed here
    device = str(wp.get_device(args.device))
    print(hardware(wp.get_device(device)))
    print(f"{'tets':>8}  {'':<13}{'setup ms':>10}{'product ms':>12}{'apart':>10}")
    for cells in (max(1, round((int(tets) / 5.0)**(1.0 / 3.0))) for tets in args.tets.split(",")):
        found = measure(cells, device, args.precision)
        for name, (setup, product, apart) in found.items():
            print(f"{5 * cells**3:>8}  {name:<13}{setup:>10.4f}{product:>12.4f}{apart:>10.1e}")
        for name in ("assembled", "sliced"):
            more, less = found[name][0] - found["matrix-free"][0], found["matrix-free"][1] - found[name][1]
            says = f"pays from {max(more / less, 0.0):.1f} products on" if less > 0.0 else "never pays"
            print(f"{'':>10}{name} {says}", flush=True)


if __name__ == "__main__":
    main()
