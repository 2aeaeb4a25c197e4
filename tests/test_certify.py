"""The reference cases of `benchmarks/certify`, the package's own motions, and other engines'."""

import csv
import json
from xml.etree import ElementTree as ET

import evaluate_engines
import numpy as np
import pytest
from certify import derivatives, jax_runners, oracle, runners
from certify.cases import DEFINED, FORMAT, TIMES, Case, read
from certify.equations import accelerations, energy, solve, system
from lagrangian import accelerations_of_chain
from suites import chaos

CASES = {case.name: case for case in read()}
EPS = np.finfo(float).eps


def test_the_file_has_twelve_cases_as_they_are_defined_with_all_their_digits():
    assert len(CASES) == len(DEFINED) == 12
    for defined, case in zip(DEFINED, CASES.values(), strict=True):
        assert defined.items() <= case.record.items()
        assert float(case.record["difference"]) < 1e-21
        assert [state["time"] for state in case.record["states"]] == ["1", "5", "10"]
        for state in case.record["states"]:
            assert state.keys() == case.record["start"].keys() | {"time", "growth"}
            assert all(len(text.partition(".")[2]) == 28 for text in state["theta"])
        for values in (case.start, case.mechanism.masses, case.mechanism.lengths):
            np.testing.assert_array_equal(np.float32(values), values)
    assert [end for _, end, _ in CASES["driven"].intervals] == [1.0, 2.5, 4.0, 5.0, 7.5, 10.0]


def test_a_file_of_another_format_is_refused(tmp_path):
    path = tmp_path / "cases.json"
    path.write_text(json.dumps({"format": "another", "cases": []}), encoding="utf-8")
    with pytest.raises(ValueError, match=f"format must be '{FORMAT}', got 'another'"):
        read(path)


@pytest.mark.parametrize("name", CASES)
def test_the_equations_are_those_that_sympy_derives(name):
    case, rng = CASES[name], np.random.default_rng(0)
    chain = runners.chain_of(case)
    if case.n > 3:
        pytest.skip("SymPy takes long, and the equations are the same for all n")
    q, u, torque = (rng.normal(size=k) for k in (chain.coordinates, chain.coordinates, case.n))
    q[case.n :] *= 0.1
    expected = accelerations_of_chain(chain, q, u, np.append(torque, 0.0))
    found = accelerations(case.mechanism, q, u, torque)
    np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-10)
    by_elimination = solve(*(x.astype(object) for x in system(case.mechanism, q, u, torque)))
    np.testing.assert_allclose(by_elimination.astype(float), expected, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("name", CASES)
def test_our_simulator_meets_every_reference(name):
    case = CASES[name]
    played = runners.play(runners.ENGINES["npend_gym dop853"], case, 1e-3)
    growth = [float(state["growth"]) for state in case.record["states"]]
    errors = runners.errors(case, played)
    assert np.all(errors < 1e-11 + 1e-12 * np.maximum.accumulate(growth))
    assert runners.energy_error(case, played) < 1e-10


@pytest.mark.parametrize("name", CASES)
def test_energy_of_the_references_is_conserved_where_nothing_takes_it(name):
    case = CASES[name]
    chain = case.mechanism
    if np.any(chain.damping) or np.any(chain.drag) or case.record["torque"]:
        pytest.skip("energy is not conserved")
    first = energy(chain, *case.start)
    scale = np.abs(chain.gravity * chain.masses.sum() * chain.lengths.sum())
    for state in case.states:
        assert abs(energy(chain, *state) - first) < 1e-13 * scale


@pytest.mark.long
def test_our_derivatives_are_those_of_the_references():
    given = [case for case in CASES.values() if case.derivative is not None]
    assert len(given) == 11
    for case in given:  # steps follow the state, and the derivative of springs is stiffer
        bound = 1e-9 if case.name == "springs" else 1e-10
        assert float(derivatives.compared("npend_gym dop853", case, 1e-3)["error"]) < bound


def test_torques_of_joints_stand_behind_the_cart_and_between_the_slides():
    torque = np.array([1.0, 2.0])
    assert runners.forces_on(CASES["springs"], torque).tolist() == [1.0, 0.0, 2.0, 0.0]
    assert runners.forces_on(CASES["cart"], torque).tolist() == [0.0, 1.0, 2.0]


def test_the_command_writes_a_row_for_each_engine_or_why_there_is_none(tmp_path, capsys):
    chosen = ["--case", "drag", "--engine", "npend_gym rk4", "--engine", "Drake RK3"]
    assert evaluate_engines.main([*chosen, "--out", str(tmp_path), "--json"]) == 0
    ours, theirs = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert float(ours["error_1_s"]) < 1e-8
    assert theirs["error_1_s"] == ""
    assert "Error: " in theirs["reason"]
    assert (tmp_path / "engines.csv").exists()
    assert "npend_gym rk4" in evaluate_engines.line(ours)


def test_the_file_in_a_new_folder_keeps_old_rows_and_the_json_has_the_new_ones(
    tmp_path, monkeypatch, capsys
):
    def rows(cases, names):
        yield {"case": cases[0].name, "engine": names[0], "reason": "a stand-in"}

    monkeypatch.setattr(evaluate_engines, "rows", rows)
    out = tmp_path / "new" / "folder"
    for engine in ("npend_gym rk4", "Drake RK3"):
        chosen = ["--case", "drag", "--engine", engine, "--json", "--out", str(out)]
        assert evaluate_engines.main(chosen) == 0
        assert [row["engine"] for row in json.loads(capsys.readouterr().out)] == [engine]
    with (out / "engines.csv").open() as file:
        assert {row["engine"] for row in csv.DictReader(file)} == {"npend_gym rk4", "Drake RK3"}


def test_the_file_keeps_rows_of_engines_and_cases_that_are_no_longer_known(tmp_path):
    path, known = tmp_path / "engines.csv", {"case": "drag", "engine": "npend_gym rk4"}
    path.write_text("case,engine\nold,npend_gym rk4\ndrag,old\n")
    rows = [(row["case"], row["engine"]) for row in evaluate_engines._merged(path, [known])]
    assert rows == [("drag", "npend_gym rk4"), ("drag", "old"), ("old", "npend_gym rk4")]


def test_a_run_that_diverges_is_named_so(monkeypatch):
    def exploding(*_case_and_step):
        return lambda state, *_torque_and_duration: (state + 1e4, 1)

    row = evaluate_engines._about("npend_gym rk4", CASES["links"])
    engine = runners.Engine(exploding, "none", "")
    monkeypatch.setitem(evaluate_engines.ENGINES, "exploding", engine)
    row |= evaluate_engines._played("exploding", CASES["links"])
    assert row["reason"] == "diverged"
    assert "error_1_s" not in row


def test_a_robot_in_sdf_has_the_numbers_of_urdf():
    urdf = ET.fromstring(runners.chain_of(CASES["cart"]).to_urdf())
    model = ET.fromstring(jax_runners._sdf(ET.tostring(urdf, "unicode")))[0]
    for tag in ("mass", "xyz", "damping"):
        found = [float(x) for each in model.iter(tag) for x in each.text.split()]
        expected = {
            "mass": ["1", *(each.get("value") for each in urdf.iter("mass"))],
            "xyz": [x for each in urdf.iter("axis") for x in each.get("xyz").split()],
            "damping": [each.get("damping") for each in urdf.iter("dynamics")],
        }[tag]
        assert found == [*map(float, expected)]
    joints = [(each.find("parent").text, each.find("child").text) for each in model.iter("joint")]
    assert joints == [("world", "world-link"), ("world-link", "cart-link"),
                      ("cart-link", "link0-link"), ("link0-link", "link1-link")]  # fmt: skip
    poses = [each.findtext("pose") for each in model.findall("joint")]
    assert poses[1:] == ["0.0 0.0 0.0 0 0 0", "0.0 0.0 0.0 0 0 0", "0.0 0.0 -1.0 0 0 0"]


@pytest.mark.long
@pytest.mark.parametrize("integrator", ["RK4", "Euler", "implicitfast"])
def test_mujoco_approaches_the_references(integrator):
    pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    engine = runners.ENGINES[f"MuJoCo {integrator}"]
    order = 4 if integrator == "RK4" else 1
    for case in CASES.values():
        if case.name == "drag":
            with pytest.raises(ValueError, match="MuJoCo has no such thing"):
                engine.make(case, 1e-3)
            continue
        if case.name in ("stiff", "springs") and order == 1:
            continue  # steps that follow their vibrations would take minutes
        coarse, fine = (
            runners.errors(case, runners.play(engine, case, 2.0**-k))[0] for k in (10, 12)
        )
        assert fine < 1e-6 if order == 4 else fine < 0.02
        assert coarse / fine > 2.0**order or fine < 1e-9


@pytest.mark.long
def test_scipy_meets_the_references_on_the_dense_equations():
    for case in CASES.values():
        if case.name not in ("stiff", "long"):
            played = runners.play(runners.ENGINES["SciPy DOP853"], case, 1e-3)
            assert runners.errors(case, played)[0] < 1e-9


def test_heyoka_starts_nowhere_at_rest_with_level_rods():
    """Its first step is wrong from there, without a word, at the tolerances of float64."""
    starts = {name: case.start[:, : case.n] for name, case in CASES.items()}
    rng = np.random.default_rng(0)
    starts["ensembles"] = np.stack([rng.uniform(-3.0, 3.0, (10_000, 2)), np.zeros((10_000, 2))])
    starts["accuracy"] = np.array([[np.pi / 4], [0.0]])
    starts["chaos"] = np.array([[chaos.ANGLE], [0.0]])
    for name, (theta, omega) in starts.items():
        level = np.all(abs(np.cos(theta)) < 1e-6, axis=-1) & np.all(omega == 0.0, axis=-1)
        assert not np.any(level), name


@pytest.mark.long
def test_the_references_are_computed_again_by_heyoka():
    pytest.importorskip("heyoka", reason="heyoka is not installed")
    found = oracle.compute(Case(DEFINED[0]))
    assert found["states"] == CASES["one-rod"].record["states"]
    assert TIMES == (1, 5, 10)
