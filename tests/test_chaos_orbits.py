"""Periodic orbits: they close, and grow out of the normal modes with the multipliers of these."""

import numpy as np
import oracle
import pytest
from interrupt import Interrupt

from npend_gym import Cart, Chain, chaos, simulate, theory
from npend_gym.chaos import ContinuationError, periodic_orbits


def test_orbits_of_a_pendulum_have_the_period_of_the_elliptic_integral():
    amplitudes = [0.1, 1.0, 3.0]
    for orbit, angle in zip(
        periodic_orbits(Chain.uniform(1, length=0.7), 0, amplitudes=amplitudes),
        amplitudes,
        strict=True,
    ):
        exact = theory.pendulum_period(angle, 0.7)
        assert orbit.period == pytest.approx(exact, rel=1e-11)
        assert orbit.amplitude == pytest.approx(angle, rel=1e-12)
        assert orbit.energy == pytest.approx(9.81 * 0.7 * (1.0 - np.cos(angle)), rel=1e-12)
        assert orbit.multipliers.size == 0
        assert orbit.stable


@pytest.mark.parametrize("mode", [0, 1, 2])
def test_small_orbits_are_the_normal_modes_and_have_their_multipliers(mode):
    chain = Chain([1.0, 0.5, 2.0], [1.0, 0.7, 0.4])
    frequencies, shapes = theory.normal_modes(chain)
    (orbit,) = periodic_orbits(chain, mode, amplitudes=[1e-3])
    period = 2.0 * np.pi / frequencies[mode]
    assert orbit.period == pytest.approx(period, rel=1e-5)
    np.testing.assert_allclose(orbit.theta, 1e-3 * shapes[:, mode], atol=1e-8)
    others = np.delete(frequencies, mode)
    turns = np.exp(1j * np.concatenate([others, -others]) * period)
    for multiplier in orbit.multipliers:
        assert np.abs(multiplier - turns).min() < 1e-4
    assert orbit.stable


def test_orbits_are_closed_also_by_scipy_on_the_dense_equations():
    chain = Chain.uniform(2)
    orbits = periodic_orbits(chain, 1, amplitudes=[np.pi / 4, 1.3])
    for orbit in orbits:
        assert orbit.closure < 1e-10
        theta, omega = oracle.trajectory(chain, orbit.theta, 0.0, [0.0, orbit.period])
        np.testing.assert_allclose(theta[-1], orbit.theta, atol=1e-8)
        np.testing.assert_allclose(omega[-1], 0.0, atol=1e-8)
        motion = orbit.motion(3)
        assert np.abs(motion.omega[[0, 1, 2]]).max() < 1e-10
        assert np.abs(motion.theta[1] - motion.theta[0]).max() > 0.5  # half the period is not all


def test_neighbours_leave_an_unstable_orbit_by_its_largest_multiplier():
    chain = Chain.uniform(2)
    stable, unstable = periodic_orbits(chain, 1, energies=[5.0, 25.0])
    assert stable.stable
    assert not unstable.stable
    assert [stable.energy, unstable.energy] == pytest.approx([5.0, 25.0], rel=1e-12)
    growth, shrinking = unstable.multipliers.real
    assert growth * shrinking == pytest.approx(1.0, rel=1e-6)
    change = np.array([1e-9, 0.0])  # after some periods along the direction that grows
    times = unstable.period * np.arange(6)
    near = simulate(chain, unstable.theta + change, 0.0, times, rtol=1e-13, atol=1e-15)
    distances = np.linalg.norm(near.theta - unstable.theta, axis=1)
    assert distances[4] / distances[3] == pytest.approx(growth, rel=0.01)


@pytest.mark.long
def test_links_have_nonlinear_normal_modes():
    arm = Chain(1.0, [1.0, 0.8], centres=[0.5, 0.4], inertias=0.1)
    (orbit,) = periodic_orbits(arm, 0, amplitudes=[1.0])
    assert orbit.closure < 1e-10
    assert orbit.provenance["arguments"]["mode"] == 0


@pytest.mark.long
@pytest.mark.parametrize("n", [2, 3, 4, 5])
def test_all_nonlinear_normal_modes_reach_two_radians_and_are_closed(n):
    for mode in range(n):
        for orbit in periodic_orbits(Chain.uniform(n), mode, amplitudes=[np.pi / 4, 2.0]):
            assert orbit.closure < 1e-10


@pytest.mark.long
def test_an_amplitude_in_the_gap_of_a_resonance_is_refused():
    with pytest.raises(ContinuationError, match=r"mode 0 has no orbit for 1.8 of amplitudes: it t"):
        periodic_orbits(Chain.uniform(5), 0, amplitudes=[0.5, 1.8])


@pytest.mark.long
def test_ctrl_c_ends_a_continuation_at_once():
    periodic_orbits(Chain.uniform(2), 0, amplitudes=[0.1])  # compiled
    with pytest.raises(KeyboardInterrupt), Interrupt():
        periodic_orbits(Chain.uniform(60), 59, amplitudes=[2.0])


@pytest.mark.parametrize(
    ("arguments", "error", "text"),
    [
        ({"amplitudes": None}, ValueError, "either amplitudes or energies, and not both"),
        ({"energies": [1.0]}, ValueError, "either amplitudes or energies, and not both"),
        ({"amplitudes": [1.0, 0.5]}, ValueError, "amplitudes must be a list of increasing"),
        ({"amplitudes": [0.0, 0.5]}, ValueError, "amplitudes must be a list of increasing"),
        ({"amplitudes": 1.0}, ValueError, "amplitudes must be a list of increasing"),
        ({"amplitudes": [np.pi]}, ValueError, "amplitudes must be below pi"),
        ({"amplitudes": [np.nan]}, ValueError, "amplitudes must be finite"),
        ({"mode": 2}, ValueError, "mode must be between 0 and 1, got 2"),
        ({"chain": Chain.uniform(2, damping=0.1)}, ValueError, "no damping"),
        ({"chain": Chain.uniform(2, gravity=0.0)}, ValueError, "chain must hang"),
        ({"chain": 2}, TypeError, "chain"),
        *(
            ({"chain": Chain.uniform(2, **part)}, ValueError, r"pivot at rest.*chain\.hung\(\)")
            for part in ({"base": Cart(1.0)}, {"stiffness": 100.0})
        ),
    ],
)
def test_bad_input_is_refused_by_name(arguments, error, text):
    given = {"chain": Chain.uniform(2), "mode": 0, "amplitudes": [1.0]} | arguments
    with pytest.raises(error, match=text):
        chaos.periodic_orbits(**given)
