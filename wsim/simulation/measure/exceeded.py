"""Warnings of frames in which an edge was longer than twice its rest length, or a solver left as much force as it found.

Status words hold both for every body (`wsim.model.stage`), so that frames are neither slowed nor missed. One warning for
each body and kind: its first frame, and how often and how badly since.
"""

from dataclasses import dataclass

import numpy as np

from wsim.model.model import edge_lengths
from wsim.model.stage import STRETCHED, THROWN, UNSOLVED
from wsim.physics.motion.divergence_monitor import MOST

EXPLICIT = ("if the motion is not meant to be that violent, explicit steps are too long for it; give more substeps, or solver "
            "auto")
OTHERS = "nothing holds it to its material there; give more substeps or iterations, or slower motion"
BEHIND = "tethers and strain limits are projected behind its steps, which undo a part of it; solver xpbd takes both together"
CAP = 1e9              # percent: no more is told, see kernels/cloth/spring.py and kernels/solver/line_search.py
DEEP = 0.25            # of an edge: examples have up to 0.19, where a heavy ball lies in a net of 5 cm
MANY = 1e6             # below which what is whole is a count, and told with all its digits
NOTHING = "1 is as if nothing had been solved; give more substeps or iterations, or less stiffness"


@dataclass
class ExceededNote:
    """place: of the warning among all."""

    place: int
    first: int
    worst: float
    frame: int
    count: int = 1


def note_exceeded_limits(sim) -> None:
    """Notes limits that were exceeded, after frame `sim.frame`, which holds."""
    status = sim.plan.status
    for method in sim.plan.methods:
        for key, value, said in method.frame_warnings(status):
            _add_exceeded_note(sim, key, value, _with_world(sim.model, key, said))
    if sim.frame == sim.scene.frames and sim.scene.things("MaterialSink"):
        from wsim.simulation.measure.checks.idle_sinks import idle_sink_warnings
        sim.warnings += idle_sink_warnings(sim)
    if not status.words.any():
        return
    bodies, explicit = sim.model.bodies, sim.plan.choice.solver == "explicit"
    unsolved = BEHIND if sim.plan.hard else NOTHING
    stretched = status.said(STRETCHED)
    if status.said(THROWN)[0] and not stretched.any():            # a march, which does not say where
        stretched = _stretched_percent(sim)
    beyond = [(int(place), True, stretched[place]) for place in np.flatnonzero(stretched)]
    left = status.said(UNSOLVED)
    beyond += [(_first_body_of_system(sim.model, int(system)), False, left[system]) for system in np.flatnonzero(left)]
    for place, strained, percent in beyond:
        value, body = float(percent) / 100.0, bodies[place]
        where = body.path + f" (world {body.world})" * (sim.worlds > 1)
        said = (f"an edge of {where} is {{worst}} times as long as at rest: {EXPLICIT if explicit else OTHERS}" if strained
                else f"Newton's method left a residual of {{worst}} on {where}: {unsolved}")
        _add_exceeded_note(sim, (bool(strained), where), value, said)


def _with_world(model, key: tuple, text: str) -> str:
    """A warning that names its world behind its prim, where there are several and its key ends with both."""
    path, world = key[-2:] if len(key) > 1 else ("", 0)
    named = isinstance(path, str) and path.startswith("/") and isinstance(world, int)
    return text.replace(path, path + model.of_world(world), 1) if named else text


def warn_of_depth(sim, depth: float) -> list[str]:
    """A warning where a collider stands out of a cloth by more than DEEP of its edges. depth: penetration now [m]."""
    cloths = [b for b in sim.model.bodies if b.source.is_sheet]
    edges = {b.path: float(np.median(edge_lengths(b))) for b in cloths if b.world == 0 and len(b.edges)}
    if not edges or len(cloths) < len(sim.model.bodies) or depth <= DEEP * max(edges.values()):
        return []
    path, edge = min(edges.items(), key=lambda item: item[1])
    where = path if len(edges) == 1 else "a cloth"
    return [f"frame {sim.frame}: {where} lets a collider stand out by {depth:.3g} m between its points; allowed is a quarter "
            f"of its edges of {edge:.3g} m; give it a finer mesh, the collider a wsim:thickness of {depth:.2g} m or more, or "
            "wsim:selfCollision"]


def _add_exceeded_note(sim, key: tuple, value: float, text: str) -> None:
    found = sim.notes.get(key)
    if found is None:
        found = sim.notes[key] = ExceededNote(len(sim.warnings), sim.frame, value, sim.frame)
        sim.warnings.append("")
    else:
        found.count += 1
        if value > found.worst:
            found.worst, found.frame = value, sim.frame
    frames = f"frame {found.first}" + (f" and {found.count - 1} later, worst in frame {found.frame}" if found.count > 1 else "")
    count = found.worst < MANY and found.worst == round(found.worst)
    worst = (f"{found.worst:.0f}" if count else f"{found.worst:.3g}") + " or more" * (found.worst >= 0.01 * CAP)
    sim.warnings[found.place] = f"{frames}: {text.format(worst=worst)}"


def _first_body_of_system(model, system: int) -> int:
    """Number of the first body of a system."""
    return next(k for k, b in enumerate(model.bodies) if b.first == model.starts[system])


def _stretched_percent(sim) -> np.ndarray:
    """As the status has it, from the positions."""
    x, found = sim.state.x.numpy().astype(np.float64), []
    for b in sim.model.bodies:
        rest, ends = edge_lengths(b), x[sim.model.shared(b.edges)]
        over = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)[rest > 0.0] / rest[rest > 0.0]
        most = float(over.max(initial=0.0))
        found.append(0 if most <= MOST else int(min(100.0 * most, CAP)))
    return np.array(found)
