"""Options of `wsim sweep` and `wsim warm`."""

from wsim.cli.arguments import parse_count_or_zero, parse_nonempty_name, parse_positive_count

COMMANDS = ("sweep", "warm")
KEEP = ("none", "last", "all")


def command_function(args, commands, sweep) -> tuple:
    """(module, function) of a command."""
    if args.command == "fit" and args.many and not args.joint:
        return sweep, "fits"
    return sweep if args.command in COMMANDS else commands, args.command


def sweep_settings(args):
    """Settings of a sweep from its arguments."""
    from wsim.sweep.job import Settings
    changes = {name: getattr(args, name, None) for name in ("frames", "substeps", "iterations", "solver", "integrator")}
    precision = getattr(args, "precision", None) or "float32"
    return Settings(device=args.device, precision=precision, keep=getattr(args, "keep", "none"),
                    changes={k: v for k, v in changes.items() if v is not None}, worlds=getattr(args, "worlds", None),
                    workers=args.workers, cores=args.cores, address=args.address, retries=getattr(args, "retries", 2))


def add_sweep(commands) -> None:
    """The parser of `wsim sweep`, without what all commands share."""
    sweep = commands.add_parser("sweep", help="run a scene in many variations, a row of a table for each")
    sweep.add_argument("scene")
    sweep.add_argument("--vary", type=parse_nonempty_name, action="append", required=True, metavar="TARGET=DRAWS",
                       help="/World/Cloth:stretch=log(100,10000,20), lin(LOW,HIGH,N), list(A,B), FILE.csv; a variant set as "
                            "/PRIM:SET=list(A,B); start=list(RESULT); file=list(SCENE); may be repeated: a grid")
    sweep.add_argument("-o", "--output", type=parse_nonempty_name, required=True, metavar="FOLDER", help="table and results")
    sweep.add_argument("--latin", type=parse_positive_count, metavar="N", help="N draws of a Latin hypercube, not a grid")
    sweep.add_argument("--seed", type=parse_count_or_zero, default=0, metavar="N", help="of a hypercube (default: 0)")
    sweep.add_argument("--keep", choices=KEEP, default="none",
                       help="result layers: none, the last frame or all (default: none)")
    sweep.add_argument("--resume", action="store_true", help="go on with the sweep that FOLDER holds")
    sweep.add_argument("--frames", type=parse_positive_count, metavar="N", help="default: the scene's")
    sweep.add_argument("--worlds", type=parse_positive_count, metavar="N",
                       help="runs that share arrays at most (default: as suits the device)")
    _add_worker_options(sweep)
    sweep.add_argument("--retries", type=parse_count_or_zero, default=2, metavar="N",
                       help="of runs whose worker was lost (default: 2)")
    sweep.add_argument("--sheet", action="store_true", help="contact sheet of the last frames, FOLDER/sheet.png (with --keep)")
    sweep.add_argument("--plot", type=parse_nonempty_name, action="append", default=[], metavar="COLUMN",
                       help="draw a column over what varies, FOLDER/COLUMN.png; may be repeated")
    sweep.add_argument("--quiet", action="store_true", help="no progress")


def _add_worker_options(command) -> None:
    command.add_argument("--workers", type=parse_positive_count, metavar="N",
                         help="processes (needs the extra `sweep`; default: this one)")
    command.add_argument("--cores", type=parse_positive_count, default=1, metavar="N",
                         help="of the CPU for each worker (default: 1)")
    command.add_argument("--address", type=parse_nonempty_name, metavar="HOST", help="a Ray cluster: auto, or its address")


def add_many(fit) -> None:
    """Options by which `wsim fit` takes many specimens."""
    fit.add_argument("--many", type=parse_nonempty_name, nargs="+", default=[], metavar="OBSERVED",
                     help="specimens, each fitted by itself: a row of the table in the folder -o for each")
    fit.add_argument("--joint", action="store_true", help="one fit of all --many, which share the parameters")
    fit.add_argument("--shared", type=parse_nonempty_name, metavar="A,B",
                     help="parameters that a joint fit shares; the others are of each specimen (default: all are shared)")
    fit.add_argument("--copies", type=parse_positive_count, metavar="N",
                     help="copies of the scene at once at most, on each worker")
    fit.add_argument("--resume", action="store_true", help="go on with the fits that the folder holds")
    _add_worker_options(fit)


def add_warm(commands) -> None:
    """The parser of `wsim warm`."""
    warm = commands.add_parser("warm", help="compile the kernels of scenes ahead")
    warm.add_argument("scene", nargs="+")


def add_sweep_commands(commands, shared) -> None:
    """Both parsers; shared(command) gives one the options of the solver."""
    for make in (add_sweep, add_warm):
        make(commands)
    for name in COMMANDS:
        shared(commands.choices[name])

