"""The front of a release: the singularities of a small one, and its forerunner at finite angles."""

import math

import numpy as np
import pytest
from scripts import run_script

from npend_gym import Chain, theory
from paper.period import front


@pytest.mark.parametrize("x", [0.36, 0.6, 0.81])
def test_the_free_end_turns_a_jump_into_a_logarithm_and_back(x):
    near, far = front.beside_the_front(x, 1e-3), front.beside_the_front(x, 1e-2)
    strength = 1.0 / math.sqrt(x)
    down, up, again, last = range(4)
    for passage in (down, last):
        assert near[passage, 1] - near[passage, 0] == pytest.approx(strength, abs=0.01)
    for passage, sign in ((up, 1.0), (again, -1.0)):
        grown = near[passage].mean() - far[passage].mean()
        assert grown == pytest.approx(sign * strength / math.pi * math.log(10.0), abs=2e-3)
        assert near[passage, 0] == pytest.approx(near[passage, 1], abs=0.02)  # no jump
    assert front.acceleration(x, 0.9 * (1.0 - x)) == pytest.approx(-1.0, abs=1e-4)  # free fall
    assert front.acceleration(x, 0.5 * (1.0 - x), modes=20) == pytest.approx(-1.0, abs=0.1)


def test_the_acceleration_is_the_change_of_the_velocity_of_many_rods():
    n, x, tau, step = 400, 0.6, 1.3, 0.01
    chain = Chain.uniform(n)
    omega, modes = theory.normal_modes(chain)
    angles = modes * ((chain.lift @ modes) / (chain.lift @ modes**2))
    bob = round(n - 0.5 - x**2 * (n + 0.5))
    t = 2.0 * np.sqrt((n + 0.5) / chain.gravity) * (tau + step * np.array([-1.0, 1.0]))
    place = np.cumsum(angles, axis=0)[bob]
    velocity = -np.sin(np.outer(t, omega)) @ (place * omega)
    change = (velocity[1] - velocity[0]) / (t[1] - t[0]) / chain.gravity
    assert front.acceleration(x, tau) == pytest.approx(change, abs=0.02)


def test_the_angle_of_the_free_end_grows_without_bound_where_the_front_arrives():
    assert front.acceleration(0.0, 0.9, modes=200_000) == pytest.approx(-1.0, abs=1e-3)
    for delta in (1e-2, 1e-3):
        found = float(front.acceleration(0.0, 1.0 + delta, modes=1_000_000))
        assert found == pytest.approx(math.sqrt(2.0 / delta), rel=3.0 * math.sqrt(delta))


@pytest.mark.long
def test_a_simulated_small_release_has_the_acceleration_of_the_sum():
    (found,) = front.measured(800, 0.02, (0.6,))
    at = np.array([-0.6, -0.4, -0.2])
    small = front.acceleration(found.x, 1.0 + found.x + at)
    assert np.interp(at, found.delta, found.values) == pytest.approx(small, abs=0.02)


def test_the_forerunner_follows_the_logarithm_far_from_the_front_and_is_bounded_near_it():
    for a in (0.25, 0.3):
        far, near, nearest = front.kept_at(a, 0.6).core([-4.0, -0.5, -0.3])
        assert far == pytest.approx(-math.log(4.0), abs=0.15)
        assert -0.5 < near < nearest < -0.2  # the logarithm is 0.69 and 1.20
    widest = [one.tip for one in front.kept() if one.amplitude > 0.35]
    assert max(widest) - min(widest) < 0.05


def test_the_kept_file_has_a_row_for_each_place(tmp_path):
    run_script(front.FILE.with_name("front.py"), tmp_path / "front.csv", "100:0.4", cwd=tmp_path)
    lines = (tmp_path / "front.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0] == front.FILE.read_text(encoding="utf-8").splitlines()[0]
    assert [line.split(",")[0] for line in lines[1:]] == ["100"] * len(front.PLACES)


@pytest.mark.long
@pytest.mark.nightly
def test_the_kept_accelerations_are_those_that_are_measured_now():
    for found in front.measured(1600, 0.5):
        kept = front.kept_at(0.5, found.x)
        assert found.values == pytest.approx(kept.values, abs=1e-3)
        assert found.tip == pytest.approx(kept.tip, abs=1e-3)
