"""Error and time of sand in the material point method: a slope near its friction angle, columns that collapse, an hourglass.

    PYTHONPATH=. python tools/bench/soft/mpm/sand.py [--slope 29 31] [--column 0.6 1 2 3 5] [--hourglass 0.4 0.8 1.2]
                                                     [--angle 30] [--width 0] [--cells 16] [--device cpu]

Slope: a layer 0.1 m deep and 12 m long, of a friction angle of 30 degrees, on a rough floor, between smooth walls across z and
walls at both ends; gravity grows in 1/3 s. Its speed in the middle says whether it stands. A layer without ends speeds up by
g (sin - cos tan 30); the wall at the toe bears at most the passive thrust, g depth / 2 tan(60)^2 / length of it.

Column: sand of 30 degrees on a rough floor, in plane strain. The run-out is (L - L0) / L0 = 1.2 a up to a = H0 / L0 of 2.3 and
1.9 a^(2/3) above: the factors of Lube, Huppert, Sparks, Freundt 2005 (Phys. Rev. E 72, 041301), whose sand has an angle of
repose of about 30 degrees and whose channel is 2 L0 wide; Lajeunesse, Monnier, Homsy 2005 (Phys. Fluids 17, 103302) found the
same powers, with glass beads of 22 degrees, 45 mm between walls. --angle 22 --width 45: such beads, L0 = 100 mm; walls rub as
smooth glass does, tan 13 (Jop, Forterre, Pouliquen 2005, J. Fluid Mech. 541), and half of the channel is simulated. A deposit
ends where it is less than L0 / 50 deep: grains that roll on alone do not count. The edge of what is L0 / 20 deep is told too: a
continuum has a thin tip that no grains have, and its end depends on cells; the heap behind it does not.

Hourglass: a silo 0.4 m wide with rough walls and a slot in its flat bottom, a plate 25 mm thick whatever the cells are, plane
strain. Beverloo, Leniger, van de Velde 1961: the rate does not depend on the height. In plane strain it is
C rho sqrt(g) (D - k d)^(3/2), d the size of grains; cells take their place here. Rates are told for each quarter of a second.
"""

import argparse
import time

import numpy as np

import wsim
from wsim.physics.mpm.objects import Granular

GRAVITY, ANGLE = 9.81, 30.0
GLASS = float(np.tan(np.radians(13.0)))        # friction of beads on a smooth wall
LENGTH = 0.1               # L0 of columns [m]
THIN, HEAP = 0.02, 0.05    # L0: depth at the edge of a deposit, and of the heap without its tip
PLATE = 0.0125             # half of the thickness of an hourglass's bottom [m]
ROUGH = 10.0               # friction of a floor on which nothing slides


def add_wall(scene: wsim.Scene, name: str, axis: str, place: float, inward: float, friction: float = 0.0) -> None:
    """A plane across an axis, at that place [m], that keeps what is on the side where the axis grows (inward 1) or falls."""
    turned = np.diag([inward, 1.0, inward, 1.0])
    turned["XYZ".index(axis), 3] = place
    scene.collider(f"/{name}", wsim.Plane(axis), motion=wsim.Motion.still(turned), static_friction=friction,
                   dynamic_friction=friction)


def make_scene(width: float, floor: float, side: float = 0.0) -> wsim.Scene:
    """A floor with that friction, and walls across z: at 0, which is smooth, and at `width`, with friction `side`."""
    scene = wsim.Scene(fps=60)
    scene.collider("/floor", wsim.Plane(), static_friction=floor, dynamic_friction=floor)
    add_wall(scene, "near", "Z", 0.0, 1.0)
    add_wall(scene, "far", "Z", width, -1.0, side)
    return scene


def run_slope(degrees: float, device: str, integrator: str, depth: float = 0.1, length: float = 12.0, cell: float = 0.025,
              seconds: float = 0.9) -> tuple[float, float]:
    """Speed of the middle of a layer on a slope at the end [m/s], and its acceleration in the second half [m/s^2]; printed."""
    scene = make_scene(2 * cell, ROUGH)
    scene.gravity = (0.0, 0.0, 0.0)
    add_wall(scene, "head", "X", -0.5 * length, 1.0)
    add_wall(scene, "toe", "X", 0.5 * length, -1.0)
    scene.mpm("/sand", wsim.Box((0.5 * length, 0.5 * depth, cell)), at=(0, 0.5 * depth, cell), cell=cell,
              material=Granular(young=2.5e6 * depth, friction_angle=np.radians(ANGLE)), integrator=integrator)
    simulation = wsim.Simulation(scene, device=device)
    x = simulation.samples()[0].positions
    middle = (np.abs(x[:, 0]) < 0.5) & (x[:, 1] > 0.7 * depth)
    tilt, seen, began = np.radians(degrees), [], time.process_time()
    for frame in range(1, int(60 * seconds) + 1):
        part = GRAVITY * min(1.0, frame / 20)
        if frame <= 20:
            simulation.set("/", "gravity", (part * np.sin(tilt), -part * np.cos(tilt), 0.0))
        simulation.step()
        seen.append(float(simulation.samples()[0].velocities[middle, 0].mean()))
    moved = float((simulation.samples()[0].positions - x)[middle, 0].mean())
    half = len(seen) // 2
    rate = 60.0 * (seen[-1] - seen[half]) / (len(seen) - 1 - half)
    theory = max(0.0, GRAVITY * (np.sin(tilt) - np.cos(tilt) * np.tan(np.radians(ANGLE))))
    print(f"slope of {degrees:g} degrees, angle {ANGLE:g}: {len(x)} particles, at {seconds:g} s {1e3 * seen[-1]:.1f} mm/s, "
          f"moved {1e3 * moved:.1f} mm, acceleration {rate:.3f} m/s^2 (without ends {theory:.3f}), "
          f"{time.process_time() - began:.0f} CPU s", flush=True)
    return seen[-1], rate


def deposit_edge(x: np.ndarray, volume: np.ndarray, width: float, cell: float, thin: float = THIN) -> float:
    """Where a deposit becomes thinner than `thin` L0 [m], by the volume above each cell of the floor."""
    edges = np.arange(0.0, x.max() + 2.0 * cell, cell)
    depth = np.histogram(x, edges, weights=volume)[0] / (cell * width)
    return float(edges[np.flatnonzero(depth <= thin * LENGTH)[0]])


def expected_runout(aspect: float) -> float:
    """(L - L0) / L0."""
    return 1.2 * aspect if aspect <= 2.3 else 1.9 * aspect ** (2.0 / 3.0)


def run_column(aspect: float, device: str, integrator: str, channel: float, cells: int, angle: float = ANGLE,
               young: float = 2e5) -> float:
    """Run-out of a column [L0] in a channel so wide [m], 0: plane strain; printed."""
    cell, height = LENGTH / cells, aspect * LENGTH
    width = cell * max(2.0, round(channel / cell) / 2)
    scene = make_scene(width, ROUGH, GLASS if channel else 0.0)
    add_wall(scene, "wall", "X", 0.0, 1.0)
    scene.mpm("/sand", wsim.Box((0.5 * LENGTH, 0.5 * height, 0.5 * width)), at=(0.5 * LENGTH, 0.5 * height, 0.5 * width),
              cell=cell, material=Granular(young=young, friction_angle=np.radians(angle)), integrator=integrator)
    simulation = wsim.Simulation(scene, device=device)
    began = time.process_time()
    simulation.run(int(60 * 5.0 * np.sqrt(height / GRAVITY)) + 6)
    sample = simulation.samples()[0]
    x, volume = sample.positions, np.pi / 6.0 * sample.widths**3
    found, theory = deposit_edge(x[:, 0], volume, width, cell) / LENGTH - 1.0, expected_runout(aspect)
    print(f"column a = {aspect:g}, angle {angle:g}, channel {2e3 * width if channel else 0:.0f} mm, {cells} cells: {len(x)} "
          f"particles, run-out {found:.2f} L0 ({theory:.2f}, {100 * (found / theory - 1):+.0f} %), of the heap "
          f"{deposit_edge(x[:, 0], volume, width, cell, HEAP) / LENGTH - 1.0:.2f}, 99.5 % of it within "
          f"{np.quantile(x[:, 0], 0.995) / LENGTH - 1.0:.2f}, height {x[:, 1].max() / LENGTH:.2f} L0, "
          f"{time.process_time() - began:.0f} CPU s", flush=True)
    return found


def run_hourglass(height: float, device: str, integrator: str, slot: float = 0.1, cell: float = 0.0125, half: float = 0.2,
                  seconds: float = 1.6) -> float:
    """Mass a second and metre of depth that falls through a slot [kg/(s m)], from 40 % of the time on; printed."""
    width = 2 * cell
    scene = wsim.Scene(fps=60)
    add_wall(scene, "near", "Z", 0.0, 1.0)
    add_wall(scene, "far", "Z", width, -1.0)
    reach = 0.5 * (half - 0.5 * slot) + 0.1                    # half of a bottom plate, which goes on under the wall
    for name, side in (("left", -1.0), ("right", 1.0)):
        scene.collider(f"/bottom_{name}", wsim.Box((reach, PLATE, 0.2)), at=(side * (0.5 * slot + reach), -PLATE, 0.5 * width),
                       static_friction=0.6, dynamic_friction=0.6)
        add_wall(scene, f"wall_{name}", "X", side * half, -side, 0.5)
    scene.mpm("/sand", wsim.Box((half, 0.5 * height, 0.5 * width)), at=(0, 0.5 * height, 0.5 * width), cell=cell,
              material=Granular(young=1e6, friction_angle=np.radians(ANGLE)), integrator=integrator)
    simulation = wsim.Simulation(scene, device=device)
    began, mass = time.process_time(), []
    each = Granular().density * (0.5 * cell) ** 3 / width
    for _ in range(int(60 * seconds)):
        simulation.step()
        mass.append(each * np.count_nonzero(simulation.samples()[0].positions[:, 1] < -2 * PLATE))
    times, first = np.arange(1, len(mass) + 1) / 60.0, int(0.4 * len(mass))
    rate = float(np.polyfit(times[first:], mass[first:], 1)[0])
    factor = rate / (Granular().density * np.sqrt(GRAVITY) * slot**1.5)
    quarters = " ".join(f"{4.0 * (mass[k + 15] - mass[k]):.0f}" for k in range(15, len(mass) - 15, 15))
    left = 1.0 - mass[-1] / (Granular().density * 2 * half * height)
    print(f"hourglass {height:g} m high, slot {1e3 * slot:g} mm, {slot / cell:g} cells: {rate:.1f} kg/(s m), {factor:.3f} "
          f"rho sqrt(g) D^1.5, by quarters of a second {quarters}, {100 * left:.0f} % left, "
          f"{time.process_time() - began:.0f} CPU s", flush=True)
    return rate


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--slope", type=float, nargs="*", default=[29.0, 31.0])
    parser.add_argument("--column", type=float, nargs="*", default=[0.6, 1.0, 2.0, 3.0, 5.0])
    parser.add_argument("--hourglass", type=float, nargs="*", default=[0.4, 0.8, 1.2])
    parser.add_argument("--width", type=float, default=0.0, help="of the channel of columns [mm]; 0: plane strain")
    parser.add_argument("--angle", type=float, default=ANGLE, help="friction angle of columns [degrees]")
    parser.add_argument("--cells", type=int, default=16, help="along L0 of columns")
    parser.add_argument("--slot", type=float, default=100.0, help="of the hourglass [mm]")
    parser.add_argument("--across", type=float, default=8.0, help="cells of its slot")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--integrator", default="explicit", choices=("explicit", "implicit"))
    given = parser.parse_args()
    for degrees in given.slope:
        run_slope(degrees, given.device, given.integrator)
    for aspect in given.column:
        run_column(aspect, given.device, given.integrator, 1e-3 * given.width, given.cells, given.angle)
    for height in given.hourglass:
        run_hourglass(height, given.device, given.integrator, 1e-3 * given.slot, 1e-3 * given.slot / given.across)


if __name__ == "__main__":
    main()
