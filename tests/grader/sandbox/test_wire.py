"""Frames: what goes in comes out, and garbage raises WireError and nothing else."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from course_lib.filters import Gaussian, Particles, Step
from grader.sandbox import wire

CAPS = {wire.ARRAYS: 1 << 20, wire.TEXT: 1 << 10}
#: Nothing is timed, and every run has the same examples.
few = settings(deadline=None, derandomize=True, max_examples=40)
many = settings(few, max_examples=150)
float_arrays = arrays(np.float64, array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=4))


def joined(buffers):
    return b"".join(bytes(buffer) for buffer in buffers)


def decoded(buffers):
    frame = joined(buffers)
    kind, length = wire.decode_header(frame[: wire.HEADER_BYTES], CAPS)
    assert kind == wire.ARRAYS and length == len(frame) - wire.HEADER_BYTES
    return wire.decode_arrays(frame[wire.HEADER_BYTES :])


@few
@given(st.lists(float_arrays, max_size=5))
def test_arrays_come_out_as_they_went_in_nan_included(sent):
    received = decoded(wire.encode_arrays(sent))
    assert len(received) == len(sent)
    for a, b in zip(sent, received, strict=True):
        assert a.shape == b.shape and a.tobytes() == b.tobytes() and b.dtype == np.float64


@few
@given(st.text(max_size=50))
def test_text_comes_out_as_it_went_in(text):
    header, payload = wire.encode_text(text)
    assert wire.decode_header(header, CAPS) == (wire.TEXT, len(payload))
    if text.isprintable():
        assert wire.decode_text(payload) == text


@few
@given(st.integers(0, 200), st.lists(st.integers(1, 50), max_size=8))
def test_partial_writes_resume_where_they_stopped(count, lengths):
    data = [bytes([index]) * length for index, length in enumerate(lengths)]
    left = wire.after([memoryview(piece) for piece in data], count)
    assert joined(left) == b"".join(data)[count:]


def accepts_or_refuses(payload):
    """Decoded, garbage is a list of arrays no larger than itself; or else a WireError."""
    try:
        result = wire.decode_arrays(payload)
    except wire.WireError:
        return
    assert sum(array.nbytes for array in result) <= len(payload)
    try:
        wire.decode_posterior(result)
    except wire.WireError:
        pass


@many
@given(st.binary(max_size=200))
def test_garbage_is_refused(payload):
    accepts_or_refuses(payload)
    try:
        wire.decode_header(payload, CAPS)
    except wire.WireError:
        pass


@many
@given(st.lists(st.one_of(st.integers(0, 5), st.integers(0, 2**64 - 1)), max_size=12))
def test_words_that_claim_anything_are_refused(words):
    accepts_or_refuses(np.array(words, dtype="<u8").tobytes())


@few
@given(st.lists(float_arrays, min_size=1, max_size=3), st.data())
def test_a_frame_with_one_byte_changed_is_read_or_refused(sent, data):
    payload = bytearray(joined(wire.encode_arrays(sent)[1:]))
    payload[data.draw(st.integers(0, len(payload) - 1))] = data.draw(st.integers(0, 255))
    accepts_or_refuses(payload)


@pytest.mark.parametrize("claim", [2**20 + 1, 2**32 - 1])
def test_a_claim_over_the_cap_is_refused_at_the_header(claim):
    with pytest.raises(wire.WireError, match="over the cap"):
        wire.decode_header(wire.encode_header(wire.ARRAYS, claim), CAPS)


def test_an_empty_array_cannot_hide_a_huge_extent():
    words = [1, 2, 0, 2**62]
    with pytest.raises(wire.WireError, match="larger than any memory"):
        wire.decode_arrays(np.array(words, dtype="<u8").tobytes())


def same(a, b):
    assert type(a) is type(b)
    if isinstance(a, list):
        assert len(a) == len(b)
    elif isinstance(a, np.ndarray):
        return np.testing.assert_array_equal(a, b)
    for one, other in zip(a, b, strict=True):
        same(one, other)


targets = st.one_of(
    float_arrays,
    st.builds(Particles, float_arrays, float_arrays),
    st.builds(Gaussian, float_arrays, float_arrays),
)


@few
@given(st.one_of(targets, st.lists(targets, max_size=4)), st.integers(0, 2**52))
def test_every_kind_of_posterior_comes_out_as_it_went_in(posterior, token):
    answered, received = wire.decode_posterior(decoded(wire.encode_posterior(float(token), posterior)))
    assert answered == token
    same(received, posterior)


def test_of_a_step_only_the_posterior_is_sent():
    states = np.ones((3, 2))
    _, received = wire.decode_posterior(decoded(wire.encode_posterior(1.0, Step(states, memory=object()))))
    same(received, states)


@pytest.mark.parametrize("dtype", [np.float32, np.int64, np.uint8, bool, ">f8"])
def test_real_numbers_of_any_type_become_float64(dtype):
    states = np.eye(3).astype(dtype)
    _, received = wire.decode_posterior(decoded(wire.encode_posterior(1.0, states)))
    same(received, np.eye(3))


def test_memory_order_does_not_matter():
    states = np.asfortranarray(np.arange(12.0).reshape(4, 3))[::2]
    _, received = wire.decode_posterior(decoded(wire.encode_posterior(1.0, states)))
    same(received, np.array([[0.0, 1.0, 2.0], [6.0, 7.0, 8.0]]))


@pytest.mark.parametrize(
    ("posterior", "complaint"),
    [
        (None, "got None (is a return missing?)"),
        ("particles", "got a str"),
        ((np.ones((3, 2)), np.zeros(3)), "got a tuple"),
        ([[1.0, 2.0]], "got a list"),
        (np.array([[object()]]), "the particles must be an array of real numbers, got dtype object"),
        (np.ones((3, 2)) * 1j, "got dtype complex128"),
        (Particles(np.ones((3, 2)), np.array(["a"])), "the log-weights must be"),
        (Particles(np.ones((3, 2)), None), "got dtype object"),
    ],
)
def test_what_is_no_posterior_is_named(posterior, complaint):
    with pytest.raises(TypeError) as caught:
        wire.encode_posterior(1.0, posterior)
    assert complaint in str(caught.value)
