"""A rollout as a layer of PyTorch (extra `torch`): tensors of parameters in, positions and velocities out, gradients back.

    layer = Layer(recording, ["/World/Cloth:stretch", "/World/Cloth:velocities"], frames=[12, 24])
    x, v = layer(stretch, velocities)                      # each (2, points, 3)
    ((x[1] - wanted) ** 2).sum().backward()

Gradients are exact for the scheme that ran (`Recording.backward`), and first ones only: a second backward pass through them
raises; `wsim.gradient.rollout.products.Rollout.hvp` has second derivatives. Outputs are gathered on the device of the
simulation, without a way through the host; inputs and gradients of inputs go through it.
"""

import weakref
from itertools import count
from typing import Any

import numpy as np
import torch
import warp as wp

from wsim.gradient.recording import Recording
from wsim.gradient.rollout.products import Rollout
from wsim.scene import Problem, SceneError

_numbers = count(1)
_last: weakref.WeakKeyDictionary[Recording, int] = weakref.WeakKeyDictionary()      # number of the run that a recording holds


class Layer(torch.nn.Module):
    """A recording as a function of tensors; it has no weights of its own.

    names, frames  as `wsim.gradient.rollout.products.Rollout`, whose order of points the outputs have (`rollout.part` says
    where a body is)
    dtype          of the outputs; None: the simulation's precision
    Called with one tensor for each name, of any real dtype, on any device, of a shape that `wsim.gradient.inputs.by_name`
    allows. Returns positions [m] and velocities [m/s], (frames, points, 3) each; of several worlds (worlds, frames, points, 3).
    Gradients have the dtype, shape and device of the inputs. Raises SceneError as `Rollout.write` and `Recording.run` do.
    """

    def __init__(self, recording: Recording, names, frames=None, dtype: torch.dtype | None = None):
        super().__init__()
        self.rollout, self.recording = Rollout(recording, names, frames), recording
        self.device = torch.device(wp.device_to_torch(recording.sim.device))
        self.dtype = dtype or (torch.float64 if recording.sim.precision == "float64" else torch.float32)
        self.index = torch.as_tensor(self.rollout.index, device=self.device)                       # (worlds, points)
        self.origin = torch.as_tensor(self.rollout.origin, dtype=torch.float64, device=self.device)
        self.kept = [wp.to_torch(a) for a in (recording.states, recording.rests, recording.speeds)]         # the same memory

    def values(self) -> list[torch.Tensor]:
        """Present values of the inputs, float64, in their order: to begin an optimisation with."""
        return [torch.as_tensor(np.array(value), device=self.device) for value in self.rollout.values().values()]

    def forward(self, *given: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        names = list(self.rollout.inputs)
        if len(given) != len(names):
            raise SceneError(Problem("inputs", f"found {len(given)} tensors; allowed are {len(names)}: {', '.join(names)}"))
        return _RolloutFunction.apply(self, *given)

    def run(self, given: tuple[torch.Tensor, ...]) -> tuple[torch.Tensor, torch.Tensor]:
        self.rollout.write({name: t.detach().cpu().numpy() for name, t in zip(self.rollout.inputs, given, strict=True)})
        self.recording.run()
        return self.motion()

    def motion(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Outputs of the last run."""
        if self.device.type == "cuda":
            wp.synchronize_device(self.recording.sim.device)                # Warp's stream is not torch's
        frames = torch.as_tensor(self.rollout.frames, device=self.device)
        x, e, v = (array[frames][:, self.index].transpose(0, 1) for array in self.kept)
        x, v = (x.to(torch.float64) + e + self.origin).to(self.dtype), v.to(self.dtype)
        return (x, v) if self.recording.sim.worlds > 1 else (x[0], v[0])

    def seeds(self, grad: torch.Tensor | None) -> dict[int, Any] | None:
        """Derivatives by a motion as a recording takes them, in the solver's order. SceneError where one is no number."""
        if grad is None:
            return None
        base, points = self.recording.state.x, self.recording.sim.model.points
        own = torch.float64 if self.recording.sim.precision == "float64" else torch.float32
        each = grad.detach().to(self.device, own).reshape(len(self.index), len(self.rollout.frames), -1, 3)
        into = torch.zeros(each.shape[1], points, 3, dtype=own, device=self.device)
        into.index_add_(1, self.index.reshape(-1), each.transpose(0, 1).reshape(each.shape[1], -1, 3))
        if not torch.isfinite(into).all():               # waits, too: torch's stream is not Warp's
            raise SceneError(Problem("gradients", "found a derivative by the layer's outputs that is not finite"))
        return {frame: wp.from_torch(into[k], dtype=base.dtype) for k, frame in enumerate(self.rollout.frames)}


class _RolloutFunction(torch.autograd.Function):
    @staticmethod
    def forward(ctx, layer: Layer, *given):                                 # type: ignore[override]
        x, v = layer.run(given)
        ctx.layer, ctx.number = layer, next(_numbers)
        _last[layer.recording] = ctx.number
        ctx.save_for_backward(x, v, *given)
        ctx.set_materialize_grads(False)
        return x, v

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, *grads):                                              # type: ignore[override]
        layer, (x, v, *given) = ctx.layer, ctx.saved_tensors
        if all(g is None for g in grads):
            return (None,) * (1 + len(given))
        _rerun_if_replaced(layer, ctx.number, (x, v), given)
        shapes = {name: tuple(t.shape) for name, t in zip(layer.rollout.inputs, given, strict=True)}
        found = layer.rollout.of(layer.recording.backward(*map(layer.seeds, grads)), shapes)
        return None, *(torch.as_tensor(g, dtype=t.dtype, device=t.device) for g, t in zip(found.values(), given, strict=True))


def _rerun_if_replaced(layer: Layer, number: int, outputs: tuple, given) -> None:
    """A recording holds one run: where it is another's by now, this one runs once more."""
    if _last.get(layer.recording) == number and all(map(torch.equal, layer.motion(), outputs)):
        return
    _last[layer.recording] = number
    for a, b in zip(layer.run(tuple(given)), outputs, strict=True):
        if (a - b).abs().max() <= torch.finfo(b.dtype).eps ** 0.5 * b.abs().max():             # but for rounding
            continue
        raise SceneError(Problem("recording", "something that is no input of this layer has been set between its forward and "
                                 "its backward pass, and the run cannot be repeated; call backward before that"))
