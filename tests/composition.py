"""Every ability of the physics with every kind of mechanism: what works, and what is refused.

`python tests/composition.py` runs all cells and writes the table of docs/reference/composition.md.
"""

# ruff: noqa: ARG001, ARG005  functions of users have the arguments that they are called with
from __future__ import annotations

import copy
import io
import pickle
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from matrices import Matrix

from npend_gym import (
    Cart,
    Chain,
    Event,
    Signal,
    Trajectory,
    chaos,
    physics,
    pseudo_periods,
    simulate,
)

TIMES = np.linspace(0.0, 0.6, 7)
RK4 = {"method": "rk4", "dt": 0.002}
THETA, OMEGA = [0.7, 0.4], [0.2, -0.1]
STARTS = np.array([THETA, [0.3, 0.9], [-0.5, 0.2]])


def shaken(t):
    """Acceleration of a pivot that is shaken up and down."""
    return 0.3 * np.sin(3.0 * t), 2.0 * np.cos(20.0 * t)


def push(t, theta, omega):
    """A torque that depends on time alone."""
    return 0.3 * np.sin(3.0 * t)


rising = lambda t, theta, omega: 0.1 * t  # noqa: E731 - pickle does not find it by its name


def passing(t, theta, omega):
    """An event: the first rod hangs straight down."""
    return theta[0]


@dataclass(frozen=True)
class Mechanism:
    """A chain, and what drives it beside torques."""

    chain: Chain
    drives: dict[str, Any] = field(default_factory=dict)

    @property
    def constant(self) -> dict[str, Any]:
        """The drives at the instant 0, for functions of a state."""
        drives = dict(self.drives)
        if callable(drives.get("pivot_acceleration")):
            drives["pivot_acceleration"] = drives["pivot_acceleration"](0.0)
        return drives

    def run(self, theta: Any = THETA, **more: Any) -> Trajectory:
        """Return a motion."""
        omega = OMEGA if np.ndim(theta) == 1 else 0.0
        return simulate(self.chain, theta, omega, TIMES, **{**self.drives, **more})


_TWO = {"masses": [1.0, 0.6], "lengths": [0.8, 0.5]}
_LINKS = {"centres": [0.4, 0.3], "inertias": [0.05, 0.02]}
_SPRINGS = {"stiffness": [300.0, 200.0], "axial_damping": 0.5}
COLUMNS = {
    "ideal": Mechanism(Chain.uniform(2)),
    "uneven": Mechanism(Chain(**_TWO)),
    "damped, drag": Mechanism(Chain(**_TWO, damping=0.1, drag=0.05, quadratic_drag=0.02)),
    "links": Mechanism(Chain(**_TWO, **_LINKS)),
    "friction, rotors": Mechanism(Chain(**_TWO, **_LINKS, friction=0.02, armature=0.01, gear=6.0)),
    "springs": Mechanism(Chain(**_TWO, **_SPRINGS)),
    "springs, cart": Mechanism(Chain(**_TWO, **_SPRINGS, base=Cart(1.5))),
    "links, springs": Mechanism(Chain(**_TWO, **_LINKS, **_SPRINGS)),
    "friction, rotors, springs, cart": Mechanism(
        Chain(
            **_TWO,
            **_LINKS,
            **_SPRINGS,
            friction=0.02,
            armature=0.01,
            gear=6.0,
            drag=0.05,
            base=Cart(1.5, 0.2),
        )
    ),
    "cart": Mechanism(Chain(**_TWO, base=Cart(1.5))),
    "cart, rail damping, force": Mechanism(Chain(**_TWO, base=Cart(1.5, 0.2)), {"force": 0.5}),
    "links, cart": Mechanism(Chain(**_TWO, **_LINKS, base=Cart(1.5))),
    "pivot accelerated": Mechanism(Chain(**_TWO), {"pivot_acceleration": (0.5, -1.0)}),
    "pivot shaken": Mechanism(Chain(**_TWO), {"pivot_acceleration": shaken}),
}
SIGNAL = Signal([0.0, 0.25, 1.0], [0.2, -0.3, 0.1], "linear")


def _signal_of(mechanism: Mechanism) -> dict[str, Any]:
    """Return a torque by samples; all drives that change must be samples then."""
    more: dict[str, Any] = {"torque": SIGNAL}
    if callable(mechanism.drives.get("pivot_acceleration")):
        times = np.linspace(0.0, 1.0, 11)
        rows = np.array([shaken(t) for t in times])
        more["pivot_acceleration"] = Signal(times, rows, "linear")
    return more


def _near(found: Any, expected: Any, tolerance: float = 1e-6) -> None:
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=tolerance)


def _same(found: Any, expected: Any) -> None:
    np.testing.assert_array_equal(found, expected)


# -- abilities: each raises where the mechanism lacks it, or an assertion fails -----------------


def _one(m: Mechanism) -> None:
    _near(m.run().theta, m.run(rtol=1e-12, atol=1e-14).theta)


def _one_rk4(m: Mechanism) -> None:
    found, expected = m.run(**RK4), m.run()
    _near(found.theta, expected.theta)
    _near(found.omega, expected.omega, 1e-5)


def _many(m: Mechanism, **more: Any) -> None:
    many = m.run(STARTS, **more)
    alone = simulate(m.chain, STARTS[1], 0.0, TIMES, **{**m.drives, **more})
    _same(many.theta[1], alone.theta)
    _same(many[1].energy(), alone.energy())


def _threads(m: Mechanism) -> None:
    for more in ({}, RK4, {"torque": push}):
        _same(m.run(STARTS, threads=2, **more).theta, m.run(STARTS, **more).theta)


def _torque_array(m: Mechanism) -> None:
    _same(m.run(torque=[0.3, 0.0]).theta, m.run(torque=0.3).theta)


def _torque_each(m: Mechanism) -> None:
    torque = np.array([[0.3, 0.1], [0.0, 0.0], [-0.2, 0.4]])
    alone = simulate(m.chain, STARTS[2], 0.0, TIMES, torque=torque[2], **m.drives)
    _same(m.run(STARTS, torque=torque).theta[2], alone.theta)


def _function(m: Mechanism, **more: Any) -> None:
    fine = np.linspace(0.0, 1.0, 2001)
    samples = Signal(fine, 0.3 * np.sin(3.0 * fine), "linear")
    found = m.run(torque=push, **more)
    if not callable(m.drives.get("pivot_acceleration")):  # all signals, or all functions
        _near(found.theta, m.run(torque=samples, **more).theta, 1e-5)
    assert np.abs(found.theta - m.run(**more).theta).max() > 1e-4


def _signal(m: Mechanism) -> None:
    given = _signal_of(m)
    _near(m.run(**given).theta, m.run(**given, **RK4).theta)


def _events(m: Mechanism, theta: Any = THETA, **more: Any) -> None:
    quantities = [Event("angle", 0), Event("velocity"), passing]
    motion = m.run(theta, events=quantities, **more)
    one = motion if motion.theta.ndim == 2 else motion[0]
    assert len(one.t_events[0]) == len(one.t_events[2])
    _near(one.t_events[0], one.t_events[2], 1e-9)


def _at(m: Mechanism, **more: Any) -> None:
    motion = m.run(**more)
    theta, omega = motion.at(TIMES)
    _near(theta, motion.theta, 1e-12)
    _near(omega, motion.omega, 1e-12)
    fine = simulate(
        m.chain, THETA, OMEGA, [0.0, 0.317], **{**m.drives, **more, "rtol": 1e-12, "atol": 1e-14}
    )
    _near(motion.at(0.317)[0], fine.theta[-1], 1e-5)


def _at_many(m: Mechanism) -> None:
    many = m.run(STARTS)
    _near(many.at(TIMES)[0], many.theta, 1e-12)


def _at_of_one(m: Mechanism) -> None:
    for more in ({}, RK4):
        many = m.run(STARTS, **more)
        _near(many[1].at(0.3)[0], many.at(0.3)[0][1], 0.0)


def _at_after_events(m: Mechanism) -> None:
    event = Event("angle", 0, terminal=True)
    one, many = m.run(events=event), m.run(STARTS, events=event)
    for motion in (one, many[0], many[2]):
        _near(motion.at(motion.times)[0], motion.theta, 1e-9)


def _differences(m: Mechanism, **more: Any) -> tuple[np.ndarray, dict[str, Any]]:
    """Return the change of theta at the end by the first angle, by central differences."""
    tight = {**m.drives, **more}
    tight |= {} if "dt" in tight else {"rtol": 1e-12, "atol": 1e-14}
    start = m.run(**more)
    own: dict[str, Any] = {}
    if start.stretch is not None and start.stretch_rate is not None:
        own = {"stretch": start.stretch[0], "stretch_rate": start.stretch_rate[0]}
    h = 1e-4
    ends = [
        simulate(m.chain, [THETA[0] + step, THETA[1]], OMEGA, TIMES, **tight, **own).theta[-1]
        for step in (h, -h)
    ]
    return (ends[0] - ends[1]) / (2.0 * h), tight | own


def _sensitivities(m: Mechanism, **more: Any) -> None:
    expected, given = _differences(m, **more)
    found = simulate(m.chain, THETA, OMEGA, TIMES, **given).sensitivities()
    _near(found.A[-1, :2, 0], expected, 1e-6)


def _gradient(m: Mechanism, **more: Any) -> None:
    motion = m.run(**more)
    weights = np.random.default_rng(0).normal(size=motion.theta.shape)
    found = motion.gradient(weights, 0.0)
    whole = motion.sensitivities()
    _near(found.by_theta[:2], np.tensordot(weights, whole.A[:, :2, :2], 2), 1e-9)


def _derivatives_of_one_of_many(m: Mechanism) -> None:
    many = m.run(STARTS)
    alone = simulate(m.chain, STARTS[1], 0.0, TIMES, **m.drives)
    _same(many[1].sensitivities().A, alone.sensitivities().A)
    _same(many[1].gradient(1.0, 0.0).by_theta, alone.gradient(1.0, 0.0).by_theta)


def _energy(m: Mechanism) -> None:
    motion = m.run(rtol=1e-12, atol=1e-14)
    lost = motion.energy()[0] - motion.energy()
    if m.drives:
        return
    if _loses(m.chain):
        assert lost[-1] > 0.0
    else:
        _near(lost, 0.0, 1e-8)


def _loses(chain: Chain) -> bool:
    """Return whether something takes energy."""
    parts = (chain.damping, chain.friction, chain.drag, chain.axial_damping)
    rail = chain.base is not None and chain.base.damping > 0.0
    return any(np.any(part) for part in parts) or rail


def _positions(m: Mechanism) -> None:
    motion = m.run()
    spans = np.diff(motion.positions(), axis=1, prepend=0.0)
    _near(np.linalg.norm(spans, axis=2), motion.lengths(), 1e-12)
    fine = np.linspace(0.0, 0.01, 3)
    near = simulate(m.chain, THETA, OMEGA, fine, **m.drives)
    rate = (near.positions()[2] - near.positions()[0]) / 0.01
    _near(near.velocities()[1], rate, 1e-3)


def _files(m: Mechanism) -> None:
    motion = m.run(torque=push)
    with tempfile.TemporaryDirectory() as folder:
        motion.save(Path(folder) / "a.npz")
        again = Trajectory.load(Path(folder) / "a.npz")
        still = m.run()
        still.save(Path(folder) / "b.npz")
        read = Trajectory.load(Path(folder) / "b.npz")
    _same(again.theta, motion.theta)
    _same(again.energy(), motion.energy())
    assert again.chain == motion.chain
    if not callable(m.drives.get("pivot_acceleration")):
        _same(read.at(0.3)[0], still.at(0.3)[0])


def _csv(m: Mechanism) -> None:
    motion = m.run()
    with tempfile.TemporaryDirectory() as folder:
        motion.to_csv(Path(folder) / "a.csv")
        text = (Path(folder) / "a.csv").read_text(encoding="utf-8")
    table = np.loadtxt(io.StringIO(text), delimiter=",", skiprows=1)
    _same(table[:, 1:3], motion.theta)


def _pickle(m: Mechanism) -> None:
    motion = m.run(torque=rising)
    again = pickle.loads(pickle.dumps(motion))
    _same(again.theta, motion.theta)
    named = m.run(torque=push)
    _same(pickle.loads(pickle.dumps(named)).at(0.3)[0], named.at(0.3)[0])


def _copied(m: Mechanism) -> None:
    motion = m.run(torque=rising)
    _same(copy.deepcopy(motion).at(0.3)[0], motion.at(0.3)[0])


def _plot(m: Mechanism) -> None:
    import matplotlib as mpl

    mpl.use("Agg")
    assert m.run().plot() is not None


def _notebook(m: Mechanism) -> None:
    assert "&quot;places&quot;" in m.run()._repr_html_()  # of a player's data


def _shaken_keywords(m: Mechanism) -> dict[str, Any]:
    return {k: v for k, v in m.drives.items() if k == "pivot_acceleration"}


def _largest(m: Mechanism, **more: Any) -> None:
    found = chaos.largest_lyapunov(m.chain, [2.0, 2.0], duration=60.0, **m.drives, **more)
    assert np.isfinite(found.exponent)


def _spectrum(m: Mechanism, **more: Any) -> None:
    found = chaos.lyapunov_spectrum(m.chain, [2.0, 2.0], duration=5.0, **(m.drives | more))
    if not _loses(m.chain):
        _near(found.exponents.sum(), 0.0, 1e-8)
        _near(found.exponents, -found.exponents[::-1], 1e-6)
    else:
        assert found.exponents.sum() < 0.0


def _spectrum_by_signal(m: Mechanism) -> None:
    times = np.linspace(0.0, 5.0, 21)
    more: dict[str, Any] = {"torque": Signal(times, np.sin(times), "linear")}
    if callable(m.drives.get("pivot_acceleration")):
        more["pivot_acceleration"] = Signal(times, np.array([shaken(t) for t in times]), "linear")
    _spectrum(m, **more)


def _megno(m: Mechanism, **more: Any) -> None:
    found = chaos.megno(m.chain, [0.2, 0.2], duration=60.0, **m.drives, **more)
    assert np.isfinite(found.value)


def _section(m: Mechanism, **more: Any) -> None:
    found = chaos.poincare_section(m.chain, THETA, duration=8.0, **m.drives, **more)
    _near(np.sin(found.theta[:, 0]), 0.0, 1e-8)


def _stroboscopic_section(m: Mechanism) -> None:
    drives = m.drives | {"torque": push}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the pivot is shaken with other periods
        found = chaos.stroboscopic_section(
            m.chain, THETA, period=2.0 * np.pi / 3.0, count=2, **drives
        )
    own = {"rtol": 1e-12, "atol": 1e-14}
    motion = simulate(m.chain, THETA, 0.0, np.append(0.0, found.times), **drives, **own)
    _near(found.omega, motion.omega[1:], 1e-6)


def _orbits(m: Mechanism) -> None:
    if m.drives:
        raise ValueError("periodic_orbits is defined for a chain that nothing drives")
    energy = 0.05 * m.chain.lifting_energy
    assert len(chaos.periodic_orbits(m.chain, 0, energies=[energy])) > 0


def _flips(m: Mechanism) -> None:
    found = chaos.flip_times(m.chain, [[0.1, 0.1], [3.0, 3.0]], duration=4.0, **_shaken_keywords(m))
    event = Event("flip", terminal=True)
    motion = simulate(m.chain, [3.0, 3.0], 0.0, [0.0, 4.0], events=[Event("flip", 0), event],
                      **_shaken_keywords(m))  # fmt: skip
    first = min([4.0, *motion.t_events[0], *motion.t_events[1]])
    if np.isfinite(found[1]):
        _near(found[1], first, 1e-6)


def _state(m: Mechanism) -> dict[str, Any]:
    own = m.constant
    if m.chain.stiffness is not None:
        own |= {"stretch": [0.02, 0.01], "stretch_rate": [0.1, -0.1]}
    return own


def _accelerations(m: Mechanism) -> None:
    h, own = 1e-4, _state(m)
    found = physics.accelerations(m.chain, THETA, OMEGA, **own)
    near = simulate(m.chain, THETA, OMEGA, [0.0, h], **own, rtol=1e-13, atol=1e-15)
    _near(found[:2], (near.omega[1] - near.omega[0]) / h, 0.05)


def _linearise(m: Mechanism) -> None:
    own, h = _state(m), 1e-6
    found = physics.linearise(m.chain, THETA, OMEGA, **own)
    ends = [
        physics.accelerations(m.chain, [THETA[0] + step, THETA[1]], OMEGA, **own)
        for step in (h, -h)
    ]
    half = found.A.shape[0] // 2
    _near(found.A[half:, 0], (ends[0] - ends[1]) / (2.0 * h), 1e-5)


def _jacobian(m: Mechanism) -> None:
    own = _state(m)
    whole, part = (f(m.chain, THETA, OMEGA, **own) for f in (physics.jacobian, physics.linearise))
    _same(whole[:, : part.A.shape[1]], part.A)


def _mass_matrix(m: Mechanism) -> None:
    matrix = physics.mass_matrix(m.chain, THETA)
    _near(matrix, matrix.T, 1e-12)
    assert np.linalg.eigvalsh(matrix).min() > 0.0


def _tensions(m: Mechanism) -> None:
    found = physics.tensions(m.chain, THETA, OMEGA, **_state(m))
    assert np.all(np.isfinite(found))
    hanging = {k: v for k, v in m.constant.items() if k == "pivot_acceleration"}
    weight = m.chain.gravity + (hanging["pivot_acceleration"][1] if hanging else 0.0)
    if m.chain.stiffness is None and not (hanging and hanging["pivot_acceleration"][0]):
        at_rest = physics.tensions(m.chain, 0.0, 0.0, **hanging)
        _near(at_rest, weight * m.chain.carried_masses, 1e-9)


def _no_shaking(m: Mechanism, what: str) -> None:
    if "pivot_acceleration" in m.drives:
        raise ValueError(f"{what} has no pivot_acceleration")


def _step_jacobian(m: Mechanism) -> None:
    _no_shaking(m, "step_jacobian")
    given = {"torque": [0.3, -0.2]} | m.drives
    given |= {"velocity": 0.4} if m.chain.base is not None else {}
    found = physics.step_jacobian(
        m.chain, STARTS, OMEGA, dt=0.01, substeps=5, joints=(0, 1), **given
    )
    alone = simulate(m.chain, STARTS[1], OMEGA, [0.0, 0.01], method="rk4", dt=0.002, **given)
    expected = alone.sensitivities(joints=(0, 1))
    _near(found.A[1], expected.A[-1], 1e-12)
    _near(found.B[1], expected.B[-1], 1e-12)


def _ensemble(m: Mechanism) -> None:
    _no_shaking(m, "Ensemble")
    many = physics.Ensemble(m.chain, 3)
    many.set_state(slice(None), STARTS)
    many.advance(0.0, 0.01, 5)
    alone = simulate(m.chain, STARTS[1], 0.0, [0.0, 0.01], method="rk4", dt=0.002)
    _near(many.theta[1], alone.theta[-1], 1e-14)


def _differentiable(m: Mechanism) -> None:
    _no_shaking(m, "DifferentiableEnsemble")
    many = physics.DifferentiableEnsemble(m.chain, 3, joints=(0, 1))
    many.set_state(slice(None), STARTS, OMEGA)
    jacobian = many.step_jacobian(STARTS, 0.01, 5, **m.drives)
    bars = np.random.default_rng(0).normal(size=(2, 3, m.chain.coordinates))
    gradient = many.step_vjp(STARTS, 0.01, 5, theta_bar=bars[0], omega_bar=bars[1], **m.drives)
    found = np.hstack([gradient.by_theta, gradient.by_omega, gradient.by_torque])
    whole = np.concatenate([jacobian.A, jacobian.B], axis=-1)
    _near(found, np.einsum("bi,bij->bj", np.hstack([*bars]), whole), 1e-10)


def _torch_step(m: Mechanism) -> None:
    import torch

    from npend_gym.torch import step

    _no_shaking(m, "torch.step")
    q = torch.zeros(m.chain.coordinates, dtype=torch.float64)
    q[:2] = torch.tensor(THETA, dtype=torch.float64)
    q.requires_grad_()
    u = torch.zeros_like(q)
    after, _ = step(m.chain, q, u, dt=0.01, substeps=5)
    after[0].backward()
    motion = simulate(m.chain, THETA, 0.0, [0.0, 0.01], method="rk4", dt=0.002)
    _near(q.grad[:2], motion.sensitivities().A[-1, 0, :2], 1e-12)


def _periods(m: Mechanism) -> None:
    own = _shaken_keywords(m)
    found = pseudo_periods(m.chain, [0.2, 0.2], definition="link", **own)
    motion = simulate(
        m.chain, [0.2, 0.2], 0.0, [0.0, 6.0], events=Event("angular_velocity", 1, direction=-1),
        **own,
    )  # fmt: skip
    if np.isfinite(found[1]):
        assert np.abs(motion.t_events[0] - found[1]).min() < 1e-6


ROWS: dict[str, Callable[[Mechanism], None]] = {
    "simulate, dop853": _one,
    "simulate, rk4": _one_rk4,
    "many motions, dop853": _many,
    "many motions, rk4": lambda m: _many(m, **RK4),
    "threads": _threads,
    "torque as an array (n,)": _torque_array,
    "torque as an array (B, n)": _torque_each,
    "torque as a function, dop853": _function,
    "torque as a function, rk4": lambda m: _function(m, **RK4),
    "torque as a function, many motions": lambda m: _many(m, torque=push),
    "torque as a Signal": _signal,
    "events of one motion": _events,
    "events of many motions": lambda m: _events(m, STARTS),
    "events by rk4": lambda m: _events(m, **RK4),
    "at, dop853": _at,
    "at, rk4": lambda m: _at(m, **RK4),
    "at of many motions": _at_many,
    "m[k].at": _at_of_one,
    "at after events": _at_after_events,
    "sensitivities, dop853": _sensitivities,
    "sensitivities, rk4": lambda m: _sensitivities(m, **RK4),
    "sensitivities, torque as a function of time": lambda m: _sensitivities(m, torque=push),
    "sensitivities, torque as a Signal": lambda m: _sensitivities(m, **_signal_of(m)),
    "gradient, dop853": _gradient,
    "gradient, rk4": lambda m: _gradient(m, **RK4),
    "gradient, torque as a function of time": lambda m: _gradient(m, torque=push),
    "m[k].sensitivities, m[k].gradient": _derivatives_of_one_of_many,
    "energy": _energy,
    "positions, velocities, lengths": _positions,
    "save and load": _files,
    "to_csv": _csv,
    "pickle": _pickle,
    "deepcopy": _copied,
    "plot": _plot,
    "in a notebook": _notebook,
    "chaos.largest_lyapunov": _largest,
    "chaos.lyapunov_spectrum": _spectrum,
    "chaos.megno": _megno,
    "chaos.largest_lyapunov, torque as a function of time": lambda m: _largest(m, torque=push),
    "chaos.lyapunov_spectrum, torque as a function of time": lambda m: _spectrum(m, torque=push),
    "chaos.lyapunov_spectrum, torque as a Signal": _spectrum_by_signal,
    "chaos.megno, torque as a function of time": lambda m: _megno(m, torque=push),
    "chaos.poincare_section": _section,
    "chaos.poincare_section, torque as a function": lambda m: _section(m, torque=push),
    "chaos.stroboscopic_section": _stroboscopic_section,
    "chaos.periodic_orbits": _orbits,
    "chaos.flip_times": _flips,
    "accelerations": _accelerations,
    "linearise": _linearise,
    "jacobian": _jacobian,
    "mass_matrix": _mass_matrix,
    "tensions": _tensions,
    "step_jacobian": _step_jacobian,
    "Ensemble": _ensemble,
    "DifferentiableEnsemble": _differentiable,
    "torch.step": _torch_step,
    "pseudo_periods": _periods,
}

# Why a cell is refused, by what the error says
_NO_ORBITS = "A released chain comes back only where nothing takes energy, drives it or carries it."
_EQUAL_STEPS = "Equal steps do not resolve the vibrations of springs."
_RESTING = "Ensembles have a pivot at rest or a cart."
_PACKS = "A function of time needs motions one by one."
REASONS = {
    _NO_ORBITS: ("no damping", "periodic_orbits is defined"),
    _EQUAL_STEPS: ("rigid rods",),
    _RESTING: ("has no pivot_acceleration",),
    _PACKS: ("pivot_acceleration must",),
}


MATRIX = Matrix(
    "composition.md",
    "What works with what",
    "Every ability of the physics was run with every kind of mechanism. "
    "{works} of {cells} combinations work. In the table a number says why one raises an error. "
    "`python tests/composition.py` runs all of them and writes this page.",
    ROWS,
    COLUMNS,
    REASONS,
)

if __name__ == "__main__":
    MATRIX.write()
