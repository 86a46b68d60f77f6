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
    image_file_name,
    parse_count_or_zero,
    parse_error_fraction,
    parse_nonempty_name,
    parse_pixel_size,
    parse_positive_count,
    parse_positive_number,
    parse_variant_choice,
    plot_file_name,
    report_file_name,
)
from wsim.scene.integrator import INTEGRATORS, SOLVERS
from wsim.simulation import interrupt

DONE, FAILED, USAGE, INTERRUPTED = 0, 1, 2, 130


def build_argument_parser() -> argparse.ArgumentParser:
    top = argparse.ArgumentParser(prog="wsim", description="A USD scene in, a simulated USD layer out.")
    top.add_argument("--version", action="version", version=f"wsim {__version__}")
    commands = top.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for add in (_add_run_command, new_options.add_new_command, _add_check_command, _add_plan_command, _add_bench_command,
                _add_fit_command, _add_sweep_parser, _add_view_command, _add_picture_command, _add_copy_command,
                _add_examples_command, _add_docs_command, _add_schema_command):
        add(commands)
    for command in commands.choices.values():
        command.add_argument("--debug", action="store_true", help="show where an error came from")
    return top


def _add_solver_options(command) -> None:
    """Options that change what is simulated."""
    command.add_argument("--device", type=parse_nonempty_name,
                         help="cpu, cuda:0 ... (default: the GPU if there is one, but the CPU for "
                                                      "up to 48 rigid bodies alone)")
    command.add_argument("--precision", choices=("float32", "float64"), help="default: float32")
    command.add_argument("--substeps", type=parse_positive_count, metavar="N", help="substeps a frame (default: the scene's)")
    command.add_argument("--iterations", type=parse_positive_count, metavar="N",
                         help="iterations a substep (default: the scene's)")
    command.add_argument("--solver", choices=SOLVERS, help="default: the scene's; auto weighs cost against error")
    command.add_argument("--integrator", choices=INTEGRATORS, help="default: the scene's")
    _add_variant_option(command)


def _add_fps_option(command) -> None:
    command.add_argument("--fps", type=parse_positive_number, metavar="N",
                         help="the most accurate setting that is predicted to hold N frames a second of wall clock here")


def _add_variant_option(command) -> None:
    command.add_argument("--variant", type=parse_variant_choice, action="append", default=[], metavar="/PRIM:SET=NAME",
                         help="choose a variant; may be repeated")


def _add_run_command(commands) -> None:
    run = commands.add_parser("run", help="simulate a scene into a result layer over it")
    run.add_argument("scene")
    run.add_argument("-o", "--output", type=parse_nonempty_name, metavar="OUT",
                     help="result: .usdc, .usda or .usd; an earlier one stays until it is whole (default: SCENE.sim.usdc)")
    run.add_argument("--frames", type=parse_count_or_zero, metavar="N", help="default: the scene's")
    _add_solver_options(run)
    _add_fps_option(run)
    run.add_argument("--error", type=parse_error_fraction, metavar="E",
                     help="1%%, say: the fastest setting that `wsim bench` found to stay within it; runs it if need be")
    run.add_argument("--preroll", type=parse_count_or_zero, default=0, metavar="N",
                     help="frames simulated before the first one and not written, to settle")
    run.add_argument("--samples", type=parse_positive_count, default=1, metavar="N",
                     help="samples written a frame, for motion blur")
    run.add_argument("--restart", type=parse_nonempty_name, metavar="RESULT",
                     help="go on from an earlier result, or the .partial.usdc of a run")
    run.add_argument("--flatten", action="store_true", help="one file that holds the scene too")
    run.add_argument("--clips", action="store_true", help="one file a frame, in OUT.clips, which OUT names (value clips)")
    run.add_argument("--stress", action="store_true",
                     help="write von Mises stress and strain of soft bodies as primvars vonMises and strain")
    run.add_argument("--colour", "--color", dest="colour", choices=("strain", "stress"),
                     help="write displayColor over time: blue 0, red 10 %% of strain, or the stress that takes")
    run.add_argument("--reactions", action="store_true", help="write the forces of pins as wsim:reaction")
    run.add_argument("--png", type=image_file_name, metavar="FILE", help="picture of the last frame")
    run.add_argument("--view", action="store_true", help="live view (needs the extra `view`)")
    _add_web_options(run)
    run.add_argument("--json", action="store_true", help="print the closing report as JSON")
    run.add_argument("-v", "--verbose", action="store_true", help="report also each stage and what was left out")
    run.add_argument("--quiet", action="store_true", help="no progress and no closing report")


def _add_check_command(commands) -> None:
    check = commands.add_parser("check", help="say everything that is wrong with a scene")
    check.add_argument("scene")
    check.add_argument("--json", action="store_true", help="print what was found as JSON")
    _add_variant_option(check)


def _add_plan_command(commands) -> None:
    plan = commands.add_parser("plan", help="show the stages that a scene needs, and why the rest is left out")
    plan.add_argument("scene")
    _add_fps_option(plan)
    plan.add_argument("--json", action="store_true", help="print the stages as JSON")
    _add_solver_options(plan)


def _add_bench_command(commands) -> None:
    bench = commands.add_parser("bench", help="measure time against error of a scene, and recommend settings")
    bench.add_argument("scene")
    bench.add_argument("--device", type=parse_nonempty_name, help="cpu, cuda:0 ... (default: the GPU if there is one)")
    bench.add_argument("--frames", type=parse_positive_count, dest="look", metavar="N",
                       help="frames looked at (default: the scene's, at most about half a second)")
    bench.add_argument("--budget", type=parse_positive_number, metavar="SECONDS",
                       help="what does not fit in is left out, and named (default: 120, with --quick 30)")
    bench.add_argument("--quick", action="store_true", help="fewer settings")
    bench.add_argument("--json", type=report_file_name, metavar="FILE",
                       help="everything found, as .json; - prints it, and no table")
    bench.add_argument("--plot", type=plot_file_name, metavar="FILE", help=".png or .svg (needs the extra `plot`)")
    _add_variant_option(bench)


def _add_fit_command(commands) -> None:
    fit = commands.add_parser("fit", help="find parameters of a scene from an observed motion, and how sure they are")
    fit.add_argument("scene")
    fit.add_argument("--to", type=parse_nonempty_name, action="append", default=[], metavar="OBSERVED",
                     help="USD file with sampled points")
    sweep_options.add_many(fit)
    fit.add_argument("--parameters", type=parse_nonempty_name, required=True, metavar="A,B",
                     help="stretch,bend, say, or /World/Cloth:stretch; young[]: of each tet")
    fit.add_argument("-o", "--output", type=parse_nonempty_name, metavar="FITTED",
                     help="layer over the scene with what was found")
    fit.add_argument("--frames", type=parse_positive_count, metavar="N", help="frames that are used (default: the scene's)")
    fit.add_argument("--noise", type=parse_positive_number, metavar="METRES", help="standard deviation (default: estimated)")
    fit.add_argument("--force-noise", type=parse_positive_number, metavar="NEWTON",
                     help="of wsim:reaction (default: wsim:reactionNoise)")
    fit.add_argument("--start", action="append", default=[], metavar="NAME=VALUE", help="default: the scene's value")
    fit.add_argument("--prior", action="append", default=[], metavar="NAME=MEAN:SIGMA", help="sigma 0.1 of a modulus: 10 %%")
    fit.add_argument("--accuracy", type=parse_error_fraction, metavar="E",
                     help="1%%, say: stop where two error bars are that small")
    fit.add_argument("--limit", type=parse_positive_number, default=200.0, metavar="N",
                     help="simulations at most (default: 200)")
    fit.add_argument("--restart", type=arguments.file_in_existing_folder, metavar="FILE",
                     help="keeps its state there, and goes on from it")
    fit.add_argument("--device", type=parse_nonempty_name, help="cpu, cuda:0 ... (default: the GPU if there is one)")
    fit.add_argument("--json", action="store_true", help="print the result as JSON")
    _add_variant_option(fit)


def _add_sweep_parser(commands) -> None:
    sweep_options.add_sweep_commands(commands, _add_solver_options)


def _add_view_command(commands) -> None:
    view = commands.add_parser("view", help="show a result (needs the extra `view`)")
    view.add_argument("result")
    view.add_argument("-o", "--output", "--save", type=parse_nonempty_name, dest="save", metavar="FILE",
                      help="write a .rrd file instead, for: rerun FILE")
    _add_web_options(view)


def _add_copy_command(commands) -> None:
    copy = commands.add_parser("copy", help="copy a result with its volumes, restart fields and clips")
    copy.add_argument("result")
    copy.add_argument("target", type=parse_nonempty_name, help="file to write: .usdc, .usda or .usd")


def _add_examples_command(commands) -> None:
    examples = commands.add_parser("examples", help="list the scenes that come with wsim, or run one in this folder")
    examples.add_argument("name", nargs="?", metavar="NAME", help="writes NAME.usdc and the picture NAME.png")
    examples.add_argument("--frames", type=parse_count_or_zero, metavar="N", help="default: the scene's")
    examples.add_argument("--device", type=parse_nonempty_name, help="cpu, cuda:0 ... (default: the GPU if there is one)")


def _add_docs_command(commands) -> None:
    docs = commands.add_parser("docs", help="list the pages of the documentation, or print one")
    docs.add_argument("topic", nargs="?", metavar="TOPIC")


def _add_schema_command(commands) -> None:
    commands.add_parser("schema", help="the setting by which other USD programs know the schemas of wsim")


def _add_web_options(command) -> None:
    command.add_argument("--web", action="store_true", help="serve the viewer as a web page: no screen is needed")
    command.add_argument("--port", type=parse_positive_count, default=9090, metavar="N",
                         help="of the page; N + 1 of its data (default: 9090)")
    command.add_argument("--bind", type=parse_nonempty_name, default="127.0.0.1", metavar="ADDRESS",
                         help="where page and data listen (default: 127.0.0.1, this machine only)")


def _add_picture_command(commands) -> None:
    picture = commands.add_parser("picture", help="draw a result: still, contact sheet or animation")
    picture.add_argument("result")
    picture.add_argument("-o", "--output", type=image_file_name, required=True, metavar="FILE",
                         help=".png, .apng; .gif, .mp4 (extra picture)")
    what = picture.add_mutually_exclusive_group()
    what.add_argument("--frame", type=float, metavar="CODE", help="time code of a still (default: the last)")
    what.add_argument("--sheet", type=parse_positive_count, metavar="N", help="contact sheet of N frames")
    what.add_argument("--animate", action="store_true", help="all frames: an animated PNG, or a GIF")
    picture.add_argument("--colour", "--color", dest="colour", choices=("strain", "stress", "contact"),
                         help="of bodies: red is 10 %% of strain, the stress that takes, or touching a collider")
    picture.add_argument("--size", type=parse_pixel_size, default=(960, 540), metavar="WxH")
    picture.add_argument("--camera", type=parse_nonempty_name, metavar="PATH",
                         help="a camera of the stage, or auto (default: its first)")
    picture.add_argument("--device", type=parse_nonempty_name, help="cpu, cuda:0 ... (default: the GPU if there is one)")


def explain_error(error: BaseException) -> str:
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


def _report_interruption() -> int:
    print("interrupted", file=sys.stderr)
    return INTERRUPTED


def main(argv: list[str] | None = None) -> int:
    """Runs a command; returns the exit code. Usage errors leave by SystemExit(2), as argparse does. argv None: that of the
    process, which is this command's: Ctrl-C may end it at once, and does nothing any more when all is done."""
    with interrupt.watch_interrupts("throw" if argv else "leave"):
        code = _dispatch_command(argv)
        if argv is None and interrupt.interrupts_are_watched():
            signal.signal(signal.SIGINT, signal.SIG_IGN)
    return code


def _dispatch_command(argv: list[str] | None) -> int:
    args = build_argument_parser().parse_args(argv)
    if contradiction := arguments.conflicting_options(args):
        build_argument_parser().error(contradiction)
    from wsim.cli import commands, sweep

    try:
        if args.command == "examples" and args.name:
            from wsim.cli.examples import run_command
            args = build_argument_parser().parse_args(run_command(args))
        code = getattr(*sweep_options.command_function(args, commands, sweep))(args)
        if code != INTERRUPTED:
            interrupt.raise_if_interrupted()
        return code
    except KeyboardInterrupt:
        return _report_interruption()
    except BrokenPipeError:                     # the reader of our output went away (| head): nobody to tell
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except Exception as error:
        if interrupt.came:                      # what it became on its way
            return _report_interruption()
        if args.debug:
            import traceback

            traceback.print_exc()
        print(explain_error(error), file=sys.stderr)
        return FAILED
