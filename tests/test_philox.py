"""Random numbers without a state: Philox4x64-10 is NumPy's, to the last bit."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from npend_gym._streams import Purpose
from npend_gym.compiled.jit import kernel
from npend_gym.compiled.philox import (
    first_units,
    generator,
    key_of,
    keys_of,
    philox,
    unit,
)

WORDS = st.integers(0, 2**64 - 1)


@kernel
def block_of(key_low, key_high, block, step, purpose, episode):
    return philox(key_low, key_high, block, step, purpose, episode)


@kernel
def goal_of(key_low, key_high, step, episode):
    word = philox(key_low, key_high, 0, step, Purpose.GOAL, episode)[1]
    return unit(word)


def numpys(seed, step, purpose, episode):
    return np.random.Philox(
        key=np.array([seed % 2**64, seed >> 64], np.uint64),
        counter=np.array([0, step, purpose, episode], np.uint64),
    )


@given(WORDS, WORDS, st.integers(0, 9), WORDS, WORDS, WORDS)
@example(0, 0, 0, 0, 0, 0)
@example(*(2**64 - 1,) * 2, 1, *(2**64 - 1,) * 3)
@example(2**63, 2**64 - 1, 3, 2**32, 5, 2**32 - 1)
def test_every_block_of_words_is_that_of_numpy(low, high, block, step, purpose, episode):
    stream = numpys(low + (high << 64), step, purpose, episode)
    expected = stream.random_raw(4 * (block + 1))[-4:]
    words = block_of(*map(np.uint64, (low, high, block, step, purpose, episode)))
    assert words == tuple(expected.tolist())


def test_a_block_far_down_the_stream_is_the_one_that_numpy_reaches_by_advancing():
    stream = numpys(7, 1, Purpose.SENSOR, 2)
    stream.advance(2**63 + 11)  # in blocks
    words = block_of(np.uint64(7), np.uint64(0), np.uint64(2**63 + 11), 1, Purpose.SENSOR, 2)
    assert words == tuple(stream.random_raw(4).tolist())


def test_whole_numbers_that_are_kept_as_floats_count_as_integers():
    integers = block_of(np.uint64(3), np.uint64(4), 0, 17, Purpose.MOTOR, 2)
    assert block_of(np.uint64(3), np.uint64(4), 0, 17.0, Purpose.MOTOR, 2.0) == integers


@given(st.integers(0, 2**128 - 1), st.integers(0, 2**53))
def test_units_are_what_generators_of_numpy_draw(seed, step):
    expected = np.random.Generator(numpys(seed, step, Purpose.GOAL, 1)).random(2)
    low, high = (np.uint64(word) for word in key_of(seed))
    assert goal_of(low, high, step, 1) == expected[1]
    assert first_units(keys_of(seed, 1), step, Purpose.GOAL, 1)[0] == expected[0]
    np.testing.assert_array_equal(generator(seed, step, Purpose.GOAL, 1).random(2), expected)


@pytest.mark.parametrize("purpose", Purpose)
def test_every_purpose_has_a_stream_of_its_own(purpose):
    others = [first_units(keys_of(0, 100), 0, other, 0) for other in Purpose if other != purpose]
    assert not np.isin(first_units(keys_of(0, 100), 0, purpose, 0), others).any()


@given(st.integers(0, 2**200), st.integers(0, 50))
@example(2**64 - 3, 7)
@example(2**128 - 3, 7)
@example(2**192 - 1, 2)
def test_lane_k_has_the_key_of_the_seed_plus_k(seed, count):
    expected = np.array([key_of(seed + k) for k in range(count)], np.uint64).reshape(count, 2)
    np.testing.assert_array_equal(keys_of(seed, count), expected.T)


def test_the_key_of_a_seed_is_the_seed_itself_or_its_pieces_combined():
    assert key_of(5 + (6 << 64)) == (5, 6)
    assert key_of(np.int64(5)) == (5, 0)
    assert key_of(2**128 - 1) == (2**64 - 1, 2**64 - 1)
    assert key_of((3 << 256) + (9 << 192) + (12 << 128) + 5) == (5 ^ 12 ^ 3, 9)


@pytest.mark.parametrize(("seed", "error"), [(-1, ValueError), (1.5, TypeError), (True, TypeError)])
def test_a_seed_that_is_none_is_refused_by_name(seed, error):
    with pytest.raises(error, match="seed must be"):
        key_of(seed)
