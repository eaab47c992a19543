"""Frames: what goes in comes out, and garbage raises WireError and nothing else."""

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from course_lib.filters import Gaussian, Particles, Step
from grader.sandbox import wire
from grader.sandbox.answer import AnswerError, check_action, check_posterior
from tests.fuzzing import fuzz

CAPS = {wire.ARRAYS: 1 << 20, wire.TEXT: 1 << 10}
few, many = fuzz(40), fuzz(200)
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


DIMENSION, MOST = 2, 5


class Act(NamedTuple):
    """An action, told from an array that is a posterior."""

    action: np.ndarray


def accepts_or_refuses(payload):
    """Garbage is a list of arrays that are views of it, and a posterior that may be scored; or else it is refused."""
    try:
        result = wire.decode_arrays(payload)
    except wire.WireError:
        return
    assert len(result) <= wire.MAX_ARRAYS and sum(array.nbytes for array in result) <= len(payload)
    whole = np.frombuffer(payload, np.uint8)
    for array in result:
        assert array.dtype == np.float64 and array.ndim <= wire.MAX_DIMENSIONS
        assert not array.size or np.shares_memory(array, whole)
    for decode, may_be_used in ((wire.decode_posterior, may_be_scored), (wire.decode_action, may_be_acted)):
        try:
            token, answer = decode(result)
        except wire.WireError:
            continue
        assert isinstance(token, float)
        with np.errstate(all="raise", under="ignore"):
            may_be_used(answer)


def may_be_acted(action):
    """Refused, or as many finite numbers as there must be."""
    try:
        checked = check_action(action, DIMENSION)
    except AnswerError as error:
        assert str(error).isprintable()
    else:
        assert checked.shape == (DIMENSION,) and np.isfinite(checked).all()


def may_be_scored(posterior):
    """Refused, or finite and normalised."""
    try:
        checked = check_posterior(posterior, DIMENSION, MOST)
    except AnswerError as error:
        assert str(error).isprintable()
        return
    for target in checked if isinstance(checked, list) else [checked]:
        if isinstance(target, Particles):
            assert target.states.shape[0] <= MOST and target.states.shape[1] == DIMENSION
            assert np.isfinite(target.states).all() and not np.isnan(target.log_weights).any()
            assert abs(target.weights.sum() - 1.0) < 1e-9
        else:
            assert target.mean.shape == (DIMENSION,) and target.covariance.shape == (DIMENSION, DIMENSION)
            assert np.isfinite(target.mean).all() and np.isfinite(target.covariance).all()


@many
@given(st.binary(max_size=200))
def test_garbage_is_refused(payload):
    accepts_or_refuses(payload)
    for decode in (lambda data: wire.decode_header(data, CAPS), wire.decode_text):
        try:
            decode(payload)
        except wire.WireError:
            pass


@many
@given(st.sampled_from([b"", b"b", b"bay"]), st.binary(min_size=5, max_size=8))
def test_a_header_is_of_a_kind_that_is_due_and_under_its_cap_or_refused(magic, rest):
    try:
        kind, length = wire.decode_header((magic + rest)[: wire.HEADER_BYTES], CAPS)
    except wire.WireError:
        return
    assert length <= CAPS[kind]


@many
@given(st.lists(st.one_of(st.integers(0, 5), st.integers(0, 2**64 - 1)), max_size=12))
def test_words_that_claim_anything_are_refused(words):
    accepts_or_refuses(np.array(words, dtype="<u8").tobytes())


extremes = st.sampled_from([0.0, -0.0, 1.0, np.nan, np.inf, -np.inf, 1e308, -1e308, 5e-324, 1e17, 1e-300])
rows = st.integers(0, MOST + 1)


def filled(*shape):
    return arrays(np.float64, shape, elements=extremes | st.floats())


likely = st.one_of(
    rows.flatmap(lambda n: filled(n, DIMENSION)),
    rows.flatmap(lambda n: st.builds(Particles, filled(n, DIMENSION), filled(n))),
    rows.flatmap(lambda n: st.builds(Particles, st.just(np.ones((n, DIMENSION))), filled(n))),
    st.builds(Gaussian, filled(DIMENSION), filled(DIMENSION, DIMENSION)),
    filled(DIMENSION, DIMENSION).map(lambda root: Gaussian(np.zeros(DIMENSION), np.minimum(root, root.T))),
)


@fuzz(400)
@example(Gaussian(np.zeros(2), np.full((2, 2), -1e308)))
@given(likely | st.lists(likely, max_size=3))
def test_posteriors_of_any_values_are_normalised_or_refused(posterior):
    accepts_or_refuses(joined(wire.encode_posterior(1.0, posterior)[1:]))


actions = filled(DIMENSION) | float_arrays


@many
@given(actions)
def test_actions_of_any_shape_and_values_are_what_a_world_takes_or_refused(action):
    accepts_or_refuses(joined(wire.encode_action(1.0, action)[1:]))


@many
@given(st.lists(float_arrays, min_size=1, max_size=3) | likely | st.builds(Act, actions), st.data())
def test_a_frame_with_bits_flipped_is_read_or_refused(sent, data):
    if isinstance(sent, Act):
        frame = wire.encode_action(1.0, sent.action)
    else:
        frame = wire.encode_arrays(sent) if isinstance(sent, list) else wire.encode_posterior(1.0, sent)
    payload = bytearray(joined(frame[1:]))
    for _ in range(data.draw(st.integers(1, 3))):
        payload[data.draw(st.integers(0, len(payload) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    accepts_or_refuses(bytes(payload))
    accepts_or_refuses(bytes(payload[: data.draw(st.integers(0, len(payload)))]))


@pytest.mark.parametrize("offset", [0.0, 1e8, 1e17, -1e17, 1e308, -1e308])
def test_weights_sum_to_one_whatever_their_offset(offset):
    """The logarithm of a sum is lost in a large offset: two weights of a half would be two of one."""
    checked = check_posterior(Particles(np.ones((2, DIMENSION)), np.full(2, offset)), DIMENSION, MOST)
    np.testing.assert_allclose(checked.weights, 0.5, rtol=1e-12)


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


@few
@given(float_arrays, st.integers(0, 2**52), st.booleans())
def test_an_action_comes_out_as_it_went_in(action, token, remembering):
    sent = Step(action, memory=object()) if remembering else action
    answered, received = wire.decode_action(decoded(wire.encode_action(float(token), sent)))
    assert answered == token
    same(received, action)


@pytest.mark.parametrize("answer", [np.ones((3, 2)), Gaussian(np.zeros(2), np.eye(2)), [], [np.ones((1, 2))] * 2])
def test_a_posterior_is_no_action(answer):
    with pytest.raises(wire.WireError, match="a frame of another kind"):
        wire.decode_action(decoded(wire.encode_posterior(1.0, answer)))


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
