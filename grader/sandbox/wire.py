"""The language between host and worker: frames of float64 arrays and of text. Nothing else is ever understood.

A frame is an eight-byte header (magic `bay`, kind, payload length as uint32) and its payload. A text frame holds UTF-8.
An arrays frame holds eight-byte little-endian words: the number of arrays, then for each its number of dimensions,
its dimensions and its float64 data; everything stays aligned, so that decoding makes views and copies nothing.
"""

import math
import struct

import numpy as np

from course_lib.filters import Gaussian, Particles, Step

ARRAYS, TEXT = 1, 2

_HEADER = struct.Struct("<3sBI")
_MAGIC = b"bay"
HEADER_BYTES = _HEADER.size

MAX_ARRAYS = 10_000
MAX_DIMENSIONS = 4

_BARE, _PARTICLES, _GAUSSIAN = 0, 1, 2


class WireError(ValueError):
    """These bytes are not a frame, or not the frame that was due."""


def encode_header(kind, length):
    """The eight bytes before a payload of `length` bytes."""
    if length >= 2**32:
        raise WireError(f"a frame holds less than 4 GiB, got {length} bytes")
    return _HEADER.pack(_MAGIC, kind, length)


def decode_header(data, caps):
    """Kind and payload length of the frame that begins with these eight bytes.

    Parameters
    ----------
    data : bytes-like, 8 bytes
    caps : dict of int to int
        The kinds that may arrive, and the most bytes each may hold.

    Raises
    ------
    WireError
        Not a header, a kind that is not due, or a payload over its cap: nothing has been allocated for it.
    """
    if len(data) != HEADER_BYTES:
        raise WireError(f"a header has {HEADER_BYTES} bytes, got {len(data)}")
    magic, kind, length = _HEADER.unpack(data)
    if magic != _MAGIC:
        raise WireError("bytes that are not a frame")
    if kind not in caps:
        raise WireError(f"a frame of kind {kind} is not due here")
    if length > caps[kind]:
        raise WireError(f"a frame of {length} bytes, over the cap of {caps[kind]}")
    return kind, length


def encode_text(text):
    """A text frame, as a list of buffers to write one after the other."""
    payload = text.encode("utf-8", "replace")
    return [encode_header(TEXT, len(payload)), payload]


def decode_text(payload):
    """The text of a text frame's payload."""
    try:
        return bytes(payload).decode("utf-8")
    except UnicodeDecodeError as error:
        raise WireError("text that is not UTF-8") from error


def encode_arrays(arrays):
    """An arrays frame, as a list of buffers to write one after the other; contiguous float64 data is not copied.

    Parameters
    ----------
    arrays : list of array_like
        Real numbers, at most `MAX_DIMENSIONS` dimensions each.
    """
    buffers = [struct.pack("<Q", len(arrays))]
    for array in arrays:
        array = np.asarray(array, dtype="<f8", order="C")
        buffers.append(struct.pack(f"<{1 + array.ndim}Q", array.ndim, *array.shape))
        if array.size:
            buffers.append(memoryview(array.reshape(-1)).cast("B"))
    return [encode_header(ARRAYS, sum(len(buffer) for buffer in buffers)), *buffers]


def decode_arrays(payload):
    """The arrays of an arrays frame's payload, as views of it.

    Parameters
    ----------
    payload : bytes-like

    Returns
    -------
    list of ndarray

    Raises
    ------
    WireError
        Anything but what `encode_arrays` writes.
    """
    if len(payload) % 8:
        raise WireError(f"{len(payload)} bytes, which are no whole words")
    words, numbers = np.frombuffer(payload, "<u8"), np.frombuffer(payload, "<f8")
    position = 0

    def take(count):
        nonlocal position
        position += count
        if position > len(words):
            raise WireError("a frame shorter than it says")
        return slice(position - count, position)

    count = int(words[take(1)][0])
    if count > MAX_ARRAYS:
        raise WireError(f"{count} arrays, at most {MAX_ARRAYS} may be")
    arrays = []
    for _ in range(count):
        dimensions = int(words[take(1)][0])
        if dimensions > MAX_DIMENSIONS:
            raise WireError(f"an array of {dimensions} dimensions, at most {MAX_DIMENSIONS} may be")
        shape = [int(extent) for extent in words[take(dimensions)]]
        # An empty array needs no data, whatever its other extents claim: numpy could not even address these.
        if math.prod(max(extent, 1) for extent in shape) > 2**48:
            raise WireError("an array larger than any memory")
        arrays.append(numbers[take(math.prod(shape))].reshape(shape))
    if position != len(words):
        raise WireError("a frame longer than it says")
    return arrays


def after(buffers, count):
    """What is left of buffers (memoryviews of bytes) when their first `count` bytes have been written."""
    for index, buffer in enumerate(buffers):
        if count < len(buffer):
            return [buffer[count:], *buffers[index + 1 :]]
        count -= len(buffer)
    return []


def encode_posterior(token, returned):
    """The frame that answers a step.

    Parameters
    ----------
    token : float
        Of the request that is answered.
    returned : object
        What an `Estimator` returned. Of a `Step` only the posterior is sent.

    Raises
    ------
    TypeError
        It is no posterior; the message says what it is, for the student.
    """
    posterior = returned.posterior if isinstance(returned, Step) else returned
    several = isinstance(posterior, list)
    codes, arrays = [token, float(several)], []
    for target in posterior if several else [posterior]:
        if isinstance(target, Particles):
            codes.append(_PARTICLES)
            arrays += [_floats(target.states, "the states"), _floats(target.log_weights, "the log-weights")]
        elif isinstance(target, Gaussian):
            codes.append(_GAUSSIAN)
            arrays += [_floats(target.mean, "the mean"), _floats(target.covariance, "the covariance")]
        elif isinstance(target, np.ndarray):
            codes.append(_BARE)
            arrays.append(_floats(target, "the particles"))
        else:
            got = "None (is a return missing?)" if target is None else f"a {type(target).__name__}"
            raise TypeError(f"expected Particles, an (N, d) array, a Gaussian or a list of these, got {got}")
    return encode_arrays([np.array(codes), *arrays])


def decode_posterior(arrays):
    """What `encode_posterior` put into a frame.

    Returns
    -------
    token : float
    posterior : Particles, Gaussian, ndarray or list of these
        Of any shape and any values: nothing but its form has been checked.

    Raises
    ------
    WireError
        It is not a posterior's frame.
    """
    if not arrays or arrays[0].ndim != 1 or len(arrays[0]) < 2:
        raise WireError("a posterior without its codes")
    token, several, *kinds = arrays[0].tolist()
    rest = iter(arrays[1:])
    records = {_BARE: lambda array: array, _PARTICLES: Particles, _GAUSSIAN: Gaussian}
    targets = []
    for kind in kinds:
        if kind not in records:
            raise WireError(f"a target of unknown kind {kind}")
        parts = [next(rest, None) for _ in range(1 if kind == _BARE else 2)]
        if any(part is None for part in parts):
            raise WireError("a posterior with a part missing")
        targets.append(records[kind](*parts))
    if next(rest, None) is not None:
        raise WireError("a posterior with a part too many")
    if several not in (0.0, 1.0) or (not several and len(targets) != 1):
        raise WireError("neither one target nor a list of them")
    return token, targets if several else targets[0]


def encode_action(token, returned):
    """The frame that answers a planner's step; parameters as in `encode_posterior`.

    Raises
    ------
    TypeError
        It is no array of numbers.
    """
    action = returned.posterior if isinstance(returned, Step) else returned
    if action is None:
        raise TypeError("expected an array of numbers, got None (is a return missing?)")
    return encode_arrays([np.array([token]), _floats(action, "the action")])


def decode_action(arrays):
    """What `encode_action` put into a frame.

    Returns
    -------
    token : float
    action : ndarray
        Of any shape and any values.

    Raises
    ------
    WireError
        It is not an action's frame.
    """
    if len(arrays) != 2 or arrays[0].shape != (1,):
        raise WireError("a frame of another kind")
    return float(arrays[0][0]), arrays[1]


def _floats(value, what):
    array = np.asarray(value)
    if array.dtype.kind not in "fiub":
        raise TypeError(f"{what} must be an array of real numbers, got dtype {array.dtype}")
    return np.asarray(array, dtype="<f8", order="C")
