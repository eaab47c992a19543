"""What the checks of the extended Kalman filter's two steps try, and the faults they know by name."""

import numpy as np

from course_lib.angles import wrap
from course_lib.beacon import models, quadrotor
from course_lib.beacon.constants import ANGLES, RATES, VELOCITY, Constants
from grader.assignments.beacon.expect import (
    OTHER,
    checked_covariance,
    entry_of_covariance,
    entry_of_state,
    mean_and_covariance,
    room,
    same,
    spread,
    states,
    units,
)
from grader.lessons import expect


def predict(function):
    """Mean and covariance after one step of flight, of free fall, and of rotors that differ."""
    for constants in (Constants(), OTHER):
        rng = np.random.default_rng(5)
        hover = quadrotor.hover(constants)
        for u, words in [
            (hover * [1.2, 0.9, 0.7, 1.1], "u near hovering"),
            (np.array([0.0, 4.0, 1.0, 5.5]), "rotors that differ"),
            (np.zeros(4), "rotors off: u = 0"),
        ]:
            mean, covariance = states(1, constants, rng)[0], spread(rng, 0.3)
            mean[5] = 3.14
            mean[11] = 1.0
            call = f"predict(mean, covariance, u, constants) {room(constants)}, {words}"
            got_mean, got = mean_and_covariance(function(mean, covariance, u, constants), call)
            same(
                got_mean,
                quadrotor.f(mean, u, constants.Ts, constants),
                call,
                _predicted_means(mean, u, constants),
                entry=entry_of_state,
                angles=ANGLES,
            )
            expected = _predicted(mean, covariance, u, constants)
            same(
                got,
                expected,
                call,
                _predicted_covariances(mean, covariance, u, constants),
                scale=units(expected),
                entry=entry_of_covariance,
            )


def _predicted_means(mean, u, constants):
    yield mean, "The mean stays where it was: it moves by f."
    yield quadrotor.f(mean, u, 1.0, constants), "The step takes constants.Ts seconds, not one."
    yield (
        quadrotor.f(mean, quadrotor.hover(constants), constants.Ts, constants),
        "The thrusts u are not used.",
    )
    yield (
        quadrotor.jacobians(mean, u, constants.Ts, constants)[0] @ mean,
        "F_x is for the covariance: the mean moves by f.",
    )
    if constants != Constants():
        for Ts in (constants.Ts, Constants().Ts):
            yield (
                quadrotor.f(mean, u, Ts, Constants()),
                "The numbers are those of the default constants: hand on `constants`.",
            )


def _predicted(mean, covariance, u, constants, thrust=None, gusts=None, at=None, linear=None):
    """P' = F_x P F_xᵀ + F_u Σ_u F_uᵀ + gusts, or what a fault makes of it."""
    F_x, F_u = quadrotor.jacobians(mean if at is None else at, u, constants.Ts, constants)
    Sigma_u = constants.k * np.abs(u) if thrust is None else thrust
    moved = (linear or (lambda F, P: F @ P @ F.T))(F_x, covariance)
    return moved + (F_u * Sigma_u) @ F_u.T + np.diag(_gusts(constants) if gusts is None else gusts)


def _gusts(constants, power=2, time=1.0, rows=(6, 9)):
    added = np.zeros(12)
    added[rows[0] : rows[0] + 3] = constants.sigma_v**power * constants.Ts**time
    added[rows[1] : rows[1] + 3] += constants.sigma_w**power * constants.Ts**time
    return added


def _predicted_covariances(mean, covariance, u, constants):
    def fault(**change):
        return _predicted(mean, covariance, u, constants, **change)

    gusts, Sigma_u = _gusts(constants), constants.k * np.abs(u)
    only_velocity, only_rates = gusts.copy(), gusts.copy()
    only_velocity[RATES], only_rates[VELOCITY] = 0.0, 0.0
    yield covariance, "The covariance stays what it was: P' = F_x P F_xᵀ + F_u Σ_u F_uᵀ + gusts."
    yield (
        fault(gusts=np.zeros(12)),
        "The gusts are forgotten: Σ_u = k|u| alone vanishes with u and knows no wind, so P collapses.",
    )
    yield fault(thrust=np.zeros(4)), "The rotors' noise F_u Σ_u F_uᵀ is missing."
    yield fault(thrust=np.zeros(4), gusts=np.zeros(12)), "No noise at all is added: P collapses."
    yield fault(thrust=Sigma_u**2), "k|u| is the variance of a thrust: it is squared here, as if a standard deviation."
    yield fault(thrust=np.sqrt(Sigma_u)), "k|u| is the variance of a thrust; this is its root, the standard deviation."
    yield fault(thrust=(constants.k * u) ** 2), "Σ_u has k|u| on its diagonal: k u is squared here."
    yield fault(thrust=constants.k * u**2), "Σ_u has k|u| on its diagonal, not k u²."
    yield fault(thrust=np.full(4, constants.k)), "Σ_u has k|u| on its diagonal, not k."
    yield fault(thrust=Sigma_u * constants.Ts), "F_u is that of the whole step: no further T_s for Σ_u."
    yield (
        fault(gusts=_gusts(constants, time=0)),
        "σ_v and σ_w are per root of a second: a step's gusts have the variance σ² T_s.",
    )
    yield (
        fault(gusts=_gusts(constants, time=2)),
        "A random walk's variance grows with T_s, not with its square: σ² T_s.",
    )
    yield fault(gusts=_gusts(constants, power=1)), "σ_v and σ_w are standard deviations: σ² T_s."
    yield fault(gusts=_gusts(constants, power=1, time=0)), "σ_v and σ_w are standard deviations: σ² T_s."
    yield fault(gusts=only_velocity), "The gusts turn the vehicle, too: σ_w² T_s for the body rates."
    yield fault(gusts=only_rates), "The gusts push the vehicle, too: σ_v² T_s for the velocity."
    yield fault(gusts=_gusts(constants, rows=(0, 3))), "Gusts act on velocity and rates, not on position and attitude."
    yield fault(gusts=_gusts(constants, rows=(9, 6))), "σ_v belongs to the velocity, σ_w to the body rates."
    yield fault(linear=lambda F, P: F.T @ P @ F), "The transposed F_x comes last: F_x P F_xᵀ."
    yield fault(linear=lambda F, P: P), "F_x is missing: P' starts with F_x P F_xᵀ."
    yield (
        fault(at=quadrotor.f(mean, u, constants.Ts, constants)),
        "The Jacobians belong at the mean before the step.",
    )
    if constants != Constants():
        yield fault(gusts=_gusts(Constants())), "σ_v and σ_w are those of the default constants."
        yield fault(thrust=Constants().k * np.abs(u)), "k is that of the default constants."


def update(function):
    """All nine readings, fewer, and readings so sharp that only some forms of the covariance survive."""
    rng = np.random.default_rng(6)
    for m in (9, 4, 1):
        mean, covariance = states(1, Constants(), rng)[0], spread(rng)
        mean[:3], mean[5] = (3.9, -4.2, 1.0), 3.1
        H = models.observation_jacobian(mean, OTHER)[rng.permutation(9)[:m]]
        R = np.diag(rng.uniform(0.002, 0.05, m))
        v = np.sqrt(np.diag(H @ covariance @ H.T + R)) * rng.standard_normal(m)
        for turn in (1.0, -1.0):
            # Once with the innovation's sign that takes the heading over the seam.
            _one_update(function, mean, covariance, turn * v, H, R, f"update(mean, covariance, v, H, R), {m} readings")
    _sharp_update(function)


def _one_update(function, mean, covariance, v, H, R, call):
    got_mean, got = mean_and_covariance(function(mean, covariance, v, H, R), call)
    S = H @ covariance @ H.T + R
    K = np.linalg.solve(S, H @ covariance).T
    expected = mean + K @ v
    with np.errstate(all="ignore"):
        same(
            got_mean,
            expected,
            call,
            _updated_means(mean, covariance, v, H, R, K),
            entry=entry_of_state,
            angles=ANGLES,
        )
        A = np.eye(12) - K @ H
        P = A @ covariance @ A.T + K @ R @ K.T
        faults = [
            (covariance, "The covariance stays what it was: (I - K H) P (I - K H)ᵀ + K R Kᵀ."),
            (A @ covariance @ A.T, "K R Kᵀ is missing: the readings' own noise."),
            ((2 * np.eye(12) - A) @ covariance, "The sign in I - K H."),
            (A.T @ covariance @ A + K @ R @ K.T, "The transposed I - K H comes last."),
            (covariance + K @ S @ K.T, "The sign: a reading takes uncertainty away."),
            (covariance - K @ R @ K.T, "P is reduced by K S Kᵀ, S = H P Hᵀ + R; not by K R Kᵀ."),
            (covariance @ A, "I - K H stands on the left of P."),
            (A, "P is missing: I - K H is no covariance."),
        ]
        same(
            got,
            P,
            call,
            faults,
            scale=units(P),
            entry=entry_of_covariance,
        )
    turned = np.abs(got_mean[list(ANGLES)]) > np.pi + 1e-9
    assert not turned.any(), f"{call}: the angles of the mean are not wrapped to [-π, π): {got_mean[list(ANGLES)]}"


def _updated_means(mean, covariance, v, H, R, K):
    yield mean, "The mean stays what it was: it moves by K v."
    yield mean - K @ v, "The sign: v is observed minus expected, so the mean moves by + K v."
    moved = mean + K @ v
    yield wrap(moved), "Only angles are wrapped: positions may be larger than π."
    PHt = covariance @ H.T
    for S, name in [
        (H @ covariance @ H.T, "R is missing in the innovation's covariance S = H P Hᵀ + R."),
        (R, "H P Hᵀ is missing in the innovation's covariance S = H P Hᵀ + R."),
        (H @ H.T + R, "P is missing in the innovation's covariance S = H P Hᵀ + R."),
        (H @ covariance @ H.T + R @ R, "R holds variances already: it is squared here."),
        (H @ covariance @ H.T + np.sqrt(R), "R holds the variances: this is their root."),
        (H @ covariance @ H.T - R, "The noise adds to the uncertainty: S = H P Hᵀ + R."),
    ]:
        yield lambda S=S: mean + PHt @ (np.linalg.pinv(S) @ v), name
    yield mean + PHt @ v, "S⁻¹ is missing in the gain: K = P Hᵀ S⁻¹."
    yield mean + PHt @ (H @ PHt + R) @ v, "The gain takes the inverse of S: K = P Hᵀ S⁻¹."
    yield lambda: mean + H.T @ np.linalg.solve(H @ PHt + R, v), "P is missing in the gain: K = P Hᵀ S⁻¹."


def _sharp_update(function):
    """Readings ten orders sharper than the state is known: (I - K H) P is rounded to nonsense, Joseph's form not."""
    rng = np.random.default_rng(7)
    for _ in range(5):
        call = "update(mean, covariance, v, H, R) with readings ten orders sharper than the mean"
        value = function(np.zeros(12), spread(rng, 3e4), np.zeros(12), rng.standard_normal((12, 12)), 1e-6 * np.eye(12))
        got = expect.array(value[1], (12, 12), f"{call}: covariance")
        try:
            checked_covariance(got, call)
        except AssertionError as error:
            raise AssertionError(
                "Right on paper, but not in floating-point numbers: take Joseph's form, (I - K H) P (I - K H)ᵀ + "
                f"K R Kᵀ, which stays a covariance, and average it with its transpose.\n{error}"
            ) from None
