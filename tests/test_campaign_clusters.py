"""Campaigns on a real local Ray and a real local Dask cluster of two workers.

Both stand in an environment of their own, with the versions that they pin; elsewhere these skip.
"""

import os

import pytest
from campaign_tables import completed, digests
from scripts import run_python

from npend_gym.experiments import Campaign, CampaignPlan

PLAN = CampaignPlan(n=[2, 3], amplitude=[0.3, 0.7], trials=100, batch=16)
MODULES = {"ray": "ray", "dask": "distributed"}


@pytest.fixture(scope="module")
def expected(tmp_path_factory):
    out = tmp_path_factory.mktemp("undisturbed")
    completed(PLAN, out)
    return digests(PLAN, out)


@pytest.mark.parametrize("backend", MODULES)
def test_a_cluster_of_two_workers_writes_the_same_bytes(backend, expected, tmp_path):
    pytest.importorskip(MODULES[backend])
    arguments = ["--n", "2,3", "--amplitude", "0.3,0.7", "--trials", "100", "--batch", "16"]
    command = ["-m", "npend_gym", "campaign", "--out", tmp_path, "--backend", backend, *arguments]
    assert "400 of 400 releases done" in run_python("-W", "ignore", *command, "--workers", "2")
    assert digests(PLAN, tmp_path) == expected


_KILLER = """
import os, signal, sys, time
from npend_gym.experiments.campaign import engine

def work(task):
    mark = os.path.join(OUT, "killed")
    if task == 4 and not os.path.exists(mark):
        open(mark, "w").close()
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.05)
    return task * task

OUT = os.environ["OUT"]
if __name__ == "__main__":
    with engine.workers(sys.argv[1], 2):
        done = dict(engine.run(work, range(12)))
    assert done == {k: k * k for k in range(12)}, done
    assert os.path.exists(os.path.join(OUT, "killed"))
    print("all done")
"""


@pytest.mark.parametrize("backend", MODULES)
def test_a_killed_worker_of_a_cluster_costs_only_time(backend, tmp_path):
    pytest.importorskip(MODULES[backend])
    script = tmp_path / "killer.py"
    script.write_text(_KILLER)
    around = os.environ | {"OUT": str(tmp_path)}
    assert "all done" in run_python("-W", "ignore", script, backend, env=around)


def test_a_missing_library_is_named_with_the_command_that_installs_it(tmp_path):
    from importlib.util import find_spec

    missing = [name for name, module in MODULES.items() if find_spec(module) is None]
    if not missing:
        pytest.skip("both are installed")
    with Campaign(PLAN, tmp_path) as campaign, pytest.raises(ImportError, match="pip install"):
        list(campaign.run(backend=missing[0]))
