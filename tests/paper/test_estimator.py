"""The estimator that the paper prints, against its loops as printed and a digest of its bits."""

import hashlib
import heapq

import numpy as np
import pytest

from npend_gym import Chain, simulate
from paper.estimator import listing_estimate, listing_periods


def printed_gaps(y):
    """The listing's loop as printed, its list kept as a heap so that min and remove are quick."""
    held, gaps = [], []
    for p in range(len(y)):
        for q in range(p + 1, len(y)):
            if abs(y[p] - y[q]) < 0.01:
                heapq.heappush(held, p)
                heapq.heappush(held, q)
                least = heapq.heappop(held)
                gaps.append(abs(held[0] - least) * 1 / 100)
    return gaps


def printed_times(y):
    z = np.gradient(y)
    times = []
    for k in range(len(z)):
        if np.sign(z[k]) != np.sign(z[k - 1]) and k - 1 not in times:
            times.append(k * 1 / 100)
    return times


@pytest.mark.long
def test_listing_is_the_papers_code():
    times = np.linspace(0.0, 10.0, 1000)
    heights = simulate(Chain.uniform(3, length=1 / 3), np.pi / 4, 0.0, times).positions()[:, :, 1]
    measured = listing_periods(Chain.uniform(3, length=1 / 3), np.pi / 4)
    for j in range(3):
        turns = printed_times(heights[:, j])
        averages = [abs(np.mean(printed_gaps(heights[:, j])))]
        averages += [turns[i + 2] - turns[i] for i in range(len(turns) - 2)]
        assert measured[j] == pytest.approx(abs(np.mean(averages)), rel=1e-12)


def test_listing_of_a_steady_climb_is_not_a_number():
    assert np.isnan(listing_estimate(np.linspace(0.0, 100.0, 50)))


def test_the_listing_gives_the_same_bits_on_every_machine():
    digest = hashlib.sha256()
    for n in (1, 5, 20):
        digest.update(listing_periods(Chain.uniform(n), 0.7).tobytes())
    for start in np.linspace(0.1, 1.0, 17):
        digest.update(listing_periods(Chain.uniform(3), start).tobytes())
    golden = "ac4a922183b77f6611320cd8e1f9860775fb865e779440ac1f909e7ae9ca1312"
    assert digest.hexdigest() == golden
