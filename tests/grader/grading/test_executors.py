"""Grading in processes: a fault of the grader's own costs one submission its grade and the class nothing."""

from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from types import SimpleNamespace

import pytest

from grader.assignments import assignments
from grader.grading import executors
from grader.grading.executors import Pool, local_pool
from grader.intake.submission import Submission


def pool(outcomes):
    """A pool whose processes end as `outcomes` says, by name: with a value, or an exception."""

    def submit(function, submission, references, width):
        future = Future()
        outcome = outcomes[submission.name]
        (future.set_exception if isinstance(outcome, Exception) else future.set_result)(outcome)
        return future

    return Pool(SimpleNamespace(submit=submit), assignments()["vacuum"], b"secret")


ANA, BEN = (Submission(name, f"{name}.py", "") for name in ("ana", "ben"))


def test_a_fault_of_the_grader_refuses_one_and_grades_the_next():
    results = dict(pool({"ana": ZeroDivisionError("by zero"), "ben": "a result"}).grade([ANA, BEN], {}, 15.0))
    assert results[BEN] == "a result"
    assert results[ANA].status == "refused" and results[ANA].points == 0.0
    assert "ZeroDivisionError: by zero" in results[ANA].message


def test_processes_that_die_end_the_grading():
    with pytest.raises(BrokenProcessPool):
        list(pool({"ana": BrokenProcessPool("died")}).grade([ANA], {}, 15.0))


def test_references_are_one_task_per_episode_and_come_back_in_order():
    futures = []

    def submit(function, variant, episode):
        futures.append((Future(), (variant, episode)))
        return futures[-1][0]

    def track(done):
        # The last one first, as it may happen with many processes.
        for future, outcome in reversed(futures):
            future.set_result(outcome)
        finished = list(done)
        assert len(finished) == 45
        return finished

    references = Pool(SimpleNamespace(submit=submit), assignments()["vacuum"], b"secret").references(45, track)
    assert sum(map(len, references.values())) == 45
    for variant, outcomes in references.items():
        assert outcomes == [(variant, episode) for episode in range(len(outcomes))] and outcomes


def test_a_reference_that_fails_ends_it_at_once():
    def submit(function, variant, episode):
        future = Future()
        future.set_exception(RuntimeError("the reference failed"))
        return future

    with pytest.raises(RuntimeError, match="the reference failed"):
        Pool(SimpleNamespace(submit=submit), assignments()["vacuum"], b"secret").references(45)


def test_a_pool_leaves_nothing_where_its_fork_servers_were(tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    with local_pool(assignments()["vacuum"], b"a secret of the tests", jobs=1) as pool:
        pool._executor.submit(enter_both).result()
        assert len(list(tmp_path.glob("grader-*"))) == 2
    assert list(tmp_path.glob("grader-*")) == []


def enter_both():
    """In a process of the pool: start both of its fork servers."""
    for name in ("server", "reference_server"):
        executors._bench[name].__enter__()
