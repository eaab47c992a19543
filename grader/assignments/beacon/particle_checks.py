"""What the checks of the particle filter's two pieces try, the likelihood and the regularised resampling.

The second is statistical: it draws from fixed seeds and fails a right function with a probability of at most 1e-8.
"""

import warnings

import numpy as np

from course_lib.angles import wrap
from course_lib.beacon import models
from course_lib.beacon.constants import ANGLES, BEARINGS, MEASURED, Constants
from course_lib.filters import Particles, covariance, mean
from grader.assignments.beacon.expect import OTHER, READINGS, STATE, room, spread, states
from grader.lessons import expect


def log_likelihood(function):
    """Reading by reading and all together, near the seam of the bearings and with readings missing."""
    n = 200
    for constants in (Constants(), OTHER):
        rng = np.random.default_rng(8)
        truth = states(1, constants, rng)
        truth[0, 5] = wrap(np.arctan2(-1.0, -1.0) + 2.9)
        cloud = truth + 0.2 * rng.standard_normal((n, 12))
        predicted = models.observe(truth, constants)[0]
        full = predicted + constants.sigma_z * rng.standard_normal(MEASURED)
        full[BEARINGS] = wrap(full[BEARINGS])
        full = np.append(full, [1.0, 0.3])
        masks = [np.arange(11) == i for i in range(MEASURED)] + [np.arange(11) % 4 != 1, np.ones(11, dtype=bool)]
        for there in [*masks, np.zeros(11, dtype=bool)]:
            observation = np.where(there, full, np.inf)
            names = [READINGS[i] for i in np.flatnonzero(there[:MEASURED])]
            call = (
                f"log_likelihood(observation of {', '.join(names) or 'nothing'}, states, constants) {room(constants)}"
            )
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                got = function(observation, cloud, constants)
            expected = models.log_likelihood(observation, cloud, constants)
            if isinstance(got, np.ndarray) and got.shape == (n,) and not np.isfinite(got.astype(float)).any():
                raise AssertionError(
                    "A missing reading (inf) is computed with: it says nothing, so leave it out of the sum.\n"
                    f"{call}: got {got[0]}"
                )
            got = expect.array(got, (n,), call, kind="l")
            with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
                expect.close(got, expected, call, _likelihood_faults(observation, cloud, constants))


def _likelihood_faults(observation, cloud, constants):
    there = np.isfinite(observation[:MEASURED])
    predicted = models.observe(cloud, constants)
    v = models.innovation(observation, predicted)[:, there]
    loose = (observation[:MEASURED] - predicted)[:, there]
    sigma, count = constants.sigma_z[there], there.sum()
    constant = -np.log(sigma).sum() - 0.5 * count * np.log(2 * np.pi)

    def quadratic(v, variance, half=0.5):
        return -half * (v**2 / variance).sum(axis=1)

    right = quadratic(v, sigma**2)
    yield (
        right,
        ("Right but for the constant -Σ log σᵢ - (n/2) log 2π: weights can do without it, but the evidence needs it."),
    )
    for added in (constant, 0.0):
        # Without its constant too: each fault is told before the constant is.
        yield quadratic(v, sigma**2, 1.0) + added, "The exponent lacks the half: -½ vᵀ R⁻¹ v."
        yield quadratic(loose, sigma**2) + added, "The bearings' differences are not wrapped: use your `innovation`."
        yield quadratic(wrap(v), sigma**2) + added, "Only bearings are wrapped."
        yield quadratic(v, sigma) + added, "σ is a standard deviation: divide by its square."
        yield quadratic(v, sigma**4) + added, "This divides by σ⁴: σ² is the variance."
        yield quadratic(v, 1.0) + added, "Each reading's difference is measured in its own σ."
        yield -right + added, "The sign: a larger innovation is less likely."
    yield right - np.log(sigma).sum(), "The factor (2π)^(-n/2) of the density is missing."
    yield right + constant + np.log(sigma).sum(), "The factor 1/σ of each density is missing."
    yield right + constant - np.log(sigma).sum(), "The density has 1/σ in front, not 1/σ²."
    yield np.exp(right + constant), "This is the likelihood: return its logarithm."
    yield np.log10(np.exp(1)) * (right + constant), "This is the logarithm to base 10: use np.log."
    if count:
        norm = np.sqrt((sigma**2).sum())
        yield (
            -(v**2).sum(axis=1) / norm,
            "This is the source's weight: its exponent is in metres. Divide each v by its σ.",
        )
        yield (right + constant) / count, "Independent readings: add their logarithms, do not average."
    degrees = v.copy()
    degrees[:, np.flatnonzero(there) // 4 == 1] *= 180 / np.pi
    yield quadratic(degrees, sigma**2) + constant, "Bearings and σ_α are in radians."
    if constants != Constants():
        yield (
            models.log_likelihood(observation, cloud, Constants()),
            "The numbers are those of the default constants: read all from `constants`.",
        )


#: Particles of the next check, and how far what it measures of them may be off, in units of the posterior's covariance:
#: seven standard deviations, which are 0.027 after multinomial resampling and 0.015 after systematic.
COUNT = 6000
ROOM_FOR_CHANCE = 0.19
#: The same of the kurtosis of nine two-valued columns: it is 0.005 after the right jitter and 0.02 when all is jitter.
PEAKED_FOR_CHANCE = 0.14


def regularise(function):
    """A cloud of two-valued columns: what of its spread is kept and what is jitter can be told apart afterwards."""
    cloud, log_weights, root, corners = _two_valued_cloud()
    call = f"regularise(states {cloud.shape}, log_weights, rng)"
    got = expect.array(function(cloud, log_weights, np.random.default_rng(10)), cloud.shape, call)
    different = len(np.unique(got, axis=0))
    assert different > 0.99 * COUNT, (
        f"Copies stay copies: resample first, then give each particle jitter of its own.\n{call}: {different} "
        f"different states among {COUNT}"
    )
    particles = Particles(cloud, log_weights)
    centre, C = mean(particles, ANGLES), covariance(particles, ANGLES)
    L = np.linalg.cholesky(C)
    off = got - centre
    off[:, ANGLES] = wrap(off[:, ANGLES])
    white = np.linalg.solve(L, np.linalg.solve(L, np.cov(off.T)).T)
    _circle(off, C, call)
    turned = np.abs(got[:, ANGLES]) > np.pi + 1e-9
    assert not turned.any(), f"{call}: angles are not wrapped to [-π, π): {got[:, ANGLES][turned][0]:.4f}"
    _centred(np.linalg.solve(L, off.mean(axis=0)), np.sqrt(np.diag(white).max()), L, cloud, centre, call)
    # Along a two-valued column the kurtosis of b (±1) + s ε gives s² / (b² + s²).
    along = np.linalg.solve(root, off.T)[corners]
    along -= along.mean(axis=1, keepdims=True)
    variance = (along**2).mean(axis=1)
    kurtosis = float(((along**4).mean(axis=1) / variance**2).mean())
    _jittered(white, kurtosis, C, L, root, corners, cloud, call)
    expect.repeats(lambda rng: function(cloud, log_weights, rng), "regularise")
    _collapsed(function, cloud)


def _two_valued_cloud():
    """States at the corners of a parallelepiped across θ = ±π, weights of half the sample's worth, its root."""
    rng = np.random.default_rng(9)
    root = np.linalg.cholesky(spread(rng))
    corner = rng.choice([-1.0, 1.0], (COUNT, 12))
    log_weights = corner[:, 0] + 0.5 * corner[:, 1] * corner[:, 2]
    log_weights[::10] = -np.inf
    cloud = np.array([1.0, -2.0, 2.0, 0.0, 0.0, np.pi, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0]) + corner @ root.T
    # Particles without weight are elsewhere.
    cloud[::10, :3] += 2.0
    cloud[:, ANGLES] = wrap(cloud[:, ANGLES])
    return cloud, log_weights - np.log(np.exp(log_weights).sum()), root, np.arange(3, 12)


def _circle(off, C, call):
    """Fail where headings on both sides of ±π were averaged as numbers."""
    spread_of_yaw = np.sqrt((off[:, 5] ** 2).mean())
    assert spread_of_yaw < 1.0, (
        "θ is averaged as a number: the mean of headings is a direction (course_lib.filters.mean(particles, ANGLES)), "
        f"and differences from it are wrapped.\n{call}, θ on both sides of ±π: spread of θ: expected "
        f"{np.sqrt(C[5, 5]):.3f}, got {spread_of_yaw:.3f}"
    )


def _centred(apart, size, L, cloud, centre, call):
    """Fail where the weighted mean has moved: by `apart`, in standard deviations, of which the result has `size`."""
    chance = ROOM_FOR_CHANCE * max(size, 1.0)
    if np.abs(apart).max() < chance:
        return
    unweighted = mean(Particles(cloud, np.full(COUNT, -np.log(COUNT))), ANGLES) - centre
    unweighted[list(ANGLES)] = wrap(unweighted[list(ANGLES)])
    unweighted = np.linalg.solve(L, unweighted)
    shrink = np.sqrt(1 - _h(12) ** 2)
    reason = "The mean has moved: offspring are not in proportion to the weights, or what is shrunk is not x - m."
    for share, name in [
        (1.0, "log_weights are not used: resample by them."),
        (shrink, "log_weights are not used: resample by them."),
        (1 - shrink, "The mean m is that of the cloud without its weights."),
    ]:
        if np.abs(apart - share * unweighted).max() < chance / 2:
            reason = name
    i = np.argmax(np.abs(apart))
    moved = L @ apart
    raise AssertionError(
        f"{reason}\n{call}: mean of {STATE[i]}: expected {centre[i]:.4f}, got {centre[i] + moved[i]:.4f}"
    )


def _h(d):
    return (4 / (COUNT * (d + 2))) ** (1 / (d + 4))


def _jittered(white, kurtosis, C, L, root, corners, cloud, call):
    """Compare covariance and share of the jitter with those of the right kernel, then with those of faulty ones."""
    n, d = COUNT, 12
    h = _h(d)
    kept, diagonal = 1 - h**2, np.diag(np.diag(C))
    unweighted = covariance(Particles(cloud, np.full(n, -np.log(n))), ANGLES)

    def unlike(shrink, kernel):
        """How unlike the result is to a spread scaled by `shrink` and jitter of covariance `kernel`; to 1 is chance."""
        whole = shrink * C + kernel
        there = np.linalg.solve(L, np.linalg.solve(L, whole).T)
        total, part = (np.diag(np.linalg.solve(root, np.linalg.solve(root, M).T))[corners] for M in (whole, kernel))
        # A sum of a two-valued number and a normal one of this share of the variance.
        peaked = np.mean(3 - 2 * (1 - part / total) ** 2)
        chance = ROOM_FOR_CHANCE * max(1.0, np.abs(there).max())
        return max(np.abs(white - there).max() / chance, abs(kurtosis - peaked) / PEAKED_FOR_CHANCE)

    if unlike(kept, h**2 * C) < 1:
        return
    after = L @ white @ L.T
    jitter = 1.0 - np.sqrt(max(3.0 - kurtosis, 0.0) / 2.0)
    grown = np.mean(np.diag(after) / np.diag(C))
    table = (
        f"{call}\nvariance after over variance before: expected 1.00, got {grown:.2f}\n"
        f"share of the jitter in it: expected h² = {h**2:.2f}, got {jitter:.2f}"
    )
    faults = [
        (1.0, h**2 * C, "The shrinkage is forgotten: with x + h L ε the covariance grows at every resampling, by h²."),
        (kept, h**2 * diagonal, "The jitter has only the diagonal of the covariance: the correlations are lost."),
        (1.0, h**2 * diagonal, "The jitter has only the diagonal of the covariance, and the shrinkage is forgotten."),
        (kept, h**2 * L.T @ L, "L is transposed: the rows of ε are multiplied by Lᵀ from the right."),
        (1.0, h**2 * L.T @ L, "L is transposed, and the shrinkage is forgotten."),
        (kept, h**2 * np.eye(d), "L is missing: h L ε."),
        (kept, h**2 * C @ C, "The jitter is h L ε with L Lᵀ = C: it is multiplied by C itself."),
        (kept, h**2 * unweighted, "The covariance is that of the cloud without its weights."),
        (
            1.0,
            h**2 * unweighted,
            "The covariance is that of the cloud without its weights; and shrinkage is forgotten.",
        ),
        (kept**2, h**2 * C, "The shrinkage is the root √(1 - h²), not 1 - h²."),
        ((1 - h) ** 2, h**2 * C, "The shrinkage is √(1 - h²), not 1 - h."),
        (kept, h**4 * C, "h is squared in the jitter: h L ε."),
        (kept, h * C, "The jitter's standard deviation is h, not √h."),
        (1 - h, h * C, "The jitter's standard deviation is h, not √h."),
        (1.0, C, "The factor h is missing: h L ε."),
        (kept, C, "The factor h is missing: h L ε."),
        (0.0, C, "This draws from one normal distribution: keep the particles, and shake them."),
        (kept, 0 * C, "The cloud is shrunk and not shaken: h L ε is missing."),
    ]
    likeness, name = min((unlike(shrink, kernel), name) for shrink, kernel, name in faults)
    if likeness < 1:
        raise AssertionError(f"{name}\n{table}")
    if np.abs(white - np.eye(d)).max() < ROOM_FOR_CHANCE:
        raise AssertionError(f"The size of h: (4 / (N (d + 2)))^(1 / (d + 4)) with d = 12.\n{table}")
    i, j = np.unravel_index(np.argmax(np.abs(white - np.eye(d))), (d, d))
    raise AssertionError(
        f"{table}\ncovariance of {STATE[i]} and {STATE[j]}: expected {C[i, j]:.4g}, got {after[i, j]:.4g}"
    )


def _collapsed(function, cloud):
    """One particle has all the weight: the covariance is zero and has no Cholesky factor."""
    log_weights = np.full(COUNT, -np.inf)
    log_weights[7] = 0.0
    call = "regularise where one particle has all the weight"
    try:
        got = function(cloud, log_weights, np.random.default_rng(11))
    except BaseException as error:
        if isinstance(error.__cause__, np.linalg.LinAlgError):
            raise AssertionError(
                f"{call}: the covariance is zero there, and np.linalg.cholesky wants a positive one: add 1e-12 to its "
                "diagonal"
            ) from None
        raise
    got = expect.array(got, cloud.shape, call)
    apart = got - cloud[7]
    apart[:, ANGLES] = wrap(apart[:, ANGLES])
    assert np.abs(apart).max() < 1e-2, f"{call}: expected copies of it, got one that is {np.abs(apart).max():.3g} away"
