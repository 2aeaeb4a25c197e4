"""The files of policies: what is saved is loaded again, what is no policy is refused by name."""

import json
import os
import pickle
import zlib

import numpy as np
import pytest
from policy_files import header, random_policy, save_changed, small_policy
from safetensors.numpy import load_file

from npend_gym import Chain
from npend_gym.envs import SwingUp
from npend_gym.rl import Policy, pretrained_names
from npend_gym.rl.policies.files import MAX_BYTES, PRETRAINED


def test_one_file_of_safetensors_holds_all_of_a_policy_and_the_library_itself_reads_it(tmp_path):
    policy = Policy.pretrained("swingup-1")
    policy.save(tmp_path / "a.safetensors")
    assert [path.name for path in tmp_path.iterdir()] == ["a.safetensors"]
    again = Policy.load(tmp_path / "a.safetensors")
    assert again == policy
    assert again.provenance == policy.provenance
    arrays = load_file(tmp_path / "a.safetensors")
    np.testing.assert_array_equal(arrays["weight0"], policy.weights[0])
    assert len(arrays) == 1 + 2 * len(policy.weights)


@pytest.mark.parametrize("name", pretrained_names())
def test_a_policy_that_ships_is_small_and_saved_again_has_the_same_bytes(name, tmp_path):
    shipped = (PRETRAINED / f"{name}.safetensors").read_bytes()
    policy = Policy.pretrained(name)
    policy.save(tmp_path / "a.safetensors")
    assert (tmp_path / "a.safetensors").read_bytes() == shipped
    of_goals = 2 ** policy.env["n"] if policy.provenance["arguments"].get("by_goal") else 1
    networks = len(policy.provenance.get("members", [policy])) * of_goals  # of an ensemble
    largest = 500_000 if policy.env["n"] > 3 else 350_000  # bytes in a wheel
    assert len(zlib.compress(shipped)) < largest * networks


@pytest.mark.parametrize(
    "change",
    [
        np.asfortranarray,
        lambda x: x.repeat(2, -1)[..., ::2],
        lambda x: x.astype(">f4"),
        lambda x: x.astype(np.float64),
    ],
    ids=["columns", "every other", "big-endian", "float64"],
)
def test_arrays_of_any_type_in_any_memory_are_saved_by_their_values(change, tmp_path):
    policy = small_policy()
    weights = [change(weight) for weight in policy.weights]
    changed = small_policy(scale=change(policy.scale), weights=weights)
    for name, each in {"a": policy, "b": changed}.items():
        each.save(tmp_path / f"{name}.safetensors")
    assert Policy.load(tmp_path / "b.safetensors") == policy
    found = [(tmp_path / f"{name}.safetensors").read_bytes() for name in "ab"]
    assert found[0] == found[1]


def test_damage_that_gives_another_description_is_noticed(tmp_path):
    path = tmp_path / "a.safetensors"
    small_policy(provenance={"seed": 17}).save(path)
    path.write_bytes(path.read_bytes().replace(b"17", b"18"))
    with pytest.raises(ValueError, match=r"a\.safetensors is no policy: it is damaged"):
        Policy.load(path)


NUMBERS = {"shape": [4], "data_offsets": [0, 16]}


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\xff" * 100,
        header(),
        header(scale=NUMBERS | {"dtype": "F32"}),
        header(scale={"dtype": "F32", "shape": [10**12], "data_offsets": [0, 4 * 10**12]}),
        header(scale={"dtype": "F32", "shape": [0, 2**62], "data_offsets": [0, 0]}),
        header(scale={"dtype": "F32", "shape": [1] * 70, "data_offsets": [0, 4]}, data=b"0" * 4),
        header(scale=NUMBERS | {"dtype": "F32"}, data=b"0" * 16),  # without a description
        header(scale=NUMBERS | {"dtype": "BF16", "shape": [8]}, data=b"0" * 16),
        header(scale=NUMBERS | {"dtype": "F8_E4M3", "shape": [16]}, data=b"0" * 16),
        header(__metadata__={"npend_gym": 3}),
        b"\xff\xff\xff\xff\xff\xff\xff\x7f{}",
        b"PK\x03\x04" + b"0" * 100,
        b"0" * (MAX_BYTES + 1),
    ],
    ids=range(14),
)
def test_a_file_that_is_no_policy_is_refused_by_name(content, tmp_path):
    (tmp_path / "a.safetensors").write_bytes(content)
    with pytest.raises(ValueError, match=r"a\.safetensors is no policy"):
        Policy.load(tmp_path / "a.safetensors")


def test_a_file_that_is_absent_a_folder_or_a_fifo_is_refused_by_name(tmp_path):
    path = tmp_path / "a.safetensors"
    with pytest.raises(FileNotFoundError, match=r"a\.safetensors"):
        Policy.load(path)
    places = [path.mkdir]
    if hasattr(os, "mkfifo"):
        places.append(lambda: (path.rmdir(), os.mkfifo(path)))
    for make in places:
        make()
        with pytest.raises(ValueError, match=r"a\.safetensors is no policy: it is no file"):
            Policy.load(path)


def test_a_policy_for_the_default_environment_says_so(tmp_path):
    small_policy(env={}).save(tmp_path / "a.safetensors")
    assert Policy.load(tmp_path / "a.safetensors").env == {}


class Malice:
    """Runs code when it is unpickled."""

    def __reduce__(self):
        return (pytest.fail, ("a pickle was executed",))


def test_a_pickle_is_refused_and_not_executed(tmp_path):
    bare, packed = tmp_path / "bare.safetensors", tmp_path / "packed.npz"
    bare.write_bytes(pickle.dumps(Malice()))
    np.savez(packed, scale=np.array([Malice()], dtype=object), weight0=np.ones(1), bias0=np.ones(1))
    for path, message in ((bare, "is no policy"), (packed, "policies are .safetensors")):
        with pytest.raises(ValueError, match=message):
            Policy.load(path)


def test_the_error_for_a_npz_of_an_earlier_version_has_the_code_that_converts_it(tmp_path):
    policy = small_policy(
        offset=np.linspace(0.0, 1.0, 6, dtype=np.float32), limit=10.0, activation="relu"
    )
    about = {"env": policy.env, **policy.provenance, "network": {"limit": 10.0}}
    about["network"]["activation"] = "relu"
    arrays = {f"weight{k}": np.asfortranarray(w) for k, w in enumerate(policy.weights)}
    arrays |= {f"bias{k}": bias for k, bias in enumerate(policy.biases)}
    arrays |= {"scale": policy.scale, "offset": policy.offset, "about": np.array(json.dumps(about))}
    np.savez_compressed(tmp_path / "a.npz", **arrays)
    with pytest.raises(ValueError, match=r"policies are \.safetensors files, got .*a\.npz") as told:
        Policy.load(tmp_path / "a.npz")
    assert "\n" not in str(told.value)
    exec(str(told.value).partition("earlier version: ")[2], {})
    again = Policy.load(tmp_path / "a.safetensors")
    assert again == policy
    assert again.provenance == policy.provenance


@pytest.mark.parametrize("name", ["a.pt", "a", "a.zip"])
def test_a_path_that_names_another_format_is_refused(name, tmp_path):
    with pytest.raises(ValueError, match=r"path must end in \.safetensors"):
        small_policy().save(tmp_path / name)
    with pytest.raises(ValueError, match=r"path must end in \.safetensors"):
        Policy.load(tmp_path / name)
    assert not list(tmp_path.iterdir())


def filled(value, *shape):
    return np.full(shape, value, np.float32)


def nested(depth):
    return [] if depth == 1 else [nested(depth - 1)]


WIDE = {
    "weights": [filled(0.0, 2300, 6), filled(0.0, 2300, 2300), filled(0.0, 1, 2300)],
    "biases": [filled(0.0, 2300), filled(0.0, 2300), filled(0.0, 1)],
}


OWN_MODE = {"env": {"n": 2, "mode": SwingUp(), "observation": "sincos"}}


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        (WIDE, ValueError, f"a policy must have at most {MAX_BYTES} bytes, got 2"),
        ({"provenance": {"x": nested(40)}}, ValueError, "^env and provenance .*deeper than 32"),
        ({"provenance": {"x": np.nan}}, TypeError, "^env and provenance must hold what JSON can"),
        (OWN_MODE, TypeError, "^env and provenance must hold what JSON can"),
    ],
    ids=["large", "deep", "NaN", "mode"],
)
def test_a_policy_that_could_not_be_read_again_is_not_written(changes, error, message, tmp_path):
    with pytest.raises(error, match=message):
        small_policy(**changes).save(tmp_path / "a.safetensors")
    assert not list(tmp_path.iterdir())


INFINITE = {"masses": [1.0], "lengths": [1.0], "armature": 0.1}


@pytest.mark.parametrize(
    "chain",
    [
        *(INFINITE | {"gear": gear} for gear in (np.inf, [np.inf], np.array([-np.inf]))),
        Chain.rods(1.0, 0.7, friction=0.1),
    ],
    ids=["inf", "[inf]", "array", "Chain"],
)
def test_the_chain_of_a_policys_environment_is_saved(chain, tmp_path):
    policy = random_policy([(4, 3), (1, 4)], {"chain": chain, "observation": "sincos"})
    policy.save(tmp_path / "a.safetensors")
    again = Policy.load(tmp_path / "a.safetensors")
    assert again == policy
    assert again.config.chain == (chain if isinstance(chain, Chain) else Chain.from_dict(chain))


HUGE = 3e38


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"scale": None}, "it holds"),
        ({"extra": filled(1.0, 3)}, "it holds"),
        ({"scale": filled(1.0, 5)}, r"must have the shapes \(m, 5\) and \(m,\)"),
        ({"scale": filled(1.0)}, r"scale must have .*, got \(\)"),
        ({"scale": filled(1.0, 0)}, r"scale must have .*, got \(0,\)"),
        ({"scale": filled(1.0, 1, 1, 6)}, r"scale must have .*, got \(1, 1, 6\)"),
        ({"bias1": filled(1.0, 4, 1)}, r"got \(4, 4\) and \(4, 1\)"),
        ({"bias2": filled(0.0)}, r"got \(1, 4\) and \(\)"),
        ({"bias2": filled(0.0, 0), "weight2": filled(0.5, 0, 4)}, r"got \(0, 4\) and \(0,\)"),
        ({"bias1": np.ones(4)}, "float32"),
        ({"bias1": np.ones(4, np.int32)}, "float32"),
        ({"bias1": filled(np.nan, 4)}, "finite"),
        ({"scale": filled(0.0, 6)}, "overflow"),
        ({"scale": filled(1e-40, 6)}, "overflow"),
        ({"weight0": filled(HUGE, 4, 6)}, "overflow"),
        ({"weight2": filled(HUGE, 1, 4)}, "overflow"),
        ({"bias2": filled(HUGE, 1), "weight2": filled(HUGE / 4.0, 1, 4)}, "overflow"),
    ],
)
def test_arrays_that_do_not_form_a_network_or_overflow_are_refused(changes, message, tmp_path):
    save_changed(small_policy(), tmp_path / "a.safetensors", **changes)
    with pytest.raises(ValueError, match=rf"a\.safetensors is no policy.*{message}"):
        Policy.load(tmp_path / "a.safetensors")


@pytest.mark.parametrize(
    ("changed", "text"),
    [
        ({"network": {"activation": "exec"}}, "activation must be one of"),
        ({"network": {"output": 3}}, "output must be"),
        ({"network": {"limit": -1.0}}, "limit must be"),
        ({"network": [1]}, "its network must have"),
        ({"network": {"code": "x"}}, "its network must have"),
        ({"network": {"activation": "relu"}}, "overflow"),
        ({"offset": np.zeros(5, np.float32)}, "offset must have the shape"),
    ],
)
def test_a_network_that_no_policy_has_is_refused(changed, text, tmp_path):
    large = [weight * np.float32(1e12) for weight in small_policy().weights]
    policy, path = small_policy(weights=large), tmp_path / "a.safetensors"
    policy.save(path)
    Policy.load(path)  # tanh layers keep it from overflowing
    if "network" in changed:
        changed = {"about": json.dumps({"env": policy.env} | changed)}
    save_changed(policy, path, **changed)
    with pytest.raises(ValueError, match=text):
        Policy.load(path)
