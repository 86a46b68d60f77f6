"""Observations from USD: sampled points of bodies, and what pins bear (`wsim.usd.prims.reactions`)."""

import os

import numpy as np

from wsim.fitting.observations.observe import Track, objects_with_points
from wsim.fitting.observations.reactions import Pull
from wsim.scene import Problem, Scene, SceneError


def read(path, scene: Scene, sigma: float | None = None, frames=None, bodies: list[str] | None = None,
         force: float | None = None) -> list[Track]:
    """Tracks of the bodies of a scene, and pulls of its pins, in a stage with sampled points (a result of `wsim run`, say).

    frames    which; None: every whole frame of the scene after the first that is there
    bodies    paths; None: every body of the scene that has samples
    force     standard deviation of forces [N]; None: as the stage says
    Raises SceneError for other point counts, missing frames, or where there is nothing of the scene.
    """
    from wsim.usd.result.restart import ResultReader
    result, tracks = ResultReader(os.fspath(path)), []
    sampled = result.paths()
    found, problems = pulls_of_pins(result, scene, force, frames)
    wanted = [b for b in objects_with_points(scene) if (b.path in sampled if bodies is None else b.path in bodies)]
    if not (wanted or found or problems):
        raise SceneError(Problem(result.path,
                                 f"has no samples of {', '.join(b.path for b in objects_with_points(scene))}; it has samples "
                                 f"of {', '.join(sampled) or 'nothing'}: observe a body of the scene, under its path"))
    for body in wanted:
        at = time_codes_of_frames(result.time_codes(body.path), body.path, result, scene, frames)
        if isinstance(at, Problem):
            problems.append(at)
            continue
        positions = [_positions_by_author(result, body, code) for code in at.values()]
        if any(len(p) != len(body.points) for p in positions):
            wrong = next(len(p) for p in positions if len(p) != len(body.points))
            problems.append(Problem(body.path, f"has {wrong} points in {result.path}; allowed is {len(body.points)}, as in the "
                                    "scene: observe this mesh, or give Track(points=...) the points that were seen"))
            continue
        tracks.append(Track(body.path, np.array(list(at)), np.stack(positions), sigma=sigma, source=result.path))
    if problems:
        raise SceneError(problems)
    return [*tracks, *found]


def time_codes_of_frames(codes: list[float], path: str, result, scene: Scene, frames) -> dict[int, float] | Problem:
    """Time code of each frame that is wanted, of those that there are."""
    every = {(code - scene.start) * scene.fps / result.fps: code for code in codes}
    there = {round(f): code for f, code in every.items() if abs(f - round(f)) < 1e-6}
    asked = sorted(f for f in there if 1 <= f <= scene.frames) if frames is None else [int(f) for f in frames]
    missing = [f for f in asked if f not in there]
    if asked and not missing:
        return {f: there[f] for f in asked}
    seen = f"{min(there)} to {max(there)}" if there else "none"
    return Problem(path, f"has no frame {missing[0] if missing else 'from 1 on'} in {result.path}; there are {seen} (of "
                   f"{scene.fps:g} a second, from time code {scene.start:g})")


def _positions_by_author(result, body, code: float) -> np.ndarray:
    """Positions [m] in the author's order: a net has a vertex of a curve for each end of a spring."""
    from wsim.usd.result.samples import particle_of_each_vertex
    seen = result.positions(body.path, code)
    own = particle_of_each_vertex(result.stage.GetPrimAtPath(body.path))
    if own is None or len(own) != len(seen):
        return seen
    places = np.full((max(int(own.max()) + 1, len(body.points)), 3), np.nan)
    places[own] = seen
    return places


def pulls_of_pins(result, scene: Scene, sigma: float | None, frames=None) -> tuple[list[Pull], list[Problem]]:
    """Pulls of the pins of a scene in a stage (`wsim.usd.result.restart.ResultReader`), and what is wrong with them. Where
    neither sigma nor the stage says how right they are, that is wrong: forces [N] and positions [m] can only be weighed by
    both."""
    from wsim.usd.prims import reactions
    found, problems = [], []
    for pin in scene.pins:
        prim = result.stage.GetPrimAtPath(pin.path)
        codes = reactions.reaction_time_codes(prim)
        if not codes:
            continue
        authored, weights = reactions.read_reaction_noise(prim)
        at = time_codes_of_frames(codes, pin.path, result, scene, frames)
        if isinstance(at, Problem):
            problems.append(at)
        elif not (sigma or authored):
            problems.append(Problem(pin.path, f"has {reactions.REACTION} in {result.path} and no noise; author "
                                    "wsim:reactionNoise, or give --force-noise (and --noise of positions), or block it"))
        else:
            each = [reactions.read_reaction_forces(prim, code) for code in at.values()]
            wrong = next((f for f in each if len(f) not in (1, len(pin.points)) or len(f) != len(each[0])), None)
            if wrong is not None:
                problems.append(Problem(pin.path, f"has {len(wrong)} forces in {result.path}; allowed are {len(pin.points)}, "
                                        "one for each of physics:indices0, or 1, their sum"))
                continue
            total = len(each[0]) == 1 < len(pin.points)
            found.append(Pull(pin.path, np.array(list(at)), np.stack(each)[:, 0] if total else np.stack(each),
                              weights=weights, sigma=sigma or authored, source=result.path))
    return found, problems
