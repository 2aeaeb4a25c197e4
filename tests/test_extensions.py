"""Drag and moving pivots against the dense Lagrangian, derived by SymPy."""

import gymnasium as gym
import numpy as np
import pytest
from lagrangian import system
from scipy.interpolate import CubicSpline

from npend_gym import Cart, Chain, pseudo_periods, simulate
from npend_gym.physics import accelerations, linearise
from npend_gym.physics.energy import velocities


def with_parts(chain, **parts):
    """Return the same chain with a cart, or springs."""
    return Chain.from_dict(chain.as_dict() | parts)


def cases(n, drag=True):
    """Some random chains in motion."""
    rng = np.random.default_rng(n)
    for _ in range(10):
        resistance = rng.uniform(0.0, 2.0, (3, n)) * [[1.0], [drag], [drag]]
        chain = Chain(
            rng.uniform(0.3, 3.0, n), rng.uniform(0.3, 3.0, n), rng.uniform(0.0, 20.0), *resistance
        )
        yield chain, *rng.normal(0.0, 3.0, (3, n)), rng.uniform(0.3, 3.0), rng.normal(0.0, 5.0, 2)


def agree(got, expected):
    np.testing.assert_allclose(got, expected, rtol=0.0, atol=1e-11 * np.abs(expected).max())


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_an_accelerated_pivot_is_that_of_the_lagrangian_with_drag_too(n):
    for chain, theta, omega, torque, _, given in cases(n):
        velocity = given[::-1]
        matrix, force = system(chain, theta, omega, torque, velocity=velocity)
        expected = np.linalg.solve(matrix[2:, 2:], force[2:] - matrix[2:, :2] @ given)
        found = accelerations(
            chain, theta, omega, torque, velocity=velocity, pivot_acceleration=given
        )
        agree(found[:n], expected)
        np.testing.assert_array_equal(found[n:], given)


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_a_cart_is_that_of_the_lagrangian_with_drag_and_a_rail_that_resists(n):
    for chain, theta, omega, torque, cart, (push, speed) in cases(n):
        rail = 0.3
        matrix, force = system(chain, theta, omega, torque, cart, push - rail * speed, (speed, 0.0))
        moving = np.array([0, *range(2, n + 2)])  # not up
        expected = np.linalg.solve(matrix[np.ix_(moving, moving)], force[moving])
        pushed = accelerations(
            with_parts(chain, base=Cart(cart, rail)), theta, omega, torque, force=push,
            velocity=speed,
        )  # fmt: skip
        agree(pushed, np.append(expected[1:], expected[0]))


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


DRAGGED = Chain([1.0, 0.5, 2.0], [1.0, 0.7, 0.4], 9.81, 0.05, [0.3, 0.1, 0.2], [0.2, 0.5, 0.1])


def power_taken(chain, theta, omega):
    square = (velocities(chain, theta, omega) ** 2).sum(axis=-1)
    by_air = (chain.drag + chain.quadratic_drag * np.sqrt(square)) * square
    return (by_air + chain.damping * np.diff(omega, axis=-1, prepend=0.0) ** 2).sum(axis=-1)


@pytest.mark.parametrize("options", [{}, {"method": "rk4", "dt": 2e-4}])
def test_what_drag_takes_is_missing_in_the_energy(options):
    times = np.linspace(0.0, 4.0, 8001)
    path = simulate(DRAGGED, [2.0, 1.2, -0.4], 0.0, times, rtol=1e-12, atol=1e-14, **options)
    lost = CubicSpline(times, power_taken(DRAGGED, path.theta, path.omega)).antiderivative()(times)
    np.testing.assert_allclose(path.energy() + lost, path.energy()[0], rtol=1e-8)
    assert lost[-1] > 0.3 * path.energy()[0]


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


@pytest.mark.parametrize("lanes", [1, 5])
def test_the_environments_account_for_what_drag_takes(lanes):
    keywords = {
        "masses": DRAGGED.masses, "lengths": DRAGGED.lengths, "damping": 0.05,
        "drag": DRAGGED.drag, "quadratic_drag": DRAGGED.quadratic_drag,
    }  # fmt: skip
    env = gym.make_vec(
        "NPendulum-v0", num_envs=lanes, n=3, mode="passive", max_episode_steps=None, **keywords
    )
    env.reset(options={"theta": [[2.0, 1.2, -0.4]] * lanes})
    info = [env.step(np.zeros(lanes, int))[4] for _ in range(100)][-1]
    exact = simulate(DRAGGED, [2.0, 1.2, -0.4], 0.0, [0.0, 1.0])
    np.testing.assert_allclose(info["theta"], [exact.theta[-1]] * lanes, rtol=0, atol=1e-5)
    assert np.abs(info["energy_error"]).max() < 1e-6
    assert exact.energy()[-1] < 0.9 * exact.energy()[0]


def test_drag_in_a_reset_option_is_that_of_its_lane_alone():
    many = gym.make_vec("NPendulum-v0", num_envs=4, n=2, mode="passive")
    drag = np.array([[0.0, 0.0], [0.5, 0.1], [0.0, 0.0], [0.0, 0.3]])
    many.reset(seed=3, options={"drag": drag, "quadratic_drag": 2.0 * drag})
    seen = [many.step(np.zeros(4, int))[0] for _ in range(50)]
    for lane in range(4):
        one = gym.make("NPendulum-v0", n=2, mode="passive")
        options = {"drag": drag[lane], "quadratic_drag": 2.0 * drag[lane]}
        one.reset(seed=3 + lane, options=options)
        for step in seen:
            np.testing.assert_array_equal(one.step(0)[0], step[lane])
    assert np.abs(seen[-1][0] - seen[-1][1]).max() > 0.01


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


ON_CART = Chain.uniform(3, base=Cart(1.0))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"pivot_acceleration": 1.0}, "pivot_acceleration must be two numbers"),
        ({"force": 1.0}, r"force .* must have base=Cart\(mass\)"),
        ({"force": lambda _t: 1.0}, r"force .* must have base=Cart\(mass\)"),
        ({"velocity": 1.0}, r"velocity .* must have base=Cart\(mass\)"),
        ({"position": 1.0}, r"position .* must have base=Cart\(mass\)"),
        ({"pivot_acceleration": (0, 1), "force": 1.0}, r"must have base=Cart\(mass\)"),
        ({"chain": ON_CART, "velocity": (0, 1)}, "velocity must"),
        ({"chain": ON_CART, "pivot_acceleration": (0, 1)}, "must be None for a chain"),
    ],
)
def test_bad_motions_of_the_pivot_are_refused_by_name(arguments, message):
    with pytest.raises(ValueError, match=message):
        simulate(
            **{"chain": Chain.uniform(3), "theta": 0.1, "omega": 0.0, "times": [0, 1]} | arguments
        )


def test_the_dense_output_of_a_cart_is_refused_where_there_is_none(uneven):
    with pytest.raises(ValueError, match=r"base=Cart\(mass\)"):
        simulate(uneven, 0.1, 0.0, [0.0, 1.0]).cart_at(0.5)
    with pytest.raises(ValueError, match=r"base=Cart\(mass\)"):
        simulate(uneven, 0.1, 0.0, [0.0, 1.0], pivot_acceleration=(1.0, 0.0)).cart_at(0.5)
