"""What of material points has no derivative, and is refused by its prim path."""

from typing import Any

import numpy as np

from wsim.kernels.particles.mpm.adjoint.law_table import BACK
from wsim.physics.mpm.actions.choice import loads_on_points
from wsim.scene import Scene, solids
from wsim.scene.values.coverage import gradient_refusal

FLAT = (solids.Plane, solids.Box)


def refuse_underivable(method: Any, scene: Scene) -> None:
    """Raises SceneError for implicit steps, particles that come and go, laws without an adjoint, and colliders that are curved,
    are meshes, or turn."""
    path = method.things[0].path
    if not method.grid.waves:
        raise gradient_refusal("grown", path, what="takes implicit steps", fix="choose explicit ones")
    if met := [*scene.bodies(), *scene.things("Body"), *scene.things("Rods")]:
        raise gradient_refusal("grown", met[0].path, what="stands beside material points and may meet them",
                               fix="leave it out, or leave out gradients=True")
    if method.flow:
        poured = next(thing for thing in (*method.things, *scene.things("MaterialSink")) if getattr(thing, "pour", True))
        raise gradient_refusal("grown", poured.path, what="has particles that come or go", fix="leave out what pours and takes")
    if method.acts:
        acting = [*(pin for thing in method.things for pin in thing.pins), *loads_on_points(scene), *method.things]
        raise gradient_refusal("grown", acting[0].path, what="has loads, pins or air that acts on it", fix="leave them out")
    for thing in method.things:
        if thing.material.law not in BACK:
            raise gradient_refusal("law", thing.path, name="law", law=thing.material.law)
    for collider in scene.colliders:
        if not isinstance(collider.shape, FLAT) or turns(collider):
            raise gradient_refusal("curved", collider.path, shape=type(collider.shape).__name__,
                                   how=" that turns" if isinstance(collider.shape, FLAT) else "")


def turns(collider: Any) -> bool:
    """True if a collider turns as it moves."""
    if not collider.motion.moves:
        return False
    return not np.allclose(collider.motion.values[:, :3, :3], collider.motion.values[0, :3, :3], atol=1e-12)
