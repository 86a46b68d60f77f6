"""Workers by Ray, on a cluster of three nodes that stands on this machine (ray.cluster_utils): what is killed is made good.

Slow, and skipped where Ray is not installed (pip install -e ".[sweep]"): rows of the same sweep in one process are the truth.
"""

import os
import signal
import subprocess
import sys
import time

import pytest

import wsim
from tests.make.sweep.sweep import hung, lasting, table
from wsim.scene import SceneError
from wsim.sweep.job import Settings

pytestmark = [pytest.mark.slow, pytest.mark.skipif(not __import__("importlib.util").util.find_spec("ray"),
                                                   reason='Ray is not installed: pip install -e ".[sweep]"')]
VARY = ["stretch=log(100,1000,6)", "gravity_y=list(-9.81,-3)"]
STORE = 100 * 2**20


@pytest.fixture(scope="module")
def file(tmp_path_factory) -> str:
    """A scene whose runs last long enough to be killed."""
    return hung(tmp_path_factory.mktemp("scene") / "hung.usda", frames=200, substeps=40)


@pytest.fixture(scope="module")
def undisturbed(file, tmp_path_factory) -> list[dict]:
    return lasting(wsim.sweep(file, VARY, tmp_path_factory.mktemp("truth") / "out", settings=Settings(device="cpu")))


@pytest.fixture
def cluster():
    """Three nodes of one core; nothing of it stays behind."""
    import ray
    from ray.cluster_utils import Cluster
    made = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "object_store_memory": STORE})
    made.more = [made.add_node(num_cpus=1, object_store_memory=STORE) for _ in range(2)]
    made.wait_for_nodes()
    try:
        yield made
    finally:
        ray.shutdown()
        made.shutdown()


def settings(cluster, **more) -> Settings:
    return Settings(device="cpu", address=cluster.address, worlds=1, **more)


def test_a_cluster_gives_the_table_of_one_process(file, undisturbed, cluster, tmp_path):
    rows = list(wsim.sweep(file, VARY, tmp_path / "out", settings=settings(cluster)))
    assert lasting(sorted(rows, key=lambda r: r["run"])) == undisturbed == lasting(table(tmp_path / "out"))
    assert len({r["worker"] for r in rows}) == 3


def test_a_worker_that_is_killed_is_replaced_and_its_run_done_again(file, undisturbed, cluster, tmp_path):
    rows = wsim.sweep(file, VARY, tmp_path / "out", settings=settings(cluster))
    first = next(rows)
    os.kill(int(first["worker"].rpartition(":")[2]), signal.SIGKILL)
    every = [first, *rows]
    assert lasting(table(tmp_path / "out")) == undisturbed
    assert max(r["tries"] for r in every) == 2 and {r["status"] for r in every} == {"done"}


def test_a_node_that_is_killed_leaves_the_table_whole(file, undisturbed, cluster, tmp_path):
    rows = wsim.sweep(file, VARY, tmp_path / "out", settings=settings(cluster))
    first = [next(rows) for _ in range(2)]
    cluster.remove_node(cluster.more[0], allow_graceful=False)
    every = [*first, *rows]
    assert lasting(table(tmp_path / "out")) == undisturbed and {r["status"] for r in every} == {"done"}


def test_a_driver_that_is_killed_leaves_rows_from_which_another_goes_on(file, undisturbed, cluster, tmp_path):
    out = tmp_path / "out"
    code = (f"import wsim; from wsim.sweep.job import Settings; list(wsim.sweep({file!r}, {VARY!r}, {str(out)!r}, "
            f"settings=Settings(device='cpu', address={cluster.address!r}, worlds=1)))")
    driver = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    journal, began = out / "rows.jsonl", time.monotonic()
    while not (journal.exists() and journal.read_text().count("\n") >= 3):
        assert time.monotonic() - began < 200.0 and driver.poll() is None
        time.sleep(0.05)
    driver.kill()
    driver.wait()
    kept = journal.read_text().count("\n")
    assert 3 <= kept < len(undisturbed) and 0 < len(table(out)) <= kept
    rows = list(wsim.sweep(file, VARY, out, resume=True, settings=settings(cluster)))
    assert lasting(table(out)) == undisturbed and len(rows) == len(undisturbed)


def test_a_run_that_ends_its_worker_again_and_again_is_listed(file, cluster, tmp_path, monkeypatch):
    """The scene of one draw is a file that is gone when the worker comes to it; others are done."""
    from wsim.sweep import cluster as workers

    class Deadly(workers.RemoteWorker):
        def run(self, part):
            if any(draw["stretch"] == 200.0 for _, draw in part):
                os._exit(1)
            return super().run(part)
    monkeypatch.setattr(workers, "RemoteWorker", Deadly)
    rows = list(wsim.sweep(file, "stretch=list(100,200,300)", tmp_path / "out", settings=settings(cluster, retries=1)))
    rows = {r["stretch"]: r for r in rows}
    assert [rows[s]["status"] for s in (100.0, 200.0, 300.0)] == ["done", "failed", "done"]
    assert rows[200.0]["tries"] == 2 and "its worker was lost" in rows[200.0]["why"]


def test_workers_of_other_versions_are_refused(file, cluster, tmp_path, monkeypatch):
    from wsim.sweep import cluster as workers

    class Old(workers.RemoteWorker):
        def hello(self):
            return super().hello() | {"warp-lang": "0.1"}
    monkeypatch.setattr(workers, "RemoteWorker", Old)
    with pytest.raises(SceneError, match=r"runs warp-lang 0.1 and not .*; install the same on every node"):
        list(wsim.sweep(file, VARY, tmp_path / "out", settings=settings(cluster)))


def test_ray_adds_less_than_a_twentieth_to_runs_of_a_second(file, tmp_path):
    """Ten runs one after another on one worker, from the first that is handed out to the last row."""
    from wsim.sweep.cluster import RayCluster
    from wsim.sweep.job import Job
    job = Job(file, {}, str(tmp_path), 0, Settings(device="cpu", workers=1), runs="tests.make.sweep.sleeper")
    with RayCluster(job) as workers:
        next(iter(workers.run([[(0, {})]])))                     # the worker has made what it needs
        began = time.perf_counter()
        rows = [row for part in workers.run([[(k, {})] for k in range(10)]) for row in part]
        whole = time.perf_counter() - began
    bare = sum(row["seconds"] for row in rows)
    print(f"{whole:.3f} s for {bare:.3f} s of runs: {100.0 * (whole / bare - 1.0):.2f} %")
    assert len(rows) == 10 and whole < 1.05 * bare


def test_an_address_where_nothing_answers_is_told(file, tmp_path):
    with pytest.raises(SceneError, match="no Ray cluster answers there"):
        list(wsim.sweep(file, VARY, tmp_path / "out", settings=Settings(device="cpu", address="127.0.0.1:1")))


@pytest.mark.parametrize("killed", [False, True])
def test_one_fit_whose_copies_are_on_two_workers_is_that_of_one_process(killed, cluster):
    """To the bit, with turns of three copies on each, and where a worker is killed on the way."""
    from tests.make.fitting.shared import WINDS, hung, seen
    from wsim.fitting.fit import Settings as Fitting
    from wsim.fitting.fit import fit
    from wsim.sweep.team import Team
    begun, specimens = hung(stretch=200.0, wind=2.0), [seen(hung(wind=wind)) for wind in WINDS]

    def found(**more):
        return fit(begun, specimens[0], "stretch,bend,wind_x", also=[(begun, specimens[1])], each=more.pop("each", None),
                   settings=Fitting(device="cpu", shared=("stretch", "bend"), **more))
    with Team(settings(cluster, workers=2), copies=3) as team:
        def kill(step):
            if killed and step["step"] == 2:
                import ray
                ray.kill(team.cluster.actors[1])
        spread, whole = found(team=team, each=kill), found()
    assert spread.estimate.theta.tobytes() == whole.estimate.theta.tobytes()
    assert (spread.steps, spread.simulations, spread.residuals) == (whole.steps, whole.simulations, whole.residuals)
