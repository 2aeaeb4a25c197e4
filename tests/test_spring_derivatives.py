"""Chains on springs and on bases that move, and their derivatives, against SymPy's Lagrangian."""

import numpy as np
import pytest
from lagrangian import all_accelerations
from numba import config
from oracle import rk4_step
from test_derivatives import complex_slopes

from npend_gym import Chain
from npend_gym.chain import ChainParameters
from npend_gym.compiled.arrays import aligned_zeros, packs
from npend_gym.compiled.jit import inlined_kernel, kernel
from npend_gym.compiled.packs import WIDTH
from npend_gym.physics.kernels.adjoint import ADJOINT_ROWS, adjoint
from npend_gym.physics.kernels.driven import AFTER_TORQUES
from npend_gym.physics.kernels.dynamics import (
    ANSWER_ROWS,
    WORK_ROWS,
    accelerations_kept,
    arrays_of,
    derivative,
    new_work,
    respond,
)
from npend_gym.physics.kernels.link_terms import Base, Parameter
from npend_gym.physics.kernels.rk4 import TABLEAU, WEIGHTS
from npend_gym.physics.kernels.springs import AXIAL_DAMPING, STIFFNESS, spring_arrays
from npend_gym.physics.kernels.states import new_rates_scratch, rates_of_states
from npend_gym.physics.kernels.tangent import POSE_ROWS, pose, tangent
from npend_gym.physics.kernels.tape import (
    Rods,
    Steps,
    carry_back,
    carry_changes,
    new_scratch,
)

pytestmark = pytest.mark.long  # kernels of their own take long to compile

SIMPLE = ("masses", "lengths", "gravity", "damping", "drag", "quadratic_drag")
BASES = ["rest", "cart", "prescribed"]
KINDS = ["springs", "springs in air", "links", "machine"]


class Case:
    """A chain of one kind on one base, in motion, for the kernels and for the Lagrangian."""

    def __init__(self, kind, base, n, seed=0, stiffness=(50.0, 900.0)):
        rng = np.random.default_rng([seed, n])
        self.rng, self.n, self.stretching = rng, n, kind.startswith("springs")
        options = {"damping": rng.uniform(0.1, 1.0, n)}
        lengths = rng.uniform(0.3, 2.0, n)
        if kind in ("springs in air", "machine"):
            options |= {name: rng.uniform(0.1, 1.0, n) for name in ("drag", "quadratic_drag")}
        if not self.stretching:
            options |= {"centres": lengths * rng.uniform(0.3, 0.9, n)}
            options |= {"inertias": rng.uniform(0.05, 0.5, n)}
        if kind == "machine":
            options |= {"friction": rng.uniform(0.1, 1.0, n), "friction_speed": 0.5}
            options |= {"armature": rng.uniform(0.1, 0.5, n), "gear": rng.uniform(1.0, 5.0, n)}
        chain = Chain(rng.uniform(0.3, 2.0, n), lengths, **options)
        self.values = {name: getattr(chain, name) for name in ChainParameters._fields}
        if self.stretching:
            self.values["stiffness"] = rng.uniform(*stiffness, n)
            self.values["axial_damping"] = rng.uniform(0.5, 3.0, n)
        self.base, entries = None, None
        if base == "cart":
            self.base = {"cart_mass": 1.7, "rail_damping": 0.6}
            entries = np.zeros(len(Base))
            entries[Base.INVERSE_MASS], entries[Base.DAMPING] = 1.0 / 1.7, 0.6
        elif base == "prescribed":
            self.base = {"acceleration": (2.3, -1.4)}
            entries = np.zeros(len(Base))
            entries[Base.ACROSS], entries[Base.UP] = 2.3, -1.4
        parameters = chain.repeated(1)
        if self.stretching:
            stiff = self.values["stiffness"], self.values["axial_damping"]
            self.arrays = spring_arrays(parameters, *stiff, entries)
        else:
            self.arrays = arrays_of(parameters, None if entries is None else entries[:, None])
        moving = {"rest": 0, "cart": 1, "prescribed": 2}[base]
        self.m, self.loads = n + moving + n * self.stretching, n + (moving > 0)
        self.mass = chain.masses

    def states(self, count):
        """Return q, u and loads of some states, a row each."""
        q, u = self.rng.normal(size=(2, count, self.m)) * 2.0
        if self.stretching:
            q[:, -self.n :] = self.values["lengths"] * self.rng.uniform(-0.3, 0.5, (count, self.n))
        return q, u, 5.0 * self.rng.normal(size=(count, self.loads))

    def rates(self, q, u, loads, **changed):
        """Return u' by the Lagrangian."""
        return all_accelerations(self.values | changed, q, u, loads, self.base)

    def row_of(self, name):
        """Return where a parameter stands among those that may change."""
        rows = {"stiffness": STIFFNESS, "axial_damping": AXIAL_DAMPING}
        return rows[name] if name in rows else getattr(Parameter, name)

    @property
    def names(self):
        """Return the parameters that change the motion."""
        if not self.stretching:
            plain = not np.any(self.values["friction"])
            return [*SIMPLE[:4], "centres", "inertias"] if plain else ChainParameters._fields
        resisted = SIMPLE if np.any(self.values["drag"]) else SIMPLE[:4]
        return [*resisted, "stiffness", "axial_damping"]

    def varied(self, name, change):
        """Return a parameter with a change; one of gravity is a number."""
        return {name: self.values[name] + (change[0] if name == "gravity" else change)}


def cases(*kinds):
    return pytest.mark.parametrize(
        ("kind", "base", "n"),
        [(kind, base, n) for kind in kinds for base in BASES for n in (1, 2, 3)],
    )


@cases(*KINDS)
def test_accelerations_on_every_base_are_those_of_the_lagrangian(kind, base, n):
    case = Case(kind, base, n)
    for q, u, loads in zip(*case.states(5), strict=True):
        found = np.empty(2 * case.m)
        derivative(np.concatenate([q, u]), loads, case.arrays, new_work(case.m), found)
        expected = case.rates(q, u, loads)
        np.testing.assert_array_equal(found[: case.m], u)
        assert np.abs(found[case.m :] - expected).max() <= 1e-12 * np.abs(expected).max()


@cases(*KINDS)
def test_jacobians_of_many_states_are_complex_steps_of_the_lagrangian(kind, base, n):
    case = Case(kind, base, n)
    q, u, loads = case.states(4)
    wanted = np.arange(case.loads)[::-1].copy()
    found = np.empty((4, case.m, 2 * case.m + wanted.size))
    scratch = new_rates_scratch(case.m)
    rates_of_states(q, u, loads, wanted, case.arrays, case.mass, scratch, found)
    for k in range(4):

        def rates(change, k=k):
            parts = np.split(change, [case.m, 2 * case.m])
            return case.rates(q[k] + parts[0], u[k] + parts[1], loads[k] + parts[2])

        expected = complex_slopes(rates, 2 * case.m + case.loads)
        expected[:, 2 * case.m :] = expected[:, : 2 * case.m - 1 : -1]
        assert np.abs(found[k] - expected).max() <= 1e-12 * np.abs(expected).max()


def steps_of(states, lengths, tableau, weights):
    """Return steps of a method with all instants at their ends."""
    count, stages = len(states), len(tableau)
    return Steps(
        states, lengths, tableau, np.full(count, stages), weights, np.arange(count),
        np.tile(weights, (count, 1)),
    )  # fmt: skip


def slopes_at(case, q, u, loads):
    """Return forward and backward derivatives of u' in one state, by all it depends on.

    A step of Euler's method, of one second, adds those of q' and u' to the changes.
    """
    m, n, size = case.m, case.n, 2 * case.m + case.loads
    steps = steps_of(np.concatenate([q, u])[None], np.ones(1), np.zeros((1, 1)), np.ones(1))
    rods, scratch = Rods(case.arrays, case.mass, loads[None, None]), new_scratch(1, m)
    rows = AXIAL_DAMPING + 1
    entries = [(name, i) for name in case.names for i in range(1 if name == "gravity" else n)]
    total = size + len(entries)
    changes, pushed = np.eye(total, 2 * m), np.zeros((total, case.loads))
    pushed[2 * m : size] = np.eye(case.loads)
    changed = np.zeros((total, rows, n))
    for k, (name, i) in enumerate(entries):
        changed[size + k, case.row_of(name)] = np.eye(n)[i] if name != "gravity" else 1.0
    before = changes.copy()
    carry_changes(steps, rods, changes, pushed, changed, np.empty((1, total, 2 * m)), scratch)
    forward = (changes - before)[:, m:].T
    backward = np.empty_like(forward)
    for j in range(m):
        bar, torque_bar, chain_bar = (
            np.zeros(2 * m),
            np.zeros((1, 1, case.loads)),
            np.zeros((rows, n)),
        )
        bar[m + j] = 1.0
        carry_back(steps, rods, bar, torque_bar, chain_bar, np.zeros((1, 2 * m)), scratch)
        bar[m + j] -= 1.0
        by_entries = [chain_bar[case.row_of(name), i] for name, i in entries]
        backward[j] = np.concatenate([bar, torque_bar[0, 0], by_entries])
    return forward, backward, entries


@cases(*KINDS)
def test_tangents_and_adjoints_are_complex_steps_of_the_lagrangian(kind, base, n):
    """By state, torques, force and every parameter; an adjoint is the transpose of the tangent."""
    case = Case(kind, base, n)
    q, u, loads = (x[0] for x in case.states(1))
    forward, backward, entries = slopes_at(case, q, u, loads)

    def rates(change):
        parts = np.split(change, [case.m, 2 * case.m])
        return case.rates(q + parts[0], u + parts[1], loads + parts[2])

    expected = [complex_slopes(rates, 2 * case.m + case.loads)]
    for name in case.names:
        count = 1 if name == "gravity" else n
        expected.append(
            complex_slopes(
                lambda d, name=name: case.rates(q, u, loads, **case.varied(name, d)), count
            )
        )
    whole = np.hstack(expected)
    assert whole.shape[1] == 2 * case.m + case.loads + len(entries)
    assert np.abs(forward - whole).max() <= 1e-12 * np.abs(whole).max()
    assert np.abs(backward - forward).max() <= 1e-12 * np.abs(whole).max()


@pytest.mark.parametrize("base", BASES)
@pytest.mark.parametrize("kind", ["springs in air", "machine"])
def test_derivatives_of_steps_under_loads_that_change_are_those_of_the_dense_steps(kind, base):
    """Torques, the force and the acceleration of the base differ from stage to stage."""
    case, count = Case(kind, base, 2, seed=1), 3
    m, rng = case.m, case.rng
    lengths, stages = np.array([0.02, 0.03, 0.01]), len(TABLEAU)
    loads = 3.0 * rng.normal(size=(count, stages, case.n + AFTER_TORQUES))
    if base == "prescribed":
        loads[..., case.n] = 0.0
    q, u, _ = case.states(1)
    used = case.n + (base == "cart")

    def end(change, reached=None):
        y = np.concatenate([q[0], u[0]]) + change[: 2 * m]
        given = loads[..., :used] + change[2 * m :].reshape(count, stages, used)
        for step in range(count):
            if reached is not None:
                reached.append(y.real.copy())
            of_stage = iter(range(stages))

            def rates(y, step=step, of_stage=of_stage):
                s = next(of_stage)
                if base == "prescribed":
                    case.base["acceleration"] = tuple(loads[step, s, -2:])
                return np.concatenate([y[m:], case.rates(y[:m], y[m:], given[step, s])])

            y = rk4_step(rates, y, lengths[step])
        return y

    size, states = 2 * m + count * stages * used, []
    whole = complex_slopes(end, size)
    end(np.zeros(size), states)
    steps = steps_of(np.array(states), lengths, TABLEAU, WEIGHTS)
    rods, scratch = Rods(case.arrays, case.mass, loads), new_scratch(stages, m)
    changes, pushed = np.eye(2 * m + used, 2 * m), np.zeros((2 * m + used, used + 1))
    pushed[2 * m :, :used] = np.eye(used)
    none, frames = np.zeros((2 * m + used, 0, case.n)), np.empty((count, 2 * m + used, 2 * m))
    carry_changes(steps, rods, changes, pushed, none, frames, scratch)
    np.testing.assert_array_equal(frames[-1], changes)
    at_all_times = whole[:, 2 * m :].reshape(2 * m, -1, used).sum(axis=1)
    expected = np.hstack([whole[:, : 2 * m], at_all_times])
    assert np.abs(changes.T - expected).max() <= 1e-12 * np.abs(expected).max()

    bar = weights = rng.normal(size=2 * m)
    bar, torque_bar, no_bar = bar.copy(), np.zeros((count, stages, used + 1)), np.zeros((0, case.n))
    carry_back(steps, rods, bar, torque_bar, no_bar, np.zeros((count, 2 * m)), scratch)
    got = np.concatenate([bar, torque_bar[..., :used].ravel()])
    assert np.abs(got - weights @ whole).max() <= 1e-12 * np.abs(whole).max()


@pytest.mark.parametrize("base", BASES)
def test_stiff_springs_carry_a_rigid_chain_on_every_base(base):
    """In the mean over their ringing: the accelerations with the tensions of rigid rods."""
    n = 3
    rigid = Case("links", base, n, seed=2)
    ends = {"centres": rigid.values["lengths"], "inertias": np.zeros(n)}
    errors = []
    for stiffness in (1e8, 1e10):
        soft = Case("springs", base, n, seed=2, stiffness=(stiffness, 2.0 * stiffness))
        soft.values |= {name: rigid.values[name] for name in ("masses", "lengths", "damping")}
        theta, omega = 0.7 * np.arange(1.0, n + 1), np.array([1.0, -2.0, 0.5])
        moving, loads = rigid.m - n, np.array([1.0, -0.5, 0.3, 2.0])[: rigid.loads]
        q, u = np.append(theta, [0.0] * moving), np.append(omega, [0.4, -0.3][:moving])
        expected = all_accelerations(rigid.values | ends, q, u, loads, rigid.base)
        chain = Chain(soft.values["masses"], soft.values["lengths"], damping=soft.values["damping"])
        arrays = spring_arrays(
            chain.repeated(1), soft.values["stiffness"], np.zeros(n),
            None if base == "rest" else np.array(soft.arrays.base[:, 0]),
        )  # fmt: skip
        m, stretch = moving + 2 * n, np.zeros(n)
        y, found = np.zeros(2 * m), np.empty(2 * m)
        y[: n + moving], y[m : m + n + moving] = q, u
        for _ in range(4):  # Newton: the stretch with which rods would not stretch on
            y[m - n : m] = stretch
            derivative(y, loads, arrays, new_work(m), found)
            at, slopes = found[2 * m - n :].copy(), np.empty((n, n))
            for i in range(n):
                step = 1e-3 / stiffness
                y[m - n : m] = stretch + step * np.eye(n)[i]
                derivative(y, loads, arrays, new_work(m), found)
                slopes[:, i] = (found[2 * m - n :] - at) / step
            stretch = stretch - np.linalg.solve(slopes, at)
        y[m - n : m] = stretch
        derivative(y, loads, arrays, new_work(m), found)
        errors.append(np.abs(found[m : m + n + moving] - expected).max())
    assert errors[0] <= 1e-4
    assert errors[1] <= 0.02 * errors[0]  # they decrease as 1/k


STAGE = WORK_ROWS + 1


@inlined_kernel
def _all_of_pack(q, u, loads, chain, mass, changes, pushed, changed, lam, rows, found):
    """Write accelerations, a tangent and an adjoint of the chains of a pack, or of one chain."""
    stage, poses, m = rows, rows[STAGE:], q.size
    answer = rows[STAGE + POSE_ROWS :]
    out = answer[ANSWER_ROWS:]
    alpha, force = found[0][:m], out[ADJOINT_ROWS][:m]
    accelerations_kept(q, u, loads, chain, stage, alpha)
    pose(u, alpha, chain, mass, stage, poses)
    tangent(u, alpha, changes[0], changes[1], pushed, changed, chain, mass, poses, out, force)
    respond(force, chain, stage, answer, found[1][:m])
    adjoint(
        u, alpha, lam, chain, mass, stage, answer, out, found[2][:m], found[3][:m],
        found[4][: loads.size], found[5:],
    )  # fmt: skip


@kernel
def _alone(q, u, loads, chain, mass, changes, pushed, changed, lam, rows, found):
    _all_of_pack(q, u, loads, chain, mass, changes, pushed, changed, lam, rows, found)


@kernel
def _together(q, u, loads, chain, mass, changes, pushed, changed, lam, rows, found):
    _all_of_pack(
        packs(q), packs(u), packs(loads), packs(chain), packs(mass), packs(changes), pushed,
        changed, packs(lam), packs(rows), packs(found),
    )  # fmt: skip


@pytest.mark.skipif(bool(config.DISABLE_JIT), reason="packs are there in machine code alone")
@pytest.mark.parametrize("base", ["rest", "cart"])
def test_a_lane_of_a_pack_of_springs_has_the_bits_of_the_chain_alone(base):
    n, rng = 3, np.random.default_rng(5)
    chain = Chain.uniform(n, damping=0.2, drag=0.3, quadratic_drag=0.1)
    parameters = chain.repeated(WIDTH)
    scaled = rng.uniform(0.5, 1.5, (2, WIDTH, n))
    parameters = parameters._replace(masses=scaled[0], lengths=scaled[1], centres=scaled[1])
    stiffness, axial = rng.uniform(50.0, 500.0, (WIDTH, n)), rng.uniform(0.0, 2.0, (WIDTH, n))
    entries, moving = None, 0
    if base == "cart":
        entries, moving = np.zeros((len(Base), WIDTH)), 1
        entries[Base.INVERSE_MASS] = rng.uniform(0.3, 2.0, WIDTH)
        entries[Base.DAMPING] = rng.uniform(0.0, 1.0, WIDTH)
    m, count = 2 * n + moving, AXIAL_DAMPING + 1
    q, u, lam, turned, sped = rng.normal(size=(5, m, WIDTH))
    q[-n:] *= 0.1
    loads = rng.normal(size=(n + moving, WIDTH))
    pushed, changed = rng.normal(size=n + moving), rng.normal(size=(count, n))
    height = STAGE + POSE_ROWS + ANSWER_ROWS + ADJOINT_ROWS + 1

    def run(call, lanes, arrays, width):
        rows, found = aligned_zeros(height, (m + 2) * width), aligned_zeros(5 + count, m * width)
        each = [aligned(x[:, lanes]) for x in (q, u, loads)]
        changes = np.stack([aligned(turned[:, lanes]), aligned(sped[:, lanes])])
        mass = aligned(parameters.masses.T[:, lanes])
        virtual = aligned(lam[:, lanes])
        call(*each, arrays, mass, changes, pushed, changed, virtual, rows, found)
        return found.reshape(5 + count, m, width)

    def aligned(x):
        flat = aligned_zeros(x.size)
        flat[:] = np.ascontiguousarray(x).ravel()
        return flat

    whole = run(_together, slice(None), spring_arrays(parameters, stiffness, axial, entries), WIDTH)
    for k in (0, 7, WIDTH - 1):
        one = ChainParameters(*(x[k : k + 1] for x in parameters))
        base_of_one = None if entries is None else entries[:, k]
        arrays = spring_arrays(one, stiffness[k], axial[k], base_of_one)
        alone = run(_alone, slice(k, k + 1), arrays, 1)
        np.testing.assert_array_equal(whole[..., k], alone[..., 0])
    assert np.all(np.any(whole[1] != whole[1, :, :1], axis=-1))  # the lanes differ
