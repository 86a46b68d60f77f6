"""Workers by Ray: a process each, on this machine or on a cluster, handed parts of a sweep.

Ray (Moritz and others 2018, OSDI) starts processes where there is room, carries what they are given and what they answer, and
says when one is lost. Here: what is handed out, what is tried again, and what workers must have in common.

    start     every worker says its versions, its cache of kernels and whether it sees the folder; other versions are refused
    loss      the runs of a lost worker go back, one by one, so that the one that ended it is alone when it is tried again;
              after `Settings.retries` further losses it is listed as failed. Another worker is started where there is room
    end       workers end with the process that started them, however that ends
"""

import os
import socket
import sys
from collections import deque
from collections.abc import Iterable, Iterator
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from time import monotonic
from typing import Any

import ray

from wsim.model.compiler.core_team import VARIABLE
from wsim.scene import Problem, SceneError

Item = tuple[int, Any]
STORE = 100 * 2**20          # [bytes] of Ray's object store on this machine: rows are small
PATIENCE = 120.0             # [s] without any worker, after which a sweep ends
MOST = {True: 1024, False: 8}        # runs of a part on GPUs, and on CPUs, where rows come late else


class RemoteWorker:
    """One worker, in a process of its own."""

    def __init__(self, job):
        self.job, self.worker = job, None

    def hello(self) -> dict:
        """Things that a worker must have in common with others."""
        return {**package_versions(), **describe_worker(self.job)}

    def run(self, part: list[Item]) -> list[dict]:
        if self.worker is None:
            import warp as wp
            wp.config.log_level = wp.LOG_WARNING
            self.worker = import_module(self.job.runs).Worker(self.job)
        return self.worker.run(part)


def package_versions() -> dict:
    """Versions on which results depend."""
    from wsim import __version__
    found = {"wsim": __version__, "python": ".".join(map(str, sys.version_info[:2]))}
    for name in ("warp-lang", "numpy", "usd-core"):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found


def describe_worker(job) -> dict:
    """Where a worker runs, where it keeps kernels, and what it sees of the files of a job."""
    import warp as wp

    from wsim.model import kernel_cache
    device = kernel_cache.warp_device(job.settings.device)
    cache = str(wp.config.kernel_cache_dir)
    unseen = [path for path in job.files() if not os.path.exists(path)]
    return {"node": socket.gethostname(), "device": str(device), "cache": cache, "writes": os.access(cache, os.W_OK),
            "unseen": unseen}


class RayCluster:
    """Workers of a job. A context manager: they are there inside it. Raises SceneError where they cannot be had."""

    def __init__(self, job):
        self.job, self.settings = job, job.settings
        self.own = False                          # Ray was started here
        self.actors: list = []
        self.said: list[str] = []

    def __enter__(self) -> "RayCluster":
        try:
            self._connect_to_ray()
            self._start_workers()
            self._check()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_) -> None:
        for actor in self.actors:
            ray.kill(actor)
        self.actors = []
        if self.own:
            ray.shutdown()

    @property
    def size(self) -> int:
        return len(self.actors)

    @property
    def most(self) -> int:
        """Runs of a part at most."""
        return self.settings.worlds or MOST[self.gpu]

    # start

    def _connect_to_ray(self) -> None:
        os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")      # workers without a GPU see the devices there are
        if ray.is_initialized():
            return
        quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": "ERROR"}
        address = self.settings.address
        self.own = True
        if address is None:
            ray.init(num_cpus=(self.settings.workers or 1) * self.settings.cores, object_store_memory=STORE,
                     include_dashboard=False, **quiet)
            return
        try:
            require_address_answers(address)
            ray.init(address=address if address == "auto" or ":" in address else f"{address}:6379", **quiet)
        except Exception as error:
            first = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
            raise SceneError(Problem(f"--address {address}", f"no Ray cluster answers there: {first}; start one by: ray start "
                                     "--head")) from None

    def _start_workers(self) -> None:
        """One a GPU, unless another device is named; else one for so many cores."""
        there = ray.cluster_resources()
        gpus, cpus = int(there.get("GPU", 0)), int(there.get("CPU", 0))
        self.gpu = gpus > 0 and not str(self.settings.device or "cuda").startswith("cpu")
        room = gpus if self.gpu else cpus // self.settings.cores
        count = min(self.settings.workers or room, room)
        if count < 1 or count < (self.settings.workers or 0):
            what = f"{gpus} GPUs" if self.gpu else f"{cpus} cores, {self.settings.cores} to a worker"
            raise SceneError(Problem("--workers", f"{self.settings.workers or 1} are asked for, and there are {what}"))
        threads = {name: str(self.settings.cores) for name in (VARIABLE, "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS",
                                                               "MKL_NUM_THREADS")}
        cache = {"WARP_CACHE_PATH": os.environ["WARP_CACHE_PATH"]} if "WARP_CACHE_PATH" in os.environ else {}
        self.maker = ray.remote(RemoteWorker).options(num_cpus=self.settings.cores, num_gpus=1 if self.gpu else 0,
                                                      max_restarts=0, runtime_env={"env_vars": threads | cache})
        self.given = ray.put(self.job)
        self.actors = [self.maker.remote(self.given) for _ in range(count)]

    def _check(self) -> None:
        """Asks every worker what it is. Raises SceneError for other versions, and files that they do not see."""
        answers: dict[Any, dict] = {}
        problems: list[Problem] = []
        waiting = {actor.hello.remote(): actor for actor in self.actors}
        ready, late = ray.wait(list(waiting), num_returns=len(waiting), timeout=PATIENCE)
        for ref in ready:
            try:
                answers[waiting[ref]] = ray.get(ref)
            except Exception as error:
                problems.append(Problem("worker", f"could not start: {last_error_line(error)}"))
        if not answers and not problems:
            problems.append(Problem("worker", f"none of {len(late)} has started after {PATIENCE:g} s"))
        problems += [p for answer in answers.values() for p in worker_differences(answer)]
        if problems:
            raise SceneError(dict.fromkeys(problems))
        for ref in late:                                  # no room for them yet
            ray.kill(waiting[ref])
        self.actors = [a for a in self.actors if a in answers]
        places = sorted({f"{a['node']} ({a['device']}, kernels in {a['cache']}" + ", which it cannot write" * (not a["writes"])
                         + ")" for a in answers.values()})
        self.said.append(f"{len(self.actors)} workers: {'; '.join(places)}")

    # runs

    def run(self, parts: Iterable[list[Item]]) -> Iterator[list[dict]]:
        """Rows of parts as they end, not in order."""
        queue = deque((part, 1) for part in parts)
        idle, flying, starting = list(self.actors), dict[Any, tuple](), dict[Any, Any]()
        since = monotonic()
        while queue or flying:
            while queue and idle:
                actor, (part, tries) = idle.pop(), queue.popleft()
                flying[actor.run.remote(part)] = actor, part, tries
            if not flying and not starting:
                starting |= self._start_another_worker()
            if flying:
                since = monotonic()
            elif monotonic() - since > PATIENCE:
                raise SceneError(Problem("worker", f"all are lost, and none has started for {PATIENCE:g} s; go on with "
                                         "--resume"))
            ready, _ = ray.wait([*flying, *starting], timeout=1.0)
            for ref in ready:
                if ref in starting:
                    idle += self._started(ref, starting.pop(ref))
                    continue
                actor, part, tries = flying.pop(ref)
                rows, lost = self.answer_of_worker(ref)
                if rows is not None:
                    idle.append(actor)
                    yield [{**row, "tries": row["tries"] + tries - 1} for row in rows]
                    continue
                self.actors.remove(actor)
                starting |= self._start_another_worker()
                if tries > self.settings.retries:
                    yield [{**self.job.lost(item, lost), "tries": tries} for item in part]
                else:
                    queue.extend(([item], tries + 1) for item in part)

    def _start_another_worker(self) -> dict:
        """A further worker, that is asked what it is."""
        actor: Any = self.maker.remote(self.given)
        return {actor.hello.remote(): actor}

    def _started(self, ref, actor) -> list:
        try:
            good = not worker_differences(ray.get(ref))
        except Exception:
            good = False
        if good:
            self.actors.append(actor)
        return [actor] * good

    @staticmethod
    def answer_of_worker(ref) -> tuple[Any, str]:
        """Answer of a worker; None and why, where it is lost or has failed."""
        try:
            return ray.get(ref), ""
        except Exception as error:
            return None, last_error_line(error)


def require_address_answers(address: str) -> None:
    """Raises OSError where nothing listens at an address: Ray itself would ask for minutes."""
    if address == "auto" or "://" in address:
        return
    host, _, port = address.partition(":")
    with socket.create_connection((host, int(port or 6379)), timeout=10.0):
        pass


def worker_differences(answer: dict) -> list[Problem]:
    """Differences of a worker from this process."""
    here, node = package_versions(), answer["node"]
    others = [f"{name} {answer[name]} and not {here[name]}" for name in here if answer[name] != here[name]]
    problems = [Problem(node, f"runs {', '.join(others)}; install the same on every node")] if others else []
    if answer["unseen"]:
        problems.append(Problem(node, f"does not see {', '.join(answer['unseen'])}; put scene and folder where all nodes see "
                                "them"))
    return problems


def last_error_line(error: Exception) -> str:
    """An error of Ray in one line."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return (lines[-1] if lines else type(error).__name__)[:300]
