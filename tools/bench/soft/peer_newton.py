"""Newton's solvers on a clamped beam of tets: the runs of runs.py.

    PEER_PYTHON tools/bench/soft/peer_newton.py PROBLEM.npz SETTINGS.json OUT_FOLDER [--device cuda:0|cpu]

Run by peers.py with the interpreter of an environment of Newton's own; imports newton, warp and numpy, nothing of wsim.

    vbd, vbd_tile     vertex block descent, backward Euler: stable Neo-Hookean without logarithm. SolverVBD takes the Lame
                      parameters of small strain and adds mu to lambda itself (particle_vbd_kernels.py): E and nu are right.
    semi_implicit     symplectic Euler: stable Neo-Hookean with logarithm. SolverSemiImplicit takes k_mu, k_lambda as the
                      parameters of that energy, so that it is given 4/3 mu and lambda + 5/6 mu; without, E is wrong by 27 %.

As in tools/bench/nets/peer_newton.py: no contacts, no damping, a frame is a graph that is replayed, colours by the edges of the
tets. Tiles gather tets and run on a GPU only.
"""

import sys
from math import exp
from pathlib import Path

import newton
import numpy as np
import warp as wp

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))
from tools.bench.nets.peer_newton import EXPLICIT, Run, colors  # noqa: E402
from tools.bench.soft.runs import Make, arguments, serve  # noqa: E402

EDGES = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))


def parameters(problem: dict[str, np.ndarray], solver: str) -> tuple[float, float, str]:
    """k_mu, k_lambda [Pa] that a solver wants for E and nu, and the name of its energy in material.py."""
    E, nu = float(problem["young"]), float(problem["poisson"])
    mu, lam = E / (2.0 * (1.0 + nu)), E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))
    return (4.0 / 3.0 * mu, lam + 5.0 / 6.0 * mu, "neo_hookean") if solver == EXPLICIT else (mu, lam, "neo_hookean_no_log")


class Beam:
    """One solver on the beam."""

    def __init__(self, model: newton.Model, problem: dict[str, np.ndarray], setting: dict, offset: np.ndarray, decay: float):
        self.run = Run(model, setting, float(problem["frame"]))
        self.keep, self.frames = exp(-decay * float(problem["frame"])), 0
        start = (problem["points"] + offset).astype(np.float32)
        for state in self.run.states:
            state.particle_q.assign(start)

    def frame(self) -> None:
        self.run.frame(replay=self.frames > 0)
        self.frames += 1
        if self.keep < 1.0:
            v = self.run.states[self.run.at].particle_qd
            v.assign(self.keep * v.numpy())

    def positions(self) -> np.ndarray:
        return self.run.now()[0]


def begin(problem: dict[str, np.ndarray], setting: dict, device: wp.Device, groups: list[np.ndarray]) -> Make:
    k_mu, k_lambda, _ = parameters(problem, setting["solver"])
    masses = problem["masses"].copy()
    masses[problem["pinned"]] = 0.0

    def make(gravity: np.ndarray, offset: np.ndarray, decay: float) -> Beam:
        n, builder = len(masses), newton.ModelBuilder(gravity=wp.vec3(*gravity.tolist()))
        builder.add_particles(pos=[wp.vec3(*p) for p in problem["points"].tolist()], vel=[wp.vec3(0.0)] * n,
                              mass=masses.tolist(), radius=[0.0] * n)
        for tet in problem["tets"].tolist():
            builder.add_tetrahedron(*tet, k_mu=k_mu, k_lambda=k_lambda, k_damp=0.0)
        builder.set_coloring(groups)
        model = builder.finalize(device=device)
        model.particle_grid = None
        return Beam(model, problem, setting, offset, decay)

    return make


def main() -> None:
    args, problem, settings = arguments(__doc__)
    wp.config.log_level = wp.LOG_WARNING
    device = wp.get_device(args.device)
    edges = np.unique(np.sort(np.concatenate([problem["tets"][:, e] for e in EDGES]), axis=1), axis=0)
    groups = colors(len(problem["points"]), edges.astype(np.int32))
    head = {"newton": newton.__version__, "warp": wp.config.version, "device": device.name, "colors": len(groups)}
    with wp.ScopedDevice(device):
        serve("newton", head, args, problem,
              [(s | {"model": parameters(problem, s["solver"])[2]}, lambda s=s: begin(problem, s, device, groups))
               for s in settings])


if __name__ == "__main__":
    main()
