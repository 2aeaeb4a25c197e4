"""The window to play in, without a display."""

import os
import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest

from npend_gym import Chain, pseudo_periods, simulate
from npend_gym.cli import main
from npend_gym.play import Game, play


@pytest.fixture(autouse=True)
def no_display(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")


@pytest.fixture
def pg():
    import pygame

    return pygame


def key(pg, game, name, kind="KEYDOWN"):
    game.handle(pg.event.Event(getattr(pg, kind), key=getattr(pg, f"K_{name}")))


def run(game, seconds):
    for _ in range(round(seconds / 0.02)):
        game.advance()


def test_left_alone_the_chain_completes_the_pseudo_periods_of_a_release():
    game = Game(3)
    start = game.theta
    assert np.pi / 4 <= start[0] < np.pi / 4 + 0.017
    run(game, 2.0)
    assert not game.periods.any()
    run(game, 3.0)
    expected = pseudo_periods(Chain.uniform(3), start)
    np.testing.assert_allclose(game.periods, expected, atol=1e-4)


def test_the_chain_starts_as_in_an_environment_of_the_same_seed():
    env = gym.make("NPendulum-v0", n=4, mode="passive", amplitude=0.5)
    np.testing.assert_array_equal(Game(4, 0.5, seed=3).theta, env.reset(seed=3)[1]["theta"])


def test_space_pauses_and_continues(pg):
    game = Game(2)
    run(game, 0.2)
    key(pg, game, "SPACE")
    run(game, 1.0)
    assert game.time == pytest.approx(0.2)
    key(pg, game, "SPACE")
    run(game, 0.2)
    assert game.time == pytest.approx(0.4)


def test_arrows_turn_the_chain_at_the_pivot_while_they_are_held(pg):
    game, free = Game(1), Game(1)
    key(pg, game, "RIGHT")
    run(game, 0.3)
    run(free, 0.3)
    assert game.theta[0] > free.theta[0] + 0.1
    key(pg, game, "RIGHT", "KEYUP")
    energy = game.energy
    run(game, 1.0)
    assert game.energy == pytest.approx(energy, rel=1e-4)


def test_after_a_push_the_pseudo_periods_are_those_of_the_free_motion_since(pg):
    game = Game(1)
    run(game, 2.5)
    assert game.periods[0] > 0.0
    key(pg, game, "LEFT")
    run(game, 0.1)
    assert not game.periods.any()
    key(pg, game, "LEFT", "KEYUP")
    theta, omega = game.theta, game.omega
    run(game, 0.02)
    assert game.time == pytest.approx(0.02)
    run(game, 5.0)
    expected = pseudo_periods(Chain.uniform(1), theta, omega)
    np.testing.assert_allclose(game.periods, expected, atol=1e-4)


def test_a_chain_of_links_is_released_and_shown_as_bars(pg):
    game = Game(chain="realaigym A.0", amplitude=1.0)
    key(pg, game, "UP")
    assert game.n == 2  # the number of links is that of the chain
    rods = Game(2).picture()
    run(game, 0.2)
    chain = Chain.realaigym("A.0")
    start = Game(chain=chain, amplitude=1.0).theta
    np.testing.assert_allclose(
        game.theta, simulate(chain, start, 0.0, [0.0, 0.2]).theta[-1], atol=1e-5
    )
    assert game.picture().shape == rods.shape
    run(game, 2.0)
    np.testing.assert_allclose(game.periods, pseudo_periods(chain, start, duration=2.2), atol=1e-4)


@pytest.mark.parametrize("side", [0.7, -0.7])
def test_the_mouse_pulls_the_bob_that_is_nearest(pg, side):
    game = Game(3)
    x, y = game.positions[-1]
    game.handle(pg.event.Event(pg.MOUSEBUTTONDOWN, pos=pixel(game, (x, y)), button=1))
    game.handle(pg.event.Event(pg.MOUSEMOTION, pos=pixel(game, (3.0 * side, -1.5))))
    places = []
    for _ in range(1500):
        game.advance()
        places.append(game.positions[-1, 0])
    assert np.sign(np.mean(places)) == np.sign(side)
    assert abs(np.mean(places)) > 0.5
    game.handle(pg.event.Event(pg.MOUSEBUTTONUP, pos=(0, 0), button=1))
    energy = game.energy
    run(game, 1.0)
    assert game.energy == pytest.approx(energy, rel=1e-3)


def pixel(game, place):
    x, y = np.asarray(place) / game.n * 0.44 * 560
    return round(280 + x), round(280 - y)


def test_a_hand_that_holds_a_bob_where_it_is_exerts_no_torque(pg):
    game = Game(4)
    bob = game.positions[2]
    game.handle(pg.event.Event(pg.MOUSEBUTTONDOWN, pos=pixel(game, bob), button=1))
    game.advance()
    free = Game(4)
    free.advance()
    np.testing.assert_allclose(game.theta, free.theta, atol=1e-4)


def test_keys_change_number_and_amplitude_within_their_limits(pg):
    game = Game(2, 0.2)
    key(pg, game, "UP")
    assert game.n == game.theta.size == 3
    key(pg, game, "PAGEUP")
    assert game.amplitude == pytest.approx(0.2 + np.radians(5.0))
    assert game.theta[0] >= game.amplitude
    for _ in range(50):
        key(pg, game, "DOWN")
        key(pg, game, "PAGEDOWN")
    assert game.n == 1
    assert game.amplitude == pytest.approx(np.radians(5.0))
    for _ in range(50):
        key(pg, game, "PAGEUP")
    assert game.amplitude < np.pi


def test_r_releases_the_chain_again(pg):
    game = Game(2)
    first = game.theta
    run(game, 1.0)
    key(pg, game, "r")
    assert game.time == 0.0
    np.testing.assert_array_equal(game.theta, first)


def test_the_picture_shows_each_completed_bob(pg):
    game = Game(2)
    key(pg, game, "SPACE")

    def blue():
        return (np.abs(game.picture()[:, 560:].astype(int) - (0x00, 0x72, 0xB2)) < 8).all(-1).sum()

    assert game.picture().shape == (560, 880, 3)
    assert blue() == 0
    key(pg, game, "SPACE")
    run(game, 4.0)
    assert blue() > 40


def test_the_window_answers_posted_events_and_closes(pg):
    game = Game(2)
    pg.display.init()
    for event in (
        pg.event.Event(pg.KEYDOWN, key=pg.K_UP),
        pg.event.Event(pg.KEYDOWN, key=pg.K_q),
    ):
        pg.event.post(event)
    play(game)
    assert game.over
    assert game.n == 3
    assert not pg.display.get_init()


def test_closing_the_window_ends_the_game(pg):
    game = Game(1)
    pg.display.init()
    pg.event.post(pg.event.Event(pg.QUIT))
    play(game)
    assert game.over


def test_without_a_display_the_command_says_so():
    code = "from npend_gym.cli import main; raise SystemExit(main(['play']))"
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True, text=True, check=False, timeout=120,
        env=os.environ | {"SDL_VIDEODRIVER": "none"},
    )  # fmt: skip
    assert done.returncode == 1
    assert done.stderr.startswith("npend play: no window can be opened")


@pytest.mark.parametrize("driver", ["offscreen", "dummy"])
def test_a_driver_that_shows_nothing_is_no_display(driver, pg, monkeypatch, capsys):
    monkeypatch.delenv("SDL_VIDEODRIVER")
    monkeypatch.setattr(pg.display, "init", lambda: None)
    monkeypatch.setattr(pg.display, "get_driver", lambda: driver)
    assert main(["play"]) == 1
    error = capsys.readouterr().err
    assert "no window can be opened: there is no display" in error
    assert "npend page" in error


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("--n 0", "n must be between 1 and 200"),
        ("--n 201", "n must be between 1 and 200"),
        ("--amplitude 0", "amplitude must not be 0"),
        ("--amplitude 60", "got 60: 60 degrees are 1.047 rad"),
        ("--amplitude nan", "amplitude must be finite"),
        ("--seed -1", "seed must be at least 0"),
        ("--n 3 --chain acrobot", "n must be left out where chain is given, got 3"),
    ],
)
def test_bad_arguments_of_play_exit_with_2(arguments, message, refusal):
    assert message in refusal("play", *arguments.split())
