"""All features of chains in any combination, against the Lagrangian that SymPy derives."""

import itertools

import numpy as np
import pytest
from lagrangian import all_accelerations

from npend_gym import Cart, Chain, physics, simulate
from npend_gym.chain import ChainParameters
from npend_gym.physics.energy import kinetic_of_motion

FEATURES = ("links", "friction", "rotors", "drag", "springs")
BASES = ("resting", "cart", "moving")
COMBINATIONS = [
    (base, *chosen)
    for count in range(len(FEATURES) + 1)
    for chosen in itertools.combinations(FEATURES, count)
    for base in BASES
]
RIGID = ChainParameters._fields


def case(features, n=3, seed=0):
    """Return a chain with these features, all its coordinates, rates, and what acts on it."""
    rng = np.random.default_rng(seed)
    lengths = rng.uniform(0.4, 1.5, n)
    given = {"masses": rng.uniform(0.5, 2.0, n), "lengths": lengths, "damping": 0.2}
    own = {
        "links": {"centres": rng.uniform(0.2, 0.8, n) * lengths, "inertias": 0.1},
        "friction": {"friction": rng.uniform(0.1, 0.5, n), "friction_speed": 0.7},
        "rotors": {"armature": rng.uniform(0.05, 0.2, n), "gear": [-6.0, 5.0, np.inf][:n]},
        "drag": {"drag": 0.1, "quadratic_drag": rng.uniform(0.1, 0.3, n)},
        "springs": {"stiffness": rng.uniform(100.0, 300.0, n), "axial_damping": 0.6},
    }
    for feature in features[1:]:
        given |= own[feature]
    places = BASES.index(features[0])
    chain = Chain(**given, base=Cart(1.7, 0.4) if places == 1 else None)
    stretch = rng.uniform(-0.1, 0.1, n), rng.normal(0.0, 0.4, n)
    stretch = stretch if chain.stiffness is not None else (np.zeros(0), np.zeros(0))
    q = np.concatenate([rng.uniform(-3.0, 3.0, n), np.zeros(places), stretch[0]])
    u = np.concatenate([rng.normal(0.0, 2.0, n), rng.normal(size=places), stretch[1]])
    return chain, q, u, rng.normal(0.0, 1.0, n + 1), (0.5, -1.2) if places == 2 else None


def keywords(chain, q, u, loads, acceleration):
    """Return the arguments of `physics.accelerations`."""
    n, places = chain.n, 0 if chain.base is None else 1
    given = {"theta": q[:n], "omega": u[:n], "torque": loads[:n]}
    if acceleration is not None:
        places, given["pivot_acceleration"] = 2, acceleration
        given["velocity"] = u[n : n + 2]
    elif places == 1:
        given |= {"force": loads[n], "velocity": u[n]}
    if chain.stiffness is not None:
        given |= {"stretch": q[n + places :], "stretch_rate": u[n + places :]}
    return given


def values_of(chain):
    names = [*RIGID, *(["stiffness", "axial_damping"] if chain.stiffness is not None else [])]
    return {name: np.asarray(getattr(chain, name)) for name in names}


def derived(chain, q, u, loads, acceleration, **changes):
    """Return the accelerations that SymPy's equations give, complex where arguments are."""
    base = None if acceleration is None else {"acceleration": acceleration}
    if chain.base is not None:
        base = {"cart_mass": chain.base.mass, "rail_damping": chain.base.damping}
    return all_accelerations(values_of(chain) | changes, q, u, loads, base)


def complex_columns(function, x):
    """Return the derivatives of a function by the entries of `x`, by complex steps."""
    return np.stack([function(x + 1e-30j * one).imag / 1e-30 for one in np.eye(x.size)], axis=-1)


def scaled(found, expected):
    return np.abs(found - expected).max() / max(np.abs(expected).max(), 1.0)


@pytest.mark.parametrize(
    "features",
    [  # whose kernels take long to compile
        pytest.param(features, marks=[pytest.mark.long] * bool({"springs", "rotors"} & {*features}))
        for features in COMBINATIONS
    ],
    ids="-".join,
)
def test_any_mechanism_moves_and_is_linearised_as_its_lagrangian_says(features):
    state = chain, q, u, loads, acceleration = case(features)
    given = keywords(*state)
    assert scaled(physics.accelerations(chain, **given), derived(*state)) <= 1e-13
    m, n = q.size, chain.n
    inputs = n + (chain.base is not None)
    by_all = complex_columns(
        lambda x: derived(
            chain, x[:m], x[m : 2 * m], np.append(x[2 * m :], np.zeros(n + 1 - inputs)),
            acceleration,
        ),
        np.concatenate([q, u, loads[:inputs]]),
    )  # fmt: skip
    found = physics.jacobian(chain, **given)[m:]
    assert scaled(found, by_all) <= 1e-12
    if acceleration is None:
        own = {} if chain.stiffness is None else {"stretch": given["stretch"]}
        mass = physics.mass_matrix(chain, q[:n], **own)
        # each column of M^-1 answers the torque on a joint, which acts on two links
        joints = np.zeros((m, inputs))
        joints[:inputs, :inputs] = np.eye(inputs)
        joints[range(n - 1), range(1, n)] = -1.0
        assert scaled(mass @ found[:, 2 * m :], joints) <= 1e-12


@pytest.mark.long
@pytest.mark.parametrize(
    "features",
    [
        pytest.param(features, marks=pytest.mark.nightly) if 3 < len(features) < 6 else features
        for features in COMBINATIONS
    ],
    ids="-".join,
)
def test_gradients_of_any_mechanism_by_all_its_parameters_are_those_of_complex_steps(features):
    chain, q, u, loads, acceleration = case(features, n=2, seed=1)
    h = 1e-3
    given = keywords(chain, q, u, loads, acceleration)
    motion = simulate(chain, times=[0.0, h], method="rk4", dt=h, **given)
    values = values_of(chain)
    names = [name for name in values if not (name == "gear" and "rotors" not in features)]
    if "links" not in features:
        names.remove("centres")

    def end(name, value):
        q_now, u_now = q.astype(complex), u.astype(complex)
        changes = {name: value}
        if "links" not in features and name == "lengths":
            changes["centres"] = value
        slopes = []
        for part in (0.0, 0.5, 0.5, 1.0):
            q_at = q_now + (part * h * slopes[-1][0] if slopes else 0.0)
            u_at = u_now + (part * h * slopes[-1][1] if slopes else 0.0)
            slopes.append((u_at, derived(chain, q_at, u_at, loads, acceleration, **changes)))
        weights = np.array([1.0, 2.0, 2.0, 1.0]) / 6.0
        return np.concatenate([h * sum(w * each[k] for w, each in zip(weights, slopes, strict=True))
                               for k in (0, 1)])  # fmt: skip

    bars = np.random.default_rng(2).normal(size=2 * q.size)
    bar = np.zeros((2, 2, q.size))
    bar[:, 1] = bars.reshape(2, -1)
    by_name = motion.gradient(bar[0], bar[1], parameters=names).by_parameters
    for name in names:
        value = np.atleast_1d(values[name]).astype(complex)
        expected = bars @ complex_columns(
            lambda x, name=name: end(name, x[0] if name == "gravity" else x), value
        )
        assert scaled(by_name[name], expected) <= 1e-12, name


@pytest.mark.parametrize("features", [("resting", *FEATURES), ("cart", *FEATURES)], ids="-".join)
def test_energy_and_momenta_of_links_on_springs_agree_with_the_mass_matrix(features):
    chain, q, u, _, _ = case(features)
    n, places = chain.n, int(chain.base is not None)
    stretch, rate = q[n + places :], u[n + places :]
    mass = physics.mass_matrix(chain, q[:n], stretch=stretch)
    found = kinetic_of_motion(
        chain, q[:n], u[:n], u[n] if places else None, stretch, rate
    )  # fmt: skip
    assert abs(found / (0.5 * u @ mass @ u) - 1.0) <= 1e-14


@pytest.mark.long
def test_links_on_springs_keep_their_energy():
    chain = Chain(
        [1.0, 0.5], [1.0, 0.8], centres=[0.4, 0.3], inertias=0.05, armature=0.02, gear=3.0,
        stiffness=200.0, base=Cart(1.5),
    )  # fmt: skip
    motion = simulate(chain, [1.0, -0.5], 0.3, np.linspace(0.0, 3.0, 31), velocity=0.2)
    assert np.abs(motion.energy() / motion.energy()[0] - 1.0).max() < 1e-8


@pytest.mark.long
def test_links_on_stiff_springs_follow_rigid_links():
    rigid = Chain([1.0, 0.5], [1.0, 0.8], centres=[0.4, 0.3], inertias=0.05, friction=0.02)
    times, given = np.linspace(0.0, 1.0, 11), {"rtol": 1e-10, "atol": 1e-12}
    expected = simulate(rigid, [1.0, 0.5], 0.0, times, **given).theta
    errors = []
    for stiffness in (1e4, 1e5):
        chain = Chain.from_dict(rigid.as_dict() | {"stiffness": stiffness})
        found = simulate(chain, [1.0, 0.5], 0.0, times, **given).theta
        errors.append(np.abs(found - expected).max())
    np.testing.assert_allclose(errors[0] / errors[1], 10.0, rtol=0.05)


@pytest.mark.long
def test_a_link_whose_spring_is_pushed_through_its_joint_is_named():
    chain = Chain([1.0], [1.0], centres=[0.4], inertias=[0.05], stiffness=1.0)
    with pytest.raises(physics.IntegrationError, match="or a rod has no length left"):
        simulate(chain, 0.3, 0.0, [0.0, 5.0], stretch=[-0.9], stretch_rate=[-50.0])
