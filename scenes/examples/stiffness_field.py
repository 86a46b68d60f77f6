"""How stiff each tet of a bar is, from one photograph of how it hangs: soft where it is held, four times as stiff beyond. 63
points with 0.1 mm of noise, 120 unknown moduli; what lies between is filled in by the belief that neighbours are alike, but for
some sharp edges (total variation). The free end carries nothing, and the fit says that it is not seen.

    python scenes/examples/stiffness_field.py
"""

import numpy as np

import wsim
from wsim import Bulk, Scene, Simulation
from wsim.fitting import Settings, Track
from wsim.scene import shapes

SOFT, STIFF = 5e4, 2e5         # [Pa]
NOISE = 1e-4                   # [m]


def scene_of(cells=(6, 2, 2), frames: int = 8) -> Scene:
    """The start of the fit: 100 kPa everywhere. Long damped steps bring it to rest."""
    scene = Scene(fps=10.0, frames=frames, solver="implicit", integrator="backward_euler", substeps=1, air_drag=5.0)
    points, tets = shapes.block((0.6, 0.2, 0.2), cells)
    body = scene.soft("/bar", points, tets, material=Bulk(1e5, 0.3, 1e3))
    scene.pin("/wall", body, np.flatnonzero(points[:, 0] < points[:, 0].min() + 1e-6))
    return scene


def run(cells=(6, 2, 2), limit: float = 150.0) -> dict:
    scene = scene_of(cells)
    soft = scene.softs[0]
    along = soft.points[soft.tets].mean(axis=1)[:, 0]                      # [m] middles of the tets, from -0.3 to 0.3
    truth = np.where(along < 0.0, SOFT, STIFF)
    photographed = Simulation(scene, device="cpu", precision="float64")
    photographed.set("/bar", "young", truth)
    photographed.run()
    x = photographed.positions()
    x = x + NOISE * np.random.default_rng(0).normal(size=x.shape)
    found = wsim.fit(scene, [Track("/bar", np.array([scene.frames]), x[None], sigma=NOISE)], "young[tv]",
                     settings=Settings(device="cpu", limit=limit))
    return {"along": along, "truth": truth, "young": found.values["young[]"], "unseen": found.unseen("young[]"),
            "gradients": found.simulations, "converged": found.converged, "text": found.text()}


if __name__ == "__main__":
    r = run()
    print(r["text"])
    slice_of = np.floor(r["along"] / 0.1 + 1e-9)
    for k in np.unique(slice_of):
        own = slice_of == k
        print(f"{0.1 * k:+.1f} to {0.1 * k + 0.1:+.1f} m: found {np.median(r['young'][own]):9.0f} Pa, true "
              f"{r['truth'][own][0]:9.0f}, {int(r['unseen'][own].sum())} of {own.sum()} tets unseen")
