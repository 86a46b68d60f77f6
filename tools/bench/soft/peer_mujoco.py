"""MuJoCo's flex on a clamped beam of tets, on the CPU: the runs of runs.py.

    MUJOCO_PYTHON tools/bench/soft/peer_mujoco.py PROBLEM.npz SETTINGS.json OUT_FOLDER

Run by peers.py with the interpreter of an environment with MuJoCo 4; imports mujoco and numpy, nothing of wsim.

`solver` is MuJoCo's integrator: "discrete" is implicit, M + h D + h^2 K solved once a step by conjugate gradients to
`tolerance` in at most `iterations`; "Euler" (symplectic) and "RK4" are explicit in the elastic forces. "implicit" and
"implicitfast" refuse elastic flexes since MuJoCo 3.13. `neo_hookean`: the flex of stable Neo-Hookean energy without
logarithm, else Saint Venant-Kirchhoff's; both have the E and nu that they are given, and their forces equal those of
material.py to rounding. All in float64, on one thread.

A flexcomp shares its mass equally among its points; here each has its lumped mass, as everywhere else. No contacts, no damping.
"""

import sys
import warnings
from math import exp
from pathlib import Path

import mujoco
import numpy as np

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))
from tools.bench.soft.runs import Make, arguments, processor, serve  # noqa: E402

RADIUS = 1e-3             # [m] of gyration of a point's body, which only slides: of no effect


def text(values) -> str:
    return " ".join(map(repr, np.asarray(values).ravel().tolist()))


def scene(problem: dict[str, np.ndarray], setting: dict, gravity: np.ndarray) -> mujoco.MjModel:
    h = float(problem["frame"]) / setting["substeps"]
    spec = mujoco.MjSpec.from_string(f"""<mujoco>
      <option integrator="{setting["solver"]}" timestep="{h!r}" gravity="{text(gravity)}" solver="CG"
              tolerance="{setting.get("tolerance", 1e-8)}" iterations="{setting["iterations"]}">
        <flag contact="disable"/>
      </option>
      <size memory="1G"/>
      <worldbody>
        <flexcomp name="beam" type="direct" dim="3" mass="1" radius="0.001" point="{text(problem["points"])}"
                  element="{text(problem["tets"])}">
          <elasticity young="{float(problem["young"])!r}" poisson="{float(problem["poisson"])!r}"/>
          <contact selfcollide="none" contype="0" conaffinity="0"/>
          <pin id="{text(problem["pinned"])}"/>
        </flexcomp>
      </worldbody>
    </mujoco>""")
    if setting.get("neo_hookean"):
        spec.flexes[0].elastic3d = 1
    for i in np.setdiff1d(np.arange(len(problem["points"])), problem["pinned"]).tolist():
        body, mass = spec.body(f"beam_{i}"), float(problem["masses"][i])
        body.mass, body.inertia = mass, [mass * RADIUS**2] * 3
    return spec.compile()


class Beam:
    """One integrator on the beam."""

    def __init__(self, model: mujoco.MjModel, problem: dict[str, np.ndarray], setting: dict, offset: np.ndarray, decay: float):
        self.model, self.data, self.substeps = model, mujoco.MjData(model), setting["substeps"]
        self.keep = exp(-decay * float(problem["frame"]))
        moving = np.setdiff1d(np.arange(len(offset)), problem["pinned"])
        self.data.qpos[:] = offset[moving].ravel()           # three slides a point, in the order of the points

    def frame(self) -> None:
        mujoco.mj_step(self.model, self.data, self.substeps)
        self.data.qvel *= self.keep

    def positions(self) -> np.ndarray:
        """Not a number where MuJoCo found the run unstable: it starts again from rest without an error."""
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_flex(self.model, self.data)
        bad = [mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC]
        found = self.data.flexvert_xpos.copy()
        return found * np.nan if any(self.data.warning[w].number for w in bad) else found


def begin(problem: dict[str, np.ndarray], setting: dict) -> Make:
    return lambda gravity, offset, decay: Beam(scene(problem, setting, gravity), problem, setting, offset, decay)


def main() -> None:
    warnings.filterwarnings("ignore", message="flex 'beam' is not rigid")      # it looks for other forces than these
    args, problem, settings = arguments(__doc__)
    head = {"mujoco": mujoco.__version__, "device": processor()}
    serve("mujoco", head, args, problem,
          [(s | {"model": "neo_hookean_no_log" if s.get("neo_hookean") else "st_venant_kirchhoff"},
            lambda s=s: begin(problem, s)) for s in settings])


if __name__ == "__main__":
    main()
