"""`wsim fit`: from files to a table and a layer."""

import os
import sys

from wsim.cli.progress import line
from wsim.fitting.fields.result import FieldFit
from wsim.fitting.fit import Fit, Settings, fit
from wsim.fitting.observations.observe import Track
from wsim.fitting.observations.observed_usd import read
from wsim.scene import Problem, Scene, SceneError
from wsim.usd.result.as_json import as_json
from wsim.usd.result.dependencies import refuse


def run(scene: Scene, args) -> bool:
    """Fits, prints, writes; whether it converged."""
    _check_outputs(scene, args)

    def tracks(paths: list[str]) -> list[Track]:
        return [t for path in paths for t in read(path, scene, args.noise, force=args.force_noise)]

    seen, also = tracks(args.to or args.many[:1]), [(scene, tracks([path])) for path in args.many[0 if args.to else 1:]]
    settings = Settings(device=args.device, accuracy=args.accuracy or 0.0, limit=args.limit, state=args.restart)
    with line(0) as progress:
        progress.say("compiling")

        def told(step: dict) -> None:
            values = ", ".join(f"{name} {value:.5g}" for name, value in step["values"].items())
            progress.say(f"step {step['step']}: {values}; frames to {step['frame']} of {step['frames']}, "
                         f"{step['simulations']:.3g} simulations")
        result = fit(scene, seen, args.parameters, also=also, start=pairs("--start", args.start),
                     priors=priors(args.prior), each=told, settings=settings)
    write(scene, result, args)
    return result.converged


def _check_outputs(scene: Scene, args) -> None:
    """Raises SceneError for files to write that cannot be, or that the fit reads."""
    inputs = {args.scene: "the scene"} | dict.fromkeys([*args.to, *args.many], "the observation")
    refuse("--restart", args.restart, inputs)
    if args.output:
        from wsim.usd.result.fitted import check_target
        check_target(scene, args.output)
        refuse("-o", args.output, inputs | ({args.restart: "the state of the fit"} if args.restart else {}))


def write(scene: Scene, result: Fit | FieldFit, args) -> None:
    if args.output:
        unknown = _save(scene, result, args.output)
        if unknown:
            print(f"warning: {args.output}: {', '.join(unknown)} could not be identified; what is written there is one of many "
                  "answers", file=sys.stderr)
    if args.json:
        print(as_json(result.as_dict() | {"scene": args.scene, "output": args.output}))
    else:
        print(result.text())
        if args.output:
            print(f"{args.output}: a layer over {os.path.basename(str(scene.source))} with these values")


def _save(scene: Scene, result: Fit | FieldFit, path: str) -> list[str]:
    """Writes the layer; names of parameters that are open."""
    from wsim.usd.result.fitted import save_fitted
    if isinstance(result, Fit):
        save_fitted(scene, result.scene, path, result.as_dict() | {"residuals": []})
        return [p.name for p in result.parameters if result.errors[p.name] == float("inf")]
    from wsim.usd.result.fields import author_fields
    found = result.as_dict()
    short = [{k: v for k, v in f.items() if k not in ("values", "sensitivity")} for f in found["fields"]]
    fields = [(f.path, f.kind.name, result.values[f.name]) for f in result.fields]
    bodies = {b.path: b for b in (*result.scene.bodies(), *result.scene.pins, *result.scene.colliders)}
    save_fitted(scene, result.scene, path, found | {"fields": short, "history": []},
                lambda stage: author_fields(stage, fields, bodies))
    return [name for name, error in result.errors.items() if error == float("inf")]


def pairs(option: str, texts: list[str]) -> dict[str, float]:
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


def priors(texts: list[str]) -> dict[str, tuple[float, float]]:
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
