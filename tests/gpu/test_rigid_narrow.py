"""Tests of tests/physics/rigid on a GPU: manifolds, GJK and EPA, triangles, contacts, free rotation, scenes of files.

The narrow phase comes in the order in which its parts build on one another, so that the first that fails is the cause.
"""

import pytest
import warp as wp

from tests.physics.rigid import pairs, test_contact, test_floors, test_free, test_usd
from tests.physics.rigid.narrow import test_gjk, test_manifold, test_triangles

pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="needs a GPU")
READ = ("test_scenes_of_others", "test_results_are", "test_a_run_goes_on")       # of test_usd: what runs
for module in (test_manifold, test_gjk, test_triangles, test_free, test_contact, test_floors, test_usd):
    wanted = READ if module is test_usd else "test_"
    globals().update({name: test for name, test in vars(module).items() if name.startswith(wanted) and callable(test)})


@pytest.fixture(autouse=True)
def on_a_gpu(monkeypatch):
    monkeypatch.setitem(pairs.WHERE, "device", "cuda:0")
