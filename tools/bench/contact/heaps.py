"""Heaps, deep piles and laws of grains: python -m tools.bench.contact.heaps WHAT ... [options]

    heap GRAINS SECONDS MORE ROW ...      a loose column twice as high as wide collapses for SECONDS, and goes on for MORE
    pile ACROSS LAYERS FRAMES ROW ...     loose grains fall together between walls without friction
    slip MU ROW ...       a plate tilts by 4 degrees a second under a block of 27, about six axes: where it slips [degrees]
    silo ACROSS ROW ...   the floor of a square silo sinks: weight on it, of heights of 1 to 4 widths, over Janssen's
    press ACROSS ROW ...  grains without friction between walls: forces of floor and walls, over those of a liquid
    free GRAINS ROW ...   two balls of grains meet without gravity: change of momentum and angular momentum, over m v and m v R

ROW is SUBSTEPSxITERATIONS. Grains have 8 mm and 2600 kg/m^3; frames take 1/60 s. --mu: friction of all contacts. --mixed: radii
from 2 to 6 mm. Time is of a frame, the median: CPU time, or wall time on a GPU. Overlaps are of pairs that touch, over the
distance of their centres at rest. Janssen 1895: p(z) = p_m (1 - exp(-z / z_m)), z_m = D / (4 mu K), p_m = rho g z_m, with D the
width; K is fitted to the four heights.
"""

import argparse
import time

import numpy as np
import warp as wp

import wsim
from tools.bench.contact.peer_grains import column, slope
from wsim.physics.position_based.objects import Grains

RADIUS, DENSITY, G, FPS = 0.004, 2600.0, 9.81, 60
MASS = DENSITY * 4.0 / 3.0 * np.pi * RADIUS**3


def make_scene(row: str, mu: float, **more) -> wsim.Scene:
    """An empty one of so many substeps and iterations, with a floor unless told otherwise."""
    substeps, iterations = map(int, row.split("x"))
    floor = more.pop("floor", True)
    scene = wsim.Scene(fps=FPS, substeps=substeps, iterations=iterations, **more)
    if floor:
        scene.collider("/floor", wsim.Plane(), static_friction=mu, dynamic_friction=mu)
    return scene


def add_walls(scene: wsim.Scene, half: float, mu: float) -> None:
    """Four planes around a square."""
    for k, n in enumerate(([1, 0, 0], [-1, 0, 0], [0, 0, 1], [0, 0, -1])):
        pose, x = np.eye(4), np.cross([0, 1, 0], n)
        pose[:3, :3], pose[:3, 3] = np.stack([x, np.cross(n, x), n], axis=1), -half * np.array(n)
        scene.collider(f"/wall_{k}", wsim.Plane(), motion=wsim.Motion.still(pose), static_friction=mu, dynamic_friction=mu)


def lattice(nx: int, ny: int, half: float = 1.1 * RADIUS, loose: float = 0.1) -> np.ndarray:
    """Places (nx ny nx, 3) [m] in layers on y = 0, moved at random by `loose` radii."""
    k = np.stack(np.meshgrid(np.arange(nx), np.arange(ny), np.arange(nx), indexing="ij"), -1).reshape(-1, 3)
    return (2 * k + 1) * half - [nx * half, 0.0, nx * half] + loose * RADIUS * np.random.default_rng(0).uniform(-1, 1, k.shape)


def overlaps(x: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """Overlap of each pair that touches [1]."""
    from scipy.spatial import cKDTree
    i, j = cKDTree(x).query_pairs(2.0 * radii.max(), output_type="ndarray").T
    R = radii[i] + radii[j]
    found = 1.0 - np.linalg.norm(x[i] - x[j], axis=1) / R
    return found[found > 0.0] if (found > 0.0).any() else np.zeros(1)


class Run:
    """A simulation whose frames are timed, and whose greatest overlaps are kept."""

    def __init__(self, scene: wsim.Scene, device: str):
        wp.config.log_level = wp.LOG_WARNING
        self.simulation = wsim.Simulation(scene, device=device)
        self.clock = time.process_time if device == "cpu" else time.perf_counter
        self.times: list[float] = []
        self.worst = 0.0
        self.method = next(m for m in self.simulation.plan.methods if m.name == "grains")

    def step(self, frames: int) -> None:
        for _ in range(frames):
            start = self.clock()
            self.simulation.step()
            wp.synchronize()
            self.times.append(1e3 * (self.clock() - start))
            if len(self.times) % 5 == 0:
                self.worst = max(self.worst, self.method.indicators(None, None)["grain_overlap"])

    def force(self, path: str) -> np.ndarray:
        """That grains give a collider in the last substep [N]."""
        h = 1.0 / (FPS * self.simulation.plan.clock.substeps)
        return self.simulation.plan.method("contact").contacts.impulses(h)[path] / h

    @property
    def places(self) -> np.ndarray:
        return self.simulation.positions().astype(float)

    @property
    def speeds(self) -> np.ndarray:
        return np.linalg.norm(self.simulation.velocities(), axis=1)


def heap(args) -> None:
    x = column(args.grains)
    radii = np.full(len(x), RADIUS)
    if args.mixed:
        radii = RADIUS * np.random.default_rng(1).uniform(0.5, 1.5, len(x))
        x = x * 1.3 + [0.0, 0.5 * RADIUS, 0.0]
    print("| grains | row | carried | ms | rests since | slope | overlap: worst, end, 1 % | v | way mean, most | sinks |")
    for row in args.rows:
        scene = make_scene(row, args.mu)
        scene.particles("/grains", points=x, radius=radii if args.mixed else RADIUS,
                        material=Grains(static_friction=args.mu, dynamic_friction=args.mu, rolling_friction=args.rolling))
        run, rested = Run(scene, args.device), None
        for k in range(round(args.seconds * FPS) // 30):
            run.step(30)
            rested = (rested or (k + 1) / 2) if run.speeds.max() < 1e-3 else None
        before, v, last = run.places, run.speeds, run.method.indicators(None, None)["grain_overlap"]
        run.step(round(args.more * FPS))
        way = np.linalg.norm(run.places - before, axis=1)
        print(f"| {len(x)} | {row} | {run.method.deep} | {np.median(run.times[2:]):.1f} | {rested} | {slope(before):.2f} | "
              f"{run.worst:.3f}, {last:.3f}, {np.quantile(overlaps(before, radii), 0.99):.4f} | "
              f"{np.sqrt((v**2).mean()):.1e}, {v.max():.1e} | {way.mean():.1e}, {way.max():.1e} | "
              f"{before[:, 1].mean() - run.places[:, 1].mean():.1e} |", flush=True)


def pile(args) -> None:
    x = lattice(args.across, args.layers)
    print("| grains | row | ms, most | overlap: worst of all frames, end | mean, 1 % | height of the centre | v rms |")
    for row in args.rows:
        scene = make_scene(row, args.mu)
        add_walls(scene, 1.1 * RADIUS * args.across, 0.0)
        scene.particles("/grains", points=x, radius=RADIUS, material=Grains(static_friction=args.mu, dynamic_friction=args.mu))
        run = Run(scene, args.device)
        run.step(args.frames)
        o = overlaps(run.places, np.full(len(x), RADIUS)) if len(x) < 2e5 else np.full(1, np.nan)
        print(f"| {len(x)} | {row} | {np.median(run.times[2:]):.2f}, {max(run.times[2:]):.1f} | {run.worst:.3f}, "
              f"{run.method.indicators(None, None)['grain_overlap']:.3f} | {o.mean():.4f}, {np.quantile(o, 0.99):.3f} | "
              f"{run.places[:, 1].mean():.4f} | {np.sqrt((run.speeds**2).mean()):.1e} |", flush=True)


def tilted(angle: float, axis: float) -> np.ndarray:
    """A pose that turns by `angle` about a level axis, which stands at `axis` from x [rad]."""
    k = np.array([np.cos(axis), 0.0, np.sin(axis)])
    K, pose = np.cross(np.eye(3), -k), np.eye(4)
    pose[:3, :3] += np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K
    return pose


def slip(args) -> None:
    print("| mu | row | atan(mu) | slips at [degrees], by axis |")
    for row in args.rows:
        expected, found = np.degrees(np.arctan(args.mu)), []
        start = expected - 5.0
        for axis in np.radians([0, 15, 30, 45, 70, 200]):
            t = np.arange(0, 181) / FPS
            tilt = np.radians(np.clip(start + 4.0 * (t - 0.5), start, None))
            scene = make_scene(row, args.mu, floor=False)
            poses = np.stack([tilted(a, axis) for a in tilt])
            scene.collider("/plate", wsim.Plane("Y"), motion=wsim.Motion(t, poses), static_friction=args.mu,
                           dynamic_friction=args.mu)
            x = lattice(3, 3, RADIUS, 0.0) @ poses[0][:3, :3].T
            scene.particles("/grains", points=x, radius=RADIUS,
                            material=Grains(static_friction=args.mu, dynamic_friction=args.mu))
            run = Run(scene, args.device)
            run.step(24)
            at, frame = run.places.mean(axis=0) @ poses[24][:3, :3], 24
            speed, rate = 0.0, np.radians(4.0)
            while frame < 180 and speed < 0.02:                    # [m/s] along the plate
                run.step(1)
                frame += 1
                now = run.places.mean(axis=0) @ poses[frame][:3, :3]
                speed, at = FPS * np.linalg.norm((now - at)[[0, 2]]), now
            since = np.sqrt(2.0 * speed * np.cos(tilt[frame]) / (G * rate))              # v = g rate t^2 / (2 cos)
            found.append(np.degrees(tilt[frame] - rate * (since + 0.5 / FPS)))
        print(f"| {args.mu} | {row} | {expected:.2f} | {', '.join(f'{a:.2f}' for a in found)} |", flush=True)


def silo(args) -> None:
    D = 2.2 * RADIUS * args.across
    print("| row | height over width, weight on the floor over all | K | Janssen's with that K | v rms |")
    for row in args.rows:
        z, part, mass, still = [], [], [], []
        for widths in (1, 2, 3, 4):
            scene = make_scene(row, args.mu, floor=False)
            t = np.arange(0, 241) / FPS
            poses = np.tile(np.eye(4), (len(t), 1, 1))
            poses[:, 1, 3] = -0.002 * np.clip(t - 1.5, 0.0, None)
            scene.collider("/floor", wsim.Plane("Y"), motion=wsim.Motion(t, poses), static_friction=args.mu,
                           dynamic_friction=args.mu)
            add_walls(scene, 0.5 * D, args.mu)
            across = int(args.across * 2.2 / 2.6)                          # loose: a lattice would stand off the walls
            x = lattice(across, int(1.3 * widths * args.across), 1.3 * RADIUS, 0.4)
            scene.particles("/grains", points=x, radius=RADIUS,
                            material=Grains(static_friction=args.mu, dynamic_friction=args.mu))
            run, borne = Run(scene, args.device), []
            run.step(120)
            for _ in range(90):
                run.step(1)
                borne.append(-run.force("/floor")[1])
            weight = len(x) * MASS * G
            z.append(np.quantile(run.places[:, 1], 0.99) + RADIUS - poses[210, 1, 3])
            part.append(np.mean(borne) / weight)
            mass.append(len(x))
            still.append(np.sqrt((run.speeds**2).mean()))
        z, part = np.array(z), np.array(part)
        Ks = np.linspace(0.02, 3.0, 2981)
        s = 4.0 * args.mu * Ks[:, None] * z / D
        K = Ks[np.argmin((((1.0 - np.exp(-s)) / s - part) ** 2).sum(axis=1))]
        s = 4.0 * args.mu * K * z / D
        print(f"| {row} | {', '.join(f'{a:.2f}: {p:.3f}' for a, p in zip(z / D, part, strict=True))} | {K:.2f} | "
              f"{', '.join(f'{p:.3f}' for p in (1.0 - np.exp(-s)) / s)} | {max(still):.1e} |", flush=True)


def press(args) -> None:
    print("| row | floor over weight | walls over rho g z^2 / 2 | overlap | v rms |")
    for row in args.rows:
        scene = make_scene(row, 0.0)
        half = 1.1 * RADIUS * args.across
        add_walls(scene, half, 0.0)
        x = lattice(args.across, 2 * args.across)
        scene.particles("/grains", points=x, radius=RADIUS, material=Grains(static_friction=0.0, dynamic_friction=0.0))
        run, floor, walls = Run(scene, args.device), [], []
        run.step(180)
        for _ in range(60):
            run.step(1)
            floor.append(-run.force("/floor")[1])
            walls.append(np.mean([np.abs(run.force(f"/wall_{k}")).max() for k in range(4)]))
        weight = len(x) * MASS * G
        level = 2.0 * run.places[:, 1].mean()                                  # of a body of even density
        o = overlaps(run.places, np.full(len(x), RADIUS))
        print(f"| {row} | {np.mean(floor) / weight:.4f} | {np.mean(walls) / (weight * level / (4.0 * half)):.3f} | "
              f"{np.quantile(o, 0.99):.4f} | {np.sqrt((run.speeds**2).mean()):.1e} |", flush=True)


def free(args) -> None:
    print("| grains | row | momentum | angular momentum | most overlap |")
    side = int(np.ceil((args.grains * 1.1) ** (1.0 / 3.0)))
    for row in args.rows:
        ball = lattice(side, side) - [0.0, 1.1 * RADIUS * side, 0.0]
        ball = ball[np.linalg.norm(ball, axis=1) < 1.1 * RADIUS * side]
        R = 1.1 * RADIUS * side
        x = np.concatenate([ball - [1.05 * R, 0.3 * R, 0.0], ball + [1.05 * R, 0.3 * R, 0.0]])
        v = np.repeat([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]], len(ball), axis=0)
        scene = make_scene(row, args.mu, floor=False, gravity=(0.0, 0.0, 0.0))
        scene.particles("/grains", points=x, velocities=v, radius=RADIUS,
                        material=Grains(static_friction=args.mu, dynamic_friction=args.mu))
        run = Run(scene, args.device)
        run.step(24)
        u, y = run.simulation.velocities().astype(float), run.places
        dL = (np.cross(y, u) - np.cross(x, v)).sum(axis=0)
        print(f"| {len(x)} | {row} | {np.linalg.norm(u.sum(axis=0)) / len(x):.1e} | {np.linalg.norm(dL) / (len(x) * R):.1e} | "
              f"{run.worst:.3f} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("heap", "pile", "slip", "silo", "press", "free"))
    parser.add_argument("rest", nargs="+")
    parser.add_argument("--mu", type=float, default=0.5)
    parser.add_argument("--rolling", type=float)
    parser.add_argument("--mixed", action="store_true")
    parser.add_argument("--device", default="cpu")
    args = parser.parse_args()
    names = {"heap": ("grains", "seconds", "more"), "pile": ("across", "layers", "frames"), "slip": ("mu",),
             "silo": ("across",), "press": ("across",), "free": ("grains",)}[args.what]
    for name, text in zip(names, args.rest, strict=False):
        setattr(args, name, float(text) if name in ("seconds", "more", "mu") else int(text))
    args.rows = args.rest[len(names):]
    {"heap": heap, "pile": pile, "slip": slip, "silo": silo, "press": press, "free": free}[args.what](args)


if __name__ == "__main__":
    main()
