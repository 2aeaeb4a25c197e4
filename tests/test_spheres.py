"""Balls on a chain, against rigid bodies, potential flow and terminal speeds."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import ellipk

from npend_gym import Chain, physics, pseudo_periods

RADIUS = np.array([0.02, 0.035, 0.01, 0.03])  # m
SPACING = np.array([0.12, 0.2, 0.1, 0.3])  # m
STEEL, WATER, G = 7800.0, 998.0, 9.81
THETA, OMEGA = np.array([0.7, -1.2, 2.5, 0.3]), np.array([1.5, -3.0, 2.0, 4.0])


def added_mass(radius, density):
    """Return the added mass [kg] of a ball from the kinetic energy of the fluid around it.

    The flow is that of a dipole: with phi = -U a^3 cos(angle) / (2 r^2) its energy is
    rho/2 int |grad phi|^2, which is half of the added mass times U^2.
    """

    def shell(r):  # int |grad phi|^2 over a sphere, U = 1, over 2 pi
        across = quad(lambda u: u**2 + (1.0 - u**2) / 4.0, -1.0, 1.0)[0]
        return across * radius**6 / r**6 * r**2

    return 2.0 * np.pi * density * quad(shell, radius, np.inf)[0]


def in_fluid(theta, omega, fluid):
    """Return the angular accelerations and the force on the pivot [N], from Newton's law.

    Weight less buoyancy and inertia with added mass stand apart here, ball by ball.
    """
    volume = 4.0 / 3.0 * np.pi * RADIUS**3
    weight = (STEEL - fluid) * volume * G
    heavy = STEEL * volume + np.array([added_mass(r, fluid) for r in RADIUS])
    n = theta.size
    s, c = np.sin(theta), np.cos(theta)
    reach = np.tril(np.ones((n, n))) * SPACING  # of ball i along rod j
    along_x, along_y = reach * c, reach * s  # velocity of ball i for a turn of rod j
    turned_x, turned_y = reach @ (-s * omega**2), reach @ (c * omega**2)
    matrix = along_x.T @ (heavy[:, None] * along_x) + along_y.T @ (heavy[:, None] * along_y)
    matrix += np.diag(0.4 * STEEL * volume * RADIUS**2)
    load = -along_x.T @ (heavy * turned_x) - along_y.T @ (heavy * turned_y + weight)
    alpha = np.linalg.solve(matrix, load)
    pull_x = heavy * (along_x @ alpha + turned_x)
    pull_y = heavy * (along_y @ alpha + turned_y) + weight
    return alpha, -np.array([pull_x.sum(), pull_y.sum()])


@pytest.mark.parametrize("fluid", [0.0, 1.2, WATER])
def test_balls_in_a_fluid_move_and_pull_as_newtons_law_with_buoyancy_and_added_mass(fluid):
    chain = Chain.spheres(4, RADIUS, SPACING, STEEL, gravity=G, fluid_density=fluid)
    alpha, pull = in_fluid(THETA, OMEGA, fluid)
    own = physics.accelerations(chain, THETA, OMEGA)
    np.testing.assert_allclose(own, alpha, rtol=1e-11)
    rod = np.array([np.sin(THETA[0]), -np.cos(THETA[0])])
    tension = physics.tensions(chain, THETA, OMEGA)[0]
    assert tension == pytest.approx(pull @ rod, rel=1e-11)


@pytest.mark.parametrize("fluid", [0.0, WATER])
def test_a_ball_on_a_rod_has_the_period_of_its_weight_and_inertia(fluid):
    a, l, r = 0.9, 0.4, 0.15
    ball = Chain.spheres(1, r, l, STEEL, fluid_density=fluid, gravity=G)
    inertia = (STEEL + fluid / 2.0) * l**2 + 0.4 * STEEL * r**2  # over the volume
    turned = (STEEL - fluid) * G * l
    expected = 4.0 * np.sqrt(inertia / turned) * ellipk(np.sin(a / 2.0) ** 2)
    assert pseudo_periods(ball, a)[0] == pytest.approx(expected, rel=1e-9)


def test_balls_that_do_not_turn_are_point_masses_and_small_ones_approach_them():
    still = Chain.spheres(3, 0.02, 0.2, STEEL, fixed=False)
    assert still.is_ideal
    assert still.masses[0] == pytest.approx(4.0 / 3.0 * np.pi * 0.02**3 * STEEL, rel=1e-15)
    assert still == Chain.uniform(3, still.masses[0], 0.2)
    away = []
    for radius in (0.02, 0.01):
        balls = Chain.spheres(4, radius, 0.2, STEEL)
        points = Chain.spheres(4, radius, 0.2, STEEL, fixed=False)
        both = [physics.accelerations(each, THETA, OMEGA) for each in (balls, points)]
        away.append(np.abs(both[0] - both[1]).max())
    assert away[0] / away[1] == pytest.approx(4.0, rel=0.05)  # the inertia is 2/5 m r^2


def test_drag_balances_the_weight_at_the_terminal_speed():
    r, viscosity, oil, coefficient = 0.002, 1.4, 960.0, 0.44
    slow = Chain.spheres(1, r, 0.1, 2500.0, fluid_density=oil, viscosity=viscosity)
    stokes = 2.0 / 9.0 * (2500.0 - oil) * 9.81 * r**2 / viscosity
    assert slow.drag[0] * stokes == pytest.approx(slow.masses[0] * slow.gravity, rel=1e-14)
    fast = Chain.spheres(1, r, 0.1, 2500.0, fluid_density=oil, drag_coefficient=coefficient)
    newton = np.sqrt(8.0 / 3.0 * (2500.0 / oil - 1.0) * 9.81 * r / coefficient)
    weight = fast.masses[0] * fast.gravity
    assert fast.quadratic_drag[0] * newton**2 == pytest.approx(weight, rel=1e-14)


def test_balls_of_unequal_densities_hang_in_vacuum_and_parameters_of_chains_replace_theirs():
    mixed = Chain.spheres(2, 0.02, 0.2, [STEEL, 2500.0])
    assert mixed.masses[0] / mixed.masses[1] == pytest.approx(STEEL / 2500.0)
    hollow = Chain.spheres(2, 0.02, 0.2, 90.0, inertias=2e-7, damping=1e-6)
    assert hollow.inertias.tolist() == [2e-7, 2e-7]
    assert hollow.damping.tolist() == [1e-6, 1e-6]
