"""Links with inertia, friction and rotors against other derivations of the same motion."""

import gymnasium as gym
import lagrangian
import numpy as np
import oracle
import pytest
from engines import dm_control_model, mujoco_accelerations, mujoco_motion
from gymnasium.envs.classic_control.acrobot import rk4

from npend_gym import Chain, chaos, simulate
from npend_gym.physics import accelerations, linearise, mass_matrix
from npend_gym.physics.energy import (
    centre_of_mass,
    energy_of_links,
    kinetic_energy,
    positions,
    total_energy,
)
from npend_gym.physics.substeps import default_substeps


def cases(n, count, **changes):
    """Yield chains with all that links have, in motion: (chain, theta, omega, torque)."""
    rng = np.random.default_rng(n)
    for _ in range(count):
        lengths = rng.uniform(0.3, 3.0, n)
        values = {
            "masses": rng.uniform(0.3, 3.0, n),
            "lengths": lengths,
            "gravity": rng.uniform(0.0, 20.0),
            "damping": rng.uniform(0.0, 1.0, n),
            "drag": rng.uniform(0.0, 1.0, n),
            "quadratic_drag": rng.uniform(0.0, 1.0, n),
            "centres": rng.uniform(-0.5, 1.5, n) * lengths,
            "inertias": rng.uniform(0.01, 1.0, n),
            "friction": rng.uniform(0.0, 3.0, n),
            "friction_speed": rng.uniform(0.05, 2.0, n),
            "armature": rng.uniform(0.0, 1.0, n),
            "gear": rng.choice([6.0, -6.0, 0.7, np.inf], n),
        }
        yield Chain(**(values | changes)), *rng.normal(0.0, 3.0, (2, n)), rng.normal(0.0, 10.0, n)


def difference(got, expected):
    return np.abs(got - expected).max() / np.abs(expected).max()


BARE = {"drag": 0.0, "quadratic_drag": 0.0, "friction": 0.0, "armature": 0.0}


@pytest.mark.parametrize("options", [{}, BARE], ids=["machine", "links"])
@pytest.mark.parametrize("n", [1, 2, 3, 4, 5])
def test_links_move_as_the_lagrangian_says(n, options):
    for case in cases(n, 10, **options):
        assert difference(accelerations(*case), lagrangian.accelerations(*case)) <= 1e-13


@pytest.mark.parametrize("n", [5, 20, 51])
def test_long_chains_move_as_the_dense_system_says(n):
    for case in cases(n, 5):
        assert difference(accelerations(*case), oracle.link_accelerations(*case)) <= 1e-12


@pytest.mark.parametrize("n", [1, 2, 20])
def test_links_move_as_in_mujoco(n):
    without = {"drag": 0.0, "quadratic_drag": 0.0, "friction": 0.0, "gear": np.inf}
    for case in (*cases(n, 5, **without), *cases(n, 5, armature=0.0, **without)):
        assert difference(accelerations(*case), mujoco_accelerations(*case)) <= 1e-11


@pytest.mark.parametrize("n", [1, 2, 5, 100])
def test_links_that_shrink_to_bobs_are_the_ideal_chain(n):
    for case in cases(n, 5, **BARE, centres=None, inertias=0.0):
        chain, *state = case
        nearly = Chain.from_dict(chain.as_dict() | {"inertias": 1e-30})
        assert chain.is_ideal
        assert not nearly.is_ideal
        assert difference(accelerations(nearly, *state), accelerations(chain, *state)) <= 1e-14


@pytest.mark.long
def test_a_step_of_the_acrobot_is_that_of_gymnasium():
    chain, env = Chain.acrobot(), gym.make("Acrobot-v1").unwrapped
    speeds = np.array([env.MAX_VEL_1, env.MAX_VEL_2])
    states = np.random.default_rng(0).uniform(-1.0, 1.0, (1000, 4)) * [np.pi, np.pi, *speeds]
    theta, omega = np.cumsum(states[:, :2], axis=1), np.cumsum(states[:, 2:], axis=1)
    for torque in env.AVAIL_TORQUE:  # on the elbow
        alpha = accelerations(chain, theta, omega, [0.0, torque])
        found = np.diff(alpha, prepend=0.0)
        for k, state in enumerate(states):
            slope = np.array(env._dsdt([*state, torque]))[2:4]
            assert difference(found[k], slope) <= 1e-13
            expected = rk4(env._dsdt, [*state, torque], [0.0, env.dt])[:4]
            path = simulate(
                chain, theta[k], omega[k], [0.0, env.dt], torque=[0.0, torque], method="rk4",
                dt=env.dt,
            )  # fmt: skip
            end = np.diff([path.theta[1], path.omega[1]], prepend=0.0)
            assert difference(end.ravel(), expected) <= 1e-12


@pytest.mark.long
def test_the_acrobot_of_dm_control_swings_alike():
    # its angles are from upright, clockwise: ours are pi minus their sums
    angles, speeds, control = np.array([0.4, -0.7]), np.array([0.5, 1.0]), 0.6
    expected = mujoco_motion(dm_control_model(), angles, speeds, control, 2.0, 40_000)
    path = simulate(
        Chain.dm_control("acrobot"), np.pi - np.cumsum(angles), -np.cumsum(speeds), [0.0, 2.0],
        torque=[0.0, -2.0 * control], rtol=1e-13, atol=1e-14,
    )  # fmt: skip
    found = np.diff(np.pi - path.theta[-1], prepend=0.0)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)
    assert np.abs(expected - angles).max() > 1.0


@pytest.mark.parametrize(("num_poles", "scale"), [(1, 1.0), (3, 1.0), (6, 0.25)])
def test_poles_on_the_cart_of_dm_control_swing_alike(num_poles, scale):
    rng = np.random.default_rng(num_poles)
    angles, speeds = scale * rng.normal(size=(2, num_poles))
    angles[0] += np.pi  # hanging
    model, control = dm_control_model(num_poles), 0.05
    expected = mujoco_motion(model, [0.1, *angles], [-0.3, *speeds], control, 2.0, 40_000)
    path = simulate(
        Chain.dm_control("cartpole", num_poles), np.pi - np.cumsum(angles), -np.cumsum(speeds),
        [0.0, 2.0], position=0.1, velocity=-0.3, force=10.0 * control, rtol=1e-14, atol=1e-15,
    )  # fmt: skip
    found = np.diff(np.pi - path.theta[-1], prepend=0.0)
    np.testing.assert_allclose(found, expected[1:], rtol=0, atol=1e-9)
    assert path.position[-1] == pytest.approx(expected[0], abs=1e-9)
    assert np.abs(expected - [0.1, *angles]).max() > 0.2


MACHINE = Chain(
    [1.0, 0.5, 2.0], [0.5, 0.4, 0.8], damping=0.05, drag=[0.05, 0.1, 0.02],
    quadratic_drag=[0.02, 0.03, 0.01], centres=[0.2, 0.3, 0.5], inertias=[0.02, 0.01, 0.15],
    friction=[0.3, 0.1, 0.2], friction_speed=0.5, armature=[0.05, 0.02, 0.01], gear=[6, -6, np.inf],
)  # fmt: skip
LOSSLESS = Chain.from_dict(MACHINE.as_dict() | {
    "damping": 0.0, "drag": 0.0, "quadratic_drag": 0.0, "friction": 0.0
})  # fmt: skip


@pytest.mark.parametrize("options", [{}, BARE | {"centres": None, "inertias": 0.0}])
def test_the_energy_is_that_of_the_mass_matrix_and_of_the_heights_and_of_all_links(options):
    for chain, theta, omega, torque in cases(4, 10, **options):
        matrix, _ = lagrangian.system(chain, theta, omega, torque)
        np.testing.assert_allclose(mass_matrix(chain, theta), matrix[2:, 2:], rtol=0, atol=1e-13)
        expected = 0.5 * omega @ matrix[2:, 2:] @ omega
        assert kinetic_energy(chain, theta, omega) == pytest.approx(expected, rel=1e-13)
        rise = centre_of_mass(chain, theta) - centre_of_mass(chain, np.zeros(4))
        height = total_energy(chain, theta, np.zeros(4)) / chain.gravity / chain.masses.sum()
        assert height == pytest.approx(rise[1], rel=1e-12)
        of_links = energy_of_links(chain, theta, omega).sum()
        assert of_links == pytest.approx(total_energy(chain, theta, omega), rel=1e-13)
        many = chain.repeated(2)
        again = total_energy(many, np.array([theta, theta]), np.array([omega, omega]))
        np.testing.assert_allclose(again, total_energy(chain, theta, omega), rtol=1e-15)


BOBS = Chain([1.0, 2.0, 0.5], [0.5, 1.0, 0.7], damping=[0.3, 0.1, 0.2])
DRAGGED = Chain([1.0, 0.5, 2.0], [1.0, 0.7, 0.4], 9.81, 0.05, [0.3, 0.1, 0.2], [0.2, 0.5, 0.1])
SPRUNG = Chain.from_dict(
    DRAGGED.as_dict() | {"stiffness": [300.0, 500.0, 200.0], "axial_damping": [5.0, 0.0, 8.0]}
)


@pytest.mark.parametrize("options", [{}, {"method": "rk4", "dt": 2.5e-4}], ids=["dop853", "rk4"])
@pytest.mark.parametrize(
    ("chain", "torque"),
    [
        (BOBS, [4.0, -1.0, 0.5]),
        (DRAGGED, [0.0, 0.0, 0.0]),
        pytest.param(SPRUNG, [4.0, -1.0, 0.5], marks=pytest.mark.long),
        (MACHINE, [2.0, -1.0, 0.5]),
    ],
    ids=["bobs", "drag", "springs", "machine"],
)
def test_torques_do_work_and_what_resists_takes_it(chain, torque, options):
    nodes, weights = np.polynomial.legendre.leggauss(8)  # the power, integrated by pieces
    edges = np.linspace(0.0, 4.0, 401)
    middle, half = 0.5 * (edges[1:] + edges[:-1]), 0.5 * np.diff(edges)
    times = np.concatenate([[0.0], (middle[:, None] + half[:, None] * nodes).ravel(), [4.0]])
    path = simulate(
        chain, [2.5, -1.0, 3.0], 0.0, times, torque=torque, rtol=1e-13, atol=1e-14, **options
    )
    speeds = np.diff(path.omega, axis=1, prepend=0.0)
    u = speeds / chain.friction_speed
    size = np.linalg.norm(path.velocities(), axis=2)
    powers = [
        torque * speeds,
        -chain.friction * u / np.sqrt(1.0 + u**2) * speeds,
        -chain.damping * speeds**2,
        -(chain.drag + chain.quadratic_drag * size) * size**2,
    ]
    if chain.stiffness is not None:
        powers.append(-chain.axial_damping * path.stretch_rate**2)
    works = [half @ (power.sum(axis=1)[1:-1].reshape(-1, 8) @ weights) for power in powers]
    assert path.energy()[-1] - path.energy()[0] == pytest.approx(sum(works), rel=1e-8)
    assert min(abs(work) for work in works if work) > 1.0  # J: what there is matters


@pytest.mark.parametrize("torque", [0.0, [0.0, 0.3]])
def test_default_substeps_follow_links_that_stick_and_slip(torque):
    chain, times = Chain.realaigym("C.1"), np.linspace(0.0, 5.0, 11)
    exact = simulate(chain, [2.5, 1.0], 0.0, times, torque=torque)
    dt = 0.01 / default_substeps(chain, 0.01)
    path = simulate(chain, [2.5, 1.0], 0.0, times, torque=torque, method="rk4", dt=dt)
    np.testing.assert_allclose(path.theta, exact.theta, rtol=0, atol=3e-4)
    assert dt < 1e-3 < 0.01 / default_substeps(Chain.realaigym("C.1", motors=False), 0.01)


@pytest.mark.long
def test_a_motion_of_links_without_losses_keeps_the_volume_in_phase_space():
    assert abs(chaos.volume_change(LOSSLESS)) < 1e-6
    assert chaos.volume_change(MACHINE) < -0.9


def test_states_with_leading_axes_are_linearised_one_by_one():
    theta, omega = np.random.default_rng(0).normal(size=(2, 5, 2, 3))
    together = linearise(MACHINE, theta, omega, joints=(0, 2))
    assert together.B.shape == (5, 2, 6, 2)
    alone = linearise(MACHINE, theta[3, 1], omega[3, 1], joints=(0, 2))
    for many, one in zip(together, alone, strict=True):
        np.testing.assert_allclose(many[3, 1], one, rtol=1e-13)


def test_the_ends_of_links_are_their_joints():
    np.testing.assert_allclose(
        positions(Chain.acrobot(), np.array([np.pi / 2, np.pi])), [[1.0, 0.0], [1.0, 1.0]],
        atol=1e-15,
    )  # fmt: skip
