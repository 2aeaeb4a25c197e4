import json
import pickle
import zipfile

import numpy as np
import pytest

from npend_gym.rl.evaluation import evaluate
from npend_gym.rl.policies import MAX_BYTES, PRETRAINED, Policy, pretrained_names


def small_policy():
    rng = np.random.default_rng(0)
    sizes = [(4, 6), (4, 4), (1, 4)]
    return Policy(
        scale=np.full(6, 2.0, np.float32),
        weights=[rng.normal(size=size).astype(np.float32) for size in sizes],
        biases=[rng.normal(size=size[:1]).astype(np.float32) for size in sizes],
        provenance={"env": {"n": 2}},
    )


def test_a_policy_is_the_network_it_says():
    torch = pytest.importorskip("torch")
    policy = small_policy()
    layers = []
    for weight, bias in zip(policy.weights, policy.biases, strict=True):
        layer = torch.nn.Linear(weight.shape[1], weight.shape[0])
        layer.weight.data, layer.bias.data = torch.from_numpy(weight), torch.from_numpy(bias)
        layers += [layer, torch.nn.Tanh()]
    seen = np.random.default_rng(1).normal(size=(50, 6)).astype(np.float32)
    with torch.no_grad():
        expected = torch.nn.Sequential(*layers[:-1])(torch.from_numpy(seen / 2.0)).clamp(-1.0, 1.0)
    np.testing.assert_allclose(policy(seen), expected.numpy(), atol=1e-6)
    assert 0 < np.sum(np.abs(policy(seen)) < 1.0) < 50  # some are cut off, some are not


def test_a_saved_policy_comes_back_with_its_provenance(tmp_path):
    policy = small_policy()
    policy.save(tmp_path / "a.npz")
    again = Policy.load(tmp_path / "a.npz")
    seen = np.ones((3, 6), np.float32)
    np.testing.assert_array_equal(policy(seen), again(seen))
    assert again.provenance == json.loads((tmp_path / "a.json").read_text()) == policy.provenance


def test_a_policy_is_saved_and_loaded_by_a_string_too(tmp_path):
    small_policy().save(str(tmp_path / "a.npz"))
    assert Policy.load(str(tmp_path / "a.npz")).provenance == small_policy().provenance


class Malice:
    """Runs code when it is unpickled."""

    def __reduce__(self):
        return (pytest.fail, ("a pickle was executed",))


def test_a_pickle_is_refused_and_not_executed(tmp_path):
    bare, packed = tmp_path / "bare.npz", tmp_path / "packed.npz"
    bare.write_bytes(pickle.dumps(Malice()))
    np.savez(packed, scale=np.array([Malice()], dtype=object), weight0=np.ones(1), bias0=np.ones(1))
    for path in (bare, packed):
        with pytest.raises(ValueError, match="is no policy"):
            Policy.load(path)


def test_a_zip_of_other_things_is_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("scale", "import os")
        archive.writestr("weight0.npy", b"\x93NUMPY")
    with pytest.raises(ValueError, match="is no policy"):
        Policy.load(tmp_path / "a.npz")


def test_a_file_that_would_fill_the_memory_is_refused_unread(tmp_path):
    np.savez_compressed(tmp_path / "a.npz", scale=np.zeros(MAX_BYTES // 4 + 1, np.float32))
    assert (tmp_path / "a.npz").stat().st_size < MAX_BYTES // 100
    with pytest.raises(ValueError, match="bytes unpacked, at most"):
        Policy.load(tmp_path / "a.npz")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"scale": None}, "it holds"),
        ({"extra": np.ones(3, np.float32)}, "it holds"),
        ({"scale": np.ones(5, np.float32)}, r"for inputs of shape \(5,\)"),
        ({"bias1": np.ones((4, 1), np.float32)}, "biases of shape"),
        ({"bias1": np.ones(4)}, "finite float32"),
        ({"bias1": np.full(4, np.nan, np.float32)}, "finite float32"),
    ],
)
def test_numbers_that_are_no_network_are_refused(changes, message, tmp_path):
    small_policy().save(tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as file:
        arrays = dict(file) | changes
    np.savez(tmp_path / "b.npz", **{k: v for k, v in arrays.items() if v is not None})
    with pytest.raises(ValueError, match=message):
        Policy.load(tmp_path / "b.npz")


def test_an_unknown_pretrained_policy_is_refused_with_the_names_there_are():
    with pytest.raises(ValueError, match="pretrained must be one of"):
        Policy.pretrained("swingup-99")
    with pytest.raises(ValueError, match="pretrained must be one of"):
        Policy.pretrained("../policies")
    assert "swingup-99" not in pretrained_names()


@pytest.mark.parametrize("name", pretrained_names())
def test_a_pretrained_policy_is_small_and_does_what_it_says(name):
    policy = Policy.pretrained(name)
    said = policy.provenance["evaluation"]
    assert (PRETRAINED / f"{name}.npz").stat().st_size < 200_000
    seen = evaluate(policy, policy.provenance["env"], episodes=said["episodes"])
    assert seen.rate == pytest.approx(said["success"], abs=0.03)  # tanh is the system's own
    assert seen.rate > 0.9


def test_the_pretrained_double_pendulum_is_there():
    assert "swingup-2" in pretrained_names()
