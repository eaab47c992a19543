"""What checks of exercises have in common: expectations that fail in one readable line."""

import numpy as np

from course_lib.angles import wrap


def array(value, shape, call, kind="f"):
    """The value as an array, after making sure that it is one.

    Parameters
    ----------
    value : object
        What a student's function returned.
    shape : tuple of int
        What it should have.
    call : str
        The call that returned it, as the message names it.
    kind : str
        "f" for finite real numbers, "l" for logarithms (which may be -inf), "i" for integers.

    Returns
    -------
    ndarray

    Raises
    ------
    AssertionError
        It is none, has another shape, or holds what it must not.
    """
    assert value is not None, f"{call} returns None: is there a `return`?"
    try:
        result = np.asarray(value)
    except Exception:
        raise AssertionError(f"{call}: expected an array of shape {shape}, got {type(value).__name__}") from None
    assert result.dtype.kind in "fiub", (
        f"{call}: expected an array of {'integers' if kind == 'i' else 'real numbers'}, got {_called(value, result)}"
    )
    assert result.shape == shape, f"{call}: expected shape {shape}, got {result.shape}"
    if kind == "i":
        assert result.dtype.kind in "iu", f"{call}: expected integers, got dtype {result.dtype}"
        return result
    result = result.astype(float)
    bad = np.isnan(result) if kind == "l" else ~np.isfinite(result)
    assert not bad.any(), f"{call}: {bad.sum()} of {bad.size} values are {result[bad].ravel()[0]}"
    return result


def close(got, expected, call, faults=(), tolerance=1e-9, example=None, angles=False):
    """Fail where two arrays of the same shape differ, naming the fault if it is a known one.

    Parameters
    ----------
    got, expected : ndarray
    call : str
        The call, as the message names it.
    faults : iterable of (ndarray or callable, str)
        What a known fault gives instead (or a function of no arguments that returns it), and its name.
    tolerance : float
        Absolute and relative.
    example : callable, optional
        `example(index) -> str`, the arguments that belong to one element of the first axis.
    angles : bool
        Compare modulo 2π.

    Raises
    ------
    AssertionError
        With the fault's name, what was expected and what was got.
    """
    if _agree(got, expected, tolerance, angles):
        return
    with np.errstate(invalid="ignore"):
        apart = np.abs(wrap(got - expected) if angles else got - expected)
    apart = np.where(np.isnan(apart), np.where(got == expected, 0.0, np.inf), apart)
    worst = np.unravel_index(np.argmax(apart), apart.shape)
    tried = f"{call}{': ' + example(worst[0]) if example and worst else ''}"
    message = f"{tried}\nexpected {expected[worst]:.6g}, got {got[worst]:.6g}"
    for wrong, name in faults:
        if _agree(got, wrong() if callable(wrong) else wrong, tolerance, angles):
            message = f"{name}\n{message}"
            break
    raise AssertionError(message)


def repeats(call, words):
    """Fail unless `call(rng)` gives the same for generators of the same seed."""
    first, second = (np.asarray(call(np.random.default_rng(8))) for _ in range(2))
    assert np.array_equal(first, second, equal_nan=True), (
        f"{words} gives different results for two generators of the same seed: draw from `rng` and nothing else"
    )


def _agree(a, b, tolerance, angles):
    if angles:
        return np.allclose(wrap(a - b), 0.0, atol=tolerance)
    return np.allclose(a, b, rtol=tolerance, atol=tolerance, equal_nan=True)


def _called(value, result):
    return f"dtype {result.dtype}" if isinstance(value, np.ndarray) else type(value).__name__
