"""Speed of explicit material points: a cube that falls on a floor and stays in one piece, sorting and all launches included.

    PYTHONPATH=. python tools/bench/soft/mpm/speed.py [--device cpu] [--material jelly sand] [--threads 1 2] [--across 40]

Time is of the best frame of ten, by the clock: others may use the machine. CPU time is that of all threads, over all frames.
Threads are those of a CPU; the places of particles behind all frames, as a digest, are the same for any number of them.
"""

import argparse
import hashlib
import time

import wsim
from wsim.physics.mpm import tile_grid
from wsim.physics.mpm.objects import Granular, Jelly

MATERIALS = {"jelly": Jelly(young=1e5), "sand": Granular(young=2e5)}
FRAMES = 10


def measure_speed(name: str, across: int, device: str, threads: int) -> float:
    """Million particle steps a second of a cube so many particles across; printed."""
    tile_grid.count_cores = lambda: threads
    scene, half = wsim.Scene(fps=60), 0.01 * across
    scene.collider("/floor", wsim.Plane(), static_friction=0.5, dynamic_friction=0.5)
    scene.mpm("/cube", wsim.Box((half, half, half)), at=(0, half + 0.001, 0), cell=0.04, material=MATERIALS[name],
              integrator="explicit")
    simulation = wsim.Simulation(scene, device=device)
    method = next(m for m in simulation.plan.methods if m.name == "mpm")
    for _ in range(4):                                         # two are launched one by one, or without helpers
        simulation.step()
    best, steps, began = float("inf"), 0, time.process_time()
    for _ in range(FRAMES):
        wall = time.perf_counter()
        simulation.step()
        now = int(method.status.said("mpm: grid")[3])
        best, steps = min(best, (time.perf_counter() - wall) / now), steps + now
    cpu, count = time.process_time() - began, method.part.count
    digest = hashlib.md5(simulation.samples()[0].positions.tobytes(), usedforsecurity=False).hexdigest()[:8]
    where = f"{device}, {threads} threads" if device == "cpu" else device
    print(f"{name}, {count} particles, {where}: {1e3 * best:.3f} ms a step, "
          f"{count / best / 1e6:.1f} million particle steps a second, {count * steps / cpu / 1e6:.1f} of CPU time; "
          f"{steps} steps, places {digest}", flush=True)
    return count / best / 1e6


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--material", nargs="*", default=list(MATERIALS), choices=list(MATERIALS))
    parser.add_argument("--threads", type=int, nargs="*", default=[1, 2])
    parser.add_argument("--across", type=int, default=40, help="particles along an edge of the cube")
    given = parser.parse_args()
    for name in given.material:
        for threads in given.threads if given.device == "cpu" else [1]:
            measure_speed(name, given.across, given.device, threads)


if __name__ == "__main__":
    main()
