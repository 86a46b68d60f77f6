"""A cache of kernels that is damaged, full or not to be written; two threads that compile, capture and step at once."""

import errno
import os
import shutil
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
import warp as wp

from tests.make.simulation.simulation import chain, drape
from wsim import cli
from wsim.model import kernel_cache
from wsim.scene import SceneError
from wsim.simulation.simulation import Simulation

PLACE = "wsim_cache_test"


@wp.kernel(module=PLACE, enable_backward=False)
def count(x: wp.array(dtype=int)):
    x[wp.tid()] = wp.tid() + 7


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """A cache of its own, of a process that has loaded nothing yet."""
    kernel_cache.start_warp()
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path / "cache"))
    (tmp_path / "cache").mkdir()
    forget()
    yield tmp_path / "cache"
    forget()


def forget() -> None:
    wp.get_module(PLACE).unload()
    kernel_cache.SEEN.clear()


def counted() -> list[int]:
    kernel_cache.load_kernel_module(PLACE, wp.get_device("cpu"))
    x = wp.zeros(3, dtype=int, device="cpu")
    wp.launch(count, 3, [x], device="cpu")
    return x.numpy().tolist()


def garble(path: Path) -> None:
    """Part of the code of a binary: Warp loads that, and crashes when it runs."""
    whole = bytearray(path.read_bytes())
    whole[64:400] = bytes(b ^ 0x5A for b in whole[64:400])
    path.write_bytes(whole)


def without_record(folder: Path, of: str) -> None:
    """A file that was cut short, in a folder of another program's making."""
    (folder / kernel_cache.RECORD).unlink()
    (file,) = folder.glob(of)
    file.write_bytes(file.read_bytes()[:50])


def replaced(folder: Path) -> None:
    shutil.rmtree(folder)
    folder.write_text("no folder")


def test_a_damaged_cache_is_compiled_again(cache, tmp_path):
    assert counted() == [7, 8, 9]
    (folder,) = cache.iterdir()
    shutil.copytree(folder, tmp_path / "sound")
    for damage in (lambda f: garble(next(f.glob("*.o"))), lambda f: next(f.glob("*.meta")).write_bytes(b"\x80{"),
                   lambda f: without_record(f, "*.o"), lambda f: without_record(f, "*.meta"), replaced):
        damage(folder)
        forget()
        assert counted() == [7, 8, 9]
        assert kernel_cache._unsound_folders(PLACE) == [] and (folder / kernel_cache.RECORD).exists()
        shutil.rmtree(folder)
        shutil.copytree(tmp_path / "sound", folder)
    forget()
    before = next(folder.glob("*.o")).stat().st_mtime_ns
    assert counted() == [7, 8, 9] and next(folder.glob("*.o")).stat().st_mtime_ns == before       # what is sound stays


def test_a_cache_that_takes_nothing_is_one_sentence_with_the_way_out(cache, monkeypatch, capsys):
    def full(path, data):
        raise OSError(errno.ENOSPC, "No space left on device", str(path))
    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", full)
        with pytest.raises(SceneError, match="disk that compiled kernels are kept on is full; .* WARP_CACHE_PATH"):
            counted()
    cache.rmdir()
    cache.write_text("no folder")
    with pytest.raises(SceneError, match=f"kernel cache {cache}: compiled kernels cannot be kept there .*WARP_CACHE_PATH"):
        counted()


@pytest.mark.parametrize("error, words", [
    (NotADirectoryError(errno.ENOTDIR, "Not a directory"), r"cannot be kept there \(Not a directory\); .* WARP_CACHE_PATH"),
    (None, "there is no home folder .* WARP_CACHE_PATH")])
def test_a_home_that_is_not_there_is_one_sentence(monkeypatch, error, words, scene):
    def init():
        if error:
            raise error
    monkeypatch.setattr(wp, "init", init)
    if error is None:
        for name in ("WARP_CACHE_PATH", "XDG_CACHE_HOME"):
            monkeypatch.delenv(name, raising=False)
        monkeypatch.setattr(wp.config, "kernel_cache_dir", None)
        monkeypatch.setattr("os.path.expanduser", lambda path: path)
    with pytest.raises(SceneError, match=words) as raised:
        Simulation(scene, device="cpu")
    assert cli.explain_error(raised.value).count("\n") == 0


def test_two_threads_step_two_simulations_to_the_bits_of_one():
    """Each builds, compiles, captures and is set while others run: launches of one never go into the graph of another."""
    def run(k: int) -> np.ndarray:
        sim = Simulation(drape() if k % 2 else chain(10, substeps=4, iterations=4), device="cpu")
        for frame in range(12):
            if frame % 3 == 2:
                sim.graphs.forget("test")                          # captured anew
                sim.set("/", "gravity", (0.0, -9.0 - frame, 0.0))
            sim.step()
        return sim.positions()
    alone, found, errors = [run(0), run(1)], {}, []

    def work(k: int) -> None:
        try:
            found[k] = run(k)
        except BaseException as error:
            errors.append(error)
    threads = [threading.Thread(target=work, args=(k,)) for k in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert errors == []
    for k, positions in found.items():
        np.testing.assert_array_equal(positions, alone[k % 2])


def test_kernels_of_a_report_are_in_the_cache_once_for_all_scenes(monkeypatch):
    """Another scene of the same kinds asks for the modules of the first; all kernels of one are made before it is loaded."""
    from wsim.physics.cloth.kinds import stored
    monkeypatch.setattr(stored, "FEW", 0)                              # else the host sums what these have
    asked: list[list[tuple[str, int]]] = []
    for scene in (drape(), drape()):
        scene.frames, scene.solver = scene.frames + len(asked), "xpbd"
        scene.substeps += 4 * len(asked)                               # another plan
        sim = Simulation(scene, device="cpu")
        sim.step()
        own: list[tuple[str, int]] = []
        ready = kernel_cache.load_module_of_kernel
        monkeypatch.setattr(kernel_cache, "load_module_of_kernel", lambda kernel, model, ready=ready, own=own: (
            own.append((kernel.module.name, len(kernel.module.kernels))), ready(kernel, model)))
        sim.indicators()
        monkeypatch.setattr(kernel_cache, "load_module_of_kernel", ready)
        asked.append(own)
    assert asked[0] and asked[0] == asked[1] and all(name.startswith("wsim_report_") for name, _ in asked[0])
    assert len(set(asked[0])) == len({name for name, _ in asked[0]})    # none grew after it was loaded


def test_warp_starts_without_a_word_of_a_driver_that_a_machine_without_a_gpu_lacks():
    code = ("from wsim.model import kernel_cache; import warp as wp; wp.config.log_level = wp.LOG_WARNING; "
            "kernel_cache.start_warp()")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=Path(__file__).parents[2])
    assert done.returncode == 0 and "NVIDIA CUDA driver" not in done.stderr, done.stderr


def test_other_words_of_a_start_are_passed_on(capfd):
    with kernel_cache._standard_error_without(b"no driver"):
        os.write(2, b"warning: no driver\nwarning: an old one\n")
    assert capfd.readouterr().err == "warning: an old one\n"
