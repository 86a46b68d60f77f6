"""Where a frame that ends without numbers first lost them: the substep, the stage, the array and the point.

The frame is run once more from its begin, a look at the arrays after every stage. A stage that takes all substeps of a frame in
one launch is run with fewer of them, by bisection. This costs what reading the arrays so often does, and is for errors only.
"""

import numpy as np
import warp as wp

from wsim.model.midnodes import places_with_midnodes
from wsim.model.stage import MISSED, THROWN
from wsim.physics.motion.points import NOT_FINITE
from wsim.scene import Problem, SceneError
from wsim.simulation.plan import SimulationPlan


def first_fault_of_frame(plan: SimulationPlan, time: float) -> str:
    """Text of the first fault of the frame that begins at `time` [s] with the state's snapshot; "" where it ends well this
    time."""
    clock, tape = plan.clock, plan.model.tape
    substeps, dt, plan.model.tape = clock.substeps, clock.dt, None

    def run_fewer_substeps(count: int) -> tuple:
        clock.substeps, clock.dt = count, dt * count / substeps
        plan.state.restore_snapshot()
        plan.before_frame(time)
        return _run_looking_at_arrays(plan)
    try:
        found = run_fewer_substeps(substeps)
        if not found or found[1] is None or found[1].rate != "frame" or found[1].phase != "predict":
            return describe_first_fault(plan, substeps, *found) if found else ""
        good, bad = 0, substeps
        while bad - good > 1:
            middle = (good + bad) // 2
            good, bad = (good, middle) if run_fewer_substeps(middle) else (middle, bad)
        _, stage, arrays = run_fewer_substeps(bad)
        return describe_first_fault(plan, substeps, bad - 1, stage, arrays)
    except RuntimeError:
        return ""
    finally:
        clock.substeps, clock.dt, plan.model.tape = substeps, dt, tape
        plan.state.restore_snapshot()


def _run_looking_at_arrays(plan: SimulationPlan) -> tuple:
    """(substep, stage, arrays) after which something first was no number; stage None: at the begin. Empty: all went well."""
    arrays = {(part.name, f.name): part.arrays[f.name] for part in plan.state.parts.values() for f in part.fields}
    for part in plan.state.parts.values():
        for f in part.fields:
            if not f.persistent:
                part.arrays[f.name].zero_()              # nothing of it is read before it is written
    start = _first_bad_rows(arrays)
    if start:
        return 0, None, start
    found: list[tuple] = []
    stages = [s for m in plan.methods for s in m.stages]
    launches = [s.launch for s in stages]

    def launch_with_check(stage, launch):
        def check_after_launch(clock) -> None:
            launch(clock)
            bad = {} if found else _first_bad_rows(arrays)
            if bad:
                found.append((clock.k, stage, bad))
        return check_after_launch
    try:
        for stage, launch in zip(stages, launches, strict=True):
            stage.launch = launch_with_check(stage, launch)
        plan.stretch(0, plan.clock.substeps)
    finally:
        for stage, launch in zip(stages, launches, strict=True):
            stage.launch = launch
    return found[0] if found else ()


def _first_bad_rows(arrays: dict[tuple, wp.array]) -> dict[tuple, int]:
    """First row that is not finite of each array that has one."""
    found = {}
    for name, array in arrays.items():
        values = array.numpy()
        wrong = ~np.isfinite(values.reshape(len(values), -1)).all(axis=1)
        if wrong.any():
            found[name] = int(np.flatnonzero(wrong)[0])
    return found


def judge_recorded_run(recording, long: str) -> None:
    """Judges what a `wsim.gradient.recording.Recording` has run into: warns of residuals (long: of explicit steps). Raises
    SceneError where a position is no number."""
    plan, status = recording.plan, recording.plan.status
    status.fetch()
    if int(status.said(NOT_FINITE)[0]):
        bad = max(int(np.argmax(~np.isfinite(recording.states.numpy()).all(axis=(1, 2)))), 1)
        recording.rewind()
        for frame in range(bad - 1):
            recording.pose(frame)
            for part in range(len(recording.cuts) - 1):
                recording.forward(frame, part)
        plan.state.take_snapshot()
        plan.clock.starting = recording.begins and bad == 1
        said = first_fault_of_frame(plan, (recording.start + bad - 1) / recording.sim.scene.fps)
        raise SceneError(Problem("frame", f"a position is no number in frame {recording.start + bad}{said and f' ({said})'}; "
                                 "give it more substeps, or fewer frames"))
    if lost := next((name for name in status.places if name.endswith(": not finite") and status.said(name)[0]), ""):
        raise SceneError(Problem("frame", f"{lost}, in a frame of the recording; give it more substeps, or fewer frames"))
    if status.said(THROWN)[0]:
        recording.warn(long)
    if status.said(MISSED)[0]:
        recording.warn(f"/: gradients: {plan.integrator} leaves too large a residual; a simulation would go on with backward "
                       "Euler. Take more iterations or smaller substeps")


def describe_first_fault(plan: SimulationPlan, substeps: int, substep: int, stage, arrays: dict[tuple, int]) -> str:
    """arrays: row that is not finite, by part and field; substep of substeps: as `wsim.model.stage.Clock` counts them."""
    part, name = next((("points", n) for n in ("d", "v", "x") if ("points", n) in arrays), next(iter(arrays)))
    body, point = author_of_row(plan, part, arrays[part, name])
    meaning = next(f.meaning for f in plan.state.parts[part].fields if f.name == name)
    solves = plan.clock.integrator.solves
    where = "when the frame begins" if stage is None else (
        f"in substep {substep // solves + 1} of {substeps // solves}"
        f"{f' (stage {substep % solves + 1} of {plan.integrator})' * (solves > 1)}, stage {stage.name}")
    row = f"{'point' if part == 'points' else part} {point} of {body}"
    return f"first {where}: array {name} ({meaning}) of {row}"


def place_of_point(plan: SimulationPlan, path: str, row: int) -> str:
    """A point's place in words, " at (x, y, z) m"."""
    return f" at ({', '.join(f'{x:.4g}' for x in plan.state.x.numpy()[row] + plan.model.body(path).origin)}) m"


def author_of_row(plan: SimulationPlan, part: str, place: int) -> tuple[str, int]:
    """Path of the body, and number of the author's point (of another part: of the body's row), at a row of a part."""
    model = plan.model
    if part != "points":
        path, rows = next(((path, rows) for (path, _), rows in plan.state.parts[part].rows.items() if place in rows),
                          ("/", np.array([place])))             # a list of pairs belongs to no prim
        return path, int(np.flatnonzero(rows == place)[0])
    body = next(b for b in model.bodies if b.first <= place < b.last)
    where = np.flatnonzero(places_with_midnodes(body) == place)
    if not len(where):                                        # another body's point stands for it
        return body.path, -1
    return body.path, int(where[0]) if where[0] < len(body.index) else int(body.ends[where[0] - len(body.index), 0])
