"""Edges of a vehicle in the plane that turns and accelerates: what each collision check misses, and what it costs."""

from typing import NamedTuple

import numpy as np

from course_lib.beacon.planning.collisions import march_by_chord, march_by_speed


class Family(NamedTuple):
    """Bounds of uniform draws: turning rate (rad/s), acceleration (m/s²), speed at the start (m/s)."""

    omega: float
    acceleration: float
    speed: float


#: The sheet's agile vehicle, and a gentle one.
AGILE, GENTLE = Family(8.0, 8.0, 2.0), Family(1.0, 1.0, 2.0)
#: In a room of 10 m with so many boxes, redrawn after so many edges; the source's threshold (m).
BOXES, EDGES, D_MIN = 12, 50, 0.01


class Compared(NamedTuple):
    """Counts: edges, colliding ones, those each check missed, and distances asked for."""

    edges: int
    colliding: int
    missed_by_chord: int
    missed_by_speed: int
    checks_by_chord: int
    checks_by_speed: int


def compare(family, edges, rng, d_min=D_MIN, radius=0.0):
    """Run both checks on random edges; a vehicle of no size collides where it is in a box.

    Parameters
    ----------
    family : Family
    edges : int
    rng : numpy.random.Generator
    d_min, radius : float
        Of the source's check and of the vehicle, in metres.

    Returns
    -------
    Compared
    """
    counts = np.zeros(5, dtype=int)
    for edge in range(edges):
        if edge % EDGES == 0:
            middle, half = rng.uniform(-5.0, 5.0, (BOXES, 2)), rng.uniform(0.1, 0.6, (BOXES, 2))
        low, high = middle - half, middle + half

        def gap(places, low=low, high=high):
            beyond = np.maximum(np.maximum(low - places[..., None, :], places[..., None, :] - high), 0.0)
            return np.sqrt((beyond**2).sum(axis=-1)).min(axis=-1)

        start = rng.uniform(-4.8, 4.8, 2)
        while gap(start) <= max(d_min, radius):
            start = rng.uniform(-4.8, 4.8, 2)
        path, duration, fastest = edge_of(family, start, rng)
        truth = np.any(gap(path(np.linspace(0.0, duration, 201))) <= radius)
        chord, by_chord = march_by_chord(path, duration, gap, d_min)
        speed, by_speed = march_by_speed(path, duration, gap, radius, fastest)
        counts += [truth, truth and not chord, truth and not speed, by_chord, by_speed]
    return Compared(edges, *counts.tolist())


def edge_of(family, start, rng):
    """A random edge: position at a time or times, its duration, and the largest speed on it."""
    omega, acceleration = rng.uniform(-1.0, 1.0, 2) * [family.omega, family.acceleration]
    speed, heading, duration = rng.uniform(0.0, family.speed), rng.uniform(-np.pi, np.pi), rng.uniform(0.1, 0.5)

    def path(t):
        # ∫ (v + a s) exp(i (θ + ω s)) ds
        t = np.asarray(t)
        turned = np.exp(1j * omega * t)
        moved = speed * (turned - 1) / (1j * omega)
        moved = moved + acceleration * (t * turned / (1j * omega) + (turned - 1) / omega**2)
        moved = moved * np.exp(1j * heading)
        return start + np.stack([moved.real, moved.imag], axis=-1)

    return path, duration, max(speed, abs(speed + acceleration * duration))
