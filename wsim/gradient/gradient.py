"""From gradients of what kernels read to those of what a scene says: the chain rule of parameters, in float64.

Kernels read a number for each spring, hinge, triangle, tet and point, and each has a gradient of its own: sums over many
elements are taken here and not by atomics in float32 (a parameter that 2e7 threads share would be 2.6 % off). Gravity and drag
of the air stand once a point for the same reason.
"""

from functools import cached_property
from typing import Any

import numpy as np
import warp as wp

from wsim.gradient.element_gradient import ElementGradient
from wsim.gradient.inputs.by_name import inputs_by_name
from wsim.gradient.loss import LossCotangents
from wsim.gradient.tables import GradientTables
from wsim.physics.contact.gradient import ContactGradient
from wsim.scene import Problem, SceneError
from wsim.scene.nodal.masses import single_density
from wsim.scene.values.coverage import differentiable_row, gradient_refusal
from wsim.scene.values.table import FRICTION


class FetchedArrays(dict):
    """Device arrays by their key, which come to the host in float64 when they are asked for: a million springs have many."""

    def __init__(self, arrays: dict[int, wp.array]):
        super().__init__()
        self.arrays = arrays

    def __missing__(self, key: int) -> np.ndarray:
        self[key] = found = self.arrays[key].numpy().astype(np.float64)
        return found


class Gradient(ElementGradient):
    """Derivatives of a loss, in SI units, by what a scene says.

    Bodies by path, None: the only one; worlds as ever. Arrays over points are float64, (n, 3) or (n,), in the author's order;
    where an author's points are one particle (a weld), each has the sum. Raises SceneError where a path or name is none, or has
    no derivative.
    """

    def __init__(self, parameters: GradientTables, states: dict[int, np.ndarray], targets: list, motions: list,
                 seeds: LossCotangents):
        """seeds: the loss, after its first frame was reached."""
        self.parameters, self.model, self.plan = parameters, parameters.model, parameters.plan
        self.recording = seeds.recording
        self.inertia = inertia = seeds.end()              # of what pins bear, where a loss asks for that
        self.states, self._targets, self.loads = states, targets, parameters.loads
        self.grads = FetchedArrays({array.ptr: wp.clone(array.grad) for array in parameters.arrays()})
        for key, by in inertia.tables.items() if inertia else ():
            self.grads[key] = self.grads[key] + by
        self.contacts = ContactGradient(self.plan, motions) if parameters.contact else None
        self.bodies: Any = seeds.bodies.gradient(states, self.grads) if seeds.bodies else None
        self.grains: Any = seeds.grains.gradient(states) if seeds.grains else None
        self.fluids: Any = seeds.fluids.gradient(states, seeds.recording.start) if seeds.fluids else None

    @cached_property
    def entries(self) -> dict[str, np.ndarray]:                       # type: ignore[override]
        return {name: self.parameters.ends(self.of(array)) for name, array in self.parameters.net().items()}

    def value(self, path: str, name: str, world: int = 0, elements: bool = False):
        """Gradient with respect to a value of the table (`wsim.scene.values.table`) of the object at a path, "/" the scene.
        elements: of each element by itself. Raises SceneError with the reason where it has no derivative."""
        row = differentiable_row(self.model.scene, path, name)
        if row.owner == "Scene":
            return getattr(self, name)(world)
        if row.gradient in ("path", "turns", "weights"):
            own = inputs_by_name(self.recording, [f"{path}:{name}"])[f"{path}:{name}"]
            return own.gradient(self, world, own.read_value(world).shape)
        if row.gradient == "body" or self.bodies and self.bodies.recorded.places(path, name, world):
            return self.bodies.value(path, name, world)
        if row.gradient == "surface" and not self.fluids:
            raise gradient_refusal("surface", path)
        if row.gradient == "grains":
            return self.grains.value(path, name, world)
        if row.gradient in ("fluid", "surface"):
            return self.fluids.value(path, name, world)
        if row.gradient == "material":
            return self.material(name, path, world, elements)
        if name in FRICTION:
            return self.friction(path, world)[FRICTION.index(name)]
        if row.gradient == "load":
            return self.load(path, world)
        return self.motion(path, world)[:, 0] if row.gradient == "shift" else getattr(self, name)(path, world)

    # points

    def positions(self, path: str | None = None, world: int = 0) -> np.ndarray:
        """Gradient with respect to the positions at the start [1/m], (n, 3)."""
        if grains := self.recording.grain_path(path):
            return self.grains.value(grains, "positions", world)
        return self.by_point(self.plan.state.x, path, world)

    def velocities(self, path: str | None = None, world: int = 0) -> np.ndarray:
        """Gradient with respect to the velocities at the start [s/m], (n, 3)."""
        if grains := self.recording.grain_path(path):
            return self.grains.value(grains, "velocities", world)
        return self.by_point(self.plan.state.v, path, world)

    def by_point(self, array: wp.array, path: str | None, world: int) -> np.ndarray:
        body, every = self.model.body(path, world), self.states[array.ptr].astype(np.float64)
        found = every[body.index]
        for end in body.ends.T:                          # middles of quadratic tets start between two points
            np.add.at(found, end, 0.5 * every[body.middles])
        return found

    def masses(self, path: str | None = None, world: int = 0) -> np.ndarray:
        """Gradient with respect to the masses of the points [1/kg], (n,); of pinned ones by the reaction forces of their pins,
        else 0."""
        return self.by_mass()[self.model.body(path, world).index]

    def by_mass(self) -> np.ndarray:
        return super().by_mass() + (self.inertia.mass if self.inertia else 0.0)

    def density(self, path: str | None = None, world: int = 0) -> float:
        """Gradient with respect to the density that all masses of a body follow [m^3/kg]."""
        b = self.model.body(path, world)
        density = self.plan.ports.densities.get(b.number) or single_density(b.source)
        if density is None:
            raise gradient_refusal("density", b.path)
        return float((self.by_mass()[b.first:b.last] * b.masses).sum()) / density

    def mass(self, path: str | None = None, world: int = 0) -> float:
        """Gradient with respect to the mass of a net, which its points share in the proportions that they have [1/kg]."""
        b = self.model.body(path, world)
        if not b.source.is_net:
            raise gradient_refusal("mass", b.path)
        return float((self.by_mass()[b.first:b.last] * b.masses).sum() / b.masses.sum())

    def gravity(self, world: int = 0) -> np.ndarray:
        """[s^2/m], (3,)."""
        more = sum((each.gravity(world) for each in (self.bodies, self.fluids, self.grains) if each), np.zeros(3))
        if not self.model.bodies:
            return more
        found, loads = self.of(self.parameters.points.gravity) + (self.inertia.gravity if self.inertia else 0.0), self.loads
        if loads:
            found[loads.point] += self.of(loads.own)
        return found[self.places(world)].sum(axis=0) + more

    def air_drag(self, world: int = 0) -> float:
        """[s]."""
        if self.parameters.points is None:
            raise gradient_refusal("idle", "air_drag", name="air_drag")
        found = self.of(self.parameters.points.decay) + (self.inertia.decay if self.inertia else 0.0)
        return float(found[self.places(world)].sum())

    def wind(self, world: int = 0) -> np.ndarray:
        """[s/m], (3,); zero where no cloth has drag or lift."""
        air, more = self.parameters.air, self.fluids.wind(world) if self.fluids else np.zeros(3)
        return self.of(air.wind)[self.places(world)].sum(axis=0) + more if air else more

    def air_coefficient(self, name: str, path: str | None = None, world: int = 0) -> float:
        """Gradient with respect to "drag" or "lift" of a cloth, or to "normal_drag" of its material."""
        body, air = self.model.body(path, world), self.parameters.air
        felt = air and body.source.feels_air
        if name not in ("drag", "lift", "normal_drag") or not felt:
            raise gradient_refusal("air", body.path, name=name)
        share = 1.0 / 3.0 if name == "normal_drag" else self.model.scene.air_density / 6.0
        return float(self.of(getattr(air, name))[body.first:body.last].sum()) * share

    def friction(self, path: str | None = None, world: int = 0) -> np.ndarray:
        """Gradient with respect to the static and the dynamic friction of a body or a collider, (2,)."""
        return self.touched(path).friction(path, world)

    def restitution(self, path: str, world: int = 0) -> float:
        """Gradient with respect to the restitution of a collider."""
        return self.touched(path).restitution(path, world)

    def thickness(self, path: str, world: int = 0) -> float:
        """Gradient with respect to the thickness of a collider [1/m]."""
        return self.touched(path).thickness(path, world)

    def motion(self, path: str, world: int = 0) -> np.ndarray:
        """Gradient with respect to what may be added to a collider's motion, (frames + 1, 2, 3): at each frame a shift [1/m]
        and a small turn about its origin [1/rad], both in the world and linear in time between frames."""
        return self.touched(path).motion(path, world)

    def touched(self, path: str | None) -> ContactGradient:
        if self.grains and path and path in [c.path for c in self.model.scene.colliders]:
            raise gradient_refusal("poured", path, name="friction, thickness, restitution and motion")
        if self.contacts is None:
            raise gradient_refusal("touched", path or "/")
        return self.contacts

    def pin(self, path: str, name: str, world: int = 0) -> float:
        """Gradient with respect to the stiffness [N/m] or damping [N s/m] of a soft pin."""
        pins, first = self.parameters.pins, 0
        for p in pins.groups["soft"] if pins else ():
            part = slice(first, first + len(p.places))
            first = part.stop
            if p.pin.path != path or p.body.world != world:
                continue
            own = self.borne(path, world, name)
            if name == "stiffness":
                return float(-(self.of(pins.soft.alpha)[part]).sum() / (p.part * p.pin.stiffness**2)) + own
            if name == "damping":
                return float(self.of(pins.soft.damping)[part].sum()) * p.part + own
        raise gradient_refusal("pin", path, name=name)

    def borne(self, path: str, world: int, name: str):
        """Part of the gradients with respect to a pin that comes from its reaction forces. Raises SceneError where that is not
        known."""
        if self.inertia and (path, world) in self.inertia.moved:
            raise gradient_refusal("moved", path, name=name)
        return self.inertia.soft.get((path, world), {}).get(name, 0.0) if self.inertia else 0.0

    def places(self, world: int) -> np.ndarray:
        return np.concatenate([np.arange(b.first, b.last) for b in self.model.bodies if b.world == world])

    def targets(self, path: str, world: int = 0) -> np.ndarray:
        """Gradient with respect to the places where a pin puts its points, or pulls them to [1/m]: (frames, moments of a
        frame, points, 3) of a moving one, see `wsim.model.stage.Clock.moments`, (points, 3) of one that stands still."""
        pins = self.parameters.pins
        own = self.borne(path, world, "targets")
        for number, kind in enumerate(pins.target if pins else ()):
            at = 0
            for p in pins.groups[kind]:
                if p.pin.path == path and p.body.world == world:
                    each = np.stack([frame[number].numpy()[:, at:at + len(p.places)] for frame in self._targets if frame])
                    each = each.astype(np.float64)
                    return each if pins.moves else each.sum(axis=(0, 1)) + own
                at += len(p.places)
        every = ", ".join(p.path for p in self.model.scene.pins)
        raise SceneError(Problem(path, f"is no pin; there are {every or 'none'}"))

    def actuation(self, path: str | None = None, world: int = 0) -> np.ndarray:
        """Gradient with respect to the factors of a net's muscles, (keys, groups) of its curve."""
        if not self.parameters.muscles:
            raise gradient_refusal("actuation", path or "actuation")
        number = self.parameters.muscles.find(self.model.body(path, world).path, world)
        found = np.sum([frame[-2 if self.loads else -1][number] for frame in self._targets], axis=0)
        return found + (self.inertia.muscles[number] if self.inertia and self.inertia.muscles else 0.0)

    def load(self, path: str | None = None, world: int = 0) -> np.ndarray:
        """Gradient with respect to the force [1/N] or traction [1/Pa] of a load (None: the only one), (keys, 3) of its
        curve."""
        if not self.loads:
            raise gradient_refusal("load", path or "loads")
        number = self.loads.find(path, world)
        found = np.sum([frame[-1][number] for frame in self._targets], axis=0)
        return found + (self.inertia.loads[number] if self.inertia and self.inertia.loads else 0.0)
