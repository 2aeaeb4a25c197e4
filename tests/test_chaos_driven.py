"""Exponents of driven chains, against tangent vectors that SciPy integrates."""

import json

import lagrangian
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from variational import (
    KINDS,
    LINE,
    PENDULUM,
    PERIOD,
    SHAKEN,
    TORQUES,
    TWO,
    cosine,
    exponents_of,
    flow,
    pendulum_rates,
)  # fmt: skip

from npend_gym import Cart, Chain, Signal, chaos, simulate
from npend_gym.physics import mass_matrix

# -- the driven damped pendulum --------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize(
    ("size", "chaotic"),
    [
        (0.9, False),
        (1.15, True),
        pytest.param(1.35, False, marks=pytest.mark.nightly),
        pytest.param(1.5, True, marks=pytest.mark.nightly),
    ],
)
def test_exponents_of_the_driven_pendulum_are_those_of_another_integration(size, chaotic):
    expected, scatter = exponents_of(pendulum_rates(size), [0.2, 0.0], PERIOD, 230, 30)
    given = {"torque": cosine(size), "duration": 200.0 * PERIOD}
    largest = chaos.largest_lyapunov(PENDULUM, 0.2, **given)
    assert largest.chaotic == chaotic
    assert (expected[0] > 0.05) == chaotic
    error = 4.0 * np.hypot(largest.error, scatter[0])
    assert error < 0.08
    assert largest.exponent == pytest.approx(expected[0], abs=error)
    found = chaos.lyapunov_spectrum(PENDULUM, 0.2, **given).exponents
    np.testing.assert_allclose(found, expected, atol=error)
    assert found.sum() == pytest.approx(-0.5, abs=1e-9)  # the divergence of the flow
    megno = chaos.megno(PENDULUM, 0.2, **given)
    assert (megno.value > 2.0) == chaotic
    assert megno.exponent == pytest.approx(expected[0], abs=2.0 * error)


@pytest.mark.parametrize(
    ("size", "settling"), [(1.35, 25), pytest.param(1.07, 80, marks=pytest.mark.long)]
)
def test_exponents_of_a_periodic_attractor_are_those_of_its_multipliers(size, settling):
    *_, (start, _) = flow(pendulum_rates(size), [0.2, 0.0], PERIOD, settling)
    (_, first), (end, second) = flow(pendulum_rates(size), start, PERIOD, 2)
    np.testing.assert_allclose(end, start, atol=1e-6)
    turns = np.linalg.eigvals(second @ first)
    expected = np.sort(np.log(np.abs(turns)))[::-1] / (2.0 * PERIOD)
    periods = 20
    found = chaos.lyapunov_spectrum(
        PENDULUM, start[0], start[1], duration=periods * PERIOD, torque=cosine(size)
    ).exponents
    # what remains of the angle between the vectors, or of a turning pair, falls as one over time
    np.testing.assert_allclose(found, expected, atol=2.0 / (periods * PERIOD))
    assert found.sum() == pytest.approx(-0.5, abs=1e-9)


# -- Kapitza's pendulum: (g + a(t)) / l in the place of g / l, so Mathieu's equation ---------------


def multipliers_upright(shake, damping, period):
    """Return the multipliers of x'' + damping x' = (1 + shake(t)) x, by SciPy."""

    def rates(t, y):
        x, v = y.reshape(2, 2)
        return np.concatenate([v, (1.0 + shake(t)) * x - damping * v])

    end = solve_ivp(rates, (0.0, period), np.eye(2).ravel(), "DOP853", rtol=1e-12, atol=1e-13)
    return np.linalg.eigvals(end.y[:, -1].reshape(2, 2))


@pytest.mark.parametrize("damping", [0.0, 0.2])
@pytest.mark.parametrize("height", [0.05, 0.1])
def test_a_pendulum_stands_upright_where_the_multipliers_of_mathieus_equation_say_so(
    height, damping
):
    rate = 20.0
    shake, period = cosine(height * rate**2, rate), 2.0 * np.pi / rate
    turns = multipliers_upright(shake, damping, period)
    stable = np.abs(turns).max() < 1.0 + 1e-6
    # P. L. Kapitza, Sov. Phys. JETP 21 (1951), 588: for fast shaking (height rate)^2 > 2 g l
    assert stable == ((height * rate) ** 2 > 2.0)
    chain, given = Chain.uniform(1, gravity=1.0, damping=damping), {}
    given["pivot_acceleration"] = lambda t: (0.0 * t, height * rate**2 * np.cos(rate * t))
    changed = np.zeros((2, 6))  # of the angle and its rate, after those of the pivot and its two
    changed[[0, 1], [0, 3]] = 1.0
    for _ in chaos.tangents(chain, np.pi, 0.0, [0.0, period], changed, **given):
        pass
    found = np.linalg.eigvals(changed[:, [0, 3]])
    np.testing.assert_allclose(np.sort_complex(found), np.sort_complex(turns), atol=1e-9)
    duration = 64.0 * period  # not so long that the rounding of pi is an angle
    spectrum = chaos.lyapunov_spectrum(chain, np.pi, duration=duration, samples=8, **given)
    assert spectrum.exponents.size == 2  # the pivot has none: its motion is prescribed
    sums = spectrum.history * spectrum.times[:, None]
    late = (sums[-1] - sums[3]) / (spectrum.times[-1] - spectrum.times[3])
    expected = np.sort(np.log(np.abs(turns)))[::-1] / period
    np.testing.assert_allclose(np.sort(late)[::-1], expected, atol=0.05)  # not in whole periods
    largest = chaos.largest_lyapunov(chain, np.pi, duration=40.0, **given)
    assert largest.chaotic == (not stable)
    tilted = simulate(chain, np.pi - 0.01, 0.0, [0.0, 10.0], **given).theta[-1, 0]
    assert (abs(tilted - np.pi) < 0.1) == stable


# -- every kind of chain, and every kind of drive --------------------------------------------------

CART = Chain.uniform(1, gravity=1.0, damping=0.2, base=Cart(1.0, 0.3))
LINK = Chain(1.0, [1.0], gravity=1.0, centres=0.5, inertias=0.1, friction=0.15, friction_speed=0.1)


def cart_rates(size):
    def rates(t, y):
        (angle, _, spin, speed), push = y, size * np.cos(t)
        c, s = np.cos(angle), np.sin(angle)
        right = [-s - 0.2 * spin, push - 0.3 * speed + spin**2 * s]
        determinant = 2.0 - c**2
        turned = (2.0 * right[0] - c * right[1]) / determinant
        return np.array([spin, speed, turned, (right[1] - c * right[0]) / determinant])

    return rates


def link_rates(size):
    def rates(t, y):
        rubbed = y[1] / 0.1
        torque = size * np.cos(0.7 * t) - 0.15 * rubbed / np.sqrt(1.0 + rubbed**2)
        return np.array([y[1], (torque - 0.5 * np.sin(y[0])) / (0.1 + 0.25)])

    return rates


@pytest.mark.long
@pytest.mark.parametrize(
    ("chain", "rates", "name", "rate", "size", "chaotic"),
    [
        pytest.param(CART, cart_rates, "force", 1.0, 1.5, False, marks=pytest.mark.nightly),
        (CART, cart_rates, "force", 1.0, 2.5, True),
        (LINK, link_rates, "torque", 0.7, 0.3, False),
        pytest.param(LINK, link_rates, "torque", 0.7, 0.4, True, marks=pytest.mark.nightly),
    ],
)
def test_exponents_of_a_driven_cart_and_of_a_driven_link_with_friction(
    chain, rates, name, rate, size, chaotic
):
    period = 2.0 * np.pi / rate
    start = np.append([0.2], np.zeros(2 * chain.coordinates - 1))
    expected, scatter = exponents_of(rates(size), start, period, 150, 30)
    given = {"duration": 150.0 * period, name: cosine(size, rate)}
    largest = chaos.largest_lyapunov(chain, 0.2, **given)
    assert largest.chaotic == chaotic
    assert (expected[0] > 0.05) == chaotic
    error = 4.0 * np.hypot(largest.error, scatter.max())
    assert error < 0.2
    assert largest.exponent == pytest.approx(expected[0], abs=error)
    found = chaos.lyapunov_spectrum(chain, 0.2, **given)
    np.testing.assert_allclose(found.exponents, np.sort(expected)[::-1], atol=error)
    if name == "force":  # the place of the cart changes nothing
        assert np.abs(found.exponents).min() < 0.01
    assert found.provenance["arguments"][name] == "function <lambda>"


def now(drive, t):
    return 0.0 if drive is None else drive(t) if callable(drive) else drive


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_tangent_vectors_of_driven_chains_are_those_of_the_lagrangian(kind):
    (chain, drives), end = KINDS[kind], 1.0
    start, ending = {}, {}
    motion = simulate(chain, [0.7, 0.4], [0.2, -0.1], [0.0, end], **drives, rtol=1e-12, atol=1e-14)
    for part, k in ((start, 0), (ending, -1)):
        for name in ("position", "velocity", "stretch", "stretch_rate"):
            own = getattr(motion, name)
            part[name] = [] if own is None else np.atleast_1d(own[k])
    m = chain.coordinates + 2 * ("pivot_acceleration" in drives)

    def rates(t, y):
        torque = now(drives.get("torque"), t) * np.array(
            [1.0, np.ndim(now(drives.get("torque"), t))]
        )
        loads = np.append(torque, now(drives.get("force"), t))
        shaken = drives.get("pivot_acceleration")
        given = {} if shaken is None else {"acceleration": np.array(shaken(t))}
        return np.append(
            y[m:], lagrangian.accelerations_of_chain(chain, y[:m], y[m:], loads, **given)
        )

    state = [0.7, 0.4, *start["position"], *start["stretch"]]
    state += [0.2, -0.1, *start["velocity"], *start["stretch_rate"]]
    ((after, expected),) = flow(rates, state, end, 1, turning=0)
    np.testing.assert_allclose(after[:2], motion.theta[-1], atol=1e-8)
    vectors = np.eye(2 * m)
    for _ in chaos.tangents(chain, [0.7, 0.4], [0.2, -0.1], [0.0, end], vectors, **drives):
        pass
    np.testing.assert_allclose(vectors.T, expected, atol=1e-7 * np.abs(expected).max())
    # canonical momenta: the sum of all exponents is the growth of the volume in these
    volume = np.linalg.slogdet(expected)[1]
    for part, k, sign in ((ending, -1, 1.0), (start, 0, -1.0)):
        stretch = {"stretch": part["stretch"]} if chain.stiffness is not None else {}
        volume += sign * np.linalg.slogdet(mass_matrix(chain, motion.theta[k], **stretch))[1]
    found = chaos.lyapunov_spectrum(chain, [0.7, 0.4], [0.2, -0.1], duration=end, **drives)
    assert found.exponents.size == 2 * chain.coordinates
    assert found.exponents.sum() == pytest.approx(volume / end, abs=1e-6)


BY_LINE = pytest.param({"torque": LINE}, marks=[pytest.mark.long, pytest.mark.nightly])


@pytest.mark.parametrize("drives", [TORQUES, SHAKEN, BY_LINE, {"torque": [2.0, 1.0]}])
def test_exponents_of_a_driven_chain_without_damping_come_in_pairs(drives):
    found = chaos.lyapunov_spectrum(Chain(**TWO), 2.0, duration=1.0, **drives).exponents
    assert found[0] > 0.3
    np.testing.assert_allclose(found, -found[::-1], atol=1e-6)


def test_a_constant_torque_tilts_the_pendulum_and_its_exponents():
    chain, tilt = Chain.uniform(1), 2.5  # m g l sin(tilt) balances the torque, unstably
    load = {"torque": 9.81 * np.sin(tilt)}
    found = chaos.lyapunov_spectrum(chain, tilt, duration=6.0, samples=2, **load)
    early, late = found.history * found.times[:, None]
    rate = np.sqrt(-9.81 * np.cos(tilt))
    np.testing.assert_allclose((late - early) / np.diff(found.times), [rate, -rate], atol=1e-3)
    load = {"torque": 9.81 * np.sin(0.5), "duration": 40.0}  # stably
    assert chaos.megno(chain, 0.5, **load).value < 1.0
    assert not chaos.largest_lyapunov(chain, 0.5, **load).chaotic


@pytest.mark.parametrize("measure", [chaos.megno, chaos.lyapunov_spectrum, chaos.largest_lyapunov])
def test_drives_of_every_form_are_the_same_and_stand_in_the_record(measure):
    chain, given = Chain(**TWO, base=Cart(2.0)), {"duration": 40.0}
    by_number = measure(chain, 0.2, **given, torque=0.5, force=0.3)
    forms = {
        "function push": push_of,
        "2 samples, previous": lambda value: Signal([0.0, 41.0], [value, value]),
    }
    made = json.loads(json.dumps(by_number.provenance))["arguments"]
    assert (made["torque"], made["force"]) == (0.5, 0.3)
    for record, form in forms.items():
        found = measure(chain, 0.2, **given, torque=form(0.5), force=form(0.3))
        np.testing.assert_allclose(found.history[-1], by_number.history[-1], atol=1e-4)
        made = found.provenance["arguments"]
        assert (made["torque"], made["force"]) == (record, record)
    plain = measure(chain, 0.2, **given).provenance["arguments"]
    assert not {"torque", "force", "pivot_acceleration"}.intersection(plain)


def push_of(value):
    def push(t):
        return value + 0.0 * t

    return push


# -- what is refused -------------------------------------------------------------------------------


def braked(_t, _theta, omega):
    return -omega[0]


def pushed_apart(_t, _theta, omega):
    return np.sign(omega[0] - omega[1])  # the same where both rods turn faster


def braked_late(t, _theta, omega):
    return -omega[0] if t > 0.5 else 0.0


@pytest.mark.parametrize(
    ("drives", "message"),
    [
        ({"torque": braked}, "torque must depend on time alone.*not known: give resistance to the"),
        ({"torque": pushed_apart}, "torque must depend on time alone"),
        ({"torque": braked_late}, "torque must depend on time alone"),
        ({"force": np.cos}, "force acts on a cart: the chain must have base"),
        ({"force": 1.0}, "force is that of a cart"),
        ({"torque": [1.0] * 3}, "torque must"),
        ({"torque": lambda _t: [1.0] * 3}, r"must return finite numbers of shape \(\) or \(2,\)"),
        ({"torque": Signal([0.0, 1.0], [1.0, 2.0])}, "torque must be sampled over the whole"),
        ({"torque": np.cos, "pivot_acceleration": Signal([0.0, 40.0], [[0.0, 1.0]])},
         "must be all functions or all signals"),
    ],
)  # fmt: skip
def test_what_drives_no_motion_or_has_no_derivative_is_refused_by_name(drives, message):
    for measure in (chaos.megno, chaos.lyapunov_spectrum, chaos.largest_lyapunov):
        with pytest.raises(ValueError, match=message):
            measure(Chain.uniform(2), 1.0, duration=40.0, **drives)
