"""Error and time of sand in the material point method: a slope near its friction angle, and the run-out of columns.

    PYTHONPATH=. python tools/bench/soft/mpm/sand.py [--slope 29 31] [--column 0.6 1 2 3] [--device cpu]

Both are in plane strain, between walls without friction that are 2 cells apart. Slope: a layer 4 cells deep and 12 m long, of a
friction angle of 30 degrees, on a rough floor; gravity grows in 1/3 s. Its speed in the middle says whether it stands.
A layer that flows speeds up by g (sin - cos tan 30). Columns stand on a rough floor. Lajeunesse, Monnier, Homsy 2005 found in
a channel, with beads of an angle of repose of 22 degrees, (L - L0) / L0 = 1.2 a up to a = H0 / L0 of about 3, and
1.9 a^(2/3) above.
"""

import argparse
import time

import numpy as np

import wsim
from wsim.physics.mpm.objects import Granular

GRAVITY, ANGLE, REPOSE = 9.81, 30.0, 22.0
LENGTH = 0.1               # L0 of columns [m]
ACROSS = 16                # cells along L0
ROUGH = 10.0               # friction of a floor on which nothing slides


def make_scene(width: float, floor: float) -> wsim.Scene:
    """A floor with that friction, and two walls across z, which are smooth."""
    scene = wsim.Scene(fps=60)
    scene.collider("/floor", wsim.Plane(), static_friction=floor, dynamic_friction=floor)
    turned = np.diag([-1.0, 1.0, -1.0, 1.0])
    turned[2, 3] = width
    for name, place in (("near", np.eye(4)), ("far", turned)):
        scene.collider(f"/{name}", wsim.Plane("Z"), motion=wsim.Motion.still(place), static_friction=0.0, dynamic_friction=0.0)
    return scene


def run_slope(degrees: float, device: str, integrator: str, depth: float = 0.2, length: float = 12.0,
              cell: float = 0.05) -> None:
    """Prints the speed of a layer on a slope."""
    scene = make_scene(2 * cell, ROUGH)
    scene.gravity = (0.0, 0.0, 0.0)
    scene.mpm("/sand", wsim.Box((0.5 * length, 0.5 * depth, cell)), at=(0, 0.5 * depth, cell), cell=cell,
              material=Granular(young=1e6, friction_angle=np.radians(ANGLE)), integrator=integrator)
    simulation = wsim.Simulation(scene, device=device)
    x = simulation.samples()[0].positions
    middle = (np.abs(x[:, 0]) < 0.5) & (x[:, 1] > 0.7 * depth)
    tilt, seen, began = np.radians(degrees), {}, time.process_time()
    for frame in range(1, 73):
        part = GRAVITY * min(1.0, frame / 20)
        if frame <= 20:
            simulation.set("/", "gravity", (part * np.sin(tilt), -part * np.cos(tilt), 0.0))
        simulation.step()
        if frame % 12 == 0:
            seen[frame / 60] = float(simulation.samples()[0].velocities[middle, 0].mean())
    moved = float((simulation.samples()[0].positions - x)[middle, 0].mean())
    rate = (seen[1.2] - seen[0.6]) / 0.6
    theory = max(0.0, GRAVITY * (np.sin(tilt) - np.cos(tilt) * np.tan(np.radians(ANGLE))))
    print(f"slope of {degrees:g} degrees, angle {ANGLE:g}: {len(x)} particles, at 1.2 s {1e3 * seen[1.2]:.1f} mm/s, moved "
          f"{1e3 * moved:.1f} mm, acceleration {rate:.3f} m/s^2 (theory {theory:.3f}), {time.process_time() - began:.0f} CPU s",
          flush=True)


def run_column(aspect: float, device: str, integrator: str) -> None:
    """Prints the run-out of a column."""
    cell, height = LENGTH / ACROSS, aspect * LENGTH
    scene = make_scene(2 * cell, ROUGH)
    scene.collider("/wall", wsim.Plane("X"), static_friction=0.0, dynamic_friction=0.0)
    scene.mpm("/sand", wsim.Box((0.5 * LENGTH, 0.5 * height, cell)), at=(0.5 * LENGTH, 0.5 * height, cell), cell=cell,
              material=Granular(young=2e5, friction_angle=np.radians(REPOSE)), integrator=integrator)
    simulation = wsim.Simulation(scene, device=device)
    began = time.process_time()
    simulation.run(int(60 * 5.0 * np.sqrt(height / GRAVITY)) + 6)
    x = simulation.samples()[0].positions
    front = np.quantile(x[:, 0], 0.995)                        # few grains of the front do not count
    found, theory = front / LENGTH - 1.0, 1.2 * aspect if aspect <= 3.0 else 1.9 * aspect ** (2.0 / 3.0)
    print(f"column a = {aspect:g}, angle {REPOSE:g}: {len(x)} particles, run-out {found:.2f} L0 (Lajeunesse {theory:.2f}, "
          f"{100 * (found / theory - 1):+.0f} %), height {x[:, 1].max() / LENGTH:.2f} L0, "
          f"{time.process_time() - began:.0f} CPU s", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--slope", type=float, nargs="*", default=[29.0, 31.0])
    parser.add_argument("--column", type=float, nargs="*", default=[0.6, 1.0, 2.0, 3.0])
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--integrator", default="explicit", choices=("explicit", "implicit"))
    given = parser.parse_args()
    for degrees in given.slope:
        run_slope(degrees, given.device, given.integrator)
    for aspect in given.column:
        run_column(aspect, given.device, given.integrator)


if __name__ == "__main__":
    main()
