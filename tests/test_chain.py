import copy
import inspect
import json
import pickle
from dataclasses import FrozenInstanceError

import numpy as np
import pytest

from npend_gym import Chain
from npend_gym.chain import MECHANISM, ChainParameters


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
    with pytest.raises(ValueError, match="read-only"):
        chain.masses[0] = 2.0
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


def test_a_chain_goes_through_json_and_back():
    for chain in (LINKS, Chain([1.0, 2.0], 1.0), Chain(1.0, [1.0, 2.0], friction_speed=0.1)):
        text = json.dumps(chain.as_dict(), allow_nan=False)
        assert Chain.from_dict(json.loads(text)) == chain
        assert Chain(**json.loads(text)) == chain
        assert pickle.loads(pickle.dumps(chain)) == chain
    assert list(Chain(1.0, [1.0]).as_dict()) == [
        "masses", "lengths", "gravity", "damping", "drag", "quadratic_drag"
    ]  # fmt: skip
    assert Chain.from_dict({"masses": 1.0, "lengths": [1.0, 2.0]}) == Chain(1.0, [1.0, 2.0])


@pytest.mark.parametrize(
    ("values", "error", "message"),
    [
        ([1.0, 2.0], TypeError, "a chain must be a dict of parameters"),
        ({"masses": 1.0}, ValueError, "has no 'lengths'; its keys are masses, lengths, gravity"),
        (
            {"masses": 1.0, "lengths": 1.0, "mass": 2.0},
            ValueError,
            "'mass'; did you mean 'masses'[?] its",
        ),
        ({"masses": 1.0, "lengths": -1.0}, ValueError, "lengths must be greater than zero"),
    ],
)
def test_a_dict_that_is_no_chain_is_refused(values, error, message):
    with pytest.raises(error, match=message):
        Chain.from_dict(values)


def test_many_chains_have_the_parameters_of_one_and_their_changes():
    many = LINKS.repeated(2, inertias=np.full((2, 3), 0.5), lengths=np.ones((2, 3)))
    np.testing.assert_array_equal(many.inertias, np.full((2, 3), 0.5))
    np.testing.assert_array_equal(many.centres, [LINKS.centres] * 2)
    assert not many.is_ideal
    longer = Chain(1.0, [1.0, 2.0]).repeated(2, lengths=np.full((2, 2), 3.0))
    assert longer.is_ideal  # bobs stay at the ends of their rods
    np.testing.assert_array_equal(longer.centres, longer.lengths)
    with pytest.raises(ValueError, match="inertias must be zero or more"):
        LINKS.repeated(2, inertias=-np.ones((2, 3)))
    with pytest.raises(ValueError, match="those of link 0 are 0"):
        LINKS.repeated(2, centres=np.zeros((2, 3)))


def test_an_unknown_keyword_is_refused_with_the_nearest_one_and_all_there_are():
    with pytest.raises(TypeError, match=r"did you mean 'inertias'\? It takes masses, .*, base$"):
        Chain(1.0, [1.0, 1.0], inertia=0.1)
    fields = [*ChainParameters._fields, *MECHANISM]
    assert list(inspect.signature(Chain).parameters) == fields


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"inertias": -0.1}, ValueError, "inertias must be zero or more, got"),
        ({"inertias": [0.1, np.nan]}, ValueError, "inertias must be finite"),
        ({"centres": "middle"}, TypeError, "centres must hold real numbers, got 'middle'"),
        ({"centres": [np.inf, 1.0]}, ValueError, "centres must be finite"),
        ({"centres": [1.0, 0.0]}, ValueError, "those of link 1 are 0; give it an inertia"),
        ({"friction": -1.0}, ValueError, "friction must be zero or more"),
        ({"friction": 1.0, "friction_speed": 0.0}, ValueError, "dry friction needs a speed"),
        ({"friction": 1.0, "friction_speed": None}, TypeError, "friction_speed must hold real"),
        ({"friction_speed": 1e-40}, ValueError, "friction_speed must be at least 1e-30"),
        ({"armature": -1.0}, ValueError, "armature must be zero or more"),
        ({"gear": [6.0, 0.0]}, ValueError, "gear must not be zero"),
        ({"gear": np.nan}, ValueError, "gear must be finite"),
        ({"gear": "6:1"}, TypeError, "gear must hold real numbers"),
        ({"gear": [1.0, 2.0, 3.0]}, ValueError, r"gear must be one number or .* \(2,\)"),
        ({"masses": []}, ValueError, "masses must be one number or a list"),
        ({"masses": [[1.0]]}, ValueError, "masses must be one number or a list"),
        ({"masses": [1.0, 2.0], "lengths": [1.0]}, ValueError, "got 2 masses and 1 lengths"),
        ({"masses": 0.0}, ValueError, "masses must be greater than zero"),
        ({"lengths": [1.0, -2.0]}, ValueError, "lengths must be greater than zero"),
        ({"masses": np.nan}, ValueError, "masses must be finite"),
        ({"lengths": np.inf}, ValueError, "lengths must be finite"),
        ({"masses": "1"}, TypeError, "masses must hold real numbers"),
        ({"gravity": -9.81}, ValueError, "gravity must be zero or more"),
        ({"gravity": np.nan}, ValueError, "gravity must be finite"),
        ({"gravity": [9.81]}, TypeError, "gravity must be a real number"),
        ({"gravity": 1e-40}, ValueError, "gravity must be zero or at least 1e-30"),
        ({"damping": -0.1}, ValueError, "damping must be zero or more"),
        ({"damping": 1e-40}, ValueError, "damping must be zero or at least 1e-30"),
        ({"damping": [0.1] * 3}, ValueError, r"damping must be one number or .* \(2,\)"),
        ({"drag": 1e-40}, ValueError, "drag must be zero or at least 1e-30"),
    ],
)
def test_bad_arguments_are_refused_by_name(arguments, error, message):
    with pytest.raises(error, match=message):
        Chain(**{"masses": 1.0, "lengths": [1.0, 1.0]} | arguments)


def test_long_text_among_numbers_fills_no_memory():
    masses: list = [1.0] * 100_000
    masses[50] = "1" * 100_000  # as much in every entry would be 40 GB
    with pytest.raises(TypeError, match="masses must hold real numbers, got"):
        Chain(masses, 1.0)
    with pytest.raises(TypeError, match="masses must hold real numbers, got"):
        Chain([masses, masses], 1.0)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"n": 0}, ValueError, "n must be between 1 and 1000000, got 0"),
        ({"n": 2.0}, TypeError, "n must be an integer"),
        ({"mass": [1.0, 2.0]}, TypeError, "mass must be a real number"),
        ({"length": 0.0}, ValueError, "length must be greater than zero"),
    ],
)
def test_bad_arguments_of_uniform_are_refused_by_name(arguments, error, message):
    with pytest.raises(error, match=message):
        Chain.uniform(**{"n": 2} | arguments)
