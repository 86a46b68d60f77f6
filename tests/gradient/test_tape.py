"""A tape finds the values that a launch has read where they are written over, in arguments and in structs."""

from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp

from wsim.model.arena import ArraySlots
from wsim.model.structs import fill_struct
from wsim.model.tape import Tape
from wsim.model.vjp import fixed_adjoint, of_table
from wsim.scene import Scene
from wsim.simulation.simulation import Simulation

VECTORS = wp.array(dtype=wp.vec3d)


@wp.struct
class Read:
    x: VECTORS
    c: VECTORS            # a constant


@wp.kernel(module="test_tape_adjoint", enable_backward=True)
def multiply(at: Read, x_out: VECTORS):
    i = wp.tid()
    x_out[i] = wp.cw_mul(wp.cw_mul(at.x[i], at.x[i]), at.c[i])


def test_an_array_of_a_struct_that_is_written_over_keeps_its_derivative():
    """x <- c x^2 three times in place: c^7 x^8, by x 8 c^7 x^7, by c 7 c^6 x^8."""
    rng, n = np.random.default_rng(1), 5
    start, factor, weight = 1.0 + 0.1 * rng.normal(size=(3, n, 3))
    x = wp.array(start, dtype=wp.vec3d, device="cpu")
    c = wp.array(factor, dtype=wp.vec3d, device="cpu", requires_grad=True)
    tape, at = Tape(ArraySlots(wp.get_device("cpu"), wp.float64), []), fill_struct(Read, x=x, c=c)
    tape.write(x, True)                                  # the tape knows it, as methods' arrays are known after their first use
    tape.begin()
    for _ in range(3):
        tape.launch(multiply, n, [at], [x], device="cpu")
    tape.finish()
    constant = fill_struct(Read, c=c)
    assert tape.read(constant) is constant and at.x is x
    assert x.numpy() == pytest.approx(factor**7 * start**8, rel=1e-14)
    (root,) = tape.roots
    root.carried.assign(weight)
    tape.backward()
    assert root.carried.numpy() == pytest.approx(weight * 8 * factor**7 * start**7, rel=1e-13)
    assert c.grad.numpy() == pytest.approx(weight * 7 * factor**6 * start**8, rel=1e-13)


def test_a_kernel_with_an_entry_in_the_table_has_that_adjoint():
    """An entry that hands on three times what it gets, and is asked once a launch, before anything is read."""
    n, asked = 4, []
    x = wp.array(np.ones((n, 3)), dtype=wp.vec3d, device="cpu")
    at = fill_struct(Read, x=x, c=wp.array(np.ones((n, 3)), dtype=wp.vec3d, device="cpu", requires_grad=True))

    def record(inputs: list):
        asked.append(inputs)

        def backward(read: list, wrote: list) -> None:
            read[0].x.grad.assign(3.0 * wrote[0].grad.numpy())
            wrote[0].grad.zero_()                        # a write takes its gradient away
        return backward
    tape = Tape(ArraySlots(wp.get_device("cpu"), wp.float64), [], vjp={multiply: record})
    tape.write(x, True)
    tape.begin()
    for _ in range(2):
        tape.launch(multiply, n, [at], [x], device="cpu")
    tape.finish()
    tape.roots[0].carried.assign(np.full((n, 3), 5.0))
    tape.backward()
    assert len(asked) == 2 and all(inputs[0] is at for inputs in asked)
    assert tape.roots[0].carried.numpy() == pytest.approx(45.0) and at.c.grad.numpy() == pytest.approx(0.0)


@pytest.mark.parametrize("solver, known", [("explicit", {"leapfrog_kernel"}),
                                           ("xpbd", {"predict_euler_f32_over_cores", "finish_euler_f32_over_cores"}),
                                           ("implicit", {"predict_euler_f32_over_cores", "finish_euler_f32_over_cores"})])
def test_kernels_have_entries_where_gradients_are_asked_for(solver, known):
    scene = Scene(solver=solver, integrator="leapfrog" if solver == "explicit" else "backward_euler")
    scene.pin("/pin", scene.net("/net", [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], [[0, 1]], [10.0], [1.0, 1.0]), [0])
    found = [{kernel.key.split("__")[0] for kernel in Simulation(scene, device="cpu", gradients=g).model.vjp}
             for g in (False, True)]
    assert found == [set(), known]


def test_two_tables_that_share_a_kernel_have_an_adjoint_each():
    model, tables = SimpleNamespace(vjp={}), [object() for _ in range(3)]
    for name, table in zip("ab", tables, strict=False):
        model.vjp |= of_table(model, multiply, table, fixed_adjoint(name))
    assert [model.vjp[multiply]([table]) for table in tables[:2]] == ["a", "b"]
