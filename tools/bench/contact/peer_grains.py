"""Grains of wsim and particles of Newton's SolverXPBD in the same collapse of a column, one behind the other in one process.

    PYTHONPATH=.:FOLDER_OF_NEWTON python -m tools.bench.contact.peer_grains GRAINS SECONDS ROW [ROW ...] [--device cuda:0|cpu]
    ROW     wsim:SUBSTEPSxITERATIONS or newton:SUBSTEPSxITERATIONS:RELAXATION

FOLDER_OF_NEWTON: `pip install --no-deps --target FOLDER newton==1.8.0`. A column twice as high as wide, grains of 8 mm and
2600 kg/m^3, friction 0.5 of all contacts, frames of 1/60 s. Both sides begin with the same places. Newton's particles take
Coulomb friction by the overlap of the iteration (`solve_particle_particle_contacts`) and add the pushes of all contacts times
soft_contact_relaxation (0.9 by default), without an average; a GPU replays its frames as a graph.

Columns: time of a frame (CPU time, or wall time on a GPU; the first frame is left out); overlap of pairs that touch over 8 mm,
worst hundredth in the collapse and at the end, and the mean at the end; height of the centre of mass, over that at the start;
slope of the surface; speed left, root of the mean square and greatest; the way of the centre and the mean way of a grain in
the last second.
"""

import argparse
import time
from collections.abc import Callable

import numpy as np
import warp as wp

import wsim
from wsim.physics.position_based.objects import Grains

RADIUS, DENSITY, MU, FPS = 0.004, 2600.0, 0.5, 60
RELAXED = 0.9          # Newton's default


def column(grains: int) -> np.ndarray:
    """Places (about `grains`, 3) [m]: layers of 1.6 radii, columns of 2.3, moved by a tenth of a radius at random."""
    R = (grains * 2.3 * 1.6 * 2.3 / (4.0 * np.pi)) ** (1.0 / 3.0) * RADIUS
    across, up = int(R / (2.3 * RADIUS)) + 2, int(4.0 * R / (1.6 * RADIUS)) + 1
    side = np.arange(-across, across + 1)
    i = np.stack(np.meshgrid(side, np.arange(up), side, indexing="ij"), -1).reshape(-1, 3).astype(float)
    i[:, [0, 2]] += 0.5 * (i[:, 1:2] % 2)
    x = i * [2.3 * RADIUS, 1.6 * RADIUS, 2.3 * RADIUS] + [0.0, 1.2 * RADIUS, 0.0]
    x = x[np.hypot(x[:, 0], x[:, 2]) < R]
    return x + 0.1 * RADIUS * np.random.default_rng(0).uniform(-1, 1, x.shape)


Side = tuple[Callable[[], None], Callable[[], np.ndarray], Callable[[], np.ndarray]]         # step, positions, velocities


def wsim_side(x: np.ndarray, substeps: int, iterations: int, device: str) -> Side:
    """wsim's grains."""
    scene = wsim.Scene(fps=FPS, substeps=substeps, iterations=iterations)
    scene.collider("/floor", wsim.Plane(), static_friction=MU, dynamic_friction=MU)
    scene.particles("/grains", points=x, radius=RADIUS, material=Grains(rolling_friction=np.inf))     # as Newton's are
    simulation = wsim.Simulation(scene, device=device)
    return lambda: simulation.run(1), simulation.positions, simulation.velocities


def newton_side(x: np.ndarray, substeps: int, iterations: int, relaxation: float, device: str) -> Side:
    """Newton's particles on its ground plane."""
    import newton
    n, mass = len(x), DENSITY * 4.0 / 3.0 * np.pi * RADIUS**3
    builder = newton.ModelBuilder(up_axis=newton.Axis.Y, gravity=wp.vec3(0.0, -9.81, 0.0))
    builder.add_particles(pos=x.tolist(), vel=np.zeros((n, 3)).tolist(), mass=[mass] * n, radius=[RADIUS] * n)
    builder.add_ground_plane()
    model = builder.finalize(device=device)
    model.particle_mu = model.soft_contact_mu = MU
    model.shape_material_mu.fill_(MU)
    solver = newton.solvers.SolverXPBD(model, iterations=iterations, soft_contact_relaxation=relaxation)
    states, contacts, h = [model.state(), model.state()], model.contacts(), 1.0 / (FPS * substeps)
    if substeps % 2:
        raise SystemExit(f"newton:{substeps}: substeps are odd; allowed are even ones; fix: give {substeps + 1}")
    graph = None

    def frame() -> None:
        for _ in range(substeps):
            states[0].clear_forces()
            model.collide(states[0], contacts)
            solver.step(states[0], states[1], None, contacts, h)
            states.reverse()

    def step() -> None:
        nonlocal graph
        if not wp.get_device(device).is_cuda:
            return frame()
        if graph is None:
            frame()
            with wp.ScopedCapture(device=device) as capture:
                frame()
            graph = capture.graph
            return None
        return wp.capture_launch(graph)
    return step, lambda: states[0].particle_q.numpy(), lambda: states[0].particle_qd.numpy()


def overlaps(x: np.ndarray) -> np.ndarray:
    """Overlap of each pair that touches, over the distance of its centres at rest [1]."""
    from scipy.spatial import cKDTree
    i, j = cKDTree(x).query_pairs(2.0 * RADIUS, output_type="ndarray").T
    return 1.0 - np.linalg.norm(x[i] - x[j], axis=1) / (2.0 * RADIUS) if len(i) else np.zeros(1)


def slope(x: np.ndarray) -> float:
    """Slope [1] of the surface between 15 % and 85 % of the height, by the highest tenth of each ring of a diameter."""
    out = np.hypot(x[:, 0], x[:, 2])
    rings = (out / (2.0 * RADIUS)).astype(int)
    crest = [(2.0 * RADIUS * (k + 0.5), np.quantile(x[rings == k, 1], 0.95)) for k in range(rings.max() + 1)
             if (rings == k).sum() > 3]
    c, y = np.array(crest).T
    kept = (y < 0.85 * y.max()) & (y > 0.15 * y.max()) & (c > c[np.argmax(y)])
    return float(-np.polyfit(c[kept], y[kept], 1)[0]) if kept.sum() > 2 else float("nan")


def run_row(name: str, side: Side, x: np.ndarray, frames: int, on_gpu: bool) -> None:
    """Runs and prints one row."""
    step, positions, velocities = side
    clock, times, worst, last = time.perf_counter if on_gpu else time.process_time, [], 0.0, x
    for f in range(1, frames + 1):
        start = clock()
        step()
        wp.synchronize()
        times.append(1e3 * (clock() - start))
        if f == frames - FPS:
            last = positions().astype(float)
        if f % 10 == 0:
            worst = max(worst, float(np.quantile(overlaps(positions().astype(float)), 0.99)))
    y, v = positions().astype(float), np.linalg.norm(velocities(), axis=1)
    o, way = overlaps(y), np.linalg.norm(y - last, axis=1)
    print(f"| {name} | {np.median(times[2:]):.1f} | {worst:.3f} | {np.quantile(o, 0.99):.4f} | {o.mean():.4f} | "
          f"{y[:, 1].mean() / x[:, 1].mean():.3f} | {slope(y):.2f} | {np.sqrt((v**2).mean()):.1e}, {v.max():.1e} | "
          f"{last[:, 1].mean() - y[:, 1].mean():.1e}, {way.mean():.1e} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("grains", type=int)
    parser.add_argument("seconds", type=float)
    parser.add_argument("rows", nargs="+")
    parser.add_argument("--device", default="cpu")
    args = parser.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    x = column(args.grains)
    print(f"{len(x)} grains, {args.seconds:g} s, {wp.get_device(args.device).name}")
    print("| row | ms a frame | worst overlap | at the end | mean | height | slope | speed left [m/s] | sinks, moves [m/s] |")
    print("|---|---|---|---|---|---|---|---|---|")
    for row in args.rows:
        name, counts, *relaxation = row.split(":")
        sub, it = map(int, counts.split("x"))
        side = (wsim_side(x, sub, it, args.device) if name == "wsim" else
                newton_side(x, sub, it, float(relaxation[0]) if relaxation else RELAXED, args.device))
        run_row(row, side, x, round(args.seconds * FPS), args.device != "cpu")


if __name__ == "__main__":
    main()
