"""Sections of driven chains: once a period of the drive, and where a rod passes an angle."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from variational import KINDS, PENDULUM, PERIOD, cosine, flow, pendulum_rates

from npend_gym import Chain, Signal, chaos, simulate

# Baker and Gollub's table of attractors: after how many periods they repeat
ATTRACTORS = {0.9: 1, 1.07: 2, 1.15: None, 1.35: 1, 1.45: 2, 1.47: 4, 1.5: None}


@pytest.mark.parametrize(("size", "points"), ATTRACTORS.items())
def test_the_stroboscopic_section_shows_period_doublings_and_chaos(size, points):
    section = chaos.stroboscopic_section(
        PENDULUM, 0.2, period=PERIOD, count=32, discard=200, torque=cosine(size)
    )
    assert section.period() == points
    np.testing.assert_allclose(section.times, PERIOD * np.arange(201, 233), rtol=1e-14)
    assert np.all((section.theta >= -np.pi) & (section.theta < np.pi))
    assert section.provenance["arguments"]["torque"] == "function <lambda>"


def test_points_of_a_stroboscopic_section_are_those_of_scipy():
    states = np.array([state for state, _ in flow(pendulum_rates(1.35), [0.2, 0.0], PERIOD, 6)])
    found = chaos.stroboscopic_section(
        PENDULUM, 0.2, period=PERIOD, count=4, discard=2, torque=cosine(1.35)
    )
    np.testing.assert_allclose(np.hstack([found.theta, found.omega]), states[2:], atol=1e-7)


# -- sections of every kind ------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize("kind", ["friction, rotors", "drag, shaken", "springs, cart"])
def test_a_stroboscopic_section_is_the_motion_once_a_period(kind):
    chain, drives = KINDS[kind]
    with pytest.warns(UserWarning, match="after the period, 0.7 s, but differs by more than a th"):
        found = chaos.stroboscopic_section(
            chain, [0.7, 0.4], [0.2, -0.1], period=0.7, count=5, discard=3, rtol=1e-12, **drives
        )
    times = 0.7 * np.arange(9)
    motion = simulate(chain, [0.7, 0.4], [0.2, -0.1], times, rtol=1e-12, atol=1e-14, **drives)
    np.testing.assert_allclose(found.omega, motion.omega[4:], atol=1e-6)
    turns = (found.theta - motion.theta[4:]) / (2.0 * np.pi)
    np.testing.assert_allclose(turns, np.rint(turns), atol=1e-7)


def test_a_section_meets_short_pulses_while_the_chain_rests():
    chain, pulse = Chain.uniform(1, gravity=0.0, damping=0.5), 0.04

    def kick(t):
        return np.where(t % 2.0 < pulse, 0.5 / pulse, 0.0)

    # each adds 0.5 m^2 kg/s; between two the rate decays by exp(-1)
    found = chaos.stroboscopic_section(chain, 0.0, period=2.0, count=3, torque=kick, discard=20)
    limit = 0.5 / np.expm1(1.0) * np.sinh(0.25 * pulse) / (0.25 * pulse) * np.exp(0.25 * pulse)
    np.testing.assert_allclose(found.omega, limit, rtol=1e-5)


def test_the_drive_of_a_section_may_depend_on_the_state():
    def braked(t, _theta, omega):
        return 1.35 * np.cos(2.0 * t / 3.0) - 0.5 * omega[0]

    free, given = Chain.uniform(1, gravity=1.0), {"period": PERIOD, "count": 3}
    by_feedback = chaos.stroboscopic_section(free, 0.2, torque=braked, **given)
    by_damping = chaos.stroboscopic_section(PENDULUM, 0.2, torque=cosine(1.35), **given)
    np.testing.assert_allclose(by_feedback.omega, by_damping.omega, atol=1e-6)


def test_a_drive_is_not_asked_for_what_it_is_after_the_motion():
    samples = Signal([0.0, PERIOD], [1.0, 1.0])
    once = chaos.stroboscopic_section(
        PENDULUM, 0.2, period=PERIOD, count=1, torque=lambda t: 0.0 + samples(t)
    )
    alike = chaos.stroboscopic_section(PENDULUM, 0.2, period=PERIOD, count=1, torque=1.0)
    np.testing.assert_allclose(once.omega, alike.omega, atol=1e-9)


def test_the_period_of_a_section_is_that_of_an_orbit_too_and_no_other_number():
    (orbit,) = chaos.periodic_orbits(Chain.uniform(2), 0, amplitudes=[1.2])
    found = chaos.poincare_section(orbit.chain, orbit.theta, duration=6.5 * orbit.period)
    assert found.period() == 1
    three = chaos.Section(np.arange(7.0), np.zeros((7, 1)), np.arange(7.0)[:, None] % 3, {})
    assert three.period() == 3
    turned = chaos.Section(np.arange(4.0), np.full((4, 1), -np.pi), np.zeros((4, 1)), {})
    turned.theta[1::2] = np.pi - 1e-9
    assert turned.period() == 1
    once = chaos.Section(np.zeros(1), np.zeros((1, 1)), np.zeros((1, 1)), {})
    assert once.period() is None
    with pytest.raises(ValueError, match="tolerance must be greater than zero"):
        once.period(0.0)


def test_a_driven_pendulum_passes_the_vertical_as_an_event_of_its_motion_does():
    found = chaos.poincare_section(PENDULUM, 0.2, duration=60.0, torque=cosine(0.9))
    states = solve_ivp(
        pendulum_rates(0.9), (0.0, 60.0), [0.2, 0.0], "DOP853", rtol=1e-11, atol=1e-12,
        events=lambda _, y: np.sin(y[0]),
    )  # fmt: skip
    wanted = states.y_events[0][:, 1] > 0.0
    np.testing.assert_allclose(found.times, states.t_events[0][wanted], atol=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"period": 0.0}, "period must be greater than zero"),
        ({"count": 0}, "count must be"),
        ({"discard": -1}, "discard must be"),
        ({"period": 1e20}, r"\(discard \+ count\) \* period must be at most"),
        ({"rtol": 1e-17}, "rtol must be at least"),
        ({"force": np.cos}, "force acts on a cart"),
        ({"theta": [1.0] * 3}, "theta must be one number"),
    ],
)
def test_bad_arguments_of_a_stroboscopic_section_are_refused_by_name(change, message):
    given = {"theta": 0.5, "period": 1.0, "count": 3}
    with pytest.raises(ValueError, match=message):
        chaos.stroboscopic_section(Chain.uniform(2), **(given | change))
