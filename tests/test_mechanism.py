"""What carries a chain and what stretches in it: one value, its equations, its motions as data."""

import copy
import pickle

import numpy as np
import pytest
from lagrangian import accelerations_of_chain
from oracle import TINY, complex_slopes
from test_links import cases

from npend_gym import (
    Cart,
    Chain,
    Event,
    Signal,
    Trajectory,
    __version__,
    simulate,
)
from npend_gym.physics import (
    accelerations,
    jacobian,
    linearise,
    mass_matrix,
    momentum_jacobian,
    tensions,
)

PARTS = {
    "pivot": {},
    "cart": {"base": Cart(1.7, 0.6)},
    "springs": {"stiffness": [90.0, 60.0, 120.0], "axial_damping": [0.4, 0.0, 1.0]},
}
PARTS["springs on a cart"] = PARTS["cart"] | PARTS["springs"]


def each(mechanism, *more):
    """Return a case of a test; kernels of springs take long to compile."""
    marks = [pytest.mark.long] * ("springs" in mechanism)
    return pytest.param(mechanism, *more, marks=marks)


TIMES = np.linspace(0.0, 1.0, 11)


def chain_of(mechanism, **more):
    return Chain([1.0, 0.5, 2.0], [1.0, 0.7, 0.4], **PARTS[mechanism], **more)


def moving(chain, seed=0):
    """Return coordinates and rates, (m,) each."""
    q, u = np.random.default_rng(seed).normal(size=(2, chain.coordinates))
    if chain.stiffness is not None:
        q[-chain.n :] *= 0.1
    return q, 2.0 * u


def arguments_of(chain, q, u):
    """Return coordinates and rates as the keywords of `simulate` and `accelerations`."""
    n = chain.n
    state = {"theta": q[..., :n], "omega": u[..., :n]}
    if chain.base is not None:
        state |= {"position": q[..., n], "velocity": u[..., n]}
    if chain.stiffness is not None:
        state |= {"stretch": q[..., -n:], "stretch_rate": u[..., -n:]}
    return state


# -- the value --------------------------------------------------------------------------------


def test_chains_with_other_parts_differ_and_hung_alike_are_equal():
    chains = [chain_of(mechanism) for mechanism in PARTS]
    chains += [chain_of("cart", damping=0.1), Chain(**chains[0].as_dict(), base=Cart(1.7, 0.5))]
    assert len({*chains}) == len(chains)
    assert {chain.hung() for chain in chains[:4]} == {chains[0]}
    assert chains[4].hung() == Chain([1.0, 0.5, 2.0], [1.0, 0.7, 0.4], damping=0.1)


# -- the equations ----------------------------------------------------------------------------


def places(chain, q):
    """Return the positions of the bobs in the frame of the rail, (..., n, 2), also complex."""
    n = chain.n
    lengths = chain.lengths + (0.0 if chain.stiffness is None else q[..., -n:])
    theta = q[..., :n]
    along = np.stack([np.sin(theta), -np.cos(theta)], axis=-1)
    bobs = np.cumsum(lengths[..., None] * along, axis=-2)
    if chain.base is not None:
        bobs[..., 0] += q[..., n, None]
    return bobs


def dense_mass_matrix(chain, q):
    """Return the second derivatives of the kinetic energy by the rates, from positions alone."""
    m = chain.coordinates
    if np.iscomplexobj(q):  # there is no complex step of a complex step
        h = 1e-5
        columns = [
            (places(chain, q + h * e) - places(chain, q - h * e)) / (2 * h) for e in np.eye(m)
        ]
    else:
        columns = [places(chain, q + 1j * TINY * e).imag / TINY for e in np.eye(m)]
    by_q = np.stack(columns)  # (m, n, 2)
    matrix = np.einsum("ikx,jkx,k->ij", by_q, by_q, chain.masses)
    if chain.base is not None:
        matrix[chain.n, chain.n] += chain.base.mass
    return matrix


@pytest.mark.parametrize("mechanism", [*map(each, PARTS)])
def test_mass_matrix_and_kinetic_energy_are_those_of_all_bobs_and_the_cart(mechanism):
    chain = chain_of(mechanism)
    for seed in range(3):
        q, u = moving(chain, seed)
        own = {} if chain.stiffness is None else {"stretch": q[-3:]}
        found, expected = mass_matrix(chain, q[:3], **own), dense_mass_matrix(chain, q)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13)
        path = simulate(chain, **arguments_of(chain, q, u), times=[0.0])
        assert path.kinetic_energy()[0] == pytest.approx(0.5 * u @ expected @ u, rel=1e-12)
    many = np.stack([moving(chain, seed)[0] for seed in range(3)])
    own = {} if chain.stiffness is None else {"stretch": many[:, -3:]}
    np.testing.assert_array_equal(mass_matrix(chain, many[:, :3], **own)[2], found)


@pytest.mark.parametrize("mechanism", [*map(each, PARTS)])
def test_the_derivatives_of_the_momenta_are_those_of_the_mass_matrix_times_the_rates(mechanism):
    chain = chain_of(mechanism)
    m = chain.coordinates
    q, u = moving(chain)
    by_q = complex_slopes(lambda change: dense_mass_matrix(chain, q + change) @ u, m)
    found = momentum_jacobian(chain, q, u)
    np.testing.assert_allclose(found[:, :m], by_q, rtol=0, atol=1e-8)
    np.testing.assert_allclose(found[:, m:], dense_mass_matrix(chain, q), rtol=0, atol=1e-13)
    both = momentum_jacobian(chain, np.stack([q, 2.0 * q]), np.stack([u, u]))
    np.testing.assert_array_equal(both[0], found)


RAISED = pytest.mark.parametrize(
    ("mechanism", "raised"),
    [*(each(k, None) for k in PARTS), *(each(k, (2.3, -1.4)) for k in ("pivot", "springs"))],
)


@RAISED
def test_accelerations_of_all_coordinates_are_those_of_the_lagrangian(mechanism, raised):
    chain = chain_of(mechanism, damping=0.3, drag=0.2, quadratic_drag=0.1)
    q, u = (np.stack(rows) for rows in zip(*(moving(chain, k) for k in range(5)), strict=True))
    rng = np.random.default_rng(9)
    torque, push = rng.normal(size=(5, 3)), rng.normal(size=5)
    given = {} if chain.base is None else {"force": push}
    state = arguments_of(chain, q, u)
    if raised is not None:  # behind the angles are the place of the pivot and its velocity
        q, u = np.insert(q, [3, 3], 0.0, axis=1), np.insert(u, [3, 3], (0.3, 0.5), axis=1)
        given = {"pivot_acceleration": raised, "velocity": (0.3, 0.5)}
    found = accelerations(chain, **state, torque=torque, **given)
    for k in range(5):
        loads = np.append(torque[k], push[k])
        expected = accelerations_of_chain(chain, q[k], u[k], loads, raised)
        np.testing.assert_allclose(found[k], expected, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("mechanism", [*map(each, PARTS)])
def test_the_linearisation_has_all_coordinates_and_the_force_behind_the_joints(mechanism):
    chain = chain_of(mechanism, damping=0.3, drag=0.2)
    (q, u), m = moving(chain), chain.coordinates
    inputs = 3 + (chain.base is not None)
    torque = np.array([1.0, -0.5, 0.2])
    force = {} if chain.base is None else {"force": 2.0}

    def rates(change):
        moved_q, moved_u = q + change[:m], u + change[m : 2 * m]
        loads = np.append(torque, 2.0) + np.append(change[2 * m :], [0.0] * (4 - inputs))
        return np.concatenate([moved_u, accelerations_of_chain(chain, moved_q, moved_u, loads)])

    expected = complex_slopes(rates, 2 * m + inputs)
    whole = jacobian(chain, **arguments_of(chain, q, u), torque=torque, **force)
    np.testing.assert_allclose(whole, expected, rtol=1e-10, atol=1e-9)
    a, b = linearise(chain, **arguments_of(chain, q, u), torque=torque, joints=(2,), **force)
    np.testing.assert_array_equal(a, whole[:, : 2 * m])
    columns = [2 * m + 2, *([2 * m + 3] if chain.base is not None else [])]
    np.testing.assert_array_equal(b, whole[:, columns])


def newton(chain, q, u, a, raised=(0.0, 0.0)):
    """Return the pull along each link in its upper joint, by Newton's law for what hangs there.

    The accelerations of the centres of mass are second differences of their positions along
    q + u t + a t^2 / 2; `raised` is a prescribed acceleration of the pivot.
    """
    h, weights = 2e-3, np.array([2.0, -27.0, 270.0, -490.0, 270.0, -27.0, 2.0]) / 180.0
    times = h * np.arange(-3, 4)[:, None]
    path = q + u * times + 0.5 * a * times**2
    tips = places(chain, path)
    joints = np.concatenate([tips[:, :1] * 0.0, tips[:, :-1]], axis=1)
    if chain.base is not None:
        joints[:, 0, 0] = path[:, chain.n]
    share = 1.0 if chain.stiffness is not None else (chain.centres / chain.lengths)[:, None]
    centres = joints + share * (tips - joints)
    falling = np.tensordot(weights, centres, 1) / h**2 + raised
    speeds = np.tensordot(np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / 60.0, tips, 1) / h
    size = np.linalg.norm(speeds, axis=-1, keepdims=True)
    force = chain.masses[:, None] * (falling + np.array([0.0, chain.gravity]))
    force += (chain.drag[:, None] + chain.quadratic_drag[:, None] * size) * speeds
    hanging = np.cumsum(force[::-1], axis=0)[::-1]
    along = np.stack([np.sin(q[: chain.n]), -np.cos(q[: chain.n])], axis=-1)
    return -(hanging * along).sum(axis=-1)


@RAISED
def test_tensions_are_what_newton_says_of_the_bobs_below(mechanism, raised):
    chain = chain_of(mechanism, damping=0.3, drag=0.2, quadratic_drag=0.1)
    q, u = moving(chain)
    state = arguments_of(chain, q, u) | {"torque": [2.0, -1.0, 0.5]}
    state |= {} if chain.base is None else {"force": 3.0}
    alpha = accelerations(chain, **state, pivot_acceleration=raised)
    if raised is not None:
        state |= {"pivot_acceleration": raised}
        alpha = np.delete(alpha, [3, 4])  # of the pivot
    expected = newton(chain, q, u, alpha, raised or (0.0, 0.0))
    np.testing.assert_allclose(tensions(chain, **state), expected, rtol=0, atol=1e-5)


@pytest.mark.parametrize("base", [None, Cart(1.5, 0.3)])
def test_tensions_of_links_are_the_forces_along_them_in_their_upper_joints(base):
    for chain, theta, omega, torque in cases(3, 5, base=base):
        q, u = (np.append(x, [0.2] * (base is not None)) for x in (theta, omega))
        state = arguments_of(chain, q, u) | {"torque": torque}
        expected = newton(chain, q, u, accelerations(chain, **state))
        found = tensions(chain, **state)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7 * np.abs(expected).max())


# -- motions as data --------------------------------------------------------------------------


GAINS = {"omega": 0.1}  # in a dict, so that nothing is compiled for motions that are so short


def drive_of_the_module(t, _theta, omega):
    return np.sin(t) - GAINS["omega"] * omega[0]


LAMBDA = lambda t, _, omega: np.sin(t) - GAINS["omega"] * omega[0]  # noqa: E731 - must not pickle
SAMPLES = Signal([0.0, 0.55, 1.0], [[1.0, 0.0, 0.0], [-1.0, 0.5, 0.0], [0.0, 0.0, 0.2]], "linear")
DRIVEN = {
    "constant torques": ("pivot", {"torque": [0.5, 0.0, -0.2]}),
    "a force": ("springs on a cart", {"force": 2.0, "velocity": 0.3, "torque": 0.1}),
    "samples": ("cart", {"torque": SAMPLES, "force": Signal([0.0, 1.0], [1.0, -1.0])}),
    "samples for springs": ("springs", {"torque": SAMPLES}),
    "an acceleration": ("springs", {"pivot_acceleration": (1.0, -2.0)}),
    "a shaken pivot": (
        "pivot", {"pivot_acceleration": Signal([0.0, 1.0], [[1.0, 0.0], [0.0, 2.0]], "linear")}
    ),
    "a function of the module": ("pivot", {"torque": drive_of_the_module}),
    "a lambda": ("cart", {"torque": LAMBDA, "force": lambda t: 2.0 * np.cos(t)}),
    "an event": ("pivot", {"events": Event("velocity", rod=0, terminal=True)}),
}  # fmt: skip
LOST = ("a lambda",)  # when pickled
LOST_IN_FILES = ("a lambda", "a function of the module")


def motion_of(kind, **more):
    mechanism, keywords = DRIVEN[kind]
    return simulate(chain_of(mechanism), 0.5, 0.2, TIMES, **keywords, **more)


def same(one, other):
    for name in (
        "times", "theta", "omega", "position", "velocity", "stretch", "stretch_rate", "counts"
    ):  # fmt: skip
        mine, its = getattr(one, name), getattr(other, name)
        assert (mine is None) == (its is None), name
        if its is not None:
            np.testing.assert_array_equal(mine, its)
    assert (one.chain, one.provenance) == (other.chain, other.provenance)
    np.testing.assert_array_equal(one.status, other.status)
    for mine, its in zip(one.t_events, other.t_events, strict=True):
        np.testing.assert_array_equal(mine, its)
    np.testing.assert_array_equal(one.energy(), other.energy())


METHODS = {"dop853": {}, "rk4": {"method": "rk4", "dt": 0.02}}
# these compile loops that no other test needs: by either method, and by fixed steps
COMPILING = ("samples", "samples for springs")
COMPILING_STEPS = (
    *COMPILING, "a force", "a function of the module", "a lambda", "an acceleration",
    "a shaken pivot",
)  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "options"),
    [
        pytest.param(
            kind, options, id=f"{kind}, {method}",
            marks=pytest.mark.long if kind in (COMPILING_STEPS if options else COMPILING) else (),
        )
        for kind in DRIVEN
        for method, options in METHODS.items()
    ],
)  # fmt: skip
def test_a_trajectory_pickles_copies_and_saves_whatever_drove_it(kind, options, tmp_path):
    motion = motion_of(kind, **options)
    inside = 0.37 * motion.times[-1]
    expected = motion.at(inside)
    motion.save(tmp_path / "motion.npz")
    assert [*tmp_path.iterdir()] == [tmp_path / "motion.npz"]
    assert motion.provenance["version"] == __version__
    copies = {
        "pickled": pickle.loads(pickle.dumps(motion)),
        "copied": copy.copy(motion),
        "copied deeply": copy.deepcopy(motion),
        "saved": Trajectory.load(tmp_path / "motion.npz"),
    }
    for how, again in copies.items():
        same(again, motion)
        lost = {"pickled": LOST, "saved": LOST_IN_FILES}.get(how, ())
        if kind in lost:
            with pytest.raises(ValueError, match=r"needs the function .*, which could not"):
                again.at(inside)
        else:
            np.testing.assert_array_equal(again.at(inside), expected)


def test_a_pickle_holds_the_motion_and_not_the_steps_that_dense_output_keeps():
    motion = motion_of("constant torques")
    before = len(pickle.dumps(motion))
    motion.at(0.5)
    assert len(pickle.dumps(motion)) == before


@pytest.mark.long
def test_many_motions_pickle_and_each_of_them_goes_on(tmp_path):
    chain = chain_of("springs on a cart")
    motion = simulate(chain, np.full((3, 3), 0.4), 0.0, TIMES, force=[1.0, 0.0, -1.0])
    motion.save(tmp_path / "many.npz")
    for again in (pickle.loads(pickle.dumps(motion)), Trajectory.load(tmp_path / "many.npz")):
        same(again, motion)
        np.testing.assert_array_equal(again[2].at(0.123), motion[2].at(0.123))


def test_text_has_the_cart_and_the_springs_too(tmp_path):
    motion = motion_of("a force")
    motion.to_csv(tmp_path / "motion.csv")
    table = np.genfromtxt(tmp_path / "motion.csv", delimiter=",", names=True)
    np.testing.assert_array_equal(table["position"], motion.position)
    np.testing.assert_array_equal(table["velocity"], motion.velocity)
    for k in range(3):
        np.testing.assert_array_equal(table[f"theta{k}"], motion.theta[:, k])
        np.testing.assert_array_equal(table[f"stretch{k}"], motion.stretch[:, k])
        np.testing.assert_array_equal(table[f"stretch_rate{k}"], motion.stretch_rate[:, k])


# -- what follows from motions ----------------------------------------------------------------


def shaken_up_and_down(t):
    """Acceleration of a pivot at 0.1 m cos(120 t): a^2 w^2 = 144 > 2 g l = 19.62 m^2/s^2."""
    return 0.0, -0.1 * 120.0**2 * np.cos(120.0 * t)


def test_kapitzas_pendulum_stands_up_where_its_pivot_is_shaken_fast_enough():
    pendulum, times = Chain.uniform(1), np.linspace(0.0, 10.0, 501)
    standing = simulate(
        pendulum, np.pi - 0.2, 0.0, times, pivot_acceleration=shaken_up_and_down,
        velocity=(0.0, 0.0),
    )  # fmt: skip
    assert np.abs(standing.theta - np.pi).max() < 0.5
    # about upright it swings as in the effective potential: w^2 = a^2 w^2 / (2 l^2) - g / l
    slow = np.sqrt(0.5 * (0.1 * 120.0) ** 2 - 9.81)
    crossings = np.flatnonzero(np.diff(np.sign(standing.theta[:, 0] - np.pi)))
    assert np.diff(times[crossings]).mean() == pytest.approx(np.pi / slow, rel=0.05)
    falling = simulate(pendulum, np.pi - 0.2, 0.0, times)
    assert np.abs(falling.theta - np.pi).max() > 3.0
