"""What records the bodies of a scene, and which scenes none does."""

from wsim.physics.rigid.recorded.bodies import Recorded
from wsim.physics.rigid.solids import acting, as_met, meet, meeting, sleeps, standing, touches
from wsim.scene.values.coverage import refuse


def refuse_contacts(scene) -> None:
    """Raises SceneError where bodies that are to be recorded can touch what has no derivative."""
    if not (touches(scene) or meet(scene)):
        return
    bodies = [body for body in scene.things("Body") if meeting(body)]
    beside = scene.bodies() if touches(scene) else []
    other = next((c.path for c in (*beside, *standing(scene.colliders))), bodies[-1].path)
    for key, wrong in (("points", touches(scene)), ("held", acting(scene)), ("impulses", scene.contact_tolerance <= 0.0),
                       ("sleep", sleeps(scene))):
        if wrong:
            raise refuse(key, bodies[0].path, other=other)
    for c in standing(scene.colliders):
        met = as_met(c, False)
        if met is not None and met.mesh is not None:
            raise refuse("meshes", c.path)


def recorded(method) -> Recorded:
    """Recorder of a method's bodies (`wsim.physics.rigid.method.Rigid`)."""
    if not (method.joints or method.contacts):
        return Recorded(method)
    from wsim.physics.rigid.recorded.islands import RecordedIslands
    return RecordedIslands(method)
