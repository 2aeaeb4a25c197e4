"""Drag, carts and moving pivots: closed forms, and the energy that they take and give."""

import gymnasium as gym
import numpy as np
import pytest
from test_links import DRAGGED

from npend_gym import Cart, Chain, pseudo_periods, simulate
from npend_gym.physics import accelerations, linearise


def with_parts(chain, **parts):
    """Return the same chain with a cart, or springs."""
    return Chain.from_dict(chain.as_dict() | parts)


def agree(got, expected):
    np.testing.assert_allclose(got, expected, rtol=0.0, atol=1e-11 * np.abs(expected).max())


def test_the_terms_are_there_in_long_chains_of_even_and_odd_length():
    # equal rates of drag on all bobs only slow the chain: alpha(drag) = alpha(0) - rate omega
    rng = np.random.default_rng(1)
    for n in (50, 51):
        masses, lengths, theta, omega = rng.uniform(0.5, 2.0, (4, n))
        free, slowed = (Chain(masses, lengths, drag=k * masses) for k in (0.0, 0.7))
        expected = accelerations(free, theta, omega) - 0.7 * omega
        agree(accelerations(slowed, theta, omega), expected)
    # a free fall of the pivot takes gravity away, a cart of great mass is a pivot at rest
    chain = Chain(masses, lengths)
    weightless = accelerations(Chain(masses, lengths, gravity=0.0), theta, omega)
    falling = accelerations(chain, theta, omega, pivot_acceleration=(0.0, -chain.gravity))
    agree(falling[:n], weightless)
    heavy = accelerations(with_parts(chain, base=Cart(1e16)), theta, omega)
    agree(heavy[:n], accelerations(chain, theta, omega))


def test_without_gravity_one_bob_slows_as_its_closed_form_says():
    # one bob, no gravity: omega' = -(c + d l omega) omega / m, of which 1/omega is known
    c, d, m, l, start = 0.3, 0.5, 2.0, 0.8, 4.0
    times = np.linspace(0.0, 5.0, 6)
    path = simulate(Chain([m], [l], 0.0, 0.0, c, d), 0.2, start, times)
    growth = np.exp(c / m * times)
    exact = 1.0 / (growth / start + d * l / c * (growth - 1.0))
    np.testing.assert_allclose(path.omega[:, 0], exact, rtol=1e-9)


def test_work_of_an_accelerated_pivot_balances_the_energy(uneven):
    sideways, up = given = np.array([2.0, -1.5])
    path = simulate(uneven, 0.8, 0.1, np.linspace(0.0, 3.0, 31), pivot_acceleration=given)
    moved = path.positions() - path.positions()[0]
    work = -moved @ [sideways, up] @ uneven.masses  # of the force -m a that is seen on the pivot
    np.testing.assert_allclose(path.energy() - path.energy()[0], work, rtol=0, atol=1e-7)
    assert np.abs(work).max() > 1.0


@pytest.mark.parametrize("options", [{}, {"method": "rk4", "dt": 1e-3}])
def test_work_of_the_force_on_a_cart_and_of_the_torque_balances_all_energy(uneven, options):
    push, torque = 3.0, np.array([2.0, 0.0, -1.0, 0.5])
    path = simulate(
        with_parts(uneven, base=Cart(1.5)), [0.8, -0.3, 1.0, 2.0], 0.1, np.linspace(0.0, 3.0, 31),
        position=0.5, velocity=-0.7, torque=torque, force=push, **options,
    )  # fmt: skip
    assert (path.position[0], path.velocity[0]) == (0.5, -0.7)
    bobs = path.velocities() + path.velocity[:, None, None] * [1.0, 0.0]
    kinetic = 0.5 * (bobs**2).sum(axis=2) @ uneven.masses + 0.75 * path.velocity**2
    np.testing.assert_allclose(path.kinetic_energy(), kinetic, rtol=1e-13)
    turned = np.diff(path.theta - path.theta[0], axis=1, prepend=0.0)
    work = push * (path.position - 0.5) + turned @ torque
    np.testing.assert_allclose(path.energy() - path.energy()[0], work, rtol=0, atol=1e-6)


def test_stiff_drag_gets_more_substeps():
    plain, stiff, fast = (
        gym.make("NPendulum-v0", **drag).unwrapped.config.min_substeps
        for drag in ({}, {"drag": [0.0, 500.0]}, {"quadratic_drag": 50.0})
    )
    assert stiff > 10 * plain
    assert fast > 10 * plain


def test_drag_keeps_the_pseudo_period_of_a_pack_and_lengthens_that_of_one_pendulum():
    # damped linearly, a small swing turns at the rate sqrt(g/l - (c/2m)^2)
    chain = Chain.uniform(1, drag=1.0)
    expected = 2.0 * np.pi / np.sqrt(9.81 - 0.25)
    assert pseudo_periods(chain, 1e-3)[0] == pytest.approx(expected, rel=1e-5)
    starts = np.linspace(0.2, 0.9, 16)[:, None] * np.ones(3)
    together = pseudo_periods(DRAGGED, starts)
    np.testing.assert_array_equal(together[3], pseudo_periods(DRAGGED, starts[3]))


def test_at_rest_and_along_a_path_the_linearisation_with_drag_is_sound():
    at_rest = linearise(DRAGGED, np.zeros((2, 3)), 0.0).A
    linear = Chain(DRAGGED.masses, DRAGGED.lengths, 9.81, 0.05, DRAGGED.drag)
    np.testing.assert_array_equal(at_rest[1], linearise(linear, 0.0).A)  # |v| v has no slope there


def test_the_dense_output_of_a_cart_is_refused_where_there_is_none(uneven):
    with pytest.raises(ValueError, match=r"base=Cart\(mass\)"):
        simulate(uneven, 0.1, 0.0, [0.0, 1.0]).cart_at(0.5)
    with pytest.raises(ValueError, match=r"base=Cart\(mass\)"):
        simulate(uneven, 0.1, 0.0, [0.0, 1.0], pivot_acceleration=(1.0, 0.0)).cart_at(0.5)
