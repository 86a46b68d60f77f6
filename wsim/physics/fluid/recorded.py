"""Fluids of a recording: their fields after each frame, what a loss of them adds, and the frames as a tape has them.

A frame is one entry of the tape, since how many steps it takes is known on the device alone: it runs as it would without a
tape, and leaves each step's velocities for the adjoint (`wsim.physics.fluid.adjoint.step`). Those stand in the memory of the
tape, so that checkpoints bound them.
"""

from typing import Any

import numpy as np
import warp as wp

from wsim.model.stage import Clock
from wsim.model.tape import add_and_clear_gradient, without_gradient
from wsim.physics.fluid.adjoint.gradient import FluidGradient
from wsim.physics.fluid.adjoint.step import DomainAdjoint
from wsim.physics.fluid.adjoint.trace import Trace
from wsim.physics.fluid.grid.multigrid import AXES
from wsim.physics.fluid.measure import NAMES, fields_at_centers
from wsim.scene import Problem, SceneError
from wsim.scene.values.coverage import gradient_refusal

FIELDS = {"smoke": "smoke", "temperature": "heat", "velocity": ""}            # of a loss, by what scalars are called


class RecordedFluids:
    """frames: what the numbers of sources, and of what moves, got in each frame, the last one first."""

    def __init__(self, method: Any):
        self.method, self.model = method, method.model
        self.adjoints = [DomainAdjoint(domain) for domain in method.domains]
        self.kept: list[dict[str, wp.array]] = []
        self.begun: dict[tuple[int, str], np.ndarray] = {}           # fields that were put where the recording begins
        self.loaded = False

    # frames

    def frame(self, k: int, clock: Clock, least: int, most: int) -> None:
        """Frame of fluid k, recorded."""
        tape, domain, adjoint = self.model.tape, self.method.domains[k], self.adjoints[k]
        if not self.loaded:
            adjoint.launches.load()
        self.loaded = k + 1 == len(self.adjoints)
        arrays, dt, real = self.arrays(k), clock.dt, self.model.real
        read = [tape.read(a) for a in arrays.values()]
        wrote = [tape.write(a, True) for a in arrays.values()]
        trace = Trace(adjoint.launches, most, lambda n: tape.slots.plain.take(real, (n,)))

        def run_recorded_frame() -> None:
            for base, version in zip(arrays.values(), read, strict=True):
                wp.copy(base, without_gradient(version))
            domain.trace = trace
            domain.frame(dt, least, most)
            domain.trace = None
            wp.copy(trace.clock, domain.clock)
            for base, version in zip(arrays.values(), wrote, strict=True):
                wp.copy(without_gradient(version), base)
        tape.do(run_recorded_frame)

        def run_frame_adjoint() -> None:
            own = self.frame_cotangents(k)
            for by, version in zip(own, wrote, strict=True):
                wp.copy(by, version.grad)
                version.grad.zero_()
            adjoint.frame(trace)
            for by, version in zip(own, read, strict=True):
                add_and_clear_gradient(by, version.grad)
        tape.adjoints.append(run_frame_adjoint)

    def arrays(self, k: int) -> dict[str, wp.array]:
        """Arrays of the state of fluid k, by name."""
        layout = self.method.layouts[k]
        return {name: self.method.field(k, name) for name in (*NAMES[:layout.dim], *self.method.carried[k])}

    def frame_cotangents(self, k: int) -> list[wp.array]:
        """Cotangents in the order of `arrays`."""
        a = self.adjoints[k]
        return [*(getattr(a.by, AXES[b]) for b in range(self.method.layouts[k].dim)), *a.by_scalars.values()]

    def bytes(self, frames: int) -> int:
        """Bytes of what `allot` takes for so many frames."""
        return (frames + 1) * sum(a.capacity for k in range(len(self.adjoints)) for a in self.arrays(k).values())

    def allot(self, frames: int) -> None:
        self.kept = [{name: wp.zeros((frames + 1, a.size), dtype=a.dtype, device=a.device)
                      for name, a in self.arrays(k).items()}
                     for k in range(len(self.adjoints))]

    def keep(self, frame: int) -> None:
        for k, kept in enumerate(self.kept):
            for name, array in self.arrays(k).items():
                wp.copy(kept[name][frame], array)

    # what is seen, and a loss of it

    def row(self, path: str, world: int = 0) -> int:
        """Number of a fluid. Raises SceneError where there is no such one."""
        for k, (fluid, of) in enumerate(self.method.pairs):
            if (fluid.path, of) == (path, world):
                return k
        raise SceneError(Problem(path, f"is no fluid of world {world}; there are "
                                 f"{', '.join(dict.fromkeys(f.path for f, _ in self.method.pairs))}"))

    def runs(self, path: str, name: str) -> None:
        """Raises SceneError where nothing of a value runs in the fluids that it is of."""
        method, whys = self.method, []
        for k, domain in enumerate(method.domains):
            sources = domain.sources.sources if domain.sources else []
            if domain.fluid.path == path:
                whys.append(why_fluid_value_idle(domain, method.carried[k], name))
            whys += [why_source_unheard(domain, method.carried[k], s, name) for s in sources if s.path == path]
        if not whys or all(whys):
            raise gradient_refusal("still", path, name=name, why=next(filter(None, whys), "no fluid is reached"))

    def fields(self, frame: int, path: str, world: int = 0) -> dict[str, np.ndarray]:
        """smoke, temperature (nx, ny, nz), velocity (nx, ny, nz, 3) at the cells' centres after so many frames, float64."""
        k = self.row(path, world)
        layout, fluid = self.method.layouts[k], self.method.pairs[k][0]
        shapes = {NAMES[a]: layout.faces(a) for a in range(layout.dim)} | dict.fromkeys(self.method.carried[k], layout.n)
        now = {name: a[frame].numpy().astype(np.float64).reshape(shapes[name]) for name, a in self.kept[k].items()}
        found = fields_at_centers(fluid, layout, now, np.float64)
        return {"smoke" if name == "density" else name: values for name, values in found.items()}

    def losses(self, frames: int, given: dict | None) -> "FluidLosses":
        return FluidLosses(self, frames, given or {})


def why_fluid_value_idle(domain: Any, carried: tuple[str, ...], name: str) -> str:
    """Reason why nothing of a value of a fluid runs, or ""."""
    for called, scalar in (("smoke", "smoke"), ("weight", "smoke"), ("smoke_decay", "smoke"), ("temperature", "heat"),
                           ("lift", "heat"), ("cooling", "heat")):
        if name == called and scalar not in carried:
            return f"there is no {'smoke' if scalar == 'smoke' else 'heat'} in it"
    none = (name == "viscosity" and domain.viscosity is None) or (name == "vorticity" and not domain.swirling)
    if name == "acceleration" and domain.field is None:
        return "there is none at the start"
    return "it is 0 at the start" if none else ""


def why_source_unheard(domain: Any, carried: tuple[str, ...], source: Any, name: str) -> str:
    """Reason why nothing of a value of a source runs in a fluid, or ""."""
    if name in ("smoke", "temperature") and FIELDS[name] not in carried:
        return f"there is no {'smoke' if name == 'smoke' else 'heat'} in {domain.fluid.path}"
    if name == "velocity" and source.velocity is None:
        return "it leaves the air alone; give it a velocity"
    return "it is 0 of all sources" if name == "expansion" and domain.sources.expansion is None else ""


class FluidLosses:
    """Derivatives of a loss by fields of fluids, {frame: {path, or (path, world): {"smoke", "temperature" (nx, ny, nz),
    "velocity" (nx, ny, nz, 3)}}}, frame by frame on the way back."""

    def __init__(self, recorded: RecordedFluids, frames: int, given: dict):
        self.recorded, self.given = recorded, {}
        for frame, each in given.items():
            if not 0 <= frame <= frames:
                raise SceneError(Problem("fluids", f"found frame {frame}; allowed are 0 to {frames}"))
            self.given[frame] = [pair for key, fields in each.items() for pair in self.dense(key, fields)]
        for a in recorded.adjoints:
            a.launches.numbers.zero_()
            if a.forces.field is not None:
                a.forces.field.zero_()
            a.projection.worst.zero_()
        self.frames: list[list[tuple]] = []

    def dense(self, key: Any, fields: dict) -> list[tuple[wp.array, np.ndarray]]:
        """(array of the state, derivative by it), of a fluid. Raises SceneError for shapes and names that are none."""
        path, world = key if isinstance(key, tuple) else (key, 0)
        r = self.recorded
        k = r.row(path, world)
        fluid, layout, arrays = r.method.pairs[k][0], r.method.layouts[k], r.arrays(k)
        found = []
        for name, values in fields.items():
            values, shape = np.asarray(values, np.float64), (*fluid.shape, *[3] * (name == "velocity"))
            if name not in FIELDS or (name != "velocity" and FIELDS[name] not in arrays):
                have = ", ".join(n for n, called in FIELDS.items() if not called or called in arrays)
                raise SceneError(Problem(path, f"has no field {name!r}; there are {have}"))
            if values.shape != shape or not np.isfinite(values).all():
                raise SceneError(Problem(path, f"derivatives by {name} must be finite with shape {shape}; found "
                                         f"{values.shape}"))
            if name == "velocity":
                found += [(arrays[NAMES[a]], layout.transpose_centered(values[..., axis], a))
                          for a, axis in enumerate(layout.axes)]
            else:
                found.append((arrays[FIELDS[name]], values.ravel()))
        return found

    def at(self, frame: int) -> list[tuple[wp.array, np.ndarray]]:
        """(array of the state, what the loss adds to its gradient) after so many frames."""
        return [(array, values.ravel()) for array, values in self.given.get(frame, ())]

    def take(self) -> None:
        """A frame was undone: what sources and what moves got in it."""
        found = []
        for a in self.recorded.adjoints:
            of = [each.numbers for each in (a.sources, a.obstacles) if each is not None and each.numbers is not None]
            found.append(tuple(wp.clone(array) for array in of))
            for array in of:
                array.zero_()
        self.frames.append(found)

    @property
    def worst(self) -> float:
        """The largest residual, over its right-hand side, of an adjoint solve of the pressure."""
        return max(float(a.projection.worst.numpy()[0]) for a in self.recorded.adjoints)

    def gradient(self, states: Any, start: int) -> FluidGradient:
        """states: derivatives by the state where the recording begins, by address; start: its frame."""
        return FluidGradient(self, states, start)
