"""Records check what they are given."""

import numpy as np


def check_ranges(record, **ranges):
    """Check attributes of a record, each against a closed interval.

    Parameters
    ----------
    record : object
    ranges : dict of str to (float, float)
        Attribute name to its least and largest value.

    Raises
    ------
    ValueError
        A value is not finite or lies outside.
    """
    for name, (low, high) in ranges.items():
        value = getattr(record, name)
        if not (low <= value <= high and np.isfinite(value)):
            raise ValueError(f"{name} = {value} must be finite and within [{low:.9g}, {high:.9g}]")
