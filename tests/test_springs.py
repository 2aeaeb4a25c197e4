"""Rods that stretch: bobs on springs, against forces in Cartesian coordinates and closed forms."""

from itertools import product

import numpy as np
import pytest
from conftest import chains_in_motion
from hypothesis import given, settings
from scipy.integrate import solve_ivp
from scipy.linalg import eigh

from npend_gym import Cart, Chain, Signal, pseudo_periods, simulate
from npend_gym.physics import tensions

pytestmark = pytest.mark.long  # kernels of their own take long to compile

SOFT = np.array([300.0, 500.0, 200.0, 400.0])  # N/m, for the chain `uneven`


def on_springs(chain, stiffness=SOFT, **parts):
    """Return the same chain with rods that stretch."""
    return Chain.from_dict(chain.as_dict() | {"stiffness": stiffness} | parts)


def pulled(chain, torque, place, speed):
    """Return the accelerations of the bobs, (n, 2), and the force on the pivot; no angle is used.

    `place` and `speed` are those of the pivot, then of the bobs, (n + 1, 2).
    """
    below, moving = np.diff(place, axis=0), np.diff(speed, axis=0)
    length = np.linalg.norm(below, axis=1, keepdims=True)
    along = below / length
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    rate = (moving * along).sum(axis=1)
    omega = (moving * across).sum(axis=1) / length[:, 0]
    couple = torque - chain.damping * np.diff(omega, prepend=0.0)
    on_rod = couple - np.append(couple[1:], 0.0)
    tension = chain.stiffness * (length[:, 0] - chain.lengths) + chain.axial_damping * rate
    on_lower = -tension[:, None] * along + (on_rod[:, None] / length) * across
    force = on_lower - np.append(on_lower[1:], [[0.0, 0.0]], axis=0)
    size = np.linalg.norm(speed[1:], axis=1)
    force -= (chain.drag + chain.quadratic_drag * size)[:, None] * speed[1:]
    return force / chain.masses[:, None] - [0.0, chain.gravity], -on_lower[0]


def cartesian(path, torque=0.0, force=0.0, pivot_acceleration=(0.0, 0.0)):
    """SciPy's solution in Cartesian coordinates from the same start, under the same drives.

    Positions of the pivot and of the bobs in the frame of the rail, (T, n + 1, 2).
    """
    chain = path.chain
    shape = (2, chain.n + 1, 2)

    def rates(_t, y):
        place, speed = y.reshape(shape)
        bobs, on_pivot = pulled(chain, torque, place, speed)
        pivot = pivot_acceleration
        if chain.base is not None:
            on_cart = force + on_pivot[0] - chain.base.damping * speed[0, 0]
            pivot = (on_cart / chain.base.mass, 0.0)
        return np.stack([speed, np.vstack([pivot, bobs])]).ravel()

    start = np.stack([in_frame_of_rail(path)[0], in_frame_of_rail(path, rates=True)[0]]).ravel()
    times = path.times
    solution = solve_ivp(rates, times[[0, -1]], start, "DOP853", times, rtol=1e-12, atol=1e-12)
    return solution.y.T.reshape(-1, *shape)[:, 0]


def in_frame_of_rail(path, *, rates=False):
    """Return the positions of the pivot and of the bobs, or their velocities, (T, n + 1, 2)."""
    given = path.velocity if rates else path.position
    pivot = np.zeros((path.times.size, 2))
    if given is not None:
        pivot[:, 0 : given.ndim] = given.reshape(path.times.size, -1)
    bobs = path.velocities() if rates else path.positions()
    return np.concatenate([np.zeros_like(bobs[:, :1]), bobs], axis=1) + pivot[:, None]


@settings(max_examples=15)
@given(chains_in_motion(max_n=6))
def test_bobs_go_where_springs_gravity_torques_and_drag_pull_them(motion):
    chain, theta, omega, torque = motion
    n, rng = chain.n, np.random.default_rng(chain.n)
    drag = dict(zip(("drag", "quadratic_drag"), rng.uniform(0.0, 1.0, (2, n)), strict=True))
    stiffness, axial = rng.uniform(50.0, 2000.0, n), rng.uniform(0.0, 3.0, n)
    chain = on_springs(chain, stiffness, axial_damping=axial, **drag)
    path = simulate(
        chain, theta, omega, np.linspace(0.0, 0.1, 3), torque=torque, rtol=1e-12, atol=1e-14,
        stretch=chain.lengths * rng.uniform(-0.3, 0.5, n), stretch_rate=rng.normal(size=n),
    )  # fmt: skip
    found, expected = in_frame_of_rail(path), cartesian(path, torque)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)


TIGHT = {"rtol": 1e-12, "atol": 1e-13}
IN_AIR = {"axial_damping": [1.0, 0.0, 2.0, 0.5], "damping": 0.1, "drag": 0.1, "quadratic_drag": 0.2}
PUSHED = (
    IN_AIR | {"base": Cart(1.5, 0.4)},
    {"theta": [0.8, -0.3, 1.0, 2.0], "omega": 0.1, "position": 0.5, "velocity": -0.7},
    {"torque": np.array([2.0, 0.0, -1.0, 0.5]), "force": 3.0},
)
MOTIONS = {  # parts of the chain, start, drives, options
    "pivot": ({}, {"theta": 0.9, "omega": 0.3}, {}, TIGHT),
    "cart": (*PUSHED, TIGHT),
    "cart, rk4": (*PUSHED, {"method": "rk4", "dt": 1e-3}),
    "accelerated pivot": (
        {"drag": 0.3},
        {"theta": 0.8, "omega": 0.1, "velocity": (0.3, 0.5)},
        {"pivot_acceleration": (2.0, -1.5)},
        TIGHT,
    ),
}


@pytest.mark.parametrize("kind", MOTIONS)
def test_long_motions_on_soft_springs_follow_scipy(uneven, kind):
    parts, start, drives, options = MOTIONS[kind]
    times = np.linspace(0.0, 3.0 if kind == "pivot" else 2.0, 31)
    path = simulate(on_springs(uneven, **parts), times=times, **start, **drives, **options)
    expected = cartesian(path, **drives)
    np.testing.assert_allclose(in_frame_of_rail(path), expected, rtol=0, atol=1e-7)
    assert np.ptp(path.stretch, axis=0).min() > 0.01
    assert path.position is None or np.ptp(path.position) > 0.1
    np.testing.assert_array_equal(path.centres(), path.positions())


def test_energy_of_springs_on_a_cart_is_kept(uneven):
    chain = on_springs(uneven, base=Cart(1.5))
    path = simulate(chain, [0.8, -0.3, 1.0, 2.0], 0.5, np.linspace(0.0, 5.0, 51), velocity=0.4)
    assert np.abs(path.energy() / path.energy()[0] - 1.0).max() < 1e-8
    speeds = in_frame_of_rail(path, rates=True)
    masses = np.append(1.5, uneven.masses)
    momentum = speeds[..., 0] @ masses  # nothing pushes the cart
    np.testing.assert_allclose(momentum, momentum[0], rtol=0, atol=1e-8)


def test_one_mass_on_a_damped_spring_bounces_as_its_closed_form_says():
    m, k, d, start = 0.7, 90.0, 1.3, 0.05
    chain, times = Chain([m], [0.8], stiffness=k, axial_damping=d), np.linspace(0.0, 4.0, 41)
    path = simulate(chain, 0.0, 0.0, times, stretch=start + m * 9.81 / k)
    decay = d / (2.0 * m)
    w = np.sqrt(k / m - decay**2)
    expected = start * np.exp(-decay * times) * (np.cos(w * times) + decay / w * np.sin(w * times))
    np.testing.assert_allclose(path.stretch[:, 0] - m * 9.81 / k, expected, rtol=0, atol=1e-10)
    np.testing.assert_array_equal(path.theta, 0.0)


def test_a_mass_whirled_without_gravity_keeps_the_length_at_which_its_spring_holds_it():
    m, l, k, omega = 2.0, 0.5, 300.0, 4.0
    chain, times = Chain([m], [l], 0.0, stiffness=k), np.linspace(0.0, 5.0, 6)
    path = simulate(chain, 0.1, omega, times, stretch=0.0)
    # angular momentum and energy of the start hold at the turning point of the length too
    apart = l * m * omega**2 / (k - m * omega**2)
    held = simulate(chain, 0.1, omega, times, stretch=apart)
    np.testing.assert_allclose(held.lengths()[:, 0], l + apart, rtol=1e-10)
    np.testing.assert_allclose(held.omega, omega, rtol=1e-10)
    np.testing.assert_allclose(path.lengths() ** 2 * path.omega, l**2 * omega, rtol=1e-9)
    assert np.ptp(path.lengths()) > 0.01


def test_a_hanging_chain_rings_along_its_rods_in_the_modes_of_its_springs(uneven):
    # theta = 0 stays so, and the motion along the line is linear: m x'' = -K x, x = sum of r
    apart = np.eye(4) - np.eye(4, k=-1)
    squares, shapes = eigh(apart.T @ np.diag(SOFT) @ apart, np.diag(uneven.masses))
    at_rest = 9.81 * uneven.carried_masses / SOFT
    for square, shape in zip(squares, shapes.T, strict=True):
        moved = 0.01 * apart @ shape
        times = np.linspace(0.0, 4.0 * np.pi / np.sqrt(square), 17)
        path = simulate(on_springs(uneven), 0.0, 0.0, times, stretch=at_rest + moved)
        expected = np.cos(np.sqrt(square) * times)[:, None] * moved
        np.testing.assert_allclose(path.stretch - at_rest, expected, rtol=0, atol=1e-10)


def test_a_small_swing_has_the_period_of_the_stretched_length():
    # e = m g / k = 0.2 is far from a resonance of swing and spring (0.333)
    m, l, k = 1.0, 1.0, 9.81 / 0.2
    period = pseudo_periods(Chain([m], [l], stiffness=k), 1e-4)
    assert period[0] == pytest.approx(2.0 * np.pi * np.sqrt((l + m * 9.81 / k) / 9.81), rel=1e-6)


@pytest.mark.parametrize("options", [{}, {"method": "rk4", "dt": 2e-4}])
def test_energy_on_springs_is_kept_and_is_zero_hanging_at_rest(options):
    chain = Chain.uniform(5, stiffness=1e4)
    path = simulate(chain, 1.0, 0.0, np.linspace(0.0, 10.0, 101), **options)
    assert np.abs(path.energy() / path.energy()[0] - 1.0).max() < 1e-9
    hanging = 9.81 * chain.carried_masses / 1e4
    rest = simulate(chain, 0.0, 0.0, [0.0, 1.0], stretch=hanging, **options)
    np.testing.assert_allclose(rest.energy(), 0.0, atol=1e-18)
    # from its definition: masses lifted, springs stretched
    lifted = path.positions()[0, :, 1].sum() * 9.81 + 0.5e4 * (path.stretch[0] ** 2).sum()
    lowest = (np.cumsum(1.0 + hanging) * -9.81).sum() + 0.5e4 * (hanging**2).sum()
    assert path.energy()[0] == pytest.approx(lifted - lowest, rel=1e-12)


def test_stiff_springs_come_to_rigid_rods_by_an_error_that_goes_as_one_over_stiffness():
    chain, times = Chain.uniform(5), [0.0, 2.0]
    rigid = simulate(chain, 0.5, 0.0, times, rtol=1e-13, atol=1e-15).theta[-1]
    stiffness = np.array([1e5, 2e5, 5e5, 1e6])
    errors = [
        np.abs(simulate(on_springs(chain, k), 0.5, 0.0, times).theta[-1] - rigid).max()
        for k in stiffness
    ]
    products = stiffness * errors
    assert np.ptp(products) < 0.01 * products[-1]
    assert 1e-5 < errors[-1] < 1e-4


@pytest.mark.parametrize("axial_damping", [0.0, 50.0])
def test_the_start_that_is_chosen_does_not_ring_and_an_unstretched_one_does(uneven, axial_damping):
    times = np.linspace(0.0, 0.05, 51)
    ringing = []
    for k, start in product((1e5, 1e6), ({}, {"stretch": 0.0})):
        chain = on_springs(uneven, k, axial_damping=axial_damping)
        path = simulate(chain, [1.0, 0.5, -0.4, 0.8], 1.5, times, **start)
        carried = k * path.stretch + axial_damping * path.stretch_rate
        expected = tensions(uneven, path.theta, path.omega)
        ringing.append(np.abs(carried - expected).max() / expected.max())
    slow, loud = ringing[::2], ringing[1::2]
    assert slow[0] < 3e-3
    assert slow[1] == pytest.approx(0.1 * slow[0], rel=0.3)  # as 1/k
    assert min(loud) > 100.0 * slow[0]


def acting(drive, t, q, u):
    """Value of a drive, constant or not, at an instant."""
    if isinstance(drive, Signal):
        return drive(t)
    return drive(t, *(q, u)[: drive.__code__.co_argcount - 1]) if callable(drive) else drive


@pytest.mark.parametrize(
    ("chain", "options"),
    [
        ({"drag": 0.8, "base": Cart(1.0, 2.0)}, {"velocity": 6.0}),
        ({"drag": 0.8}, {"velocity": [6.0, 0.0], "pivot_acceleration": [-12.0, 3.0]}),
        ({}, {"pivot_acceleration": lambda t: (2.0 * t, 50.0 * np.sin(20.0 * t))}),
        ({"base": Cart(1.0)}, {"force": Signal([0.0, 1.0], [3.0, 90.0], kind="linear")}),
        ({"base": Cart(1.0)}, {"force": lambda t, q, u: 20.0 * t - 3.0 * q[0] - 9.0 * u[2]}),
    ],
)
def test_springs_start_with_the_rate_at_which_tensions_of_rigid_rods_change(chain, options):
    step, k = 1e-4, 2e5
    given = {**chain, "masses": 1.0, "lengths": [0.6, 0.5]}
    state = [0.7, -0.4], [0.5, 1.0]
    start = simulate(Chain(**given, stiffness=k), *state, [0.0], **options)
    rods = simulate(Chain(**given), *state, step * np.arange(3), rtol=1e-13, atol=1e-14, **options)
    carried = []
    for j, t in enumerate(rods.times):
        q, u = (
            np.append(rods.theta[j], rods.position[j]),
            np.append(rods.omega[j], rods.velocity[j]),
        )
        now = {name: acting(drive, t, q, u) for name, drive in options.items()}
        now["velocity"] = rods.velocity[j]
        carried.append(tensions(rods.chain, rods.theta[j], rods.omega[j], **now))
    first, second, third = carried
    expected = (4.0 * second - 3.0 * first - third) / (2.0 * step * k)
    np.testing.assert_allclose(start.stretch_rate[0], expected, rtol=2e-5, atol=1e-8)


def test_a_motion_in_segments_is_the_motion_in_one(uneven):
    chain = on_springs(uneven, axial_damping=1.0)
    whole = simulate(chain, 0.8, 0.1, [0.0, 1.0, 2.0], torque=0.5)
    first = simulate(chain, 0.8, 0.1, [0.0, 1.0], torque=0.5)
    state = {name: getattr(first, name)[-1] for name in ("stretch", "stretch_rate")}
    then = simulate(chain, first.theta[-1], first.omega[-1], [1.0, 2.0], **state, torque=0.5)
    for name in ("theta", "omega", "stretch", "stretch_rate"):
        ours, expected = getattr(then, name)[-1], getattr(whole, name)[-1]
        np.testing.assert_allclose(ours, expected, rtol=0, atol=1e-8)


def test_a_mirrored_release_on_springs_is_the_mirror_image_to_the_last_bit(uneven):
    right = simulate(on_springs(uneven), 0.9, 0.1, [0.0, 1.0], torque=0.5)
    left = simulate(on_springs(uneven), -0.9, -0.1, [0.0, 1.0], torque=-0.5)
    np.testing.assert_array_equal(right.theta, -left.theta)
    np.testing.assert_array_equal(right.stretch, left.stretch)


@pytest.mark.parametrize("definition", ["bob", "link", "height", "com"])
def test_periods_on_stiff_springs_come_to_those_on_rigid_rods_as_one_over_stiffness(definition):
    chain = Chain.uniform(3)
    rigid = pseudo_periods(chain, 0.5, definition=definition)
    gaps = [1e6, 1e7] * np.transpose(
        [
            pseudo_periods(on_springs(chain, k), 0.5, definition=definition) - rigid
            for k in (1e6, 1e7)
        ]
    )
    np.testing.assert_allclose(gaps[:, 0], gaps[:, 1], rtol=0.01)


def test_springs_of_different_chains_start_with_what_a_function_does_to_each_of_them():
    chains = [Chain([m, 1.0], [1.0, 0.5], stiffness=400.0, base=Cart(2.0)) for m in (0.5, 2.0)]
    starts, times = [[0.5, 0.2], [0.1, 0.9]], [0.0, 0.5, 1.0]
    many = simulate(chains, starts, 0.0, times, force=lambda t: 3.0 + t)
    for k, chain in enumerate(chains):
        alone = simulate(chain, starts[k], 0.0, times, force=lambda t: 3.0 + t)
        np.testing.assert_array_equal(many[k].stretch, alone.stretch)
        pushed = simulate(chain, starts[k], 0.0, times, force=3.0)
        np.testing.assert_array_equal(many[k].stretch[0], pushed.stretch[0])


def test_springs_of_many_motions_are_judged_each_by_its_own_chain():
    soft, stiff = Chain.uniform(1, stiffness=5.0), Chain.uniform(1, stiffness=500.0)
    one_way = simulate([stiff, soft], [[3.0], [0.1]], 0.0, [0.0, 0.1])
    other = simulate([soft, stiff], [[0.1], [3.0]], 0.0, [0.0, 0.1])
    np.testing.assert_array_equal(other.stretch, one_way.stretch[::-1])
    # held at rest by its tension m g cos(theta)
    np.testing.assert_allclose(
        other.stretch[:, 0, 0], 9.81 * np.cos([0.1, 3.0]) / [5.0, 500.0], rtol=1e-9
    )
    short, long = Chain(1.0, 1.0, stiffness=500.0), Chain(1.0, 2.0, stiffness=500.0)
    given = {"stretch": [[0.0], [-1.5]]}
    shrunk = simulate([short, long], 0.1, 0.0, [0.0, 0.01], **given)
    alone = simulate(long, 0.1, 0.0, [0.0, 0.01], stretch=-1.5)
    np.testing.assert_array_equal(shrunk[1].stretch, alone.stretch)
    pair = Chain.uniform(2, stiffness=500.0)
    for_all = simulate(pair, np.ones((3, 2)), 0.0, [0.0], stretch=[0.01, 0.02], stretch_rate=[1, 2])
    np.testing.assert_array_equal(for_all.stretch, np.tile([0.01, 0.02], (3, 1, 1)))
    np.testing.assert_array_equal(for_all.stretch_rate, np.tile([1.0, 2.0], (3, 1, 1)))
    with pytest.raises(
        ValueError, match=r"is \[\[0.0\], \[-1.5\]\] for lengths \[\[2.0\], \[1.0\]\]$"
    ):
        simulate([long, short], 0.1, 0.0, [0.0, 0.01], **given)
    with pytest.raises(ValueError, match="give stretch, or more stiffness"):
        simulate([stiff, soft], [[0.1], [3.0]], 0.0, [0.0, 0.1])


@pytest.mark.parametrize(
    "carried", [lambda _t: np.array([0.0, -20.0]), Signal([0.0, 1.0], [[0.0, -20.0]])]
)
def test_springs_that_a_drive_holds_apart_at_the_start_need_no_stretch(carried):
    soft = Chain.uniform(1, stiffness=5.0)
    motion = simulate(soft, 3.0, 0.0, [0.0, 0.1], pivot_acceleration=carried)
    constant = simulate(soft, 3.0, 0.0, [0.0, 0.1], pivot_acceleration=[0.0, -20.0])
    np.testing.assert_allclose(motion.stretch, constant.stretch, rtol=0, atol=1e-9)
    assert motion.stretch[0, 0] == pytest.approx((9.81 - 20.0) * np.cos(3.0) / 5.0)
    with pytest.raises(ValueError, match="give stretch, or more stiffness"):
        simulate(soft, 0.1, 0.0, [0.0, 0.1], pivot_acceleration=carried)
