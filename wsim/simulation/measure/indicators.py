"""Energy, strain and the closing report: what a user reads to trust a run. NumPy in float64 on what the device holds.

    kinetic    1/2 sum m v^2 [J]            gravity   -sum m g.x [J], from the origin of the world
    strain     |length - rest| / rest of every edge of a cloth or spring

Where nothing of the scene takes energy and nothing moves it, the energy of a run changes by the integrator alone, which for
implicit ones is their numerical damping:

    energy_change      (E - E at the start) / what was turned over: the largest of the kinetic energies seen, of kinetic and
                       elastic energy at both ends, and of what gravity gave or took
"""

from dataclasses import dataclass
from math import inf

import numpy as np
import warp as wp

from wsim.model.model import PointBody, edge_lengths
from wsim.scene import Pin
from wsim.scene.curve import Curve
from wsim.scene.methods import has_other_objects
from wsim.simulation.duration import warn_of_missed_rate
from wsim.simulation.measure.exceeded import warn_of_depth
from wsim.simulation.plan import SimulationPlan

STILL = 1e-6          # of what gravity would give over the size of a body: less turned over is what float32 leaves of rest
PLACED = 1e-5         # of the size of a body that a pin may be away from its points


def edge_strain(body: PointBody, x: np.ndarray) -> np.ndarray:
    """Signed strain of every edge with a rest length, (m,)."""
    rest = edge_lengths(body)
    good = rest > 0.0
    ends = x[body.edges[good]]
    return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / rest[good] - 1.0


def gather_indicators(plan: SimulationPlan, x: np.ndarray, v: np.ndarray) -> dict[str, float]:
    """Indicators of every method and of the points: strain, energies [J], and what each method adds.

    x [m] relative to each body's origin and v [m/s], solver order, float64.
    """
    out = _indicators_of_points(plan, x, v) if plan.model.bodies else {}
    for method in plan.methods:
        out |= method.indicators(x, v)
    if "shape_energy" in out:
        out["elastic_energy"] = out.get("elastic_energy", 0.0) + out["shape_energy"]
    if plan.model.bodies:
        out["energy"] = out["kinetic_energy"] + out["gravity_energy"] + out.get("elastic_energy", 0.0)
    return out


def _indicators_of_points(plan: SimulationPlan, x: np.ndarray, v: np.ndarray) -> dict[str, float]:
    model, points = plan.model, plan.ports.points
    masses = model.stack("masses")
    masses[model.gone] = 0.0
    if plan.ports.arrivals:
        masses[plan.ports.arrivals.absent_places()] = 0.0
    free = points.constants.w.numpy() > 0.0
    gravity = points.gravity().astype(np.float64)
    strains = [edge_strain(b, x) for b in model.bodies if len(b.edges)]
    out: dict[str, float] = {}
    if strains:
        strain = np.concatenate(strains)
        out["max_strain"] = float(np.abs(strain).max(initial=0.0))
        out["rms_strain"] = float(np.sqrt(np.mean(strain**2))) if len(strain) else 0.0
    out["kinetic_energy"] = float(0.5 * np.sum(masses * free * np.sum(v**2, axis=1)))
    out["gravity_energy"] = float(-sum(
        np.sum(masses[b.first:b.last, None] * (x[b.first:b.last] + b.origin) * gravity[b.first:b.last]) for b in model.bodies))
    return out


# what the integrator itself takes away

@dataclass
class IntegratorBalance:
    """A run from where it was last placed, in which nothing but its integrator takes energy."""

    plan: SimulationPlan
    frame: int                    # where it begins
    state: wp.array               # all persistent fields there
    changes: int                  # live parameters that had been set
    most: float = 0.0             # largest kinetic energy seen [J]
    next: int = 1                 # frames after the beginning at which it is looked at again: 1, 2, 3, 4, 6, 8, 12, 16 ...

    def look(self, sim) -> None:
        """Looks at the energy after a frame; now and then."""
        if sim.frame - self.frame < self.next:
            return
        power = 1 << (self.next.bit_length() - 1)
        self.next = 2 * power if self.next > power else max(power + power // 2, self.next + 1)
        v = self.plan.state.v.numpy().astype(np.float64)
        self.most = max(self.most, float(0.5 * np.sum(self.plan.model.stack("masses") * np.sum(v**2, axis=1))))

    def change(self, sim) -> dict[str, float]:
        """energy_change and energy_change_seconds, or nothing where something else has changed it, or nothing moved."""
        if sim.plan is not self.plan or len(sim.changes) != self.changes or sim.frame == self.frame:
            return {}
        now, plan = sim.indicators(), self.plan
        turned = [t.q for t in plan.solids]                  # rotations of the present state, from which others are sought
        kept = [wp.clone(q) for q in turned]
        plan.state.take_snapshot()
        wp.copy(plan.state.points.every, self.state)
        for table in plan.solids:
            table.forget()
        first = sim.indicators()
        plan.state.restore_snapshot()
        for q, before in zip(turned, kept, strict=True):
            wp.copy(q, before)
        own = [e["kinetic_energy"] + e.get("elastic_energy", 0.0) for e in (first, now)]
        over = max(self.most, *own, abs(now["gravity_energy"] - first["gravity_energy"]))
        weight = float(np.sum(plan.model.stack("masses"))) * float(np.linalg.norm(sim.scene.gravity))
        extent = max(float(np.ptp(b.places, axis=0).max(initial=0.0)) for b in plan.model.bodies)
        if not over > STILL * weight * extent:               # at rest
            return {}
        return {"energy_change": (now["energy"] - first["energy"]) / over,
                "energy_change_seconds": (sim.frame - self.frame) / sim.scene.fps}


def begin_integrator_balance(sim) -> IntegratorBalance | None:
    """Energy balance of a run that begins here by an implicit integrator; None where something else takes energy or gives
    some."""
    if not sim.model.bodies or sim.plan.choice.integrator.explicit or not energy_is_conserved(sim):
        return None
    return IntegratorBalance(sim.plan, sim.frame, wp.clone(sim.state.points.every), len(sim.changes))


def energy_is_conserved(sim) -> bool:
    """True if energy stays: no contacts, damping, drag, limits, pressure or loads, and pins that hold points where they are."""
    scene = sim.scene
    lossy = [bool(scene.colliders), scene.air_drag, bool(scene.varying or scene.loads)]
    lossy += [isinstance(value, Curve) for _, _, value, _ in sim.changes]
    lossy += [body.loses_energy for body in scene.bodies()]
    return not (any(lossy) or has_other_objects(scene)) and all(_pin_stays_in_place(sim, pin) for pin in scene.pins)


def _pin_stays_in_place(sim, pin: Pin) -> bool:
    """Whether a pin is hard, does not move, and finds its points where it holds them."""
    if pin.follows is not None or pin.stiffness < inf or np.ptp(pin.motion.values, axis=0).any():
        return False
    body = next(b for b in sim.scene.bodies() if b.path == pin.body)
    start = body.motion.points(body.points)
    held = start[pin.points] if pin.places is None else pin.motion.points(pin.places)
    return bool(np.abs(sim.positions(pin.body)[pin.points] - held).max(initial=0.0) <= PLACED * np.ptp(start, axis=0).max())


def profile_stages(plan: SimulationPlan) -> dict[str, float]:
    """Milliseconds a substep of each stage, launched one by one from the current state, which is put back."""
    from time import perf_counter
    plan.state.take_snapshot()
    spent: dict[str, float] = {}
    clock, repeats = plan.clock, 3
    device = plan.model.device
    for stage in (s for m in plan.methods for s in m.stages if s.rate != "frame" and s.frames in ("", clock.form)):
        times = clock.iterations if stage.rate == "iteration" else 1
        clock.k = clock.i = 0
        stage.launch(clock)
        wp.synchronize_device(device)
        began = perf_counter()
        for _ in range(repeats):
            stage.launch(clock)
        wp.synchronize_device(device)
        spent[stage.name] = 1e3 * times * (perf_counter() - began) / repeats
    plan.state.restore_snapshot()
    return spent


def count_constraint_rows(plan: SimulationPlan) -> tuple[int, int]:
    """Springs, triangles, hinges, limits, tets of all methods; and how many are worked on in a substep: once each in a sweep, a
    Newton step, an evaluation of the forces."""
    clock, integrator, found = plan.clock, plan.choice.integrator, plan.ports.constraint_rows
    hard, soft = (sum(len(r.ids) for r in found if r.hard == which) for which in (True, False))
    soft += sum(table.size for table in plan.solids)
    return hard + soft, hard * clock.iterations + soft * (integrator.forces if integrator.explicit else clock.iterations)


def _acting_limits_text(sim) -> str:
    """How many tethers and strain limits act now, in words."""
    from wsim.simulation.measure.limits import acting_limits, describe_acting_limits
    return describe_acting_limits(acting_limits(sim.plan, sim.state.x.numpy().astype(np.float64)))


def make_run_report(sim, with_profile: bool = True) -> dict:
    """Report of what ran and how well, ready for JSON. ms of a stage are those of single launches, without the graph's
    saving."""
    plan, times = sim.plan, sim.milliseconds
    later = times[1:] or times
    ms = float(np.mean(later)) if later else 0.0
    error = sim.indicators() | (sim.balance.change(sim) if sim.balance else {})          # of the state before it is profiled
    limits = {"limits": _acting_limits_text(sim)} if plan.hard else {}
    deep = warn_of_depth(sim, error.get("penetration", 0.0))
    spent = profile_stages(plan) if with_profile and sim.frame else {}
    constraints, a_substep = count_constraint_rows(plan)
    a_second = 1e3 * plan.clock.substeps / ms if ms else 0.0
    forms = {"forms": dict(sim.forms)} if plan.parted else {}
    sizes = {name: sum(map(len, part.rows.values())) or part.count                     # strands of all lengths have equal rows
             for name, part in plan.state.parts.items()                                # not "grid x", which is of the grid
             if name != "points" and " " not in name and part.count}
    return {
        "device": str(sim.device), "device_name": sim.device.name, "precision": sim.precision, "worlds": sim.worlds,
        "frames": sim.frame, "substeps": plan.clock.steps, "iterations": plan.clock.iterations,
        "solver": plan.choice.solver, "integrator": plan.integrator, "why": plan.choice.why,
        "raised": plan.choice.need.told(plan.model.scene, plan.choice.substeps),
        "points": plan.model.points, "constraints": constraints, "sizes": sizes, "ms_per_frame": ms,
        "points_per_second": plan.model.points * a_second,
        "constraints_per_second": a_substep * a_second, "bodies_per_second": sizes.get("bodies", 0) * a_second,
        "seconds": dict(sim.seconds), "captures": sim.graphs.told(), "error": error,
        "host": sim.host.told(plan.methods),
        "predicted": {"ms_per_frame": 1e3 * plan.seconds, "error": plan.choice.error,
                      **(sim.measured.report() if sim.measured else {})},
        "stages": [{k: r[k] for k in ("name", "phase", "launches", "bytes")} | {"ms": spent.get(r["name"])}
                   for r in plan.table()],
        "kept": [k for method in plan.methods for k in method.kept_distances()],
        "skipped": plan.skipped, "repeats": list(sim.repeats),
        "warnings": [*sim.warnings, *warn_of_missed_rate(sim.fps, later), *deep,
                     *(w for each in (sim.measured, sim.settled) if each for w in each.warnings())],
        **({"balance": watch.report()} if (watch := plan.ports.balance) else {}), **limits, **forms,
    }
