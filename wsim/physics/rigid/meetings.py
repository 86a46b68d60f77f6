"""Colliders as contacts of rigid bodies ask for them: kinds of shapes that can meet, whether something bounces, where shapes
are in the frames of their bodies."""

import numpy as np

from wsim.geometry.rotation import matrix_quat, quat_conjugate, quat_product, quat_rotate
from wsim.kernels.rigid.narrow.pair import pairs_of_kinds
from wsim.physics.rigid import solids
from wsim.physics.rigid.objects import SURFACE
from wsim.physics.rigid.solids import (
    body_contact_parts,
    contact_shape_of,
    scene_contact_colliders,
    touching_colliders,
)
from wsim.scene import Collider

FEW = 64                   # shapes of a world, with colliders, up to which near pairs come from a table, not from trees

def meeting_shape_kinds(bodies: list, colliders: list[Collider]) -> frozenset[tuple[str, str]]:
    """Kinds of shapes that can meet, pairs with a mesh among them."""
    mine = {met.kind for body in bodies for c in body_contact_parts(body) if (met := contact_shape_of(c, True)) is not None}
    still = {met.kind for c in scene_contact_colliders(colliders) if (met := contact_shape_of(c, False)) is not None}
    on_meshes = (mine if "mesh" in still else set()) | (mine | still if "mesh" in mine else set())
    return frozenset(p for p in pairs_of_kinds(mine | still) if mine & set(p) and p[1] != "mesh") | frozenset(
        (one, "mesh") for one in on_meshes)


def ball_core_pairs(pairs: frozenset[tuple[str, str]]) -> frozenset[tuple[str, str]]:
    """Pairs of a ball, the core of a shape, with what that shape can meet."""
    return frozenset(("sphere", kind) for pair in pairs if "plane" not in pair for kind in pair if kind != "sphere")


def flush_collider_kinds(scene) -> frozenset[str]:
    """Kinds of colliders that may lie flush beside another; none where one stands alone, or in the converged mode."""
    found = [met.kind for c in scene_contact_colliders(scene.colliders) if (met := contact_shape_of(c, False)) is not None]
    return frozenset(found) - {"plane"} if len(found) > 1 and not scene.contact_tolerance else frozenset()


def has_restitution(scene) -> bool:
    """True if something has a restitution."""
    own = [c for body in scene.things("Body") for c in touching_colliders(body)]
    return any(c.restitution > 0.0 for c in (*own, *scene_contact_colliders(scene.colliders)))


def shape_rows_of_path(contacts, path: str, name: str, world: int | None) -> list[int]:
    """Shapes of a body or collider of `wsim.physics.rigid.contacts.RigidContactTables` that have that friction or restitution;
    none where nothing bounces from the start."""
    if name not in SURFACE or name == "restitution" and not contacts.bouncing:
        return []
    return [k for k, (own, of) in enumerate(contacts.named) if own == path and (world is None or of in (-1, world))]


def read_surface_value(contacts, name: str) -> np.ndarray:
    """(shapes,) of a friction or of restitution, in the first world."""
    table = contacts.table
    found = table.restitution.numpy() if name == "restitution" else table.friction.numpy()[:, SURFACE.index(name)]
    return found[:contacts.shapes]


def set_surface_value(contacts, path: str, name: str, value: float, world: int | None) -> bool:
    """Sets it of a body or collider, of one world or of all (None)."""
    still = contacts.table.still
    rows = [k for k in shape_rows_of_path(contacts, path, name, world) if k < still or world in (None, 0)]
    rows += [contacts.shapes + (of - 1) * (contacts.shapes - still) + k - still         # see kernels/rigid/contact.py, surfaces
             for k in shape_rows_of_path(contacts, path, name, world) if k >= still
             for of in range(1, contacts.model.worlds) if world in (None, of)]
    if rows:
        array = contacts.table.restitution if name == "restitution" else contacts.table.friction
        values = array.numpy()
        values[rows if name == "restitution" else (rows, SURFACE.index(name))] = value
        array.assign(values)
    return bool(rows)


def collider_places_in_body(masses: list, colliders: list[Collider], centers: np.ndarray) -> np.ndarray:
    """(x, y, z, quaternion), (n, 7), of colliders, about `centers` (n, 3) in their frames, in those of the centres of mass and
    principal axes of their bodies."""
    if not colliders:
        return np.zeros((0, 7))
    M = np.array([c.motion.at(0.0) for c in colliders])
    back, center = quat_conjugate(np.array([m.axes for m in masses])), np.array([m.center for m in masses])
    x = np.einsum("nij,nj->ni", M[:, :3, :3], centers) + M[:, :3, 3]
    return np.concatenate([quat_rotate(back, x - center), quat_product(back, matrix_quat(M[:, :3, :3]))], axis=1)


def body_contact_shapes(owners: list[tuple[int, int, Collider]]) -> list:
    """The `ContactShape` of each (body, world, collider): those of all worlds are the same."""
    found = {key: contact_shape_of(c, True) for key, c in {id(c): c for *_, c in owners}.items()}
    return [found[id(c)] for *_, c in owners]


def contact_shape_figures(shapes: list) -> list[tuple]:
    """(core, size, ball, skin) of `ContactShape`s, a tuple each, in turn."""
    once = {key: (met.core, met.size, met.ball, met.skin) for key, met in {id(met): met for met in shapes}.items()}
    return list(zip(*(once[id(met)] for met in shapes), strict=True))


def contact_signature(b) -> list:
    """What of a scene with contacts of bodies decides its kernels."""
    from wsim.physics.rigid.forms import choose_pass_form
    points = solids.bodies_touch_points(b.scene)
    own = [c for body in b.scene.things("Body") for c in solids.body_contact_parts(body)]
    form = choose_pass_form(b.model.device, b.model.worlds * len(own) + len(solids.scene_contact_colliders(b.scene.colliders)))
    filtered, joined = any(map(b.scene.things, ("Group", "FilteredPairs"))), bool(solids.enabled_joints(b.scene))
    few = len(own) + len(solids.scene_contact_colliders(b.scene.colliders)) <= FEW
    said = [few, sorted(meeting_shape_kinds(b.scene.things("Body"), b.scene.colliders)), sorted(flush_collider_kinds(b.scene)),
            solids.bodies_have_meshes(b.scene),
            has_restitution(b.scene), form.name, form.blocks, solids.bodies_may_sleep(b.scene), filtered, joined,
            b.scene.contact_tolerance > 0.0]
    return said + [sorted({type(c.shape).__name__ for c in own}), any(c.restitution > 0.0 for c in own)] * points
