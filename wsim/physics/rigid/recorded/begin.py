"""What records the bodies of a scene, and which scenes none does."""

from wsim.physics.rigid.recorded.bodies import RecordedBodies
from wsim.physics.rigid.solids import (
    bodies_may_sleep,
    bodies_touch_points,
    contact_shape_of,
    enabled_joints,
    has_rigid_contacts,
    scene_contact_colliders,
    touching_colliders,
)
from wsim.scene.values.coverage import gradient_refusal


def refuse_contacts(scene) -> None:
    """Raises SceneError where bodies that are to be recorded can touch, or are driven by, what has no derivative."""
    for actuator in scene.things("Actuator")[:1]:
        raise gradient_refusal("actuators", actuator.path)
    if not (bodies_touch_points(scene) or has_rigid_contacts(scene)):
        return
    bodies = [body for body in scene.things("Body") if touching_colliders(body)]
    beside = scene.bodies() if bodies_touch_points(scene) else []
    other = next((c.path for c in (*beside, *scene_contact_colliders(scene.colliders))), bodies[-1].path)
    for key, wrong in (("points", bodies_touch_points(scene)), ("held", enabled_joints(scene)),
                       ("impulses", scene.contact_tolerance <= 0.0), ("sleep", bodies_may_sleep(scene))):
        if wrong:
            raise gradient_refusal(key, bodies[0].path, other=other)
    still = [(c, contact_shape_of(c, False)) for c in scene_contact_colliders(scene.colliders)]
    for c, met in still + [(c, contact_shape_of(c, True)) for body in bodies for c in touching_colliders(body)]:
        if met is not None and met.mesh is not None:
            raise gradient_refusal("meshes", c.path)


def make_recorder(method) -> RecordedBodies:
    """Recorder of a method's bodies (`wsim.physics.rigid.method.RigidMethod`)."""
    if not (method.joints or method.contacts):
        return RecordedBodies(method)
    from wsim.physics.rigid.recorded.islands import RecordedIslands
    return RecordedIslands(method)
