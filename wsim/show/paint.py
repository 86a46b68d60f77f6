"""Colours of measured values over what is drawn of a stage (`wsim.show.colour`), from its points at any time code."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from wsim.model.model import Body, make_body
from wsim.scene import Problem, SceneError, Soft
from wsim.scene.check.contact import kept
from wsim.scene.nodal.skin import held
from wsim.show.colour import KINDS, NEAR, measured, scale, through
from wsim.show.prim import Drawn
from wsim.show.visible import Visible
from wsim.usd.load import read_stage
from wsim.usd.prims.surface import OF, faces
from wsim.usd.result.samples import Frame, particles_of


def paint(seen: Visible, kind: str, device=None) -> None:
    """Gives the bodies of a stage their colours of `kind`, one of KINDS. Raises SceneError where the stage is no scene of wsim,
    or has no collider to touch."""
    if kind not in KINDS:
        raise SceneError(Problem("colour", f"'{kind}'; allowed is {', '.join(KINDS)}"))
    scene = read_stage(seen.stage)
    bodies, skins = {b.path: make_body(b, 0, k, 0) for k, b in enumerate(scene.bodies())}, held(scene)
    touched = [d for d in seen.drawn if d.kind == "collider"]
    if kind == "contact" and not touched and seen.floor is None:
        raise SceneError(Problem("colour", "there is no collider that is seen, so that nothing touches; take strain or stress"))
    within = _surfaces(seen, bodies)
    mine = [d for d in seen.drawn if d.kind in ("cloth", "soft") and d.look.path in {**bodies, **skins, **within}]
    near = NEAR * max((float(np.linalg.norm(np.ptp(d.points(seen.times[0]), axis=0))) for d in mine), default=1.0)
    for d in mine:
        skin, (of, own) = skins.get(d.look.path), within.get(d.look.path, (d.look.path, None))
        body = bodies[of if skin is None else skin.body]
        d.look = replace(d.look, colors=np.zeros((len(d.points(seen.times[0])), 3)), color_of=d.look.triangles)
        if kind == "contact":
            apart = {c: gap for c, path, gap, _ in kept(scene) if path == body.path}
            reaches = [(c, float(body.reach.max(initial=0.0)) + apart.get(c.look.path, 0.0)) for c in touched]
            d.colors = _touching(seen, d, reaches, float(body.reach.max(initial=0.0)), near, device)
        else:
            d.colors = _measured(seen, body, kind, skin, own)


def _surfaces(seen: Visible, bodies: dict[str, Body]) -> dict[str, tuple[str, np.ndarray]]:
    """Meshes that a result draws in the place of TetMeshes: path of the TetMesh, and the numbers of their points in it."""
    found = {}
    for path in (d.look.path for d in seen.drawn):
        of = seen.stage.GetPrimAtPath(path).GetCustomDataByKey(OF)
        if of in bodies:
            source = bodies[of].source
            assert isinstance(source, Soft)
            found[path] = of, faces(source.tets)[0]
    return found


def _measured(seen: Visible, body, kind: str, skin, own: np.ndarray | None) -> Callable[[float], np.ndarray]:
    """own: the numbers of the mesh's points among those of the body; None: all."""
    def colors(t: float) -> np.ndarray:
        values = measured(body, _positions(seen, body.path, t), kind)
        return scale(through(skin, values) if skin is not None else values if own is None else values[own])
    return colors


def _positions(seen: Visible, path: str, t: float) -> np.ndarray:
    """World positions [m] of the body's points in the author's order."""
    prim = seen.stage.GetPrimAtPath(path)
    world = Frame.of(prim, t).world_points(np.asarray(prim.GetAttribute("points").Get(t), np.float64))
    particles = particles_of(prim)
    if particles is None:
        return world
    own = np.zeros((int(particles.max()) + 1, 3))
    own[particles] = world
    return own


def _touching(seen: Visible, d: Drawn, reaches: list[tuple[Drawn, float]], reach: float, near: float,
              device) -> Callable[[float], np.ndarray]:
    """reaches: colliders, and how far from each what touches it stays; reach: from the floor [m]."""
    def colors(t: float) -> np.ndarray:
        points = d.points(t)
        gap = np.full(len(points), near)
        for collider, own in reaches:
            surface = collider.points(t), collider.look.triangles
            gap = np.minimum(gap, gaps(points, [surface], own + near, device) - own)
        if seen.floor is not None:
            gap = np.minimum(gap, points[:, "XYZ".index(seen.up)] - seen.floor(t) - reach)
        return scale(1.0 - np.maximum(gap, 0.0) / near)
    return colors


def gaps(points: np.ndarray, colliders: list[tuple[np.ndarray, np.ndarray]], most: float, device=None) -> np.ndarray:
    """Distance [m] of points (n, 3) to the nearest of triangle meshes (points, triangles), at most `most`, (n,)."""
    found = np.full(len(points), most)
    if not colliders or not len(points):
        return found
    import warp as wp

    from wsim.kernels.picture import distance
    from wsim.model import kernel_cache
    device, center = kernel_cache.device(device), points.mean(axis=0)
    places = np.concatenate([p for p, _ in colliders]) - center
    starts = np.cumsum([0, *(len(p) for p, _ in colliders[:-1])])
    triangles = np.concatenate([t + s for (_, t), s in zip(colliders, starts, strict=True)])
    with wp.ScopedDevice(device):
        corners: wp.array = wp.array(triangles.astype(np.int32).ravel(), dtype=wp.int32)
        mesh = wp.Mesh(wp.array(places.astype(np.float32), dtype=wp.vec3), corners)
        out, at = wp.zeros(len(points), dtype=wp.float32), wp.array((points - center).astype(np.float32), dtype=wp.vec3)
        wp.launch(distance.nearest, dim=len(points), inputs=[mesh.id, at, float(most)], outputs=[out])
        return out.numpy().astype(np.float64)
