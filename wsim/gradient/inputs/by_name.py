"""What a recording begins with and reads, by name: values that can be read, written and differentiated by.

    /World/Cloth:positions, :velocities      (n, 3) [m], [m/s] where the recording begins, in world space, author's order
    /World/Cloth:rest_shape                  (n, 3) [m] where points are at rest; of a net :lengths, (edges,) [m]
    /World/Cloth:stretch, :density, ...      () one value of a live parameter, or (elements,) one for each element
    /World/Net:actuation                     factors of a net's muscles, (keys, groups) of its curve
    /World/Pin:targets                       where a pin puts its points [m]: (frames, moments of a frame, n, 3), see
                                             `wsim.model.stage.Clock.moments`, or (n, 3) if it is still
    /World/Load:force, :traction             of a load [N], [Pa]: (3,), or (keys, 3) of its curve
    /World/Bones:turns, :weights             of a skeleton that is followed: `wsim.gradient.inputs.skeletons`
    gravity, wind                            (3,) [m/s^2], [m/s] of the whole scene
    air_drag                                 () [1/s]
    friction, restitution, colliders' shifts: `wsim.gradient.inputs.contact`; keys, tangents, easing handles and turns of
    pins and colliders: `wsim.gradient.inputs.path`; of rigid bodies: `wsim.gradient.inputs.bodies`, of fluids: `.fluids`

Elements are springs and tets in the author's order, hinges in the solver's. With several worlds a value may have one axis more,
the worlds, in front; without it all worlds share the value. Points that are one particle (a weld, a tie) have one place: that
of the last of them.
"""

import numpy as np

from wsim.gradient.inputs.base import PART, RecordingInput, StartInput
from wsim.gradient.inputs.bodies import BodyValue
from wsim.gradient.inputs.contact import ContactInput, ShiftInput
from wsim.gradient.inputs.controls import ActuationInput, LoadInput, TargetsInput
from wsim.gradient.inputs.fluids import FluidValue, SurfaceInput
from wsim.gradient.inputs.grains import MaterialPointValue
from wsim.gradient.inputs.path import PathInput
from wsim.gradient.inputs.rest import RestInput
from wsim.gradient.inputs.skeletons import BlendWeightsInput, JointTurnsInput
from wsim.scene import Deformable, Problem, SceneError
from wsim.scene.methods import object_at_path
from wsim.scene.nodal.masses import single_density
from wsim.scene.values.coverage import differentiable_row, gradient_refusal, no_derivative_error
from wsim.scene.values.table import limits_explicit_steps


class SceneInput(RecordingInput):
    """gravity, wind or air_drag, of the whole scene."""

    def read_value(self, world: int = 0) -> np.ndarray:
        p = self.recording.parameters
        fluids = self.recording.fluids
        if self.what == "wind" and not (p.air or fluids):
            raise gradient_refusal("wind", self.name)
        points = p.plan.ports.points
        if fluids and not p.bodies and (points is None or self.what == "wind" and not p.air) and self.what != "air_drag":
            return getattr(fluids.method, self.what)[world].copy()
        if points is None and p.bodies and self.what == "gravity":
            return p.bodies.method.gravity[world].copy()
        if points is None and self.recording.grains and self.what == "gravity":
            return self.recording.grains.method.gravity[world].copy()
        if points is None:
            raise gradient_refusal("idle", self.name, name=self.what)
        array = points.gravity() if self.what == "gravity" else (p.air.wind if self.what == "wind" else p.points.decay).numpy()
        rows = array.astype(np.float64)[self.model.rows("/", world)]
        if (rows != rows[0]).any():
            raise SceneError(Problem(self.name, "is not the same for all bodies, and has no one value"))
        return rows[0]

    def difference_scale(self) -> float:
        return PART * max(1.0, float(np.abs(self.read_value()).max()))


class DensityInput(RecordingInput):
    """Density of a body whose masses follow it."""

    def read_value(self, world: int = 0) -> np.ndarray:
        body = self.model.body(self.path, world)
        density = self.sim.plan.ports.densities.get(body.number) or single_density(body.source)
        if density is None:
            raise gradient_refusal("density", self.path)
        return np.array(density)



class MassInput(RecordingInput):
    """Mass of a net."""

    def read_value(self, world: int = 0) -> np.ndarray:
        body = self.model.body(self.path, world)
        return np.array(body.masses.sum())



class MaterialInput(RecordingInput):
    """A live parameter of a material, one for the body or one for each element."""

    def values(self, body) -> list[np.ndarray]:
        """Gradients by the tables that have it, one for each element."""
        rows = self.recording.parameters.rows(body)
        found = [np.broadcast_to(r.stiffness[self.what], len(r.ids)) for r in rows if self.what in r.stiffness]
        if self.what == "damping":
            found += [np.full(len(r.ids), r.tau) for r in rows if r.tau > 0.0]
        for table in self.recording.parameters.tables:
            found += [np.array([v]) for b, v in zip(getattr(table, "bodies", ()), getattr(table, "values", ()), strict=True)
                      if b is body and self.what == "pressure"]
            if self.what == "yield_strain" and table.plastic:
                found += [np.unique(y[np.isfinite(y)]) for p, y in zip(table.parts, table.plastic.limits, strict=True)
                          if p.body is body]
        return found + [part.values[self.what] for part in self.tets(body)]

    def tets(self, body) -> list:
        return [part for table in self.recording.parameters.tables for part in table.parts
                if part.body is body and self.what in part.values]

    def read_value(self, world: int = 0) -> np.ndarray:
        """One value where all elements have the same, else that of each element."""
        body = self.model.body(self.path, world)
        found = self.values(body)
        if not found:
            raise no_derivative_error(self.path, self.what, self.row.owner, self.names(self.recording, body))
        every = self.sorted(np.concatenate(found).astype(np.float64), body)
        return np.array(every[0]) if (every == every[0]).all() else every

    def sorted(self, values: np.ndarray, body) -> np.ndarray:
        """Values of tets, which stand by their materials: in the author's order."""
        parts = self.tets(body)
        if parts:
            values[np.concatenate([part.rows for part in parts])] = values.copy()
        return values

    @staticmethod
    def names(recording, body) -> list[str]:
        """Names of a body that can be written, besides where it is."""
        more = ["density"] * (single_density(body.source) is not None) + ["mass"] * body.source.is_net
        return sorted({*recording.parameters.names(body), *more})

    def allowed_numbers(self, value: np.ndarray) -> np.ndarray:
        """0 too: what is slackened to nothing has a derivative."""
        return super().allowed_numbers(value) | ((value == 0.0) & (self.row.range.low == 0.0))

    def value_shapes(self) -> list[tuple[int, ...]]:
        body = self.model.body(self.path)
        count = sum(len(each) for each in self.values(body))
        single = count == 1 or self.what == "yield_strain" or (self.what == "damping" and not self.tets(body))
        return [()] if single else [(), (count,)]

    def gradient(self, gradient, world: int, shape: tuple[int, ...]) -> np.ndarray:
        found = np.asarray(gradient.value(self.path, self.what, world, elements=bool(shape)))
        return self.sorted(found, self.model.body(self.path, world)) if shape else found

    def difference_scale(self) -> float:
        """Scale of the value; of Poisson's ratio a part of what is left to its ends."""
        value = self.read_value()
        if self.what == "poisson":
            return PART * float(np.minimum(0.5 - value, 1.0 + value).min())
        return PART * float(np.abs(value).min())


def inputs_by_name(recording, names) -> dict[str, RecordingInput]:
    """Inputs by name. Raises SceneError with every name that is none, or nothing can be differentiated by."""
    found: dict[str, RecordingInput] = {}
    problems: list[Problem] = []
    for name in names:
        try:
            found[name] = _input_of_name(recording, name)
            found[name].read_value()
        except SceneError as error:
            problems += error.problems
        if list(names).count(name) > 1:
            problems.append(Problem(name, "is named twice; name it once"))
    if problems or not found:
        raise SceneError(list(dict.fromkeys(problems)) or Problem("inputs", "none is named"))
    return found


KINDS: dict[str, type[RecordingInput]] = {"start": StartInput, "whole": SceneInput, "density": DensityInput, "mass": MassInput,
                                          "material": MaterialInput,
                                          "rest": RestInput, "actuation": ActuationInput, "load": LoadInput,
                                          "targets": TargetsInput, "contact": ContactInput,
                                          "shift": ShiftInput, "surface": SurfaceInput, "path": PathInput, "body": BodyValue,
                                          # by `ValueRow.gradient`
                                          "fluid": FluidValue, "grains": MaterialPointValue,
                                          "turns": JointTurnsInput, "weights": BlendWeightsInput}


def _input_of_name(recording, name: str) -> RecordingInput:
    """Raises SceneError where the table of values has no such input; whether a recording has it is found when it is read."""
    path, _, what = name.rpartition(":")
    scene = recording.sim.scene
    thing = object_at_path(scene, path or "/")
    if thing is None:
        there = [*(b.path for b in scene.bodies()), *(f"{p.path}:targets" for p in scene.pins),
                 *(f"{load.path}:{load.name}" for load in scene.loads), *(c.path for c in scene.colliders)]
        raise SceneError(Problem(name, f"there is no body {path}; there are {', '.join(there)}"))
    own = isinstance(thing, Deformable) and MaterialInput.names(recording, recording.sim.model.body(path))
    return KINDS[differentiable_row(scene, path or "/", what, own or ()).gradient](recording, name)


def require_stable_substeps(recording, names) -> None:
    """Raises SceneError where the values that were written want shorter explicit steps than were recorded."""
    least, found = recording.plan.ports.stable_substeps, recording.plan.clock.substeps
    if least and any(limits_explicit_steps(name.rpartition(":")[2]) for name in names) and (wanted := least()) > found:
        raise SceneError(Problem("substeps", f"found {found}; these values want {wanted}. Give the scene more substeps before "
                                 "it is recorded, or keep stiffness and damping below"))
