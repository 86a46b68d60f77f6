"""The same water by three methods: fluid by constraints, liquid on a grid, material points; python -m tools.bench.soft.waters

A dam: a column a wide, 2 a high, a / 2 deep between walls of no friction, particles a / 16 apart (4096), until its front has
come to 4 a. Front: of the foremost particle, against table 2 of Martin and Moyce 1952 (n^2 = 2), whose membrane takes 0.28 of
t sqrt(2 g / a) to go; the error is the largest of the table. A tank: 1000 particles at rest, ten along each edge, for 5 s;
height of the centre of mass over that at the start, greatest speed at the end. Time: of the processor, after kernels are
compiled, a frame of 1/60 s, and over a second of water. Runs of one method follow runs of the others, thrice; the least counts.
"""

import time
from collections.abc import Callable

import numpy as np

import wsim
from wsim.physics.mpm.objects import Water

G = 9.81
MARTIN_MOYCE = np.array([(0.84, 1.22), (1.19, 1.44), (1.43, 1.67), (1.63, 1.89), (1.83, 2.11), (1.98, 2.33), (2.20, 2.56),
                         (2.32, 2.78), (2.51, 3.00), (2.65, 3.22), (2.83, 3.44), (2.98, 3.67), (3.11, 3.89), (3.33, 4.11)])
LATE = 0.28
TURNS = 3


def channel(scene: wsim.Scene, low: np.ndarray, high: np.ndarray) -> None:
    """Planes without friction on five sides of a box [m]."""
    for name, n, at in (("floor", (0, 1, 0), low), ("left", (1, 0, 0), low), ("right", (-1, 0, 0), high),
                        ("back", (0, 0, 1), low), ("front", (0, 0, -1), high)):
        normal = np.array(n, float)
        side = np.eye(3)[(int(np.argmax(np.abs(normal))) + 1) % 3]
        M = np.eye(4)
        M[:3, :3], M[:3, 3] = np.stack([side, np.cross(normal, side), normal], axis=1), at
        scene.collider(f"/{name}", wsim.Plane(), motion=wsim.Motion.still(M), static_friction=0.0, dynamic_friction=0.0)


def by_constraints(substeps: int, iterations: int) -> Callable:
    def fill(low, high, size, d):
        scene = wsim.Scene(fps=60, substeps=substeps, iterations=iterations)
        channel(scene, low, high)
        scene.particles("/water", wsim.Box(tuple(0.5 * size)), at=low + 0.5 * size, radius=0.5 * d, material="fluid")
        return scene, lambda sim: (sim.positions("/water"), sim.velocities("/water"))
    return fill


def by_grid(low, high, size, d):
    scene = wsim.Scene(fps=60)
    tank = scene.liquid("/tank", low, high, cell=2.0 * d)
    scene.liquid_source("/water", tank, wsim.Box(tuple(0.5 * size)), at=low + 0.5 * size)
    return scene, _sampled("/tank_drops")


def by_points(bulk: float) -> Callable:
    def fill(low, high, size, d):
        scene = wsim.Scene(fps=60)
        channel(scene, low, high)
        scene.mpm("/water", wsim.Box(tuple(0.5 * size)), at=low + 0.5 * size, cell=2.0 * d, material=Water(bulk=bulk))
        return scene, _sampled("/water_drops")
    return fill


def _sampled(path: str) -> Callable:
    def read(sim):
        found = next(sample for sample in sim.samples() if sample.path == path)
        return found.positions, found.velocities
    return read


METHODS = {"constraints, 8 x 4": by_constraints(8, 4), "constraints, 4 x 4": by_constraints(4, 4), "liquid on a grid": by_grid,
           "material points, bulk 1e5 Pa": by_points(1e5), "material points, bulk 1e6 Pa": by_points(1e6)}


def dam(fill: Callable, a: float = 0.12) -> tuple[int, float, float]:
    """(particles, CPU time a frame [s], largest error of the front)."""
    d, zero = a / 16, np.zeros(3)
    scene, read = fill(zero, np.array([5.0 * a, 4.0 * a, 0.5 * a]), np.array([a, 2.0 * a, 0.5 * a]), d)
    scale, sim, front, spent = np.sqrt(2.0 * G / a), wsim.Simulation(scene, device="cpu"), [1.0], 0.0
    sim.load()
    frames = int(np.ceil((MARTIN_MOYCE[-1, 0] - LATE) / scale * 60.0)) + 1
    for _ in range(frames):
        begin = time.process_time()
        sim.step()
        spent += time.process_time() - begin
        front.append((read(sim)[0][:, 0].max() + 0.5 * d) / a)
    now = np.interp((MARTIN_MOYCE[:, 0] - LATE) / scale * 60.0, np.arange(frames + 1), front)
    return len(read(sim)[0]), spent / frames, float(np.abs(now / MARTIN_MOYCE[:, 1] - 1.0).max())


def tank(fill: Callable, frames: int = 300) -> tuple[float, float, float]:
    """(CPU time a frame [s], height over that at the start, greatest speed at the end [m/s])."""
    low, size = np.array([-0.1, 0.0, -0.1]), np.full(3, 0.2)
    scene, read = fill(low, np.array([0.1, 0.32, 0.1]), size, 0.02)
    sim, spent = wsim.Simulation(scene, device="cpu"), 0.0
    sim.load()
    height = read(sim)[0][:, 1].mean()
    for _ in range(frames):
        begin = time.process_time()
        sim.step()
        spent += time.process_time() - begin
    x, v = read(sim)
    return spent / frames, float(x[:, 1].mean() / height), float(np.linalg.norm(v, axis=1).max())


def main() -> None:
    dams, tanks = ({name: [] for name in METHODS} for _ in range(2))  # type: dict[str, list], dict[str, list]
    for _ in range(TURNS):
        for name, fill in METHODS.items():
            dams[name].append(dam(fill))
            tanks[name].append(tank(fill))
    print(f"{'':30} particles  dam ms a frame   us a particle  front   tank ms a frame  height    speed")
    for name in METHODS:
        count, spent, error = min(dams[name], key=lambda row: row[1])
        still, height, speed = min(tanks[name])
        print(f"{name:30} {count:9d}  {1e3 * spent:14.1f}  {1e6 * spent / count:14.1f}  {100 * error:4.1f} %  "
              f"{1e3 * still:16.1f}  {height:.4f}  {speed:.1e}", flush=True)


if __name__ == "__main__":
    main()
