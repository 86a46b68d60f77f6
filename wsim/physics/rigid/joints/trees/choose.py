"""Which coordinates the joints of a scene are solved in: reduced where all of them form trees, else maximal.

The example's humanoid, which lands with stiff drives: 20 substeps a frame err by 2 mm in reduced coordinates and by 120 mm in
maximal ones, 1.8 and 4.1 ms a frame on a CPU, 28 and 119 ms on an H200 (tools/bench/rigid/trees.py).
"""

from typing import Any

from wsim.physics.rigid import solids
from wsim.physics.rigid.joints.tables import DeviceJoints
from wsim.scene import Problem, SceneError


def why_maximal(b) -> str:
    """Reason why a scene cannot have reduced coordinates that does not lie in its joints, or ""."""
    return "gradients" if b.model.gradients else ""


def make_joints(b, method) -> Any:
    """Joints of a method (`DeviceJoints`). Raises SceneError where a scene asks for reduced coordinates that it cannot have."""
    wanted = b.scene.coordinates
    why = "" if wanted != "maximal" else "asked for"
    why = why or why_maximal(b)
    if not why:
        from wsim.physics.rigid.joints.trees.tables import DeviceTrees
        try:
            pushed = solids.bodies_touch_points(b.scene) or bool(solids.bodies_met_by_strands(b.scene))
            trees = DeviceTrees(b, method, pushed or solids.has_rigid_contacts(b.scene), pushed)
            b.state.add(trees.part, *trees.tree_parts)
            return trees
        except ValueError as error:
            why = str(error)
    if solids.has_soft_contacts(b.scene):
        raise SceneError(Problem("/", "contact_model is mujoco, which bodies have in reduced coordinates alone; here are "
                                 f"maximal ones ({why}); allowed: rigid; fix: leave wsim:contactModel out, or change that"))
    if wanted == "reduced":
        raise SceneError(Problem("/", f"coordinates is reduced, which this scene cannot have ({why}); allowed: auto, maximal; "
                                 "fix: leave wsim:coordinates out"))
    joints = DeviceJoints(b, method)
    b.state.add(joints.part)
    joints.ignored = ignored_terms(joints.given, why)
    if joints.ignored and wanted == "maximal":
        raise SceneError(Problem("/", f"coordinates is maximal, and {joints.ignored}"))
    joints.ignored = joints.ignored or bent_hinges(joints.given, why) or ignored_tolerance(b.scene, why)
    return joints


def bent_hinges(joints: list, why: str) -> str:
    """What is said of hinges behind each other that maximal coordinates take as one joint, "" where those are exact."""
    found = [joint.path for joint in joints if len(joint.hinges) == 3 or any(map(any, joint.hinges.values()))]
    if not found:
        return ""
    others = f" and {len(found) - 1} other joints" * (len(found) > 1)
    return (f"hinges one behind the other, of {found[0]}{others}, are taken as turns about one point: right for small "
            f"angles alone; this scene takes maximal coordinates: {why}; fix: change that")


def ignored_tolerance(scene, why: str) -> str:
    """What is said of a residual that contacts beside joints in maximal coordinates do not know."""
    if scene.contact_tolerance == 0.0 or not solids.has_rigid_contacts(scene):
        return ""
    return (f"contact_tolerance is {scene.contact_tolerance:g} m/s, and sweeps are counted where joints take maximal "
            f"coordinates: {why}; fix: change that, or leave it out and give iterations")


def ignored_terms(joints: list, why: str) -> str:
    """What joints in maximal coordinates leave out, "" where nothing; why: reason for these coordinates."""
    for name, what in (("mimics", "a mimic"), ("armature", "armature"), ("friction", "dry friction")):
        found = [joint.path for joint in joints if getattr(joint, name)]
        if found:
            others = f" and {len(found) - 1} other joints" * (len(found) > 1)
            return (f"{found[0]}{others} have {what}, which joints have in reduced coordinates alone; this scene takes maximal "
                    f"ones: {why}; fix: change that, or remove {what}")
    return ""
