"""The page: what is in the file, and what a browser makes of it."""

import base64
import json
import re
from pathlib import Path

import numpy as np
import pytest
from accessibility import grave_findings
from conftest import wait_for
from test_release import plans_with_bobs_that_do_not_complete

from npend_gym import Chain, __version__, theory
from npend_gym.cli import main
from npend_gym.experiments import ReleaseExperiment, run_release
from npend_gym.recording import record_first_trials, record_release
from npend_gym.report import player
from npend_gym.report import release_page as report
from npend_gym.report import release_tables as results

PLAN = ReleaseExperiment(n_values=(2, 5), trials=2, seed=3)


@pytest.fixture(scope="module")
def runs():
    return run_release(PLAN)


@pytest.fixture(scope="module")
def path(runs, tmp_path_factory):
    return written(PLAN, runs, tmp_path_factory.mktemp("page"))


def written(plan, runs, folder):
    path = folder / "release.html"
    player.write(path, report.page(plan, runs, record_first_trials(plan, runs)))
    return path


def data_of(path):
    text = path.read_text("utf-8")
    return json.loads(
        re.search(r'<script type="application/json" id="data">(.*?)</script>', text)[1]
    )


def test_the_page_holds_the_recorded_motion_and_the_measured_numbers(path, runs):
    data = data_of(path)
    assert data["provenance"]["version"] == __version__
    assert ReleaseExperiment(**data["provenance"]["arguments"]).runs() == PLAN.runs()
    for shown, run in zip(data["releases"], (runs[0], runs[2]), strict=True):
        assert shown["n"] == run.n
        assert shown["periods"] == run.periods.tolist()
        assert shown["models"]["T0"]["value"] == theory.ideal_period(PLAN.chain_of(run.n))
        assert shown["models"]["T1"]["value"] == theory.fundamental_period(PLAN.chain_of(run.n))
        places = np.frombuffer(base64.b64decode(shown["places"]), "<f4").reshape(-1, run.n, 2)
        motion = record_release(PLAN, run, shown["interval"]).motion
        np.testing.assert_allclose(places * run.n, motion.positions(), atol=1e-4 * run.n)


def test_the_diagram_of_the_law_has_every_measured_value(path, runs):
    series = {one["name"]: one["points"] for one in data_of(path)["law"]["series"]}
    assert [p[1] for p in series["mean of a trial"]] == [run.mean for run in runs]
    assert [p[1] for p in series["each bob"]] == np.concatenate([r.periods for r in runs]).tolist()
    for n, value in series["T1"]:
        assert value == theory.fundamental_period(PLAN.chain_of(n))
    ends = [series["T1"][k][0] for k in (0, -1)]
    assert ends == [min(PLAN.n_values), max(PLAN.n_values)]  # lines end where the data end


@pytest.mark.parametrize(
    ("count", "said"),
    [(4, "2 trials for each N"), (3, "3 of 4 releases: the run was interrupted")],
)
def test_results_of_an_interrupted_release_are_shown_as_such(count, said, runs, tmp_path, capsys):
    results.write(PLAN, runs[:count], tmp_path, figures=False)
    page = tmp_path / "again.html"
    assert main(["release", str(tmp_path), "--page", str(page)]) == 0
    assert said in page.read_text("utf-8")
    assert ("has 3 of 4 releases" in capsys.readouterr().err) == (count == 3)


def test_the_page_refers_to_nothing_outside(path):
    text = path.read_text("utf-8")
    outside = set(re.findall(r"https?://[^\"' ]+", text))
    assert outside == {"http://www.w3.org/2000/svg"}  # a name, not an address
    assert not re.search(r"<(link|script|img)[^>]+(src|href)=\"(?!data:)", text)
    assert "$" + "{" in text  # the script came through the template whole
    assert not re.search(
        r"\$(title|about|data|style|script|summary|legend|command|version)\b", text
    )


@plans_with_bobs_that_do_not_complete
def test_bobs_that_do_not_complete_have_no_number(plan, tmp_path):
    path = written(plan, run_release(plan), tmp_path)
    (shown,) = data_of(path)["releases"]
    rows = re.findall(r"<td>(.*?)</td>", path.read_text("utf-8"))
    assert rows[0] == str(plan.n_values[0])
    assert "nan" not in rows
    if plan.gravity:
        assert 0 < sum(t is None for t in shown["periods"]) < 20
    else:
        assert shown["periods"] == [None, None]
        assert shown["models"] == {}


@pytest.mark.parametrize("change", [{"duration": 0.03}, {"lengths": 1e-4}, {"lengths": 0.01}])
def test_a_short_motion_has_a_hundred_intervals_and_ends_after_its_last_bob(change, tmp_path):
    plan = ReleaseExperiment(n_values=[2], trials=1, **change)
    runs = run_release(plan)
    (shown,) = data_of(written(plan, runs, tmp_path))["releases"]
    assert len(base64.b64decode(shown["places"])) == 101 * 2 * 2 * 4
    if "duration" in change:
        assert 100 * shown["interval"] == pytest.approx(0.03)
    else:
        assert shown["periods"] == runs[0].periods.tolist()
        assert 1.0 < 100 * shown["interval"] / max(shown["periods"]) < 1.1


def test_the_command_in_the_page_makes_the_same_release(path, capsys):
    text = path.read_text("utf-8")
    command = re.search(r"<code>npend (.*)</code>", text)[1]
    assert command == "release --n 2,5 --trials 2 --seed 3"
    assert main(command.split()) == 0
    mean = re.search(r"<td>5</td><td>([\d.]+)</td>", text)[1]
    assert f"   5   {mean} +-" in capsys.readouterr().out


def test_page_from_results_is_the_page_of_the_release_whatever_their_provenance(
    path, runs, tmp_path
):
    folder, out = tmp_path / "results", tmp_path / "new" / "again.html"
    results.write(PLAN, runs, folder, figures=False)
    manifest = json.loads((folder / "manifest.json").read_text())
    for change in ({}, {"provenance": {}}):
        (folder / "manifest.json").write_text(json.dumps(manifest | change))
        assert main(["release", str(folder), "--page", str(out)]) == 0
        assert out.read_bytes() == path.read_bytes()


def test_changed_results_are_refused(runs, tmp_path, refusal):
    results.write(PLAN, runs, tmp_path, figures=False)
    table = tmp_path / "periods.csv"
    table.write_text(table.read_text().replace("2.7", "2.8"))
    error = refusal("release", str(tmp_path), "--page", str(tmp_path / "a.html"))
    assert "periods.csv has been changed since" in error


@pytest.mark.long
def test_the_page_of_springs_holds_places_within_the_picture(tmp_path):
    plan = ReleaseExperiment(
        chain=Chain([1.0, 1.0], [1.0, 1.0], stiffness=60.0), trials=1, duration=5.0
    )
    runs = run_release(plan)
    (shown,) = data_of(written(plan, runs, tmp_path))["releases"]
    places = np.frombuffer(base64.b64decode(shown["places"]), "<f4").reshape(-1, 2, 2)
    motion = record_release(plan, runs[0], shown["interval"]).motion
    farthest = np.hypot(*motion.positions().T).max()
    assert farthest > 1.2 * motion.chain.total_length
    np.testing.assert_allclose(farthest * places, motion.positions(), atol=2e-4)


# ---- in a browser --------------------------------------------------------------------------------


@pytest.fixture
def page(open_page, path):
    """The page in a tab."""
    return open_page(path)


def go(page, time):
    page.eval_on_selector(
        "#time", f"slider => {{ slider.value = {time}; slider.dispatchEvent(new Event('input')) }}"
    )


def time_of(page):
    return float(page.input_value("#time"))


def table(page):
    return page.eval_on_selector_all("#table tbody td", "cells => cells.map(c => c.textContent)")


@pytest.mark.long
def test_the_page_plays_and_pauses_by_the_space_key(page):
    assert time_of(page) == 0.0
    page.keyboard.press("Space")
    wait_for(page, lambda: time_of(page) > 0.3)
    page.keyboard.press("Space")
    paused = time_of(page)
    page.wait_for_timeout(200)
    assert time_of(page) == paused
    assert page.text_content("#play") == "Play"
    page.keyboard.press(".")
    assert time_of(page) == pytest.approx(paused + 0.04, abs=0.011)


@pytest.mark.long
def test_the_animation_ends_and_can_be_played_again(page, runs):
    page.select_option("#speed", "4")
    page.click("#play")
    wait_for(page, lambda: page.text_content("#play") == "Play")
    assert table(page) == [f"{t:.4f}" for t in runs[2].periods]
    page.click("#play")
    wait_for(page, lambda: 0.0 < time_of(page) < 3.0)


@pytest.mark.long
def test_pseudo_periods_appear_as_they_complete(page, runs):
    periods = runs[2].periods
    assert table(page) == ["\u2013"] * 5
    go(page, (periods.min() + periods.max()) / 2)
    now = time_of(page)
    assert table(page) == [f"{t:.4f}" if t <= now else "\u2013" for t in periods]
    done = periods[periods <= now]
    assert 0 < done.size < 5
    assert page.text_content("#state").startswith(
        f"{done.size} of 5 bobs have completed, mean {done.mean():.4f} s"
    )
    visible = "#periods circle.dot"
    shown = page.eval_on_selector_all(
        visible, "dots => dots.filter(d => d.r.baseVal.value > 0).length"
    )
    assert shown == done.size
    page.keyboard.press("End")
    assert table(page) == [f"{t:.4f}" for t in periods]


@pytest.mark.long
def test_the_summary_fits_its_frame_and_models_have_one_name_everywhere(page, runs):
    page.set_viewport_size({"width": 1200, "height": 900})
    frame = page.locator("details .scroll")
    assert frame.evaluate("box => box.scrollWidth - box.clientWidth") == 0
    texts = "all => all.map(one => one.textContent)"
    heads = page.eval_on_selector_all("details th", texts)
    legend = page.eval_on_selector_all("#law ~ figcaption .legend span", texts)
    keys = page.eval_on_selector_all(
        "#law ~ figcaption .legend span",
        "all => all.map(one => `${one.className} ${one.style.cssText}`)",
    )
    assert len(set(keys)) == len(keys) == 7  # no two look alike
    up = page.eval_on_selector_all("#law > text[text-anchor=end]", texts)
    assert len(up) >= 4
    for name in ("T0", "T0+a", "T1", "T(N,a)"):
        assert f"{name} [s]" in heads
        assert name in legend
        assert f" {name} " in results.summary_text(PLAN, runs)


@pytest.mark.long
def test_the_menu_names_the_chain_that_is_shown_and_another_can_be_chosen(page, runs):
    assert page.input_value("#release") == "1"
    assert page.get_attribute("#chain", "aria-label").startswith("Animation of 5")
    page.select_option("#release", "0")
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("End")
    assert table(page) == [f"{t:.4f}" for t in runs[0].periods]


def tip_in_canvas(page):
    """Place of the tip's colour in the canvas, from its middle, over its height."""
    x, y = page.evaluate(
        """() => {
          const canvas = document.getElementById("chain"), { width, height } = canvas;
          const { data } = canvas.getContext("2d").getImageData(0, 0, width, height);
          let [count, x, y] = [0, 0, 0];
          const tip = [0xd5, 0x5e, 0x00, 0xff];
          for (let k = 0; k < data.length; k += 4)
            if (tip.every((value, c) => data[k + c] === value)) {
              count += 1; x += (k / 4) % width; y += Math.floor(k / 4 / width);
            }
          return [(x / count + 0.5 - width / 2) / height, (height / 2 - y / count - 0.5) / height];
        }"""
    )
    return np.array([x, y])


@pytest.mark.long
def test_the_canvas_shows_the_tip_where_it_is(page, runs):
    motion = record_release(PLAN, runs[2], 0.04).motion
    for k in (0, 25, 60):
        go(page, 0.04 * k)
        expected = 0.46 * motion.positions()[k, -1] / motion.chain.total_length
        np.testing.assert_allclose(tip_in_canvas(page), expected, atol=0.01)


@pytest.mark.long
def test_values_show_under_the_pointer_and_by_the_arrow_keys(page, runs):
    page.focus("#law")
    page.keyboard.press("ArrowLeft")
    tip = page.locator("#law ~ .tip")
    assert tip.text_content() == f"N = 5, trial 2, centre of mass: {runs[3].com:.4f} s"
    box = page.locator("#law circle.chosen").bounding_box()
    page.mouse.move(5, 5)
    page.evaluate("document.activeElement.blur()")
    assert tip.text_content() == ""
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    shown = r"N = 5, trial \d, (mean|centre of mass|bob \d): \d\.\d{4} s"
    assert re.fullmatch(shown, tip.text_content())


@pytest.mark.long
def test_every_control_and_picture_has_a_name_for_a_screen_reader(page):
    names = page.locator("body").aria_snapshot()
    for name in ('combobox "Pendulums', 'button "Play"', 'slider "Time"', 'img "Animation of 5'):
        assert name in names
    assert "Pseudo-period of each of 5 bobs" in names
    assert 'table "Pseudo-period of each bob, as they complete"' in names
    go(page, 1.0)
    assert page.get_attribute("#time", "aria-valuetext") == "1.00 seconds"


@pytest.mark.long
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing_serious(open_page, path, scheme):
    page = open_page(path, color_scheme=scheme)
    go(page, 3.0)
    assert grave_findings(page) == []


@pytest.mark.long
def test_the_page_fits_a_narrow_screen(page):
    page.set_viewport_size({"width": 360, "height": 640})
    page.wait_for_timeout(100)
    assert page.evaluate("document.documentElement.scrollWidth") <= 360


@pytest.mark.long
def test_without_a_script_the_tables_are_there(browser, path):
    context = browser.new_context(java_script_enabled=False)
    tab = context.new_page()
    tab.goto(Path(path).as_uri())
    assert tab.locator("details table tbody tr").count() == 2
    assert "need JavaScript" in tab.locator("noscript").inner_text()
    context.close()


@pytest.mark.long
def test_both_axes_of_the_diagram_of_the_law_have_numbers_for_a_single_chain(open_page, tmp_path):
    plan = ReleaseExperiment(chain=Chain.dm_control("cartpole", 3), trials=1)
    page = open_page(written(plan, run_release(plan), tmp_path))
    texts = page.eval_on_selector_all("#law > text", "all => all.map((one) => one.textContent)")
    across = [float(one) for one in texts[: texts.index("number of pendulums N")]]
    assert across[0] == 3.0
    assert len(across) > 2
    assert all(np.diff(across[1:]) > 0.0)


@pytest.mark.long
def test_the_page_of_one_pendulum_speaks_of_one(open_page, tmp_path):
    plan = ReleaseExperiment(n_values=(1,), trials=1)
    page = open_page(written(plan, run_release(plan), tmp_path))
    assert page.title() == "Release of N = 1 pendulum"
    go(page, 3.0)
    assert page.text_content("#state").startswith("1 of 1 bob has completed, mean 2.")
    label = page.get_attribute("#chain", "aria-label")
    assert label == "Animation of 1 pendulum; 1 of 1 bob has completed"
