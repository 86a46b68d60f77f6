"""Narrow-phase kernels as a GPU gets them. `X[i] += v` of an array is an atomic addition; of a local array the CUDA compiler
makes a trap of it, without a word: a launch that comes there fails with error 719. Warp's compiler needs no GPU to say so."""

import sys

import pytest
import warp as wp

from tests.make.physics.rigid.narrow import triangles
from wsim.kernels.rigid.lists.collide_mesh import collide_mesh


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "darwin", reason="Warp compiles for CUDA on Linux and Windows alone")
@pytest.mark.parametrize("made", [lambda: triangles.kernel(wp.float32),
                                  lambda: collide_mesh(triangles.KINDS, wp.float32, "test_traps")], ids=["pairs", "rows"])
def test_no_way_through_the_narrow_phase_ends_in_a_trap(made, tmp_path):
    wp.compile_aot_module(made().module, device=None, arch=90, module_dir=str(tmp_path), use_ptx=True)
    (code,) = tmp_path.glob("*.ptx")
    text = code.read_text()
    assert ".entry" in text and "trap;" not in text
