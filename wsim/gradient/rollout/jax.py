"""A rollout as a function of JAX arrays (extra `jax`) with a reverse-mode derivative of its own.

    f = function(recording, ["/World/Cloth:stretch"], frames=[24])
    jax.value_and_grad(lambda stretch: ((f(stretch)[0] - wanted) ** 2).sum())(stretch)

Both passes are callbacks on the host, so that the function may be used inside `jax.jit`. `jax.vmap` and `jax.jacrev` run their
rows one after the other; worlds run together. The function has no jvp and no second derivatives. The backward pass runs the
recording forward once more: a recording holds one run, and JAX does not say which call the pass belongs to. Callbacks run in
threads of their own: for float64 use `jax.config.update("jax_enable_x64", True)`, not the context manager.
"""

import jax
import jax.numpy as jnp
import numpy as np

from wsim.gradient.recording import Recording
from wsim.gradient.rollout.products import Rollout


def function(recording: Recording, names, frames=None):
    """f(one array for each name, of a shape that `wsim.gradient.inputs.by_name` allows) -> positions [m], velocities [m/s],
    (frames, points, 3) each, of several worlds (worlds, frames, points, 3), as `wsim.gradient.rollout.products.Rollout` orders
    them, in JAX's default real type: float64 only with `jax_enable_x64`. Gradients are exact for the scheme that ran."""
    rollout = Rollout(recording, names, frames)
    real = jnp.zeros(0).dtype

    def motion_on_host(*given) -> tuple[np.ndarray, np.ndarray]:
        y = rollout.run({name: np.asarray(value) for name, value in zip(rollout.inputs, given, strict=True)})
        return tuple(np.moveaxis(y, -4, 0).astype(real))                     # type: ignore[return-value]

    def vjp_on_host(given, seeds) -> tuple[np.ndarray, ...]:
        motion_on_host(*given)
        shapes = {name: np.shape(value) for name, value in zip(rollout.inputs, given, strict=True)}
        found = rollout.vjp(np.stack([np.asarray(s, np.float64) for s in seeds], axis=-4), shapes)
        return tuple(np.asarray(g, value.dtype) for g, value in zip(found.values(), given, strict=True))

    @jax.custom_vjp
    def rollout_function(*given):
        shape = (*rollout.shape[:-4], *rollout.shape[-3:])
        return jax.pure_callback(motion_on_host, (jax.ShapeDtypeStruct(shape, real),) * 2, *given, vmap_method="sequential")

    def rollout_forward_pass(*given):
        given = tuple(jnp.asarray(value) for value in given)
        return rollout_function(*given), given

    def rollout_backward_pass(given, seeds):
        return jax.pure_callback(vjp_on_host, tuple(jax.ShapeDtypeStruct(g.shape, g.dtype) for g in given), given, seeds,
                                 vmap_method="sequential")

    rollout_function.defvjp(rollout_forward_pass, rollout_backward_pass)
    return rollout_function
