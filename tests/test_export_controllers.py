"""Controllers as C: their torques, their plans in a loop, and what the header holds."""

import ctypes
import os
import shutil
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from headers import CART, FLAGS, LOOP_OF_CONTROLLER, bytes_of, compiled, ticks_standing

from npend_gym import Chain, __version__
from npend_gym.cli import main
from npend_gym.envs import EnvConfig
from npend_gym.envs.modes import Balance
from npend_gym.export import to_c
from npend_gym.rl import MPC, lqr, modal_damping, planned_swing_up, state_feedback
from npend_gym.rl.angles import wrap
from npend_gym.rl.controllers.feedback import StateFeedback
from npend_gym.rl.controllers.step_model import joined

pytestmark = [
    pytest.mark.skipif(os.name != "posix", reason="the options of compilers elsewhere"),
    pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc here"),
]

OWN = [6.0, -3.0, 2.0, 1.0, 4.0, -5.0]  # N, of a cart with two rods
# Acts in many states, lane by lane
DRIVER = """
#include "policy.h"
void acts(int lanes, int steps, const double *theta, const double *omega, const double *cart,
    double *torque)
{
    static p_controller controller;
    int lane, step;
    for (lane = 0; lane < lanes; lane++) {
        p_controller_reset(&controller);
        for (step = 0; step < steps; step++) {
            p_controller_act(&controller, theta, omega, cart, torque);
            theta += P_RODS, omega += P_RODS, cart += 2, torque += P_JOINTS;
        }
    }
}
void shorts(int size, const double *x, double *y)
{
    for (; size--; x++, y++)
        *y = p_short(*x);
}
"""
# What a program calls
CALLS = """
#include "policy.h"
static p_controller controller;
void begin(void) { p_controller_reset(&controller); }
void act(const double *angle, const double *speed, double *torque)
{
    p_controller_act(&controller, angle, speed, 0, torque);
}
"""


def two_motors():
    return EnvConfig(n=2, mode="balance", actuated=(0, 1), chain=Chain.multiarm(2), max_torque=0.2)


@pytest.fixture(scope="module")
def plan():
    return planned_swing_up(EnvConfig(n=2, mode="swingup", dt=0.025), 3.0, settle=0.1, tries=4)


def draw(config, near, spread):
    """Return angles, velocities and carts around states, (lanes, steps, ...)."""
    rng = np.random.default_rng(0)
    states = near + rng.normal(size=near.shape) * spread
    (q, u), n = np.split(states, 2, axis=-1), config.n
    cart = np.stack([q[..., n], u[..., n]], -1) if config.has_cart else np.zeros((*q.shape[:2], 2))
    return np.ascontiguousarray(q[..., :n]), np.ascontiguousarray(u[..., :n]), cart


def in_c(controller, folder, states, **options):
    """Return the torques in C, (lanes, steps, joints)."""
    library = compiled(controller, folder, driver=DRIVER, **options)
    lead, config = states[0].shape[:2], getattr(controller, "hold_goal", controller).config
    torque = np.empty((*lead, config.joints.size))
    library.acts(*lead, *(array.ctypes.data_as(ctypes.c_void_p) for array in (*states, torque)))
    return torque


def in_order(action, gain, away):
    """Return actions, summed in the order of the header, and the sizes of what was rounded.

    Angles are rounded where whole turns are taken from them, as numbers of the size pi.
    """
    total, size = np.zeros_like(action), abs(action)
    for k in range(away.shape[-1]):
        term = gain[..., k] * away[..., k, None]
        total, size = total + term, size + abs(gain[..., k]) * (abs(away[..., k, None]) + np.pi)
    return action - total, size


def check(torque, action, size, python, config):
    """Compare torques with the bits of `action`, and with what Python's controller computes."""
    np.testing.assert_array_equal(torque, config.action_limits * np.clip(action, -1.0, 1.0))
    found = torque / config.action_limits
    bound = config.state_size * np.finfo(float).eps * size
    assert (abs(found - np.clip(python, -1.0, 1.0)) <= bound).all()
    free = abs(found) < 1.0
    ulp = np.spacing(abs(np.float32(python[free]))).astype(np.float64)
    print(f"largest difference {np.max(abs(found - python)[free] / ulp):.1e} ulp of float32")
    assert 0.02 < free.mean() < 0.98


def info_of(states, relative):
    theta, omega, cart = states
    return (np.cumsum(theta, -1), np.cumsum(omega, -1), cart) if relative else (theta, omega, cart)


@pytest.mark.parametrize("relative", [False, True])
@pytest.mark.parametrize("name", ["balance", "cart", "two motors", "damping", "own gain"])
def test_feedback_in_c_has_the_torques_of_python_in_100_000_states(name, relative, tmp_path):
    controller = {
        "balance": lambda: lqr(EnvConfig(n=3, mode="balance"), action_weight=100.0),
        "cart": lambda: lqr(EnvConfig(**CART)),
        "two motors": lambda: lqr(two_motors(), np.array([0.0, np.pi])),
        "damping": lambda: modal_damping(EnvConfig(n=4, mode="calm")),
        "own gain": lambda: state_feedback(EnvConfig(**CART), OWN, 0.4, cart_position=0.3),
    }[name]()
    config, n = controller.config, controller.config.n
    near = np.zeros((100, 1000, config.state_size))
    near[:] = controller.rest
    if relative:
        near[..., :n] = np.diff(near[..., :n], axis=-1, prepend=0.0)
    near[..., 0] += 2.0 * np.pi * np.random.default_rng(1).integers(-3, 4, (100, 1000))
    states = draw(config, near, 0.1 if name in ("balance", "cart") else 1.5)
    theta, omega, cart = info_of(states, relative)
    of_cart = np.moveaxis(cart, -1, 0) if config.has_cart else ()
    away = controller.deviation(joined(theta, omega, of_cart))
    gain = np.broadcast_to(controller.gain, (*near.shape[:2], *controller.gain.shape))
    action, size = in_order(np.zeros((*near.shape[:2], config.joints.size)), gain, away)
    python = controller.actions(joined(theta, omega, of_cart))
    check(in_c(controller, tmp_path, states, relative=relative), action, size, python, config)


@pytest.mark.long
def test_a_plan_in_c_holds_tracks_and_holds_as_it_does_in_python(plan, tmp_path):
    config, steps = plan.hold_goal.config, len(plan.gains)
    wait, lanes = round(plan.settle / config.dt), 1000
    around = [plan.nominal.states[:1]] * wait + [plan.nominal.states[:-1]]
    near = np.concatenate([*around, np.repeat(plan.nominal.states[-1:], 40, axis=0)])
    states = draw(config, np.broadcast_to(near, (lanes, *near.shape)), 0.03)
    whole = joined(*states[:2], ())
    time = np.broadcast_to(np.arange(len(near)) * config.dt, whole.shape[:2])
    python = plan.at(whole.reshape(-1, 4), time.ravel()).actions.reshape(*whole.shape[:2], -1)
    action, size = np.empty_like(python), np.empty_like(python)
    goal = StateFeedback(config, plan.hold_goal.angle, plan.hold_goal.gain)
    for k in range(len(near)):
        held = plan.hold_start if k < wait else goal
        gain, away, feed = held.gain, held.deviation(whole[:, k]), np.zeros(1)
        if wait <= k < wait + steps:
            gain, feed = plan.gains[k - wait], plan.nominal.actions[k - wait]
            away = whole[:, k] - plan.nominal.states[k - wait]
            away[:, :2] = wrap(away[:, :2])
        action[:, k], size[:, k] = in_order(np.tile(feed, (lanes, 1)), gain, away)
    check(in_c(plan, tmp_path, states), action, size, python, config)


def test_angles_without_whole_turns_have_numpys_bits(tmp_path):
    library, rng = compiled(lqr(two_motors()), tmp_path, driver=DRIVER), np.random.default_rng(0)
    turns = 2.0 * np.pi * np.arange(-2000.0, 2000.0)
    x = np.concatenate([
        rng.uniform(-9.0, 9.0, 10**5), rng.uniform(-9e5, 9e5, 10**5), turns, turns - np.pi,
        np.nextafter(turns - np.pi, 0.0), np.nextafter(turns + np.pi, 1e9), 10.0**-turns[-300:],
    ])  # fmt: skip
    y = np.empty_like(x)
    library.shorts(x.size, *(array.ctypes.data_as(ctypes.c_void_p) for array in (x, y)))
    np.testing.assert_array_equal(y, wrap(x))


@pytest.mark.long
@pytest.mark.parametrize("relative", [False, True])
def test_a_plan_in_c_swings_up_what_encoders_of_4096_counts_show(plan, relative, tmp_path):
    library = compiled(plan, tmp_path, driver=LOOP_OF_CONTROLLER, relative=relative)
    config, start = plan.hold_goal.config, [0.03, -0.02]
    assert ticks_standing(library, config, start, 8000, relative) > 3000


def test_what_is_no_number_stays_none(tmp_path):
    states = [np.full((2, 1, 2), np.nan), np.zeros((2, 1, 2)), np.zeros((2, 1, 2))]
    states[0][1], states[1][1] = np.pi, [[np.nan, 0.0]]
    assert np.isnan(in_c(lqr(two_motors()), tmp_path, states)).all()


@pytest.mark.long
def test_sizes_and_the_time_of_a_call_are_measured(plan, tmp_path):
    for name, controller in {"lqr": lqr(plan.hold_goal.config), "plan": plan}.items():
        to_c(controller, tmp_path / "policy.h", prefix="p")
        size = bytes_of(tmp_path, CALLS)
        print(f"{name}: {size} bytes")
        assert size < (2048 if name == "lqr" else 20 * 1024)
        states = [np.zeros((1000, 100, 2)) for _ in range(3)]
        library = compiled(controller, tmp_path, driver=DRIVER)
        pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in (*states, states[0].copy())]
        begin = time.process_time()
        library.acts(1000, 100, *pointers)
        seconds = (time.process_time() - begin) / 1e5
        print(f"{name}: {1e9 * seconds:.0f} ns a call with gcc -O2")
        assert seconds < 1e-5


@pytest.mark.long
def test_the_control_loop_of_the_examples_is_compiled_without_a_warning(plan, tmp_path):
    to_c(plan, tmp_path / "arm.h", prefix="arm", relative=True)
    loop = Path(__file__).parent.parent / "examples" / "control_loop.c"
    subprocess.run(["gcc", *FLAGS, "-O2", "-I.", "-c", str(loop)], cwd=tmp_path, check=True)


@pytest.mark.parametrize(
    ("keywords", "relative"),
    [({"n": 1}, True), ({"n": 3}, True), ({"n": 2, "actuated": (0, 1)}, True), ({"n": 2}, False),
     ({"n": 2, "actuated": (1,)}, True), ({"n": 2, "base": "cart"}, True)],
)  # fmt: skip
def test_the_control_loop_of_the_examples_says_for_which_chain_it_is(keywords, relative, tmp_path):
    controller = lqr(EnvConfig(mode="balance", **keywords))
    to_c(controller, tmp_path / "arm.h", prefix="arm", relative=relative)
    loop = Path(__file__).parent.parent / "examples" / "control_loop.c"
    done = subprocess.run(
        ["gcc", "-fsyntax-only", "-I.", str(loop)],
        cwd=tmp_path, check=False, capture_output=True, text=True,
    )  # fmt: skip
    assert "control_loop.c needs a chain of two rods with one motor" in done.stderr


@pytest.mark.long
def test_the_header_says_what_it_is_for(plan, tmp_path):
    to_c(plan, tmp_path / "plan.h", prefix="arm")
    text = (tmp_path / "plan.h").read_text()
    assert text.startswith(f"/* A controller, written by npend_gym {__version__}\n")
    assert '"controller": "planned transition"' in text
    assert '"mode": "swingup"' in text
    assert '"substeps"' not in text
    assert "#define ARM_ROWS 122 /* the start that is held, the steps of the plan, the" in text
    assert "#define ARM_WAIT 4 " in text
    assert max(map(len, text.splitlines())) <= 110


def test_the_header_says_how_a_mode_was_changed(tmp_path):
    mode = Balance()
    mode.hold = 3.0
    to_c(lqr(EnvConfig(n=2, mode=mode)), tmp_path / "lqr.h")
    text = (tmp_path / "lqr.h").read_text()
    assert '"env": {\n *     "n": 2,\n *     "mode": "Balance(hold=3.0)"\n *   }' in text


def test_what_cannot_be_exported_is_refused(tmp_path):
    path = tmp_path / "controller.h"
    for function in (MPC(EnvConfig(n=1, mode="balance")), lambda *_: 0.0):
        with pytest.raises(TypeError, match=r"policy must be a Policy, .* rl\.state_feedback\(con"):
            to_c(function, path)
    with pytest.raises(ValueError, match="torque_levels must be left out"):
        to_c(lqr(EnvConfig(n=2, mode="balance", torque_levels=3)), path)
    assert list(tmp_path.iterdir()) == []


def test_the_command_writes_what_the_function_writes(tmp_path, refusal):
    expected, written = tmp_path / "expected.h", tmp_path / "lqr.h"
    config = EnvConfig(n=3, mode="balance", observation="sincos", max_torque=20.0)
    to_c(lqr(config), expected, prefix="arm")
    options = ["export", "--controller", "LQR", "--to", "c", "-o", str(written)]
    options += ["--task", "balance-3", "--env", "max_torque=20.0", "--prefix", "arm"]
    assert main(options) == 0
    assert written.read_bytes() == expected.read_bytes()
    assert "give either a policy, or --controller" in refusal(*options, "calm-1")
    to_torch = ["export", "--controller", "plan", "--to", "torch", "-o", str(tmp_path / "a.pt2")]
    assert "--controller plan is for --to c" in refusal(*to_torch)
    of_mpc = ["export", "--controller", "MPC", "--to", "c", "-o", str(written)]
    message = "--controller must be one of LQR, damping, plan; got 'MPC'"
    assert message in refusal(*of_mpc)
    of_goals = ["export", "--controller", "plan", "--task", "transition-2", "--to", "c"]
    message = "--controller plan must have a task with one goal"
    assert message in refusal(*of_goals, "-o", str(written))
    with_settings = ["export", "calm-1", "--to", "c", "-o", str(written), "--env", "dt=0.1"]
    assert "--task and --env are for a --controller" in refusal(*with_settings)
