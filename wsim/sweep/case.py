"""Cases: the scene of each run, and which runs may share arrays as worlds.

A case has the scene of its draw, as `wsim run` would simulate it. What its values do not decide of how a scene is built makes
its `base`: cases of one base differ in live values and start states alone, and worlds of one simulation of the base become
them by `Simulation.set`.
"""

import os
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from wsim.scene import Problem, Scene, SceneError
from wsim.scene.check.scene import check_scene
from wsim.scene.methods import object_at_path
from wsim.sweep.job import Job
from wsim.sweep.vary import curves
from wsim.sweep.vary.draws import Draw
from wsim.sweep.vary.target import FILE, START, SweepTarget, resolve_sweep_target
from wsim.usd.result import provenance

TOLD = 12              # refused draws that are told one by one


@dataclass
class SweepCase:
    """One run. key: of its base, cases of one key share it. lives: live values that make a world of the base this case."""

    scene: Scene
    base: Scene
    key: tuple
    lives: list[tuple[str, str, Any]] = field(default_factory=list)
    built: tuple[str, ...] = ()               # names of the draw that no running simulation takes
    start: str | None = None                  # a result whose last frame is the start


class SweepCases:
    """Cases of a job. Files are loaded once."""

    def __init__(self, job: Job):
        self.job = job
        self.loaded: dict[tuple, Scene] = {}
        self.targets: dict[tuple, SweepTarget] = {}
        self.starts: dict[tuple, Any] = {}
        self.sets: dict[tuple, list[str]] = {}

    def scene(self, file: str | None = None, variants: dict | None = None) -> Scene:
        """The scene of a file (None: the job's) with variants besides the job's, and what the job changes."""
        given = self.job.scene if file is None else file
        if isinstance(given, Scene):
            return replace(given, **self.job.settings.changes)
        chosen = {prim: dict(own) for prim, own in self.job.variants.items()}
        for prim, own in (variants or {}).items():
            chosen.setdefault(prim, {}).update(own)
        key = (given, repr(sorted((p, sorted(o.items())) for p, o in chosen.items())))
        if key not in self.loaded:
            from wsim.usd import load
            changes = self.job.settings.changes
            self.loaded[key] = replace(load(given, variants=chosen, frames=changes.get("frames")), **changes)
        return self.loaded[key]

    def variant_sets(self, path: str, file: str | None = None) -> list[str]:
        """Names of the variant sets of a prim of the scene's file."""
        source = (self.job.scene.source if isinstance(self.job.scene, Scene) else self.job.scene) if file is None else file
        if source is None:
            return []
        if (source, path) not in self.sets:
            from wsim.usd import open_stage
            stage = open_stage(source, self.job.variants or None)
            prim = stage.GetPrimAtPath(path)
            self.sets[source, path] = list(prim.GetVariantSets().GetNames()) if prim else []
        return self.sets[source, path]

    def target(self, name: str, scene: Scene, file: str | None) -> SweepTarget:
        key = (name, file)
        if key not in self.targets:
            self.targets[key] = resolve_sweep_target(name, scene, lambda path: self.variant_sets(path, file))
        return self.targets[key]

    def case(self, draw: Draw) -> SweepCase:
        """The case of a draw. Raises SceneError for what is no value, or none of what the scene has."""
        file = str(draw[FILE]) if FILE in draw else None
        first = self.scene(file)
        found = {name: self.target(name, first, file) for name in draw}
        variants: dict[str, dict[str, str]] = {}
        for name, target in found.items():
            if target.kind == "variant":
                variants.setdefault(target.path, {})[target.what] = _drawn_value_text(draw[name])
        if variants and isinstance(self.job.scene, Scene) and file is None:
            raise SceneError(Problem(next(iter(variants)), "a scene made in Python has no variants; give the path of a file"))
        base = self.scene(file, variants)
        for target in found.values():
            base = target.bare(base) if target.kind == "value" else base
        whole = base
        lives: list[tuple[str, str, Any]] = []
        built: list[tuple] = []
        for name, target in found.items():
            if target.kind != "value":
                continue
            whole = target.written(whole, draw[name])
        for name, target in found.items():
            own = target.live(base, whole) if target.kind == "value" else []
            if own is None:
                base = target.written(base, draw[name])
                built.append((name, draw[name]))
            lives += own or []
        key = (file, repr(sorted((p, sorted(o.items())) for p, o in variants.items())), tuple(built))
        named = tuple(name for name, target in found.items() if target.kind in ("variant", "file")) + tuple(n for n, _ in built)
        return SweepCase(whole, base, key, lives, named, _drawn_value_text(draw[START]) if START in draw else None)

    def started(self, case: SweepCase):
        """State that a case starts from (`wsim.usd.result.restart.RestartState`); None: the scene's own."""
        if case.start is None:
            return None
        from wsim.usd.result.restart import load_restart
        key = (case.start, case.key)
        if key not in self.starts:
            self.starts[key] = load_restart(case.start, case.base)
        return self.starts[key]

    def check(self, draws: list[Draw]) -> None:
        """Raises SceneError with every draw that cannot run, and why, before anything does."""
        refused = self._unknown_targets(draws)
        for number, draw in enumerate(draws) if not refused else ():
            try:
                case = self.case(draw)
                problems = [p for p in check_scene(case.scene) if p.fatal]
                if case.start is not None and not problems:
                    self.started(case)
            except SceneError as error:
                problems = error.problems
            refused += [Problem(p.path, f"{p.text} (run {number}: {describe_draw(draw)})") for p in problems]
        if refused:
            more = [] if len(refused) <= TOLD else [Problem("--vary", f"and {len(refused) - TOLD} more draws are refused")]
            raise SceneError([*refused[:TOLD], *more])

    def _unknown_targets(self, draws: list[Draw]) -> list[Problem]:
        """Names that are no targets, and files that are no scenes, each once."""
        found: dict[Problem, None] = {}
        for file, name in dict.fromkeys((str(d[FILE]) if FILE in d else None, name) for d in draws for name in d):
            try:
                self.target(name, self.scene(file), file)
            except SceneError as error:
                of = "" if file is None or name in (START, FILE) else f" (in {file})"
                found |= dict.fromkeys(Problem(p.path, p.text + of * (p.path != file)) for p in error.problems)
        return list(found)


def describe_draw(draw: Draw) -> str:
    """A draw in words."""
    return ", ".join(f"{name} {_drawn_value_text(given)}" for name, given in draw.items())


def _drawn_value_text(value) -> str:
    if isinstance(value, tuple):
        return " ".join(f"{v:g}" for v in value)
    return f"{value:g}" if isinstance(value, float) else str(value)


def motion_digest(scene: Scene) -> str:
    """Sixteen hexadecimal digits of what decides the motion of a scene, its settings and start included."""
    made = provenance.scene_digests(scene)
    own = {name: getattr(scene, name) for name in (*sorted(provenance.SETTINGS), "frames")}
    start = {b.path: provenance.content_digest([b.points, b.velocities]) for b in scene.bodies()}
    return provenance.content_digest([sorted((at, sorted(fields.items())) for at, fields in made.items()), sorted(own.items()),
                                      sorted(start.items())])


def set_live_values(sim, together: list[SweepCase]) -> None:
    """Gives every world of a simulation the live values of its case."""
    lives = [{(path, name): value for path, name, value in case.lives} for case in together]
    for path, name in lives[0]:
        sim.set(path, name, [own[path, name] for own in lives], range(len(lives)))


def start_from_result(sim, restart, world: int | None = None) -> None:
    """Puts a simulation, or one world of it, where an earlier run got to; None: the scene's own start."""
    if restart is None:
        return
    if object_at_path(sim.scene, "/") is not None and not restart.positions:
        sim.restart(0, restart.fields, alike=False)
        return
    for path, positions in restart.positions.items():
        sim.set(path, "positions", np.asarray(positions), world)
        if path in restart.velocities:
            sim.set(path, "velocities", np.asarray(restart.velocities[path]), world)


def absolute_draw_paths(draw: Draw) -> Draw:
    """The draw with its files by their whole paths, for workers elsewhere."""
    return {name: os.path.abspath(_drawn_value_text(given)) if name in (START, FILE) or curves.names_curve_file(given)
            else given
            for name, given in draw.items()}
