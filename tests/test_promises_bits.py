"""The same bits: in other processes, in pieces, on other machines."""

import hashlib
import json
import multiprocessing
import os
import sys

import gymnasium as gym
import numpy as np
import pytest
from lanes import actions_for, assert_same, run
from scripts import run_python

import npend_gym  # noqa: F401 - registers the environments
from npend_gym import Chain, digests, simulate
from npend_gym.cli import main
from npend_gym.compiled.packs import WIDTH
from npend_gym.physics import calls, motion


def episodes():
    """Return a digest of some episodes."""
    digest = hashlib.sha256()
    for n in (1, 2, 5, 10, 50):
        envs = gym.make_vec("NPendulum-v0", num_envs=17, n=n, damping=0.01, threads=2)
        for observation, *rest, info in run(envs, actions_for(envs, 40)):
            for part in (observation, *rest, info["energy"], info["theta"]):
                digest.update(part.tobytes())
        envs.close()
    return digest.hexdigest()


@pytest.fixture(scope="module")
def here():
    return episodes()


@pytest.mark.long
@pytest.mark.parametrize("flags", [[], ["-O"]])
def test_another_process_computes_the_same_whatever_its_settings(here, flags):
    code = "import test_promises_bits as t; print(t.episodes())"
    settings = {"PYTHONHASHSEED": "77", "LC_ALL": "tr_TR.UTF-8", "LANG": "tr_TR.UTF-8"}
    settings |= {"OMP_NUM_THREADS": "8", "NUMBA_NUM_THREADS": "2"}
    settings["PYTHONPATH"] = os.pathsep.join(["tests", *sys.path])
    assert run_python(*flags, "-c", code, env=os.environ | settings).strip() == here


@pytest.mark.long
@pytest.mark.parametrize("way", ["fork", "spawn", "forkserver"])
@pytest.mark.filterwarnings("ignore:.*multi-threaded.*:DeprecationWarning")
def test_however_a_worker_is_begun_it_computes_the_same(here, way):
    if way not in multiprocessing.get_all_start_methods():
        pytest.skip(f"no {way} on this system")
    with multiprocessing.get_context(way).Pool(1) as pool:
        assert pool.apply_async(episodes).get(timeout=120) == here


@pytest.mark.parametrize("mode", ["passive", "swingup"])
@pytest.mark.parametrize("threads", [1, 2])
def test_a_step_taken_in_pieces_is_the_same_step(monkeypatch, mode, threads):
    def run():
        env = gym.make_vec(
            "NPendulum-v0", num_envs=40, n=3, mode=mode, damping=0.05, drag=0.1, dt=0.1,
            threads=threads, measure_periods=True,
        )  # fmt: skip
        env.reset(seed=0)
        actions = np.zeros(40, int) if mode == "passive" else np.full((40, 1), 0.7)
        seen = [env.step(actions) for _ in range(60)]
        env.close()
        return [(*step[:4], step[4]["energy_error"], step[4]["pseudo_periods"]) for step in seen]

    whole = run()
    monkeypatch.setattr(calls, "_RODS_PER_CALL", 2 * 3 * 16)  # two substeps of a group
    assert_same(whole, run())


RK4 = {"method": "rk4", "dt": 0.003}
ONE = np.full(4, 1.0)
SIX = np.repeat(np.linspace(0.0, 2.5, 6)[:, None], 4, axis=1)  # the first rests, and is done first


@pytest.mark.parametrize(
    ("options", "starts"),
    [
        pytest.param({}, ONE, id="one motion"),
        pytest.param(RK4, ONE, id="one motion of rk4"),
        pytest.param({}, SIX, id="six side by side"),
        # kernels of their own take long to compile
        pytest.param(RK4, SIX, id="six side by side of rk4", marks=pytest.mark.long),
    ],
)
def test_motions_computed_in_pieces_have_the_bits_of_whole_ones_alone(
    monkeypatch, uneven, options, starts
):
    times = np.linspace(0.0, 4.0, 7)
    whole = [simulate(uneven, start, 0.0, times, **options) for start in np.atleast_2d(starts)]
    monkeypatch.setattr(motion, "RODS_PER_CALL", 20)  # five steps
    monkeypatch.setattr(motion, "RODS_PER_PACK_CALL", 5 * 4 * WIDTH)
    pieced = simulate(uneven, starts, 0.0, times, **options)
    for found, name in ((pieced.theta, "theta"), (pieced.omega, "omega")):
        expected = [getattr(each, name) for each in whole]
        np.testing.assert_array_equal(np.reshape(found, np.shape(expected)), expected)


def test_positions_and_energies_do_not_depend_on_numpys_sine(monkeypatch):
    path = simulate(Chain.uniform(3), 1.0, 0.0, [0.0, 0.5, 1.0])
    before = path.positions(), path.velocities(), path.energy()
    monkeypatch.setattr(np, "sin", None)
    monkeypatch.setattr(np, "cos", None)
    assert_same(before, (path.positions(), path.velocities(), path.energy()))


@pytest.mark.parametrize(
    "name",
    [  # kernels of machines take long to compile
        pytest.param(name, marks=[pytest.mark.long] * ("machine" in name))
        for name in digests.checks()
    ],
)
def test_this_machine_meets_the_committed_digests(name, capsys, monkeypatch):
    compute = digests.checks()[name]
    monkeypatch.setattr(digests, "checks", lambda: {name: compute})
    assert main(["verify", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["same"]
    assert [check["name"] for check in report["checks"]] == [name]


def test_verify_checks_every_committed_digest():
    assert set(digests.checks()) == set(digests.GOLDEN)
    assert len(digests.GOLDEN) >= 17


def test_verify_names_what_differs(monkeypatch, capsys):
    few = {name: compute for name, compute in digests.checks().items() if "simulate" in name}
    monkeypatch.setattr(digests, "checks", lambda: few)
    monkeypatch.setitem(digests.GOLDEN, "simulate, rk4", "0" * 64)
    assert main(["verify"]) == 1
    shown = capsys.readouterr()
    assert "DIFFERS" in shown.out
    assert "these differ: simulate, rk4\n" in shown.err
    assert "simulate, dop853" not in shown.err
