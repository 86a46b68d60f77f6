"""Hashes that tests keep (`tests.make.suite.hashes`) are Warp's own, and follow what names mean."""

import pytest
import warp as wp
from warp._src.context import ModuleHasher

from tests.make.suite import hashes

STEP = wp.constant(0.5)


@wp.func
def first_half(x: float):
    return STEP * x


@wp.func
def other_half(x: float):
    return x - STEP


def module_of(function) -> wp.Module:
    def double(x: wp.array(dtype=float)):
        x[wp.tid()] = function(x[wp.tid()]) + function(x[0])
    module = wp.Module("doubled", None)
    module.register_kernel(wp.Kernel(func=double, key="double", module=module))
    return module


def kept_and_whole(module, monkeypatch) -> tuple[bytes, bytes]:
    """A module's hash as tests have it, and as Warp does."""
    found = []
    for way in (hashes.hash_adjoint, hashes.HASH):
        monkeypatch.setattr(ModuleHasher, "hash_adjoint", way)
        found.append(ModuleHasher(list(module.kernels.values()), module.options).get_hash())
    return found[0], found[1]


@pytest.mark.parametrize("change", [2.0, other_half])
def test_a_kept_hash_is_that_of_what_names_mean_now(change, monkeypatch):
    """A constant, then a function in a closure, change between two modules of the same kernel."""
    module = module_of(first_half)
    before = [kept_and_whole(module, monkeypatch) for _ in range(3)]
    assert len({*before[0], *before[1], *before[2]}) == 1
    if isinstance(change, float):
        monkeypatch.setitem(globals(), "STEP", change)
    else:
        next(iter(module.kernels.values())).func.__closure__[0].cell_contents = change
    kept, whole = kept_and_whole(module, monkeypatch)
    assert kept == whole != before[0][0]
