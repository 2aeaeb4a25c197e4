"""Chains on a GPU: in Numba's simulator, as assembly text, and on a GPU where there is one.

Each script is a process of its own, because Numba reads once whether it simulates.
"""

import json
import os
import re
from collections import Counter
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from scripts import run_python
from suites import gpu
from suites.timing import Peers

from npend_gym import Cart, Chain, simulate
from npend_gym.compiled.sincos import FLOAT32_CONSTANTS, sincos
from npend_gym.physics import simulate_on_device
from npend_gym.physics.gpu_simulation import _launches

HAS_NUMBA_CUDA = find_spec("numba_cuda") is not None
needs_numba_cuda = pytest.mark.skipif(
    not HAS_NUMBA_CUDA, reason='no numba-cuda: pip install "npend-gym[cuda]"'
)


# What all scripts begin with
BEGIN = """
import json
import numpy as np
from npend_gym import Chain

def report(cases):
    print(json.dumps({name: differences(*case) for name, case in cases.items()}))
"""


def lines_of(code, cwd=None):
    """Run a script in Numba's simulator of a GPU; return the lines that it prints."""
    environment = os.environ | {"NUMBA_ENABLE_CUDASIM": "1"}
    return run_python("-W", "error", "-c", BEGIN + code, cwd=cwd, env=environment).splitlines()


def simulated(code):
    """Run a script in Numba's simulator of a GPU; return what its last line has, as JSON."""
    return json.loads(lines_of(code)[-1])


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """What the scripts find that take little time, in one process for all of them."""
    scripts = {
        "given": GIVEN, "point masses": COMPARE + POINT_MASSES, "float32": SINGLE,
        "simulate": SIMULATE, "errors": ERRORS,
    }  # fmt: skip
    lines = lines_of("".join(scripts.values()), cwd=tmp_path_factory.mktemp("simulated"))
    return dict(zip(scripts, map(json.loads, lines), strict=True))


def on_gpu(code):
    """Run a script with Numba as it is."""
    return json.loads(run_python("-c", BEGIN + code).splitlines()[-1])


# Random chains, one a lane, advanced twice: which numbers differ from those of the processor
COMPARE = """
from npend_gym.physics import DeviceChains, Ensemble

RNG = np.random.default_rng(8)

def differences(chains, size, substeps, steps=2):
    many = Ensemble(chains, size, joints=range(many_rods(chains)))
    on_gpu, n = DeviceChains(chains, size), many.n
    theta, omega = RNG.uniform(-3.0, 3.0, (size, n)), RNG.normal(size=(size, n)) * 4.0
    torque = RNG.normal(size=(size, n))
    many.set_state(slice(None), theta, omega)
    put = on_gpu.cuda.to_device
    state = [put(values) for values in (theta, omega, torque, np.zeros(size))]
    for _ in range(steps):
        many.advance(torque, 0.07, substeps)
        on_gpu.advance(*state, 0.07, substeps)
    theta, omega, _, diverged = (values.copy_to_host() for values in state)
    assert not diverged.any() and not np.array_equal(theta, many.theta + 1e-12)
    return int(np.sum(theta != many.theta) + np.sum(omega != many.omega))

def many_rods(chains):
    return chains.n if isinstance(chains, Chain) else chains[0].n

def uneven(n, **more):
    values = RNG.uniform(0.5, 2.0, (2, n))
    return Chain(*values, damping=0.1, **more)
"""
POINT_MASSES = """
report({
    "n = 1": (uneven(1), 3, 4), "n = 2": (uneven(2), 3, 4), "n = 5": (uneven(5), 3, 4),
    "in a thread's storage": (uneven(12), 2, 1),
    "substeps that fast rods cut": (uneven(2), 3, None),
    "some with drag": ([uneven(2), uneven(2, drag=0.2, quadratic_drag=0.1)], 2, 3),
})
"""
BODIES = """
links = Chain.rods([1.0, 0.5], [1.0, 0.7])
report({
    "links": (links, 3, 4),
    "long links": (Chain.rods(np.ones(10), np.ones(10)), 2, 1),
    "machine": (Chain.realaigym("C.1"), 3, 4),
    "machine with drag": (Chain.rods([1.0, 0.5], [1.0, 0.7], friction=0.1, drag=0.1), 2, 2),
})
"""


# Chains made with long rods and advanced with parameters of short ones, which need more substeps;
# and links that get drag
GIVEN = """
from npend_gym.physics import DeviceChains, Ensemble

differences = []

def compare(chain, made_of, count):
    n = chain.n
    drag = not np.array_equal(chain.drag, made_of.drag)
    many, on_gpu = Ensemble(chain, 2), DeviceChains(made_of, 2, drag=drag)
    many.set_state(slice(None), 0.7)
    many.advance(0.0, 0.05)
    put = on_gpu.cuda.to_device
    torque, lost = put(np.zeros((2, n))), put(np.zeros(2))
    theta, omega = put(np.full((2, n), 0.7)), put(np.zeros((2, n)))
    rows = put(chain.repeated(count).stacked())
    on_gpu.advance(theta, omega, torque, lost, 0.05, parameters=rows)
    pairs = (theta, many.theta), (omega, many.omega)
    differences.extend(int(np.sum(ours.copy_to_host() != theirs)) for ours, theirs in pairs)

short = Chain([1.0, 0.5], [0.02, 0.03], damping=1e-4)
for count in (1, 2):
    compare(short, Chain.uniform(2), count)
for n in (2, 9):
    compare(*(Chain.rods(np.ones(n), np.ones(n), drag=drag) for drag in (0.5, 0.0)), 1)
print(json.dumps(differences))
"""


@pytest.mark.long
def test_substeps_and_drag_are_those_of_the_parameters_that_a_step_is_given(found):
    assert found["given"] == [0] * 8


@pytest.mark.long
def test_point_masses_in_the_simulator_have_the_bits_of_the_processor(found):
    assert set(found["point masses"].values()) == {0}


@pytest.mark.long
def test_links_and_machines_in_the_simulator_have_the_bits_of_the_processor():
    assert set(simulated(COMPARE + BODIES).values()) == {0}


@needs_numba_cuda
def test_chains_on_a_gpu_have_the_bits_of_the_processor():
    found = "from numba import cuda; print('true' if cuda.is_available() else 'false')"
    if not on_gpu(found):
        pytest.skip("no GPU")
    assert on_gpu(GIVEN) == [0] * 8
    assert set(on_gpu(COMPARE + POINT_MASSES).values()) == {0}
    assert set(on_gpu(COMPARE + BODIES).values()) == {0}
    assert set(on_gpu(GRADIENTS + OF_POINT_MASSES).values()) == {0}
    assert set(on_gpu(GRADIENTS + OF_BODIES).values()) == {0}


# Random derivatives by the states after a step, taken back: which differ from the processor's
GRADIENTS = """
from npend_gym.physics import DifferentiableDeviceChains, DifferentiableEnsemble

RNG = np.random.default_rng(9)

def differences(chain, size, substeps, names=(), made_of=None):
    n, spin = chain.n, 1.0 if substeps else 12.0
    ours = DifferentiableEnsemble(chain, size, joints=range(n))
    theirs = DifferentiableDeviceChains(made_of or chain, size, drag=made_of is not None)
    theta, omega, torque, theta_bar, omega_bar = RNG.normal(size=(5, size, n))
    ours.set_state(slice(None), theta, spin * omega)
    found = ours.step_vjp(
        torque, 0.07, substeps, theta_bar=theta_bar, omega_bar=omega_bar, parameters=names
    )
    put = theirs.cuda.to_device
    state = [put(array) for array in (theta, spin * omega, torque)]
    bars = [put(array) for array in (theta_bar, omega_bar, np.zeros((size, n)))]
    by_parameters = put(np.zeros((size, 12, n)))
    flags, more = put(np.zeros(size)), [by_parameters] if names else []
    given = None if made_of is None else put(chain.repeated(1).stacked())
    theirs.step_vjp(*state, [*bars, *more], flags, 0.07, substeps, parameters=given)
    assert not np.any(flags.copy_to_host()) and np.all(found.by_torque)
    pairs = list(zip(found[2:5], (bar.copy_to_host() for bar in bars)))
    if names:
        fields, rows = chain.repeated(1)._fields, by_parameters.copy_to_host()
        for name in names:
            row = rows[:, fields.index(name)]
            pairs.append((found.by_parameters[name], row[:, 0] if name == "gravity" else row))
    # the processor gives what a chain lacks the value 1e-30 where it differentiates by it
    return int(sum(np.sum(np.abs(a - b) > (1e-29 if names else 0.0)) for a, b in pairs))
"""
OF_POINT_MASSES = """
names = "masses", "lengths", "gravity", "damping", "drag", "quadratic_drag"
report({
    "n = 1": (Chain.uniform(1), 2, 2), "n = 2": (Chain.uniform(2, damping=0.1), 2, 3, names),
    "substeps that fast rods cut": (Chain.uniform(2), 2, None),
    "n = 10": (Chain.uniform(10), 2, 1),
    "drag": (Chain([1.0, 2.0], [1.0, 0.7], drag=0.1, quadratic_drag=0.2), 2, 2, names),
})
"""
OF_BODIES = """
simple = "masses", "lengths", "gravity", "damping", "centres", "inertias"
everything = *simple, "drag", "quadratic_drag", "friction", "friction_speed", "armature", "gear"
links = [Chain.rods([1.0, 0.5], [1.0, 0.7], drag=drag) for drag in (0.0, 0.1)]
report({
    "links": (links[0], 2, 2, simple),
    "links that get drag": (links[1], 2, 2, everything, links[0]),
    "machine": (Chain.realaigym("C.1"), 2, 2, everything),
})
"""


@pytest.mark.long
@pytest.mark.parametrize("cases", [OF_POINT_MASSES, OF_BODIES], ids=["point masses", "bodies"])
def test_gradients_in_the_simulator_have_the_bits_of_the_processor(cases):
    assert set(simulated(GRADIENTS + cases).values()) == {0}


SINGLE = """
from npend_gym.physics import DeviceChains

chains = DeviceChains(Chain.uniform(2), 3, dtype="float32")
theta = np.linspace(-3.0, 3.0, 6, dtype=np.float32).reshape(3, 2)
omega, torque = np.zeros((2, 3, 2), np.float32)
diverged = np.zeros(3, np.float32)
diverged[2] = 1.0
for _ in range(10):
    chains.advance(theta, omega, torque, diverged, 0.02, 2)
print(json.dumps(theta.tolist()))
"""


@pytest.mark.long
def test_float32_is_near_float64_and_chains_that_have_diverged_stay(found):
    theta = found["float32"]
    begin = np.linspace(-3.0, 3.0, 6).reshape(3, 2)
    for k in range(2):
        path = simulate(Chain.uniform(2), begin[k], 0.0, [0.0, 0.2], method="rk4", dt=0.01)
        np.testing.assert_allclose(theta[k], path.theta[-1], rtol=0.0, atol=3e-6)
        assert np.all(theta[k] != path.theta[-1])  # it was not computed in float64
    np.testing.assert_array_equal(theta[2], begin[2].astype(np.float32))


def test_sines_of_float32_have_the_precision_of_float32():
    # the text of sincos with the constants that the translation puts in place of its own
    text = sincos.py_func
    names = {
        name: np.float32(FLOAT32_CONSTANTS.get(value, value)) if isinstance(value, float) else value
        for name, value in text.__globals__.items()
        if not name.startswith("__")
    }
    code = text.__code__.replace(
        co_consts=tuple(
            np.float32(c) if isinstance(c, float) else c for c in text.__code__.co_consts
        )
    )
    single = type(text)(code, names)
    x = np.random.default_rng(0).uniform(-1e3, 1e3, 100_000).astype(np.float32)
    s, c = single(x)
    assert s.dtype == np.float32
    np.testing.assert_allclose(s, np.sin(x.astype(float)), rtol=0.0, atol=1e-7)
    np.testing.assert_allclose(c, np.cos(x.astype(float)), rtol=0.0, atol=1e-7)


SIMULATE = """
from npend_gym import IntegrationError
from npend_gym.physics import simulate_on_device

chain, theta, times = Chain.uniform(2, damping=0.1), [[0.5, 1.0], [-2.0, 0.1]], [0.0, 0.1, 0.35]
path = simulate_on_device(chain, theta, 0.3, times, torque=0.5, dt=0.03)
path.save("motions.npz")
again = type(path).load("motions.npz")
assert np.array_equal(again.theta, path.theta) and again.energy().shape == (2, 3)
try:
    simulate_on_device(Chain.uniform(2, length=1e-3), theta, 0.0, times, dt=0.2)
except IntegrationError as error:
    message = str(error)
print(json.dumps([path.theta.tolist(), path.omega.tolist(), message]))
"""


@pytest.mark.long
def test_simulate_on_a_gpu_has_the_motions_that_the_processor_computes_one_by_one(found):
    theta, omega, message = found["simulate"]
    for k, start in enumerate([[0.5, 1.0], [-2.0, 0.1]]):
        path = simulate(
            Chain.uniform(2, damping=0.1), start, 0.3, [0.0, 0.1, 0.35], torque=0.5,
            method="rk4", dt=0.03,
        )  # fmt: skip
        np.testing.assert_array_equal(theta[k], path.theta)
        np.testing.assert_array_equal(omega[k], path.omega)
    assert message.startswith("the state diverged between t = 0 s and 0.1 s")


@pytest.mark.parametrize("steps", [1, 65_536, 65_537, 1_000_003])
def test_launches_of_an_interval_take_its_steps_with_the_same_bits(steps):
    interval = 0.1234567
    parts = list(_launches(interval, steps))
    assert sum(count for _, count in parts) == steps
    assert all(count <= 65_536 for _, count in parts)
    assert {span / count for span, count in parts} == {interval / steps}


PTX = """
from npend_gym.physics.gpu import SHORT, adjoint_kernel, kernel_for
from npend_gym.physics.kernels import threads
from npend_gym.physics.kernels.link_terms import count_terms

def arguments(chains, dtype):
    n = chains.masses.shape[1]
    shapes = threads.storage_shapes(n, count_terms(chains), 1) if n > SHORT else []
    return [
        *np.zeros((3, 1, n), dtype), np.zeros(1, dtype), chains.stacked().astype(dtype),
        *np.array([0.01, 1.0, 0.0], dtype), *(np.zeros(shape, dtype) for shape in shapes),
    ]

chains = {
    "bobs 2": Chain.uniform(2), "bobs 30": Chain.uniform(30),
    "links 2": Chain.rods([1.0, 1.0], [1.0, 1.0]),
    "machine 2": Chain.rods([1.0, 1.0], [1.0, 1.0], friction=0.1, drag=0.1),
}
wanted = [(name, "float64") for name in chains] + [("bobs 2", "float32")]
texts = {}
for name, dtype in wanted:
    rows = chains[name].repeated(1)
    texts[f"{name} {dtype}"] = kernel_for(rows, dtype).ptx(*arguments(rows, dtype))
numbers = [np.zeros((2, 3)) for _ in range(6)]
numbers += [np.zeros((2, 12, 3)), np.zeros(2), np.zeros((1, 12, 3)), *np.ones(3)]
numbers += [np.zeros(shape) for shape in threads.adjoint_shapes(3, 3, 2, 1)]
texts["adjoint float64"] = adjoint_kernel(3, True, "float64").ptx(*numbers)
print(json.dumps(texts))
"""


@needs_numba_cuda
@pytest.mark.long
def test_kernels_compile_for_a_gpu_without_one_and_fuse_no_product_with_a_sum():
    texts = on_gpu(PTX)
    assert len(texts) == 6
    for name, text in texts.items():
        found = Counter(re.findall(r"^\s+(?:@!?%p\d+ )?([a-z][\w.]+)\s", text, re.MULTILINE))
        bits = name[-2:]
        rounded = found[f"mul.rn.f{bits}"] + found[f"add.rn.f{bits}"] + found[f"sub.rn.f{bits}"]
        assert rounded > 500, name
        # without .rn the driver would fuse
        assert not [op for op in found if re.match(r"(mul|add|sub)\.f|fma|mad\..*f(32|64)", op)]
        assert not [op for op in found if "approx" in op], name
        if bits == "32":
            assert found["mul.f64"] + found["mul.rn.f64"] == 0
        if " 2 " in name:
            assert ".local" not in text, f"{name} has arrays out of the registers"


ERRORS = """
from npend_gym.physics import DeviceChains, simulate_on_device

chains, state = DeviceChains(Chain.uniform(2), 3), [np.zeros((3, 2)) for _ in range(3)]
flags, messages = np.zeros(3), []
for call in (
    lambda: chains.advance(*state[:2], np.zeros((3, 1)), flags, 0.1),
    lambda: chains.advance(*state, np.zeros(3, int), 0.1),
    lambda: chains.advance(*state, flags, -0.1), lambda: chains.advance(*state, flags, 0.1, 0),
    lambda: chains.advance(*state, flags, 0.1, parameters=[1]),
    lambda: DeviceChains(Chain.uniform(2), 3, dtype="float16"),
    lambda: simulate_on_device(Chain.uniform(2), np.zeros((0, 2)), 0.0, [0.0, 1.0], dt=0.1),
):
    try:
        call()
    except (TypeError, ValueError) as error:
        messages.append(str(error))
print(json.dumps(messages))
"""


@pytest.mark.long
def test_arrays_that_do_not_fit_are_refused_by_name(found):
    torque, diverged, dt, substeps, parameters, dtype, starts = found["errors"]
    assert torque == "torque must have the shape (3, 2), got (3, 1)"
    assert diverged == "diverged must be of dtype float64, got int64"
    assert dt.startswith("dt must be")
    assert substeps.startswith("substeps must be")
    assert parameters.startswith("parameters must be an array on the GPU")
    assert dtype.startswith("dtype must be")
    assert starts.startswith("theta, omega and torque must hold one state or more")


@pytest.mark.skipif(HAS_NUMBA_CUDA, reason="numba-cuda is installed")
def test_without_the_extra_the_error_says_what_to_install():
    with pytest.raises(ImportError, match=r'pip install "npend-gym\[cuda\]"'):
        simulate_on_device(Chain.uniform(2), 0.1, 0.0, [0.0, 1.0], dt=0.1)


@needs_numba_cuda
def test_without_a_gpu_the_error_says_so_and_what_to_do():
    code = (
        "from numba import cuda\nfrom npend_gym.physics import DeviceChains\nmessage = None\n"
        "try:\n    DeviceChains(Chain.uniform(2), 2)\n"
        "except RuntimeError as error:\n    message = str(error)\n"
        "print(json.dumps([cuda.is_available(), message]))"
    )
    available, message = on_gpu(code)
    if available:
        pytest.skip("there is a GPU")
    assert "need an NVIDIA GPU with its driver" in message
    assert 'device="cpu"' in message


@pytest.mark.parametrize("parts", [{"base": Cart(1.0)}, {"stiffness": 1e3}])
def test_what_a_gpu_cannot_simulate_is_refused(parts):
    chain = Chain.uniform(2, **parts)
    with pytest.raises(ValueError, match="is defined for rigid rods on a pivot at rest"):
        simulate_on_device(chain, 0.1, 0.0, [0.0, 1.0], dt=0.1)
    with pytest.raises(TypeError, match=r"chain must be an npend_gym\.Chain, got \["):
        simulate_on_device([chain, chain], 0.1, 0.0, [0.0, 1.0], dt=0.1)


BENCH = """
import sys
sys.path.insert(0, BENCHMARKS)
from suites import gpu, timing

timing.SECONDS, gpu.LANES, gpu.COUNTS, gpu.MANY, gpu.COPIED = 1e-4, (2,), (2,), 2, 16
same_bits, gpu.same_bits = gpu.same_bits, lambda: same_bits(lanes=2, steps=2)
print(json.dumps([row._asdict() for row in gpu.rows(timing.Peers(print))]))
"""


@pytest.mark.long
def test_the_benchmark_compares_bits_and_measures_steps_and_bandwidth():
    folder = str(Path(__file__).parents[1] / "benchmarks")
    rows = simulated(BENCH.replace("BENCHMARKS", repr(folder)))
    assert "differ in 0 of 10, by 0 ulps at most" in rows[0]["note"]
    assert rows[1]["job"] == "bytes copied in its memory"
    assert len(rows) == 2 + 2 * 2
    for row in rows:
        assert row["ours_per_s"] > 0.0
    # a step of two rods in one launch: 12 numbers of 8 bytes
    single = next(row for row in rows[2:] if "float64" in row["job"] and ", 1 a" in row["job"])
    share = 100.0 * single["ours_per_s"] * 96 / rows[1]["ours_per_s"]
    assert single["note"] == f"{share:.3g} % of the bandwidth"


def test_without_a_gpu_the_benchmark_measures_nothing_and_says_why():
    if HAS_NUMBA_CUDA and on_gpu("from numba import cuda; print(int(cuda.is_available()))"):
        pytest.skip("there is a GPU")
    messages = []
    assert not list(gpu.rows(Peers(messages.append)))
    assert messages[0].startswith("the GPU is left out")


# Steps and environments of tensors, on the processor and as on a GPU: which numbers differ
OF_TENSORS = """
import torch
from npend_gym.torch import DifferentiableVectorEnv, DivergedError, device_steps, step

def steps():
    random = torch.Generator().manual_seed(0)
    theta, omega = torch.randn(2, 3, 2, generator=random, dtype=torch.float64)
    torque = torch.randn(3, 1, generator=random, dtype=torch.float64)
    # rods that need more substeps than those of the chain itself
    values = {"masses": [1.0, 0.7], "lengths": [0.1, 0.07], "gravity": 9.0, "drag": [0.1, 0.0]}
    values = {name: torch.tensor(value, dtype=torch.float64) for name, value in values.items()}
    leaves = [x.requires_grad_() for x in (theta, omega, torque, *values.values())]
    a, b = step(Chain.uniform(2, damping=0.1), *leaves[:3], values, dt=0.05)
    a, b = step(Chain.uniform(2), a, b, torque, dt=0.05, substeps=2)
    (a.sum() + b.square().sum()).backward()
    return [a, b, *(leaf.grad for leaf in leaves)]

def environments():
    env = DifferentiableVectorEnv(3, n=2, mode="swingup")
    observation, _ = env.reset(seed=1)
    actions = torch.full((3, 1), 0.3, dtype=torch.float64, requires_grad=True)
    total = 0.0
    for _ in range(3):
        observation, reward, *_ = env.step(actions)
        total = total + reward.sum() + observation.square().sum()
    total.backward()
    return [observation, total, actions.grad]

def both():
    return [x.detach() for x in steps() + environments()]

processor = both()
device_steps.on_gpu = lambda tensor: True
pairs = list(zip(processor, both()))
fast = torch.full((2, 2), 1e6, dtype=torch.float64)
try:
    step(Chain.uniform(2), fast * 0.0, fast, dt=1.0, substeps=1)
except DivergedError as error:
    lanes = error.chains
try:
    step(Chain.acrobot(), fast * 0.0, parameters={"drag": fast / 1e7}, dt=0.1)
except ValueError as error:
    refused = "nor links get rotors or drag" in str(error)
print(json.dumps([sum(int((a != b).sum()) for a, b in pairs), len(pairs), lanes, refused]))
"""


@pytest.mark.long
def test_tensors_on_a_gpu_have_values_and_gradients_with_the_bits_of_the_processor():
    pytest.importorskip("torch")
    assert simulated(OF_TENSORS) == [0, 2 + 7 + 3, [0, 1], True]


@pytest.mark.skipif(HAS_NUMBA_CUDA, reason="numba-cuda is installed")
def test_an_environment_of_tensors_says_what_a_gpu_needs():
    pytest.importorskip("torch")
    from npend_gym.torch import DifferentiableVectorEnv

    with pytest.raises(ImportError, match=r'pip install "npend-gym\[cuda\]"'):
        DifferentiableVectorEnv(2, n=2, device="cuda")
    with pytest.raises(ValueError, match="device must be"):
        DifferentiableVectorEnv(2, n=2, device="meta")
