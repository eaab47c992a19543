import numpy as np
import pytest

from course_lib.recording import Run, replay


def run_of(steps):
    return Run(np.zeros((steps + 1, 2)), np.arange(steps)[:, None] + 0.5, 10.0 * np.arange(steps)[:, None])


def test_a_run_whose_parts_differ_in_length_is_refused():
    with pytest.raises(ValueError, match="3 observations needs 4 true states and 3 controls, got 3 and 3"):
        Run(np.zeros((3, 2)), np.zeros((3, 1)), np.zeros((3, 1)))
    with pytest.raises(ValueError, match="got 4 and 2"):
        Run(np.zeros((4, 2)), np.zeros((3, 1)), np.zeros((2, 1)))


def test_replay_hands_each_step_what_happened_in_it_and_what_the_last_call_returned():
    rng = np.random.default_rng(0)
    calls = []

    def estimator(previous, observation, control, constants, rng):
        calls.append((previous, observation, control, constants, rng))
        return len(calls)

    run = run_of(3)
    assert list(replay(estimator, run, "constants", rng)) == [1, 2, 3, 4]
    assert run.steps == 3
    assert calls[0] == (None, None, None, "constants", rng)
    for k in (1, 2, 3):
        assert calls[k] == (k, k - 0.5, 10.0 * (k - 1), "constants", rng)


def test_replay_calls_the_estimator_only_when_the_next_posterior_is_asked_for():
    calls = []
    posteriors = replay(lambda previous, *_: calls.append(previous), run_of(3), None, np.random.default_rng(0))
    next(posteriors)
    assert len(calls) == 1
