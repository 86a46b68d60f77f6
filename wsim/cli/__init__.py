"""The command line: what can be asked, and what a failure looks like.

    0 done    1 failed, with one message    2 asked wrongly    130 interrupted, the frames so far are in OUT.partial.usdc

Commands import what they need when they run, so that `wsim --help` stays a matter of milliseconds.
"""

import argparse
import errno
import os
import signal
import sys

from wsim import __version__
from wsim.cli import arguments, new_options, sweep_options
from wsim.cli.arguments import (
    drawing,
    fraction,
    image,
    named,
    pixels,
    positive,
    report,
    variant,
    whole,
    whole_or_none,
)
from wsim.scene.integrator import INTEGRATORS, SOLVERS
from wsim.simulation import interrupt

DONE, FAILED, USAGE, INTERRUPTED = 0, 1, 2, 130


def parser() -> argparse.ArgumentParser:
    top = argparse.ArgumentParser(prog="wsim", description="A USD scene in, a simulated USD layer out.")
    top.add_argument("--version", action="version", version=f"wsim {__version__}")
    commands = top.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for add in (_run, new_options.add, _check, _plan, _bench, _fit, _sweep, _view, _picture, _copy, _examples, _docs, _schema):
        add(commands)
    for command in commands.choices.values():
        command.add_argument("--debug", action="store_true", help="show where an error came from")
    return top


def _solver(command) -> None:
    """Options that change what is simulated."""
    command.add_argument("--device", type=named, help="cpu, cuda:0 ... (default: the GPU if there is one, but the CPU for "
                                                      "up to 48 rigid bodies alone)")
    command.add_argument("--precision", choices=("float32", "float64"), help="default: float32")
    command.add_argument("--substeps", type=whole, metavar="N", help="substeps a frame (default: the scene's)")
    command.add_argument("--iterations", type=whole, metavar="N", help="iterations a substep (default: the scene's)")
    command.add_argument("--solver", choices=SOLVERS, help="default: the scene's; auto weighs cost against error")
    command.add_argument("--integrator", choices=INTEGRATORS, help="default: the scene's")
    _choices(command)


def _fps(command) -> None:
    command.add_argument("--fps", type=positive, metavar="N",
                         help="the most accurate setting that is predicted to hold N frames a second of wall clock here")


def _choices(command) -> None:
    command.add_argument("--variant", type=variant, action="append", default=[], metavar="/PRIM:SET=NAME",
                         help="choose a variant; may be repeated")


def _run(commands) -> None:
    run = commands.add_parser("run", help="simulate a scene into a result layer over it")
    run.add_argument("scene")
    run.add_argument("-o", "--output", type=named, metavar="OUT",
                     help="result: .usdc, .usda or .usd; an earlier one stays until it is whole (default: SCENE.sim.usdc)")
    run.add_argument("--frames", type=whole_or_none, metavar="N", help="default: the scene's")
    _solver(run)
    _fps(run)
    run.add_argument("--error", type=fraction, metavar="E",
                     help="1%%, say: the fastest setting that `wsim bench` found to stay within it; runs it if need be")
    run.add_argument("--preroll", type=whole_or_none, default=0, metavar="N",
                     help="frames simulated before the first one and not written, to settle")
    run.add_argument("--samples", type=whole, default=1, metavar="N", help="samples written a frame, for motion blur")
    run.add_argument("--restart", type=named, metavar="RESULT",
                     help="go on from an earlier result, or the .partial.usdc of a run")
    run.add_argument("--flatten", action="store_true", help="one file that holds the scene too")
    run.add_argument("--clips", action="store_true", help="one file a frame, in OUT.clips, which OUT names (value clips)")
    run.add_argument("--stress", action="store_true",
                     help="write von Mises stress and strain of soft bodies as primvars vonMises and strain")
    run.add_argument("--colour", "--color", dest="colour", choices=("strain", "stress"),
                     help="write displayColor over time: blue 0, red 10 %% of strain, or the stress that takes")
    run.add_argument("--reactions", action="store_true", help="write the forces of pins as wsim:reaction")
    run.add_argument("--png", type=image, metavar="FILE", help="picture of the last frame")
    run.add_argument("--view", action="store_true", help="live view (needs the extra `view`)")
    _web(run)
    run.add_argument("--json", action="store_true", help="print the closing report as JSON")
    run.add_argument("-v", "--verbose", action="store_true", help="report also each stage and what was left out")
    run.add_argument("--quiet", action="store_true", help="no progress and no closing report")


def _check(commands) -> None:
    check = commands.add_parser("check", help="say everything that is wrong with a scene")
    check.add_argument("scene")
    check.add_argument("--json", action="store_true", help="print what was found as JSON")
    _choices(check)


def _plan(commands) -> None:
    plan = commands.add_parser("plan", help="show the stages that a scene needs, and why the rest is left out")
    plan.add_argument("scene")
    _fps(plan)
    plan.add_argument("--json", action="store_true", help="print the stages as JSON")
    _solver(plan)


def _bench(commands) -> None:
    bench = commands.add_parser("bench", help="measure time against error of a scene, and recommend settings")
    bench.add_argument("scene")
    bench.add_argument("--device", type=named, help="cpu, cuda:0 ... (default: the GPU if there is one)")
    bench.add_argument("--frames", type=whole, dest="look", metavar="N",
                       help="frames looked at (default: the scene's, at most about half a second)")
    bench.add_argument("--budget", type=positive, metavar="SECONDS",
                       help="what does not fit in is left out, and named (default: 120, with --quick 30)")
    bench.add_argument("--quick", action="store_true", help="fewer settings")
    bench.add_argument("--json", type=report, metavar="FILE", help="everything found, as .json; - prints it, and no table")
    bench.add_argument("--plot", type=drawing, metavar="FILE", help=".png or .svg (needs the extra `plot`)")
    _choices(bench)


def _fit(commands) -> None:
    fit = commands.add_parser("fit", help="find parameters of a scene from an observed motion, and how sure they are")
    fit.add_argument("scene")
    fit.add_argument("--to", type=named, action="append", default=[], metavar="OBSERVED",
                     help="USD file with sampled points")
    sweep_options.add_many(fit)
    fit.add_argument("--parameters", type=named, required=True, metavar="A,B",
                     help="stretch,bend, say, or /World/Cloth:stretch; young[]: of each tet")
    fit.add_argument("-o", "--output", type=named, metavar="FITTED", help="layer over the scene with what was found")
    fit.add_argument("--frames", type=whole, metavar="N", help="frames that are used (default: the scene's)")
    fit.add_argument("--noise", type=positive, metavar="METRES", help="standard deviation (default: estimated)")
    fit.add_argument("--force-noise", type=positive, metavar="NEWTON", help="of wsim:reaction (default: wsim:reactionNoise)")
    fit.add_argument("--start", action="append", default=[], metavar="NAME=VALUE", help="default: the scene's value")
    fit.add_argument("--prior", action="append", default=[], metavar="NAME=MEAN:SIGMA", help="sigma 0.1 of a modulus: 10 %%")
    fit.add_argument("--accuracy", type=fraction, metavar="E", help="1%%, say: stop where two error bars are that small")
    fit.add_argument("--limit", type=positive, default=200.0, metavar="N", help="simulations at most (default: 200)")
    fit.add_argument("--restart", type=arguments.kept, metavar="FILE", help="keeps its state there, and goes on from it")
    fit.add_argument("--device", type=named, help="cpu, cuda:0 ... (default: the GPU if there is one)")
    fit.add_argument("--json", action="store_true", help="print the result as JSON")
    _choices(fit)


def _sweep(commands) -> None:
    sweep_options.add(commands, _solver)


def _view(commands) -> None:
    view = commands.add_parser("view", help="show a result (needs the extra `view`)")
    view.add_argument("result")
    view.add_argument("-o", "--output", "--save", type=named, dest="save", metavar="FILE",
                      help="write a .rrd file instead, for: rerun FILE")
    _web(view)


def _copy(commands) -> None:
    copy = commands.add_parser("copy", help="copy a result with its volumes, restart fields and clips")
    copy.add_argument("result")
    copy.add_argument("target", type=named, help="file to write: .usdc, .usda or .usd")


def _examples(commands) -> None:
    examples = commands.add_parser("examples", help="list the scenes that come with wsim, or run one in this folder")
    examples.add_argument("name", nargs="?", metavar="NAME", help="writes NAME.usdc and the picture NAME.png")
    examples.add_argument("--frames", type=whole_or_none, metavar="N", help="default: the scene's")
    examples.add_argument("--device", type=named, help="cpu, cuda:0 ... (default: the GPU if there is one)")


def _docs(commands) -> None:
    docs = commands.add_parser("docs", help="list the pages of the documentation, or print one")
    docs.add_argument("topic", nargs="?", metavar="TOPIC")


def _schema(commands) -> None:
    commands.add_parser("schema", help="the setting by which other USD programs know the schemas of wsim")


def _web(command) -> None:
    command.add_argument("--web", action="store_true", help="serve the viewer as a web page: no screen is needed")
    command.add_argument("--port", type=whole, default=9090, metavar="N", help="of the page; N + 1 of its data (default: 9090)")
    command.add_argument("--bind", type=named, default="127.0.0.1", metavar="ADDRESS",
                         help="where page and data listen (default: 127.0.0.1, this machine only)")


def _picture(commands) -> None:
    picture = commands.add_parser("picture", help="draw a result: still, contact sheet or animation")
    picture.add_argument("result")
    picture.add_argument("-o", "--output", type=image, required=True, metavar="FILE",
                         help=".png, .apng; .gif, .mp4 (extra picture)")
    what = picture.add_mutually_exclusive_group()
    what.add_argument("--frame", type=float, metavar="CODE", help="time code of a still (default: the last)")
    what.add_argument("--sheet", type=whole, metavar="N", help="contact sheet of N frames")
    what.add_argument("--animate", action="store_true", help="all frames: an animated PNG, or a GIF")
    picture.add_argument("--colour", "--color", dest="colour", choices=("strain", "stress", "contact"),
                         help="of bodies: red is 10 %% of strain, the stress that takes, or touching a collider")
    picture.add_argument("--size", type=pixels, default=(960, 540), metavar="WxH")
    picture.add_argument("--camera", type=named, metavar="PATH", help="a camera of the stage, or auto (default: its first)")
    picture.add_argument("--device", type=named, help="cpu, cuda:0 ... (default: the GPU if there is one)")


def explain(error: BaseException) -> str:
    """A failure in words: what and where, never a traceback."""
    from wsim.scene import SceneError

    if isinstance(error, SceneError):
        return "\n".join(map(str, error.problems))
    text = " ".join(str(error).split())
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
        return f"error: the disk is full ({error.filename or text}); free space or write elsewhere with -o"
    if isinstance(error, OSError):                # "[Errno 2] No such file or directory: 'x'" is Python's way of saying it
        return f"error: {error.filename}: {error.strerror}" if error.filename and error.strerror else f"error: {text}"
    if isinstance(error, MemoryError) or "out of memory" in text.lower():
        return f"error: out of memory ({text}); use a smaller scene, --precision float32 or another --device"
    return f"error: unexpected {type(error).__name__}: {text}; please report this, with what --debug shows"


def _interrupted() -> int:
    print("interrupted", file=sys.stderr)
    return INTERRUPTED


def main(argv: list[str] | None = None) -> int:
    """Runs a command; returns the exit code. Usage errors leave by SystemExit(2), as argparse does. argv None: that of the
    process, which is this command's: Ctrl-C may end it at once, and does nothing any more when all is done."""
    with interrupt.watch("throw" if argv else "leave"):
        code = _main(argv)
        if argv is None and interrupt.watched():
            signal.signal(signal.SIGINT, signal.SIG_IGN)
    return code


def _main(argv: list[str] | None) -> int:
    args = parser().parse_args(argv)
    if contradiction := arguments.contradiction(args):
        parser().error(contradiction)
    from wsim.cli import commands, sweep

    try:
        if args.command == "examples" and args.name:
            from wsim.cli.examples import run_command
            args = parser().parse_args(run_command(args))
        code = getattr(*sweep_options.home(args, commands, sweep))(args)
        if code != INTERRUPTED:
            interrupt.check()
        return code
    except KeyboardInterrupt:
        return _interrupted()
    except BrokenPipeError:                     # the reader of our output went away (| head): nobody to tell
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except Exception as error:
        if interrupt.came:                      # what it became on its way
            return _interrupted()
        if args.debug:
            import traceback

            traceback.print_exc()
        print(explain(error), file=sys.stderr)
        return FAILED
