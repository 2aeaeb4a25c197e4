"""The small pieces that several rooms share: extras, provenance, fits."""

import json
import platform

import numpy as np
import pytest

import npend_gym
from npend_gym._extras import require
from npend_gym._provenance import provenance
from npend_gym.experiments import power_law
from npend_gym.report import write_csv


def test_a_library_that_is_installed_but_broken_is_not_called_missing(tmp_path, monkeypatch):
    (tmp_path / "brokenlibrary.py").write_text("import alsomissing")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ImportError, match=r"it is installed but cannot be imported.*alsomissing"):
        require("brokenlibrary", "plot", "figures")


def test_the_provenance_is_plain_json_with_versions_arguments_and_seed():
    record = json.loads(json.dumps(provenance({"n": 3}, seed=7)))
    assert record["version"] == npend_gym.__version__
    assert record["python"] == platform.python_version()
    assert record["numpy"] == np.__version__
    assert (record["arguments"], record["seed"]) == ({"n": 3}, 7)


def test_a_record_that_is_changed_leaves_the_next_one_alone():
    provenance({})["version"] = "another"
    assert provenance({})["version"] == npend_gym.__version__


def test_a_power_law_is_found_and_two_points_have_no_interval():
    x = np.array([1.0, 3.0, 10.0])
    assert power_law(x, 7.0 * x**0.5).value == pytest.approx(0.5, abs=1e-12)
    two = power_law([1.0, 4.0], [1.0, 2.0])
    assert two.value == pytest.approx(0.5)
    assert np.isnan(two.error)
    level = power_law(x, [3.0, 3.0, 3.0])
    assert (level.value, level.error) == (0.0, 0.0)


def test_confidence_intervals_hold_the_truth_as_often_as_they_say():
    rng = np.random.default_rng(1)
    x = np.geomspace(1.0, 100.0, 8)
    fits = [power_law(x, x**0.5 * np.exp(0.1 * rng.normal(size=8))) for _ in range(400)]
    held = np.mean([abs(fit.value - 0.5) <= fit.error for fit in fits])
    assert held == pytest.approx(0.95, abs=0.03)


def test_a_table_without_rows_is_refused_because_it_has_no_columns(tmp_path):
    with pytest.raises(ValueError, match=r"rows must hold at least one row, .* got \[\]"):
        write_csv(tmp_path / "table.csv", [])
    assert not any(tmp_path.iterdir())
