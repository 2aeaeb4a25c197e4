"""Short computations and the digests that their results must have, the same on every machine.

A digest that differs means that this machine, or its versions of Numba and NumPy, computes
something else; the name of the check says where to look.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

from npend_gym.chain import Cart, Chain
from npend_gym.compiled.normal import make_normal
from npend_gym.envs.modes import MODES
from npend_gym.envs.registration import ENV_ID
from npend_gym.experiments import starts
from npend_gym.period import DEFINITIONS, pseudo_periods
from npend_gym.physics import Trajectory, simulate

ENV_STEPS = 120
LINKS = {"inertias": 0.05, "centres": 0.6}
MACHINERY = {"friction": 0.02, "armature": 0.01, "gear": -6.0, "drag": 0.05}

# fmt: off
GOLDEN: dict[str, str] = {
    "simulate, dop853":
        "1465e6344d1e50735695fdf0a573fe497284894e1b2e30d80f1e1a0e4aaf712a",
    "simulate, rk4":
        "73713f4137f1f45fcd8c3a77cfedfa73cf9dd3d08a078b26e38831f87f9277c2",
    "simulate, cart":
        "a2ad67a876409adf649207b13ee73f262c7e48143120961fe35ace06752d5f07",
    "simulate, shaken pivot":
        "767ea39dc7a011f9c68a8e75e3a5c31319aeeb48481c94b6eeaf00a6489a5cc7",
    "simulate, drag":
        "f05dc6231a8b15f2bb5713d86485b9eee9b100cb6dd91cff0e5c579ea977c9e1",
    "simulate, springs":
        "1fd01aa99ebe44f1ed936b4435ab03012b0e9d1a116bc259cc636fc4312feeb8",
    "pseudo-periods, bob":
        "79f893c0ebf178d6382c004f054e2ee301c1bb5d72472804473a42710975dc1e",
    "pseudo-periods, link":
        "b40d5ef788e36e4cf6da895706f777ad88ccf6dd2cfde22ea1fad8fdf8aea902",
    "pseudo-periods, height":
        "7b604ea4c26d56468f82c82efc5a4dcfa55372748e5484b86b91553e58894d41",
    "pseudo-periods, com":
        "f72f7d9b34cf85bcc0bf3e431b94448afa3819b2d7296fd2b0ab264247ee8884",
    "pseudo-periods, horizontal":
        "79f893c0ebf178d6382c004f054e2ee301c1bb5d72472804473a42710975dc1e",
    "random numbers":
        "d5b23020686d4b80c904fa907482e42fffdc6c8aca01fe76f8d4527e70a32263",
    "environment, passive":
        "f9fac8dcaaf3e39128c5d3fe93746a4584a9b08c8397cd4a2aa7104e6c180c0c",
    "environment, swingup":
        "1fe35c89cdfa13b629170970c76b88a7a9dfc066ecb5d63c25226f972a8758ed",
    "environment, balance":
        "a25f017847a15d596e5ae27fa7c18e0cd16044b863dec2b0f21ca5b33ef24941",
    "environment, calm":
        "e52a1022e443df559aa7426f7598253ae9cc46176b04bc8ab03409f06e4d17e4",
    "environment, transition":
        "e89d2be29b305061d6445a0113260ed1f6e961b4bf8164eceb02de6953e149c9",
    "vector environment, passive":
        "db2eb2a8d54e4d4dc68ef6bd5fb98283d558a8484f269876f9c9e50e016dc42b",
    "vector environment, swingup":
        "ba788c5d91aedefbf1663eb30ca8ee9ffc7de2cbac986dbde966d525c3d2472c",
    "vector environment, balance":
        "f4ab7b712ed1b455657e9c658d7ae5a099a2fb385538aa1c1d3866fcd9d6d12f",
    "vector environment, calm":
        "4600019c204e57df25af02e3b177fbfb945845c258cf722ebe82dad5becca12e",
    "vector environment, transition":
        "315f53e6bc7788da3b30be054d7d2a2b4fb2e1d8db033c610fa6906f8d4cbc2f",
    "simulate, links":
        "0b76b87e9437f8ccb2a3b3e4df8881ef8fe0647364f5d7c2587c7aefe1a313c7",
    "simulate, machine":
        "84b23e7b54a64b7520b4de5cbf0616b50889d21bbe7b9e8dfddf534b173f91a9",
    "vector environment, machine":
        "e2bc33623022f06c43b028b0666b328862a642c4ba48c2f5c281d7aa1fd1e4e6",
}
# fmt: on


class Digest(NamedTuple):
    """A check with the expected and the computed SHA-256 of its results."""

    name: str
    golden: str
    found: str

    @property
    def same(self) -> bool:
        """Whether no byte differs."""
        return self.golden == self.found


def outcomes() -> Iterator[Digest]:
    """Yield the outcome of every check."""
    for name, compute in checks().items():
        digest = hashlib.sha256()
        for array in compute():
            digest.update(np.ascontiguousarray(array).tobytes())
        yield Digest(name, GOLDEN.get(name, ""), digest.hexdigest())


def checks() -> dict[str, Callable[[], Iterator[Any]]]:
    """Return the checks by name; each yields arrays and numbers."""
    motions: dict[str, dict[str, Any]] = {
        "dop853": {},
        "rk4": {"method": "rk4", "dt": 0.01},
        "shaken pivot": {"pivot_acceleration": (0.5, -1.0)},
    }
    return {
        **{f"simulate, {name}": _motion(options) for name, options in motions.items()},
        "simulate, cart": _motion({"force": 0.5}, base=Cart(2.0)),
        "simulate, springs": _motion({}, stiffness=500.0, axial_damping=0.1),
        "simulate, drag": _motion({}, drag=0.05, quadratic_drag=0.02),
        "simulate, links": _motion({}, **LINKS),
        "simulate, machine": _motion({}, base=Cart(2.0), **LINKS, **MACHINERY),
        **{f"pseudo-periods, {definition}": _periods(definition) for definition in DEFINITIONS},
        "random numbers": _random_numbers,
        **{f"environment, {mode}": _single(mode) for mode in MODES},
        **{f"vector environment, {mode}": _vector(mode) for mode in MODES},
        "vector environment, machine": _vector(
            "swingup", {"masses": [1.0, 0.5], "lengths": [0.5, 0.3], **LINKS, **MACHINERY}
        ),
    }


def _motion(options: dict[str, Any], **parts: Any) -> Callable[[], Iterator[Any]]:
    def compute() -> Iterator[Any]:
        chain = Chain(np.linspace(1.0, 2.0, 7), np.linspace(1.0, 0.5, 7), damping=0.01, **parts)
        times, torque = np.linspace(0.0, 3.0, 31), np.linspace(3.0, -1.0, 7)
        path: Trajectory = simulate(chain, 1.2, 0.3, times, torque=torque, **options)
        yield from (path.theta, path.omega, path.positions(), path.energy())

    return compute


def _periods(definition: str) -> Callable[[], Iterator[Any]]:
    def compute() -> Iterator[Any]:
        for n in (1, 5, 20):
            yield pseudo_periods(Chain.uniform(n), 0.7, definition=definition)
        starts = np.outer(np.linspace(0.1, 1.0, 17), np.ones(3))
        yield pseudo_periods(Chain.uniform(3), starts, definition=definition)

    return compute


def _random_numbers() -> Iterator[Any]:
    u, v = np.reshape(starts(2**64 - 500, 0, 2000, 0.0, 1.0), (2, 1000))
    yield from (u, v)
    make_normal(u, v)
    yield from (u, v)


def _single(mode: str) -> Callable[[], Iterator[Any]]:
    def compute() -> Iterator[Any]:
        for n in (1, 2, 10):
            env = gym.make(ENV_ID, n=n, mode=mode, damping=0.02, observation="sincos")
            env.action_space.seed(1)
            yield env.reset(seed=1)[0]
            for _ in range(ENV_STEPS):
                observation, reward, _, _, info = env.step(env.action_space.sample())
                yield from (observation, reward, info["energy"], info["energy_error"])

    return compute


def _vector(mode: str, chain: dict[str, Any] | None = None) -> Callable[[], Iterator[Any]]:
    def compute() -> Iterator[Any]:
        given: dict[str, Any] = {"n": 3, "drag": 0.1} if chain is None else {"chain": chain}
        envs = gym.make_vec(
            ENV_ID,
            num_envs=20,
            mode=mode,
            max_episode_steps=40,
            threads=2,
            measure_periods=True,
            **given,
        )
        envs.action_space.seed(1)
        yield envs.reset(seed=1)[0]
        for _ in range(ENV_STEPS):
            observation, reward, terminated, _, info = envs.step(envs.action_space.sample())
            yield from (observation, reward, terminated, info["energy"], info["pseudo_periods"])
        envs.close()

    return compute
