"""Chains by name, against their sources."""

import numpy as np
import pytest
from engines import dm_control_model
from gymnasium.envs.classic_control.acrobot import AcrobotEnv
from scipy.integrate import quad

from npend_gym import Cart, Chain


def test_a_rod_with_a_tip_has_the_moments_of_its_density():
    masses, lengths, tips = [1.0, 2.0, 0.0], [0.5, 1.5, 2.0], [0.0, 0.7, 3.0]
    chain = Chain.rods(masses, lengths, tips, damping=0.1)
    for i, (mass, length, tip) in enumerate(zip(masses, lengths, tips, strict=True)):
        density = mass / length
        moments = [
            quad(lambda x, d=density, k=k: d * x**k, 0.0, length)[0] + tip * length**k
            for k in range(3)
        ]
        own = (1.0, chain.centres[i], chain.inertias[i] / chain.masses[i] + chain.centres[i] ** 2)
        np.testing.assert_allclose(chain.masses[i] * np.array(own), moments, rtol=1e-14)
    np.testing.assert_array_equal(chain.damping, 0.1)
    assert Chain.rods(0.0, [1.0, 2.0], 3.0) == Chain(3.0, [1.0, 2.0])  # no mass: a bob


def test_the_acrobot_is_that_of_gymnasium():
    book = AcrobotEnv
    assert book.book_or_nips == "book"
    assert Chain.acrobot() == Chain(
        [book.LINK_MASS_1, book.LINK_MASS_2], [book.LINK_LENGTH_1, book.LINK_LENGTH_2], 9.8,
        centres=[book.LINK_COM_POS_1, book.LINK_COM_POS_2], inertias=book.LINK_MOI,
    )  # fmt: skip


def test_realaigym_has_the_published_inertias_about_the_joints_and_its_friction():
    chain = Chain.realaigym("C.1")
    about_joint = chain.inertias + chain.masses * chain.centres**2
    np.testing.assert_allclose(about_joint, [0.031887199591513, 0.050869848128073], rtol=1e-12)
    cf, speeds = np.array([0.16, 0.12]), np.array([1e-7, 1e4])
    for speed in speeds:  # dry friction is cf arctan(100 v) there
        u = speed / chain.friction_speed
        friction = chain.friction * u / np.sqrt(1.0 + u**2)
        np.testing.assert_allclose(friction, cf * np.arctan(100.0 * speed), rtol=1e-6)
    np.testing.assert_allclose(chain.armature / chain.gear**2, 6.287203962819607e-05, rtol=1e-14)
    still = Chain.realaigym("C.1", motors=False)
    np.testing.assert_array_equal(still.inertias, chain.inertias)
    assert not np.any([still.damping, still.friction, still.armature])
    assert Chain.realaigym("C.1", "1.0") == chain
    assert Chain.realaigym("A.0").lengths.tolist() == [0.3, 0.2]


@pytest.mark.parametrize(("design", "model"), [("C.0", None), ("C.1", "2.0"), ("C.1", "3.0")])
def test_models_with_negative_inertia_are_refused(design, model):
    with pytest.raises(ValueError, match=r"negative inertia about the centre of a link, -0\.0"):
        Chain.realaigym(design, model)


def test_multiarm_swings_with_the_period_of_a_physical_pendulum():
    chain = Chain.multiarm(1)  # I'' + m g a theta = 0 with the published m, a, I
    inertia = 1.09119e-4 + 0.147755 * 0.147585**2
    assert chain.lift[0] == pytest.approx(0.147755 * 0.147585, rel=1e-15)
    assert chain.inertias[0] + chain.masses[0] * chain.centres[0] ** 2 == pytest.approx(inertia)
    assert [Chain.multiarm(arms).n for arms in (1, 2, 3)] == [1, 2, 3]
    np.testing.assert_array_equal(Chain.multiarm(3).lengths, [0.1728, 0.2287, 0.2413])


@pytest.mark.parametrize("num_poles", [None, 1, 3])
def test_dm_control_has_these_links(num_poles):
    model = dm_control_model(num_poles)
    chain = Chain.dm_control("cartpole", num_poles) if num_poles else Chain.dm_control("acrobot")
    links = model.body_mass.size - chain.n  # after the world and, maybe, the cart
    np.testing.assert_array_equal(chain.masses, model.body_mass[links:])
    np.testing.assert_allclose(chain.centres, model.body_ipos[links:, 2], rtol=1e-15)
    np.testing.assert_allclose(chain.inertias, model.body_inertia[links:, 0], rtol=1e-14)
    np.testing.assert_array_equal(chain.damping, model.dof_damping[-chain.n :])
    assert -model.opt.gravity[2] == chain.gravity
    if num_poles:
        assert chain.base == Cart(model.body_mass[1], model.dof_damping[0])
    else:
        assert chain.base is None


def test_a_name_stands_for_a_chain():
    assert Chain.preset("acrobot") == Chain.acrobot()
    assert Chain.preset("realaigym C.1") == Chain.realaigym("C.1")
    assert Chain.preset("multiarm 2") == Chain.multiarm(2)
    assert Chain.preset("dm_control cartpole") == Chain.dm_control("cartpole")


def test_centres_and_inertias_that_are_given_replace_those_of_rods():
    given = Chain.rods(2.0, 1.0, centres=0.3, inertias=0.5)
    assert given == Chain(2.0, 1.0, centres=0.3, inertias=0.5)
