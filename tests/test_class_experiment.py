"""The experiment for a class: its simulated data, and the analysis that its page shows."""

import re

import ball_chain
import numpy as np
import pytest
from test_docs import ROOT

from npend_gym import pseudo_periods, simulate


@pytest.mark.long
def test_the_force_is_the_rate_of_the_momentum_that_the_sensor_integrates():
    times = 0.3 + 1e-4 * np.arange(-1.0, 2.0)
    motion = simulate(ball_chain.BALLS, 0.8, 0.0, np.concatenate([[0.0], times]))
    velocity = np.tensordot(motion.velocities()[1:], ball_chain.BALLS.masses, ([1], [0]))
    rate = (velocity[2] - velocity[0]) / 2e-4
    weight = np.array([0.0, -ball_chain.BALLS.masses.sum() * ball_chain.BALLS.gravity])
    pull = ball_chain.pull_at_pivot(motion.theta[2], motion.omega[2])
    np.testing.assert_allclose(pull, weight - rate, rtol=2e-3)  # drag is the rest
    still = np.zeros(ball_chain.BALLS.n)
    np.testing.assert_allclose(ball_chain.pull_at_pivot(still, still), weight, atol=1e-15)


def test_no_rod_is_turned_while_the_thread_holds_the_chain():
    chain, theta = ball_chain.BALLS, ball_chain.held_angles()
    x, y = np.sin(theta), -np.cos(theta)
    pull = ball_chain.PULL * np.array([1.0, -1.0]) * [
        np.sin(ball_chain.DIRECTION), np.cos(ball_chain.DIRECTION),
    ]  # fmt: skip
    for i in range(chain.n):
        below = np.array([pull[0], pull[1] - chain.masses[i:].sum() * chain.gravity])
        assert x[i] * below[1] - y[i] * below[0] == pytest.approx(0.0, abs=1e-13)


def test_the_script_writes_the_data_of_the_page(tmp_path):
    ball_chain.main(tmp_path / "a.csv")
    own, there = (
        np.loadtxt(path, delimiter=",", skiprows=1)
        for path in (tmp_path / "a.csv", ROOT / "examples" / "data" / "ball_chain.csv")
    )
    np.testing.assert_allclose(own, there, atol=1.1e-3)  # the last digit


def analysed(folder, seed):
    """Return what the code of the page makes of the data of another class."""
    page = (ROOT / "docs" / "howto" / "class_experiment.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    assert len(code.splitlines()) == 20
    ball_chain.main(folder / "ball_chain.csv", seed)
    names = {"print": lambda *_: None}
    exec(code.replace("examples/data", folder.as_posix()), names)
    return names


@pytest.mark.long
def test_a_class_measures_the_period_to_three_parts_in_a_thousand(tmp_path):
    true = pseudo_periods(ball_chain.BALLS, ball_chain.held_angles(), definition="com")[0]
    names = [analysed(tmp_path, seed) for seed in range(100, 130)]
    errors = np.array([each["mean"] for each in names]) / true - 1.0
    assert 0.001 < np.sqrt(np.mean(errors**2)) < 0.004
    assert abs(errors.mean()) < 0.002
    force = np.interp(true, names[0]["t"], names[0]["f"])
    assert force == pytest.approx(1.25, abs=0.1)


def test_a_wrong_zero_moves_the_period_by_it_times_the_period_over_the_force(tmp_path, monkeypatch):
    for name in ("DRIFT", "NOISE", "TILT"):
        monkeypatch.setattr(ball_chain, name, 0.0)
    clean = analysed(tmp_path, 0)
    offset, shown, calls = 0.01, ball_chain.shown, []

    def drifted(force, rng):
        calls.append(force)
        return shown(force, rng) + offset * (len(calls) > 1)  # the first is at rest

    monkeypatch.setattr(ball_chain, "shown", drifted)
    moved = analysed(tmp_path, 0)["mean"] - clean["mean"]
    force = np.interp(clean["mean"], clean["t"], clean["f"])
    assert moved == pytest.approx(-offset * clean["mean"] / force, rel=0.1)


@pytest.mark.long
def test_angle_length_and_air_change_the_period_as_the_page_says():
    def period(angle, length=0.5, **fluid):
        chain = ball_chain.Chain.spheres(10, 0.010, length / 10, 7800.0, **fluid)
        return pseudo_periods(chain, np.radians(angle), definition="com")[0]

    steel = period(45.0)
    assert period(60.0) / period(20.0) - 1.0 == pytest.approx(0.06, abs=0.005)
    assert period(46.0) / steel - 1.0 == pytest.approx(0.002, abs=0.0005)
    assert period(45.0, length=0.501) / steel - 1.0 == pytest.approx(0.001, abs=0.0001)
    air = {"fluid_density": 1.2, "viscosity": 1.8e-5, "drag_coefficient": 0.4}
    assert abs(period(45.0, **air) / steel - 1.0) < 0.0002
