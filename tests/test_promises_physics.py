"""The physics against another engine, and against what holds for every chain."""

import gymnasium as gym
import numpy as np
import pytest

import npend_gym  # noqa: F401 - registers the environments
from npend_gym import Chain, pseudo_periods, simulate, theory

TIGHTEST = {"rtol": 1e-14, "atol": 1e-16}
TORQUES = (4.0, -7.0, 2.0, 0.0)  # N m at the pivot, half a second each


def uneven_chain(n, **others):
    return Chain(np.linspace(1.0, 0.4, n), np.linspace(0.6, 1.1, n), **others)


def mujoco_path(chain, theta, dt):
    """Return angles and velocities of MuJoCo's equivalent chain every half second, (4, 2, n)."""
    mujoco = pytest.importorskip("mujoco")
    spec = mujoco.MjSpec()
    spec.option.timestep, spec.option.integrator = dt, mujoco.mjtIntegrator.mjINT_RK4
    spec.option.gravity = [0.0, 0.0, -chain.gravity]
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    body, above = spec.worldbody, 0.0
    for mass, length in zip(chain.masses, chain.lengths, strict=True):
        body = body.add_body(pos=[0.0, 0.0, -above])
        body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0.0, -1.0, 0.0])
        # MuJoCo wants some inertia: so little that it is below the tolerances
        body.mass, body.ipos, body.inertia = mass, [0.0, 0.0, -length], [1e-13] * 3
        body.explicitinertial = True
        above = length
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:] = np.diff(theta, prepend=0.0)  # joint angles are relative
    seen = []
    for torque in TORQUES:
        data.qfrc_applied[0] = torque
        for _ in range(round(0.5 / dt)):
            mujoco.mj_step(model, data)
        seen.append([np.cumsum(data.qpos), np.cumsum(data.qvel)])
    return np.array(seen)


@pytest.mark.parametrize("n", [2, 3, 5])
def test_mujocos_equivalent_chain_moves_alike_under_steps_of_torque(n):
    chain, start = uneven_chain(n), np.linspace(0.9, 0.2, n)
    reference = mujoco_path(chain, start, 1e-4)
    for options, tolerance in ((TIGHTEST, 1e-9), ({}, 1e-6)):
        theta, omega = start, np.zeros(n)
        for k, torque in enumerate(TORQUES):
            path = simulate(chain, theta, omega, [0.0, 0.5], torque=torque, **options)
            theta, omega = path.theta[-1], path.omega[-1]
            np.testing.assert_allclose(theta, reference[k, 0], rtol=0.0, atol=tolerance)
            np.testing.assert_allclose(omega, reference[k, 1], rtol=0.0, atol=10.0 * tolerance)


@pytest.mark.parametrize("n", [2, 3, 5])
def test_the_environment_moves_as_mujocos_chain(n):
    chain, start = uneven_chain(n), np.linspace(0.9, 0.2, n)
    reference = mujoco_path(chain, start, 1e-4)
    for substeps, tolerance in ((None, 2e-5), (400, 1e-9)):
        env = gym.make(
            "NPendulum-v0", n=n, masses=chain.masses, lengths=chain.lengths, max_torque=10.0,
            dt=0.05, substeps=substeps,
        )  # fmt: skip
        _, info = env.reset(seed=0, options={"theta": start, "omega": 0.0})
        for k, torque in enumerate(TORQUES):
            for _ in range(10):
                info = env.step(np.array([torque / 10.0]))[4]
            np.testing.assert_allclose(info["theta"], reference[k, 0], rtol=0.0, atol=tolerance)


def test_energy_is_kept_for_twenty_seconds_and_for_an_hour():
    for n in (1, 2, 5):
        chain = uneven_chain(n)
        scale = float(chain.gravity * (chain.masses @ np.cumsum(chain.lengths)))
        tight = simulate(chain, 1.5, 0.0, np.linspace(0.0, 20.0, 201), **TIGHTEST).energy()
        assert np.ptp(tight) < 1e-9 * scale
        hour = simulate(chain, 0.8, 0.0, np.linspace(0.0, 3600.0, 361)).energy()
        assert np.ptp(hour) < 1e-6 * scale


def test_whole_turns_of_a_rod_change_nothing_but_its_angle():
    chain, start = uneven_chain(3), np.array([0.5, 1.0, -0.3])
    turns = 2.0 * np.pi * np.array([1, -2, 3])
    times = np.linspace(0.0, 3.0, 31)
    path = simulate(chain, start, 0.0, times, **TIGHTEST)
    turned = simulate(chain, start + turns, 0.0, times, **TIGHTEST)
    np.testing.assert_allclose(turned.theta - turns, path.theta, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(turned.positions(), path.positions(), rtol=0.0, atol=1e-11)


@pytest.mark.parametrize("ratio", [1e-12, 1e-3, 1e3, pytest.param(1e12, marks=pytest.mark.long)])
@pytest.mark.parametrize("what", ["masses", "lengths"])
def test_enormous_ratios_keep_the_energy(what, ratio):
    values = {"masses": np.ones(3), "lengths": np.ones(3)}
    values[what] = np.array([1.0, 1.0, ratio])
    chain = Chain(**values)
    period = 2.0 * np.pi / theory.fastest_frequency(chain)
    times = np.linspace(0.0, 20.0 * min(period, 1.0), 21)
    energy = simulate(chain, 0.5, 0.0, times, rtol=1e-12, atol=1e-14).energy()
    assert np.ptp(energy) < 1e-8 * energy[0]


@pytest.mark.parametrize("n", [2, 3, 5])
def test_a_mode_has_the_period_of_its_frequency(n):
    chain = uneven_chain(n)
    frequencies, modes = theory.normal_modes(chain)
    for k in range(n):
        shape = 1e-4 * modes[:, k]
        periods = pseudo_periods(chain, shape, reading="link")
        # a rod's speed falls, rises and falls: in a mode, one period from rest
        known = periods[np.isfinite(periods)]
        assert known.size
        np.testing.assert_allclose(known, 2.0 * np.pi / frequencies[k], rtol=1e-6)


@pytest.mark.parametrize("reading", ["bob", "link"])
def test_a_bob_that_goes_over_the_top_for_ever_has_no_period_of_its_rod(reading):
    periods = pseudo_periods(Chain.uniform(1), 0.1, 10.0, reading=reading, duration=20.0)
    if reading == "link":  # the rod never turns back
        assert np.isnan(periods).all()
    else:  # the bob's horizontal velocity reverses twice in each turn, at the top and the sides
        path = simulate(Chain.uniform(1), 0.1, 10.0, np.linspace(0.0, 2.0, 20001))
        side = path.velocities()[:, 0, 0]
        up = np.flatnonzero((side[:-1] < 0.0) & (side[1:] >= 0.0))[0]
        down = np.flatnonzero((side[:-1] > 0.0) & (side[1:] <= 0.0))
        assert periods[0] == pytest.approx(path.times[down[down > up][0]], abs=2e-4)
