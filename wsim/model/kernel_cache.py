"""Kernels are compiled, kept in Warp's cache on disk, loaded and captured behind one guard and one lock.

    cache     a module is a folder of the cache: binary, table of kernels (.meta), source. Warp trusts what lies there, and a
              cut or garbled file fails every later run, or crashes it. So a module that was loaded leaves the digests of its
              files beside them (RECORD), and the version of `wsim.model.compiler` that made them; what does not agree with
              those, or has none and is not just being made, is removed and compiled once more. What fails then too is said
              with the cache and the way out, WARP_CACHE_PATH.
    lock      Warp compiles and captures for the whole process: launches of another thread would go into the graph that this
              one captures. Threads that step share the gate; who builds, compiles or captures has it alone.
"""

import errno
import hashlib
import json
import os
import re
import shutil
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any

import warp as wp

from wsim.model import warp_private
from wsim.model.compiler import core_team, variants
from wsim.model.compiler.version import rewriting_version
from wsim.scene import Problem, SceneError

RECORD = "wsim.json"     # {file: digest} of a module's folder, and of what rewrote its source
COMPILER = "compiler"
if wp.config.log_level == wp.LOG_INFO:       # Warp's default: its banner and a line for each module it loads
    wp.config.log_level = wp.LOG_WARNING
FRESH = 60.0             # [s] for which a folder without a record may be the work of a process that is about to leave one
SEEN: set[tuple] = set()         # (cache, module) that this process has looked at
STARTED: list[bool] = []         # not empty: Warp has been started
PROBE = 8 << 20          # bytes that a cache must take before a module is compiled: on a full disk LLVM ends the process


class SharedGate:
    """Many share it, or one has it alone. A thread that shares may have it alone inside: it lets go meanwhile."""

    def __init__(self):
        self.changed, self.own = threading.Condition(), threading.local()
        self.owner: int | None = None
        self.sharing, self.waiting = 0, 0

    @contextmanager
    def shared(self) -> Iterator[None]:
        if self.owner == threading.get_ident() or getattr(self.own, "shares", False):
            yield
            return
        with self.changed:
            while self.owner is not None or self.waiting:
                self.changed.wait()
            self.sharing += 1
            self.own.shares = True
        try:
            yield
        finally:
            with self.changed:
                self.sharing -= 1
                self.own.shares = False
                self.changed.notify_all()

    @contextmanager
    def alone(self) -> Iterator[None]:
        if self.owner == threading.get_ident():
            yield
            return
        shares = int(getattr(self.own, "shares", False))
        with self.changed:
            self.sharing, self.waiting = self.sharing - shares, self.waiting + 1
            try:
                while self.owner is not None or self.sharing:
                    self.changed.wait()
                self.owner = threading.get_ident()
            except BaseException:
                self.sharing += shares
                raise
            finally:
                self.waiting -= 1
                self.changed.notify_all()
        try:
            yield
        finally:
            with self.changed:
                self.owner, self.sharing = None, self.sharing + shares
                self.changed.notify_all()


GATE = SharedGate()


def start_warp() -> None:
    """Starts Warp. Raises SceneError where its cache of kernels cannot be."""
    named = wp.config.kernel_cache_dir or os.environ.keys() & {"WARP_CACHE_PATH", "XDG_CACHE_HOME"}
    if not named and os.path.expanduser("~") == "~":
        raise SceneError(Problem("kernel cache", "there is no home folder to keep compiled kernels in; set WARP_CACHE_PATH to "
                                 "a folder that can be written"))
    quiet = nullcontext() if STARTED else _standard_error_without(b"Could not find or load the NVIDIA CUDA driver")
    with GATE.alone(), quiet:
        try:
            wp.init()
            STARTED.append(True)
        except OSError as error:
            raise _refusal_of_cache(error) from error


@contextmanager
def _standard_error_without(text: bytes) -> Iterator[None]:
    """Passes on what comes to standard error but for lines with this text: Warp's native code warns of a missing driver, and a
    machine without a GPU has none."""
    try:
        sys.stderr.flush()
        kept, taken = os.dup(2), tempfile.TemporaryFile()                       # noqa: SIM115
    except (OSError, AttributeError):                  # no standard error, or no place for it
        yield
        return
    try:
        os.dup2(taken.fileno(), 2)
        yield
    finally:
        os.dup2(kept, 2)
        taken.seek(0)
        os.write(2, b"".join(line for line in taken if text not in line))
        os.close(kept)
        taken.close()


def warp_device(name):
    """The Warp device of that name; None: the first GPU, else the CPU. Raises SceneError with those there are."""
    start_warp()
    try:
        return wp.get_device(name)
    except Exception:
        have = ", ".join(str(d) for d in wp.get_devices())
        raise SceneError(Problem("device", f"there is no device {name!r}; allowed are {have}")) from None


def load_kernel_module(module, device, block_dim: int | None = None) -> None:
    """Compiles and loads a module (of Warp, of Python, or a name) on a device, once more from its source where what lies in
    the cache is damaged. Raises SceneError where the cache takes or gives nothing; errors of the code itself as they are."""
    module = module if isinstance(module, wp.Module) else wp.get_module(getattr(module, "__name__", module))
    with GATE.alone():
        known, place = warp_private.loaded_executables(module), (wp.config.kernel_cache_dir, module.name)
        try:
            if place not in SEEN:
                _remove_folders(_unsound_folders(module.name))
                SEEN.add(place)
            if not warp_private.in_cache(module, 1 if device.is_cpu else block_dim):
                probe_cache_folder()
            with variants.single_variant(device.is_cpu):
                wp.load_module(module, device=device, block_dim=block_dim)
        except SceneError:
            raise
        except Exception:
            _load_from_nothing(module, device, block_dim)
        if known is None or warp_private.loaded_executables(module) != known:
            _record_digests(module.name)
        core_team.join_executables(module, device)


def report_module(model, *what: str) -> str:
    """Name of a module of kernels that reports and checks launch: of what is in it and of no scene, so that the cache has it
    once for all scenes. All its kernels are made before the first is loaded."""
    digest = hashlib.blake2b(repr((model.real.__name__, *what)).encode(), digest_size=6).hexdigest()
    return f"wsim_report_{digest}"


def load_module_of_kernel(kernel, model) -> None:
    """Loads a kernel that a `wsim.model.model.Model` launches only when asked, outside of frames."""
    load_kernel_module(kernel.module, model.device, model.block if model.device.is_cuda else None)


@contextmanager
def without_header() -> Iterator[None]:
    """Warp's precompiled header costs more than it saves where one module is compiled."""
    headers = wp.config.use_precompiled_headers
    wp.config.use_precompiled_headers = False
    try:
        yield
    finally:
        wp.config.use_precompiled_headers = headers


@contextmanager
def capture_graph(device) -> Iterator[Any]:
    """Captures what is launched inside as a graph, `capture.graph`. Kernels must be loaded before."""
    from wsim.model.compiler import recorded
    with GATE.alone(), wp.ScopedCapture(device=device, force_module_load=False) as capture:
        recorded.lighten_capture()
        yield capture
        recorded.end_capture()


def _load_from_nothing(module, device, block_dim: int | None) -> None:
    """A second time from nothing: without the folders, and without Warp's memory of the failure."""
    try:
        _remove_folders(_folders_of_module(module.name))
        warp_private.forget_module(module)
        with variants.single_variant(device.is_cpu):
            wp.load_module(module, device=device, block_dim=block_dim)
    except Exception as error:
        fault = _fault_of_cache(error)
        if fault is None:
            raise
        raise _refusal_of_cache(fault) from error


def _fault_of_cache(error: Exception) -> Exception | None:
    """What the cache did wrong; None: it is not to blame."""
    text = str(error)
    if isinstance(error, OSError) or "Failed to load C" in text:
        return error
    return None


def probe_cache_folder() -> None:
    """Raises SceneError where the cache does not take what is about to be compiled."""
    probe = Path(str(wp.config.kernel_cache_dir), f"probe_{os.getpid()}")
    try:
        try:
            probe.write_bytes(bytes(PROBE))
        finally:
            probe.unlink(missing_ok=True)
    except OSError as error:
        raise _refusal_of_cache(error) from error


def _refusal_of_cache(error: Exception) -> SceneError:
    """The cache and the way out, in words."""
    place, code = wp.config.kernel_cache_dir, getattr(error, "errno", None)
    way = "set WARP_CACHE_PATH to a folder that can be written"
    if code in (errno.ENOSPC, errno.EDQUOT):
        text = f"the disk that compiled kernels are kept on is full; free space there, or {way} elsewhere"
    elif isinstance(error, OSError):
        text = f"compiled kernels cannot be kept there ({error.strerror or error}); make it writable, or {way}"
    else:
        text = f"compiled kernels cannot be loaded from there ({error}); remove the folder, or {way}"
    return SceneError(Problem(f"kernel cache {place}", text))


# the folders of a module

def _folders_of_module(name: str) -> list[Path]:
    """Of a module, in the versions that it had; a file may stand where one should be."""
    place, form = str(wp.config.kernel_cache_dir), re.compile(rf"wp_{re.escape(name)}_[0-9a-f]{{7}}\Z")
    try:
        return [Path(place, each) for each in os.listdir(place) if form.match(each)]
    except OSError:
        return []


def _digests_of_files(folder: Path) -> dict[str, str]:
    """Of what is loaded from a folder, by file."""
    return {f.name: hashlib.blake2b(f.read_bytes(), digest_size=16).hexdigest() for f in sorted(folder.iterdir())
            if f.is_file() and f.name != RECORD and f.suffix not in (".cpp", ".cu")}


def _unsound_folders(name: str) -> list[Path]:
    """Folders with files that are not those that were loaded, or of which nobody knows."""
    found = []
    for folder in _folders_of_module(name):
        try:
            now = _digests_of_files(folder)
            known = json.loads((folder / RECORD).read_bytes()) if (folder / RECORD).exists() else {}
            stale = bool(known) and known.get(COMPILER) != rewriting_version()
            differs = stale or any(now.get(file, digest) != digest for file, digest in known.items())
            if differs or (now.keys() - known.keys() and time.time() - folder.stat().st_mtime > FRESH):
                found.append(folder)
        except FileNotFoundError:                          # gone meanwhile
            pass
        except (OSError, ValueError, AttributeError):      # no folder, or no record
            found.append(folder)
    return found


def _remove_folders(folders: list[Path]) -> None:
    """As far as that is allowed: who may not write has to trust."""
    for folder in folders:
        with suppress(OSError):
            shutil.rmtree(folder) if folder.is_dir() and not folder.is_symlink() else folder.unlink()


def _record_digests(name: str) -> None:
    """Leaves the digests of folders that have none, or to which a file came."""
    for folder in _folders_of_module(name):
        try:
            kept, now = folder / RECORD, _digests_of_files(folder) | {COMPILER: rewriting_version()}
            if not kept.exists() or json.loads(kept.read_bytes()).keys() != now.keys():
                part = folder / f"{RECORD}.{os.getpid()}"
                part.write_text(json.dumps(now))
                os.replace(part, kept)
        except (OSError, ValueError):                      # a cache that only gives
            pass
