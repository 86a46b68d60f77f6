"""Reasons why the energy balance of a frame is left open: what works in it, and by how much is not known. The device knows of
pins whose targets it evaluates whether they move (kernels/math/ledger.py)."""

from itertools import pairwise
from math import inf

import numpy as np
import warp as wp

from wsim.scene.curve import Motion
from wsim.scene.methods import feels_air

UNKNOWN = ("torque", "wind", "actuation", "pressure")          # live values whose work is not known
STILL = 1e-9           # [m] or of a rotation: a motion that changes by less stands still


def moves_within(motion: Motion, time: float, dt: float) -> bool:
    """True if a motion moves in a frame."""
    if not motion.moves:
        return False
    first = motion.at(time)
    return any(np.abs(motion.at(time + s * dt) - first).max() > STILL for s in (0.5, 1.0))


class OpenFrameReasons:
    """The things of a scene that work without its work being known: always, or while it moves."""

    def __init__(self, b, works):
        """works: `wsim.simulation.measure.checks.works.WorkOfSubsteps`, what it knows."""
        scene, points = b.scene, bool(b.model.bodies)
        found = [f"muscles of {s.path}" for s in scene.bodies() if s.actuation]
        found += [f"pressure in {s.path}" for s in scene.bodies() if s.pressure]
        found += [f"soft pin {p.path}" for p in scene.pins if np.isfinite(p.stiffness)]
        found += ["smoothed contacts (wsim:contactWidth)"] * bool(scene.contact_width and scene.colliders and points)
        found += [f"load {load.path}, which varies" for load in scene.loads if np.ptp(load.curve.values, axis=0).any()]
        self.works, blown = works, np.any(scene.wind) or any(v.name == "wind" for v in scene.varying)
        found += ["wind"] * bool(blown and feels_air(scene) and not works.wind)
        found += [f"{v.name} of {v.path}, which varies" for v in scene.varying if v.name not in ("gravity", "wind")]
        found += [f"drive of {j.path}, per mass" for j in scene.things("Joint") if j.enabled
                  for d in j.drives.values() if d.acceleration and (d.stiffness or d.speed)][:1]
        found += [f"torque on {body.path}" for body in scene.things("Body") if np.any(body.torque)][:1]
        found += [f"fluid {f.path} around bodies" for f in (*scene.things("Fluid"), *scene.things("Liquid"))]
        found += [f"material points, such as {m.path}" for m in scene.things("MaterialPoints")][:1]
        found += [f"rods {r.path}" for r in scene.things("Rods")]
        found += [f"particles that come or go, such as {p.path}" for p in scene.things("Particles")
                  if p.pour or scene.things("MaterialSink")][:1]
        found += [f"surface tension of {p.path}" for p in scene.things("Particles")
                  if getattr(p.material, "surface_tension", 0.0)][:1]
        self.always = found
        self.colliders = scene.colliders if points else []
        self.sizes = {c.path: sum_of_shape_numbers(c.shape) for c in self.colliders}
        pins = b.ports.pins
        self.pins = pins
        self.paths = [p.pin.path for p in pins.groups["hard"]] if pins else []
        self.speeds = pins.pull if pins else wp.zeros(0, dtype=wp.float64, device=b.model.device)      # see `Pins.pull`
        self.joints = [j for j in scene.things("Joint") if j.enabled]

    def set_value(self, path: str, name: str, value) -> None:
        """A live value that works, and was not there at the start."""
        if name in UNKNOWN and not (name == "wind" and self.works.wind):
            self.always = list(dict.fromkeys([*self.always, f"{name} of {path}, which was set"]))

    def reasons_of_frame(self, time: float, dt: float) -> tuple[list[str], float]:
        """Reasons why the frame that starts at `time` [s] is left open, and the speed [m/s] of what moves in it; inf where
        that is not what works. Without pins that the device evaluates."""
        if self.always:
            return self.always, inf
        speeds = {p.pin.path: speed_of_pin(p, time, dt) for p in (self.pins.unseen() if self.pins else ())}
        speeds |= {j.path: inf for j in self.joints if moves_within(j.motion, time, dt)}
        known = self.works.colliders
        speeds |= {c.path: speed_of_collider(c, time, dt, self.sizes[c.path]) for c in self.colliders
                   if (not known or c.restitution)}
        found = [path for path, speed in speeds.items() if speed > STILL]
        return [f"{path} moves" for path in found[:1]], max((speeds[path] for path in found), default=0.0)


def speed_of_pin(pin, time: float, dt: float) -> float:
    """Greatest speed [m/s] at which a pin moves its points in a frame."""
    places = [pin.targets(time + s * dt) for s in (0.0, 0.5, 1.0)]
    return 2.0 / dt * max(float(np.linalg.norm(b - a, axis=1).max(initial=0.0)) for a, b in pairwise(places))


def speed_of_collider(collider, time: float, dt: float, size: float) -> float:
    """Greatest speed [m/s] of a collider in a frame, at most; inf where its points move. size: `sum_of_shape_numbers` of its
    shape."""
    if getattr(collider.shape, "poses", None) is not None:
        return inf
    if not collider.motion.moves:
        return 0.0
    M = [collider.motion.at(time + s * dt) for s in (0.0, 0.5, 1.0)]
    moved = [b - a for a, b in pairwise(M)]
    return 2.0 / dt * max(float(np.linalg.norm(D[:3, 3]) + np.linalg.norm(D[:3, :3]) * size) for D in moved)


def sum_of_shape_numbers(shape) -> float:
    """Sum of the largest numbers of a shape's fields [m]: no point of it is farther from its origin."""
    fields = map(np.asarray, vars(shape).values())
    return sum(float(np.abs(value).max(initial=0.0)) for value in fields if value.dtype.kind == "f")
