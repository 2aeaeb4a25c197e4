"""Models from files: policies, ONNX, PyTorch, Stable-Baselines3, and functions of a user."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from itertools import pairwise
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple, cast

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from npend_gym import _checks, _files
from npend_gym._extras import require
from npend_gym.chain import Chain
from npend_gym.physics import simulate
from npend_gym.rl.benchmarking.suites import BenchmarkTask, tasks_of
from npend_gym.rl.controllers.references import reference_controller
from npend_gym.rl.evaluation.settings import setting_of
from npend_gym.rl.policies.files import pretrained_names, pretrained_path
from npend_gym.rl.policies.policy import Policy
from npend_gym.theory import normal_modes

SUFFIXES = ".safetensors", ".onnx", ".pt2", ".zip"
NAMED = "pretrained", "reference", "random", "modes"  # models of the package
_RUNS_CODE = ".zip", ".pt2"  # pickles
_SHIPPED = {"swingup-2-bench": "swingup-2-robust"}  # of tasks without a policy of their name


class RunModels(NamedTuple):
    """The models of one run by their tasks, and from where they are."""

    models: dict[str, Any]
    source: dict[str, Any]  # for JSON: "from", and the SHA-256 of each file


def read_model(
    path: str | PathLike[str], env: Any = None, *, algorithm: str | None = None, trust: bool = False
) -> Any:
    """Read a model that `evaluate` and `benchmark` take.

    Parameters
    ----------
    path : path-like
        A file of `Policy.save` (.safetensors), of ONNX (.onnx), of ``torch.export`` (.pt2) or of
        Stable-Baselines3 (.zip; the statistics of a VecNormalize are beside it, in a .pkl). Or
        "package.module:name" or "file.py:name" of a function, which is imported.
    env : optional
        As for `evaluate`; of a .zip with a .pkl.
    algorithm : str, optional
        Class of Stable-Baselines3 or sb3-contrib that reads a .zip, such as "PPO".
    trust : bool
        Whether a .zip or .pt2 may be read, which can run any code.

    Returns
    -------
    Controller or Model

    Raises
    ------
    ValueError
        If there is no such model, if it is damaged or of another library, or if it must be trusted
        first.
    ImportError
        If the library that reads it is missing.

    Examples
    --------
    >>> from npend_gym import rl
    >>> rl.Policy.pretrained("balance-1").save("mine.safetensors")
    >>> rl.read_model("mine.safetensors").env["mode"]
    'balance'
    """
    text, file = str(path), Path(path)
    module, _, name = text.rpartition(":")
    if module and name.isidentifier() and file.suffix not in SUFFIXES:
        return _imported(module, name)
    if file.suffix not in SUFFIXES or not file.is_file():
        raise ValueError(
            f"model must be a file that ends in {', '.join(SUFFIXES)}, or a function as "
            f"package.module:name or file.py:name; got {_checks.show(text)}"
        )
    if file.suffix in _RUNS_CODE and not trust:
        raise ValueError(
            f"{file} must be trusted, because its pickles can run any code: give trust=True, or "
            "--trust, if it is yours"
        )
    if file.suffix == ".safetensors":
        return Policy.load(file, trust=trust)
    kind = _class_of_sb3(algorithm) if file.suffix == ".zip" else None
    try:
        if kind is not None:
            return _of_sb3(file, kind, env)
        return OnnxModel(file) if file.suffix == ".onnx" else _exported(file)
    except (ImportError, ValueError):
        raise
    except Exception as error:  # of other libraries, whose classes have no common base
        wanted = f"a model of {algorithm}" if kind else "a network that its library reads"
        raise ValueError(f"{file} must be {wanted}, got {type(error).__name__}: {error}") from error


def _imported(module: str, name: str) -> Any:
    """Return the object of this name in a module, or in a file of Python."""
    if module.endswith(".py"):
        spec = importlib.util.spec_from_file_location(Path(module).stem, module)
        if spec is None or spec.loader is None or not Path(module).is_file():
            raise ValueError(f"model must be a file of Python before the colon, got {module}")
        found = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(found)
    else:
        found = importlib.import_module(module)
    if not hasattr(found, name):
        raise ValueError(f"model must be a name in {module}, got {name!r}")
    return getattr(found, name)


def _exported(file: Path) -> Any:
    """Return the module of PyTorch in a file of ``torch.export``."""
    said = {"env": "{}"}
    loading = require("torch", "rl", "models of PyTorch").export
    module = loading.load(file, extra_files=said).module()
    module.env = _files.parse_json(said["env"] or "{}")
    return module


def _class_of_sb3(algorithm: str | None) -> Any:
    """Return a class of Stable-Baselines3 or sb3-contrib."""
    found = [
        getattr(importlib.import_module(package), algorithm or "", None)
        for package in ("stable_baselines3", "sb3_contrib")
        if importlib.util.find_spec(package)
    ]
    kind = next((each for each in found if isinstance(each, type)), None)
    if kind is None:
        raise ValueError(
            "algorithm must be a class of Stable-Baselines3 or sb3-contrib, installed, such as "
            f"PPO; got {algorithm!r}: give --algorithm"
        )
    return kind


def _of_sb3(file: Path, kind: Any, env: Any) -> Any:
    """Return a model of Stable-Baselines3, with the statistics of a VecNormalize beside it."""
    statistics, venv = file.with_suffix(".pkl"), None
    if statistics.exists():
        if env is None:
            raise ValueError(f"env must be that of {file.name}, because {statistics} normalises it")
        setting = setting_of(env)
        envs = gym.make_vec(
            setting.env_id, num_envs=1, autoreset_mode="SAME_STEP", **setting.keywords
        )
        normalising: Any = importlib.import_module("stable_baselines3.common.vec_env")
        from npend_gym.rl.adapter import SB3VecEnv  # of an extra

        venv = normalising.VecNormalize.load(str(statistics), SB3VecEnv(envs))
    return kind.load(file, env=venv, device="cpu")


class OnnxModel:
    """A model of ONNX as a controller: its first input is the observation, its first output acts.

    One with "memory" and "begins", as `to_onnx` writes it, keeps its memory from step to step.
    """

    env: Mapping[str, Any]
    """What the file says of its environment; nothing in files of other programs."""

    def __init__(self, path: Path) -> None:
        runtime = require("onnxruntime", "export", "models of ONNX")
        options = runtime.SessionOptions()
        options.intra_op_num_threads = 1  # several round otherwise
        self._session = runtime.InferenceSession(
            str(path), options, providers=["CPUExecutionProvider"]
        )
        inputs = self._session.get_inputs()
        self._name = inputs[0].name
        self._memory_shape = next((i.shape[1:] for i in inputs if i.name == "memory"), None)
        said = self._session.get_modelmeta().custom_metadata_map.get("env", "{}")
        self.env = _files.parse_json(said)
        self._memory: NDArray[Any] | None = None

    def reset(self, num_envs: int) -> None:
        """Forget what was observed."""
        if self._memory_shape is not None:
            self._memory = np.zeros((num_envs, *self._memory_shape), np.float32)

    def __call__(self, observation: Any, info: dict[str, Any]) -> NDArray[Any]:
        """Return the actions."""
        given = {self._name: np.asarray(observation, np.float32)}
        if self._memory is not None:
            begins = np.atleast_1d(info["time"]) == 0.0
            given |= {"memory": self._memory, "begins": begins}
        try:
            action, *rest = self._session.run(None, given)
        except Exception as error:  # of ONNX Runtime, whose classes have no common base
            raise ValueError(
                f"model must take observations of the shape {np.shape(observation)}, got an error "
                f"from ONNX Runtime: {error}"
            ) from error
        if self._memory is not None:
            self._memory = rest[0]
        return action


class RandomActions:
    """Actions drawn uniformly, the same for the same run."""

    def __init__(self, env: Any, run: int) -> None:
        self._space: Any = setting_of(env).config.action_space
        self._run = run
        self._rng = np.random.default_rng(run)

    def reset(self, num_envs: int) -> None:
        """Draw the same actions again."""
        del num_envs
        self._rng = np.random.default_rng(self._run)

    def __call__(self, observation: Any, info: dict[str, Any]) -> NDArray[Any]:
        """Return the actions."""
        del info
        return self._rng.uniform(-1.0, 1.0, (len(observation), *self._space.shape))


def simulated(chain: Chain, theta: Any, omega: Any, times: Any) -> NDArray[np.float64]:
    """Predict releases as `simulate` does, with its default tolerances."""
    return simulate(chain, theta, omega, times).theta


def small_swings(chain: Chain, theta: Any, omega: Any, times: Any) -> NDArray[np.float64]:
    """Predict releases by the normal modes, as if the angles were small."""
    frequency, modes = normal_modes(chain)
    amplitude = np.linalg.solve(modes, np.asarray(theta).T)  # (modes, B)
    rate = np.linalg.solve(modes, np.asarray(omega).T) / frequency[:, None]
    phase = np.multiply.outer(times, frequency)[:, :, None]  # (T, modes, 1)
    return np.einsum("im,tmb->bti", modes, amplitude * np.cos(phase) + rate * np.sin(phase))


def read_models(
    source: str,
    suite: str,
    *,
    algorithm: str | None = None,
    trust: bool = False,
    progress: Callable[[Iterable[Any]], Iterable[Any]] = iter,
) -> dict[int, RunModels]:
    """Return the models of each run for the tasks of a suite.

    Parameters
    ----------
    source : str
        "pretrained", "reference" or "random", in "release" "reference" or "modes". Or a folder with
        a file for each task, such as "swingup-2.zip", or with such a folder for each run, named by
        its seed. Or a file with the name of its task, or a function for all tasks.
    suite : str
    algorithm, trust
        As for `read_model`.
    progress : callable
        May wrap the iteration over the plans of "reference".

    Raises
    ------
    ValueError
        If there is no model for any task.
    """
    tasks, folder = tasks_of(suite), Path(source)
    if source in NAMED:
        own: dict[str, Any] = {"from": source}
        if source == "pretrained":
            own["sha256"] = {
                name: _files.sha256(pretrained_path(name)) for name in _shipped(tasks).values()
            }
        return {0: RunModels(_named(source, suite, progress), own)}
    read = partial(read_model, algorithm=algorithm, trust=trust)
    if folder.is_dir():
        runs = {int(each.name): each for each in folder.iterdir() if each.name.isdecimal()}
        return {
            run: _of_files(sorted(runs[run].iterdir()), tasks, read, runs[run])
            for run in sorted(runs)
        } or {0: _of_files(sorted(folder.iterdir()), tasks, read, folder)}
    if folder.is_file():
        return {0: _of_files([folder], tasks, read, folder)}
    function, own = read(source), {"from": source}
    module = Path(source.rpartition(":")[0])
    if module.suffix == ".py":
        own["sha256"] = {module.name: _files.sha256(module)}
    is_mapping = isinstance(function, Mapping)
    given = (
        dict(cast("Mapping[str, Any]", function)) if is_mapping else dict.fromkeys(tasks, function)
    )
    return {0: RunModels(given, own)}


def _of_files(
    files: Iterable[Path], tasks: Mapping[str, BenchmarkTask], read: Any, where: Path
) -> RunModels:
    """Return the models in files whose names are those of the tasks."""
    own = [file for file in files if file.stem in tasks]
    found = [file for file in own if file.suffix in SUFFIXES]
    for file, other in pairwise(found):
        if file.stem == other.stem:
            raise ValueError(f"model must have one file for {file.stem}, got {file} and {other}")
    models = {file.stem: read(file, tasks[file.stem].env) for file in found}
    if not models:
        raise ValueError(
            f"model must have a file for a task, {', '.join(tasks)}, that ends in "
            f"{', '.join(SUFFIXES)}; got {where}"
        )
    return RunModels(
        models, {"from": where.name, "sha256": {f.name: _files.sha256(f) for f in own}}
    )


def _named(
    name: str, suite: str, progress: Callable[[Iterable[Any]], Iterable[Any]]
) -> dict[str, Any]:
    """Return models that the package brings."""
    tasks = tasks_of(suite)
    if suite == "release":
        predicted = {"reference": simulated, "modes": small_swings}
        _checks.choice("model", name, tuple(predicted))
        return dict.fromkeys(tasks, predicted[name])
    _checks.choice("model", name, NAMED[:3])
    if name == "random":
        return {task: RandomActions(each.env, 0) for task, each in tasks.items()}
    if name == "reference":
        return {
            task: reference_controller(each.controller, each.env, progress)
            for task, each in tasks.items()
            if each.controller
        }
    return {task: Policy.pretrained(file) for task, file in _shipped(tasks).items()}


def _shipped(tasks: Iterable[str]) -> dict[str, str]:
    """Return the names of the policies of the package by the tasks that have one."""
    named = {task: _SHIPPED.get(task, task) for task in tasks}
    return {task: name for task, name in named.items() if name in pretrained_names()}
