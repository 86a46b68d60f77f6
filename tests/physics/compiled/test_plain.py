"""Plain Warp, without rewritten sources and records: the same bits; and a cache that knows which version rewrote a binary."""

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from wsim.model import kernel_cache, warp_private
from wsim.model.compiler import source, version
from wsim.scene.integrator import Integrator

ROOT = Path(__file__).parents[3]
RUN = """
import hashlib, sys
import numpy as np
import wsim
for scene in sys.argv[1:]:
    sim = wsim.Simulation(f"scenes/{scene}.usda", device="cpu")
    sim.run(2)
    found = hashlib.sha256()
    for array, _ in sim.state.copies():
        found.update(array.numpy().tobytes())
    print(scene, found.hexdigest())
"""


def digests(plain: bool, scenes: list[str], cache: Path) -> str:
    """Of all that two frames leave in the state, run in a process of its own."""
    more = {"WSIM_PLAIN_WARP": str(int(plain)), "WARP_CACHE_PATH": str(cache), "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", RUN, *scenes], cwd=ROOT, env=os.environ | more, capture_output=True, text=True,
                          check=True)
    return "\n".join(line for line in done.stdout.splitlines() if line.split(" ")[0] in scenes)


@pytest.mark.slow
@pytest.mark.parametrize("scenes", [
    ["hanging_cloth", "flag", "bunny", "rope_on_cloth"], ["balls", "humanoid", "arch", "dominoes"],
    ["plume", "dam_break", "ball_into_cloth", "squeezed_cube"]])
def test_scenes_have_the_same_bits_by_plain_warp(scenes, tmp_path):
    ours, plain = (digests(how, scenes, tmp_path / str(how)) for how in (False, True))
    assert ours == plain and ours.count("\n") == len(scenes) - 1


def test_the_version_changes_with_what_rewrites(monkeypatch):
    before = version.rewriting_version()
    assert before == version.rewriting_version() and len(before) == 32
    real = source.rewrite_functions
    monkeypatch.setattr(source, "rewrite_functions", lambda text: real(text.replace("= 2.0", "= 3.0")))
    assert version.rewriting_version() != before
    monkeypatch.setattr(version, "PLAIN", True)
    assert version.rewriting_version() == "plain"


def test_a_binary_of_another_version_is_compiled_once_more(tmp_path, monkeypatch):
    """The folder's record names the version; what names another, or none, is unsound."""
    monkeypatch.setattr(kernel_cache.wp.config, "kernel_cache_dir", str(tmp_path))
    folder = tmp_path / "wp_wsim_versions_0123456"
    folder.mkdir()
    (folder / "binary.o").write_bytes(b"code")
    kernel_cache._record_digests("wsim_versions")
    assert kernel_cache._unsound_folders("wsim_versions") == []
    monkeypatch.setattr(kernel_cache, "rewriting_version", lambda: hashlib.blake2b(b"other", digest_size=16).hexdigest())
    assert kernel_cache._unsound_folders("wsim_versions") == [folder]


def test_a_warp_without_private_names_is_run_as_it_is(monkeypatch):
    from wsim.model.compiler import recorded, variants
    for name in ("build", "codegen"):
        monkeypatch.setattr(variants, name, None)
    monkeypatch.setattr(recorded, "context", None)
    monkeypatch.setattr(variants, "TOLD", [])
    with pytest.warns(RuntimeWarning, match=r"lacks cpu_linear\w+, _INLINE_ATTRS, build_cpu, build_cuda: first frames"):
        for _ in range(2):
            with variants.single_variant():
                pass
    assert len(variants.TOLD) == 1
    recorded.lighten_capture()

    class Bare:
        """A module that offers nothing."""
    assert warp_private.folder_name(Bare(), 1) is None and not warp_private.in_cache(Bare(), 1)
    assert warp_private.loaded_executables(Bare()) is None
    warp_private.forget_module(Bare())
    assert warp_private.private_module("no_such_module") is None


@pytest.mark.parametrize("steps", [((0.5, 0.5), (0.5, 0.5)), ((1.0, 0.5),),
                                   ((0.68, 1.35), (-0.18, -1.7), (-0.18, 1.35), (0.68, 0.0))])
def test_rows_of_other_kicks_and_drifts_are_refused(steps):
    with pytest.raises(ValueError, match="integrator mine: steps are .*; allowed: one kick and a drift of 1, or two kicks"):
        Integrator("mine", 4, "", steps=steps)
    assert np.isfinite(Integrator("mine", 2, "", steps=((0.5, 1.0), (0.5, 0.0))).order)
