"""Tables of links that contacts may push, and of what a scene asks of its contacts."""

from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.rigid.joint.tree.contact.needs import TreeContactNeeds
from wsim.kernels.rigid.joint.tree.tables import mat66d, pushed_link_struct, vec5d
from wsim.model.structs import fill_struct
from wsim.physics.rigid.joints.trees.break_tables import some_joint_breaks
from wsim.physics.rigid.joints.trees.strings import some_distance_ranges
from wsim.physics.rigid.meetings import has_restitution
from wsim.physics.rigid.solids import bodies_may_sleep, has_soft_contacts


def tree_contact_needs(trees) -> TreeContactNeeds:
    """What the substeps of touching trees need. trees: `DeviceTrees`."""
    scene, moves = trees.model.scene, bool(trees.trees.moves)
    soft = has_soft_contacts(scene)
    return TreeContactNeeds(moves, has_restitution(scene) and not soft, scene.contact_tolerance > 0.0, bodies_may_sleep(scene),
                            soft, trees.pushed, some_joint_breaks(trees), some_distance_ranges(trees))


def add_soft_tables(trees, contacts) -> None:
    """Gives trees what each shape of contacts (`RigidContactTables`) has of MuJoCo's model."""
    if has_soft_contacts(trees.model.scene):
        for name, dtype in (("solref", wp.vec2d), ("solimp", vec5d)):
            values = np.array([getattr(c, name) for c in contacts.shape_colliders], np.float64)
            setattr(trees.trees, name, trees.model.upload(values, dtype))


def contact_tables(trees) -> dict[str, Any]:
    """Fields of Trees. trees: `DeviceTrees`, with links; none of them where nothing touches."""
    links, worlds, device = trees.links, trees.model.worlds, trees.device
    n, islands = len(links.body), len(links.first_link) - 1
    if not trees.touching:
        return {}
    tree = np.searchsorted(links.first_link, np.arange(n), side="right") - 1
    last, entry = np.array(links.last_dof, int), np.array(links.first_entry)
    sizes = np.where(last < 0, 0, entry[last + 1] - entry[last])               # dofs on the way from each link to the root
    answers = 6 * np.concatenate([[0], np.cumsum(sizes)])
    link_of = np.argsort(links.body)
    rows = np.arange(worlds)[:, None]
    found = {"first_tree": islands * np.arange(worlds + 1), "link_of": link_of + n * rows, "tree_of": tree + islands * rows,
             "first_answer": answers[:-1] + answers[-1] * rows,
             "last_answer": answers[np.array(links.first_link[1:], int)] + answers[-1] * rows,
             "answer_link": np.repeat(np.arange(n), sizes) + n * rows}

    def zeros(length: int, dtype):
        return wp.zeros(max(1, length), dtype=dtype, device=device)
    return {**{name: trees._to_device(values.ravel(), int) for name, values in found.items()},
            "met": zeros(n * worlds, int), "answer": zeros(int(answers[-1]) * worlds, wp.float64),
            "swing": zeros(n * worlds, mat66d), "flags": zeros(2 * worlds, int), "residual": zeros(worlds, wp.float64),
            "tolerance": float(trees.model.scene.contact_tolerance), "links": pushed_link_arrays(trees)}


def pushed_link_arrays(trees) -> Any:
    """The struct of what links are said to have; empty where nothing pushes them."""
    if not trees.pushed:
        return fill_struct(pushed_link_struct())
    n = len(trees.method.bodies)
    return fill_struct(pushed_link_struct(), u=wp.zeros_like(trees.qd),
                       **{name: wp.zeros(n, dtype=wp.vec3d, device=trees.device) for name in ("p", "L", "J", "M")})
