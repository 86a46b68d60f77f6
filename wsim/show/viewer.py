"""Results and running simulations in the rerun viewer: meshes, rigid bodies and smoke over time, plots of energy, strain and
other indicators.

    view("flag_out.usdc")                       # a result; plots where it is a scene of wsim
    viewer = Viewer(scene)                      # live: simulation.run(240, each=viewer.log)
    viewer = Viewer(scene, save="flag.rrd")     # into a file, shown later by: rerun flag.rrd

Needs the extra `view`. With `web=Page(9090)` a browser shows it (`wsim.show.web`); else the viewer is a process of its own that
listens on 127.0.0.1, and one that runs already is used.
rerun gathers usage statistics unless told otherwise: `rerun analytics disable`.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from wsim.geometry.triangulate import triangulate_polygons
from wsim.scene import Collider, Deformable, Plane, Scene, Shape, Surface, samples
from wsim.scene.bodies import bodies_sampled_by_point
from wsim.scene.methods import each_method_object, has_other_objects, place_among
from wsim.scene.nodal.skin import embed_all_skins
from wsim.scene.solids import shape_row
from wsim.show.camera import fit_camera_to_points, subjects_in_view
from wsim.show.rerun_log import Eye, LoggedMesh, RerunLog, check_recording_path, linear_to_srgb
from wsim.show.shading import CREASE, MeshLook, palette_colour, smoothing_groups
from wsim.show.visible import VisibleStage, read_visible_stage
from wsim.show.web import WebPage
from wsim.usd.result.atomic import replace_file_atomically

SIDES = 64                       # of round shapes
AWAY = 4.0                       # a thing so many times farther from the middle than most of them does not steer the view
ROOM = 0.25                      # of the size of what is there at the start, on each side, for where it goes while it runs
ASPECT, CLOSER = 1.5, 0.52       # of the view; its lens is wider than that of a picture, so the eye is that much nearer


class Viewer:
    """Shows a running simulation; call `log` after each frame.

    scene   what is simulated: its meshes are sent at once, at the start time
    save    path of an .rrd file to write instead of showing; spawn=False with no save raises ValueError
    web     a web page to serve instead (`wsim.show.web`)
    Raises SceneError when rerun is missing or does not start, OSError when `save` cannot be written.
    """

    def __init__(self, scene: Scene, *, spawn: bool = True, save=None, web: WebPage | None = None):
        if not spawn and save is None and web is None:
            raise ValueError("a viewer shows (spawn=True) or writes (save=PATH); it was given neither")
        self.outlines = {c.path: _outline_of_collider(c.shape, c.path + "/shape", k) for k, c in enumerate(scene.colliders)}
        self.scene, self.stream = (scene,
                                   RerunLog(Path(scene.source or "scene").stem, scene.up, save, web, self._eye_at_start(scene)))
        self.shown: dict[str, LoggedMesh] = {}
        self.skins = embed_all_skins(scene)
        for body in scene.bodies():
            if body.has_surface:
                self.shown |= {look.path: LoggedMesh(self.stream, look) for look in _body_looks(body, place_among(scene, body))}
        self.stream.at(scene.start, 0.0)
        self.moved = MovedShapes(self.stream, scene)
        for collider in scene.colliders:
            self._send_collider(collider, collider.motion.at(0.0), 0.0, True)
        for body in scene.bodies():
            self._body(body, body.motion.points(body.points, 0.0))

    def log(self, sim) -> None:
        """The state of a `Simulation` after a frame: points, colliders that move, indicators."""
        self.stream.at(self.scene.start + sim.frame, sim.time)
        bodies = bodies_sampled_by_point(self.scene)
        for body in bodies:
            self._body(body, sim.positions(body.path))
        poses = sim.poses()
        for collider in self.scene.colliders:
            self._send_collider(collider, poses[collider.path], sim.time, False)
        if has_other_objects(self.scene) or len(bodies) < len(self.scene.bodies()):
            self.moved.send(sim.samples())
        self.stream.plot(sim.indicators())

    def _eye_at_start(self, scene: Scene) -> Eye | None:
        """From where all is seen that is there at the start, and somewhat around it."""
        places = [b.motion.points(b.points, 0.0) for b in scene.bodies()]
        places += [c.motion.points(self.outlines[c.path][0]) for c in scene.colliders if not isinstance(c.shape, Plane)]
        for _, thing in each_method_object(scene):
            places += [c.motion.points(_outline_of_collider(c.shape, "", 0)[0]) @ thing.motion.at(0.0)[:3, :3].T
                       + thing.motion.at(0.0)[:3, 3]
                       for c in getattr(thing, "colliders", ())]
            if hasattr(thing, "low"):                        # a box of cells
                places.append(np.stack([thing.low, thing.low + thing.cell * np.array(thing.shape)]))
        return _fit_viewer_eye(places, scene.up, ROOM)

    def _body(self, body: Deformable, points: np.ndarray) -> None:
        if body.has_surface:
            if body.path in self.shown:
                self.shown[body.path].send(points)
            for path, skin in self.skins.items():
                if skin.body == body.path and path in self.shown:
                    self.shown[path].send(skin.of(points))
            return
        if body.is_particles:
            grains: Any = body
            own = palette_colour("particles", place_among(self.scene, body)) if grains.colors is None else grains.colors
            self.stream.log_beads(body.path, points, grains.radii(), np.array(own))
            return
        color = linear_to_srgb(np.array([palette_colour("springs", place_among(self.scene, body))]))
        lines = self.stream.rr.LineStrips3D(points[body.held_points()[0]].astype(np.float32), colors=color)
        self.stream.stream.log("world" + body.path, lines)

    def _send_collider(self, collider: Collider, pose: np.ndarray, seconds: float, first: bool) -> None:
        """Its triangles once, or each time where they deform; its pose as a transform, which no path below takes."""
        points, look = self.outlines[collider.path]
        curve = collider.shape.poses if isinstance(collider.shape, Surface) else None
        if first:
            self.shown[collider.path] = LoggedMesh(self.stream, look)
        if first or curve:
            self.shown[collider.path].send(np.asarray(curve.at(seconds), float) if curve else points)
        if first or collider.motion.moves:
            transform = self.stream.rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3])
            self.stream.stream.log(f"world{collider.path}/shape", transform)

    def close(self) -> None:
        """Sends what waits; a file is complete after this."""
        self.stream.close()


class MovedShapes:
    """The things of a log that methods move besides points: rigid bodies by the shapes of their colliders, instances,
    particles, smoke.

    Shapes are sent once, at the start, and below them a transform a frame; particles and smoke are spheres of each frame.
    """

    def __init__(self, log: RerunLog, scene: Scene):
        self.log = log
        self.things = {thing.path: thing for _, thing in each_method_object(scene) if getattr(thing, "colliders", None)}
        self.instances = {(thing.instancer, thing.instance): path for path, thing in self.things.items()
                          if getattr(thing, "instancer", "")}
        self.poses: dict[str, np.ndarray] = {}
        for number, (path, thing) in enumerate(self.things.items()):
            for k, collider in enumerate(thing.colliders):
                points, look = _outline_of_collider(collider.shape, f"{path}/shape/{k}", number, "soft")
                LoggedMesh(log, look).send(collider.motion.points(points))
            self._place(path, thing.motion.at(0.0))

    def send(self, found: list[samples.Sample]) -> None:
        """The samples of a frame, by `Simulation.samples`."""
        for each in found:
            if isinstance(each, samples.TransformSample) and each.path in self.things:
                pose, stretch = each.matrix.copy(), getattr(self.things[each.path], "stretch", None)
                if stretch is not None:                      # it has gone into the colliders
                    pose[:3, :3] = pose[:3, :3] @ np.linalg.inv(stretch)
                self._place(each.path, pose)
            elif isinstance(each, samples.InstanceSample):
                for number, moved in zip(each.numbers.tolist(), each.matrices, strict=True):
                    if path := self.instances.get((each.path, number)):
                        self._place(path, moved @ self.things[path].motion.at(0.0))
            elif isinstance(each, samples.ParticleSample):
                color = np.array(palette_colour("particles", 0)) if each.colors is None else each.colors
                self.log.log_beads(each.path, each.positions, 0.5 * each.widths, color)
            elif isinstance(each, samples.VolumeSample) and "density" in each.fields:
                self._send_smoke(each)

    def _place(self, path: str, pose: np.ndarray) -> None:
        """A pose holds until the next one: what rests sends nothing."""
        if path in self.poses and np.array_equal(self.poses[path], pose):
            return
        self.poses[path] = pose
        transform = self.log.rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3])
        self.log.stream.log(f"world{path}/shape", transform)

    def _send_smoke(self, box: samples.VolumeSample) -> None:
        from wsim.show.smoke.read import ALBEDO, DENSE, SmokeDensity, smoke_beads
        values = np.maximum(np.asarray(box.fields["density"], np.float32), 0.0)
        world = np.diag([box.cell, box.cell, box.cell, 1.0])
        world[:3, 3] = box.low + 0.5 * box.cell
        extinction = DENSE / (box.cell * max(values.shape))
        places, radii = smoke_beads(SmokeDensity(values, world), extinction) if values.any() else (np.zeros((0, 3)),
                                                                                                   np.zeros(0))
        self.log.log_beads(box.path + samples.VOLUME, places, radii, np.array(ALBEDO))


def _fit_viewer_eye(places: list[np.ndarray], up: str, room: float = 0.0) -> Eye | None:
    """Where the eye of a viewer is, and what it looks at [m]: as a picture has it, of places (n, 3) of each thing and room
    around them, a part of their size; None where there are none."""
    chosen = [places[k] for k in subjects_in_view(places)]
    if not chosen:
        return None
    middles = np.array([0.5 * (p.min(axis=0) + p.max(axis=0)) for p in chosen])
    off = np.linalg.norm(middles - np.median(middles, axis=0), axis=1)
    sizes = [float(np.ptp(p, axis=0).max()) for p in chosen]
    chosen = [p for p, far, size in zip(chosen, off, sizes, strict=True) if far <= AWAY * max(float(np.median(off)), size)]
    low, high = np.min([p.min(axis=0) for p in chosen], axis=0), np.max([p.max(axis=0) for p in chosen], axis=0)
    pad = room * float(np.linalg.norm(high - low))
    ends = np.stack([low - pad, high + pad])
    camera = fit_camera_to_points(np.array(np.meshgrid(*ends.T)).reshape(3, -1).T, up, ASPECT)
    center = 0.5 * (low + high)
    target = camera.eye + float((center - camera.eye) @ camera.forward) * camera.forward
    return target + CLOSER * (camera.eye - target), target


def view(result_path, save=None, web: WebPage | None = None, served: Callable[[], object] = lambda: None) -> None:
    """Shows a stage (a result or a scene) with all its frames, or writes it to the .rrd file `save`, or serves it as a web page
    `web` until `served`, which is called when all is there, returns.

    Energy and strain are plotted where the stage can be read as a scene of wsim. Raises SceneError, OSError.
    """
    seen = read_visible_stage(result_path)
    if save is None:
        log = _log_whole_stage(seen, result_path, None, web)
        if web is not None:
            served()
        log.close()
        return
    with replace_file_atomically(check_recording_path(Path(save))) as whole:
        _log_whole_stage(seen, result_path, whole).close()


def _log_whole_stage(seen: VisibleStage, result_path, save: Path | None, web: WebPage | None = None) -> RerunLog:
    from wsim.show.plots import ResultMeasures

    ends = dict.fromkeys((seen.times[0], seen.times[-1]))
    places = [np.concatenate([d.points(t) for t in ends]) for d in seen.drawn]
    log = RerunLog(Path(result_path).stem, seen.up, save, web,
                   _fit_viewer_eye([*places, *(s.corners(seen.times[0]) for s in seen.smoke)], seen.up))
    meshes = [(LoggedMesh(log, d.look), d) for d in seen.drawn if not d.balls]
    particles = [(d.look.path, d.balls) for d in seen.drawn if d.balls]
    measures = ResultMeasures.of(seen)
    for t in seen.times:
        log.at(t, (t - seen.times[0]) / seen.fps)
        for shown, d in meshes:
            if not shown.started or d.moves or d.colors:
                shown.send(d.points(t), d.colors(t) if d.colors else None)
        for path, balls_at in particles:
            balls = balls_at(t)
            log.log_beads(path, balls.centers, balls.radii, balls.colors)
        for smoke in seen.smoke:
            log.log_beads(smoke.path, *_smoke_beads_at(smoke, t), smoke.albedo)
        if measures:
            log.plot(measures.at(t))
    return log


def _smoke_beads_at(smoke, t: float) -> tuple[np.ndarray, np.ndarray]:
    from wsim.show.smoke.read import smoke_beads
    density = smoke.at(t)
    return (np.zeros((0, 3)), np.zeros(0)) if density is None else smoke_beads(density, smoke.extinction)


def _body_looks(body: Deformable, number: int) -> list[MeshLook]:
    """How a sheet or soft body is drawn: by its skins, as far as they have faces, else by its surface."""
    color, looks = np.array([palette_colour("cloth" if body.is_sheet else "soft", number)]), []
    for skin in body.skins:
        triangles, _ = triangulate_polygons(skin.points, skin.counts, skin.indices)
        if len(triangles):
            looks.append(MeshLook(triangles, color, normal_of=smoothing_groups(skin.points, triangles, CREASE), path=skin.path))
    triangles = body.surface_triangles()
    groups = smoothing_groups(body.points, triangles, np.pi if body.is_sheet else CREASE)
    return looks or [MeshLook(triangles, color, normal_of=groups, path=body.path)]


def _outline_of_collider(shape: Shape, path: str, number: int, kind: str = "collider") -> tuple[np.ndarray, MeshLook]:
    """Points [m] in the collider's frame and how they are drawn."""
    if isinstance(shape, Surface):
        points = shape.points.astype(float)
        triangles, _ = triangulate_polygons(points, shape.counts, shape.indices)
    else:
        solid = shape_row(shape)
        points, triangles = solid.outline(solid.given(shape), SIDES)
    colors = np.array([palette_colour(kind, number)])
    return points, MeshLook(triangles, colors, normal_of=smoothing_groups(points, triangles, CREASE), path=path)
