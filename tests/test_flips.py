"""When a rod first turns over, alone and as a map."""

import json

import numpy as np
import pytest

from npend_gym import Chain, Event, simulate
from npend_gym.chaos import flip_times
from npend_gym.cli import main
from npend_gym.experiments import FlipMap

pytestmark = pytest.mark.long  # a kernel is compiled

DOUBLE = Chain([1.0, 1.0], [1.0, 1.0])


def test_a_single_rod_turns_over_when_the_elliptic_integral_says():
    from scipy.special import ellipkinc

    # energy above upright: t = int_0^pi dtheta / omega(theta)
    omega = 7.0
    modulus = 4.0 * 9.81 / omega**2
    expected = 2.0 / omega * ellipkinc(0.5 * np.pi, modulus)
    found = flip_times(Chain([1.0], [1.0]), 0.0, omega, duration=5.0, rtol=1e-12)
    assert found.shape == ()
    assert found == pytest.approx(expected, abs=1e-10)
    just_below = np.sqrt(4.0 * 9.81) * (1.0 - 1e-9)
    assert np.isnan(flip_times(Chain([1.0], [1.0]), 0.0, just_below, duration=5.0))


def test_flips_are_events_of_motions_followed_one_by_one():
    starts = np.random.default_rng(3).uniform(-np.pi, np.pi, (40, 2))
    found = flip_times(DOUBLE, starts, duration=6.0, rtol=1e-11)
    for start, instant in zip(starts, found, strict=True):
        motion = simulate(
            DOUBLE, start, 0.0, [0.0, 6.0], rtol=1e-11, atol=1e-13,
            events=[Event("flip", 0), Event("flip", 1)],
        )  # fmt: skip
        first = min((float(each[0]) for each in motion.t_events if each.size), default=np.nan)
        np.testing.assert_allclose(instant, first, atol=1e-6)
    assert 10 < np.isfinite(found).sum() < 40


def test_flips_depend_on_no_neighbour_and_no_threads():
    starts = np.random.default_rng(4).uniform(-np.pi, np.pi, (5, 9, 2))
    found = flip_times(DOUBLE, starts, duration=3.0)
    assert found.shape == (5, 9)
    np.testing.assert_array_equal(flip_times(DOUBLE, starts, duration=3.0, threads=3), found)
    np.testing.assert_array_equal(flip_times(DOUBLE, starts[2, 3], duration=3.0), found[2, 3])
    np.testing.assert_allclose(flip_times(DOUBLE, -starts, duration=3.0), found, rtol=1e-13)
    assert flip_times(DOUBLE, [4.0, 0.0], duration=3.0) == 0.0


def test_a_map_within_a_half_turn_releases_from_its_axes(tmp_path):
    plan = FlipMap(size=12, width=6.0, duration=3.0)
    first, second = plan.axes()
    starts = np.stack(np.broadcast_arrays(first, second[:, None]), axis=-1)
    expected = flip_times(plan.chain, starts, duration=3.0, rtol=plan.rtol)
    np.testing.assert_array_equal(plan.run(tmp_path), expected)


def test_the_command_draws_the_map_with_axes_and_a_scale(tmp_path, capsys):
    image = pytest.importorskip("matplotlib.image")
    arguments = ["chaos", "map", "--size", "20", "--duration", "2", "--out", str(tmp_path / "a")]
    assert main(arguments) == 0
    assert "map.png" in capsys.readouterr().out
    assert image.imread(tmp_path / "a" / "map.png").shape[:2] == (833, 966)
    with np.load(tmp_path / "a" / "map.npz") as data:
        assert json.loads(str(data["about"]))["arguments"]["size"] == 20
        assert data["first"][0] == pytest.approx(-np.pi * 19 / 20)
    with pytest.raises(SystemExit, match="2"):
        main([*arguments, "--centre", "3,3", "--width", "9"])
    assert "centre and width must keep" in capsys.readouterr().err


def test_each_start_of_the_map_is_a_pixel_at_its_angles():
    pytest.importorskip("matplotlib")
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    from npend_gym.report.flip_map_figure import flip_map_figure

    plan = FlipMap(size=1000, centre=(0.5, -0.25), width=1.0, duration=10.0)
    times = np.full((1000, 1000), 10.0)
    times[100, 200] = 0.1  # bright, second angle -0.65, first 0.2
    times[300, 400] = np.nan
    figure = flip_map_figure(plan, times)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())[..., :3].astype(int)
    yellow = (pixels[..., 0] > 200) & (pixels[..., 2] < pixels[..., 0] - 60)
    (bright,) = np.argwhere(yellow[:, :1100])
    x, y = figure.axes[0].transData.inverted().transform((bright[1] + 0.5, 1190 - bright[0] - 0.5))
    assert (x, y) == pytest.approx(np.degrees([0.2005, -0.6495]), abs=1e-3)
    assert figure.axes[0].get_xlim() == pytest.approx(np.degrees([0.0, 1.0]))
    assert figure.axes[1].get_ylabel() == "time [s]"
