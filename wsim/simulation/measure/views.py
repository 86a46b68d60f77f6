"""The arrays that a simulation works on, handed to other packages without a copy (DLPack).

    for name, view in arrays(simulation).items(): ...
    x = torch.from_dlpack(arrays(simulation)["positions"])         # (points, 3), the same memory
    x[view.index["/World/Cloth"]] + view.origin["/World/Cloth"]    # world positions in the author's order: one gather

    state                 every field that outlives a frame, behind each other, (fields * points, 3); `fields` of it
    positions, remainders, velocities      parts of it: x and e [m], the position is x + e + origin; v [m/s]
    inverse_masses        [1/kg], (points,); 0: pinned
    gravity, air_drag     [m/s^2], [1/s]; a row for each body, or for each point with gradients=True or loads
                          (of what bears one it is written anew each substep, with what that adds)
    wind, drag, lift      [m/s]; air density / 6 times the coefficients; rows as gravity
    normal_drag           a third of the coefficient [kg/(m^2 s)]; rows as gravity
    springs.stiffness, .damping, .rest     [N/m], [N s/m], [m] of entries; `index["springs"]`: spring of each, -1 padding
    dihedral.stiffness, .damping           [J], [s] of each hinge; membrane.stiffness, .damping [J], [s] of each triangle;
                                           under XPBD and Newton's method distance., dihedral., membrane.compliance
    PART.FIELD            every field of the other parts of the state but the energy balance, which only checks the run;
                          `index`: rows of each prim
    corotational.mu, .lam, .damping        [Pa], [Pa], [s] of each tet, so of each material model; pressure [Pa] of triangles

What is written into them is seen by the next frame, or the next run of a recording (which begins with `Recording.initial`, not
with the state). A later `Simulation.set` of a material writes all of it anew; `positions` and `velocities` of a simulation that
has just been built are its start. No view outlives a `reset`, or a change of the solver in mid-run. Newton's method with
gradients keeps materials twice, and they are not among these. On a GPU wait for the device (`wp.synchronize`) before another
package's stream reads what Warp has written, and the other way round.

JAX on a CPU takes memory without a copy where it is aligned to 64 bytes, as `state` is and all that is no part of it, and
float64 with `jax_enable_x64`; its arrays cannot be written.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import warp as wp

from wsim.simulation.simulation import Simulation

NAMES = {"x": "positions", "e": "remainders", "v": "velocities"}


@dataclass(frozen=True)
class ArrayView:
    """An array of a simulation with `__dlpack__`; vectors are rows of 3, matrices of 2 x 2 two axes more."""

    array: wp.array
    index: dict[str, np.ndarray] = field(default_factory=dict)       # author's point -> row, (n,), by path of the body
    origin: dict[str, np.ndarray] = field(default_factory=dict)      # [m] that positions are relative to, (3,), by path
    fields: tuple[str, ...] = ()                                     # of `state`

    def __dlpack__(self, **how) -> Any:
        return wp.to_dlpack(self.array)

    def __dlpack_device__(self) -> Any:
        return self.array.__dlpack_device__()


def arrays(source, world: int = 0) -> dict[str, ArrayView]:
    """Views by name of a `Simulation`, or of a `wsim.gradient.recording.Recording`, whose `initial` is the state then. world:
    whose points the indices are of; the arrays hold all."""
    sim: Simulation = getattr(source, "sim", source)
    plan, model = sim.plan, sim.model
    watch = plan.ports.balance
    parts = [part for part in sim.state.parts.values() if part.name != "points" and not (watch and part is watch.part)]
    others = {f"{part.name}.{f.name}": ArrayView(part.arrays[f.name], {p: r for (p, of), r in part.rows.items() if of == world})
              for part in parts for f in part.fields}
    bodies = [b for b in model.bodies if b.world == world]
    if not bodies:
        return others
    index, origin = {b.path: b.index for b in bodies}, {b.path: b.origin for b in bodies}
    kept = tuple(sim.state.points.names)
    whole: Any = getattr(source, "initial", sim.state.points.every)
    found = others | {"state": ArrayView(whole, index, origin, kept)}
    for k, name in enumerate(kept):
        if name in NAMES:
            found[NAMES[name]] = ArrayView(whole[k * model.points:(k + 1) * model.points], index, origin)
    constants = plan.ports.constants
    points = index if model.by_point else {}
    found["inverse_masses"] = ArrayView(constants.w, index)
    found["gravity"], found["air_drag"] = ArrayView(constants.gravity, points), ArrayView(constants.decay, points)
    if air := plan.ports.air:
        found |= {name: ArrayView(getattr(air, name), points) for name in ("wind", "drag", "lift", "normal_drag")}
    return found | _views_of_materials(plan)


def _views_of_materials(plan) -> dict[str, ArrayView]:
    """Of whichever method solves for the forces."""
    twice = plan.ports.solve_adjoint is not None              # Newton's method keeps them for the solve and for its adjoint
    found, pull = {}, None if twice else plan.ports.force_gather
    if pull is not None and pull.springs:
        entry = {"springs": np.asarray(pull.entry)}
        for name, own in (("stiffness", "k"), ("damping", "damping"), ("rest", "rest")):
            if name != "damping" or pull.damped:
                found[f"springs.{name}"] = ArrayView(getattr(pull.table, own), entry)
    flat = [] if pull is None else [e for e in pull.elements if hasattr(e, "kind")]
    batches = ([] if twice else plan.ports.newton_tables) + plan.ports.xpbd_batches
    for source, own, name in [(e, "stiffness", "stiffness") for e in flat] + [(b, "alpha", "compliance") for b in batches]:
        found[f"{source.kind}.{name}"] = ArrayView(getattr(source.data, own))
        if source.data.tau is not None:
            found[f"{source.kind}.damping"] = ArrayView(source.data.tau)
    for table in [] if twice else plan.solids:
        if table.name == "pressure":
            found["pressure"] = ArrayView(table.data.pressure)
        else:
            found |= {f"{table.name}.{name}": ArrayView(getattr(table.data, own))
                      for name, own in (("mu", "mu"), ("lam", "lam"), ("damping", "tau"))}
    return found
