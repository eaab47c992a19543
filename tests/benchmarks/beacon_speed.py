"""Updates per second of the quadrotor's filters, beside filterpy's plain use and a loop over the particles."""

import math
import time

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from rich.progress import track
from rich.table import Table

from course_lib.angles import wrap
from course_lib.beacon import ekf, models, particle_filter, reference
from course_lib.beacon.constants import ANGLES, BEARINGS, MEASURED, Constants
from course_lib.beacon.world import World
from course_lib.filters import equally_weighted
from course_lib.recording import replay
from tests.course_lib.beacon import twins

#: Particles of the filter with arrays and of the one without, the steps that this takes, and those of filterpy.
COUNT, FEW, STEPS, PLAIN_STEPS = 5000, 100, 20, 60


def beacon_speed(console, runs):
    """CPU time per update of both references and of what one writes first, on the same recorded runs."""
    constants = Constants()
    recorded = [World(constants).simulate(np.random.default_rng([1, i])) for i in range(runs)]
    single = _updates(_kalman, recorded, constants, "Kalman filter")
    both = _updates(reference.Estimator, recorded, constants, "reference")
    plain = _plain_filterpy(recorded[0], constants)
    table = Table("filter", "CPU per update", "updates per second", "ratio", title="Extended Kalman filters")
    for name, seconds in (
        ("ekf.raw_step: filterpy's filter, compiled models", single),
        ("the assignment's reference: with and without biases", both),
        ("filterpy's plain use: models in NumPy, F by differences", plain),
    ):
        table.add_row(name, _ms(seconds), f"{1 / seconds:,.0f}", f"{seconds / single:.1f}")
    console.print(table)
    cloud = _updates(_cloud, recorded, constants, f"{COUNT} particles")
    both = _updates(reference.ParticleEstimator, recorded, constants, "reference")
    loop = _timed(lambda: _loop_filter(recorded[0], constants, np.random.default_rng(4))) / STEPS
    table = Table(
        "filter", "CPU per update", "updates per second", "ratio per particle and update", title="Particle filters"
    )
    for name, seconds, count in (
        (f"particle_filter.step, {COUNT} particles", cloud, COUNT),
        (f"the assignment's reference, {reference.COUNT} particles", both, reference.COUNT),
        (f"Python loop over {FEW} particles, not regularised", loop, FEW),
    ):
        table.add_row(name, _ms(seconds), f"{1 / seconds:,.0f}", f"{seconds / count / (cloud / COUNT):.1f}")
    console.print(table)


def _kalman(previous, observation, control, constants, rng):
    return models.prior(constants) if previous is None else ekf.raw_step(previous, observation, control, constants)[0]


def _cloud(previous, observation, control, constants, rng):
    if previous is None:
        return equally_weighted(models.sample_prior(COUNT, constants, rng))
    return particle_filter.step(previous, observation, control, constants, rng)[0]


def _updates(estimator, recorded, constants, words):
    """CPU seconds per update; the first call is not counted."""
    used = 0.0
    for run in track(recorded, f"{words}, CPU per update"):
        posteriors = replay(estimator, run, constants, np.random.default_rng(2))
        next(posteriors)
        used += _timed(lambda posteriors=posteriors: [None for _ in posteriors])
    return used / sum(run.steps for run in recorded)


def _timed(function):
    start = time.process_time()
    function()
    return time.process_time() - start


def _ms(seconds):
    return f"{1e3 * seconds:.3f} ms"


def _plain_filterpy(run, constants):
    """CPU seconds per update of the filter as filterpy's documentation has one write it."""

    class Quadrotor(ExtendedKalmanFilter):
        def predict_x(self, u=0):
            self.x = twins.f(self.x, u, constants.Ts, constants)

    def differences(function, point, step=1e-6):
        base = function(point)
        return np.array([(function(point + step * axis) - base) / step for axis in np.eye(len(point))]).T

    def residual(a, b):
        v = np.where(np.isfinite(a), a - b, 0.0)
        v[BEARINGS] = wrap(v[BEARINGS])
        return v

    kf = Quadrotor(12, MEASURED)
    kf.x, kf.P = models.prior(constants)
    start = time.process_time()
    for observation, u in zip(run.observations[:PLAIN_STEPS, :MEASURED], run.controls, strict=False):
        kf.F = differences(lambda x, u=u: twins.f(x, u, constants.Ts, constants), kf.x)
        F_u = differences(lambda v: twins.f(kf.x, v, constants.Ts, constants), u)
        kf.Q = models.process_covariance(F_u, u, constants)
        kf.predict(u)
        # A missing reading says nothing: it is as uncertain as can be.
        R = np.diag(np.where(np.isfinite(observation), constants.sigma_z**2, 1e12))
        kf.update(
            observation,
            lambda x: models.observation_jacobian(x, constants),
            lambda x: twins.observe(x, constants),
            R,
            residual=residual,
        )
        kf.x[list(ANGLES)] = wrap(kf.x[list(ANGLES)])
    return (time.process_time() - start) / PLAIN_STEPS


def _loop_filter(run, constants, rng):
    """The bootstrap filter as one writes it first: a Python loop over the particles."""
    particles = models.sample_prior(FEW, constants, rng).tolist()
    beacons, sigma = constants.beacons.tolist(), constants.sigma_z.tolist()
    for observation, control in zip(run.observations[:STEPS].tolist(), run.controls[:STEPS].tolist(), strict=True):
        weights = []
        for i, particle in enumerate(particles):
            thrusts = [u + math.sqrt(constants.k * abs(u)) * rng.standard_normal() for u in control]
            particle = _moved(particle, thrusts, constants)
            for column in range(6, 12):
                gust = constants.sigma_v if column < 9 else constants.sigma_w
                particle[column] += gust * math.sqrt(constants.Ts) * rng.standard_normal()
            particles[i] = particle
            weights.append(_likelihood_of_one(particle, observation, beacons, sigma))
        total = sum(weights)
        if total > 0.0:
            chosen = rng.choice(FEW, FEW, p=[weight / total for weight in weights])
            particles = [list(particles[i]) for i in chosen]


def _moved(state, u, constants):
    h = constants.Ts

    def along(slope, part):
        return [a + part * b for a, b in zip(state, slope, strict=True)]

    k1 = _slope(state, u, constants)
    k2 = _slope(along(k1, h / 2), u, constants)
    k3 = _slope(along(k2, h / 2), u, constants)
    k4 = _slope(along(k3, h), u, constants)
    return [x + h / 6 * (a + 2 * b + 2 * c + d) for x, a, b, c, d in zip(state, k1, k2, k3, k4, strict=True)]


def _slope(state, u, c):
    roll, pitch, yaw = state[3:6]
    p, q, r = state[9:12]
    j_x, j_y, j_z = c.inertia
    turn = (q * math.sin(roll) + r * math.cos(roll)) / math.cos(pitch)
    lift = sum(u) / c.mass
    return [
        *state[6:9],
        p + math.sin(pitch) * turn,
        q * math.cos(roll) - r * math.sin(roll),
        turn,
        lift * (math.cos(yaw) * math.sin(pitch) * math.cos(roll) + math.sin(yaw) * math.sin(roll))
        - c.drag / c.mass * state[6],
        lift * (math.sin(yaw) * math.sin(pitch) * math.cos(roll) - math.cos(yaw) * math.sin(roll))
        - c.drag / c.mass * state[7],
        lift * math.cos(pitch) * math.cos(roll) - c.g - c.drag / c.mass * state[8],
        (c.arm * (u[1] - u[3]) + (j_y - j_z) * q * r) / j_x,
        (c.arm * (u[2] - u[0]) + (j_z - j_x) * r * p) / j_y,
        (c.torque_ratio * (u[0] - u[1] + u[2] - u[3]) + (j_x - j_y) * p * q) / j_z,
    ]


def _likelihood_of_one(state, observation, beacons, sigma):
    x, y, z, yaw = *state[:3], state[5]
    exponent = ((observation[8] - z) / sigma[8]) ** 2
    for i, (bx, by, bz) in enumerate(beacons):
        if math.isfinite(observation[i]):
            exponent += ((observation[i] - math.dist((bx, by, bz), (x, y, z))) / sigma[i]) ** 2
        if math.isfinite(observation[4 + i]):
            v = observation[4 + i] - (math.atan2(by - y, bx - x) - yaw)
            exponent += ((v + math.pi) % (2 * math.pi) - math.pi) ** 2 / sigma[4 + i] ** 2
    return math.exp(-0.5 * exponent)
