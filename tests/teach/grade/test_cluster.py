"""A real Dask cluster of two workers: what one process gives, they give, though one of them is killed."""

import os
import signal
import threading
import time
from pathlib import Path

import pytest
import submitted_tracers as tracers

from raytwin.errors import MachineError
from raytwin.parallel import Workers, map_parallel
from raytwin.teach.grade.class_run import jobs_of, run

distributed = pytest.importorskip("distributed")

# Dask's own, of sockets and loops that it leaves to the garbage collector.
pytestmark = [
    pytest.mark.nightly,
    pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::DeprecationWarning", "ignore::UserWarning"),
]

TESTS = str(Path(__file__).parents[2])

RUBRIC = """
title = "t"
[[exercises]]
stage = "intersect_sphere"
points = 10
[[exercises]]
stage = "shade"
points = 5
[limits]
seconds = 30
"""


def slow_square(x: int) -> int:
    time.sleep(0.2)
    return x * x


def killed_by_three(x: int) -> int:
    if x == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return x * x


def test_a_thing_that_kills_its_local_process_costs_itself_alone():
    found = {d.thing: d for d in map_parallel(killed_by_three, list(range(5)), Workers(jobs=2))}
    assert [found[x].result for x in (0, 1, 2, 4)] == [0, 1, 4, 16]
    assert str(found[3].error) == "3: expected a process that lives, got one that is killed"


def test_no_scheduler_at_the_address_is_said(monkeypatch):
    monkeypatch.setattr("raytwin.parallel.CONNECT", 0.5)
    with pytest.raises(MachineError, match="the address of a Dask scheduler"):
        list(map_parallel(slow_square, [1], Workers(dask="tcp://127.0.0.1:1")))


# ------------------------------------------------------------------------------------------ with a cluster


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", os.pathsep.join([TESTS, os.environ.get("PYTHONPATH", "")]))
        made = distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, host="127.0.0.1",
            local_directory=str(tmp_path_factory.mktemp("dask")), silence_logs=50,
        )  # fmt: skip
        with made:
            yield made


def test_a_cluster_grades_a_class(cluster, tmp_path):
    (tmp_path / "rubric.toml").write_text(RUBRIC)
    (tmp_path / "in").mkdir()
    for name in ("", "pi"):
        (tmp_path / "in" / f"{name or 'right'}.py").write_text(tracers.tracer(name))
    jobs = jobs_of(tmp_path / "in", tmp_path / "rubric.toml")
    found = {r.student: r for r in run(jobs, tmp_path / "out", Workers(dask=cluster.scheduler_address))}
    assert found["right"].points == 15
    assert (found["pi"].points < 15, found["pi"].exercises[1].causes) == (True, ("pi-missing",))
    assert sorted(p.name for p in (tmp_path / "out" / "results").iterdir()) == sorted(f"{j.key}.json" for j in jobs)


def test_a_worker_that_is_killed_in_the_middle_costs_nothing(cluster):
    things, done = list(range(12)), []
    pids = [worker.process.pid for worker in cluster.workers.values()]
    for found in map_parallel(slow_square, things, Workers(dask=cluster.scheduler_address)):
        done.append(found)
        if len(done) == 3:
            os.kill(pids[0], signal.SIGKILL)
    assert sorted((d.thing, d.result) for d in done) == [(x, x * x) for x in things]
    assert threading.active_count() < 100
