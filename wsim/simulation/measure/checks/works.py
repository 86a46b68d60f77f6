"""Work that is added up in every substep: of wind on cloth, and of colliders that move on points.

Equations: kernels/cloth/air.py, kernels/contact/project.py. Of rigid bodies and of drives it is added up where their impulses
are given (kernels/rigid/impulse.py, kernels/rigid/joint/steps.py)."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from wsim.model.stage import MET, Clock, Stage


class WorkOfSubsteps:
    """stages: launches of a substep. `wind`, `colliders`: whether their work is known; `given`: what they add up, an array
    each, equal shares of all worlds."""

    def __init__(self, b):
        self.model, self.given = b.model, list[wp.array]()
        self.stages: list[Stage] = []
        self.wind = self.colliders = False
        integrator, scene = b.choice.integrator, b.scene
        if not b.model.bodies or integrator.solves > 1 or (integrator.explicit and len(integrator.steps) > 2) \
                or b.ports.fused_effects:
            return
        self.air, self.contacts = b.ports.wind, b.ports.contacts
        blown = np.any(scene.wind) or any(v.name == "wind" for v in scene.varying)
        if self.air is not None and blown:
            self.add_wind()
        touching = b.reasons["selfcontact"]                   # which pushes points from colliders too
        if self.contacts is not None and not touching and any(collider_is_moving(c) and not c.restitution
                                                              for c in scene.colliders):
            self.add_colliders([c.path for c in scene.colliders])

    def array(self, size: int) -> wp.array:
        self.given.append(wp.zeros(size, dtype=wp.float64, device=self.model.device))
        return self.given[-1]

    def add_wind(self) -> None:
        from wsim.kernels.cloth.air import wind_work_kernel
        kernel, air = wind_work_kernel(self.model.real, self.model.module), self.air
        given, n = self.array(air.k.size), air.k.size

        def launch_wind_work(clock: Clock) -> None:
            self.model.launch(kernel, n, [air.triangle, air.air, air.force, clock.h], [given])
        self.stages.append(Stage("work of wind", "solve", launch_wind_work, 1, n * 40, what=f"{n} triangles"))
        self.wind = True

    def add_colliders(self, paths: list[str]) -> None:
        from wsim.kernels.contact.penetration import collider_work_kernel
        kernel, own = collider_work_kernel(self.model.real, self.model.module), self.contacts
        rows = own.rows
        outside: Any = wp.array(np.array([rows.colliders[k].path in paths for k in rows.collider], np.int32), dtype=int,
                                device=self.model.device)
        given, n = self.array(own.count), own.count

        def launch_collider_work(clock: Clock) -> None:
            self.model.launch(kernel, n, [own.points, own.slots, own.push, outside, clock.effective_step], [given])
        self.stages.append(Stage("work of colliders", "solve", launch_collider_work, 1, n * 8, what=f"{n} points", frames=MET))
        self.colliders = True


def collider_is_moving(collider) -> bool:
    """True if a collider moves, or its points do."""
    return collider.motion.moves or getattr(collider.shape, "poses", None) is not None
