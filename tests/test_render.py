import copy
import os
import pickle
import subprocess
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest

from npend_gym.render import Painter, Scene, tile
from npend_gym.render.painter import _write, pygame_module
from npend_gym.window import Window

TIP, TORQUE = (0xD5, 0x5E, 0x00), (0xCC, 0x79, 0xA7)
FIRST, INK, ROD = (0x00, 0x72, 0xB2), (0x2B, 0x33, 0x3B), (0x5F, 0x69, 0x73)
PAPER, DISC = (0xF3, 0xF4, 0xF6), (0xFF, 0xFF, 0xFF)


def hanging_arc(n, *, bend=1.0, **rest):
    """A scene of n equal rods whose angles run from 0.2 rad on, over `bend`."""
    theta = 0.2 + np.linspace(0.0, bend, n)
    return Scene(np.cumsum(np.stack([np.sin(theta), -np.cos(theta)], axis=1), axis=0), n, **rest)


def mirrored(scene):
    flip = np.array([-1.0, 1.0])
    return Scene(scene.positions * flip, scene.reach, trace=scene.trace * flip)


def where(frame, color, tolerance=2):
    """Mean pixel position (x, y) of a color, at the centres of the pixels."""
    rows, columns = np.nonzero((np.abs(frame.astype(int) - color) <= tolerance).all(axis=-1))
    return np.array([columns.mean(), rows.mean()]) + 0.5 if rows.size else None


@pytest.fixture
def window(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    window = Window()
    yield window
    window.close()


@pytest.mark.parametrize("size", [32, 96, 200, 333, 480])
def test_a_picture_is_a_square_of_rgb_bytes(size):
    frame = Painter(size).paint(hanging_arc(3, time=1.0, caption="swingup, n = 3"))
    assert frame.shape == (size, size, 3)
    assert frame.dtype == np.uint8
    assert frame.flags.c_contiguous
    assert frame.flags.writeable


def test_the_same_scene_gives_the_same_picture_in_a_fresh_array():
    painter = Painter()
    scene = hanging_arc(7, time=2.5, torque=0.4, completed=3, pseudo_period=2.7)
    first, second = painter.paint(scene), painter.paint(scene)
    assert not np.shares_memory(first, second)
    second[:] = 0
    np.testing.assert_array_equal(first, painter.paint(scene))


@pytest.mark.parametrize("size", [64, 240, 480])
@pytest.mark.parametrize("n", [1, 2, 10, 200])
def test_the_tip_is_drawn_where_it_is(n, size):
    scene = hanging_arc(n)
    x, y = scene.positions[-1] / scene.reach
    expected = size / 2 + 0.44 * size * np.array([x, -y])
    np.testing.assert_allclose(where(Painter(size).paint(scene), TIP), expected, atol=0.5)


@pytest.mark.parametrize("n", [1, 4, 60])
def test_a_mirrored_scene_gives_the_mirrored_picture(n):
    scene = hanging_arc(n, trace=[[-0.5 * n, 0.0], [-0.2 * n, -0.6 * n]])
    painter = Painter(192)  # without text
    frame, mirror = painter.paint(scene), painter.paint(mirrored(scene))[:, ::-1]
    # a line lies half a sample aside in the mirror: edges differ, and by no more than a shade
    assert np.abs(frame.astype(int) - mirror).max() < 100
    assert np.abs(frame.astype(int) - mirror).mean() < 0.5


def test_a_trace_of_few_places_is_drawn_as_a_curve():
    turns = np.arange(0.0, 6.0, 0.5)  # rad, around the pivot
    circle = 0.9 * np.column_stack([np.sin(turns), -np.cos(turns)])
    frame = Painter(480).paint(Scene(circle[-1:], 1.0, trace=circle[:-1])).astype(int)
    for turn in (turns[1:-2] + turns[2:-1]) / 2.0:  # straight lines pass 6 pixels further inside
        x, y = 240.0 + 0.9 * 0.44 * 480 * np.array([np.sin(turn), np.cos(turn)])
        near = frame[round(y) - 2 : round(y) + 3, round(x) - 2 : round(x) + 3]
        assert np.ptp(near, axis=-1).max() > 10, turn


@pytest.mark.parametrize("n", [1, 5, 50, 200, 100_000])
def test_chains_of_any_length_are_drawn(n):
    frame = Painter().paint(hanging_arc(n, bend=2.0))
    colored = np.ptp(frame, axis=-1) > 60
    assert 100 < colored.sum() < 0.03 * colored.size
    assert where(frame, TIP) is not None


def test_a_bob_far_outside_the_reach_is_no_trouble():
    frame = Painter(64).paint(Scene([[1e30, 0.0], [0.0, -1e-30]], 1e-30, trace=[[-1e30, 0.0]]))
    assert frame.shape == (64, 64, 3)


def test_the_torque_turns_the_arrow_its_way_and_zero_draws_none():
    painter = Painter()
    left, right, none = (painter.paint(hanging_arc(2, torque=t)) for t in (0.5, -0.5, 0.0))
    assert where(left, TORQUE)[0] < 235  # from above the pivot counter-clockwise
    assert where(right, TORQUE)[0] > 245
    assert where(none, TORQUE) is None


def test_a_push_is_an_arrow_that_ends_at_the_tip_from_the_side_it_comes_from():
    painter, plain = Painter(), Painter().paint(hanging_arc(2)).astype(int)
    tip = where(plain, TIP)
    for push in (0.5, -1.0):
        changed = np.abs(painter.paint(hanging_arc(2, push=push)) - plain).sum(axis=-1) > 0
        rows, columns = np.nonzero(changed)
        gap = np.sign(push) * (tip[0] - columns)
        assert 0.0 < gap.min() < 25.0 < gap.max() < 130.0
        assert abs(rows.mean() - tip[1]) < 2.0


def test_the_arrow_is_at_the_joint_with_the_motor():
    for joint in (0, 1, 2):
        scene = hanging_arc(3, torque=-0.2, joint=joint)
        place = np.vstack([np.zeros(2), scene.positions])[joint] / scene.reach
        expected = 240 + 0.44 * 480 * place * (1.0, -1.0)
        assert np.linalg.norm(where(Painter().paint(scene), TORQUE) - expected) < 30


def test_links_are_bars_with_a_dot_at_the_centre_of_mass():
    ends = np.array([[0.6, 0.0], [0.6, -0.4]])
    centres = np.array([[0.2, 0.0], [0.6, 0.3]])  # the second is above its own joint
    frame = Painter(480).paint(Scene(ends, 1.0, centres=centres))
    bobs = Painter(480).paint(Scene(ends, 1.0))

    def color(x, y, picture=frame):
        return tuple(picture[round(240 - 211.2 * y), round(240 + 211.2 * x)].tolist())

    assert color(0.2, 0.0) == DISC  # the middle of the dot
    assert color(0.2 + 0.015, 0.0) == INK
    for share in (0.2, 0.5, 0.8):
        assert color(0.6 * share + 0.05, 0.02) == FIRST
        assert color(0.62, -0.4 * share) == TIP
        assert color(0.62, -0.4 * share, bobs) == DISC  # beside the thin rod of a point mass
    assert color(0.6, 0.3 + 0.015) == INK
    assert color(0.6, 0.1) == ROD


def test_text_stands_in_the_corners_and_never_in_the_disc():
    painter = Painter()
    words = hanging_arc(2, time=1e4, energy=1.2e10, pseudo_period=3.2, caption="long " * 500)
    differs = (painter.paint(words) != painter.paint(hanging_arc(2))).any(axis=-1)
    rows, columns = np.nonzero(differs)
    assert {(r > 240, c > 240) for r, c in zip(rows, columns, strict=True)} == {
        (False, False), (False, True), (True, False), (True, True),
    }  # fmt: skip
    assert np.hypot(rows - 239.5, columns - 239.5).min() > 0.44 * 480


@pytest.mark.parametrize(
    ("n", "size", "written"),
    [
        (2, 480, "pseudo-period, mean of 1 of 2 bobs: 0.829 s"),
        (2, 215, "pseudo-period (1 of 2 bobs): 0.829 s"),
        (2, 200, "pseudo-period: 0.829 s"),
        (1, 240, "pseudo-period: 0.829 s"),
    ],
)
def test_a_pseudo_period_is_named_and_absent_where_none_is_asked_for(n, size, written):
    pg = pygame_module()
    pg.font.init()

    def texts_of(scene):
        texts = []

        class Font(pg.font.Font):
            def render(self, text, *rest):
                texts.append(text)
                return super().render(text, *rest)

        fonts = SimpleNamespace(init=pg.font.init, Font=Font)
        _write(fonts, pg.Surface((size, size), 0, 32), scene)
        return texts

    assert written in texts_of(hanging_arc(n, pseudo_period=0.829, completed=1))
    assert not any("period" in text for text in texts_of(hanging_arc(n)))


def test_small_pictures_have_no_text():
    painter = Painter(96)
    plain, written = hanging_arc(2), hanging_arc(2, time=3.0, energy=2.0, caption="passive, n = 2")
    np.testing.assert_array_equal(painter.paint(plain), painter.paint(written))


@pytest.mark.parametrize("size", [84, 480])
def test_a_plain_picture_shows_the_chain_and_nothing_of_what_is_said_about_it(size):
    told = hanging_arc(
        2, time=3.0, energy=2.0, caption="swingup, n = 2", torque=0.9, push=-1.0,
        trace=[[0.1, -0.5], [0.9, -0.5]], marks=[[0.5, 0.5]],
    )  # fmt: skip
    painter = Painter(size, plain=True)
    np.testing.assert_array_equal(painter.paint(told), painter.paint(hanging_arc(2)))
    assert where(painter.paint(told), TIP) == pytest.approx(
        where(Painter(size).paint(told), TIP), abs=1
    )


@pytest.mark.parametrize("size", [64, 480])
def test_a_cart_is_seen_at_every_size(size):
    scene = Scene([[0.3, 1.0]], 2.0, rail=2.0, cart=0.3)
    painter = Painter(size, plain=True)
    gray = (np.abs(painter.paint(scene).astype(int) - ROD) <= 2).all(axis=-1)
    columns = np.nonzero(gray.any(axis=0))[0]
    middle = size * (0.5 + 0.44 * 0.15)  # of the cart; the ends of the rail have its colour
    near = columns[np.abs(columns + 0.5 - middle) < 0.1 * size]
    assert near.mean() + 0.5 == pytest.approx(middle, abs=1.0)
    assert len(near) > 0.05 * size


def test_a_painter_copies_and_pickles_after_painting():
    painter, scene = Painter(200), hanging_arc(3)
    frame = painter.paint(scene)
    for twin in (copy.deepcopy(painter), pickle.loads(pickle.dumps(painter))):
        np.testing.assert_array_equal(twin.paint(scene), frame)


def test_a_scene_keeps_its_own_positions():
    positions = np.array([[0.0, -1.0]])
    scene = Scene(positions, 1.0)
    positions[:] = 7.0
    assert scene.positions[0].tolist() == [0.0, -1.0]
    with pytest.raises(ValueError, match="read-only"):
        scene.positions[:] = 7.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"positions": np.zeros((0, 2))}, "positions must have shape"),
        ({"positions": [0.0, 1.0]}, "positions must have shape"),
        ({"positions": [[0.0, np.nan]]}, "positions must be finite"),
        ({"reach": 0.0}, "reach must be greater than zero"),
        ({"time": np.inf}, "time must be finite"),
        ({"energy": np.nan}, "energy must be finite"),
        ({"pseudo_period": -1.0}, "pseudo_period must be zero or more"),
        ({"completed": 2}, "completed must be between 0 and 1"),
        ({"torque": 1.5}, "torque must be between -1 and 1"),
        ({"push": -1.1}, "push must be between -1 and 1"),
        ({"caption": "two\nlines"}, "caption must be one printable line"),
        ({"caption": 5}, "caption must be one printable line, got 5"),
        ({"trace": [[1.0, 2.0, 3.0]]}, "trace must have shape"),
        ({"centres": [[0.0, 1.0]] * 2}, "centres must have a place for each of the 1 links"),
        ({"joint": 1}, "joint must be between 0 and 0"),
    ],
)
def test_a_scene_refuses_what_cannot_be_drawn(change, message):
    with pytest.raises(ValueError, match=message):
        Scene(**({"positions": [[0.0, -1.0]], "reach": 1.0} | change))


@pytest.mark.parametrize("size", [0, 31, 2161])
def test_a_painter_refuses_a_size_out_of_range(size):
    with pytest.raises(ValueError, match="size must be between 32 and 2160"):
        Painter(size)


@pytest.mark.parametrize(
    ("count", "rows", "columns"), [(1, 1, 1), (2, 1, 2), (3, 2, 2), (4, 2, 2), (5, 2, 3), (9, 3, 3)]
)
def test_tiles_fill_a_near_square_row_by_row(count, rows, columns):
    frames = [np.full((4, 6, 3), k, dtype=np.uint8) for k in range(count)]
    out = tile(frames)
    assert out.shape == (4 * rows, 6 * columns, 3)
    for k in range(rows * columns):
        top, left = k // columns * 4, k % columns * 6
        cell = out[top : top + 4, left : left + 6]
        assert (cell == (k if k < count else PAPER)).all()


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        ([], "number of frames must be at least 1"),
        ([np.zeros((4, 4, 3))], r"frames\[0\] must be uint8 of shape \(height, width, 3\)"),
        ([np.zeros((4, 4), np.uint8)], r"frames\[0\]"),
        ([np.zeros((4, 4, 3), np.uint8), np.zeros((4, 5, 3), np.uint8)], r"frames\[1\].*\(4, 4, 3"),
    ],
)
def test_tiles_must_be_equal_pictures(frames, message):
    with pytest.raises(ValueError, match=message):
        tile(frames)


def test_without_pygame_the_way_out_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "pygame", None)
    for use in (Painter, Window):
        with pytest.raises(ImportError, match=r'pygame.*pip install "npend-gym\[render\]"'):
            use()


def test_importing_render_imports_no_pygame_and_painting_prints_nothing_and_opens_no_display():
    code = """
import sys
from npend_gym.render import Painter, Scene
assert "pygame" not in sys.modules
Painter(200).paint(Scene([[0.0, -1.0]], 1.0, caption="passive"))
pygame = sys.modules["pygame"]
assert not pygame.get_init() and not pygame.display.get_init() and not pygame.mixer.get_init()
"""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_a_window_shows_frames_at_their_pace_and_closes(window):
    import pygame

    frame = Painter(200).paint(hanging_arc(2))
    start = time.perf_counter()
    for _ in range(4):
        window.show(frame, fps=50)
    assert time.perf_counter() - start > 0.05  # three waits of 20 ms, less the timer's grain
    shown = pygame.surfarray.array3d(pygame.display.get_surface()).transpose(1, 0, 2)
    np.testing.assert_array_equal(shown, frame)
    assert pygame.display.get_caption()[0] == "npend_gym"
    window.show(frame[:100], fps=1000)
    assert pygame.display.get_surface().get_size() == (200, 100)
    window.close()
    window.close()
    assert not pygame.display.get_init()


def test_a_window_closed_by_the_user_stays_closed_until_close(window):
    import pygame

    frame = np.zeros((40, 40, 3), dtype=np.uint8)
    window.show(frame, fps=1000)
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    for _ in range(3):
        window.show(frame, fps=1000)
        assert not pygame.display.get_init()
    window.close()
    window.show(frame, fps=1000)
    assert pygame.display.get_init()


def test_a_copied_window_starts_closed(window):
    import pygame

    window.show(np.zeros((40, 40, 3), dtype=np.uint8), fps=1000)
    copy.deepcopy(window).close()
    assert pygame.display.get_init()


def test_a_window_refuses_what_is_no_picture(window):
    with pytest.raises(ValueError, match="frame must be uint8"):
        window.show(np.zeros((40, 40, 3)), fps=30)
    with pytest.raises(ValueError, match="fps must be greater than zero"):
        window.show(np.zeros((40, 40, 3), dtype=np.uint8), fps=0)


def test_marks_are_dotted_where_they_are():
    mark = np.array([0.4, -0.3])
    plain, dotted = (Painter().paint(hanging_arc(3, marks=m)) for m in (np.empty((0, 2)), [mark]))
    rows, columns = np.nonzero((plain != dotted).any(axis=-1))
    center = np.array([columns.mean(), rows.mean()]) + 0.5
    expected = 240 + 0.44 * 480 / 3 * mark * (1, -1)
    np.testing.assert_allclose(center, expected, atol=0.5)


@pytest.mark.skipif(sys.platform != "linux", reason="SDL looks for Wayland on Linux alone")
def test_a_window_without_a_session_opens_quietly():
    code = "from npend_gym.window import Window; import numpy as np; "
    code += "window = Window(); window.show(np.zeros((8, 8, 3), np.uint8), 50.0); window.close()"
    hidden = ("DISPLAY", "WAYLAND_DISPLAY", "XDG_RUNTIME_DIR", "SDL_VIDEODRIVER")
    env = {name: value for name, value in os.environ.items() if name not in hidden}
    done = subprocess.run(
        [sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True
    )
    assert done.stderr == ""
