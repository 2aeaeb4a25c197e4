"""What an upright chain demands: closed forms, Riccati's equation by SciPy, and simulations."""

import importlib
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm, solve_continuous_are, solve_discrete_are
from scipy.special import roots_laguerre

from npend_gym import Cart, Chain, theory
from npend_gym.physics import linearise
from npend_gym.theory.unstable_modes import _count_unstable, with_lag

RESULTS = Path(__file__).parent.parent / "docs" / "results" / "hardness.csv"
LIMITS = ("noise", "resolution", "delay", "lag")
BY_CART = Chain.rods(0.1, 1.0, gravity=9.8, base=Cart(1.0))


def upright(chain):
    return linearise(chain, np.pi, joints=(0,) if chain.base is None else ())


def held(a, b, duration):
    block = np.zeros((len(a) + 1,) * 2)
    block[:-1] = np.hstack([a, b])
    moved = expm(block * duration)
    return moved[:-1, :-1], moved[:-1, -1:]


def test_the_pole_of_one_rod_is_the_root_of_g_over_l_and_the_delay_root_two_over_it():
    found = theory.hardness(*upright(Chain.uniform(1, length=0.7)), limit=3.0)
    p = math.sqrt(9.81 / 0.7)
    assert found.poles == pytest.approx([p], rel=1e-12)
    assert found.static_delay == pytest.approx(math.sqrt(2.0) / p, rel=1e-3)
    assert found.bits_per_second == pytest.approx(p / math.log(2.0))
    assert found.pole_product == pytest.approx(p)
    assert found.peak_sensitivity(math.pi * p) == pytest.approx(math.e)
    assert found.peak_sensitivity(1e-3) == math.inf  # exp(11 000)
    assert found.resolution == pytest.approx(found.noise * math.sqrt(12.0))


def test_the_pole_of_a_cartpole_is_that_of_the_textbook():
    # x'' (M + m) - m l theta'' = F, theta'' (I + m l^2) - m l x'' = m g l theta
    m, cart, half, gravity = 0.1, 1.0, 0.5, 9.8
    about_end = m * half**2 * 4.0 / 3.0
    lifted = (m + cart) * m * gravity * half
    square = lifted / ((m + cart) * about_end - (m * half) ** 2)
    poles = theory.hardness(*upright(BY_CART), limit=10.0).poles
    assert poles == pytest.approx([math.sqrt(square)], rel=1e-7)  # beside the double zero


def test_the_poles_of_ten_equal_rods_are_the_roots_of_laguerres_polynomial():
    mpmath = pytest.importorskip("mpmath", reason="mpmath is not installed")
    with mpmath.workdps(50):
        exact = [
            float(mpmath.sqrt(mpmath.mpf("9.81") * mpmath.findroot(
                lambda x: mpmath.laguerre(10, 0, x), start
            )))
            for start in roots_laguerre(10)[0]
        ]  # fmt: skip
    poles = theory.hardness(*upright(Chain.uniform(10)), limit=100.0).poles
    np.testing.assert_allclose(poles, exact, rtol=1e-11)
    np.testing.assert_allclose(poles, theory.normal_modes(Chain.uniform(10))[0], rtol=1e-11)


def test_no_slow_pole_is_lost_to_damping_or_to_the_lag_of_a_fast_motor():
    a, b = upright(Chain.uniform(3, damping=100.0))
    poles = theory.hardness(a, b, limit=30.0, dt=0.5, seconds=2000.0).poles
    np.testing.assert_allclose(poles, np.sort(np.linalg.eigvals(a).real)[-3:], rtol=1e-9)
    a, b = upright(Chain.uniform(2))
    expected = theory.least_action(a, b, limit=14.715).noise
    for lag in (1e-3, 3e-5, 1e-6, 1e-12):
        found = theory.least_action(a, b, limit=14.715, lag=lag).noise
        assert found == pytest.approx(expected, rel=10.0 * lag + 1e-9)


def test_zeros_of_a_cart_are_no_poles_in_any_coordinates():
    rng = np.random.default_rng(0)
    for theta, count in ((np.pi, 4), (0.0, 0)):
        a, _ = linearise(Chain.uniform(4, base=Cart(1.0)), theta)
        for _ in range(10):
            turned = rng.normal(size=a.shape)
            assert _count_unstable(np.linalg.solve(turned, a @ turned)) == count


@pytest.mark.parametrize(
    "chain", [Chain.uniform(1), Chain.uniform(2), Chain.uniform(3, damping=0.3)]
)
def test_the_least_action_and_its_gains_solve_riccatis_equations(chain):
    limit, dt, delay = 3.0, 0.02, 0.05
    a, b = upright(chain)
    found = theory.least_action(a, b, limit=limit, dt=dt, delay=delay)
    step, drive = held(a, limit * b, dt)
    n, size = chain.n, 2 * chain.n
    outputs = np.eye(n, size)
    tiny = 1e-13 * np.eye(size)
    cost = solve_discrete_are(step, drive, tiny, np.eye(1))
    gain = np.linalg.solve(1.0 + drive.T @ cost @ drive, drive.T @ cost @ step)
    prior = solve_discrete_are(step.T, outputs.T, tiny, np.eye(n))
    seen = outputs @ prior @ outputs.T + np.eye(n)
    estimator = prior @ outputs.T @ np.linalg.inv(seen)
    late = held(a, b, delay)[0] @ estimator
    np.testing.assert_allclose(found.feedback, gain[0], rtol=1e-3, atol=1e-5)
    np.testing.assert_allclose(found.estimator, estimator, rtol=1e-3, atol=1e-5)
    square = np.trace(cost @ late @ seen @ late.T)
    assert found.mean_square == pytest.approx(square, rel=1e-3)


def survivors(chain, limit, share, delay_steps=0, lag=0.0, lanes=200, dt=0.02):
    """Return how many of the linear systems last for 20 s with a share of the largest noise."""
    a, b = upright(chain)
    found = theory.least_action(a, b, limit=limit, dt=dt, delay=delay_steps * dt, lag=lag)
    step, drive = held(*with_lag(a, limit * b, lag), dt)
    rng, m = np.random.default_rng(3), len(a) // 2
    state, estimate = np.zeros((2, lanes, len(step)))
    actions = [np.zeros(lanes)] * (delay_steps + 1)
    for _ in range(1000):
        measured = state[:, :m] + share * found.noise * rng.normal(size=(lanes, m))
        estimate = estimate + (measured - estimate[:, :m]) @ found.estimator.T
        ahead = estimate
        for action in actions[1:]:
            ahead = ahead @ step.T + np.outer(action, drive[:, 0])
        actions = [*actions[1:], np.clip(-ahead @ found.feedback, -1.0, 1.0)]
        state, estimate = (
            each @ step.T + np.outer(actions[0], drive[:, 0]) for each in (state, estimate)
        )
    return float(np.mean(np.abs(state[:, :m]).max(axis=1) < 10.0))


@pytest.mark.parametrize(
    ("n", "more"), [(1, {}), (2, {"lag": 0.3}), (3, {"delay_steps": 5}), (5, {}), (8, {})]
)
def test_half_of_the_linear_systems_survive_the_largest_noise(n, more):
    chain, limit = Chain.uniform(n), 0.01
    assert survivors(chain, limit, 0.85, **more) > 0.6
    assert survivors(chain, limit, 1.2, **more) < 0.35


@pytest.mark.parametrize("n", [1, pytest.param(2, marks=pytest.mark.long)])
def test_bodes_integral_of_an_lqg_loop_is_pi_times_the_sum_of_its_unstable_poles(n):
    a, b = upright(Chain.uniform(n))
    c = np.eye(1, 2 * n)  # the angle of the first rod
    weight, one = np.eye(2 * n), np.eye(1)
    gain = b.T @ solve_continuous_are(a, b, weight, one)
    estimator = solve_continuous_are(a.T, c.T, weight, one) @ c.T
    inner = a - b @ gain - estimator @ c
    of_controller = np.linalg.eigvals(inner)
    found = theory.hardness(a, b, limit=10.0)
    unstable = found.pole_sum + of_controller.real[of_controller.real > 0.0].sum()
    omega = np.geomspace(1e-4, 1e6, 40001)
    s = 1j * omega[:, None, None]
    loop = gain @ np.linalg.solve(
        s * np.eye(2 * n) - inner, np.broadcast_to(estimator, (40001, 2 * n, 1))
    )
    loop = loop * (
        c @ np.linalg.solve(s * np.eye(2 * n) - a, np.broadcast_to(b, (40001, 2 * n, 1)))
    )
    log_s = -np.log(np.abs(1.0 + loop[:, 0, 0]))
    integral = np.sum(0.5 * (log_s[1:] + log_s[:-1]) * np.diff(omega)) + log_s[0] * omega[0]
    assert integral == pytest.approx(math.pi * unstable, rel=2e-3)


def rightmost_root(poles, delay, gains):
    """Return the largest real part of the roots of d(s) + k(s) exp(-s delay), by collocation."""
    size = len(poles)
    d = np.poly(poles)
    companion, delayed = np.eye(size, k=1), np.zeros((size, size))
    companion[-1], delayed[-1] = -d[:0:-1], -gains[::-1]
    nodes = 24
    x = np.cos(np.pi * np.arange(nodes + 1) / nodes)
    c = np.r_[2.0, np.ones(nodes - 1), 2.0] * (-1.0) ** np.arange(nodes + 1)
    gaps = x[:, None] - x + np.eye(nodes + 1)
    derivative = np.outer(c, 1.0 / c) / gaps
    derivative -= np.diag(derivative.sum(axis=1))
    whole = np.kron(derivative * 2.0 / delay, np.eye(size))
    whole[:size] = 0.0
    whole[:size, :size], whole[:size, -size:] = companion, delayed
    return np.linalg.eigvals(whole).real.max()


@pytest.mark.long
@pytest.mark.parametrize("n", [1, 2])
def test_a_feedback_of_the_delayed_state_exists_below_the_static_delay(n):
    limit = theory.hardness(*upright(Chain.uniform(n)), limit=10.0).static_delay
    positive = theory.normal_modes(Chain.uniform(n))[0]
    poles, order = np.concatenate([positive, -positive]), 2 * n
    d = np.poly1d(np.poly(poles))
    for share, stable in ((0.9, True), (1.1, False)):
        delay = share * limit
        # derivative number `order` of d(s) exp(s delay), over exp(s delay)
        bent = sum(
            math.comb(order, j) * delay ** (order - j) * d.deriv(j) for j in range(order + 1)
        )
        centre = max((r.real for r in bent.roots if abs(r.imag) < 1e-9), default=0.0)
        k = np.poly1d([0.0])
        for degree in range(order):  # minus Taylor's polynomial of d(s) exp(s delay) about `centre`
            value = sum(
                math.comb(degree, j) * delay ** (degree - j) * d.deriv(j)(centre)
                for j in range(degree + 1)
            )
            k -= value / math.factorial(degree) * np.poly1d([1.0, -centre]) ** degree
        gains = math.exp(centre * delay) * np.r_[np.zeros(order - 1 - k.order), k.coeffs]
        assert (rightmost_root(poles, delay, gains) < 0.0) == stable


def test_arguments_that_break_a_rule_are_named():
    a, b = upright(Chain.uniform(2))
    for wrong, name in (
        (lambda: theory.hardness(*linearise(Chain.uniform(2), 0.0)), "unstable poles"),
        (lambda: theory.hardness(a[:3], b), "a must have the shape"),
        (lambda: theory.hardness(a[:0, :0], b[:0]), "a must have the shape"),
        (lambda: theory.hardness(a, b, dt=200.0), "dt and delay must be short"),
        (lambda: theory.least_action(a, b, dt=60.0), "dt and delay must be short"),
        (lambda: theory.least_action(a, b, delay=200.0), "dt and delay must be short"),
        (lambda: theory.hardness(a, b[:, 0]), "b must have the shape"),
        (lambda: theory.hardness(a, 0.0 * b), "b must drive"),
        (lambda: theory.hardness(a, b, share=1.0), "share must be between"),
        (lambda: theory.hardness(a, b, share=1e-12), "share must be larger"),
        (lambda: theory.least_action(a, b, seconds=0.1), "seconds must be"),
        (lambda: theory.least_action(a, b, limit=0.0), "limit must be"),
        (lambda: theory.least_action(a, b, delay=-1.0), "delay must be"),
    ):
        with pytest.raises(ValueError, match=name):
            wrong()


@pytest.fixture
def study():
    """The script that measures in the environment."""
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    return importlib.import_module("hardness")


@pytest.mark.long
@pytest.mark.parametrize("base", ["pivot", "cart"])
def test_an_upright_chain_with_a_weak_motor_survives_what_the_theory_says(study, base):
    found, keywords = study.theory_of(base, 2), study.env_of(base, 2, "weak")
    noise = study.MOTORS["weak"] * found.noise
    for share, enough in ((0.8, True), (1.25, False)):
        lasting = study.survivors(keywords, {"noise": share * noise}, 32)
        assert (lasting >= 0.5) == enough


@pytest.mark.long
def test_the_page_shows_what_was_measured(study):
    rows = study.read_rows(RESULTS)
    assert {study.of_row(row) for row in rows} == set(study.cells())
    assert study.table(rows) in study.PAGE.read_text(encoding="utf-8")
    assert len(study.figure(rows).axes) == 2
    for row in rows:
        if int(row["rods"]) == 4 and row["motor"] == "task":
            expected = getattr(study.theory_of(row["base"], 4), row["quantity"])
            assert float(row["theory"]) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("factor", [0.05, 0.4, 1.0, 1.9, 2.1, 30.0])
def test_halving_finds_a_factor_on_either_side_of_the_theory(study, factor):
    found = study.found_by_halving(lambda tried: float(tried <= factor))
    assert found == pytest.approx(factor, rel=0.03)


def test_halving_ends_where_all_or_none_survive(study):
    assert study.found_by_halving(lambda _: 0.0) == 0.0
    with pytest.raises(ValueError, match="half of the episodes last at 1000 times the theory"):
        study.found_by_halving(lambda _: 1.0)


def test_nothing_is_published_where_rows_are_missing(study, tmp_path, monkeypatch):
    monkeypatch.setattr(study, "DOCS", tmp_path)
    with pytest.raises(SystemExit, match="1 cells must be measured first, such as"):
        study.publish(study.read_rows(RESULTS)[:-1])
    assert not list(tmp_path.iterdir())


def test_theory_and_measurement_agree_with_a_weak_motor(study):
    rows = [row for row in study.read_rows(RESULTS) if row["motor"] != "task"]
    of = {name: [float(row["ratio"]) for row in rows if row["quantity"] == name] for name in LIMITS}
    for name, ratios in of.items():
        apart = [ratio for ratio in ratios if abs(ratio - 1.0) > 0.2]
        assert len(ratios) == 20
        assert len(apart) == {"resolution": 2, "lag": 1}.get(name, 0)  # as the page says
