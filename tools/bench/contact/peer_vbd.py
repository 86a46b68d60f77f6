"""Newton's VBD with self-contact on the twist of twists.py: time of a frame, and the states after each turn.

    PEER_PYTHON tools/bench/contact/peer_vbd.py FOLDER [--device cuda:0|cpu]

Run by self_contact.py with the interpreter of an environment of Newton's own: this file imports newton, warp and numpy only.
FOLDER holds problem.npz and settings.json, [[substeps, iterations], ...], and gets rows.json and states.npz.

As Newton 1.8's example cloth_twist does it: one search of contacts before the substeps of a frame and in them as the solver
says by itself, trees built anew every 10 frames, buffers of 64 and 128 pairs. Radius of contacts: our thickness; margin
beyond it: 0.75 of it, as the example's. Triangles at less than two edges are no contacts of each other, as there.
mu = E h / (2 (1 + nu)), lambda = nu E h / (1 - nu^2), as tools/bench/nets/membrane.py says; hinges of the plate's stiffness.
"""

import argparse
import json
import time
from pathlib import Path

import newton
import numpy as np
import warp as wp

REBUILT = 10                             # frames
KE, KD = 1.0e3, 1.0e-1                   # of contacts, the example's


@wp.kernel
def move_ends(rows: wp.array(dtype=int), local: wp.array(dtype=wp.vec3), sign: wp.array(dtype=float),
              path: wp.array(dtype=wp.vec2), clock: wp.array(dtype=float), step: float, a: wp.array(dtype=wp.vec3),
              b: wp.array(dtype=wp.vec3)):
    """Both states' ends, linearly between frames. path: angle and height at these."""
    i = wp.tid()
    t = clock[0] + step
    k = wp.min(int(t), path.shape[0] - 2)
    s = t - float(k)
    now = sign[i] * ((1.0 - s) * path[k] + s * path[k + 1])
    p = wp.quat_rotate(wp.quat_from_axis_angle(wp.vec3(0.0, 1.0, 0.0), now[0]), local[i])
    a[rows[i]] = p + wp.vec3(0.0, now[1], 0.0)
    b[rows[i]] = a[rows[i]]


@wp.kernel
def tick(clock: wp.array(dtype=float), step: float):
    clock[0] = clock[0] + step


class Twist:
    """One setting on the device."""

    def __init__(self, p: dict, substeps: int, iterations: int, device):
        self.substeps, self.h, self.device = substeps, float(p["frame"]) / substeps, device
        mu = float(p["stretch"] / (2.0 * (1.0 + p["poisson"])))
        lame = float(p["poisson"] * p["stretch"] / (1.0 - p["poisson"]**2))
        builder = newton.ModelBuilder(gravity=wp.vec3(0.0, 0.0, 0.0))
        builder.add_cloth_mesh(
            pos=wp.vec3(0.0), rot=wp.quat_identity(), scale=1.0, vertices=[wp.vec3(*v) for v in p["rest"].tolist()],
            indices=p["triangles"].ravel().tolist(), vel=wp.vec3(0.0), density=float(p["density"]), tri_ke=mu, tri_ka=lame,
            tri_kd=1e-4, edge_ke=float(p["bend"]), edge_kd=1e-4, particle_radius=float(0.5 * p["thickness"]))
        builder.color()
        self.model = builder.finalize(device=device)
        self.model.soft_contact_ke, self.model.soft_contact_kd = KE, KD
        self.model.soft_contact_mu = float(p["friction"])
        flags, rows = self.model.particle_flags.numpy(), np.concatenate([p["upper"], p["lower"]])
        flags[rows] &= ~int(newton.ParticleFlags.ACTIVE)
        self.model.particle_flags = wp.array(flags, device=device)
        self.solver = newton.solvers.SolverVBD(
            self.model, iterations=iterations, particle_enable_self_contact=True,
            particle_self_contact_margin=float(p["thickness"]), particle_self_contact_gap=float(0.75 * p["thickness"]),
            particle_vertex_contact_buffer_size=64, particle_edge_contact_buffer_size=128)
        self.states, self.control = [self.model.state(), self.model.state()], self.model.control()
        self.states[0].particle_q.assign(p["points"].astype(np.float32))
        self.pipeline = newton.CollisionPipeline(self.model)
        self.contacts = self.pipeline.contacts()
        place, sign = p["rest"][rows], np.repeat([1.0, -1.0], [len(p["upper"]), len(p["lower"])])
        local = place - np.stack([0.0 * sign, sign * p["height"][0], 0.0 * sign], axis=1)
        self.ends = [wp.array(a, dtype=t, device=device) for a, t in (
            (rows.astype(np.int32), int), (local.astype(np.float32), wp.vec3), (sign, float),
            (np.stack([p["angle"], p["height"]], axis=1).astype(np.float32), wp.vec2))]
        self.clock, self.graph = wp.zeros(1, dtype=float, device=device), None

    def launch(self) -> None:
        self.pipeline.collide(self.states[0], self.contacts)
        step = 1.0 / self.substeps
        for _ in range(self.substeps):
            a, b = self.states
            a.clear_forces()
            wp.launch(move_ends, len(self.ends[0]), [*self.ends, self.clock, step], [a.particle_q, b.particle_q],
                      device=self.device)
            wp.launch(tick, 1, [self.clock, step], device=self.device)
            self.solver.step(a, b, self.control, self.contacts, self.h)
            self.states.reverse()

    def frame(self, number: int) -> None:
        if number % REBUILT == 0:
            self.solver.rebuild_bvh(self.states[0])
        if number == 0 or not self.device.is_cuda:
            self.launch()
        else:
            if self.graph is None:
                with wp.ScopedCapture(device=self.device) as capture:
                    self.launch()
                self.graph = capture.graph
            wp.capture_launch(self.graph)
        wp.synchronize_device(self.device)


def measure(p: dict, substeps: int, iterations: int, device) -> tuple[list[dict], list[np.ndarray]]:
    """Rows after each turn, and the states there. Substeps are even, so that one graph does."""
    began = time.perf_counter()
    run, rows, states, ms = Twist(p, substeps, iterations, device), [], [], []
    run.frame(0)
    first, began = time.perf_counter() - began, time.perf_counter()
    for frame in range(2, int(p["marks"][-1]) + 1):
        start = time.perf_counter()
        run.frame(frame - 1)
        ms.append(1e3 * (time.perf_counter() - start))
        late = time.perf_counter() - began > float(p["seconds"])
        if frame in p["marks"] or late:
            x = run.states[0].particle_q.numpy()
            rows.append({"scene": "twist", "side": "newton", "points": len(x), "substeps": substeps, "iterations": iterations,
                         "frame": frame, "ms": float(np.median(ms)), "ms_worst": max(ms), "first_s": first,
                         "finite": bool(np.isfinite(x).all())})
            states.append(x)
            ms = []
        if late or (rows and not rows[-1]["finite"]):
            break
    return rows, states


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--device", default=None)
    args = parser.parse_args()
    wp.config.quiet = True
    with np.load(args.folder / "problem.npz") as found:
        problem = {name: found[name] for name in found.files}
    rows, states = [], []
    for substeps, iterations in json.loads((args.folder / "settings.json").read_text()):
        each = measure(problem, substeps, iterations, wp.get_device(args.device))
        rows, states = rows + each[0], states + each[1]
        print(*({k: v for k, v in row.items() if k in ("substeps", "iterations", "frame", "ms")} for row in each[0]), sep="\n",
              flush=True)
    (args.folder / "rows.json").write_text(json.dumps(rows))
    np.savez(args.folder / "states.npz", **{f"x{k}": x for k, x in enumerate(states)})


if __name__ == "__main__":
    main()
