"""Many chains side by side: against single trajectories, closed forms and each other."""

import pickle

import gymnasium as gym
import numpy as np
import pytest

from npend_gym import Cart, Chain, pseudo_periods, simulate
from npend_gym.chain import ChainParameters
from npend_gym.physics import DifferentiableEnsemble, Ensemble
from npend_gym.physics.kernels.layout import Rod
from npend_gym.physics.substeps import (
    MAX_PHASE,
    MAX_SUBSTEPS,
    chain_of,
    default_substeps,
    substeps_of,
)

RNG = np.random.default_rng(5)
CHAINS = [
    Chain(RNG.uniform(0.5, 2.0, 3), RNG.uniform(0.5, 2.0, 3), damping=d, drag=d, quadratic_drag=d)
    for d in (0.0, 0.1, 0.0, 0.3, 0.02)
]
THETA, OMEGA = RNG.uniform(-2.0, 2.0, (5, 3)), RNG.normal(size=(5, 3))


def ensemble(**options):
    many = Ensemble(CHAINS, joints=(0, 2), **options)
    many.set_state(slice(None), THETA, OMEGA)
    return many


def test_every_member_moves_as_a_chain_alone_to_the_last_bit():
    many = ensemble()
    torque = RNG.normal(size=(5, 2))
    for _ in range(4):
        many.advance(torque, 0.05, 7)
    for k, chain in enumerate(CHAINS):
        joints = np.array([torque[k, 0], 0.0, torque[k, 1]])
        times = 0.05 * np.arange(5)
        alone = simulate(chain, THETA[k], OMEGA[k], times, torque=joints, method="rk4", dt=0.05 / 7)
        np.testing.assert_allclose(many.theta[k], alone.theta[-1], rtol=0.0, atol=1e-13)
        np.testing.assert_allclose(many.omega[k], alone.omega[-1], rtol=0.0, atol=1e-13)
    assert np.all(many.time == pytest.approx(0.2, rel=1e-15))


@pytest.mark.parametrize("size", [1, 5, 40])
def test_a_rollout_is_a_sequence_of_steps_to_the_last_bit(size):
    torques, start = RNG.normal(size=(6, size, 2)), RNG.normal(size=(size, 3))
    stepped, rolled = (Ensemble(CHAINS[1], size, joints=(2, 0)) for _ in range(2))
    for one in (stepped, rolled):
        one.set_state(slice(None), start, 0.3)
    theta, omega = rolled.rollout(torques, 0.05, 3)
    assert theta.shape == omega.shape == (7, size, 3)
    for k, torque in enumerate(torques):
        np.testing.assert_array_equal(np.hstack([theta[k], omega[k]]),
                                      np.hstack([stepped.theta, stepped.omega]))  # fmt: skip
        stepped.advance(torque, 0.05, 3)
    for one in (theta[-1], rolled.theta):
        np.testing.assert_array_equal(one, stepped.theta)
    np.testing.assert_array_equal(rolled.work, stepped.work)
    with pytest.raises(ValueError, match=rf"torques must have the shape \(T, {size}, 2\)"):
        rolled.rollout(torques[0], 0.05)


def test_the_energy_changes_by_the_work_that_is_done():
    many = ensemble()
    before = many.energy
    for k in range(40):
        many.advance(np.sin(0.3 * k + np.arange(10.0)).reshape(5, 2), 0.02, 20)
    np.testing.assert_allclose(many.energy - before, many.work, atol=1e-7)
    assert np.all(np.abs(many.work) > 1e-3)
    assert np.all(many.kinetic_energy <= many.energy)


@pytest.mark.parametrize(
    ("bob", "turn", "start"),
    [(2, 2.0685330, [0.3287, -0.5525, -1.1017]), (1, 1.3248154, [0.9893, 0.7093, -0.2069])],
)
def test_a_bob_that_turns_twice_within_a_substep_is_seen_by_a_chain_with_a_motor(bob, turn, start):
    h, chain = 0.02, Chain.uniform(3)
    ends = h * np.floor(turn / h) + [0.0, h]
    velocity = simulate(chain, start, 0.0, [0.0, *ends]).velocities()[1:, bob, 0]
    assert velocity[0] * velocity[1] > 0.0  # the signs at the ends of the substep do not show it
    assert pseudo_periods(chain, start)[bob] == pytest.approx(turn, abs=1e-6)
    many = Ensemble(chain, 1, joints=(0,))
    many.set_state(0, [start])
    for _ in range(150):
        many.advance(0.0, h, 1)
    assert many.pseudo_periods[0, bob] == pytest.approx(turn, abs=5e-5)


def test_places_are_those_of_the_geometry():
    many = Ensemble(Chain([1.0, 3.0], [1.0, 2.0]), 2)
    many.set_state(slice(None), [[np.pi / 2, 0.0], [0.0, np.pi]])
    np.testing.assert_allclose(many.tip, [[1.0, -2.0], [0.0, 1.0]], atol=1e-15)
    np.testing.assert_allclose(many.centre_of_mass, [[1.0, -1.5], [0.0, 0.5]], atol=1e-15)


def test_some_members_wait_while_others_advance():
    many = ensemble()
    active = np.array([True, False, True, False, True])
    many.advance(1.0, 0.05, 5, active=active)
    assert np.array_equal(many.time > 0.0, active)
    np.testing.assert_array_equal(many.theta[~active], THETA[~active])
    assert np.all(many.theta[active] != THETA[active])


def test_a_member_that_diverges_keeps_its_last_finite_state_until_another_is_set():
    many = Ensemble(Chain.uniform(2), 3)
    many.set_state(slice(None), 0.1)
    many.set_state([1], 0.1, 9e5)
    many.advance(0.0, 1.0, 1)
    for _ in range(3):
        assert many.diverged.tolist() == [False, True, False]
        assert np.all(np.isfinite(many.theta))
        np.testing.assert_array_equal(many.omega[1], 9e5)
        many.advance([[0.0], [1e30], [0.0]], 0.05, 2, active=~many.diverged)
    many.set_state([1], 0.0, 0.0)
    assert not many.diverged.any()


@pytest.mark.long
@pytest.mark.parametrize("size", [1, 3])
def test_a_cart_may_be_anywhere_at_any_speed_and_diverges_where_it_is_not_finite(size):
    near, far = (DifferentiableEnsemble(Chain.uniform(2, base=Cart(1.0)), size) for _ in "12")
    near.set_state(slice(None), 1.0)
    far.set_state(slice(None), 1.0, cart=([2e5] * size, [3e6] * size))
    for many in (near, far):
        many.advance(0.0, 0.05)
    assert not far.diverged.any()
    np.testing.assert_array_equal(far.theta, near.theta)
    np.testing.assert_array_equal(far.step_jacobian(0.0, 0.05).A, near.step_jacobian(0.0, 0.05).A)
    far._memory.of_base(Rod.OMEGA)[:] = np.inf
    far.advance(0.0, 0.05)
    assert far.diverged.all()
    with pytest.raises(FloatingPointError, match="leave all bounds in the step"):
        far.step_jacobian(0.0, 0.05)


def test_chains_of_members_are_given_as_arrays_of_parameters():
    many = Ensemble(Chain.uniform(2), 4)
    masses = RNG.uniform(0.5, 2.0, (2, 2))
    many.set_chain([1, 3], Chain.uniform(2).repeated(2, masses=masses))
    np.testing.assert_array_equal(many.parameters.masses[[1, 3]], masses)
    np.testing.assert_array_equal(many.parameters.masses[[0, 2]], 1.0)
    assert many.chain(3) == Chain(masses[1], 1.0)
    many.set_state(slice(None), 0.5)
    many.advance(0.0, 0.05)
    alone = Ensemble(Chain(masses[1], 1.0), 1)
    alone.set_state(0, 0.5)
    needed = max(default_substeps(many.chain(k), 0.05) for k in range(4))
    alone.advance(0.0, 0.05, needed)
    np.testing.assert_array_equal(many.theta[3], alone.theta[0])


def test_a_copy_moves_on_as_the_original_does():
    many = ensemble(threads=2)
    many.advance(0.5, 0.05)
    copy = pickle.loads(pickle.dumps(many))
    for one in (many, copy):
        one.advance(-0.5, 0.05)
    np.testing.assert_array_equal(copy.theta, many.theta)
    np.testing.assert_array_equal(copy.work, many.work)


def test_an_interrupted_ensemble_refuses_further_use(monkeypatch):
    many = ensemble()

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("npend_gym.physics.ensemble.advance_many", interrupted)
    with pytest.raises(KeyboardInterrupt):
        many.advance(0.0, 0.05)
    for use in (
        lambda: many.theta,
        lambda: many.energy,
        lambda: many.advance(0.0, 0.05),
        lambda: many.set_state(0, 0.1),
        lambda: many.set_chain(0, CHAINS[0]),
    ):
        with pytest.raises(RuntimeError, match="interrupted"):
            use()


MASKED = np.ma.masked_array([True] * 5, mask=[False, True, False, False, False])


def links(**more):
    return Ensemble(Chain.rods([1.0, 1.0], [1.0, 1.0], **more), 2)


def with_parameters(**parameters):
    ensemble().set_chain(0, CHAINS[0].repeated(1)._replace(**parameters))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Ensemble(CHAINS[0], 0), "size must be at least 1"),
        (lambda: Ensemble([]), r"chain must be one npend_gym\.Chain or more, got none"),
        (lambda: Ensemble(CHAINS[0], 2, joints=(3,)), "joint must be between 0 and 2"),
        (lambda: Ensemble(CHAINS[0], 2, joints=(1, 1)), r"must name each joint once, got \[1, 1\]"),
        (lambda: Ensemble([CHAINS[0], Chain.uniform(2)]), "the same number of rods, got 3 and 2"),
        (lambda: Ensemble(CHAINS[0], joints=0), r"joints must be a list such as \(0,\), got 0"),
        (lambda: ensemble().set_state([7], 0.1), "members must be indices below 5"),
        (lambda: ensemble().set_state(None, 0.1), "members must be .* in one list, .* got None"),
        (lambda: ensemble().set_state(True, 0.1), "members must be indices"),
        (lambda: ensemble().set_state([[0, 1]], 0.1), "members must be indices"),
        (lambda: ensemble().set_chain([[0, 1]], CHAINS[0]), "members must be indices"),
        (lambda: ensemble().chain(5), "member must be between -5 and 4, got 5"),
        (lambda: ensemble().set_state([0], np.ones((2, 3))), "theta and omega must have the shape"),
        (lambda: ensemble().set_state([0], 2e5), "theta must lie within"),
        (lambda: ensemble().set_state([0], np.nan), "theta must be finite"),
        (lambda: ensemble().advance(np.ones(3), 0.05), "torque must be one number"),
        (lambda: ensemble().advance(0.0, -0.05), "dt must be greater than zero"),
        (lambda: ensemble().advance(0.0, 0.05, 0), "substeps must be between 1"),
        (lambda: ensemble().advance(0.0, 0.05, active=[True]), "active must have the shape"),
        (lambda: ensemble().advance(0.0, 0.05, active=[0, 1, 2]), "active must hold True or False"),
        (lambda: ensemble().advance(0.0, 0.05, active=["no"] * 5), "active must hold True or"),
        (lambda: ensemble().advance(0.0, 0.05, active=MASKED), "active must have no masked"),
        (lambda: ensemble().set_chain(0, Chain.rods([1.0] * 3, [1.0] * 3)), "begin with a chain"),
        (lambda: links().set_chain(0, Chain.uniform(2, drag=0.5)), "nor links get .* or drag"),
        (lambda: ensemble().set_chain(0, Chain.uniform(2)), "chain must have 3 rigid rods"),
        (lambda: ensemble().set_chain(0, "acrobot"), "chain must be an npend_gym.Chain or"),
        (lambda: with_parameters(masses=np.array([[1.0, np.nan, 1.0]])), "masses must be finite"),
        (lambda: with_parameters(damping=np.array([[0.0, -1.0, 0.0]])), "damping must be zero or"),
        (lambda: with_parameters(gear=np.full((1, 3), np.nan)), "gear must be finite"),
        (
            lambda: with_parameters(lengths=np.ones((2, 3))),
            r"lengths must have the shape \(1, 3\), .* \(2, 3\)",
        ),
        (lambda: ensemble().advance(0.0, 0.1, force=1.0), r"force must be 0 .* base=Cart\(mass\)"),
        (lambda: ensemble().set_state(0, 0.1, cart=(0, 1)), r"cart must be 0 .* base=Cart\(mass\)"),
        (lambda: Ensemble([CHAINS[0], Chain.uniform(3, base=Cart(1.0))]), "have a cart or none"),
        (lambda: Ensemble(Chain.uniform(2, stiffness=1e3), 2), "leave out stiffness, or use"),
    ],
)
def test_bad_input_is_refused_by_name(call, message):
    with pytest.raises((ValueError, TypeError), match=message):
        call()


MACHINE = {"inertias": 0.02, "centres": 0.3, "friction": 0.05, "armature": 0.01, "gear": -6.0}


@pytest.mark.parametrize("parts", [{}, MACHINE], ids=["point masses", "machine"])
@pytest.mark.long
def test_chains_on_carts_follow_simulate_and_the_work_that_is_done(parts):
    rng = np.random.default_rng(3)
    parts = parts | {"drag": 0.1, "base": Cart(2.0, 0.3)}
    chains = [Chain(rng.uniform(0.5, 2.0, 2), [0.5, 0.4], **parts) for _ in range(17)]
    many = Ensemble(chains)
    many.set_state(slice(None), [0.4, 0.2], 0.0, cart=(0.5, 0.3))
    one = Ensemble(chains[5], 1)
    one.set_state(0, [0.4, 0.2], 0.0, cart=(0.5, 0.3))
    for _ in range(10):
        many.advance(0.3, 0.05, 100, force=1.5)
        one.advance(0.3, 0.05, 100, force=1.5)
    path = simulate(
        chains[5], [0.4, 0.2], 0.0, [0.0, 0.5], position=0.5, velocity=0.3, torque=0.3, force=1.5,
        rtol=1e-12, atol=1e-13,
    )  # fmt: skip
    np.testing.assert_allclose(many.theta[5], path.theta[-1], rtol=0, atol=1e-7)
    for found, expected in zip(many.cart, (path.position, path.velocity), strict=True):
        assert found[5] == pytest.approx(expected[-1], abs=1e-7)
    for found, alone in ((many.theta, one.theta), (many.cart[0], one.cart[0])):
        np.testing.assert_array_equal(found[5], alone[0])
    gained = path.energy()[-1] - path.energy()[0]  # of the cart too, in the frame of the rail
    assert gained == pytest.approx(many.work[5], abs=1e-7)


@pytest.mark.long
def test_point_masses_with_drag_stand_among_links_with_drag():
    many, chain = links(drag=0.1), Chain.uniform(2, drag=0.5)
    many.set_chain(0, chain)
    many.set_state(slice(None), 1.0)
    many.advance(0.0, 0.5)
    expected = simulate(chain, 1.0, 0.0, [0.0, 0.5]).theta[-1]
    np.testing.assert_allclose(many.theta[0], expected, atol=1e-6)


@pytest.mark.long
def test_chains_of_all_kinds_stand_side_by_side_and_keep_their_parameters():
    kinds = [Chain.uniform(2), Chain.rods([1.0, 1.0], [1.0, 0.5]), Chain.realaigym("C.1")]
    many = Ensemble(kinds)
    many.set_state(slice(None), 0.5)
    many.advance(0.0, 0.1, 2000)  # dry friction is resolved by short steps
    for k, chain in enumerate(kinds):
        assert many.chain(k) == chain
        path = simulate(chain, 0.5, 0.0, [0.0, 0.1])
        np.testing.assert_allclose(many.theta[k], path.theta[-1], rtol=0, atol=1e-7)


@pytest.mark.long
@pytest.mark.parametrize("size", [1, 3])
def test_a_machine_whose_base_rests_minds_no_other_memory(size):
    # what lies behind the rods in memory that was used before must not count as a base's motion
    chain = Chain.realaigym("C.1")
    path = simulate(chain, 0.5, 0.0, [0.0, 0.1], method="rk4", dt=2e-3)
    for _ in range(10):
        del [np.full(k, np.nan) for k in range(1, 3000, 60)][:]
        many = Ensemble(chain, size)
        many.set_state(slice(None), 0.5)
        many.advance(0.0, 0.1, 50)
        np.testing.assert_array_equal(many.theta, np.tile(path.theta[-1], (size, 1)))


def drawn_chains(kind, count, n, rng):
    """Return parameters of many chains of a kind, over six powers of ten where that is "wide"."""

    def draw(shape=(count, n)):
        exponents = rng.uniform(-3.0, 3.0, shape)
        return 10.0**exponents if kind == "wide" else rng.uniform(0.5, 2.0, shape)

    given = {"masses": draw(), "lengths": draw()}
    if kind == "braked":
        given |= {name: draw() for name in ("damping", "drag", "quadratic_drag", "friction")}
    if kind == "machines":
        given |= {"centres": draw() - 1.0, "inertias": draw(), "armature": draw()}
        given |= {"gear": 5.0 * draw(), "friction": draw(), "damping": draw()}
    if kind == "mixed":
        some = rng.random((count, 1)) < 0.5
        given |= {"inertias": np.where(some, draw(), 0.0), "damping": draw()}
        given["gravity"] = np.where(rng.random(count) < 0.5, 0.0, draw((count,)))
    return Chain.uniform(n).repeated(count, **given)


@pytest.mark.parametrize("kind", ["wide", "narrow", "braked", "machines", "mixed"])
@pytest.mark.parametrize("n", [1, 2, 4])
def test_the_substeps_of_many_chains_are_the_most_that_one_of_them_needs(kind, n):
    rng = np.random.default_rng(n)
    chains = drawn_chains(kind, 60, n, rng)
    members = range(60)
    for dt in (1e-4, 0.02, 1.0):
        one_by_one = max(default_substeps(chain_of(chains, k), dt) for k in members)
        if one_by_one > MAX_SUBSTEPS:
            with pytest.raises(ValueError, match="dt must be so short that 100000 substeps"):
                substeps_of(chains, dt)
            continue
        assert substeps_of(chains, dt) == one_by_one
        fewer = ChainParameters(*(row[:1] for row in chains))
        assert substeps_of(fewer, dt) == default_substeps(chain_of(chains, 0), dt)


def test_chains_at_the_edge_of_one_more_substep_get_it():
    lengths = np.linspace(1.0, 1.0 + 1e-12, 7)[:, None]
    chains = Chain.uniform(1).repeated(7, lengths=lengths)
    edge = MAX_PHASE / np.sqrt(9.81)
    for k in (1, 3, 19):
        for dt in k * edge * (1.0 + np.linspace(-2e-12, 2e-12, 9)):
            expected = max(default_substeps(chain_of(chains, j), dt) for j in range(7))
            assert substeps_of(chains, dt) == expected


@pytest.mark.long
def test_default_substeps_resolve_the_motion_of_a_chain_on_a_light_cart():
    chain = Chain.uniform(2, base=Cart(0.02))
    ensemble = Ensemble(chain, 1)
    ensemble.set_state(slice(None), [0.1, -0.2])
    ensemble.advance(0.0, 0.1)
    motion = simulate(chain, [0.1, -0.2], 0.0, [0.0, 0.1], rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(ensemble.theta[0], motion.theta[1], atol=1e-6)
    assert ensemble.cart[0][0] == pytest.approx(motion.position[1], abs=1e-6)


@pytest.mark.parametrize(
    "advance",
    [
        lambda: Ensemble(Chain.uniform(1, length=1e-4), 1).advance(0.0, 100.0),
        lambda: Ensemble(Chain.uniform(1, base=Cart(1e-12)), 1).advance(0.0, 0.5),
        lambda: gym.make("NPendulum-v0", n=1, mode="passive", lengths=1e-4, dt=100.0),
        lambda: gym.make_vec("NPendulum-v0", num_envs=2, n=1, damping=1e9),
    ],
)
def test_a_step_that_needs_too_many_substeps_is_refused(advance):
    with pytest.raises(ValueError, match=r"dt must be so short .* shorten dt, or give substeps"):
        advance()


def test_a_step_as_long_as_its_substeps_allow_keeps_the_energy():
    ensemble = Ensemble(Chain.uniform(1, length=1e-4), 1)
    ensemble.set_state(0, 0.5)
    before = ensemble.energy
    ensemble.advance(0.0, 1.0)
    np.testing.assert_allclose(ensemble.energy, before, rtol=1e-4)


def test_a_member_on_a_cart_has_the_mass_that_was_given():
    masses = [0.9, 0.7, 1.1, 0.049, 3.3, 1e-3, 123.456, 5.0]
    chains = [Chain.uniform(1, base=Cart(mass, 0.1)) for mass in masses]
    many = Ensemble(chains)
    assert [many.chain(k) for k in range(len(chains))] == chains
    for mass in np.random.default_rng(0).uniform(0.1, 10.0, 100):
        found = Ensemble(Chain.uniform(1, base=Cart(mass)), 1).chain(0).base.mass
        assert 1.0 / found == 1.0 / mass  # no motion differs


@pytest.mark.parametrize("cart", [(0.0,), (0.0, 0.0, 0.0), 0.5, (1.0, 0.0)])
def test_an_ensemble_that_refuses_the_state_of_a_cart_stays_in_use(cart):
    many = ensemble()
    with pytest.raises((TypeError, ValueError), match="cart must be"):
        many.set_state(0, 0.1, cart=cart)
    np.testing.assert_array_equal(many.theta, THETA)
