"""Launches recorded as bytes of arguments: the bits of Warp's own recording, and what a graph writes outlives it."""

import gc
import weakref

import numpy as np
import pytest
import warp as wp

from tests.conftest import grid
from wsim.model import kernel_cache
from wsim.model.compiler import recorded
from wsim.scene import Scene
from wsim.simulation.simulation import Simulation


@wp.struct
class Inner:
    much: wp.float64
    a: wp.array(dtype=wp.vec3)


@wp.struct
class Outer:
    few: wp.int8
    inner: Inner
    out: wp.array(dtype=wp.float64)


@wp.kernel
def mixed(flag: wp.bool, one: wp.uint8, o: Outer, w: wp.vec3, x: wp.array(dtype=wp.float64), h: wp.float16, n: int):
    """Arguments of many sizes, so that each must be put at its own alignment."""
    i = wp.tid()
    if flag:
        o.out[i] = (o.inner.much * x[i] * x[i] + wp.float64(wp.dot(o.inner.a[i], w)) + wp.float64(int(one)) + wp.float64(h)
                    + wp.float64(int(o.few) * n))


class Setting:
    """The kernel's arguments; `launch` launches it, `wanted` is what it writes."""

    def __init__(self):
        numbers = np.random.default_rng(5)
        self.a, self.x = numbers.normal(size=(4, 3)).astype(np.float32), numbers.normal(size=4)
        self.o, self.w = Outer(), wp.vec3(1.0, 2.0, 4.0)
        self.o.few, self.o.inner.much = -3, 0.1
        self.o.inner.a = wp.array(self.a, dtype=wp.vec3, device="cpu")
        self.o.out = wp.zeros(4, dtype=wp.float64, device="cpu", requires_grad=True)
        self.on = wp.array(self.x, dtype=wp.float64, device="cpu", requires_grad=True)
        kernel_cache.load_kernel_module(mixed.module, wp.get_device("cpu"))

    def launch(self, **more):
        recorded.launch(mixed, 4, [True, 200, self.o, self.w, self.on, wp.float16(0.5), 7], [], device="cpu", **more)

    @property
    def wanted(self) -> np.ndarray:
        return 0.1 * self.x**2 + self.a @ np.array([1.0, 2.0, 4.0]) + 200.0 + 0.5 - 21.0


def light(graph) -> bool:
    return type(graph._apic_capture) is recorded.lean_capture_class()


def test_arguments_of_all_sizes_are_where_a_kernel_looks_for_them():
    s = Setting()
    with kernel_cache.capture_graph("cpu") as capture:
        s.launch()
    assert light(capture.graph) and not s.o.out.numpy().any()
    wp.capture_launch(capture.graph)
    before = s.o.out.numpy().copy()
    np.testing.assert_allclose(before, s.wanted, rtol=1e-6)                  # of float32 products
    s.on.assign(s.x + 1.0)                                                   # the graph reads what is there now
    wp.capture_launch(capture.graph)
    np.testing.assert_allclose(s.o.out.numpy() - before, 0.1 * (2.0 * s.x + 1.0), atol=1e-12)


def test_a_backward_pass_is_recorded_and_is_so_again():
    """d(much x^2)/dx = 2 much x, exact to rounding; two launches add."""
    s = Setting()
    with kernel_cache.capture_graph("cpu") as capture:
        for _ in range(2):
            s.o.out.grad.fill_(1.0)                              # a backward pass takes what it reads
            s.launch(adj_inputs=[None, None, s.o, None, s.on.grad, None, None], adjoint=True)
    assert light(capture.graph)
    wp.capture_launch(capture.graph)
    np.testing.assert_allclose(s.on.grad.numpy(), 0.4 * s.x, rtol=1e-15)


def test_what_a_graph_writes_outlives_every_other_reference_to_it():
    """Arrays that a struct had when it was launched, of which it has others since, and their gradients."""
    s = Setting()
    with kernel_cache.capture_graph("cpu") as capture:
        s.launch()
    graph, seen = capture.graph, s.o.out
    looked = [weakref.ref(each) for each in (seen, seen.grad, s.o.inner.a, s.on)]
    del seen, s.o, s.on, capture
    gc.collect()
    assert all(look() is not None for look in looked)
    wp.capture_launch(graph)
    np.testing.assert_allclose(looked[0]().numpy(), s.wanted, rtol=1e-6)
    del graph
    gc.collect()
    assert all(look() is None for look in looked)


def test_a_member_set_between_two_launches_is_the_second_ones():
    s = Setting()
    first = s.o.out
    with kernel_cache.capture_graph("cpu") as capture:
        s.launch()
        s.o.out = wp.zeros(4, dtype=wp.float64, device="cpu")
        s.o.inner.much = 0.2
        s.launch()
    wp.capture_launch(capture.graph)
    np.testing.assert_allclose(first.numpy(), s.wanted, rtol=1e-6)
    np.testing.assert_allclose(s.o.out.numpy() - first.numpy(), 0.1 * s.x**2, atol=1e-12)


@wp.kernel
def scaled(x: wp.array(dtype=wp.float64), a: wp.float64, n: int, out: wp.array(dtype=wp.float64)):
    i = wp.tid()
    out[i] = x[i] / a + wp.float64(n)


def test_arrays_that_live_for_a_launch_and_signs_of_zero_are_told_apart():
    """Slices that are gone when the next is made, at the same address in Python; 1 / -0 is not 1 / 0; 1 is not 1.0."""
    kernel_cache.load_kernel_module(scaled.module, wp.get_device("cpu"))
    x, out = (wp.array(np.arange(1.0, 41.0), dtype=wp.float64, device="cpu") for _ in range(2))
    with kernel_cache.capture_graph("cpu") as capture:
        for k, a in enumerate((1, 1.0, 2.0, 0.0, -0.0, 2.0, -0.0, 0.0, 1, 4.0)):
            recorded.launch(scaled, 4, [x[4 * k:4 * k + 4], a, k], [out[4 * k:4 * k + 4]], device="cpu")
    gc.collect()
    wp.capture_launch(capture.graph)
    with np.errstate(divide="ignore"):
        wanted = np.arange(1.0, 41.0) / np.repeat([1.0, 1.0, 2.0, 0.0, -0.0, 2.0, -0.0, 0.0, 1.0, 4.0], 4)
    np.testing.assert_array_equal(out.numpy(), wanted + np.repeat(np.arange(10.0), 4))


def test_a_launch_of_a_known_kernel_is_as_strict_as_the_first_and_one_of_no_thread_is_none():
    s = Setting()
    with kernel_cache.capture_graph("cpu"):
        s.launch()
        recording = wp._src.context.runtime._apic_capture
        for threads, x, n, words in ((4, s.o.inner.a, 7, "dtype"), (4, s.on, "seven", "pack"), (-1, s.on, 7, "non-negative")):
            with pytest.raises((RuntimeError, ValueError), match=words):
                recorded.launch(mixed, threads, [True, 200, s.o, s.w, x, wp.float16(0.5), n], [], device="cpu")
        with pytest.raises(RuntimeError, match="passed 1 arguments"):
            recorded.launch(mixed, 4, [True], [], device="cpu")
        recorded.launch(mixed, 0, [True, 200, s.o, s.w, s.on, wp.float16(0.5), 7], [], device="cpu")
        assert recording.operation_count == 1


@pytest.mark.parametrize("solver", ["xpbd", "implicit", "explicit"])
def test_frames_have_the_bits_of_warps_recording(solver, monkeypatch):
    def run():
        scene = Scene(frames=3, substeps=2, iterations=2, solver=solver)
        scene.pin("/pin", scene.cloth("/cloth", *grid()), points=[0, 3])
        sim = Simulation(scene, device="cpu")
        sim.run()
        return sim, sim.positions()
    sim, x = run()
    assert all(light(graph) for graph in sim.graphs.values()) and sim.graphs
    monkeypatch.setattr(recorded, "lighten_capture", lambda: None)
    sim, own = run()
    assert not any(light(graph) for graph in sim.graphs.values())
    np.testing.assert_array_equal(x, own)


def test_warp_records_as_ever_where_it_has_other_structs(monkeypatch):
    monkeypatch.setattr(recorded, "INFO", (*recorded.INFO, "more"))
    recorded.lean_capture_class.cache_clear()
    try:
        s = Setting()
        with kernel_cache.capture_graph("cpu") as capture:
            s.launch()
        assert recorded.lean_capture_class() is None
        wp.capture_launch(capture.graph)
        np.testing.assert_allclose(s.o.out.numpy(), s.wanted, rtol=1e-6)
    finally:
        recorded.lean_capture_class.cache_clear()


def test_a_graph_that_is_to_be_saved_is_recorded_as_ever():
    s = Setting()
    with wp.ScopedCapture(device="cpu", force_module_load=False, apic=True) as capture:
        recorded.lighten_capture()
        s.launch()
    assert not light(capture.graph)
    recorded.lighten_capture()                                 # nothing is captured: nothing happens
