"""Maps grading over a class, on the cores of this machine."""

import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager

from grader.assignments import assignments
from grader.grade import grade, reference_outcomes, refused
from grader.sandbox.server import Server
from grader.submission import Refusal

# What a process of the pool holds: it is set once, when the process starts, and closed with it.
_bench = {}


@contextmanager
def local_pool(assignment, secret, jobs=None, tier=None):
    """Processes that grade.

    Parameters
    ----------
    assignment : Assignment
    secret : bytes
    jobs : int, optional
        Number of processes; one per core when left out.
    tier : int, optional
        Of isolation; the strongest available when left out.

    Yields
    ------
    Pool
    """
    cores = os.cpu_count() or 1
    jobs = jobs or cores
    # Spawned, not forked: the parent holds threads (progress bars), and a fork would copy their locks.
    context = multiprocessing.get_context("spawn")
    turn = context.BoundedSemaphore(max(1, cores - 1))
    with ProcessPoolExecutor(jobs, context, _set_up, (assignment.name, secret, turn, tier)) as executor:
        try:
            yield Pool(executor, assignment, secret)
        except BaseException:
            executor.shutdown(wait=False, cancel_futures=True)
            raise


class Pool:
    """Grading processes of one assignment."""

    def __init__(self, executor, assignment, secret):
        self._executor = executor
        self._secret = secret
        self._assignment = assignment

    def references(self):
        """Run the reference: yield (variant name, list of Outcome) as they are done."""
        futures = {
            self._executor.submit(_reference_outcomes, variant.name): variant.name
            for variant in self._assignment.variants
        }
        for future in as_completed(futures):
            yield futures[future], future.result()

    def grade(self, submissions, references):
        """Grade submissions: yield (submission, Result) as they are done.

        One that the grader itself stumbles over is refused with the reason, and the class goes on.
        """
        futures = {self._executor.submit(_grade, submission, references): submission for submission in submissions}
        for future in as_completed(futures):
            submission, error = futures[future], future.exception()
            if error is None:
                yield submission, future.result()
            elif isinstance(error, BrokenProcessPool):
                raise error
            else:
                reason = f"the grader failed on it ({type(error).__name__}: {error}): grade it by hand, and report this"
                yield (
                    submission,
                    refused(Refusal(submission.name, submission.path, reason), self._assignment, self._secret),
                )


def _set_up(name, secret, turn, tier):
    assignment = assignments()[name].under(secret)
    constants = assignment.variants[0].constants
    _bench.update(
        assignment=assignment,
        secret=secret,
        turn=turn,
        server=Server(preload=(type(constants).__module__,), withheld=assignment.withheld, tier=tier),
        reference_server=Server(trusted=assignment.reference, tier=tier),
    )


def _reference_outcomes(variant_name):
    assignment = _bench["assignment"]
    variant = assignment.variant(variant_name)
    return reference_outcomes(_bench["reference_server"], assignment, variant, _bench["secret"])


def _grade(submission, references):
    return grade(
        submission,
        _bench["assignment"],
        _bench["server"],
        _bench["reference_server"],
        references,
        _bench["secret"],
        _bench["turn"],
    )
