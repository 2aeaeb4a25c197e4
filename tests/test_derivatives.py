"""Derivatives of accelerations, steps and motions against complex steps of the dense systems."""

import threading

import numpy as np
import oracle
import pytest
from oracle import complex_slopes, dense_step
from test_links import BARE, cases

from npend_gym import Chain
from npend_gym.chain import ChainParameters
from npend_gym.physics import (
    DifferentiableEnsemble,
    Ensemble,
    jacobian,
    linearise,
    step_jacobian,
)

pytestmark = pytest.mark.long  # kernels of their own take long to compile


class Varied:
    """A chain whose parameters may be complex."""

    def __init__(self, **values):
        self.__dict__.update(values, n=len(values["masses"]))

    @classmethod
    def of(cls, chain):
        return cls(**{name: getattr(chain, name) for name in ChainParameters._fields})

    def changed(self, name, change):
        values = {each: getattr(self, each) for each in ChainParameters._fields}
        values[name] = values[name] + change
        if name == "lengths":  # centres at the ends stay there
            ends = self.centres == self.lengths
            values["centres"] = np.where(ends, values["lengths"], values["centres"])
        return Varied(**values)


def bobs(n, rng, **changes):
    return Chain(rng.uniform(0.3, 2.0, n), rng.uniform(0.3, 2.0, n), **changes)


def chains(kind, n, rng):
    if kind == "bobs":
        yield bobs(n, rng, damping=rng.uniform(0.1, 1.0, n))
        yield bobs(n, rng, drag=rng.uniform(0.1, 1.0, n), quadratic_drag=rng.uniform(0.1, 1.0, n))
    else:
        yield next(cases(n, 1, **(BARE if kind == "links" else {})))[0]


PARAMETERS = {
    "bobs": ("masses", "lengths", "gravity", "damping", "drag", "quadratic_drag"),
    "links": ("masses", "lengths", "gravity", "damping", "centres", "inertias"),
    "machine": ChainParameters._fields,
}


def states(n, rng, size=None):
    shape = n if size is None else (size, n)
    return rng.uniform(-3.0, 3.0, shape), rng.normal(size=shape) * 3.0, rng.normal(size=shape) * 5.0


@pytest.mark.parametrize("n", [1, 2, 5])
@pytest.mark.parametrize("kind", PARAMETERS)
def test_the_jacobian_is_that_of_the_dense_system_to_rounding(kind, n):
    rng = np.random.default_rng(n)
    for chain in chains(kind, n, rng):
        theta, omega, torque = states(n, rng)

        def rates(change, chain=chain, state=(theta, omega, torque)):
            varied = [x + d for x, d in zip(state, np.split(change, 3), strict=True)]
            return np.concatenate([varied[1], oracle.link_accelerations(Varied.of(chain), *varied)])

        expected = complex_slopes(rates, 3 * n)
        got = jacobian(chain, theta, omega, torque)
        assert np.abs(got - expected).max() <= 1e-12 * np.abs(expected).max()
        whole = linearise(chain, theta, omega, torque, joints=range(n))
        np.testing.assert_array_equal(np.hstack(whole), got)


@pytest.mark.parametrize("n", [1, 2, 5])
@pytest.mark.parametrize("kind", PARAMETERS)
def test_a_step_forward_and_backward_is_that_of_the_dense_system_to_rounding(kind, n):
    """By state, torque and every parameter; cut into substeps."""
    rng, dt, substeps = np.random.default_rng(n), 0.04, 3
    for chain in chains(kind, n, rng):
        state, weights = states(n, rng), rng.normal(size=2 * n)
        names = PARAMETERS[kind]

        def after(change, chain=chain, state=state):
            varied = [x + d for x, d in zip(state, np.split(change, 3), strict=True)]
            return dense_step(Varied.of(chain), *varied, dt, substeps)

        def after_parameter(change, name, chain=chain, state=state):
            change = change[0] if name == "gravity" else change
            return dense_step(Varied.of(chain).changed(name, change), *state, dt, substeps)

        ensemble = DifferentiableEnsemble(chain, 1, joints=range(n))
        ensemble.set_state(0, *state[:2])
        expected = complex_slopes(after, 3 * n)
        got = ensemble.step_jacobian(state[2][None], dt, substeps)
        forward = np.hstack([got.A[0], got.B[0]])
        assert np.abs(forward - expected).max() <= 1e-12 * np.abs(expected).max()

        gradient = ensemble.step_vjp(
            state[2][None],
            dt,
            substeps,
            theta_bar=weights[None, :n],
            omega_bar=weights[None, n:],
            parameters=names,
        )
        backward = np.hstack([gradient.by_theta, gradient.by_omega, gradient.by_torque])[0]
        assert np.abs(backward - weights @ expected).max() <= 1e-12 * np.abs(expected).max()
        for name in names:
            count = 1 if name == "gravity" else n
            expected = complex_slopes(lambda d, name=name: after_parameter(d, name), count)
            scale = max(np.abs(expected).max(), 1e-3)
            direction = {name: [1.0] if name == "gravity" else np.eye(n)}
            forward = ensemble.step_jacobian(state[2][None], dt, substeps, parameters=direction).C[
                0
            ]
            assert np.abs(forward - expected).max() <= 1e-12 * scale, name
            backward = gradient.by_parameters[name][0]
            assert np.abs(backward - weights @ expected).max() <= 1e-11 * scale, name


def test_the_state_after_a_differentiated_step_has_the_bits_of_the_step():
    """Lanes whose rods turn fast cut their substeps further, as in `advance`."""
    n, size, rng = 3, 40, np.random.default_rng(0)
    theta, omega, torque = states(n, rng, size)
    omega[::3] *= 20.0
    chain = bobs(n, rng, damping=0.1)
    plain = Ensemble(chain, size, joints=range(n))
    with_derivatives = DifferentiableEnsemble(chain, size, joints=range(n))
    for ensemble in (plain, with_derivatives):
        ensemble.set_state(slice(None), theta, omega)
    jacobian = with_derivatives.step_jacobian(torque, 0.05)
    bars = rng.normal(size=(2, size, n))
    gradient = with_derivatives.step_vjp(torque, 0.05, theta_bar=bars[0], omega_bar=bars[1])
    plain.advance(torque, 0.05)
    for reached in (jacobian, gradient):
        np.testing.assert_array_equal(reached.theta, plain.theta)
        np.testing.assert_array_equal(reached.omega, plain.omega)
    both = np.concatenate([jacobian.A, jacobian.B], axis=-1)
    expected = np.einsum("bi,bij->bj", np.concatenate([*bars], axis=1), both)
    got = np.hstack([gradient.by_theta, gradient.by_omega, gradient.by_torque])
    largest = np.abs(both).max(axis=(1, 2))[:, None]
    assert np.all(np.abs(got - expected) <= 1e-11 * largest)
    assert largest.max() > 10.0  # the lanes differ
    np.testing.assert_array_equal(with_derivatives.theta, theta)  # it stayed where it was


def test_a_chain_of_a_thousand_rods_has_the_gradient_that_differences_see():
    n, rng = 1000, np.random.default_rng(2)
    theta, omega, _ = states(n, rng)
    theta, omega = 0.3 * theta, 0.1 * omega
    chain = Chain.uniform(n, damping=0.1)
    ensemble = DifferentiableEnsemble(chain, 1)
    ensemble.set_state(0, theta, omega)
    bars, direction = rng.normal(size=(2, n)), rng.normal(size=(2, n))
    back = ensemble.step_vjp(0.5, 1e-3, 1, theta_bar=bars[:1], omega_bar=bars[1:])
    got = back.by_theta[0] @ direction[0] + back.by_omega[0] @ direction[1]

    def value(step):
        moved = Ensemble(chain, 1)
        moved.set_state(0, theta + step * direction[0], omega + step * direction[1])
        moved.advance(0.5, 1e-3, 1)
        return bars[0] @ moved.theta[0] + bars[1] @ moved.omega[0]

    assert got == pytest.approx((value(1e-6) - value(-1e-6)) / 2e-6, rel=1e-6)


def test_the_jacobian_of_a_step_takes_leading_axes_and_torques_on_other_joints():
    chain, rng = Chain.uniform(3), np.random.default_rng(3)
    theta, omega, torque = (x.reshape(2, 2, 3) for x in states(3, rng, 4))
    a, b = step_jacobian(chain, theta, omega, torque, dt=0.05, joints=(2, 0))
    assert a.shape == (2, 2, 6, 6)
    assert b.shape == (2, 2, 6, 2)
    alone = step_jacobian(chain, theta[1, 0], omega[1, 0], torque[1, 0], dt=0.05, joints=range(3))
    np.testing.assert_array_equal(a[1, 0], alone.A)
    np.testing.assert_array_equal(b[1, 0], alone.B[:, [2, 0]])


def test_no_call_leaves_traces_in_the_next():
    """Calls of other kinds and other numbers of substeps use the same work space."""
    ensemble, rng = DifferentiableEnsemble(Chain.uniform(3), 4), np.random.default_rng(4)
    ensemble.set_state(slice(None), *states(3, rng, 4)[:2])

    def results(substeps):
        gradient = ensemble.step_vjp(1.0, 0.1, substeps, theta_bar=1.0, omega_bar=2.0)
        return *gradient[:5], *ensemble.step_jacobian(1.0, 0.1, substeps)

    once = {substeps: results(substeps) for substeps in (1, 7, 2)}
    for substeps in (7, 1, 2, 7):
        for first, again in zip(once[substeps], results(substeps), strict=True):
            np.testing.assert_array_equal(first, again)


def test_threads_that_an_interrupt_leaves_at_work_spoil_no_later_derivative(monkeypatch):
    ensemble = DifferentiableEnsemble(Chain.uniform(2), 64, threads=3)
    expected, begun, theirs = ensemble.step_jacobian(0.3, 0.02, 20).A, threading.Event(), []

    def interrupted(*arguments):
        if threading.current_thread() is threading.main_thread():
            assert begun.wait(60.0)
            raise KeyboardInterrupt
        theirs.extend(arguments[-2:])  # timing and work space
        begun.set()

    with monkeypatch.context() as patch:
        patch.setattr("npend_gym.physics.step.step_tangents", interrupted)
        with pytest.raises(KeyboardInterrupt):
            ensemble.step_jacobian(2.5, 0.02, 20)
    with monkeypatch.context() as patch:
        ours = []
        patch.setattr(
            "npend_gym.physics.step.step_tangents", lambda *given: ours.extend(given[-2:])
        )
        ensemble.step_jacobian(0.3, 0.02, 20)
    np.testing.assert_array_equal(ensemble.step_jacobian(0.3, 0.02, 20).A, expected)
    assert not any(np.shares_memory(a, b) for a in theirs for b in ours)


def test_what_has_no_derivative_is_refused_by_name():
    ensemble = DifferentiableEnsemble(Chain.uniform(2), 2)
    ensemble.set_state(slice(None), 1.0)
    with pytest.raises(ValueError, match="inertias cannot be differentiated for this kind"):
        ensemble.step_vjp(0.0, 0.05, theta_bar=1.0, omega_bar=0.0, parameters=["inertias"])
    with pytest.raises(ValueError, match="parameter must be"):
        ensemble.step_vjp(0.0, 0.05, theta_bar=1.0, omega_bar=0.0, parameters=["mass"])
    with pytest.raises(ValueError, match=r"masses must have the shape \(1, 2\), got"):
        ensemble.step_jacobian(0.0, 0.05, parameters={"masses": [[1.0, 2.0, 3.0]]})
    with pytest.raises(TypeError, match=r"parameters must be a dict .* got \['masses'\]"):
        ensemble.step_jacobian(0.0, 0.05, parameters=["masses"])
    with pytest.raises(ValueError, match="theta_bar must"):
        ensemble.step_vjp(0.0, 0.05, theta_bar=np.zeros(3), omega_bar=0.0)
    ensemble.set_state(slice(None), 1.0)
    with pytest.raises(FloatingPointError, match=r"members \[1\] leave all bounds"):
        ensemble.step_jacobian([[0.0], [1e12]], 0.1, 1)
