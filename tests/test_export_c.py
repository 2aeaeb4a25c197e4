import ctypes
import dataclasses
import os
import re
import shutil
import subprocess

import numpy as np
import pytest
from headers import (
    CALLS,
    CART,
    FLAGS,
    LOOP_OF_POLICY,
    bytes_of,
    compiled,
    draw,
    in_c,
    in_float64,
    in_python,
    network,
    observed,
    ticks_standing,
)
from test_rl_memory import policy_with_memory

from npend_gym import __version__
from npend_gym.cli import main
from npend_gym.export import to_c
from npend_gym.rl import Policy, VelocityEstimator

pytestmark = pytest.mark.skipif(os.name != "posix", reason="the options of compilers elsewhere")


def check(library, policy, states, rounded, **options):
    """Compare what C observes, its actions and torques with those of Python and of exact sums."""
    observations, actions, torques = in_c(library, policy, states)
    np.testing.assert_array_equal(observations, observed(policy.config, states, **options))
    ours = in_python(policy, observations)
    print(f"largest difference {abs(actions - ours).max() * 2**24:.0f} of 2^-24")
    np.testing.assert_allclose(actions, ours, rtol=0.0, atol=rounded)
    exact, bound = in_float64(policy, observations, actions)
    assert (abs(actions - exact) <= bound).all()
    assert np.any(abs(actions) < 1.0)
    np.testing.assert_array_equal(torques, actions * policy.config.action_limits)


@pytest.mark.parametrize("compiler", ["gcc", "clang", "zig", "tcc"])
@pytest.mark.parametrize("name", [
    "balance-1", "calm-10", *(pytest.param(name, marks=pytest.mark.long) for name in (
        "balance-5-cart", "swingup-2-pendubot", "transition-2",
    )), *(pytest.param(name, marks=[pytest.mark.long, pytest.mark.nightly]) for name in (
        "swingup-3-robust", "swingup-5",
    ))
])  # fmt: skip
def test_c_observes_and_acts_as_python_does_in_many_states(name, compiler, tmp_path):
    policy = Policy.pretrained(name)
    # balance-5-cart multiplies angles by 1300
    rounded = {"balance-5-cart": 1e-4, "swingup-3-robust": 3e-5, "swingup-5": 5e-5}.get(name, 1e-5)
    states = draw(policy.config, 1000, 20 if name == "swingup-3-robust" else 100)
    check(compiled(policy, tmp_path, compiler), policy, states, rounded)


@pytest.mark.parametrize("policy", [
    policy_with_memory(),
    network(CART | {"observation": "scaled", "actuated": (0, 1)}, activation="relu", limit=1.5),
    network(CART | {"observation": "sincos", "observe_velocities": False}, output="tanh"),
    network(CART | {"observation": "angles"}, limit=2.0),
    network({"n": 2, "mode": "transition", "observation": "sincos"}),
], ids=["memory", "relu, clipped", "no velocities", "angles", "goals"])  # fmt: skip
@pytest.mark.parametrize("relative", [False, True])
def test_whatever_a_policy_observes_and_computes_is_in_the_header(policy, relative, tmp_path):
    library = compiled(policy, tmp_path, relative=relative)
    check(library, policy, draw(policy.config, 200, 20), 3e-5, relative=relative)


@pytest.mark.parametrize(
    ("name", "relative"),
    [
        pytest.param("swingup-2", True, marks=pytest.mark.long),
        pytest.param("swingup-2", False, marks=pytest.mark.long),
        pytest.param("swingup-3-robust", True, marks=pytest.mark.long),
    ],
)
def test_c_swings_rods_up_from_what_encoders_of_4096_counts_show(name, relative, tmp_path):
    policy = Policy.pretrained(name)
    library = compiled(policy, tmp_path, driver=LOOP_OF_POLICY, relative=relative)
    start = [0.1, -0.05, 0.02][: policy.config.n]
    assert ticks_standing(library, policy.config, start, 25_000, relative) > 5000


def test_tanh_in_c_is_within_2_ulp(tmp_path):
    library = compiled(Policy.pretrained("calm-1"), tmp_path)
    x = np.concatenate([np.linspace(-10.0, 10.0, 10**6), 10.0 ** np.linspace(-30, 30, 10**4)])
    x = np.float32(x)
    y = np.empty_like(x)
    library.tanhs(x.size, *(array.ctypes.data_as(ctypes.c_void_p) for array in (x, y)))
    exact = np.tanh(x.astype(np.float64))
    ulp = np.spacing(abs(np.float32(exact))).astype(np.float64)
    ours, theirs = (abs((each - exact) / ulp).max() for each in (y, np.tanh(x)))
    print(f"tanh: {ours:.2f} ulp, in NumPy {theirs:.2f}")
    assert ours < 2.0


@pytest.mark.parametrize(("tau", "period"), [(0.02, 2.0 * np.pi), (0.005, 0.0)])
def test_velocities_in_c_have_the_bits_of_the_estimator(tau, period, tmp_path):
    library, rng = compiled(Policy.pretrained("calm-1"), tmp_path), np.random.default_rng(0)
    dt = rng.uniform(0.001, 0.02, 20_000)
    angle = np.cumsum(dt * 9.0 * np.sin(np.arange(dt.size) / 300.0))
    shown = np.round(angle * 4096 / (2.0 * np.pi)) % 4096 * (2.0 * np.pi / 4096)
    estimator, found = VelocityEstimator(tau, period), np.empty_like(shown)
    doubles = ctypes.c_double(tau), ctypes.c_double(period)
    pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in (shown, dt, found)]
    library.estimates(shown.size, *pointers[:2], *doubles, pointers[2])
    expected = [float(estimator(*now)) for now in zip(shown, dt, strict=True)]
    np.testing.assert_array_equal(found, expected)


def test_a_number_that_is_none_stays_one(tmp_path):
    policy = Policy.pretrained("calm-1")
    states = draw(policy.config, 3, 1)
    states[0][0], states[1][1] = np.nan, np.nan
    observations, actions, torques = in_c(compiled(policy, tmp_path), policy, states)
    assert [
        np.isnan(array).any(axis=(1, 2)).tolist() for array in (observations, actions, torques)
    ] == [[True, True, False]] * 3


@pytest.mark.parametrize("name", ["swingup-2", "balance-2", "calm-2", "calm-2-robust"])
def test_two_rods_need_less_than_20_kilobytes_and_no_library(name, tmp_path):
    to_c(Policy.pretrained(name), tmp_path / "policy.h", prefix="p")
    size = bytes_of(tmp_path, CALLS)
    print(f"{name}: {size} bytes")
    assert size < 20_000


def test_several_policies_stand_in_one_program_of_c_or_cpp(tmp_path):
    for name in ("calm-1", "swingup-2"):
        to_c(Policy.pretrained(name), tmp_path / f"{name}.h", prefix=name.replace("-", "_"))
    headers = ("calm-1.h", "swingup-2.h", "calm-1.h")
    text = "".join(f'#include "{name}"\n' for name in headers) + "int main(void) { return 0; }"
    for compiler, name, flags in (("gcc", "a.c", FLAGS), ("g++", "a.cc", ("-std=c++17", "-Wall"))):
        if not shutil.which(compiler):
            pytest.skip(f"no {compiler} here")
        (tmp_path / name).write_text(text)
        subprocess.run([compiler, *flags, "-Werror", "-c", name], cwd=tmp_path, check=True)


def test_the_header_says_what_it_is_for_and_what_made_it(tmp_path):
    policy = Policy.pretrained("swingup-2")
    hostile = dataclasses.replace(policy, provenance={"note": "*/ #error /* ${numbers} \\"})
    to_c(hostile, tmp_path / "hostile.h")
    subprocess.run(
        ["gcc", *FLAGS, "-c", "-x", "c", "hostile.h", "-o", "a.o"], cwd=tmp_path, check=True
    )
    to_c(policy, tmp_path / "policy.h")
    text = (tmp_path / "policy.h").read_text()
    assert text.startswith(f"/* A policy, written by npend_gym {__version__}\n")
    assert '"trained_by": "shac"' in text
    assert "#define NPEND_DT 0.05 /* [s]" in text
    assert "6 numbers" not in text.partition("#define")[0]
    assert max(map(len, text.splitlines())) <= 110
    numbers = re.search(r"npend_numbers\[\] = \{(.*?)\}", text, re.DOTALL)[1].split(",")
    weights = np.array([float.fromhex(each.strip().removesuffix("f")) for each in numbers])
    np.testing.assert_array_equal(weights[:64], policy.biases[0])
    np.testing.assert_array_equal(weights[64:128], policy.weights[0][:, 0])


def test_what_cannot_be_exported_is_refused(tmp_path):
    policy, path = Policy.pretrained("swingup-2"), tmp_path / "policy.h"
    for prefix in ("", "2", "a-b", "a b", "\u00e4", 3):
        with pytest.raises(ValueError, match="prefix must be a letter, then letters, digits or _"):
            to_c(policy, path, prefix=prefix)
    with pytest.raises(ValueError, match="env of the policy must say"):
        to_c(dataclasses.replace(policy, env={}), path)
    with pytest.raises(ValueError, match="the policy is for 6 and 1"):
        to_c(dataclasses.replace(policy, env=policy.env | {"n": 3}), path)
    context = {"observe_context": True, "randomize": {"gravity": (9.0, 10.0)}}
    with pytest.raises(ValueError, match="observe_context must be False"):
        to_c(network(policy.env | context), path)
    with pytest.raises(TypeError, match="relative must be True or False"):
        to_c(policy, path, relative="joints")
    assert list(tmp_path.iterdir()) == []


def test_the_command_writes_what_the_function_writes(tmp_path):
    expected, written = tmp_path / "expected.h", tmp_path / "new" / "policy.h"
    to_c(Policy.pretrained("calm-1"), expected, prefix="arm", relative=True)
    options = ["--to", "c", "--prefix", "arm", "--relative", "--out", str(written)]
    assert main(["export", "calm-1", *options]) == 0
    assert written.read_bytes() == expected.read_bytes()
