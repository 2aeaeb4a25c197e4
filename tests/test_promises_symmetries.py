"""The engine against itself: what must not matter does not, whatever the chain and its motion."""

import hypothesis
import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from npend_gym import Chain, simulate
from npend_gym.physics import Ensemble

SEEDS, RODS, MEMBERS = st.integers(0, 2**32 - 1), st.integers(1, 6), st.integers(1, 70)
TIGHT = {"rtol": 1e-13, "atol": 1e-15}
PROPERTIES = {}  # name -> a check, and the strategies of its arguments


def over(*strategies):
    """Register a check as a property that holds for all that the strategies give."""

    def register(check):
        PROPERTIES[check.__name__] = check, strategies
        return check

    return register


def random_chain(rng, n, *, damped):
    """Return a chain of unequal rods; damping and drag are those of motions that settle slowly."""
    losses = rng.uniform(0.0, 0.3, (2, n)) * damped * rng.integers(0, 2, (2, 1))
    return Chain(
        rng.uniform(0.3, 3.0, n), rng.uniform(0.3, 3.0, n), rng.uniform(1.0, 20.0), *losses
    )


def random_state(rng, *shape):
    return rng.uniform(-3.0, 3.0, shape), rng.normal(size=shape)


def advanced(chains, theta, omega, torque, steps=3, substeps=4, threads=1):
    """Return what steps of 0.05 s make of members: angles, velocities, work and periods."""
    many = Ensemble(chains, len(theta), joints=(0,), threads=threads)
    many.set_state(slice(None), theta, omega)
    for _ in range(steps):
        many.advance(torque, 0.05, substeps)
    return np.hstack([many.theta, many.omega, many.work[:, None], many.pseudo_periods])


@over(SEEDS, RODS, MEMBERS)
def permuted_members_give_permuted_results(seed, n, size):
    rng = np.random.default_rng(seed)
    chains = [random_chain(rng, n, damped=True) for _ in range(size)]
    (theta, omega), torque = random_state(rng, size, n), rng.normal(size=(size, 1))
    order = rng.permutation(size)
    whole = advanced(chains, theta, omega, torque)
    mixed = advanced([chains[k] for k in order], theta[order], omega[order], torque[order])
    np.testing.assert_array_equal(mixed, whole[order])


@over(SEEDS, RODS, MEMBERS, st.integers(1, 4))
def a_divided_batch_gives_the_same_bits(seed, n, size, threads):
    rng = np.random.default_rng(seed)
    chain = random_chain(rng, n, damped=True)
    (theta, omega), torque = random_state(rng, size, n), rng.normal(size=(size, 1))
    whole = advanced(chain, theta, omega, torque, threads=threads)
    cut = int(rng.integers(0, size))
    parts = [slice(0, cut), slice(cut, size)]
    divided = [advanced(chain, theta[p], omega[p], torque[p]) for p in parts if theta[p].size]
    np.testing.assert_array_equal(np.vstack(divided), whole)


@over(SEEDS, st.integers(1, 4))
def halved_steps_converge_with_the_fourth_order(seed, n):
    rng = np.random.default_rng(seed)
    chain, (theta, omega) = random_chain(rng, n, damped=True), random_state(rng, 1, n)
    torque = rng.normal(size=(1, 1))
    coarse, middle, fine, finest = (
        advanced(chain, theta, omega, torque, steps=2, substeps=k)[:, : 2 * n]
        for k in (16, 32, 64, 128)
    )
    first, second, third = (
        np.abs(a - b).max() for a, b in ((coarse, middle), (middle, fine), (fine, finest))
    )
    assume(third > 3e-13)  # below that the differences are round-off
    assume(0.7 < np.log2(first / second) / np.log2(second / third) < 1.4)  # small enough steps
    assert 3.4 < np.log2(second / third) < 5.2


@over(SEEDS, RODS)
def a_mirrored_start_moves_as_the_mirror_image(seed, n):
    rng = np.random.default_rng(seed)
    chain, (theta, omega) = random_chain(rng, n, damped=True), random_state(rng, n)
    torque = rng.normal(size=n)
    times = np.linspace(0.0, 1.0, 6)
    for options in ({}, {"method": "rk4", "dt": 0.01}):
        motion = simulate(chain, theta, omega, times, torque=torque, **options)
        mirror = simulate(chain, -theta, -omega, times, torque=-torque, **options)
        np.testing.assert_array_equal(mirror.theta, -motion.theta)
        np.testing.assert_array_equal(mirror.omega, -motion.omega)


@over(SEEDS, RODS)
def time_reversed_comes_back_to_the_start(seed, n):
    rng = np.random.default_rng(seed)
    chain, (theta, omega) = random_chain(rng, n, damped=False), random_state(rng, n)
    there = simulate(chain, theta, omega, [0.0, 0.3], **TIGHT)
    back = simulate(chain, there.theta[-1], -there.omega[-1], [0.0, 0.3], **TIGHT)
    # what a difference of 1e-8 at the start grows to says how much of round-off is left at the end
    beside = simulate(chain, there.theta[-1] + 1e-8, -there.omega[-1], [0.0, 0.3], **TIGHT)
    growth = np.abs(beside.theta[-1] - back.theta[-1]).max() / 1e-8
    assume(growth < 1e3)
    speed = 1.0 + np.abs(there.omega).max()
    np.testing.assert_allclose(back.theta[-1], theta, rtol=0.0, atol=1e-10 * (1.0 + growth))
    np.testing.assert_allclose(
        -back.omega[-1], omega, rtol=0.0, atol=1e-10 * (1.0 + growth) * speed**2
    )


@over(SEEDS, RODS, st.integers(-20, 20))
def units_of_mass_change_no_bit_of_the_motion(seed, n, power):
    rng = np.random.default_rng(seed)
    chain, (theta, omega) = random_chain(rng, n, damped=True), random_state(rng, n)
    torque, unit, times = rng.normal(size=n), 2.0**power, np.linspace(0.0, 1.0, 6)
    other = Chain(
        unit * chain.masses, chain.lengths, chain.gravity, unit * chain.damping, unit * chain.drag
    )
    motion = simulate(chain, theta, omega, times, torque=torque)
    scaled = simulate(other, theta, omega, times, torque=unit * torque)
    np.testing.assert_array_equal(scaled.theta, motion.theta)
    np.testing.assert_array_equal(scaled.energy(), unit * motion.energy())


@over(SEEDS, RODS, st.integers(-6, 6), st.integers(-3, 3))
def units_of_length_and_time_only_rename_the_motion(seed, n, length, time):
    rng = np.random.default_rng(seed)
    chain, (theta, omega) = random_chain(rng, n, damped=False), random_state(rng, n)
    metre, second, times = 2.0**length, 2.0**time, np.linspace(0.0, 0.3, 4)
    other = Chain(chain.masses, metre * chain.lengths, metre / second**2 * chain.gravity)
    motion = simulate(chain, theta, omega, times, method="rk4", dt=0.005)
    named = simulate(other, theta, omega / second, second * times, method="rk4", dt=0.005 * second)
    np.testing.assert_allclose(named.theta, motion.theta, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(named.omega * second, motion.omega, rtol=1e-9, atol=1e-8)


def run(name, cases, seed):
    """Check a property in so many cases, others for each seed."""
    check, strategies = PROPERTIES[name]
    chosen = settings(
        max_examples=cases, deadline=None, derandomize=False, database=None,
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    hypothesis.seed(seed)(chosen(given(*strategies)(check)))()


@pytest.mark.parametrize("name", PROPERTIES)
@pytest.mark.parametrize(
    ("cases", "seed"), [(12, 0), pytest.param(120, 1, marks=pytest.mark.long)], ids=["few", "many"]
)
def test_what_must_not_matter_does_not(name, cases, seed):
    run(name, cases, seed)
