"""The closing report of a run, in words. The report's numbers are those of `Simulation.report()`;
`--json` prints them."""

from wsim.simulation.duration import percent_of_size

UNITS = {"penetration": "m", "too_near": "m", "grain_overlap": "of the distance of centres", "overlap": "m", "joint_error": "m",
         "angle_error": "rad", "divergence": "1/s", "speed": "m/s", "momentum": "kg m/s", "mass": "kg", "smoke": "m^3",
         "volume": "m^3", "temperature": "K"}                       # by the end of a name
# one of what a number counts, by its name in a report
NOUNS = {"bodies": "body", "joints": "joint", "grid": "cell", "rods": "rod point", "mpm": "material point",
         "substeps": "substep", "iterations": "iteration"}
SHOWN = 0.01           # ms a frame of the host: less is in the sum alone
EARLY = 10             # frames in which graphs are expected to be captured
WHOLE = ("iterations", "steps", "particles", "asleep", "broken", "in_turn", "searches", "projected", "cut")   # they count
PLAIN = (*WHOLE, "speed", "momentum", "mass", "smoke", "temperature", "volume", "strain")   # ends of names of what is no error
ENERGIES = ("energy", "_kinetic", "_elastic")
APART = ("rigid_energy", "fluid_energy", "mpm_energy")                         # not within "energy", which is that of points
ORDER = ("import", "load", "build", "compile", "capture", "first_frame", "simulate", "write", "errors", "picture", "report",
         "total")


def format_quantity(value: float) -> str:
    """Three figures and a power of a thousand: 2.31 M, 950, 0.0123."""
    for power, letter in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if abs(value) >= power:
            return f"{value / power:.3g} {letter}"
    return f"{value:.3g}"


def format_seconds(value: float) -> str:
    return f"{value:.2f} s" if value >= 1.0 else f"{1e3 * value:.3g} ms"


def format_count(n: int, part: str) -> str:
    """Number of rows of a part of the state in words: 1 body, 31 bodies, 14000 cells, 4 wheels."""
    noun = NOUNS.get(part, part)
    return f"{n} {noun if n == 1 or part not in NOUNS else noun[:-1] + 'ies' if noun.endswith('y') else noun + 's'}"


def report_text(report: dict, verbose: bool = False) -> str:
    """Text of what ran, how fast, how wrong, what to look at; verbose: also each stage and what was left out. Missing keys
    leave out their line."""
    held = [f"limits    {report['limits']}"] if report.get("limits") else []
    more = [*_stage_lines(report), *_left_out_lines(report), *(f"repeated  {w}" for w in report.get("repeats", [])[1:])]
    return "\n".join([*_size_lines(report), *_form_lines(report), *_speed_lines(report), *_error_lines(report),
                      *_balance_lines(report), *held,
                      *kept_distance_lines(report.get("kept", [])), *more * verbose, *_warning_lines(report)])


def _size_lines(report: dict) -> list[str]:
    device, name = report["device"], report.get("device_name")
    sizes, points = report.get("sizes", {}), report.get("points", "?")
    what = [f"{points} points and {report.get('constraints', '?')} constraints"] if points else []
    what += [format_count(n, part) for part, n in sizes.items() if part != "grains"]       # they are points
    drops = report.get("error", {}).get("liquid_particles")
    what += [f"{drops:.0f} particles of liquid"] if drops else []
    lines = [f"{report['frames']} frames{' of ' * bool(what)}{', '.join(what)} on {device}"
             f"{f' ({name})' if name and name.lower() != device else ''}, {report['precision']}"]
    fluid = not points and (drops or sizes) and not sizes.keys() - {"grid", "mpm"}        # it has steps of its own
    if "substeps" in report and not fluid:
        each = [format_count(report[key], key) for key in ("substeps", "iterations")] + [report["integrator"]] * bool(points)
        lines.append(f"  {', '.join(each)}")
    lines += [f"  {report['raised']}"] if report.get("raised") else []
    return lines + [f"  {what:<9}{report[what]}" for what in ("output", "partial", "picture") if report.get(what)]


def _speed_lines(report: dict) -> list[str]:
    lines = [f"time      {report['ms_per_frame']:.3g} ms/frame"]
    rates = ([f"{format_quantity(report['points_per_second'])} points and "
              f"{format_quantity(report.get('constraints_per_second', 0.0))} constraints"]
              if report.get("points_per_second") else [])
    rates += [f"{format_quantity(report['bodies_per_second'])} bodies"] if report.get("bodies_per_second") else []
    lines[0] += f"; {', '.join(rates)} a second" if rates else ""
    spent = report.get("seconds", {})
    names = [*(n for n in ORDER if n in spent), *(n for n in spent if n not in ORDER)]
    if names:
        lines.append("  " + ", ".join(f"{n.replace('_', ' ')} {format_seconds(spent[n])}" for n in names))
    return lines + _capture_lines(report.get("captures", [])) + _host_lines(report.get("host", []))


def _host_lines(told: list[dict]) -> list[str]:
    """Time of the host a frame, beside the graph, and what it evaluates there."""
    if not told:
        return []
    parts = ", ".join(f"{row['what']} {row['ms']:.2g}" for row in told if row["ms"] >= SHOWN)
    return [f"host      {sum(row['ms'] for row in told):.2g} ms a frame{f': {parts}' if parts else ''}",
            *(f"  evaluates {what}" for row in told for what in row["evaluates"])]


def _capture_lines(told: list[dict]) -> list[str]:
    """The captures of a run, and the reasons of those after its first frames."""
    late = [c for c in told if c["frame"] > EARLY]
    if not told:
        return []
    line = f"graphs    captured {len(told)} time{'s' * (len(told) > 1)} in {format_seconds(sum(c['seconds'] for c in told))}"
    return [line + f", {len(late)} of them after frame {EARLY}" * bool(late),
            *(f"  frame {c['frame']}, {c['form']}: {c['why']} ({format_seconds(c['seconds'])})" for c in late)]


def _stage_lines(report: dict) -> list[str]:
    lines, stages = [], [s for s in report.get("stages", []) if s.get("ms") is not None]
    for phase in dict.fromkeys(s.get("phase", s["name"]) for s in stages):
        inside = [s for s in stages if s.get("phase", s["name"]) == phase]
        parts = ", ".join(f"{s['name']} {s['ms']:.3g}" for s in inside)
        lines.append(f"  {phase:<9}{sum(s['ms'] for s in inside):.3g} ms a substep, launched one by one ({parts})")
    return lines


def _error_lines(report: dict) -> list[str]:
    """Errors, then other figures, energies, and what is counted."""
    found = {name: value for name, value in report.get("error", {}).items() if value is not None}
    change, time = found.pop("energy_change", None), found.pop("energy_change_seconds", 0.0)
    energies = {name: value for name, value in found.items() if name.endswith(ENERGIES)}
    counts = {name: value for name, value in found.items() if isinstance(value, int)}
    if "energy" in energies:
        energies["energy"] += sum(energies.get(name, 0.0) for name in APART)
    plain = {name for name in found if name.endswith(PLAIN)} - {*counts}
    lines = _lines_of_four("error",
                           [_format_figure(name, v) for name, v in found.items() if name not in {*energies, *counts, *plain}])
    lines += _lines_of_four("figures", [_format_figure(name, found[name]) for name in found if name in plain])
    lines += _lines_of_four("energy", [_format_figure(name.removesuffix("_energy"), v, "J") for name, v in energies.items()])
    if change is not None:
        what = "numerical damping" if change <= 0.0 else "error"
        lines.append(f"{'' if energies else 'energy':<10}{100.0 * change:+.2g} % in {time:.3g} s ({what} of "
                     f"{report.get('integrator', 'the integrator')})")
    return (lines + _measured_error_lines(report.get("predicted", {}))
            + _lines_of_four("count", [_format_figure(name, v) for name, v in counts.items() if v]))


def _measured_error_lines(said: dict) -> list[str]:
    """The error of positions, as it was measured in the first frames."""
    if "sensitive" not in said:
        return []
    error = "are not known well" if said["error"] is None else f"err by about {percent_of_size(said['error'])} of the size"
    more = "; sensitive: small differences grow, and folds come out differently with other steps" if said["sensitive"] else ""
    when = f"after {said['error_frames']} frames" if said["error_frames"] else "as predicted before the run"
    return [f"positions {error} {when}{more}"]


def _format_figure(name: str, value, unit: str | None = None) -> str:
    label = ("total" if name == "energy" else name).replace("_", " ")
    if name.endswith("strain"):
        return f"{label} {100 * value:.3g} %"
    if not isinstance(value, float) or name.endswith(WHOLE):
        return f"{label} {value:.0f}" if isinstance(value, float) else f"{label} {value}"
    unit = next((u for end, u in UNITS.items() if name.endswith(end)), "") if unit is None else unit
    return f"{label} {value:.3g} {unit}".rstrip()


def _lines_of_four(title: str, parts: list[str]) -> list[str]:
    """Four a line, the first with a title."""
    return [f"{title if k == 0 else '':<10}{', '.join(parts[k:k + 4])}" for k in range(0, len(parts), 4)]


def kept_distance_lines(taken: list[dict]) -> list[str]:
    """Text of what colliders keep from bodies where no thickness is authored: collider, body, thickness [m]."""
    return [f"contact   {k['collider']} keeps {k['thickness']:.3g} m from {k['body']}, half of whose thickness comes to that: "
            "less would show between its points (wsim:thickness)" for k in taken]


def contactless_launches_text(stages: list[dict]) -> str:
    """Launches of a frame without contacts, by the table of its stages."""
    each = ", ".join(f"{s['name']} {s['launches']}{' a substep' * (s['rate'] != 'frame')}" for s in stages)
    return f"a frame in which nothing can touch, as the device sees to: launches of {each}; else it is repeated with contacts"


def _form_lines(report: dict) -> list[str]:
    """How many frames had contacts."""
    said = report.get("forms")
    return [f"frames    {said['free']} without contacts, {said['met']} with them, {said['repeated']} tried without them first"
            ] if said else []


def _balance_lines(report: dict) -> list[str]:
    """The energy balance, and how many frames were repeated for something that asks nothing of anybody."""
    said, repeats = report.get("balance"), report.get("repeats", [])
    lines = []
    if said and said["frames"]:
        counts = list(said["left_open"].values())
        reasons = {n: [why for why, frames in said["left_open"].items() if frames == n] for n in counts}
        opened = ", ".join(f"{n} left open ({whys[0]}" + f"; and {len(whys) - 1} more" * (len(whys) > 1) + ")"
                           for n, whys in reasons.items())
        whole = all(n < said["frames"] for n in counts)
        rose = f"energy rose by at most {100.0 * said['rise']:.2g} % of the largest kinetic energy"
        rose += ", without that of edges which sweeps leave strained" * said["strained"]
        lines.append(f"balance   of {said['frames']} frames: {'; '.join(filter(None, [rose * whole, opened]))}")
    if repeats:
        lines.append(f"repeated  {repeats[0]}" + f", and {len(repeats) - 1} more" * (len(repeats) > 1))
    return lines


def _left_out_lines(report: dict) -> list[str]:
    return [f"left out  {s['stage']}: {s['why']}" for s in report.get("skipped", [])]


def _warning_lines(report: dict) -> list[str]:
    return [f"{'' if str(w).startswith('warning') else 'warning: '}{w}" for w in report.get("warnings", [])]
