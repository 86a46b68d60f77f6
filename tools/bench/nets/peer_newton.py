"""Newton's solvers on a net of springs or a sheet of triangles: positions and velocities at given frames, time of a frame.

    PEER_PYTHON tools/bench/nets/peer_newton.py PROBLEM.npz SETTINGS.json OUT_FOLDER [--device cuda:0|cpu]

Run by peers.py and membrane_peers.py with the interpreter of an environment of Newton's own (peers.py says how to make it):
this file imports newton, warp and numpy only, and nothing of wsim.

PROBLEM.npz     points (n, 3) [m], edges (m, 2), stiffness (m,) [N/m], lengths (m,) [m], masses (n,) [kg], pinned (k,),
                gravity (3,) [m/s^2], frame [s], ends (e,) numbers of the frames after which the state is kept; of a sheet
                triangles (t, 3), mu, lame [N/m] instead of springs
SETTINGS.json   [{"solver": one of SOLVERS, "substeps", "iterations"}, ...]
OUT_FOLDER      rows.json: the settings with ms, first_s, capture_s, colors, finite, or with `failed`; states.npz: x0, v0
                (e, n, 3) [m], [m/s] of the first setting, x1, v1 ... of the next

What a careful user would do is done: no particle radius, so no hash grid and no particle contacts; no self-contact, no
ground, no damping; the vertex colours of VBD heed the springs, which ModelBuilder.color() leaves out (the better of
Warp's two algorithms is taken); forces are cleared only for the solver that adds to them; one control object for all
steps; a frame is captured once and replayed. With an odd number of substeps two graphs take turns, since the two states
do. SolverVBD's tile kernels gather triangles, of which a spring net has none: off for "vbd", on for "vbd_tile" (CUDA).

SolverStyle3D is not run: it launches kernels for its own anisotropic triangles, bending and contacts only and reads no
springs, so a net of springs would fall freely; a sheet of its own triangles is another model with another trajectory.
"""

import argparse
import json
import os
import time
from pathlib import Path

import newton
import numpy as np
import warp as wp

EXPLICIT = "semi_implicit"                   # symplectic Euler, explicit in the spring forces


def vbd(model: newton.Model, iterations: int, tile: bool = False):
    return newton.solvers.SolverVBD(model, iterations=iterations, particle_enable_self_contact=False,
                                    particle_enable_tile_solve=tile)


SOLVERS = {
    "xpbd": lambda model, iterations: newton.solvers.SolverXPBD(model, iterations=iterations),
    "vbd": vbd,
    "vbd_tile": lambda model, iterations: vbd(model, iterations, True),
    EXPLICIT: lambda model, iterations: newton.solvers.SolverSemiImplicit(model, enable_tri_contact=False),
}


def colors(n: int, edges: np.ndarray) -> list[np.ndarray]:
    """Groups of points of which no two share a spring; the fewer groups of Warp's two algorithms, balanced."""
    best: list[np.ndarray] = []
    graph = wp.array(edges, dtype=wp.int32, device="cpu")
    for algorithm in (wp.utils.GraphColoringAlgorithm.MCS, wp.utils.GraphColoringAlgorithm.GREEDY):
        color = wp.empty(n, dtype=wp.int32, device="cpu")
        count = wp.utils.graph_coloring_assign(graph, color, algorithm)
        wp.utils.graph_coloring_balance(graph, color, count, 1.1)
        found = color.numpy()
        assert (found[edges[:, 0]] != found[edges[:, 1]]).all(), "a spring joins two points of one colour"
        groups = [np.flatnonzero(found == c) for c in range(count)]
        best = groups if not best or len(groups) < len(best) else best
    return best


def edges_of(problem: dict[str, np.ndarray]) -> np.ndarray:
    """Pairs of points that share a force, (m, 2)."""
    if "edges" in problem:
        return problem["edges"]
    sides = problem["triangles"][:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    return np.unique(np.sort(sides, axis=1), axis=0).astype(np.int32)


def model_of(problem: dict[str, np.ndarray], device: wp.Device, groups: list[np.ndarray], lame: float = 0.0) -> newton.Model:
    """Particles and springs or triangles, no shapes, no damping; a pinned particle has mass 0. `lame` is of the solver."""
    masses = problem["masses"].copy()
    masses[problem["pinned"]] = 0.0
    n = len(masses)
    builder = newton.ModelBuilder(gravity=wp.vec3(*problem["gravity"].tolist()))
    builder.add_particles(pos=[wp.vec3(*p) for p in problem["points"].tolist()], vel=[wp.vec3(0.0)] * n,
                          mass=masses.tolist(), radius=[0.0] * n)
    if "edges" in problem:
        for (i, j), k in zip(problem["edges"].tolist(), problem["stiffness"].tolist(), strict=True):
            builder.add_spring(i, j, k, 0.0, 0.0)
        builder.spring_rest_length = problem["lengths"].tolist()
    else:
        t = len(problem["triangles"])
        builder.add_triangles(*problem["triangles"].T.tolist(), tri_ke=[float(problem["mu"])] * t, tri_ka=[lame] * t,
                              tri_kd=[0.0] * t, tri_drag=[0.0] * t, tri_lift=[0.0] * t)
    builder.set_coloring(groups)
    model = builder.finalize(device=device)
    model.particle_grid = None
    return model


class Run:
    """One solver on one model, a frame at a time. The two states take turns, substep by substep."""

    def __init__(self, model: newton.Model, setting: dict, frame: float):
        self.model, self.substeps, self.h = model, setting["substeps"], frame / setting["substeps"]
        self.solver = SOLVERS[setting["solver"]](model, setting["iterations"])
        self.clears = setting["solver"] == EXPLICIT
        self.states, self.control = (model.state(), model.state()), model.control()
        self.at, self.graphs, self.capture_s = 0, {}, 0.0

    def launch(self) -> None:
        for s in range(self.substeps):
            old, new = self.states[(self.at + s) % 2], self.states[(self.at + s + 1) % 2]
            if self.clears:
                old.clear_forces()
            self.solver.step(old, new, self.control, None, self.h)

    def frame(self, replay: bool) -> None:
        if not replay:
            self.launch()
        else:
            if self.at not in self.graphs:
                began = time.perf_counter()
                with wp.ScopedCapture(device=self.model.device) as capture:
                    self.launch()
                self.graphs[self.at] = capture.graph
                self.capture_s += time.perf_counter() - began
            wp.capture_launch(self.graphs[self.at])
        self.at = (self.at + self.substeps) % 2
        wp.synchronize_device(self.model.device)

    def now(self) -> tuple[np.ndarray, np.ndarray]:
        state = self.states[self.at]
        return state.particle_q.numpy().astype(np.float64), state.particle_qd.numpy().astype(np.float64)


def measure(problem: dict[str, np.ndarray], setting: dict, device: wp.Device, groups) -> tuple[dict, list]:
    """The row of a setting, and its states at the ends. The first frame runs unrecorded (it compiles), the second and
    third capture; ms is the median of the rest."""
    began = time.perf_counter()
    lame = float(problem.get("lame", 0.0))
    if "mu" in problem and setting["solver"] == EXPLICIT:             # it takes the energy's own factor of (J - a)^2
        lame += float(problem["mu"])
    run = Run(model_of(problem, device, groups, lame), setting, float(problem["frame"]))
    built = time.perf_counter() - began
    ends, kept, ms = problem["ends"].tolist(), [], []
    for number in range(1, max(ends) + 1):
        start = time.perf_counter()
        run.frame(replay=number > 1)
        ms.append(1e3 * (time.perf_counter() - start))
        if number in ends:
            kept.append(run.now())
    finite = bool(all(np.isfinite(x).all() for x, _ in kept))
    return setting | {"ms": float(np.median(ms[3:])), "first_s": built + 1e-3 * ms[0], "capture_s": run.capture_s,
                      "colors": len(groups) if setting["solver"].startswith("vbd") else None, "finite": finite}, kept


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("problem")
    parser.add_argument("settings")
    parser.add_argument("out")
    parser.add_argument("--device", default=None)
    args = parser.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    device = wp.get_device(args.device)
    with np.load(args.problem) as found:
        problem = {name: found[name] for name in found.files}
    groups = colors(len(problem["points"]), edges_of(problem))
    rows, states = [], {}
    with wp.ScopedDevice(device):
        for number, setting in enumerate(json.loads(Path(args.settings).read_text())):
            try:
                row, kept = measure(problem, setting, device, groups)
                states[f"x{number}"], states[f"v{number}"] = (np.array(part) for part in zip(*kept, strict=True))
            except Exception as error:                        # a row that fails is a row of the table
                row = setting | {"finite": False, "failed": f"{type(error).__name__}: {error}"}
            rows.append(row)
            print("newton", json.dumps(row), flush=True)
    out = Path(args.out)
    for name, write in (("rows.json", lambda f: f.write(json.dumps({
            "newton": newton.__version__, "warp": wp.config.version, "device": device.name, "rows": rows}).encode())),
                        ("states.npz", lambda f: np.savez(f, **states))):
        with open(out / f"{name}.part", "wb") as file:
            write(file)
        os.replace(out / f"{name}.part", out / name)


if __name__ == "__main__":
    main()
