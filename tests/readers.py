"""Every reader of files, with good files to begin from: for the fuzzer and its tests."""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mutations
import numpy as np
from campaign_tables import completed, part_of
from policy_files import random_policy, save_changed

from npend_gym import Chain, Trajectory, simulate
from npend_gym.chain import as_chain
from npend_gym.cli.values import chain_argument
from npend_gym.envs import EnvConfig
from npend_gym.experiments import CampaignPlan, ReleaseExperiment, run_release
from npend_gym.experiments.campaign.folder import Folder
from npend_gym.experiments.campaign.plan_file import read_plan_file
from npend_gym.experiments.campaign.status import read_plan
from npend_gym.experiments.studies.release_plan import RELEASES
from npend_gym.experiments.studies.release_tables import read_releases
from npend_gym.identification import read_motion
from npend_gym.report import release_tables
from npend_gym.rl import BenchmarkRun, PlannedTransitions, Policy, read_benchmarks

CORPUS = Path(__file__).parent / "corpus"
PLAN = CampaignPlan(n=2, amplitude=[0.3, 0.7], trials=20, batch=20)
FILES, VALUES = (ValueError, OSError), (ValueError, OSError, TypeError)


@dataclass(frozen=True)
class Reader:
    """How a kind of file is read.

    Attributes
    ----------
    path : Path
        Where the reader expects the file.
    read : callable
        Is called without arguments, after bytes have been written to `path`.
    mutate : callable
        Changes bytes.
    declared : tuple
        What `read` may raise.
    seeds : list of bytes
        Good files.
    """

    path: Path
    read: Callable[[], Any]
    mutate: mutations.Mutation
    declared: tuple[type[Exception], ...]
    seeds: list[bytes]

    def attempt(self, data: bytes) -> bool:
        """Read `data`; return whether it was taken. What is not declared is raised."""
        file = os.open(self.path, os.O_WRONLY | os.O_TRUNC | os.O_CREAT)  # half of `write_bytes`
        os.write(file, data)
        os.close(file)
        try:
            self.read()
        except self.declared:
            return False
        return True


def make_readers(folder: Path) -> dict[str, Reader]:
    """Return the readers by name; `folder` gets a folder for each."""
    made = [
        _policies, _trajectory, _campaign, _plan_files, _release, _motion, _chain, _transitions,
        _benchmark,
    ]  # fmt: skip
    readers: dict[str, Reader] = {}
    for make in made:
        own = folder / make.__name__.strip("_")
        own.mkdir()
        readers |= make(own)
    return readers


def _act(policy: Policy) -> None:
    """Let a policy that was taken act; what it does must be within bounds."""
    if policy.has_memory:
        policy.reset(2)
    observed = np.full((2, policy.observed), 1e6, np.float32)
    with np.errstate(all="raise", under="ignore"):
        action = policy(observed)
    if not (np.abs(action) <= 1.0).all():
        raise AssertionError(f"an action is {action}")


def _policies(folder: Path) -> dict[str, Reader]:
    env = {"n": 2, "mode": "swingup", "observation": "sincos"}
    random_env = env | {"randomize": {"masses": [0.8, 1.2], "damping": {"low": 0.0, "high": 0.1}}}
    policies = [
        random_policy([(3, 6), (1, 3)], env),
        random_policy([(2, 14), (1, 2)], random_env, scale=np.ones((2, 7))),
        random_policy([(1, 4)], {"n": 2, "chain": "acrobot", "actuated": [1], "dt": 0.02}),
    ]
    path, seeds = folder / "a.safetensors", list[bytes]()
    policies[0].save(path)
    seeds.append(path.read_bytes())
    for policy in policies:  # without the checksum, at which most mutants would end
        save_changed(policy, path)
        seeds.append(path.read_bytes())
    return {
        "policy": Reader(path, lambda: _act(Policy.load(path)), mutations.of_tensors, FILES, seeds)
    }


def _trajectory(folder: Path) -> dict[str, Reader]:
    path, seeds = folder / "a.npz", list[bytes]()
    times = np.linspace(0.0, 0.2, 4)
    for motion in (
        simulate(Chain([1.0, 0.5], [1.0, 0.7]), 1.0, 0.0, times),
        simulate(Chain.uniform(1), [[0.5], [0.6]], 0.0, times),
    ):
        motion.save(path)
        seeds.append(path.read_bytes())
    return {
        "trajectory": Reader(
            path, lambda: Trajectory.load(path), mutations.of_archive, FILES, seeds
        )
    }


def _campaign(folder: Path) -> dict[str, Reader]:
    out = folder / "campaign"
    completed(PLAN, out)
    task = next(PLAN.tasks())
    part, plan = part_of(out, RELEASES, task), out / "plan.json"
    return {
        "part": Reader(
            part, lambda: read_releases(PLAN, Folder(part.parent), part.name, task),
            mutations.of_bytes, FILES, [part.read_bytes()],
        ),
        "plan": Reader(plan, lambda: read_plan(out), mutations.of_json, FILES, [plan.read_bytes()]),
    }  # fmt: skip


def _plan_files(folder: Path) -> dict[str, Reader]:
    toml = b"n = [2, 3]\namplitude = [0.3, 0.7]\ntrials = 50\nseed = 4\nmasses = [1.0, 2]\n"
    yaml = b"n: [2, 3]\namplitude:\n  - 0.3\n  - 0.7\ntrials: 50\ndefinition: bob\nchain: null\n"
    values = {"n": 2, "chain": {"masses": [1.0, 2.0], "lengths": [1.0, 1.0]}, "trials": 5}
    given = {".toml": toml, ".yaml": yaml, ".json": json.dumps(values).encode()}
    mutate = {".toml": mutations.of_bytes, ".yaml": mutations.of_bytes, ".json": mutations.of_json}

    def reader(suffix: str) -> Reader:
        path = folder / f"plan{suffix}"
        return Reader(
            path, lambda: CampaignPlan.from_dict(read_plan_file(path)), mutate[suffix], VALUES,
            [given[suffix]],
        )  # fmt: skip

    return {f"plan_{suffix[1:]}": reader(suffix) for suffix in given}


def _release(folder: Path) -> dict[str, Reader]:
    out = folder / "release"
    experiment = ReleaseExperiment(n_values=(1, 2), trials=2)
    release_tables.write(experiment, run_release(experiment), out, figures=False)
    seeds = {name: (out / name).read_bytes() for name in ("release.json", "periods.csv")}
    manifest = (out / "manifest.json").read_bytes()

    def changed(name: str, mutate: mutations.Mutation) -> Reader:
        """Return the reader of a release whose manifest has the digest of the changed file."""
        own = folder / f"with {name}"
        shutil.copytree(out, own)
        digest = hashlib.sha256(seeds[name]).hexdigest().encode()

        def read() -> None:
            again = hashlib.sha256((own / name).read_bytes()).hexdigest().encode()
            (own / "manifest.json").write_bytes(manifest.replace(digest, again))
            release_tables.read(own)

        return Reader(own / name, read, mutate, FILES, [seeds[name]])

    third = folder / "third"
    shutil.copytree(out, third)
    return {
        "manifest": Reader(
            third / "manifest.json", lambda: release_tables.read(third), mutations.of_json, FILES,
            [manifest],
        ),
        "release": changed("release.json", mutations.of_json),
        "periods": changed("periods.csv", mutations.of_lines),
    }  # fmt: skip


def _motion(folder: Path) -> dict[str, Reader]:
    path = folder / "a.csv"
    rows = [
        f"{0.01 * k:.2f},{np.sin(k):.4f},{np.cos(k):.4f},{k % 3}.5,{k // 30}" for k in range(60)
    ]
    seeds = ["\n".join(["time,theta0,theta1,tau0,piece", *rows]).encode()]
    rows = [f"{0.01 * k:.2f},{np.sin(k):.4f}" for k in range(25)]
    seeds.append("\r\n".join(["\ufefftime, theta0", *rows]).encode())
    rows = [row.replace(",", "\t").replace(".", ",") + "\t0,5" for row in rows]
    seeds.append("\n".join(["\tmass A", "t\tx\ty\t", *rows]).encode())
    cells = "</ColumnCells></DataColumn><DataColumn><DataObjectName>Angle</DataObjectName>"
    times, angles = ("\n".join(f"{f(k):.3f}" for k in range(25)) for f in (float, np.sin))
    seeds.append(f"<Document><DataSet><DataColumn><DataObjectName>Time</DataObjectName><ColumnCells>"
                 f"{times}{cells}<ColumnCells>{angles}</ColumnCells></DataColumn></DataSet>"
                 "</Document>".encode())  # fmt: skip
    return {"motion": Reader(path, lambda: read_motion(path), mutations.of_lines, FILES, seeds)}


def _chain(folder: Path) -> dict[str, Reader]:
    path = folder / "chain.json"
    chains = [Chain.uniform(2, 0.5), Chain.preset("acrobot"), Chain([1.0], [1.0], gear=[-3.0])]
    seeds = [json.dumps(chain.as_dict()).encode() for chain in chains]
    declared = (*VALUES, argparse.ArgumentTypeError)
    return {
        "chain": Reader(
            path, lambda: as_chain(chain_argument(str(path))), mutations.of_json, declared, seeds
        )
    }


def resting_plans(path: Path) -> EnvConfig:
    """Write the plans of a rod that stays where it hangs or stands; return its environment."""
    states = np.zeros((2, 4, 2))
    states[1, :, 0] = np.pi
    pairs = np.array([[[False], [False]], [[True], [True]]])
    motions = {"pairs": pairs, "states": states, "actions": np.zeros((2, 3, 1))}
    about = np.array(json.dumps({"arguments": {"seconds": 3.0}}))
    np.savez(path, **motions, settle=np.zeros(2), about=about)
    return EnvConfig(n=1, mode="transition")


def _transitions(folder: Path) -> dict[str, Reader]:
    path = folder / "plans.npz"
    config = resting_plans(path)
    return {
        "transitions": Reader(
            path, lambda: PlannedTransitions.load(path, config), mutations.of_archive, FILES,
            [path.read_bytes()],
        )
    }  # fmt: skip


def _benchmark(folder: Path) -> dict[str, Reader]:
    columns = {name: np.linspace(0.0, 1.0, 3) for name in ("score", "return", "motor_work")}
    columns["settling_time"] = np.array([0.5, np.nan, 1.5])
    record = {"model": {"from": "a"}, "about": {"by": "b", "env_steps": 7}, "made_by": "c"}
    episodes = {"swingup-2": columns, "calm-2": columns}
    made: dict[str, Reader] = {}
    for k, mutate in enumerate((mutations.of_json, mutations.of_lines)):
        paths = BenchmarkRun("a", "core", k, episodes, record).write(folder)

        def read(path: Path = paths[0]) -> None:
            for run in read_benchmarks([path]):
                json.dumps(run.as_dict())

        made[("benchmark", "episodes")[k]] = Reader(
            paths[k], read, mutate, FILES, [paths[k].read_bytes()]
        )
    return made


def mutants(reader: Reader, seed: int, corpus: list[bytes]):
    """Yield mutants of the reader's seeds and corpus without end; a True joins it to them."""
    rng = random.Random(seed)
    pool = [*reader.seeds, *corpus]
    while True:
        data = rng.choice(pool)
        for _ in range(rng.choice((1, 1, 1, 2))):
            data = _mutated(reader, data, rng)
        joins = yield data
        if joins and len(data) < 20_000:
            if len(pool) < 300:
                pool.append(data)
            else:
                pool[rng.randrange(len(reader.seeds), 300)] = data


def _mutated(reader: Reader, data: bytes, rng: random.Random) -> bytes:
    try:
        return reader.mutate(data, rng)
    except Exception:  # noqa: BLE001 - too damaged to be changed by its structure
        return mutations.of_bytes(data, rng)
