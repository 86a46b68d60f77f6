"""Reasons why the energy balance of a frame is left open: what works in it, and by how much is not known. Host only."""

import numpy as np

from wsim.scene.curve import Motion

STILL = 1e-9           # [m] or of a rotation: a motion that changes by less stands still


def moves_within(motion: Motion, time: float, dt: float) -> bool:
    """Whether a motion moves in a frame."""
    if not motion.moves:
        return False
    first = motion.at(time)
    return any(np.abs(motion.at(time + s * dt) - first).max() > STILL for s in (0.5, 1.0))


class Reasons:
    """What of a scene works without its work being known: always, or while it moves."""

    def __init__(self, b):
        scene = b.scene
        self.scene, self.colliders = scene, scene.colliders
        found = [f"muscles of {s.path}" for s in scene.springs if s.actuation]
        found += [f"pressure in {s.path}" for s in scene.softs if s.pressure]
        found += [f"soft pin {p.path}" for p in scene.pins if np.isfinite(p.stiffness)]
        found += [f"contact_width {scene.contact_width:g} m"] * bool(scene.contact_width and scene.colliders and b.model.bodies)
        found += [f"load {load.path}, which varies" for load in scene.loads if np.ptp(load.curve.values, axis=0).any()]
        wind = any(np.any(w) for w in (scene.wind,)) or any(v.name == "wind" for v in scene.varying)
        found += ["wind"] * bool(wind and any(c.drag or c.lift for c in scene.cloths))
        found += [f"{v.name} of {v.path}, which varies" for v in scene.varying if v.name != "gravity"]
        found += [f"drive of {j.path}" for j in scene.things("Joint") if j.enabled
                  for d in j.drives.values() if d.speed or (d.acceleration and d.stiffness)][:1]
        found += [f"torque on {body.path}" for body in scene.things("Body") if np.any(body.torque)][:1]
        found += [f"fluid {f.path} around bodies" for f in (*scene.things("Fluid"), *scene.things("Liquid"))]
        found += [f"rods {r.path}" for r in scene.things("Rods")]
        self.always = found
        self.movers = [(c.path, c, bool(b.model.bodies)) for c in scene.colliders]
        self.pins = list(scene.pins)
        self.joints = [j for j in scene.things("Joint") if j.enabled and j.motion.moves]

    def of_frame(self, time: float, dt: float) -> list[str]:
        """Reasons why the frame that starts at `time` [s] is left open."""
        if self.always:
            return self.always
        found = [f"{p.path} moves" for p in self.pins if p.follows is not None or moves_within(p.motion, time, dt)][:1]
        found += [f"{j.path} moves" for j in self.joints if moves_within(j.motion, time, dt)][:1]
        found += [f"{path} moves" for path, c, points in self.movers if points and (
            getattr(c.shape, "poses", None) is not None or moves_within(c.motion, time, dt))][:1]
        return found
