"""Chains as models of MuJoCo, whose motions are compared with `simulate`."""

import json
import re
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from npend_gym import Cart, Chain, simulate
from npend_gym.cli import main
from npend_gym.export import to_mjcf, to_sdf, to_urdf, to_usd

mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed")

SECONDS = 2.0
LINKS = Chain(
    [1.0, 0.7, 0.4], [0.8, 0.5, 0.6], damping=[0.02, 0.01, 0.03], centres=[0.5, 0.2, 0.3],
    inertias=[0.02, 0.0, 0.01], armature=[0.01, 0.0, 0.02],
)  # fmt: skip
BOBS = Chain([1.0, 0.5], [1.0, 0.4], gravity=9.5, damping=[0.05, 0.0])
CHAINS = {
    "bob": Chain.uniform(1),
    "bobs": BOBS,
    "five bobs": Chain(np.linspace(1.0, 0.4, 5), np.linspace(0.6, 1.1, 5)),
    "links": LINKS,
    "cart": Chain.from_dict(LINKS.as_dict() | {"base": Cart(1.5, 0.3)}),
    "springs": Chain.from_dict(BOBS.as_dict() | {"stiffness": 2000.0, "axial_damping": 1.0}),
    "springs on a cart": Chain([1.0, 0.5], 1.0, stiffness=500.0, base=Cart(2.0)),
    "a rotor on the base with a gear": Chain([1.0, 0.5], 1.0, armature=[0.1, 0.0], gear=[6.0, 3.0]),
}


def model_of(chain, **options):
    return mujoco.MjModel.from_xml_string(chain.to_mjcf(**options))


def in_mujoco(model, coordinates, control=()):
    """Return MuJoCo's coordinates after 2 s."""
    data = mujoco.MjData(model)
    data.qpos[:], data.ctrl[:] = coordinates, control
    mujoco.mj_step(model, data, nstep=round(SECONDS / model.opt.timestep))
    return data.qpos.copy()


def coordinates_of(chain, theta, position, stretch):
    """Return what MuJoCo has for a state: the cart, then angle and stretch of each joint."""
    angles = np.diff(theta, prepend=0.0)
    rods = angles if stretch is None else np.stack([angles, stretch], -1).ravel()
    return rods if chain.base is None else np.r_[position, rods]


@pytest.mark.parametrize("name", CHAINS)
def test_motions_of_mujoco_are_those_of_simulate(name):
    chain = CHAINS[name]
    theta, springs = np.linspace(1.2, 0.7, chain.n), chain.stiffness is not None
    started = {"stretch": np.full(chain.n, 0.01)} if springs else {}
    motors = (0, chain.n) if chain.base is not None else (0,)
    control = np.array([0.3, -0.8])[: len(motors)]
    driven = {"force": control[1]} if chain.base is not None else {}
    driven |= {"torque": control[0]} | started
    motion = simulate(chain, theta, 0.0, [0.0, SECONDS], rtol=1e-12, atol=1e-13, **driven)
    first, last = (
        coordinates_of(
            chain, motion.theta[k],
            motion.position[k] if chain.base is not None else 0.0,
            motion.stretch[k] if springs else None,
        )
        for k in (0, 1)
    )  # fmt: skip
    found = in_mujoco(model_of(chain, motors=motors, timestep=1e-4), first, control)
    print(f"{name}: {abs(found - last).max():.1e}")
    np.testing.assert_allclose(found, last, rtol=0.0, atol=1e-9)
    assert abs(last - first).max() > 0.1
    by_default = simulate(chain, theta, 0.0, [0.0, SECONDS], **driven)
    np.testing.assert_allclose(by_default.theta[-1], motion.theta[-1], rtol=0.0, atol=1e-6)


def test_no_body_has_the_name_of_another_and_a_digit_where_joints_are_two():
    """Drake names the bodies between the joints of one so: "link1" would be "link10", too."""
    for n in (10, 11, 120):
        bodies = ET.fromstring(Chain(np.ones(n), 1.0, stiffness=500.0).to_mjcf()).iter("body")
        names = [body.get("name") for body in bodies]
        assert not {f"{name}{k}" for name in names for k in range(10)} & set(names)
    assert model_of(Chain(np.ones(12), 1.0)).body("link11").id == 12


@pytest.mark.parametrize("name", CHAINS)
def test_no_joint_is_without_armature_which_genesis_would_replace_by_a_large_one(name):
    chain = CHAINS[name]
    armature = model_of(chain).dof_armature
    assert np.all(armature > 0.0)
    assert armature.max() <= max(chain.armature.max(), 1e-12)


def test_bodies_stand_where_the_bobs_are():
    model = model_of(CHAINS["cart"])
    data, theta = mujoco.MjData(model), np.array([0.3, -1.0, 2.0])
    data.qpos[:] = np.r_[0.4, np.diff(theta, prepend=0.0)]
    mujoco.mj_forward(model, data)
    x, z = 0.4 + np.cumsum(LINKS.lengths * np.sin(theta)), -np.cumsum(LINKS.lengths * np.cos(theta))
    np.testing.assert_allclose(data.body("link2").xpos, [x[1], 0.0, z[1]], atol=1e-12)
    assert model.body("link1").mass == LINKS.masses[1]


def test_dry_friction_is_that_of_mujoco_which_holds_a_joint_at_rest():
    chain = Chain(1.0, [1.0, 1.0], friction=0.3, friction_speed=0.01)
    still = in_mujoco(model_of(chain), [0.01, 0.0])
    assert abs(still - [0.01, 0.0]).max() < 1e-6
    theta = simulate(chain, [1.0, 1.0], 0.0, [0.0, SECONDS]).theta[-1]
    np.testing.assert_allclose(np.cumsum(in_mujoco(model_of(chain), [1.0, 0.0])), theta, atol=0.03)


@pytest.mark.long
def test_a_bob_creeps_as_far_as_the_docstring_says():
    chain = Chain(1.0, [1.0], friction=2.0)
    usual = mujoco.MjModel.from_xml_string(re.sub('solimpfriction=.*?" ', "", chain.to_mjcf()))
    for model, after in ((model_of(chain), 0.0999), (usual, 0.0538)):
        data = mujoco.MjData(model)
        data.qpos[:] = 0.1
        mujoco.mj_step(model, data, nstep=60_000)
        np.testing.assert_allclose(data.qpos, after, rtol=0.0, atol=1e-4)
    theta = simulate(chain, 0.1, 0.0, [0.0, 1.0]).theta[-1]
    np.testing.assert_allclose(theta, 0.0767, rtol=0.0, atol=1e-4)


def test_motors_have_their_joints_and_limits():
    chain = CHAINS["cart"]
    model = model_of(chain, motors=(3, 1), limits=[5.0, 2.0], timestep=0.004)
    assert [model.joint(k).name for k in model.actuator_trnid[:, 0]] == ["cart", "joint1"]
    np.testing.assert_array_equal(model.actuator_ctrlrange, [[-5.0, 5.0], [-2.0, 2.0]])
    assert model.opt.timestep == 0.004
    assert model_of(chain).nu == 0
    np.testing.assert_array_equal(model_of(chain, motors=(0,)).actuator_ctrllimited, [0])


@pytest.mark.parametrize("keywords", [
    {"drag": 0.1}, {"quadratic_drag": [0.0, 0.1]}, {"gear": 6.0, "armature": 0.1},
])  # fmt: skip
def test_what_mujoco_does_not_know_is_refused_by_its_name(keywords):
    name = next(iter(keywords))
    with pytest.raises(ValueError, match=f"^{name} must be left out: MuJoCo has no such"):
        to_mjcf(Chain(1.0, [1.0, 1.0], **keywords))


def test_terms_that_a_format_lacks_are_dropped_where_the_user_says_so_and_this_is_said(
    tmp_path, capsys
):
    dragged = Chain.from_dict(LINKS.as_dict() | {"quadratic_drag": 0.01, "drag": 0.02})
    file, out = tmp_path / "fit.json", tmp_path / "chain.xml"
    file.write_text(json.dumps(dragged.as_dict()))
    words = ["export", "--chain", str(file), "--to", "mjcf", "-o", str(out)]
    for more, message in (
        ([], "drag and quadratic_drag must be left out: MuJoCo has no such thing"),
        (["--drop", "drag"], "quadratic_drag must be left out: MuJoCo has no such thing"),
        (["--drop", "damping"], "drop, with --to mjcf, must be one of drag, quadratic_drag, gear"),
    ):
        with pytest.raises(SystemExit):
            main([*words, *more])
        assert message in capsys.readouterr().err.splitlines()[-1]
        assert not out.exists()
    assert main([*words, "--drop", "quadratic_drag,drag"]) == 0
    said = capsys.readouterr().err.splitlines()
    assert [line.partition(" = ")[0] for line in said] == [
        "npend export: drops quadratic_drag", "npend export: drops drag"
    ]  # fmt: skip
    assert out.read_text() == to_mjcf(LINKS)


@pytest.mark.parametrize(("options", "error", "message"), [
    ({"motors": (2,)}, ValueError, "a motor must be between 0 and 1, got 2"),
    ({"motors": (0, 0)}, ValueError, r"motors must be at different joints, got \[0, 0\]"),
    ({"motors": 0}, TypeError, r"motors must be a list such as \[0\], got 0"),
    ({"motors": None}, TypeError, r"motors must be a list such as \[0\], got None"),
    ({"limits": 5.0}, ValueError, "limits must be left out without motors, got 5"),
    ({"motors": (0,), "limits": 0.0}, ValueError, "limits must be greater than zero"),
    ({"timestep": 0.0}, ValueError, "timestep must be greater than zero"),
    ({"timestep": 1e30}, ValueError, r"timestep must be at most 1 s, got 1e\+30"),
])  # fmt: skip
def test_wrong_options_of_a_model_are_refused_by_name(options, error, message):
    with pytest.raises(error, match=message):
        to_mjcf(Chain.uniform(2), **options)


def test_the_longest_chain_that_mujoco_reads_is_written_and_a_longer_one_is_refused():
    for base in (None, Cart(1.0)):
        rods = 496 - (base is not None)
        assert model_of(Chain.uniform(rods, base=base)).njnt == 496
        with pytest.raises(ValueError, match="bodies in MuJoCo must be between 1 and 496, got 497"):
            to_mjcf(Chain.uniform(rods + 1, base=base))


def test_the_command_writes_the_model(tmp_path):
    out = tmp_path / "chain.xml"
    options = ["export", "--chain", "acrobot", "--to", "mjcf", "--out", str(out)]
    assert main([*options, "--motors", "1", "--limits", "1.5"]) == 0
    assert out.read_text() == to_mjcf(Chain.preset("acrobot"), (1,), 1.5)


@pytest.mark.parametrize("write", [to_mjcf, to_urdf, to_sdf, to_usd])
@pytest.mark.parametrize("path", ["arm.xml", Path("arm.xml")])
def test_a_function_that_returns_a_text_says_how_to_write_it_where_it_is_given_a_path(write, path):
    way = rf"write it by Path\('arm.xml'\).write_text\({write.__name__}\(chain\)\)"
    with pytest.raises(TypeError, match=way):
        write(Chain.uniform(2), path)
