"""Releases, campaigns, pages, films and the game with a chain of links."""

import json
import re
import shlex

import numpy as np
import pytest
from campaign_tables import part_of, read_part
from scipy.special import ellipk
from test_page import data_of

from npend_gym import Cart, Chain, pseudo_periods, theory
from npend_gym.cli import main
from npend_gym.experiments import (
    Campaign,
    CampaignPlan,
    ReleaseExperiment,
    analyse,
    run_release,
    summary_rows,
)
from npend_gym.recording import record_first_trials
from npend_gym.report import player, release_page, release_tables

NAME = "realaigym A.0"
CHAIN = Chain.preset(NAME)
EXPERIMENT = ReleaseExperiment(chain=NAME, trials=2, amplitude=0.6)


@pytest.fixture(scope="module")
def runs():
    return run_release(EXPERIMENT)


def test_the_chain_of_a_release_is_measured_in_every_trial(runs):
    assert EXPERIMENT.n_values == (2,)
    assert [run.trial for run in runs] == [1, 2]
    for run in runs:
        np.testing.assert_array_equal(run.periods, pseudo_periods(CHAIN, run.start))
        assert np.isfinite(run.periods).all()


@pytest.mark.parametrize(("centre", "length"), [(0.3, 0.5), (0.7, 0.5), (0.02, 0.1)])
def test_one_body_has_the_period_of_the_physical_pendulum(centre, length):
    mass, inertia, amplitude = 0.8, 0.03, 1.1
    # almost no friction makes it a machine, whose kernels other tests compile
    chain = Chain(mass, [length], centres=centre, inertias=inertia, friction=1e-30)
    small = 2.0 * np.pi * np.sqrt((inertia + mass * centre**2) / (mass * chain.gravity * centre))
    exact = small * 2.0 / np.pi * ellipk(np.sin(0.5 * amplitude) ** 2)
    for definition, part in (("bob", 1.0), ("link", 1.0), ("height", 0.5)):
        periods = pseudo_periods(chain, amplitude, definition=definition)
        np.testing.assert_allclose(periods, part * exact, rtol=1e-9)


def test_a_release_survives_json_and_is_read_back_from_its_folder(runs, tmp_path):
    plain = json.loads(json.dumps(EXPERIMENT.as_dict()))
    assert "masses" not in plain
    assert Chain.from_dict(plain["chain"]) == CHAIN
    assert ReleaseExperiment(**plain) == EXPERIMENT
    release_tables.write(EXPERIMENT, runs, tmp_path, figures=False)
    experiment, again = release_tables.read(tmp_path)
    assert experiment == EXPERIMENT
    assert [run.periods.tolist() for run in again] == [run.periods.tolist() for run in runs]


def test_what_does_not_apply_to_links_says_so(runs):
    (row,) = summary_rows(EXPERIMENT, runs)
    assert np.isnan([row["ideal_s"], row["corrected_s"], row["ideal_error"]]).all()
    assert row["fundamental_s"] == theory.fundamental_period(CHAIN)
    table = release_tables.summary_text(EXPERIMENT, runs).splitlines()[1].split()
    assert table[-6] == "-"
    assert "for point masses" in release_tables.LEGEND


@pytest.mark.parametrize("made", [ReleaseExperiment, CampaignPlan])
@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"masses": 2.0}, "masses must be left out where chain is given, which has its own"),
        ({"gravity": 1.6}, "gravity must be left out where chain is given"),
        ({"chain": "acrobat"}, "chain must be an npend_gym.Chain, a dict"),
    ],
)
def test_fields_that_contradict_the_chain_are_refused(made, fields, message):
    with pytest.raises(ValueError, match=message):
        made(**({"chain": CHAIN} | fields))
    n_name = "n_values" if made is ReleaseExperiment else "n"
    with pytest.raises(ValueError, match=f"{n_name} must be left out .* be its 2 links; got"):
        made(chain=CHAIN, **{n_name: [3]})
    assert getattr(made(chain=CHAIN, **{n_name: [2]}), n_name) == (2,)


@pytest.mark.long
def test_a_campaign_of_a_chain_measures_it_and_keeps_it(tmp_path):
    plan = CampaignPlan(chain=CHAIN.as_dict(), amplitude=[0.2, 0.4, 0.6, 0.8], trials=2)
    assert CampaignPlan(**json.loads(json.dumps(plan.as_dict()))) == plan
    with Campaign(plan, tmp_path) as campaign:
        assert not any(error for _, error in campaign.run("threading", 1))
    (task,) = plan.tasks()
    rows = read_part(part_of(tmp_path, "releases", task))
    for start, tip in zip(rows["start_rad"].to_pylist(), rows["tip_s"].to_pylist(), strict=True):
        assert tip == pseudo_periods(CHAIN, start)[-1]
    cells = read_part(tmp_path / "cells.parquet")
    assert Chain.from_dict(json.loads(cells["chain"][0].as_py())) == CHAIN
    assert cells["ideal_s"].to_pylist() == [None] * 4
    (group,) = analyse(tmp_path).groups
    assert group.label == f"chain {NAME}, definition bob"
    assert group.laws[0].exact is None


def test_the_command_line_takes_presets_and_files(tmp_path, capsys):
    file = tmp_path / "chain.json"
    file.write_text(json.dumps(CHAIN.as_dict()))
    shown = []
    for chain in (NAME, str(file)):
        assert main(["release", "--chain", chain, "--trials", "1", "--json"]) == 0
        shown.append(json.loads(capsys.readouterr().out)["summary"])
    assert shown[0] == shown[1]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "--chain: must be one of acrobot, .* or a JSON file .*; got 'no_such_chain'"),
        ("{", "cannot be read: Expecting property name"),
        ('{"masses": [1]}', "the dict of a chain has no 'lengths'"),
        ("[1]", "it must be an object, names and values, got a list"),
        ('{"masses": [1], "lengths": [1], "inertias": [-1]}', "inertias must be zero or more"),
    ],
)
def test_a_bad_chain_on_the_command_line_is_refused_in_a_line(text, message, refusal, tmp_path):
    file = "no_such_chain"
    if text is not None:
        (tmp_path / "chain.json").write_text(text)
        file = str(tmp_path / "chain.json")
    error = refusal("release", "--chain", file, "--out", str(tmp_path / "out"))
    assert re.search(message, error)
    assert not (tmp_path / "out").exists()


def test_a_page_has_the_centres_of_mass_of_links(runs, tmp_path):
    recordings = record_first_trials(EXPERIMENT, runs)
    path = tmp_path / "links.html"
    player.write(path, release_page.page(EXPERIMENT, runs, recordings))
    (release,) = data_of(path)["releases"]
    np.testing.assert_allclose(release["centres"] * CHAIN.lengths, CHAIN.centres)
    assert set(release["models"]) == {"T1", "T(N,a)"}
    assert {one["name"] for one in data_of(path)["law"]["series"]} == {
        "T1", "T(N,a)", "each bob", "mean of a trial", "centre of mass",
    }  # fmt: skip
    words = shlex.split(release_page.command(EXPERIMENT))
    assert words[:4] == ["npend", "release", "--chain", NAME]
    made_by = EXPERIMENT.as_dict() | {"n_values": [2], "trial": 1, "start": runs[0].start}
    assert recordings[0].provenance["arguments"] == made_by


SPRINGS = pytest.param({"stiffness": 1e3}, marks=[pytest.mark.long, pytest.mark.nightly])


@pytest.mark.parametrize("parts", [{"base": Cart(1.0)}, SPRINGS])
def test_carts_and_springs_are_released_and_no_model_is_told_of_them(tmp_path, parts):
    chain, file, out = Chain.uniform(2, **parts), tmp_path / "chain.json", tmp_path / "out"
    file.write_text(json.dumps(chain.as_dict()))
    page = str(tmp_path / "page.html")
    arguments = ["--chain", str(file), "--trials", "1", "--out", str(out), "--page", page]
    assert main(["release", *arguments]) == 0
    experiment, runs = release_tables.read(out)
    (row,) = summary_rows(experiment, runs)
    expected = pseudo_periods(chain, runs[0].start)
    np.testing.assert_allclose(runs[0].periods, expected, rtol=1e-12)
    assert row["measured_s"] == pytest.approx(np.nanmean(expected))
    assert np.isnan([row["fundamental_s"], row["law_s"], row["ideal_error"]]).all()
    (release,) = data_of(tmp_path / "page.html")["releases"]
    assert release["onCart"] == ("base" in parts)
    plan = CampaignPlan(chain=chain, trials=2)
    with Campaign(plan, tmp_path / "campaign") as campaign:
        assert not any(error for _, error in campaign.run("threading"))
    assert analyse(tmp_path / "campaign").groups == ()


def test_results_that_another_command_replaced_are_refused_by_its_name(tmp_path, refusal):
    out = tmp_path / "results"
    assert main(["release", "-n", "1", "--trials", "1", "--out", str(out)]) == 0
    manifest = out / "manifest.json"
    manifest.write_text(json.dumps(json.loads(manifest.read_text()) | {"experiment": "identify"}))
    assert "its manifest.json is that of 'identify'" in refusal("release", str(out))
