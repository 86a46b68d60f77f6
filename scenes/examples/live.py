"""A hung cloth that a hand pushes, live: every sixtieth of a second Python moves the hand (a collider), the rail that holds the
cloth (its pins) and a dial (how stiff the fabric is), steps a frame, and has the positions where they are, on the device.

    python scenes/examples/live.py [--garment] [--seconds 10] [--points 33] [--device cuda:0] [--view] [--at-once]

--garment   the shirt of scenes/shirt.usda, hung by its collar, in place of a sheet
--view      shows it in rerun (extra `view`), which copies positions to the host
--at-once   does not wait for the clock: how many frames a second it could do

Positions go to PyTorch where that is installed: `torch.from_dlpack` of the simulation's own array, one gather into the author's
order. Without it they stay a Warp array. What is printed is the time of a frame from the first move of the hand until positions
are there: median, 99th percentile and most, and how many of the frames came too late for the clock.
"""

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import warp as wp

from wsim import Fabric, Motion, Scene, Simulation, Sphere
from wsim.scene import shapes
from wsim.simulation.measure.views import arrays

RATE = 60.0                    # frames a second
HAND = 0.12                    # [m] radius
KNIT = Fabric(stretch=200.0, shear=60.0, bend=1e-5, density=200.0, thickness=1e-3, static_friction=0.3, dynamic_friction=0.3,
              damping=1e-4)
HELD = 0.02                    # [m] of a garment's highest points on either side, that the rail holds
SETTLED = 10                   # frames that are not counted


def curtain(points: int) -> Scene:
    """A square metre in front of the hand, on a rail."""
    scene = Scene(fps=RATE, air_drag=0.5)
    cloth = scene.cloth("/garment", *shapes.sheet(1.0, 1.0, points - 1, points - 1), material=KNIT)
    height = cloth.points[:, 1]
    scene.pin("/rail", cloth, np.flatnonzero(height > height.max() - 1e-6))
    return scene


def shirt() -> Scene:
    """A shirt without a body in it, held at both ends of its collar."""
    from wsim.usd import load
    scene = load(str(Path(__file__).resolve().parents[1] / "shirt.usda"))
    scene = replace(scene, fps=RATE, substeps=40, colliders=[], frames=0)
    scene.cloths[0].path = "/garment"
    p = scene.cloths[0].motion.points(scene.cloths[0].points, 0.0)
    right, held = p[:, 0] > p[:, 0].mean(), []
    for half in (np.flatnonzero(right), np.flatnonzero(~right)):
        top = half[np.argmax(p[half, 1])]
        held += np.flatnonzero(np.linalg.norm(p - p[top], axis=1) < HELD).tolist()
    scene.pin("/rail", scene.cloths[0], sorted(set(held)))
    return scene


class Hands:
    """What a user does: where hand, rail and dial are at a time [s]. A real one reads a device here."""

    def __init__(self, scene: Scene):
        p = scene.cloths[0].motion.points(scene.cloths[0].points, 0.0)
        self.middle, self.size, self.stretch = 0.5 * (p.min(axis=0) + p.max(axis=0)), np.ptp(p, axis=0), \
            scene.cloths[0].material.stretch

    def hand(self, t: float) -> tuple[float, ...]:
        """It goes into the cloth and out of it, and from side to side."""
        x, z = 0.3 * np.sin(1.1 * t), 0.5 * self.size[2] + HAND + 0.15 - 0.25 * np.sin(2.0 * t)**2
        return tuple(self.middle + (x * self.size[0], -0.1 * self.size[1], z))

    def rail(self, t: float) -> tuple[float, ...]:
        return 0.05 * np.sin(1.7 * t), 0.0, 0.0

    def dial(self, t: float) -> float:
        """Stretch stiffness [N/m]."""
        return self.stretch * (0.8 + 0.2 * np.cos(0.7 * t))

    def way(self, place, t: float) -> Motion:
        """From where it is to where it will be a frame later: it has a velocity, where a jump has none."""
        matrices = np.stack([np.eye(4)] * 2)
        matrices[:, :3, 3] = place(t), place(t + 1.0 / RATE)
        return Motion([t, t + 1.0 / RATE], matrices)


def positions(sim: Simulation):
    """(points, 3) [m] in the author's order, on the device: a tensor, or without PyTorch the array itself."""
    view = arrays(sim)["positions"]
    try:
        import torch
    except ImportError:
        return view.array
    x = torch.from_dlpack(view)
    return x[torch.as_tensor(view.index["/garment"], device=x.device)] + torch.as_tensor(
        view.origin["/garment"], dtype=x.dtype, device=x.device)


def move(sim: Simulation, user: Hands) -> None:
    t = sim.time
    sim.set("/hand", "motion", user.way(user.hand, t))
    sim.set("/rail", "motion", user.way(user.rail, t))
    sim.set("/garment", "stretch", user.dial(t))


def run(scene: Scene, frames: int, device=None, viewer=None, at_once: bool = True, clock=time.perf_counter,
        fps: float | None = None) -> dict:
    """clock: of the times of frames; they wait by the wall's. fps: frames a second that the setting is to hold."""
    user = Hands(scene)
    scene.collider("/hand", Sphere(HAND), at=user.hand(0.0), static_friction=0.3, dynamic_friction=0.3)
    sim = Simulation(scene, device=device, fps=fps)
    move(sim, user)
    sim.prepare()
    captured = sim.seconds.get("capture")
    show, took, late, due = viewer(scene) if viewer else None, [], 0, time.perf_counter()
    for _ in range(frames + SETTLED):
        began = clock()
        move(sim, user)
        sim.step()
        x = positions(sim)
        wp.synchronize_device(sim.device)
        took.append(1e3 * (clock() - began))
        if show:
            show.log(sim)
        due += 1.0 / RATE
        if not at_once:
            late += time.perf_counter() > due
            time.sleep(max(0.0, due - time.perf_counter()))
            due = max(due, time.perf_counter() - 1.0 / RATE)
    ms = np.array(took[SETTLED:])
    return {"ms": ms, "median": float(np.median(ms)), "p99": float(np.percentile(ms, 99)), "most": float(ms.max()),
            "late": late, "positions": x, "simulation": sim, "captured": captured}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for flag in ("--garment", "--view", "--at-once"):
        parser.add_argument(flag, action="store_true")
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--points", type=int, default=33, help="a side of the sheet")
    parser.add_argument("--device", default=None)
    args = parser.parse_args()
    if args.view:
        from wsim.show.viewer import Viewer
    r = run(shirt() if args.garment else curtain(args.points), round(args.seconds * RATE), args.device,
            Viewer if args.view else None, args.at_once, fps=RATE)
    sim = r["simulation"]
    print(f"{sim.model.points} points on {sim.device}, {sim.plan.clock.substeps} substeps of {sim.plan.choice.solver}; a frame "
          f"takes {r['median']:.3g} ms (median), {r['p99']:.3g} (99 of 100), {r['most']:.3g} at most")
    if not args.at_once:
        print(f"{r['late']} of {len(r['ms']) + SETTLED} frames came later than the clock of {RATE:g} Hz")
    print("\n".join([sim.plan.choice.why, *dict.fromkeys(sim.warnings)]))
