import copy
import inspect
import json
import pickle
from dataclasses import FrozenInstanceError

import numpy as np
import pytest

from npend_gym import Cart, Chain
from npend_gym.chain import MECHANISM, ChainParameters, as_chain


def test_scalars_stand_for_every_rod():
    chain = Chain(2.0, [1.0, 2.0, 3.0], damping=0.1)
    np.testing.assert_array_equal(chain.masses, [2.0, 2.0, 2.0])
    np.testing.assert_array_equal(chain.damping, [0.1, 0.1, 0.1])
    assert chain.n == 3
    assert Chain(1, 1).n == 1
    assert Chain([1, 2], 0.5) == Chain([1.0, 2.0], [0.5, 0.5])


def test_uniform_chain_is_the_chain_of_equal_rods():
    assert Chain.uniform(3, 2.0, 0.5, 9.8, 0.1) == Chain([2.0] * 3, [0.5] * 3, 9.8, [0.1] * 3)


def test_carried_masses_sum_from_the_tip():
    np.testing.assert_array_equal(Chain([1.0, 2.0, 4.0], 1.0).carried_masses, [7.0, 6.0, 4.0])
    assert Chain(1.0, [1.0, 0.5]).total_length == 1.5


def test_a_chain_cannot_be_changed():
    given = np.ones(3)
    chain = Chain(given, 1.0)
    given[0] = 5.0
    assert chain.masses[0] == 1.0
    with pytest.raises(FrozenInstanceError):
        chain.gravity = 1.0


def copies(chain):
    chain.lift, chain.carried_masses  # noqa: B018 - kept from now on
    return chain, pickle.loads(pickle.dumps(chain)), copy.deepcopy(chain), copy.copy(chain)


@pytest.mark.parametrize("name", ["masses", "gear", "stiffness", "lift", "carried_masses"])
def test_no_array_of_a_chain_or_of_a_copy_can_be_changed(name):
    for chain in copies(Chain([1.0, 2.0], 1.0, stiffness=9.0)):
        with pytest.raises(ValueError, match="read-only"):
            getattr(chain, name)[0] = 7.0


def test_what_a_chain_keeps_is_not_pickled():
    chain, again, *_ = copies(Chain.uniform(3))
    assert pickle.dumps(chain) == pickle.dumps(Chain.uniform(3))
    assert (again, hash(again)) == (chain, hash(chain))


def test_the_sign_of_a_zero_makes_no_other_chain():
    given = np.array([-0.0])
    chain = Chain(1, 1, -0.0, given, centres=given, inertias=1.0)
    assert np.signbit(given[0])
    assert chain == Chain(1, 1, 0.0, centres=0.0, inertias=1.0)
    assert json.dumps(chain.as_dict()).count("-") == 0


def test_repr_is_short_for_long_chains():
    assert repr(Chain.uniform(1000)) == (
        "Chain(n=1000, masses=1, lengths=1, gravity=9.81, damping=0)"
    )
    assert "masses=[1. 2.]" in repr(Chain([1.0, 2.0], 1.0))


MASKED = np.ma.masked_array([1.0, 999.0], mask=[False, True])
LINKS = Chain(
    [1.0, 2.0, 4.0], [0.5, 1.0, 2.0], 9.8, 0.1, 0.2, 0.3, centres=[0.3, -0.2, 3.0],
    inertias=[0.0, 0.1, 0.2], friction=0.1, friction_speed=[0.1, 0.2, 0.3],
    armature=[0.0, 0.01, 0.02], gear=[np.inf, 6.0, -6.0],
)  # fmt: skip


def test_links_have_their_parameters_and_an_ideal_chain_has_none_of_them():
    ideal = Chain([1.0, 2.0], [0.5, 1.0])
    assert ideal.is_ideal
    assert Chain([1.0, 2.0], [0.5, 1.0], damping=1.0, drag=1.0, gear=6.0).is_ideal
    np.testing.assert_array_equal(ideal.centres, ideal.lengths)
    np.testing.assert_array_equal(ideal.gear, [np.inf, np.inf])
    np.testing.assert_array_equal(ideal.friction_speed, [0.05, 0.05])
    assert Chain(1.0, [1.0, 2.0], centres=[1.0, 2.0]) == Chain(1.0, [1.0, 2.0])
    for change in ({"centres": 0.9}, {"inertias": 0.1}, {"friction": 0.1}, {"armature": 0.1}):
        chain = Chain([1.0, 2.0], [0.5, 1.0], **change)
        assert not chain.is_ideal
        assert chain != ideal
        assert hash(chain) != hash(ideal)
        assert next(iter(change)) in repr(chain)
    assert "gear=[inf  6. -6.]" in repr(LINKS)


def test_lift_is_mass_times_lever():
    np.testing.assert_array_equal(Chain([1.0, 2.0, 4.0], [0.5, 1.0, 2.0]).lift, [3.5, 6.0, 8.0])
    np.testing.assert_allclose(LINKS.lift, [0.3 + 0.5 * 6.0, -0.4 + 4.0, 12.0], rtol=1e-15)
    assert LINKS.lifting_energy == pytest.approx(2.0 * 9.8 * (3.3 + 3.6 + 12.0), rel=1e-15)
    assert Chain(1.0, [1.0], centres=-0.5).lifting_energy == pytest.approx(9.81, rel=1e-15)


ON_CART = {"base": Cart(1.7, 0.6)}
SPRINGS = {"stiffness": [90.0, 60.0], "axial_damping": [0.4, 0.0]}
BODIES = {"centres": 0.3, "inertias": 0.1}


@pytest.mark.parametrize(
    "parts",
    [{}, {"friction_speed": 0.1}, ON_CART, SPRINGS, ON_CART | SPRINGS, ON_CART | BODIES, None],
)
def test_a_chain_goes_through_json_and_back(parts):
    chain = LINKS if parts is None else Chain([1.0, 0.5], 0.7, damping=0.1, drag=0.2, **parts)
    text = json.dumps(chain.as_dict(), allow_nan=False)
    for again in (Chain.from_dict(json.loads(text)), Chain(**json.loads(text)), *copies(chain)):
        assert (again, hash(again), repr(again)) == (chain, hash(chain), repr(chain))
        assert again.base == (parts or {}).get("base")
        assert (again.stiffness is None) == ("stiffness" not in (parts or {}))
    assert ("base=Cart(mass=1.7" in repr(chain)) == (chain.base is not None)
    assert ("stiffness=" in repr(chain)) == (chain.stiffness is not None)


def test_a_dict_of_a_chain_has_no_more_than_it_needs():
    assert list(Chain(1.0, [1.0]).as_dict()) == [
        "masses", "lengths", "gravity", "damping", "drag", "quadratic_drag"
    ]  # fmt: skip
    assert Chain.from_dict({"masses": 1.0, "lengths": [1.0, 2.0]}) == Chain(1.0, [1.0, 2.0])


def test_many_chains_have_the_parameters_of_one_and_their_changes():
    many = LINKS.repeated(2, inertias=np.full((2, 3), 0.5), lengths=np.ones((2, 3)))
    np.testing.assert_array_equal(many.inertias, np.full((2, 3), 0.5))
    np.testing.assert_array_equal(many.centres, [LINKS.centres] * 2)
    assert not many.is_ideal
    longer = Chain(1.0, [1.0, 2.0]).repeated(2, lengths=np.full((2, 2), 3.0))
    assert longer.is_ideal  # bobs stay at the ends of their rods
    np.testing.assert_array_equal(longer.centres, longer.lengths)


def test_an_unknown_keyword_is_refused_with_the_nearest_one_and_all_there_are():
    with pytest.raises(TypeError, match=r"did you mean 'inertias'\? It takes masses, .*, base$"):
        Chain(1.0, [1.0, 1.0], inertia=0.1)
    fields = [*ChainParameters._fields, *MECHANISM]
    assert list(inspect.signature(Chain).parameters) == fields


def two_rods(**change):
    """Return what makes a chain of two rods with these arguments."""
    return lambda: Chain(**{"masses": 1.0, "lengths": [1.0, 1.0]} | change)


def sprung(**change):
    return two_rods(**{"stiffness": 1e3} | change)


def from_dict(**values):
    return lambda: Chain.from_dict(values)


def spheres(n, radius, density, **options):
    """Return what makes a chain of balls one metre apart."""
    return lambda: Chain.spheres(n, radius, 1.0, density, **options)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (two_rods(inertias=-0.1), "inertias must be zero or more, got"),
        (two_rods(inertias=[0.1, np.nan]), "inertias must be finite"),
        (two_rods(centres=[np.inf, 1.0]), "centres must be finite"),
        (two_rods(centres=[1.0, 0.0]), "those of link 1 are 0; give it an inertia"),
        (two_rods(friction=-1.0), "friction must be zero or more"),
        (two_rods(friction=1.0, friction_speed=0.0), "dry friction needs a speed"),
        (two_rods(friction_speed=1e-40), "friction_speed must be at least 1e-30"),
        (two_rods(armature=-1.0), "armature must be zero or more"),
        (two_rods(gear=[6.0, 0.0]), "gear must not be zero"),
        (two_rods(gear=np.nan), "gear must be finite"),
        (two_rods(gear=[None, 1e31]), r"gear must lie within .*, got \[1e\+31\]"),
        (two_rods(gear=[1.0, 2.0, 3.0]), r"gear must be one number or .* \(2,\)"),
        (two_rods(gear=[np.ones(2), np.ones(1)]), "gear must be a number or a rectangular array"),
        (two_rods(gear=MASKED), "gear must have no masked entries"),
        (two_rods(masses=MASKED), "masses must have no masked entries"),
        (two_rods(masses=[]), "masses must be one number or a list"),
        (two_rods(masses=[[1.0]]), "masses must be one number or a list"),
        (two_rods(masses=[1.0, 2.0], lengths=[1.0]), "got 2 masses and 1 lengths"),
        (two_rods(masses=0.0), "masses must be greater than zero"),
        (two_rods(lengths=[1.0, -2.0]), "lengths must be greater than zero"),
        (two_rods(masses=np.nan), "masses must be finite"),
        (two_rods(lengths=np.inf), "lengths must be finite"),
        (two_rods(gravity=-9.81), "gravity must be zero or more"),
        (two_rods(gravity=np.nan), "gravity must be finite"),
        (two_rods(gravity=1e-40), "gravity must be zero or at least 1e-30"),
        (two_rods(damping=-0.1), "damping must be zero or more"),
        (two_rods(damping=1e-40), "damping must be zero or at least 1e-30"),
        (two_rods(damping=[0.1] * 3), r"damping must be one number or .* \(2,\)"),
        (two_rods(drag=1e-40), "drag must be zero or at least 1e-30"),
        # from a dict, of equal rods, of rods with a mass
        (from_dict(masses=1.0), "has no 'lengths'; its keys are masses, lengths, g"),
        (from_dict(masses=1.0, lengths=1.0, mass=2.0), "'mass'; did you mean 'masses'[?] its"),
        (from_dict(masses=1.0, lengths=-1.0), "lengths must be greater than zero"),
        (lambda: Chain.uniform(0), "n must be between 1 and 1000000, got 0"),
        (lambda: Chain.uniform(2, length=0.0), "length must be greater than zero"),
        (lambda: Chain.rods(-1.0, 1.0), "masses must be zero or more"),
        (lambda: Chain.rods(0.0, 1.0), "masses of rod and tip must be greater than"),
        (lambda: Chain.rods(1.0, 0.0), "lengths must be greater than zero"),
        (lambda: Chain.rods(1.0, 1.0, -0.1), "tips must be zero or more"),
        (lambda: Chain.rods([1, 2], [1, 2, 3]), r"masses must be one number .* \(3,\)"),
        # by name
        (lambda: Chain.preset("Acrobot-v1"), "name of a chain must be one of acrobot"),
        (lambda: Chain.realaigym("B.0"), "design must be one of A.0, C.0, C.1"),
        (lambda: Chain.realaigym("A.0", "9"), "model must be one of"),
        (lambda: Chain.realaigym("C.1", 1.0), "1.0, 2.0, 3.0, as a string; got 1.0"),
        (lambda: Chain.multiarm(4), "arms must be between 1 and 3, got 4"),
        (lambda: Chain.dm_control("cheetah"), "domain must be one of acrobot, cart"),
        (lambda: Chain.dm_control("cartpole", 0), "num_poles must be between 1"),
        (lambda: Chain.dm_control("acrobot", 3), "num_poles must be left out for acrobot.* got 3"),
        # balls
        (spheres(0, 0.1, 1.0), "n must be between 1"),
        (spheres(2, 0.0, 1.0), "radius must be greater than zero"),
        (spheres(2, 0.1, [1.0, 2.0, 3.0]), "density must be one number or an array"),
        (spheres(2, 0.6, 1.0), "apart from the ball above: that of ball 1 .* 1.2 m"),
        (spheres(1, 2.0, 1.0), "apart from the pivot: that of ball 0 .* least 2 m"),
        (spheres(2, 0.1, 500.0, fluid_density=1000.0), "lighter balls rise; got"),
        (spheres(2, 0.1, [5e3, 8e3], fluid_density=1.2), "has one gravity; got"),
        (spheres(2, 0.1, 1.0, drag_coefficient=0.4), "such as 1.2 for air"),
        (spheres(2, 0.1, 1.0, viscosity=-1.0), "viscosity must be zero or more"),
        # on springs, and on a cart
        (sprung(stiffness=-1.0), "stiffness must be greater than zero"),
        (sprung(stiffness=np.inf), "stiffness must be finite"),
        (sprung(stiffness=[1e3] * 3), r"stiffness must be one number or .* \(2,\)"),
        (sprung(axial_damping=-1.0), "axial_damping must be zero or more"),
        (sprung(stiffness=None, axial_damping=1.0), "stiffness must be given with it"),
        (lambda: Cart(1.0, -1.0), "damping of a cart must be zero or more"),
        (two_rods(base={"weight": 1.0}), "base must have the keys"),
        (two_rods(base={"mass": -1.0}), "a cart must be greater than"),
    ],
)
def test_a_chain_that_cannot_be_is_refused_by_name(call, message):
    with pytest.raises(ValueError, match=message):
        call()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (two_rods(centres="middle"), "centres must hold real numbers, got 'middle'"),
        (two_rods(friction=1.0, friction_speed=None), "friction_speed must hold real"),
        (two_rods(gear="6:1"), "gear must hold real numbers"),
        (two_rods(gear=[True, None]), "gear must hold real numbers"),
        (two_rods(masses=[True, 2.0]), "masses must hold real numbers"),
        (two_rods(masses="1"), "masses must hold real numbers"),
        (two_rods(gravity=[9.81]), "gravity must be a real number"),
        (lambda: Chain.from_dict([1.0, 2.0]), "a chain must be a dict of parameters"),
        (lambda: Chain.uniform(2.0), "n must be an integer"),
        (lambda: Chain.uniform(2, mass=[1.0, 2.0]), "mass must be a real number"),
        (lambda: Chain.multiarm("1"), "arms must be an integer"),
        (spheres(2, 0.1, 1.0, fixed=1), "fixed must be True or False"),
        (spheres(2, 0.1, 1.0, colour=1), "colour"),
        (spheres(2, 0.1, 1.0, lengths=0.2), r"lengths must be left out, .* give spacing=0\.2"),
        (lambda: Cart("1"), "mass of a cart must be a real number"),
        (two_rods(base=1.0), "base must be None or a Cart"),
        (two_rods(stifness=1.0), "'stifness'; did you mean 'stiffness'"),
    ],
)
def test_a_chain_of_another_type_than_it_can_be_is_refused_by_name(call, message):
    with pytest.raises(TypeError, match=message):
        call()


def test_a_file_of_a_chain_may_have_a_byte_order_mark(tmp_path):
    path = tmp_path / "chain.json"
    path.write_text(json.dumps(LINKS.as_dict()), encoding="utf-8-sig")
    assert as_chain(path) == LINKS


def test_long_text_among_numbers_fills_no_memory():
    masses: list = [1.0] * 100_000
    masses[50] = "1" * 100_000  # as much in every entry would be 40 GB
    with pytest.raises(TypeError, match="masses must hold real numbers, got"):
        Chain(masses, 1.0)
    with pytest.raises(TypeError, match="masses must hold real numbers, got"):
        Chain([masses, masses], 1.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"masses": -np.ones((2, 2))}, "masses must be greater"),
        ({"inertias": -np.ones((2, 2))}, "inertias must be zero or more"),
        ({"centres": np.zeros((2, 2))}, "those of link 0 are 0"),
        ({"damping": [[0.1, np.nan]] * 2}, "damping must be finite"),
        ({"masses": np.full((2, 2), np.nan)}, "masses must be finite"),
        ({"friction_speed": np.full((2, 2), np.inf)}, "friction_speed must be finite"),
        ({"gear": np.full((2, 2), np.nan)}, "gear must be finite"),
        ({"damping": np.ones((2, 5))}, r"damping must have the shape \(2, 2\), .* got \(2, 5\)"),
        ({"gravity": np.ones((2, 2))}, r"gravity must have the shape \(2,\), a row for each"),
        ({"dampings": np.ones((2, 2))}, r"no parameter 'dampings'; did you mean 'damping'\?"),
    ],
)
def test_a_change_of_chains_side_by_side_that_breaks_a_rule_is_refused(changes, message):
    many = Chain.uniform(2).repeated(2)
    for change in (lambda: Chain.uniform(2).repeated(2, **changes), lambda: many.changed(changes)):
        with pytest.raises((TypeError, ValueError), match=message):
            change()


def test_gear_ratios_of_chains_side_by_side_may_be_infinite():
    gear = np.array([[np.inf, -6.0], [2.0, np.inf]])
    np.testing.assert_array_equal(Chain.uniform(2).repeated(2, gear=gear).gear, gear)
