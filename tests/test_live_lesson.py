"""The live page in class, without a browser: its scripts run in Node, on a stand-in."""

import csv
import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from npend_gym import Chain, simulate
from npend_gym.cli import main

pytestmark = [
    pytest.mark.long,  # the first page of a version compiles for a minute
    pytest.mark.skipif(not shutil.which("node"), reason="Node is not installed"),
]

STAND_IN = Path(__file__).with_name("page_stand_in.mjs")
ENTERED = """
$("lesson").open = true;
$("twin").value = "0.1";
$("angles").value = "120, -10";
$("angles").onchange();
pass(3);
timers.forEach((act) => act());
$("csv").onclick();
$("film").onclick();
const during = $("film").textContent;
$("film").onclick();
const file = async ({ download, href }) => [download, await href.text()];
const files = await Promise.all(saved.map(file));
const curves = (id) => $(id).children.filter((one) => one.name === "path").length;
const drawn = ["phase", "energies", "apart"].map((id) => [$(id)["aria-label"], curves(id)]);
$("n").value = 3;
$("n").oninput();
const after = [$("angles").value, [...npend.chain.theta]];
const n = npend.chain.n;
$("angles").value = "1e300";
$("twin").value = "1e308";
$("angles").onchange();
pass(3);
const far = [...npend.chain.theta, npend.chain.output("TIME")];
const said = [
  "120, -10", "abc", "pi/2,0", "120,5, -10", "120,5; \u221210\u00b0", "45", "", "0 ".repeat(101),
].map((text) => {
  $("angles").value = text;
  $("angles").onchange();
  return [$("understood").textContent, $("angles")["aria-invalid"], [...npend.chain.theta]];
});
console.log(JSON.stringify({ files, during, drawn, after, n, far, said }));
"""


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """What a teacher gets who writes angles, turns a second chain, and saves a table and a film."""
    folder = tmp_path_factory.mktemp("lesson")
    assert main(["play", "--out", str(folder / "live.html")]) == 0
    (folder / "lesson.mjs").write_text(STAND_IN.read_text() + ENTERED)
    done = subprocess.run(
        ["node", "lesson.mjs", "live.html"], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout)


def test_the_table_has_the_motion_of_both_chains_from_the_angles_that_were_written(found):
    (name, text), _ = found["files"]
    assert name == "pendulums.csv"
    heads, *rows = csv.reader(text.splitlines())
    expected = "time theta0 theta1 omega0 omega1 energy kinetic second_theta0 second_theta1"
    assert heads == expected.split()
    table = np.array(rows, float)
    times, chain, start = table[:, 0], Chain.uniform(2), np.radians([120.0, -10.0])
    assert times[0] == 0.0
    assert times[-1] > 1.0
    for columns, turned in ((table[:, 1:3], 0.0), (table[:, 7:9], np.radians(0.1))):
        motion = simulate(chain, start + turned, 0.0, times)
        np.testing.assert_allclose(columns, motion.theta, atol=1e-3)
    first = simulate(chain, start, 0.0, times)
    np.testing.assert_allclose(table[:, 5], first.energy(), rtol=1e-6)
    np.testing.assert_allclose(table[:, 6], first.kinetic_energy(), atol=1e-2)


def test_the_film_is_saved_when_it_is_stopped(found):
    assert found["during"] == "Stop and save"
    assert found["files"][1] == ["pendulums.webm", "pictures"]


def test_phase_plane_energies_and_distance_are_drawn(found):
    labels, curves = zip(*found["drawn"], strict=True)
    assert [label.partition(".")[0] for label in labels] == [
        "Phase plane of the last rod", "Energy against time", "Angle between the last rods",
    ]  # fmt: skip
    assert curves == (2, 4, 2)  # each with the axes


def test_the_sliders_take_the_place_of_the_angles_that_were_written(found):
    text, theta = found["after"]
    assert text == ""
    np.testing.assert_allclose(theta, [np.pi / 4] * 3)


def test_the_page_says_what_it_understood_of_the_angles_and_refuses_what_it_does_not(found):
    texts, wrong, thetas = zip(*found["said"], strict=True)
    assert list(wrong) == [False, True, True, False, False, False, False, True]
    pair, word, term, points, commas, one, empty, many = texts
    assert pair == "2 rods: 120\u00b0, \u221210\u00b0."
    rule = "is no number. Write degrees, one for each rod, as in 120, -10."
    assert word == f"\u201cabc\u201d {rule}"
    assert term == f"\u201cpi/2\u201d {rule}"
    assert thetas[1] == thetas[2] == thetas[0]  # nothing is released
    assert (
        points == "3 rods: 120\u00b0, 5\u00b0, \u221210\u00b0. A decimal has a point: 120.5, -10."
    )
    assert commas == "2 rods: 120.5\u00b0, \u221210\u00b0."
    np.testing.assert_allclose(thetas[4], np.radians([120.5, -10.0]))
    assert one == "2 rods: 45\u00b0, and 45\u00b0 for the others."
    assert empty == ""
    assert many == "101 angles, but at most 100 rods."


def test_angles_beyond_all_bounds_are_cut_to_what_the_page_can_show(found):
    *theta, time = found["far"]
    assert np.abs(theta).max() < 1e4
    assert time > 0.0
