"""What can be wrong with points that two bodies share. NumPy only."""

from collections.abc import Iterator
from math import inf, isfinite

import numpy as np

from wsim.scene import Problem, Scene, Tie
from wsim.scene.attachments import body_ties
from wsim.scene.check.objects import find_point_object, thing_error
from wsim.scene.methods import method_file

APART = 1e-4       # of the soft body's size, by which points that are to be one may stand apart


def check_tie(thing: Tie, scene: Scene) -> Iterator[Problem]:
    """Problems of a tie. Positions are compared in the world at the start."""
    path = thing.path
    if thing.others is None:
        yield from _check_body_tie(thing, scene)
        return
    body = yield from find_point_object(path, "tie", "ties", thing.body, scene)
    other = yield from find_point_object(path, "tie", "ties", thing.other, scene)
    if body is None or other is None:
        return
    if not (other.is_solid or other.is_cluster) or body is other:
        yield thing_error(path, f"it ties {thing.body} to {thing.other}", "a body and another that is soft, or of clusters",
                           "name the soft body second")
        return
    if len(thing.points) != len(thing.others) or not len(thing.points):
        yield thing_error(path, f"{len(thing.points)} points of {thing.body}, {len(thing.others)} of {thing.other}",
                           "as many, at least one", "give each point its partner, in order")
        return
    for b, points in ((body, thing.points), (other, thing.others)):
        bad = (points < 0) | (points >= len(b.points))
        if bad.any():
            yield thing_error(path, f"it names point {points[np.argmax(bad)]} of {b.path}", f"0 to {len(b.points) - 1}",
                               "count from 0, in the order of the mesh's points")
            return
    held = np.concatenate([t.others for t in scene.ties if t.other == thing.other and t.others is not None])
    if other.is_cluster and len(np.unique(held)) < len(held):
        yield thing_error(path, f"two points are tied to one point of {thing.other}", "one", "tie them to points side by side")
    twice = np.flatnonzero(np.bincount(thing.points) > 1)
    if len(twice):
        yield thing_error(path, f"point {twice[0]} of {thing.body} has more than one partner", "one", "name each point once")
    if body.is_solid and (body.quadratic or other.quadratic):
        yield thing_error(thing.body, f"it shares points with {thing.other}, and one of them is quadratic",
                           "soft bodies of linear tets",
                           "leave wsim:quadratic off: middles of edges are not shared yet")
    if body.tethers or isfinite(body.material_number("strain_limit", inf)):
        what = "tethers" if body.tethers else "a strain limit"
        yield thing_error(thing.body, f"it shares points with {thing.other} and has {what}",
                           "a cloth without", "leave it out: both are projected for a body by itself")
    yield from _check_tied_points_meet(thing, body, other)


def _check_body_tie(thing: Tie, scene: Scene) -> Iterator[Problem]:
    """Problems of a tie to a rigid body."""
    path = thing.path
    rigid = {body.path: body for body in scene.things("Body")}
    if thing.other not in rigid:
        yield thing_error(path, f"it ties {thing.body} to {thing.other}, which is no rigid body",
                          f"one of {', '.join(rigid) or 'them, of which there are none'}",
                          "name a body, or pin the points to what is still or animated; to points of a soft body: give others")
        return
    body = yield from find_point_object(path, "tie to a body", "ties", thing.body, scene)
    if body is None:
        return
    if body.noun != "rods":
        yield from _check_points_on_body(thing, body, rigid[thing.other])
    bad = (thing.points < 0) | (thing.points >= len(body.points))
    if bad.any() or not len(thing.points):
        named = f"point {thing.points[np.argmax(bad)]}" if len(thing.points) else "no point"
        yield thing_error(path, f"it names {named} of {body.path}", f"0 to {len(body.points) - 1}, at least one",
                          "count from 0, in the order of the prim's points")
        return
    if thing.places is not None and (len(thing.places) != len(thing.points) or not np.isfinite(thing.places).all()):
        yield thing_error(path, f"places are {len(thing.places)} for {len(thing.points)} points, or not finite",
                          "a finite place in the frame of the body for each point", "leave places out, or give one a point")
        return
    mine = [tie for tie in body_ties(scene, body.path) if tie is thing or tie.path < path]
    held = np.concatenate([tie.points for tie in mine] + [pin.points for pin in scene.all_pins() if pin.body == body.path])
    often = np.bincount(np.clip(held, 0, len(body.points) - 1), minlength=len(body.points))[thing.points]
    if often.max() > 1:
        yield thing_error(path, f"point {thing.points[np.argmax(often)]} of {body.path} is tied or pinned {often.max()} times",
                          "once", "name each point in one tie or pin")


def _check_points_on_body(thing: Tie, body, rigid) -> Iterator[Problem]:
    """What points of cloth, nets and soft bodies cannot be tied with. They are held where they meet colliders of the body."""
    if not method_file("Body", "solids").touching_colliders(rigid):
        yield thing_error(thing.path, f"it ties {thing.body} to {thing.other}, which has no collider", "a body with one",
                          "give the body a collider, if a small one")
    if getattr(body, "self_collision", False):
        yield thing_error(thing.path, f"it ties {thing.body}, which collides with itself", "a body that does not",
                          "take wsim:selfCollision off")
    if body.is_solid and body.quadratic:
        yield thing_error(thing.path, f"it ties {thing.body}, which is quadratic", "linear tets", "leave wsim:quadratic off")
    if body.tethers or isfinite(body.material_number("strain_limit", inf)):
        what = "tethers" if body.tethers else "a strain limit"
        yield thing_error(thing.path, f"it ties {thing.body}, which has {what}", "a body without", "leave it out")


def _check_tied_points_meet(thing: Tie, body, other) -> Iterator[Problem]:
    assert thing.others is not None
    a, b = (x.motion.points(x.points)[p] for x, p in ((body, thing.points), (other, thing.others)))
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        return                                                    # said of the bodies themselves
    away, size = np.linalg.norm(a - b, axis=1), float(np.ptp(other.motion.points(other.points), axis=0).max())
    if away.max() > APART * size:
        k = int(np.argmax(away))
        yield thing_error(thing.path,
                           f"point {thing.points[k]} of {thing.body} is {away[k]:.3g} m from point {thing.others[k]} of "
                           f"{thing.other}", f"the same place, to {APART * size:.2g} m", "move one to the other")
