"""What the check of a scan's likelihood tries, and the faults it knows by name."""

import numpy as np
from scipy.special import ndtr

from course_lib.dr20 import models
from course_lib.dr20.constants import Constants
from grader.assignments.dr20.motion_checks import OTHER, words
from grader.lessons import expect


def log_likelihood(function):
    """Reading by reading and all together: near the wall, before it, beyond it, nothing."""
    for constants in (Constants(), OTHER):
        rng = np.random.default_rng(8)
        truth = models.anywhere(40, constants, rng)
        seen = models.distances(truth, constants)
        # A place from which one beam sees no wall within reach, so that `inf` is expected somewhere.
        place = np.argmax(seen.max(axis=1) - 10.0 * (np.sort(seen, axis=1)[:, -2] > constants.r_max))
        states = truth[place] + np.array([0.06, 0.06, 0.1]) * rng.standard_normal((120, 3))
        states = np.vstack([states, truth])
        expected = seen[place]
        near = np.where(expected > constants.r_max, np.inf, expected + 0.5 * constants.sigma)
        near = np.where(near > constants.r_max, np.inf, near)
        short = np.where(np.arange(len(near)) == np.argmin(expected), 0.4 * expected, near)
        missed = np.where(np.arange(len(near)) == np.argmin(expected), np.inf, near)
        off = rng.uniform(0.0, constants.r_max, len(near))
        nothing = np.full(len(near), np.inf)
        for observation, what in [
            (near, "readings near the walls"),
            (short, "one reading short of the wall"),
            (missed, "one reading missed (inf)"),
            (off, "random readings"),
            (nothing, "nothing but inf"),
        ]:
            call = f"log_likelihood of {what}, {words(constants)}"
            with np.errstate(all="ignore"):
                got = function(observation, states, constants)
            _reads_inf(got, observation, states, call)
            got = expect.array(got, (len(states),), call, kind="l")
            right = models.log_likelihood(observation, states, constants)
            with np.errstate(all="ignore"):
                expect.close(got, right, call, _likelihood_faults(observation, states, constants, right))


def _reads_inf(got, observation, states, call):
    """Fail where an infinite reading was computed with."""
    if not isinstance(got, np.ndarray) or got.shape != (len(states),) or got.dtype.kind != "f":
        return
    bad = ~np.isfinite(got)
    if np.isinf(observation).any() and bad.all():
        raise AssertionError(
            "inf is treated as a range: that a beam sees nothing has a probability of its own, eq. (6).\n"
            f"{call}: {got[bad][0]} at {bad.sum()} of {len(got)} states"
        )
    assert not bad.any(), (
        f"{call}: {got[bad][0]} at {bad.sum()} of {len(got)} states; a reading that nothing explains is random, and "
        "has the density p_random / r_max"
    )


def _likelihood_faults(observation, states, constants, right):
    """What faulty models say, and their names."""
    d = models.distances(states, constants)
    z, there = observation, np.isfinite(observation)
    finite = np.where(there, z, 0.0)
    rate, r_max = constants.rate_short, constants.r_max

    def parts(d=d, sigma=constants.sigma, half=0.5, scale=1.0, base=None):
        """Densities of a hit, of a short reading and of a random one; probabilities of `inf` by hit and by short."""
        hit = (
            np.exp(-half * ((finite - d) / sigma) ** 2) / (scale * sigma * np.sqrt(2 * np.pi)) if base is None else base
        )
        whole = -np.expm1(-rate * d)
        short = np.where(finite <= d, rate * np.exp(-rate * finite) / whole, 0.0)
        far = ndtr((d - r_max) / constants.sigma)
        early = np.where(d > r_max, (np.exp(-rate * r_max) - np.exp(-rate * d)) / whole, 0.0)
        return hit, short, 1.0 / r_max, far, early

    def model(
        hit=None, short=None, random=None, far=None, early=None, p_hit=None, miss=constants.p_miss, unseen=None,
        across=None, **change
    ):  # fmt: skip
        usual = parts(**change)
        hit, short, random, far, early = (
            mine if mine is not None else its for mine, its in zip((hit, short, random, far, early), usual, strict=True)
        )
        p_hit = 1 - constants.p_short - constants.p_miss - constants.p_random if p_hit is None else p_hit
        reading = p_hit * hit + constants.p_short * short + constants.p_random * random
        nothing = miss + p_hit * far + constants.p_short * early if unseen is None else unseen
        p = np.where(there, reading, nothing)
        return across(p) if across else np.log(p).sum(axis=1)

    hit, short, random, far, early = parts()
    p_hit = 1 - constants.p_short - constants.p_miss - constants.p_random
    yield (
        model(across=lambda p: np.log(p.sum(axis=1))),
        "Densities are summed over the beams: independent beams multiply.",
    )
    yield (
        model(across=lambda p: np.log(p.mean(axis=1))),
        "Densities are averaged over the beams: independent beams multiply.",
    )
    yield model(across=lambda p: p.sum(axis=1)), "Densities are summed over the beams: independent beams multiply."
    yield np.exp(right), "This is the likelihood: return its logarithm."
    yield right / np.log(10.0), "This is the logarithm to base 10: use np.log."
    yield right / len(z), "Independent beams: add their logarithms, do not average."
    yield right - right.max(), "Not normalised, please: how well the scan fits at all is for the averages to see."
    yield (
        right - np.logaddexp.reduce(right),
        "Not normalised, please: how well the scan fits at all is for the averages.",
    )
    yield model(unseen=1.0), "A reading of inf is left out: that a beam sees nothing speaks for a far wall, eq. (6)."
    yield model(unseen=constants.p_miss), "inf comes not from misses alone: a wall beyond r_max is not seen either."
    yield model(miss=0.0), "A beam may miss the wall for no reason: p_miss is left out."
    at_limit = np.where(there, z, r_max)
    moved = p_hit * np.exp(-0.5 * ((at_limit - d) / constants.sigma) ** 2) / (constants.sigma * np.sqrt(2 * np.pi))
    moved += constants.p_short * np.where(at_limit <= d, rate * np.exp(-rate * at_limit) / -np.expm1(-rate * d), 0.0)
    as_r_max = np.log(moved + constants.p_random / r_max).sum(axis=1)
    yield as_r_max, "inf is read as r_max: that a beam sees nothing has a probability of its own, eq. (6)."
    yield model(far=1.0 - far), "The sign in Φ: a wall farther than r_max is the likelier not to be seen."
    yield model(far=d > r_max), "The noise decides near r_max: Φ((d - r_max) / σ) instead of a step."
    yield (
        model(early=0.0),
        "What stands before a wall beyond r_max may itself be beyond r_max: the last term of eq. (6).",
    )
    yield model(far=np.zeros_like(far)), "r_max is ignored: a wall farther than that is not seen."
    yield (
        model(random=0.0),
        "No floor for outliers: p_random / r_max is left out, and one odd reading rules out the truth.",
    )
    yield model(random=1.0), "A uniform density on [0, r_max] is 1 / r_max: p_random is divided by it."
    whole = -np.expm1(-rate * d)
    yield (
        model(short=short * whole),
        "The short term is not normalised: on [0, d] its density is divided by 1 - e^(-λd).",
    )
    yield (
        model(short=short * whole, early=early * whole),
        "The short term is not normalised: on [0, d] its density is divided by 1 - e^(-λd).",
    )
    yield model(short=short / rate), "The exponential density has its rate λ in front."
    yield (
        model(short=rate * np.exp(-rate * finite) / whole),
        "What stands before the wall is before the wall: the short term is for z ≤ d.",
    )
    yield (
        model(short=rate * np.exp(-rate * finite)),
        "The short term is for z ≤ d, and there divided by 1 - e^(-λd).",
    )
    yield model(short=0.0), "Short readings are left out: p_short."
    yield model(short=0.0, early=0.0), "Short readings are left out: p_short."
    yield model(p_hit=1.0), "The weight of a hit is what the others leave: 1 - p_short - p_miss - p_random."
    yield model(sigma=constants.sigma**2), "σ is a standard deviation: it is squared once too often."
    yield model(half=1.0), "The exponent lacks the half: -½ ((z - d)/σ)²."
    yield model(scale=1 / np.sqrt(2 * np.pi)), "The normal density lacks its factor 1/√(2π)."
    yield (
        model(base=np.exp(-0.5 * ((finite - d) / constants.sigma) ** 2)),
        "The normal density lacks its factor 1/(σ √(2π)): beside other densities it counts.",
    )
    yield (
        model(d=np.minimum(d, r_max)),
        "r_max cuts the distances: a wall beyond it is not at it. Compare the readings with the distances themselves.",
    )
    yield model(d=d[:, ::-1]), "Beams are compared in reverse order."
    if constants.room == OTHER.room:
        name = "The numbers are those of the default constants: read all from `constants`."
        default = Constants()
        yield (
            models.beam_log_likelihood(
                z,
                d,
                default.sigma,
                default.r_max,
                default.p_short,
                default.rate_short,
                default.p_miss,
                default.p_random,
            ),
            name,
        )
