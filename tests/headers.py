"""Policies for exports, the headers compiled, and the exact actions to compare with."""

import ctypes
import importlib.util
import shutil
import subprocess
import sys

import numpy as np
import pytest
from policy_files import random_policy

from npend_gym.envs import EnvConfig
from npend_gym.export import to_c
from npend_gym.physics import Ensemble
from npend_gym.rl import observation_of

# pip install ziglang: clang, where there is none
COMPILERS = {name: [name] for name in ("gcc", "clang", "tcc") if shutil.which(name)}
if importlib.util.find_spec("ziglang"):
    COMPILERS["zig"] = [sys.executable, "-m", "ziglang", "cc"]
FLAGS = ("-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror", "-ffp-contract=off")
# Calls the functions of a header for many states, lane by lane
DRIVER = """
#include "policy.h"
void acts(int lanes, int steps, const double *theta, const double *omega, const double *cart,
    const double *goal, float *observation, float *action, double *torque)
{
    static p_policy policy;
    int lane, step;
    for (lane = 0; lane < lanes; lane++) {
        p_policy_reset(&policy);
        for (step = 0; step < steps; step++) {
            p_policy_observe(theta, omega, cart, goal, observation);
            p_policy_act(&policy, observation, action);
            p_policy_torque(action, torque);
            theta += P_RODS, omega += P_RODS, cart += 2, goal += P_RODS;
            observation += P_OBSERVED, action += P_JOINTS, torque += P_JOINTS;
        }
    }
}
void tanhs(int size, const float *x, float *y)
{
    for (; size--; x++, y++)
        *y = p_tanh(*x);
}
void estimates(int size, const double *shown, const double *dt, double time_constant,
    double period, double *velocity)
{
    p_estimator state;
    p_estimate_reset(&state);
    for (; size--; shown++, dt++)
        *velocity++ = p_estimate(&state, *shown, *dt, time_constant, period);
}
"""

# What a program calls, one function for each
CALLS = """
#include "policy.h"
static p_policy policy;
void begin(void) { p_policy_reset(&policy); }
void observe(const double *angle, const double *speed, float *observation)
{
    p_policy_observe(angle, speed, 0, 0, observation);
}
void act(const float *observation, float *action) { p_policy_act(&policy, observation, action); }
void drive(const float *action, double *torque) { p_policy_torque(action, torque); }
"""

# A control loop, called each time the encoders are read
LOOP = """
#include "policy.h"
void control(int begins, int acts, const double *shown, double dt, double *torque)
{
    static p_%s it;
    static p_estimator encoders[P_RODS];
    double omega[P_RODS];
    int i;
    if (begins)
        p_%s_reset(&it);
    for (i = 0; i < P_RODS; i++) {
        if (begins)
            p_estimate_reset(&encoders[i]);
        omega[i] = p_estimate(&encoders[i], shown[i], dt, %s, 6.28318530717958623);
    }
    if (acts) {
        %s
    }
}
"""
ACTS = """
        float observation[P_OBSERVED], action[P_JOINTS];
        p_policy_observe(shown, omega, 0, 0, observation);
        p_policy_act(&it, observation, action);
        p_policy_torque(action, torque);
"""
LOOP_OF_POLICY = LOOP % ("policy", "policy", 0.005, ACTS)
LOOP_OF_CONTROLLER = LOOP % (
    "controller", "controller", 0.002, "p_controller_act(&it, shown, omega, 0, torque);"
)  # fmt: skip


def compiled(policy, folder, compiler="gcc", driver=DRIVER, **options):
    """Return the functions of a driver for a policy."""
    if compiler not in COMPILERS:
        pytest.skip(f"no {compiler} here")
    to_c(policy, folder / "policy.h", prefix="p", **options)
    (folder / "driver.c").write_text(driver)
    command = [*FLAGS, "-O2", "-shared", "-fPIC", "-o", "driver.so", "driver.c"]
    subprocess.run([*COMPILERS[compiler], *command], cwd=folder, check=True)
    return ctypes.CDLL(str(folder / "driver.so"))


def bytes_of(folder, calls):
    """Return the size of these calls of the header in a folder, which must need no library."""
    tools = ("gcc", "size", "nm")
    if not all(map(shutil.which, tools)):
        pytest.skip(f"one of {', '.join(tools)} is not here")
    (folder / "small.c").write_text(calls)
    size = ["gcc", *FLAGS, "-Os", "-fno-asynchronous-unwind-tables", "-c", "small.c"]
    subprocess.run(size, cwd=folder, check=True)
    shown = subprocess.check_output(["size", "small.o"], cwd=folder, text=True)
    needed = subprocess.check_output(["nm", "--undefined-only", "small.o"], cwd=folder, text=True)
    assert needed == ""
    return sum(map(int, shown.splitlines()[1].split()[:2]))  # text and data


def encoders_shown(theta, relative):
    """Return what encoders of 4096 counts, of one turn, show of the angles of rods [rad]."""
    angles = np.diff(theta, prepend=0.0) if relative else theta
    return np.round(angles * 4096 / (2.0 * np.pi)) % 4096 * (2.0 * np.pi / 4096)


def ticks_standing(library, config, start, ticks, relative):
    """Return for how many ticks of 1 ms a chain stands at the end, moved by the loop in C.

    The loop is `control` of the library. It sees what encoders show, and acts every `config.dt`.
    """
    every, ensemble = round(1000 * config.dt), Ensemble(config.chain, size=1)
    ensemble.set_state([0], [start], 0.0)
    torque, standing = np.zeros(config.joints.size), 0
    for tick in range(ticks):
        shown = encoders_shown(ensemble.theta[0], relative)
        pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in (shown, torque)]
        acts = tick % every == 0
        library.control(tick == 0, acts, pointers[0], ctypes.c_double(0.001), pointers[1])
        ensemble.advance(torque[None], dt=0.001, substeps=1)
        standing = standing + 1 if np.all(np.cos(ensemble.theta[0]) < -0.95) else 0
    return standing


def draw(config, lanes, steps):
    """Return states: theta, omega, cart and goal, each (lanes, steps, ...)."""
    rng = np.random.default_rng(0)
    shape = (lanes, steps, config.n)
    return (
        rng.uniform(-20.0, 20.0, shape), rng.normal(size=shape) * 6.0,
        rng.normal(size=(lanes, steps, 2)), rng.uniform(-np.pi, np.pi, shape),
    )  # fmt: skip


def in_c(library, policy, states):
    """Return what C observes and how it acts: observations, actions and torques."""
    lead, joints = states[0].shape[:2], policy.config.joints.size
    found = (
        np.empty((*lead, policy.observed), np.float32), np.empty((*lead, joints), np.float32),
        np.empty((*lead, joints)),
    )  # fmt: skip
    library.acts(*lead, *(array.ctypes.data_as(ctypes.c_void_p) for array in (*states, *found)))
    return found


def observed(config, states, **options):
    """Return what Python observes in those states."""
    theta, omega, cart, goal = (array.reshape(-1, array.shape[-1]) for array in states)
    if config.has_cart:
        options |= {"cart_position": cart[:, 0], "cart_velocity": cart[:, 1]}
    if config.observes_goals:
        options["goal"] = goal
    return observation_of(config, theta, omega, **options).reshape(*states[0].shape[:2], -1)


def in_python(policy, observations):
    """Return the actions of the policy in NumPy, lanes side by side."""
    policy.reset(len(observations))
    return np.stack([policy(each) for each in observations.swapaxes(0, 1)], axis=1)


def in_float64(policy, observations, actions):
    """Return the exact actions of the float32 network, and how far rounding may lead away.

    `actions` are those that a policy with memory remembers. The bound is that of float32 sums in
    any order (N. Higham, Accuracy and Stability of Numerical Algorithms, section 3.1), carried
    through the layers, with 2 ulp of tanh.
    """
    signal, unit = observations.astype(np.float64), 2.0**-24
    if policy.has_memory:
        length, before = len(policy.scale), np.zeros_like(actions)
        before[:, 1:] = actions[:, :-1]
        pairs = np.concatenate([observations, before], axis=-1).astype(np.float64)
        start = np.concatenate([pairs[:, :1]] * (length - 1), axis=1)
        whole = np.concatenate([start, pairs], axis=1)
        steps = observations.shape[1]
        frames = [whole[:, length - 1 - j : length - 1 - j + steps] for j in range(length)]
        signal = np.concatenate(frames, axis=-1)
    shift = 0.0 if policy.offset is None else policy.offset.ravel().astype(np.float64)
    signal = (signal - shift) / policy.scale.ravel().astype(np.float64)
    error = 3.0 * unit * (abs(signal) + abs(shift) / policy.scale.ravel())
    signal = np.clip(signal, -policy.limit, policy.limit)
    for k, (weight, bias) in enumerate(zip(policy.weights, policy.biases, strict=True)):
        w, b = weight.astype(np.float64), bias.astype(np.float64)
        size = abs(signal) @ abs(w).T + abs(b)
        signal, error = signal @ w.T + b, error @ abs(w).T + (w.shape[1] + 1) * unit * size
        last = k == len(policy.weights) - 1
        function = policy.output if last else policy.activation
        if function == "tanh":
            signal = np.tanh(signal)
            error += 4.0 * unit * abs(signal)
        else:
            signal = np.clip(signal, -1.0, 1.0) if last else np.maximum(signal, 0.0)
    return signal, error


def network(env, seed=0, **functions):
    """Return a policy of random numbers for an environment."""
    rng, config = np.random.default_rng(seed), EnvConfig(**env)
    k, sizes = config.observed, [(8, config.observed), (5, 8), (config.joints.size, 5)]
    scale, offset = rng.uniform(0.5, 2.0, k), rng.normal(size=k)
    return random_policy(sizes, env, rng, 0.5, scale=scale, offset=offset, **functions)


CART = {"n": 2, "base": "cart", "mode": "balance"}
