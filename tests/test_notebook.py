"""What motions and chains show of themselves in notebooks."""

import base64
import html
import io
import json
import re

import numpy as np
import pytest
from accessibility import grave_findings
from conftest import wait_for
from PIL import Image

from npend_gym import Cart, Chain, Event, simulate
from npend_gym._palette import distinct, rgb
from npend_gym.physics.energy import potential_energy


@pytest.fixture(scope="module")
def motion():
    return simulate(Chain([1.0, 0.5, 0.5], [1.0, 0.7, 0.4]), 1.0, 0.0, np.linspace(2.0, 5.0, 301))


def document_of(shown):
    return html.unescape(re.search(r'srcdoc="(.*?)"', shown, re.DOTALL)[1])


def data_of(shown):
    text = re.search(r'id="data">(.*?)</script>', document_of(shown))[1]
    return json.loads(text)["releases"]


def test_a_motion_shows_itself_in_a_player_at_the_places_where_it_is(motion):
    (shown,) = data_of(motion._repr_html_())
    places = np.frombuffer(base64.b64decode(shown["places"]), "<f4").reshape(-1, 3, 2)
    times = shown["interval"] * np.arange(len(places))
    assert times[-1] == pytest.approx(3.0)
    for bob in range(3):
        for axis in (0, 1):
            expected = np.interp(times, motion.times - 2.0, motion.positions()[:, bob, axis])
            np.testing.assert_allclose(2.1 * places[:, bob, axis], expected, atol=2e-4)


def test_the_player_fetches_nothing_and_is_shut_off(motion):
    shown = motion._repr_html_()
    assert not re.search(r'(src|href)="(?!data:)', document_of(shown))
    assert "default-src 'none'" in document_of(shown)
    assert 'sandbox="allow-scripts"' in shown
    assert len(shown) < 60_000


def test_of_many_motions_the_first_are_to_choose_from():
    start = np.linspace(0.1, 1.0, 24).reshape(12, 2)
    many = simulate(Chain.uniform(2), start, 0.0, np.linspace(0.0, 1.0, 26))
    shown = data_of(many._repr_html_())
    assert [one["label"] for one in shown] == [f"{k}: 2 pendulums" for k in range(8)]
    first = np.frombuffer(base64.b64decode(shown[5]["places"]), "<f4")[:4].reshape(2, 2)
    np.testing.assert_allclose(2.0 * first, many[5].positions()[0], atol=2e-4)


KINDS = {
    "points": Chain.uniform(2),
    "links on a cart": Chain.rods([1.0, 0.5], [0.6, 0.4], base=Cart(2.0)),
    "springs": Chain.uniform(2, stiffness=300.0),
    "chains that differ": [Chain.uniform(2, length=length) for length in (0.5, 1.0, 1.5)],
}


OF_EACH_KIND = pytest.mark.parametrize(
    "chain",
    [  # kernels of the others take long to compile
        pytest.param(
            chain, id=kind, marks=[pytest.mark.long] * (kind in ("springs", "links on a cart"))
        )
        for kind, chain in KINDS.items()
    ],
)


@OF_EACH_KIND
def test_motions_are_plotted_together_in_colours_of_their_own(chain):
    import matplotlib.pyplot as plt

    many = simulate(chain, [[0.2, 0.1], [0.4, 0.1], [0.5, 0.0]], 0.0, np.linspace(0.0, 1.0, 26))
    axes = many.plot()
    rows = many.theta[..., -1], many.omega[..., -1], many.energy()
    for ax, values in zip(axes, rows, strict=True):
        for line, expected in zip(ax.lines, values, strict=True):
            np.testing.assert_array_equal(line.get_xydata(), np.stack([many.times, expected], 1))
        assert len({line.get_color() for line in ax.lines}) == 3
    plt.close(axes[0].figure)


@OF_EACH_KIND
def test_motions_are_filmed_together_each_where_it_is_alone(chain):
    starts, times = np.array([[0.2, 0.1], [-1.4, 0.1], [1.5, 0.0]]), np.linspace(0.0, 1.0, 26)
    many = simulate(chain, starts, 0.0, times)
    film = many.animate(size=240)
    scene, picture = film.scene(20), film.picture(20)
    shown = [scene, *scene.beside[::-1]]
    for k, (one, color) in enumerate(zip(shown, distinct(3), strict=True)):
        own = many[k].animate(size=240).scene(20)
        np.testing.assert_array_equal(one.positions, own.positions)
        assert (one.color, one.cart, one.time) == (color, own.cart, own.time)
        assert (picture == rgb(color)).all(axis=2).sum() > 30  # its bobs or links
    assert scene.reach == max(many[k].animate(size=240).reach for k in range(3))
    assert film.recording.caption == "n = 2"
    assert many.animate(size=120, diagrams=True).picture(20).shape == (120, 240, 3)


def test_a_motion_that_ends_before_others_stays_where_it_ended(tmp_path):
    event = Event("angle", 0, terminal=True)
    starts, times = [[0.2, 0.1], [0.0, 0.0]], np.linspace(0.0, 2.0, 51)
    many = simulate(Chain.uniform(2), starts, 0.0, times, events=event)
    assert many.status.tolist() == [1, 0]
    film = many.animate(tmp_path / "two.gif", size=120)
    assert len(film) == 51
    np.testing.assert_array_equal(film.scene(50).positions, many[0].positions()[-1])
    assert film.scene(50).time == 2.0


def test_colours_are_distinct():
    for count in (1, 6, 7, 10, 50):
        assert len(set(distinct(count))) == count


def test_a_long_chain_is_shown_within_a_megabyte():
    chain = Chain.uniform(1000)
    motion = simulate(chain, 0.1, 0.0, np.linspace(0.0, 0.2, 101))
    (shown,) = data_of(motion._repr_html_())
    assert shown["n"] == 200
    last = np.frombuffer(base64.b64decode(shown["places"]), "<f4").reshape(-1, 200, 2)[-1, -1]
    np.testing.assert_allclose(1000.0 * last, motion.positions()[-1, -1], atol=0.1)
    assert len(motion._repr_html_()) < 1e6


@pytest.mark.long
def test_the_player_plays_in_a_browser(open_page, motion, tmp_path):
    path = tmp_path / "notebook.html"
    path.write_text(f"<!doctype html><title>cell</title>{motion._repr_html_()}", "utf-8")
    tab = open_page(path)
    frame = tab.frame_locator("iframe")
    assert frame.locator("#clock").inner_text() == "0.00 of 3.00 s"
    assert frame.locator("#chain").get_attribute("aria-label") == "Animation of 0: 3 pendulums"
    frame.locator("#play").click()
    wait_for(tab, lambda: frame.locator("#clock").inner_text() > "0.30")
    frame.locator("#play").click()
    assert "0.30" < frame.locator("#clock").inner_text() < "3"


@pytest.mark.long
def test_the_player_is_accessible(open_page, motion, tmp_path):
    pytest.importorskip("axe_playwright_python", reason="axe is not installed")
    path = tmp_path / "player.html"
    path.write_text(document_of(motion._repr_html_()), "utf-8")
    for scheme in ("light", "dark"):
        assert grave_findings(open_page(path, color_scheme=scheme)) == []


def test_a_motion_is_plotted_as_it_was_computed(motion):
    import matplotlib.pyplot as plt

    axes = motion.plot()
    for ax, values in zip(axes, (motion.theta, motion.omega), strict=False):
        for line, expected in zip(ax.lines, values.T, strict=True):
            np.testing.assert_array_equal(line.get_xdata(), motion.times)
            np.testing.assert_array_equal(line.get_ydata(), expected)
    energy, kinetic, potential = (line.get_ydata() for line in axes[2].lines)
    np.testing.assert_array_equal(energy, motion.energy())
    np.testing.assert_allclose(potential, potential_energy(motion.chain, motion.theta), atol=1e-9)
    np.testing.assert_array_equal(kinetic, motion.kinetic_energy())
    plt.close(axes[0].figure)


@pytest.mark.parametrize("n", [2, 7, 12])
def test_rods_of_a_plot_look_different_and_its_legends_cover_no_line(n):
    import matplotlib.pyplot as plt
    from matplotlib.colors import to_hex

    axes = simulate(Chain.uniform(n), 1.0, 0.0, np.linspace(0.0, 2.0, 21)).plot()
    figure = axes[0].figure
    colors = {to_hex(line.get_color()) for line in axes[0].lines}
    assert len(colors) == n
    figure.canvas.draw()
    assert all(ax.get_legend() is None for ax in axes)
    for legend in figure.legends:
        assert not any(legend.get_window_extent().overlaps(ax.get_window_extent()) for ax in axes)
    names = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    assert ("rod 1" in names and "rod 0" not in names) == (n <= 10)
    plt.close(figure)


def test_a_plot_shows_the_energy_of_a_counterweight():
    import matplotlib.pyplot as plt

    chain = Chain([1.0], [1.0], centres=[-0.2], inertias=[0.1])
    shown = simulate(chain, 1.0, 0.0, np.linspace(0.0, 1.0, 21))
    axes = shown.plot()[2]
    assert axes.get_ylim()[0] <= shown.energy().min() < 0.0
    plt.close(axes.figure)


def test_a_motion_is_filmed(motion, tmp_path):
    film = motion.animate(tmp_path / "chain.gif", fps=10.0, size=120)
    assert len(film) == 31
    shown = base64.b64decode(re.search(r"base64,(.*?)\"", film._repr_html_())[1])
    for file in (tmp_path / "chain.gif", io.BytesIO(shown)):
        with Image.open(file) as pictures:
            assert (pictures.size, pictures.n_frames) == ((120, 120), 31)
    with pytest.raises(ValueError, match=r"must be one of \.gif, \.mp4"):
        motion.animate(tmp_path / "chain.webm")
    with pytest.raises(TypeError, match="path must be a string or path-like, got 3"):
        motion.animate(3)


@pytest.mark.parametrize(("fps", "pictures"), [(60.0, 91), (100.0, 151), (240.0, 144)])
def test_a_film_of_many_pictures_a_second_plays_at_its_speed_in_a_notebook(motion, fps, pictures):
    film = motion.animate(fps=fps, size=120)
    shown = base64.b64decode(re.search(r"base64,(.*?)\"", film._repr_html_())[1])
    delays = []
    with Image.open(io.BytesIO(shown)) as image:
        for k in range(image.n_frames):
            image.seek(k)
            delays.append(image.info["duration"])
    assert len(film) == pytest.approx(3.0 * fps, abs=1)
    assert len(delays) == pytest.approx(pictures, abs=1)
    assert min(delays) >= 20  # browsers slow down shorter ones
    assert sum(delays) == pytest.approx(3000.0, abs=40.0)


def test_one_pendulum_is_not_called_pendulums():
    shown = simulate(Chain.uniform(1), 1.0, 0.0, [0.0, 1.0])._repr_html_()
    assert 'title="Motion of 1 pendulum"' in shown
    assert [one["label"] for one in data_of(shown)] == ["0: 1 pendulum"]


def test_a_chain_draws_itself_to_scale_with_its_data():
    chain = Chain([4.0, 1.0, 1.0], [1.0, 0.5, 0.25], gravity=1.62)
    shown = chain._repr_html_()
    rods = np.array(re.findall(r'x1="(.*?)" y1="(.*?)" x2="(.*?)" y2="(.*?)"', shown), float)
    drawn = np.hypot(*(rods[:, 2:] - rods[:, :2]).T)
    np.testing.assert_allclose(drawn / drawn[0], chain.lengths, rtol=2e-3)
    radii = np.array(re.findall(r' r="(.*?)"', shown), float)[:3]
    np.testing.assert_allclose(radii**2 / radii[0] ** 2, [1.0, 0.25, 0.25], atol=0.01)
    cells = re.findall(r"<td>(.*?)</td>", shown)
    assert cells == ["4", "1", "1", "0.5", "1", "0.25"]
    assert "gravity 1.62 m/s^2" in shown
    sprung = Chain([4.0, 1.0], [1.0, 0.5], stiffness=500.0, base=Cart(2.0))._repr_html_()
    assert "on a cart of 2 kg" in sprung
    assert "<th>stiffness [N/m]</th>" in sprung


@pytest.mark.parametrize("chain", [Chain.uniform(1), Chain.uniform(1000), Chain.realaigym("C.1")])
def test_any_chain_draws_itself_within_its_frame(chain):
    shown = chain._repr_html_()
    width, height = map(float, re.search(r'viewBox="0 0 (\S+) (\S+)"', shown).groups())
    for name, limit in (("cx", width), ("cy", height), ("x1", width), ("y2", height)):
        values = np.array(re.findall(rf'{name}="(.*?)"', shown), float)
        assert np.all((values > 0.0) & (values < limit))
    assert shown.count("<circle") <= 202
    assert len(shown) < 60_000


def test_a_motion_on_a_cart_is_played_with_the_cart():
    chain, times = Chain.rods([0.1, 0.2], [0.3, 0.3], base=Cart(0.2)), np.linspace(0.0, 2.0, 51)
    motion = simulate(chain, 2.0, 0.0, times, position=0.3, velocity=1.0)
    (data,) = data_of(motion._repr_html_())
    places = np.frombuffer(base64.b64decode(data["places"]), "<f4").reshape(51, 3, 2)
    assert data["onCart"]
    assert data["n"] == 2
    size = max(chain.total_length, np.hypot(*motion.positions().T).max())
    np.testing.assert_allclose(places[:, 0, 0] * size, motion.position, atol=1e-4)
    tip = motion.positions()[:, -1] + np.outer(motion.position, [1.0, 0.0])
    np.testing.assert_allclose(places[:, -1] * size, tip, atol=1e-4)
