"""Maps grading over a class, on the cores of this machine."""

import gc
import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.util import Finalize

from grader.assignments import assignments
from grader.grading.evaluate import preload
from grader.grading.grade import grade, plan, reference_outcome, refused
from grader.intake.submission import Refusal
from grader.sandbox.server import Server

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

    def references(self, cap, track=iter):
        """Run the reference in all episodes of the plan, once for the class.

        Parameters
        ----------
        cap : int
            Number of episodes.
        track : callable
            Takes an iterator over them that ends when the last is done, and shows how far it is.

        Returns
        -------
        dict of str to list of Outcome
            As `grade` takes them.
        """
        futures = [
            (variant.name, self._executor.submit(_reference_outcome, variant.name, episode))
            for variant, episode in plan(self._assignment, cap)
        ]
        for future in track(as_completed([future for _, future in futures])):
            future.result()
        references = {variant.name: [] for variant in self._assignment.variants}
        for name, future in futures:
            references[name].append(future.result())
        return references

    def grade(self, submissions, references, width):
        """Grade submissions: yield (submission, Result) as they are done.

        One that the grader itself stumbles over is refused with the reason, and the class goes on.
        """
        futures = {
            self._executor.submit(_grade, submission, references, width): submission for submission in submissions
        }
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
    _bench.update(
        assignment=assignment,
        secret=secret,
        turn=turn,
        server=Server(preload=preload(assignment), withheld=assignment.withheld, tier=tier),
        reference_server=Server(trusted=assignment.reference, tier=tier),
    )
    for server in (_bench["server"], _bench["reference_server"]):
        # A process of a pool ends without its interpreter's own finalisation.
        Finalize(None, server.close, exitpriority=0)
    # What has been imported stays: the garbage collector need not look through it again and again.
    gc.collect()
    gc.freeze()


def _reference_outcome(variant_name, episode):
    assignment = _bench["assignment"]
    variant = assignment.variant(variant_name)
    return reference_outcome(_bench["reference_server"], assignment, variant, episode, _bench["secret"])


def _grade(submission, references, width):
    return grade(
        submission,
        _bench["assignment"],
        _bench["server"],
        _bench["reference_server"],
        references,
        _bench["secret"],
        _bench["turn"],
        width,
    )
