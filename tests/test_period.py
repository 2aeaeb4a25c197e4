import itertools

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ellipk

from npend_gym import Chain, NPendulumEnv, pseudo_periods, simulate, theory
from npend_gym.chain import STANDARD_GRAVITY
from npend_gym.experiments.sensing import Sensor, sensed_periods
from npend_gym.period import DEFINITIONS
from npend_gym.physics import Ensemble

UNEVEN = Chain([1.0, 0.5, 2.0, 0.8], [1.0, 0.7, 0.4, 1.3])
SPRUNG = Chain([1.0, 0.5, 2.0], [1.0, 0.7, 0.4], stiffness=[200.0, 150.0, 300.0])
ON_SPRINGS = pytest.param(SPRUNG, marks=pytest.mark.long)


@pytest.mark.parametrize(
    ("definition", "theta0", "share"),
    [
        *(("bob", theta0, 1.0) for theta0 in (0.01, np.pi / 4, 1.5, -np.pi / 4)),
        *(("link", theta0, 1.0) for theta0 in (0.01, np.pi / 4, -1.5, 3.0)),
        *(("com", theta0, 1.0) for theta0 in (-np.pi / 4, 1.2)),
        ("height", np.pi / 4, 0.5),
        *(
            (definition, theta0, 1.0)
            for definition in ("bob", "com")
            for theta0 in (1.58, -2.1, 3.0)
        ),
        # beyond a right angle it moves outwards first; twice reversed, back outwards, when it
        # stops on the far side
        ("horizontal", 3.0, 0.5),
        ("horizontal", 1.5, 1.0),
    ],
)
def test_one_pendulum_has_the_period_of_the_elliptic_integral(definition, theta0, share):
    small = 2.0 * np.pi * np.sqrt(1.0 / STANDARD_GRAVITY)
    expected = share * small * 2.0 / np.pi * ellipk(np.sin(0.5 * theta0) ** 2)
    measured = pseudo_periods(Chain.uniform(1), theta0, definition=definition)
    np.testing.assert_allclose(measured, expected, rtol=0, atol=1e-8)


@pytest.mark.long
@pytest.mark.parametrize("definition", ["bob", "com"])
@pytest.mark.parametrize("start", [0.5, -2.8])  # more and less than 90 degrees from where it rests
def test_a_link_that_rests_upright_has_the_period_of_the_elliptic_integral(definition, start):
    inertia, centre, gravity = 0.1, -0.5, 9.81
    chain = Chain([1.0], [1.0], centres=[centre], inertias=[inertia], gravity=gravity)
    small = np.sqrt((inertia + centre**2) / (gravity * abs(centre)))
    expected = 4.0 * small * ellipk(np.cos(0.5 * start) ** 2)
    exact = pseudo_periods(chain, start, definition=definition, duration=20.0)
    np.testing.assert_allclose(exact, expected, rtol=0, atol=1e-8)
    sensed = sensed_periods(chain, start, definition, Sensor(0.002), 20.0, 0)
    np.testing.assert_allclose(sensed, expected, rtol=0, atol=1e-4)
    ensemble = Ensemble(chain, 1)
    ensemble.set_state(0, [start])
    for _ in range(200):
        ensemble.advance(0.0, 0.05)
    found = ensemble.pseudo_periods  # of bobs
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("n", "definition", "mean"),
    [
        (2, "link", 2.71757369),
        (2, "bob", 2.71648333),
        (3, "link", 3.22510949),
        (3, "bob", 3.19436335),
    ],
)
def test_mean_over_bobs_from_a_quarter_pi_is_the_known_one(n, definition, mean):
    # found independently with SciPy on the dense equations
    measured = pseudo_periods(Chain.uniform(n), np.pi / 4, definition=definition)
    assert measured.mean() == pytest.approx(mean, abs=1e-7)


def by_frames(chain, theta, definition, duration, dt=1e-3, omega=0.0):
    """The slow, obvious definition: signs of the signal at close frames, roots between them."""
    times = np.arange(0.0, duration, dt)
    path = simulate(chain, theta, omega, times, rtol=1e-12, atol=1e-13)
    places, velocities = path.positions(), path.velocities()
    if definition == "com":  # from both ends of each link
        share = (chain.centres / chain.lengths)[:, None]
        for ends in (places, velocities):
            above = np.insert(ends[:, :-1], 0, 0.0, axis=1)
            centres = above + (ends - above) * share
            ends[:] = np.average(centres, axis=1, weights=chain.masses)[:, None]
    signal = path.omega if definition == "link" else velocities[:, :, 0]
    if definition != "link" and np.cos(theta).min() < 0.0:
        signal = places[..., 0] * velocities[..., 1] - places[..., 1] * velocities[..., 0]
    periods = np.full(chain.n, np.nan)
    for i in range(chain.n):
        sign = np.where(np.abs(signal[:, i]) > 1e-5, np.sign(signal[:, i]), 0.0)
        known = np.flatnonzero(sign)
        turns = [(a, b) for a, b in itertools.pairwise(known) if sign[a] != sign[b]]
        risen = False
        for a, b in turns:
            if sign[b] > 0:
                risen = True
            elif risen:
                spline = np.polynomial.Polynomial.fit(
                    times[a - 4 : b + 5], signal[a - 4 : b + 5, i], 6
                )
                periods[i] = brentq(spline, times[a], times[b])
                break
    return periods


@pytest.mark.parametrize(
    ("definition", "chain", "start"),
    [
        *((name, Chain.uniform(n), 0.6) for name in ("bob", "link") for n in (2, 5, 12)),
        ("bob", UNEVEN, [0.5, 0.4, 0.6, 0.3]),
        pytest.param("bob", SPRUNG, 0.6, marks=pytest.mark.long),
        pytest.param("link", SPRUNG, 0.6, marks=pytest.mark.long),
        # the bob of a link is its far end
        pytest.param("bob", Chain.preset("realaigym A.0"), 0.6, marks=pytest.mark.long),
        ("com", UNEVEN, [0.5, 0.4, 0.6, 0.3]),
        pytest.param(
            "com", Chain.rods([1.0, 0.4, 2.0], [0.6, 1.0, 0.8], friction=0.01), [0.5, 0.4, 0.6],
            marks=pytest.mark.long,
        ),
        pytest.param(
            "com", Chain([1.0, 0.4], [0.6, 1.0], stiffness=60.0, axial_damping=0.5), 0.5,
            marks=pytest.mark.long,
        ),
        ("bob", Chain.uniform(3), 1.75),
        ("com", UNEVEN, [1.7, 1.5, 1.6, 1.9]),
        *(
            pytest.param(definition, chain, 1.8, marks=pytest.mark.long)
            for definition in ("bob", "com")
            for chain in (
                Chain([1.0, 0.4], [0.6, 1.0], stiffness=300.0, axial_damping=0.5),
                Chain.rods([1.0, 0.4, 2.0], [0.6, 1.0, 0.8]),
            )
        ),
    ],
)  # fmt: skip
def test_turning_points_are_those_seen_by_close_frames(definition, chain, start):
    dt = 1e-4 if chain.friction.any() else 1e-3  # friction changes its sign within milliseconds
    expected = by_frames(chain, start, definition, 12.0, dt)
    measured = pseudo_periods(chain, start, definition=definition, duration=11.9)
    np.testing.assert_allclose(measured, expected, rtol=0, atol=1e-8)
    assert np.isfinite(measured).sum() >= min(chain.n, 4)
    assert definition != "com" or np.ptp(measured) == 0.0
    window = np.nanmean(measured) - 1e-3  # too short for some, or for the one of the "com"
    seen = pseudo_periods(chain, start, definition=definition, duration=window)
    completed = np.where(measured < window, measured, np.nan)
    np.testing.assert_allclose(seen, completed, rtol=0, atol=1e-8)
    assert np.isnan(seen).any()


@pytest.mark.parametrize("speed", [-0.001, -0.005, 0.001])
def test_a_sign_that_counts_at_the_start_is_not_forgotten(speed):
    # inwards the upper bob turns after a millisecond, within the first step
    chain, start, omega = Chain.uniform(2), [0.1, 0.6], [speed, 0.0]
    expected = by_frames(chain, start, "bob", 4.0, 1e-4, omega)
    np.testing.assert_allclose(pseudo_periods(chain, start, omega), expected, atol=1e-8)
    for substeps in (None, 1, 20):
        env = NPendulumEnv(n=2, mode="passive", substeps=substeps)
        env.reset(seed=0, options={"theta": start, "omega": omega})
        infos = [env.step(0)[-1] for _ in range(300)]
        np.testing.assert_allclose(infos[-1]["pseudo_periods"], expected, atol=2e-3)


def test_whole_turns_of_a_rod_change_no_period():
    start = np.array([-0.5, 0.4])
    for definition in DEFINITIONS:
        periods = [
            pseudo_periods(Chain.uniform(2), start + turns, definition=definition)
            for turns in ([0.0, 0.0], [2.0 * np.pi, -2.0 * np.pi])
        ]
        np.testing.assert_allclose(*periods, rtol=0, atol=1e-7)


@pytest.mark.parametrize("chain", [Chain.uniform(5), ON_SPRINGS], ids=["bobs", "springs"])
def test_height_is_reached_again_at_the_reported_instant_and_not_before(chain):
    start = 0.7
    periods = pseudo_periods(chain, start, definition="height", duration=20.0)
    times = np.linspace(0.0, 20.0, 4001)
    height = simulate(chain, start, 0.0, times).positions()[:, :, 1]
    lift = height - height[0]
    for i in range(chain.n):
        end = periods[i] if np.isfinite(periods[i]) else 20.0
        assert (lift[(times > 0.05) & (times < end - 0.01), i] < 0.0).all()
        if np.isfinite(periods[i]):
            at = simulate(chain, start, 0.0, [0.0, periods[i]]).positions()[:, i, 1]
            assert at[1] == pytest.approx(at[0], abs=1e-8)
    assert 0 < np.isfinite(periods).sum() <= chain.n


def test_mirrored_release_has_the_same_periods_to_the_last_bit():
    for definition in ("bob", "link", "height", "com"):
        right = pseudo_periods(Chain.uniform(6), 0.5, definition=definition)
        left = pseudo_periods(Chain.uniform(6), -0.5, definition=definition)
        np.testing.assert_array_equal(right, left)


def test_within_ten_seconds_a_part_of_a_hundred_rods_completes():
    chain = Chain.uniform(100)
    for definition, count in (("link", 42), ("bob", 21)):
        done = np.isfinite(pseudo_periods(chain, np.pi / 4, definition=definition, duration=10.0))
        assert done.sum() == count


def test_without_a_duration_every_bob_of_the_papers_chains_completes():
    for n in (5, 10, 20, 100):
        assert np.isfinite(pseudo_periods(Chain.uniform(n), np.pi / 4)).all()


def test_a_rod_that_first_drifts_the_other_way_is_not_credited_with_it():
    # pushed outwards at the start: up, turn (+ to -), down, turn (- to +), up, turn: complete
    chain = Chain.uniform(1)
    period = theory.pendulum_period(0.5)
    path = simulate(chain, 0.5, 0.0, [0.0, float(period) - 0.1])
    measured = pseudo_periods(chain, path.theta[-1], path.omega[-1])
    np.testing.assert_allclose(measured, period + 0.1, atol=1e-8)


@pytest.mark.parametrize("definition", ["bob", "link", "com"])
def test_a_pivot_that_accelerates_upwards_is_gravity(definition):
    weightless = Chain.uniform(4, gravity=0.0)
    raised = pseudo_periods(weightless, 0.7, definition=definition, pivot_acceleration=(0.0, 9.81))
    at_rest = pseudo_periods(Chain.uniform(4, gravity=9.81), 0.7, definition=definition)
    np.testing.assert_allclose(raised, at_rest, rtol=1e-9)
    falling = pseudo_periods(
        Chain.uniform(4), 0.7, definition=definition, pivot_acceleration=(0, -9.80)
    )
    np.testing.assert_allclose(falling, at_rest * np.sqrt(981.0), rtol=1e-8)


@pytest.mark.parametrize("definition", ["bob", "link", "com"])
def test_a_pivot_that_accelerates_sideways_tilts_where_a_chain_hangs(definition):
    chain = Chain.uniform(2)
    tilt = np.arctan2(1.0, chain.gravity)
    felt = Chain.uniform(2, gravity=np.hypot(1.0, chain.gravity))
    expected = pseudo_periods(felt, tilt, definition=definition)
    for side in (-1.0, 1.0):
        found = pseudo_periods(chain, 0.0, definition=definition, pivot_acceleration=(side, 0.0))
        np.testing.assert_allclose(found, expected, rtol=1e-8 if definition == "link" else 1e-3)


def test_lengths_and_gravity_scale_time():
    base = pseudo_periods(Chain.uniform(4), 0.6)
    scaled = pseudo_periods(Chain.uniform(4, mass=7.0, length=4.0), 0.6)
    np.testing.assert_allclose(scaled, 2.0 * base, rtol=1e-8)


@pytest.mark.parametrize(
    "chain", [Chain.uniform(3, gravity=0.0), Chain.uniform(2, damping=100.0)], ids=["free", "stiff"]
)
def test_a_chain_without_gravity_or_overdamped_never_completes(chain):
    assert np.isnan(pseudo_periods(chain, 0.5)).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"definition": "swing"}, "must be one of bob, link, height, com, horizontal; got 'swing'"),
        ({"definition": "listing"}, "is `listing_periods` in paper/estimator.py"),
        ({"chain": Chain.uniform(2, gravity=0.0), "omega": 1.0}, "duration must be gi"),
        ({"chain": Chain(1.0, [1.0], centres=0.0, inertias=1.0)}, "duration must .* balanced"),
        ({"chain": Chain.uniform(3, stiffness=1e22)}, "rigid rods are the limit of stiff springs"),
        ({"omega": 1e200}, "omega must lie within"),
        ({"theta": np.ones((3, 2)), "omega": np.ones((2, 2))}, "^omega must"),
    ],
)
def test_bad_arguments_are_refused_with_their_rule(change, message):
    with pytest.raises(ValueError, match=message):
        pseudo_periods(**{"chain": Chain.uniform(2), "theta": 0.1} | change)


@pytest.mark.parametrize("definition", ["bob", "link", "height", "com"])
@pytest.mark.parametrize("count", [1, 5, 27])
@pytest.mark.parametrize("chain", [UNEVEN, ON_SPRINGS], ids=["bobs", "springs"])
def test_many_releases_have_the_bits_of_each_alone(chain, definition, count):
    rng = np.random.default_rng(count)
    theta, omega = rng.uniform(-1.2, 1.2, (2, count, chain.n))
    theta[1::3] *= 1.5  # some beyond 90 degrees
    options = {"definition": definition, "duration": 4.0}
    together = pseudo_periods(chain, theta, omega, **options, threads=2)
    assert together.shape == (count, chain.n)
    for k in range(count):
        alone = pseudo_periods(chain, theta[k], omega[k], **options)
        np.testing.assert_array_equal(together[k], alone)


def test_degrees_are_not_taken_for_radians():
    chain = Chain.uniform(7, length=0.3)
    with pytest.raises(ValueError, match=r"60 degrees are 1\.047 rad"):
        pseudo_periods(chain, 60)
    with pytest.raises(ValueError, match="theta must be within 2 pi rad"):
        pseudo_periods(chain, np.full((2, 7), [[0.1], [-45.0]]))
    turned = pseudo_periods(chain, 0.3 + 4.0 * np.pi, 0.01)  # unwrapped, in motion
    np.testing.assert_allclose(turned, pseudo_periods(chain, 0.3, 0.01), rtol=1e-6)
