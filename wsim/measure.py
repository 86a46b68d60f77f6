"""Energy, strain and the closing report: what a user reads to trust a run. NumPy in float64 on what the device holds.

    kinetic    1/2 sum m v^2 [J]            gravity   -sum m g.x [J], from the origin of the world
    strain     |length - rest| / rest of every edge of a cloth or spring
"""

import numpy as np
import warp as wp

from wsim.model import Body, edge_lengths
from wsim.plan import Plan


def edge_strain(body: Body, x: np.ndarray) -> np.ndarray:
    """Signed strain of every edge with a rest length, (m,)."""
    rest = edge_lengths(body)
    good = rest > 0.0
    ends = x[body.edges[good]]
    return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / rest[good] - 1.0


def gather(plan: Plan, x: np.ndarray, v: np.ndarray) -> dict[str, float]:
    """Indicators of every method and of the points: strain, energies [J], and what each method adds.

    x [m] relative to each body's origin and v [m/s], solver order, float64.
    """
    model = plan.model
    masses = model.stack("masses")
    constants = plan.methods[0].constants            # type: ignore[attr-defined]
    free = constants.w.numpy() > 0.0
    gravity = constants.gravity.numpy().astype(np.float64)
    strains = [edge_strain(b, x) for b in model.bodies if len(b.edges)]
    out: dict[str, float] = {}
    if strains:
        strain = np.concatenate(strains)
        out["max_strain"] = float(np.abs(strain).max(initial=0.0))
        out["rms_strain"] = float(np.sqrt(np.mean(strain**2))) if len(strain) else 0.0
    out["kinetic_energy"] = float(0.5 * np.sum(masses * free * np.sum(v**2, axis=1)))
    out["gravity_energy"] = float(-sum(
        np.sum(masses[b.first:b.last, None] * (x[b.first:b.last] + b.origin) * gravity[b.number]) for b in model.bodies))
    for method in plan.methods:
        out |= method.indicators(x, v)
    out["energy"] = out["kinetic_energy"] + out["gravity_energy"] + out.get("elastic_energy", 0.0)
    return out


def profile(plan: Plan) -> dict[str, float]:
    """Milliseconds a substep of each stage, launched one by one from the current state, which is put back."""
    from time import perf_counter
    plan.state.snapshot()
    spent: dict[str, float] = {}
    clock, repeats = plan.clock, 3
    device = plan.model.device
    for stage in (s for m in plan.methods for s in m.stages if s.rate != "frame"):
        times = clock.iterations if stage.rate == "iteration" else 1
        clock.k = clock.i = 0
        stage.launch(clock)
        wp.synchronize_device(device)
        began = perf_counter()
        for _ in range(repeats):
            stage.launch(clock)
        wp.synchronize_device(device)
        spent[stage.name] = 1e3 * times * (perf_counter() - began) / repeats
    plan.state.restore()
    return spent


def rows(plan: Plan) -> tuple[int, int]:
    """Springs, triangles, hinges, limits, tets of all methods; and how many are worked on in a substep: once each in a sweep, a
    Newton step, an evaluation of the forces."""
    clock, integrator = plan.clock, plan.choice.integrator
    swept = getattr(plan.method("xpbd"), "constraints", 0)
    implicit, explicit = plan.method("implicit"), plan.method("explicit")
    newton = sum(t.size for t in (*getattr(implicit, "tables", {}).values(), *getattr(implicit, "solids", [])))
    pulled = sum(len(r.ids) for r in getattr(explicit, "rows", []))
    pulled += sum(t.size for t in explicit.pull.tables) if explicit else 0             # type: ignore[attr-defined]
    return swept + newton + pulled, (swept + newton) * clock.iterations + pulled * integrator.forces


def report(sim, with_profile: bool = True) -> dict:
    """What ran and how well, ready for JSON. ms of a stage are those of single launches, without the graph's saving."""
    plan, times = sim.plan, sim.milliseconds
    later = times[1:] or times
    ms = float(np.mean(later)) if later else 0.0
    spent = profile(plan) if with_profile and sim.frame else {}
    constraints, a_substep = rows(plan)
    a_second = 1e3 * plan.clock.substeps / ms if ms else 0.0
    return {
        "device": str(sim.device), "device_name": sim.device.name, "precision": sim.precision, "worlds": sim.worlds,
        "frames": sim.frame, "substeps": plan.clock.substeps, "iterations": plan.clock.iterations,
        "solver": plan.choice.solver, "integrator": plan.integrator, "why": plan.choice.why,
        "points": plan.model.points, "constraints": constraints, "ms_per_frame": ms,
        "points_per_second": plan.model.points * a_second,
        "constraints_per_second": a_substep * a_second,
        "seconds": dict(sim.seconds), "error": sim.indicators(),
        "stages": [{k: r[k] for k in ("name", "phase", "launches", "bytes")} | {"ms": spent.get(r["name"])}
                   for r in plan.table()],
        "skipped": plan.skipped, "warnings": sim.warnings,
    }
