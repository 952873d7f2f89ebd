"""A real Dask cluster of two workers: what one process gives, they give, though one of them is killed."""

import os
import signal
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


def test_a_cluster_grades_a_class_and_a_worker_that_is_killed_costs_nothing(tmp_path, monkeypatch):
    monkeypatch.setenv(
        "PYTHONPATH", os.pathsep.join([str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")])
    )
    (tmp_path / "rubric.toml").write_text('title = "t"\n[[exercises]]\nstage = "shade"\npoints = 5\n')
    (tmp_path / "in").mkdir()
    for name in ("", "pi"):
        (tmp_path / "in" / f"{name or 'right'}.py").write_text(tracers.tracer(name))
    jobs = jobs_of(tmp_path / "in", tmp_path / "rubric.toml")
    options = {"threads_per_worker": 1, "dashboard_address": None, "host": "127.0.0.1", "silence_logs": 50}
    with distributed.LocalCluster(n_workers=2, local_directory=str(tmp_path / "dask"), **options) as cluster:
        workers = Workers(dask=cluster.scheduler_address)
        found = {r.student: r for r in run(jobs, tmp_path / "out", workers)}
        assert (found["right"].points, found["pi"].exercises[0].causes) == (5, ("pi-missing",))
        stored = sorted(p.name for p in (tmp_path / "out" / "results").iterdir())
        assert stored == sorted(f"{j.key}.json" for j in jobs)
        pid, done = next(iter(cluster.workers.values())).process.pid, []
        for one in map_parallel(slow_square, list(range(12)), workers):
            done.append((one.thing, one.result))
            if len(done) == 3:
                os.kill(pid, signal.SIGKILL)
        assert sorted(done) == [(x, x * x) for x in range(12)]
