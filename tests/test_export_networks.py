"""Policies as files of PyTorch and ONNX, run by those libraries."""

import dataclasses
import errno
import json

import numpy as np
import pytest
from disks import FaultyDisk
from headers import CART, draw, in_float64, network, observed
from test_rl_memory import policy_with_memory

from npend_gym import __version__, _files
from npend_gym.cli import main
from npend_gym.envs import EnvConfig
from npend_gym.export import policy_of, to_onnx, to_torch
from npend_gym.rl import MPC, Policy, observation_of, state_feedback

POLICIES = {
    "calm-10": Policy.pretrained("calm-10"),
    "swingup-2": Policy.pretrained("swingup-2"),
    "swingup-3-robust": Policy.pretrained("swingup-3-robust"),
    "memory": policy_with_memory(),
    "relu, clipped": network(
        CART | {"observation": "scaled", "actuated": (0, 1)}, activation="relu", limit=1.5
    ),
    "memory, offset, clipped": dataclasses.replace(
        policy_with_memory(), limit=2.0, offset=policy_with_memory().scale
    ),
}


def in_torch(policy, path):
    """Return the policy as a function of PyTorch, of arrays, and what its file says."""
    torch = pytest.importorskip("torch")
    to_torch(policy, path)
    about = dict.fromkeys(("npend_gym", "env", "dt", "action_limits", "provenance"), "")
    module = torch.export.load(path, extra_files=about).module()

    def act(*arrays):
        outputs = module(*map(torch.tensor, arrays))
        return [each.numpy() for each in (outputs if policy.has_memory else [outputs])]

    return act, about


def in_onnx(policy, path):
    """Return the policy as a function of ONNX Runtime, of arrays, and what its file says."""
    pytest.importorskip("onnx", reason="onnx is not installed")
    runtime = pytest.importorskip("onnxruntime", reason="onnxruntime is not installed")
    to_onnx(policy, path)
    session = runtime.InferenceSession(path, providers=["CPUExecutionProvider"])
    names = [each.name for each in session.get_inputs()]
    return (
        lambda *arrays: session.run(None, dict(zip(names, arrays, strict=True))),
        session.get_modelmeta().custom_metadata_map,
    )


FORMATS = [pytest.param(in_torch, "policy.pt2", id="torch"), (in_onnx, "policy.onnx")]


@pytest.mark.parametrize(("loaded", "file"), FORMATS)
@pytest.mark.parametrize("name", POLICIES)
def test_files_act_as_the_policy_does(name, loaded, file, tmp_path):
    policy = POLICIES[name]
    act, _ = loaded(policy, tmp_path / file)
    states = draw(policy.config, 300, 20)
    observations = observed(policy.config, states)
    policy.reset(300)
    memory = [np.full((300, *policy.scale.shape), 7.0, np.float32)] * policy.has_memory
    begins, actions, ours = np.ones(300, np.bool_), [], []
    for observation in observations.swapaxes(0, 1):
        action, *memory = act(observation, *memory, *[begins] * policy.has_memory)
        actions.append(action)
        ours.append(policy(observation))
        begins = np.zeros_like(begins)
    actions, ours = np.stack(actions, 1), np.stack(ours, 1)
    print(f"{name}, {file}: largest difference {abs(actions - ours).max():.1e}")
    (exact, bound), (meant, _) = (in_float64(policy, observations, a) for a in (actions, ours))
    assert actions.dtype == np.float32
    assert (abs(actions - exact) <= bound).all()
    assert abs(ours - meant).max() <= 2.0**-25  # rounded once, from float64


@pytest.mark.parametrize(("loaded", "file"), FORMATS)
def test_an_episode_begins_without_memory_of_the_one_before(loaded, file, tmp_path):
    policy = policy_with_memory()
    act, _ = loaded(policy, tmp_path / file)
    observations = observed(policy.config, draw(policy.config, 2, 6))
    memory = np.zeros((2, *policy.scale.shape), np.float32)
    for step in range(6):  # in the second environment, another episode begins at step 3
        begins = np.array([step == 0, step in (0, 3)])
        actions, memory = act(observations[:, step], memory, begins)
    fresh = np.zeros((1, *policy.scale.shape), np.float32)
    for step in range(3, 6):
        alone, fresh = act(observations[1:, step], fresh, np.array([step == 3]))
    np.testing.assert_allclose(actions[1:], alone, rtol=0.0, atol=1e-6)


@pytest.mark.parametrize(("loaded", "file"), FORMATS)
def test_a_file_says_for_which_environment_it_is_and_what_made_it(loaded, file, tmp_path):
    policy = Policy.pretrained("swingup-2")
    _, about = loaded(policy, tmp_path / file)
    assert about["npend_gym"] == __version__
    assert json.loads(about["env"]) == policy.env
    assert json.loads(about["dt"]) == policy.config.dt
    assert json.loads(about["action_limits"]) == policy.config.action_limits.tolist()
    assert json.loads(about["provenance"]) == policy.provenance


@pytest.mark.parametrize(("form", "file"), [("torch", "policy.pt2"), ("onnx", "policy.onnx")])
def test_the_command_writes_the_file(form, file, tmp_path, refusal):
    pytest.importorskip(form, reason=f"{form} is not installed")
    assert main(["export", "calm-1", "--to", form, "-o", str(tmp_path / file)]) == 0
    assert (tmp_path / file).stat().st_size > 17_000
    wrong = ["--to", form, "-o", str(tmp_path / "policy.h")]
    assert f"out must be a file that ends in {file[6:]}" in refusal("export", "calm-1", *wrong)
    given = ["--to", form, "-o", str(tmp_path / file)]
    assert "--prefix is for --to c" in refusal("export", "calm-1", *given, "--prefix", "a")


@pytest.mark.parametrize(("write", "file"), [(to_torch, "a.pt2"), (to_onnx, "a.onnx")])
def test_a_file_that_cannot_be_written_is_an_error_that_keeps_the_older_one(
    write, file, tmp_path, monkeypatch
):
    pytest.importorskip(write.__name__.removeprefix("to_"))
    (tmp_path / file).write_text("older")
    monkeypatch.setattr(_files, "disk", FaultyDisk(1, "half", errno.ENOSPC))
    with pytest.raises(OSError, match="No space left"):
        write(POLICIES["swingup-2"], tmp_path / file)
    assert [path.read_text() for path in tmp_path.iterdir()] == ["older"]


@pytest.mark.parametrize(("loaded", "file"), FORMATS)
def test_the_file_of_a_gain_of_ones_own_is_minus_k_times_the_deviation(loaded, file, tmp_path):
    config, gain = EnvConfig(n=2, mode="balance"), np.array([-8.0, 5.0, 2.0, -1.0])
    controller = state_feedback(config, gain)
    policy = policy_of(controller)
    rng = np.random.default_rng(0)
    away = rng.uniform(-3.1, 3.1, (1000, 4))
    observation = observation_of(policy.config, np.pi + away[:, :2], away[:, 2:])
    to = {"policy.pt2": to_torch, "policy.onnx": to_onnx}[file]
    act, about = loaded(policy, tmp_path / file)
    expected = np.clip(-away @ gain / config.max_torque, -1.0, 1.0)
    np.testing.assert_allclose(act(observation)[0][:, 0], expected, rtol=0.0, atol=2e-6)
    assert json.loads(about["provenance"]) == {"controller": "state feedback", "angle": [np.pi] * 2}
    to(controller, tmp_path / ("own_" + file))
    assert (tmp_path / ("own_" + file)).stat().st_size == (tmp_path / file).stat().st_size


@pytest.mark.parametrize(("write", "file"), [(to_torch, "mpc.pt2"), (to_onnx, "mpc.onnx")])
def test_a_controller_that_is_no_linear_feedback_is_refused(write, file, tmp_path):
    with pytest.raises(TypeError, match=r"policy must be a Policy, or what rl\.lqr.* got .*MPC"):
        write(MPC(EnvConfig(n=2, mode="balance")), tmp_path / file)
