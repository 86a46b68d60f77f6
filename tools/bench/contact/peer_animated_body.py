"""Newton's VBD on the cloth of animated_body.py: time of a frame, and the states after every tenth of a second.

    PEER_PYTHON tools/bench/contact/peer_animated_body.py FOLDER [--device cuda:0|cpu]

Run by animated_body.py with the interpreter of an environment of Newton's own: this file imports newton, warp and numpy only.
FOLDER holds problem.npz and settings.json, [[substeps, iterations], ...], and gets rows.json and states.npz.

As Newton 1.8's example cloth_franka does it: the body is moved from outside, so that each substep has its pose before and
after; contacts with it are searched in each substep; self-contacts as the solver says by itself, trees built anew every 10
frames. Radius of self-contacts: our thickness; margin beyond it: 0.75 of it. mu, lambda and bending as peer_vbd.py says.
"""

import argparse
import json
import time
from pathlib import Path

import newton
import numpy as np
import warp as wp

REBUILT = 10                             # frames
KE, KD = 1.0e4, 1.0e1                    # of contacts, the example's
SKIN = 0.01                              # [m] from the body within which contacts are found, the example's


@wp.kernel
def move_body(path: wp.array(dtype=wp.vec2), every: float, clock: wp.array(dtype=float), h: float,
              before: wp.array(dtype=wp.transform), after: wp.array(dtype=wp.transform)):
    """Poses of the body at the start and the end of a substep. path: angle and place each `every` seconds."""
    for j in range(2):
        t = (clock[0] + float(j) * h) / every
        k = wp.min(int(t), path.shape[0] - 2)
        now = path[k] + (t - float(k)) * (path[k + 1] - path[k])
        q = wp.quat_from_axis_angle(wp.vec3(0.0, 1.0, 0.0), now[0] + 0.5 * 3.14159265)
        if j == 0:
            before[0] = wp.transform(wp.vec3(0.0, 0.0, now[1]), q)
        else:
            after[0] = wp.transform(wp.vec3(0.0, 0.0, now[1]), q)


@wp.kernel
def pass_time(clock: wp.array(dtype=float), h: float):
    clock[0] = clock[0] + h


class Dance:
    """One setting on the device."""

    def __init__(self, p: dict, substeps: int, iterations: int, device):
        self.substeps, self.h, self.device = substeps, float(p["frame"]) / substeps, device
        mu = float(p["stretch"] / (2.0 * (1.0 + p["poisson"])))
        lame = float(p["poisson"] * p["stretch"] / (1.0 - p["poisson"]**2))
        builder = newton.ModelBuilder(gravity=wp.vec3(0.0, -9.81, 0.0))
        body = builder.add_body(is_kinematic=True)
        builder.add_shape_capsule(body, radius=float(p["radius"]), half_height=float(p["half"]),
                                  cfg=newton.ModelBuilder.ShapeConfig(mu=float(p["friction"]), ke=KE, kd=KD))
        builder.add_cloth_mesh(
            pos=wp.vec3(0.0), rot=wp.quat_identity(), scale=1.0, vertices=[wp.vec3(*v) for v in p["points"].tolist()],
            indices=p["triangles"].ravel().tolist(), vel=wp.vec3(0.0), density=float(p["density"]), tri_ke=mu, tri_ka=lame,
            tri_kd=1e-4, edge_ke=float(p["bend"]), edge_kd=1e-4, particle_radius=float(0.5 * p["thickness"]))
        builder.color()
        self.model = builder.finalize(device=device)
        self.model.soft_contact_ke, self.model.soft_contact_kd = KE, KD
        self.model.soft_contact_mu = float(p["friction"])
        self.solver = newton.solvers.SolverVBD(
            self.model, iterations=iterations, integrate_with_external_rigid_solver=True, particle_enable_self_contact=True,
            particle_self_contact_margin=float(p["thickness"]), particle_self_contact_gap=float(0.75 * p["thickness"]),
            particle_vertex_contact_buffer_size=64, particle_edge_contact_buffer_size=128)
        self.states, self.control = [self.model.state(), self.model.state()], self.model.control()
        self.pipeline = newton.CollisionPipeline(self.model, soft_contact_gap=SKIN)
        self.contacts = self.pipeline.contacts()
        self.path = wp.array(np.stack([p["angle"], p["z"]], axis=1).astype(np.float32), dtype=wp.vec2, device=device)
        self.every = float(p["times"][1])
        self.clock, self.graph = wp.zeros(1, dtype=float, device=device), None

    def launch(self) -> None:
        for _ in range(self.substeps):
            a, b = self.states
            a.clear_forces()
            wp.launch(move_body, 1, [self.path, self.every, self.clock, self.h], [a.body_q, b.body_q], device=self.device)
            self.pipeline.collide(a, self.contacts)
            self.solver.step(a, b, self.control, self.contacts, self.h)
            wp.launch(pass_time, 1, [self.clock, self.h], device=self.device)
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


def measure(p: dict, substeps: int, iterations: int, device) -> tuple[dict, np.ndarray]:
    """The row of a setting, and its states. Substeps are even, so that one graph does."""
    began = time.perf_counter()
    run, states, frames, ms = Dance(p, substeps, iterations, device), [], [], []
    run.frame(0)
    first = time.perf_counter() - began
    for frame in range(2, int(p["frames"]) + 1):
        start = time.perf_counter()
        run.frame(frame - 1)
        ms.append(1e3 * (time.perf_counter() - start))
        if frame % int(p["mark"]) == 0:
            states.append(run.states[0].particle_q.numpy().copy())
            frames.append(frame)
    return {"side": "newton", "solver": "vbd", "points": len(states[0]), "substeps": substeps, "iterations": iterations,
            "ms": float(np.median(ms)), "ms_most": max(ms), "first_s": first, "frames": frames}, np.array(states)


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
        row, x = measure(problem, substeps, iterations, wp.get_device(args.device))
        rows, states = [*rows, row], [*states, x]
        print({k: v for k, v in row.items() if k in ("substeps", "iterations", "ms", "ms_most")}, flush=True)
    (args.folder / "rows.json").write_text(json.dumps(rows))
    np.savez(args.folder / "states.npz", **{f"x{k}": x for k, x in enumerate(states)})


if __name__ == "__main__":
    main()
