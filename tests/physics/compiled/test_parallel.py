"""Modules that the cache lacks are compiled in parallel, to the same code; what is wrong with one is said by its load."""

import threading

import pytest
import warp as wp
from warp._src import build

from wsim.model import kernel_cache
from wsim.model.compiler.parallel import compile_all

NAMES = "compiled_parallel_one", "compiled_parallel_two"


@wp.kernel(module=NAMES[0], enable_backward=False)
def one(x: wp.array(dtype=int)):
    x[wp.tid()] = wp.tid() + 1


@wp.kernel(module=NAMES[1], enable_backward=False)
def two(x: wp.array(dtype=int)):
    x[wp.tid()] = wp.tid() + 2


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """A cache of its own, of a process that has loaded nothing yet."""
    kernel_cache.start_warp()
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    monkeypatch.setattr(wp.config, "use_precompiled_headers", False)
    forget()
    yield tmp_path
    forget()


def forget() -> None:
    for name in NAMES:
        wp.get_module(name).unload()
    kernel_cache.SEEN.clear()


def loaded() -> list[list[int]]:
    """What the kernels leave."""
    device, found = kernel_cache.warp_device("cpu"), []
    for name, kernel in zip(NAMES, (one, two), strict=True):
        kernel_cache.load_kernel_module(name, device)
        x = wp.zeros(2, dtype=int, device="cpu")
        wp.launch(kernel, 2, [x], device="cpu")
        found.append(x.numpy().tolist())
    return found


def each(count: int) -> dict[str, None]:
    return dict.fromkeys(NAMES[:count])


def test_two_are_compiled_at_the_same_time_and_loaded_from_the_cache(cache, monkeypatch):
    """Each waits for the other within its compilation, at most 60 s; neither is compiled a second time."""
    meet, compile, count = threading.Barrier(2, timeout=60.0), build.build_cpu, []

    def meeting(*args, **more) -> None:
        count.append(args)
        meet.wait()
        compile(*args, **more)
    monkeypatch.setattr(build, "build_cpu", meeting)
    compile_all(each(2), kernel_cache.warp_device("cpu"))
    assert len(count) == 2 and loaded() == [[1, 2], [2, 3]] and len(count) == 2
    assert all(kernel_cache._unsound_folders(name) == [] and kernel_cache._folders_of_module(name) for name in NAMES)


def test_the_code_is_that_of_modules_which_are_compiled_alone(cache):
    compile_all(each(2), kernel_cache.warp_device("cpu"))
    found = {path.name: path.read_bytes() for path in cache.rglob("*.o")}
    assert len(found) == 2
    for path in list(cache.iterdir()):
        path.rename(cache.parent / f"{path.name}_{cache.name}")
    forget()
    assert loaded() == [[1, 2], [2, 3]] and found == {path.name: path.read_bytes() for path in cache.rglob("*.o")}


def test_one_alone_is_left_to_its_load(cache):
    compile_all(each(1), kernel_cache.warp_device("cpu"))
    assert not list(cache.iterdir())


def test_what_goes_wrong_is_said_by_the_load(cache, monkeypatch):
    def broken(*args, **more) -> None:
        raise RuntimeError("no such instruction")
    with monkeypatch.context() as patch:
        patch.setattr(build, "build_cpu", broken)
        compile_all(each(2), kernel_cache.warp_device("cpu"))
        with pytest.raises(RuntimeError, match="no such instruction"):
            kernel_cache.load_kernel_module(NAMES[0], kernel_cache.warp_device("cpu"))
    forget()
    assert loaded() == [[1, 2], [2, 3]]


def test_what_kernels_call_counts_for_the_size_of_a_module():
    """Once, however often it is called."""
    from wsim.model import warp_private

    @wp.func
    def doubled(x: float):
        return 2.0 * x

    def made(module: str, body):
        return warp_private.source_size(wp.kernel(body, module=wp.get_module(module)).module)

    def calls_once(a: wp.array(dtype=float)):
        a[wp.tid()] = doubled(a[wp.tid()])

    def calls_not(a: wp.array(dtype=float)):
        a[wp.tid()] = 2.0 * a[wp.tid()] + 1234567.0

    def calls_many(a: wp.array(dtype=float)):
        a[wp.tid()] = doubled(doubled(doubled(a[wp.tid()])))
    once, none, many = (made(f"sized_{body.__name__}", body) for body in (calls_once, calls_not, calls_many))
    assert once > none and 0 < many - once < 40
