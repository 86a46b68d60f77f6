"""Colours of measured values over what is drawn of a stage (`wsim.show.colour`), from its points at any time code."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from wsim.model.model import PointBody, make_body
from wsim.scene import Problem, SceneError
from wsim.scene.check.contact import kept_distances
from wsim.scene.nodal.skin import embed_all_skins
from wsim.show.colour import KINDS, NEAR, colour_scale, point_strain_or_stress, values_on_skin
from wsim.show.prim import DrawnPrim
from wsim.show.visible import VisibleStage
from wsim.usd.load import read_stage
from wsim.usd.prims.surface import OF
from wsim.usd.result.samples import PrimFrame, particle_of_each_vertex


def paint_measured_colours(seen: VisibleStage, kind: str, device=None) -> None:
    """Gives the bodies of a stage their colours of `kind`, one of KINDS. Raises SceneError where the stage is no scene of wsim,
    or has no collider to touch."""
    if kind not in KINDS:
        raise SceneError(Problem("colour", f"'{kind}'; allowed is {', '.join(KINDS)}"))
    scene = read_stage(seen.stage)
    bodies, skins = {b.path: make_body(b, 0, k, 0) for k, b in enumerate(scene.bodies())}, embed_all_skins(scene)
    touched = [d for d in seen.drawn if d.kind == "collider"]
    if kind == "contact" and not touched and seen.floor is None:
        raise SceneError(Problem("colour", "there is no collider that is seen, so that nothing touches; take strain or stress"))
    within = _surfaces_of_tet_meshes(seen, bodies)
    mine = [d for d in seen.drawn if d.kind in ("cloth", "soft") and d.look.path in {**bodies, **skins, **within}]
    near = NEAR * max((float(np.linalg.norm(np.ptp(d.points(seen.times[0]), axis=0))) for d in mine), default=1.0)
    for d in mine:
        skin, (of, own) = skins.get(d.look.path), within.get(d.look.path, (d.look.path, None))
        body = bodies[of if skin is None else skin.body]
        d.look = replace(d.look, colors=np.zeros((len(d.points(seen.times[0])), 3)), color_of=d.look.triangles)
        if kind == "contact":
            apart = {c: gap for c, path, gap, _ in kept_distances(scene) if path == body.path}
            reaches = [(c, float(body.reach.max(initial=0.0)) + apart.get(c.look.path, 0.0)) for c in touched]
            d.colors = _contact_colours(seen, d, reaches, float(body.reach.max(initial=0.0)), near, device)
        else:
            d.colors = _strain_colours(seen, body, kind, skin, own)


def _surfaces_of_tet_meshes(seen: VisibleStage, bodies: dict[str, PointBody]) -> dict[str, tuple[str, np.ndarray]]:
    """Meshes that a result draws in the place of TetMeshes: path of the TetMesh, and the numbers of their points in it."""
    found = {}
    for path in (d.look.path for d in seen.drawn):
        of = seen.stage.GetPrimAtPath(path).GetCustomDataByKey(OF)
        if of in bodies:
            found[path] = of, np.unique(bodies[of].source.surface_triangles())
    return found


def _strain_colours(seen: VisibleStage, body, kind: str, skin, own: np.ndarray | None) -> Callable[[float], np.ndarray]:
    """own: the numbers of the mesh's points among those of the body; None: all."""
    def strain_colours_at(t: float) -> np.ndarray:
        values = point_strain_or_stress(body, _body_points_at(seen, body.path, t), kind)
        return colour_scale(values_on_skin(skin, values) if skin is not None else values if own is None else values[own])
    return strain_colours_at


def _body_points_at(seen: VisibleStage, path: str, t: float) -> np.ndarray:
    """World positions [m] of the body's points in the author's order."""
    prim = seen.stage.GetPrimAtPath(path)
    world = PrimFrame.of(prim, t).world_points(np.asarray(prim.GetAttribute("points").Get(t), np.float64))
    particles = particle_of_each_vertex(prim)
    if particles is None:
        return world
    own = np.zeros((int(particles.max()) + 1, 3))
    own[particles] = world
    return own


def _contact_colours(seen: VisibleStage, d: DrawnPrim, reaches: list[tuple[DrawnPrim, float]], reach: float, near: float,
                     device) -> Callable[[float], np.ndarray]:
    """reaches: colliders, and how far from each what touches it stays; reach: from the floor [m]."""
    def contact_colours_at(t: float) -> np.ndarray:
        points = d.points(t)
        gap = np.full(len(points), near)
        for collider, own in reaches:
            surface = collider.points(t), collider.look.triangles
            gap = np.minimum(gap, gaps_to_colliders(points, [surface], own + near, device) - own)
        if seen.floor is not None:
            gap = np.minimum(gap, points[:, "XYZ".index(seen.up)] - seen.floor(t) - reach)
        return colour_scale(1.0 - np.maximum(gap, 0.0) / near)
    return contact_colours_at


def gaps_to_colliders(points: np.ndarray, colliders: list[tuple[np.ndarray, np.ndarray]], most: float,
                      device=None) -> np.ndarray:
    """Distance [m] of points (n, 3) to the nearest of triangle meshes (points, triangles), at most `most`, (n,)."""
    found = np.full(len(points), most)
    if not colliders or not len(points):
        return found
    import warp as wp

    from wsim.kernels.picture import distance
    from wsim.model import kernel_cache
    device, center = kernel_cache.warp_device(device), points.mean(axis=0)
    places = np.concatenate([p for p, _ in colliders]) - center
    starts = np.cumsum([0, *(len(p) for p, _ in colliders[:-1])])
    triangles = np.concatenate([t + s for (_, t), s in zip(colliders, starts, strict=True)])
    with wp.ScopedDevice(device):
        corners: wp.array = wp.array(triangles.astype(np.int32).ravel(), dtype=wp.int32)
        mesh = wp.Mesh(wp.array(places.astype(np.float32), dtype=wp.vec3), corners)
        out, at = wp.zeros(len(points), dtype=wp.float32), wp.array((points - center).astype(np.float32), dtype=wp.vec3)
        wp.launch(distance.measure_mesh_distance, dim=len(points), inputs=[mesh.id, at, float(most)], outputs=[out])
        return out.numpy().astype(np.float64)
