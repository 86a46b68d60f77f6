"""`wsim fit`: from files to a table and a layer."""

import os
import sys
from contextlib import nullcontext
from dataclasses import replace
from typing import Any

from wsim.cli.progress import progress_line
from wsim.fitting.fields.result import FieldFit
from wsim.fitting.fit import Fit, Settings, fit
from wsim.fitting.observations.observe import Track
from wsim.fitting.observations.observed_usd import read
from wsim.scene import Problem, Scene, SceneError
from wsim.scene.methods import objects_with_values
from wsim.usd.result.as_json import as_json
from wsim.usd.result.dependencies import refuse_overwrite


def run_fit_command(scene: Scene, args) -> bool:
    """Fits, prints, writes; whether it converged."""
    _check_outputs(scene, args)

    def read_observed_tracks(paths: list[str]) -> list[Track]:
        return [t for path in paths for t in read(path, scene, args.noise, force=args.force_noise)]

    seen, also = (read_observed_tracks(args.to or args.many[:1]),
                  [(scene, read_observed_tracks([path])) for path in args.many[0 if args.to else 1:]])
    shared = None if args.shared is None else tuple(args.shared.split(","))
    settings = Settings(device=args.device, accuracy=args.accuracy or 0.0, limit=args.limit, state=args.restart, shared=shared,
                        copies=args.copies)
    with progress_line(0) as progress, _team_of_fit_workers(args, progress.say) as team:
        settings = replace(settings, team=team)
        progress.say("compiling")

        def show_fit_step(step: dict) -> None:
            values = ", ".join(f"{name} {value:.5g}" for name, value in step["values"].items())
            progress.say(f"step {step['step']}: {values}; frames to {step['frame']} of {step['frames']}, "
                         f"{step['simulations']:.3g} simulations")
        result = fit(scene, seen, args.parameters, also=also, start=parse_name_values("--start", args.start),
                     priors=parse_priors(args.prior), each=show_fit_step, settings=settings)
    write_fit_result(scene, result, args)
    return result.converged


def _team_of_fit_workers(args, said):
    """Workers of the fit (`wsim.sweep.team`) where some are asked for; else nothing."""
    from wsim.cli.sweep_options import sweep_settings
    asked = sweep_settings(args)
    if not asked.remote:
        return nullcontext()
    from wsim.sweep.team import Team
    return Team(asked, args.copies, said)


def _check_outputs(scene: Scene, args) -> None:
    """Raises SceneError for files to write that cannot be, or that the fit reads."""
    inputs = {args.scene: "the scene"} | dict.fromkeys([*args.to, *args.many], "the observation")
    refuse_overwrite("--restart", args.restart, inputs)
    if args.output:
        from wsim.usd.result.fitted import check_target
        check_target(scene, args.output)
        refuse_overwrite("-o", args.output, inputs | ({args.restart: "the state of the fit"} if args.restart else {}))


def write_fit_result(scene: Scene, result: Fit | FieldFit, args) -> None:
    paths = fitted_layer_paths(result, args.output) if args.output else []
    for k, path in enumerate(paths):
        unknown = _save_fitted_layer(scene, result, path, k)
        if unknown:
            print(f"warning: {path}: {', '.join(unknown)} could not be identified; what is written there is one of many "
                  "answers", file=sys.stderr)
    if args.json:
        print(as_json(result.as_dict() | {"scene": args.scene, "output": args.output}))
    else:
        print(result.text())
        for k, path in enumerate(paths):
            of = f" of {args.many[k]}" if len(paths) > 1 else ""
            print(f"{path}: a layer over {os.path.basename(str(scene.source))} with these values{of}")


def fitted_layer_paths(result: Fit | FieldFit, path: str) -> list[str]:
    """Layers that are written: one, or FITTED.1.usda, FITTED.2.usda ... where experiments have values of their own."""
    if isinstance(result, FieldFit) or all(p.only is None for p in result.parameters):
        return [path]
    stem, end = os.path.splitext(path)
    return [f"{stem}.{k + 1}{end}" for k in range(len(result.scenes))]


def _save_fitted_layer(scene: Scene, result: Fit | FieldFit, path: str, k: int = 0) -> list[str]:
    """Writes the layer of experiment k; names of its parameters that are open."""
    from wsim.usd.result.fitted import save_fitted
    if isinstance(result, Fit):
        save_fitted(scene, result.scenes[k], path, result.as_dict() | {"residuals": []})
        return [p.name for p in result.parameters if p.only in (None, k) and result.errors[p.name] == float("inf")]
    from wsim.usd.result.fields import author_fields
    found = result.as_dict()
    short = [{k: v for k, v in f.items() if k not in ("values", "sensitivity")} for f in found["fields"]]
    fields = [(f.path, f.kind.name, result.values[f.name]) for f in result.fields]
    bodies: dict[str, Any] = {b.path: b for b in objects_with_values(result.scene)}
    save_fitted(scene, result.scene, path, found | {"fields": short, "history": []},
                lambda stage: author_fields(stage, fields, bodies))
    return [name for name, error in result.errors.items() if error == float("inf")]


def parse_name_values(option: str, texts: list[str]) -> dict[str, float]:
    """name=value"""
    found = {}
    for text in texts:
        name, _, value = text.rpartition("=")
        try:
            found[name] = float(value)
        except ValueError:
            name = ""
        if not name:
            raise SceneError(Problem(option, f"found {text!r}; write it as name=value"))
    return found


def parse_priors(texts: list[str]) -> dict[str, tuple[float, float]]:
    """name=mean:sigma"""
    found = {}
    for text in texts:
        name, _, pair = text.rpartition("=")
        mean, _, sigma = pair.partition(":")
        try:
            found[name] = float(mean), float(sigma)
        except ValueError:
            name = ""
        if not name:
            raise SceneError(Problem("--prior", f"found {text!r}; write it as name=mean:sigma, sigma in the mapped space (of a "
                                     "modulus 0.1 is 10 %)"))
    return found
