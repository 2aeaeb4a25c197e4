"""A law of friction with a parameter of its own, added to a copy of the package in a few files."""

import pytest
from scripts import changed_copy, run_python

# Stribeck: joints that stick have (1 + stiction) times the friction of those that slide
STRIBECK = {
    "npend_gym/chain/model.py": [
        ("    gear: FloatArray\n", "    gear: FloatArray\n    stiction: FloatArray\n"),
        (
            "        gear: ArrayLike | None = np.inf,\n",
            "        gear: ArrayLike | None = np.inf,\n        stiction: ArrayLike = 0.0,\n",
        ),
        (
            '            "armature": armature,\n',
            '            "armature": armature,\n            "stiction": stiction,\n',
        ),
    ],
    "npend_gym/chain/parameters.py": [
        ("    gear: FloatArray\n", "    gear: FloatArray\n    stiction: FloatArray\n"),
        ("none, np.full_like(masses, np.inf)\n", "none, np.full_like(masses, np.inf), none\n"),
    ],
    "npend_gym/physics/kernels/laws.py": [
        ("    PER_SPEED: int = 2", "    STICTION: int = 3\n    PER_SPEED: int = 2"),
        (
            "    rows[Friction.PER_SPEED, column] =",
            (
                "    rows[Friction.STICTION, column] = chain[Parameter.stiction, i]\n"
                "    rows[Friction.PER_SPEED, column] ="
            ),
        ),
        (
            "    return (rows[Friction.FRICTION, i] * u) / math.sqrt(1.0 + u * u)\n",
            "    return rows[Friction.FRICTION, i] * _share(rows, i, u)\n",
        ),
        (
            "    return u / math.sqrt(1.0 + u * u)\n",
            (
                "    sticking = rows[Friction.STICTION, i] / (1.0 + u * u)\n"
                "    return (1.0 + sticking) * u / math.sqrt(1.0 + u * u)\n"
            ),
        ),
        (
            "    return slope / (root * root * root)\n",
            (
                "    sticking = rows[Friction.STICTION, i] * (1.0 - 2.0 * u * u) / (root * root)\n"
                "    return slope * (1.0 + sticking) / (root * root * root)\n"
            ),
        ),
        (
            "    return changed[Parameter.friction, i] * share - by_speed\n",
            (
                "    by_speed -= changed[Parameter.stiction, i] * _sticking(rows, i, u)\n"
                "    return changed[Parameter.friction, i] * share - by_speed\n"
            ),
        ),
        (
            "    chain_bar[Parameter.friction, i] += share * torque_bar\n",
            (
                "    chain_bar[Parameter.friction, i] += share * torque_bar\n"
                "    chain_bar[Parameter.stiction, i] += _sticking(rows, i, u) * torque_bar\n"
            ),
        ),
        (
            "@inlined_kernel\ndef friction_change(",
            (
                "@inlined_kernel\n"
                "def _sticking(rows: FloatArray, i: int, u: Any) -> Any:\n"
                "    root = math.sqrt(1.0 + u * u)\n"
                "    return rows[Friction.FRICTION, i] * u / (root * root * root)\n\n\n"
                "@inlined_kernel\ndef friction_change("
            ),
        ),
    ],
}

USED = """
import math, numpy as np, gymnasium as gym, npend_gym
from npend_gym import Chain, physics, simulate
from npend_gym.physics import DifferentiableEnsemble, Ensemble

def law(chain, j, speed):  # what the parameter means, in plain words
    u = speed / chain.friction_speed[j]
    return chain.friction[j] * u / math.sqrt(1 + u * u) * (1 + chain.stiction[j] / (1 + u * u))

given = dict(friction=[0.3, 0.2], friction_speed=0.7, stiction=[0.5, 0.8])
chain = Chain([1.0, 0.6], [0.8, 0.5], **given)
assert Chain.from_dict(chain.as_dict()) == chain and "stiction" in repr(chain)
theta, omega = [0.4, 1.3], [0.5, -0.2]
resisted = [law(chain, 0, 0.5), law(chain, 1, -0.7)]
smooth = Chain([1.0, 0.6], [0.8, 0.5])
expected = physics.accelerations(smooth, theta, omega, -np.array(resisted))
np.testing.assert_allclose(physics.accelerations(chain, theta, omega), expected, rtol=1e-13)

times, h = [0.0, 0.1, 0.2], 1e-6
def end(**changes):
    changed = Chain.from_dict(chain.as_dict() | changes)
    return simulate(changed, theta, omega, times, method="rk4", dt=0.01).theta[-1]
motion = simulate(chain, theta, omega, times, method="rk4", dt=0.01)
for name in ("stiction", "friction", "friction_speed"):
    own = getattr(chain, name)
    near = (end(**{name: own + h}) - end(**{name: own - h})) / (2 * h)
    found = motion.sensitivities(parameters={name: np.ones((1, 2))}).C[-1, :2, 0]
    np.testing.assert_allclose(found, near, rtol=1e-5, atol=1e-9)
    bars = np.zeros((3, 2)); bars[-1] = 1.0
    back = motion.gradient(bars, 0.0, [name]).by_parameters[name].sum()
    np.testing.assert_allclose(back, near.sum(), rtol=1e-5, atol=1e-9)
numbers = physics.linearise(chain, theta, omega).A[2:, 2:]
for k in range(2):
    ends = [physics.accelerations(chain, theta, np.array(omega) + s * h * np.eye(2)[k])
            for s in (1, -1)]
    np.testing.assert_allclose(numbers[:, k], (ends[0] - ends[1]) / (2 * h), rtol=1e-6)

ensemble = Ensemble(chain, 20)
ensemble.set_state(slice(None), theta, omega)
ensemble.advance(0.0, 0.2, 20)
np.testing.assert_allclose(ensemble.theta[-1], motion.theta[-1], rtol=1e-12)
np.testing.assert_array_equal(ensemble.parameters.stiction[-1], chain.stiction)
differentiable = DifferentiableEnsemble(chain, 20)
differentiable.set_state(slice(None), theta, omega)
found = differentiable.step_vjp(0.0, 0.2, 20, theta_bar=1.0, omega_bar=0.0, parameters=["stiction"])
near = (end(stiction=chain.stiction + h) - end(stiction=chain.stiction - h)) / (2 * h)
np.testing.assert_allclose(found[-1]["stiction"][-1].sum(), near.sum(), rtol=1e-5)

seen = []
for value in ([0.5, 0.8], 0.0):
    own = Chain.from_dict(chain.as_dict() | {"stiction": value})
    env = gym.make("npend/SwingUp-v1", chain=own)
    env.reset(seed=0)
    seen.append([env.step(np.ones(env.action_space.shape, np.float32))[0] for _ in range(5)][-1])
assert np.abs(seen[0] - seen[1]).max() > 1e-6

from npend_gym.export import to_mjcf, to_sdf, to_urdf, to_usd
for write in (to_mjcf, to_urdf, to_sdf, to_usd):
    try:
        write(chain)
    except ValueError as error:
        assert "stiction must be left out" in str(error)
    else:
        raise AssertionError("stiction was lost")

times = np.arange(0.0, 4.0, 0.01)
moved = simulate(chain, [1.9, 1.2], 0.0, times).theta
wrong = Chain.from_dict(chain.as_dict() | {"friction": [0.2, 0.3]})
found = npend_gym.identify(times, moved, chain=wrong, fit=["friction"]).chain
np.testing.assert_allclose(found.friction, chain.friction, rtol=1e-4)
np.testing.assert_array_equal(found.stiction, chain.stiction)
"""


@pytest.mark.long
def test_a_law_of_friction_with_one_parameter_takes_three_files(tmp_path):
    assert len(STRIBECK) <= 4
    environment = changed_copy(tmp_path, STRIBECK.items())
    run_python("-c", USED, env=environment, cwd=tmp_path)
