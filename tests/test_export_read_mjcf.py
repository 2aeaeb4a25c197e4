"""Models of MuJoCo as chains, whose mass matrix and accelerations are compared."""

import importlib.util
import re
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from npend_gym import Cart, Chain
from npend_gym.chain import PRESETS
from npend_gym.export import from_mjcf
from npend_gym.physics import accelerations, mass_matrix

mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed")

ARM = """
<mujoco>
  <compiler angle="degree"/>
  <option gravity="0 0 -9.7"><flag contact="disable"/></option>
  <default>
    <joint axis="0 1 0" damping="0.02"/>
    <geom type="capsule" size="0.03" density="700"/>
    <default class="upper"><joint armature="0.01" damping="0.05"/></default>
  </default>
  <worldbody>
    <body name="stand" pos="0.5 0 1"><geom type="box" size="0.1 0.1 0.5"/>
      <body name="a" pos="0 0.1 0.6" childclass="upper">
        <joint name="shoulder"/><geom fromto="0 0 0 0 0 0.5"/>
        <body name="b" pos="0 0.08 0.5" euler="0 30 0">
          <joint name="elbow" axis="0 -1 0"/><geom fromto="0 0 0 0 0 0.4"/>
          <body name="c" pos="0 0 0.4">
            <joint name="wrist"/><geom name="rod" fromto="0 0 0 0.2 0 0.1" mass="0.2"/>
            <geom name="knob" type="sphere" pos="0.2 0 0.1" mass="0.1"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="elbow" gear="1"/></actuator>
</mujoco>
"""
ON_CART = """
<mujoco>
  <option gravity="3 0 -9"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="sledge"><joint name="rail" type="slide" axis="3 0 1" damping="0.7" armature="0.2"/>
      <geom type="box" size="0.2 0.1 0.1" mass="1.5"/>
      <body name="pole" euler="0 20 0"><joint name="hinge" axis="0 2 0"/>
        <geom type="cylinder" fromto="0 0 0 0 0 0.7" size="0.02" mass="0.4"/>
        <body name="second" pos="0 0 0.7"><joint name="knee" axis="0 1 0"/>
          <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="0.2"/></body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


PASSIVE_MOTOR = """<actuator>
<dcmotor name="p" joint="elbow" input="none" motorconst="0.5" resistance="0.2"/>"""
TOOL = '<body pos=".1 0 .05"><geom fromto="0 0 0 0.1 0 .05"/></body>'


def check_dynamics(model, chain):
    """Compare mass matrix and accelerations in random states; angles are found by where bodies are.

    MuJoCo's velocities are those of a cart, then of the joints, with the signs of their axes.
    """
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    n, carts = chain.n, int(chain.base is not None)
    mujoco.mj_kinematics(model, data)
    axis = data.xaxis[carts]
    gravity = model.opt.gravity - (model.opt.gravity @ axis) * axis
    if not chain.gravity:  # any direction in the plane may be below
        gravity = np.cross(axis, np.roll(axis, 1))
    gravity /= np.linalg.norm(gravity)
    for _ in range(20):
        data.qpos[:], data.qvel[:] = rng.uniform(-3.0, 3.0, n + carts), rng.normal(size=n + carts)
        mujoco.mj_forward(model, data)
        first = data.xaxis[carts]
        right = np.cross(first, gravity)
        bodies = model.jnt_bodyid[carts:]
        along = np.diff(data.xanchor[carts:], axis=0, append=0.0)
        along[-1] = data.subtree_com[bodies[-1]] - data.xanchor[-1]
        theta = np.arctan2(along @ right, along @ gravity)
        turns = np.zeros((n + carts,) * 2)  # rates of (theta, position) from MuJoCo's
        turns[:n, carts:] = np.tri(n) * np.sign(data.xaxis[carts:] @ first)
        turns[n:, :carts] = data.xaxis[0] @ right
        speeds, inertia = turns @ data.qvel, np.empty((model.nv, model.nv))
        for row, unit in zip(inertia, np.eye(model.nv), strict=True):
            mujoco.mj_mulM(model, data, row, unit)
        ours = turns.T @ mass_matrix(chain, theta) @ turns
        np.testing.assert_allclose(inertia, ours, rtol=1e-9, atol=1e-9 * abs(ours).max())
        given = {"velocity": speeds[n]} if carts else {}
        expected = accelerations(chain, theta, speeds[:n], **given)
        np.testing.assert_allclose(turns @ data.qacc, expected, rtol=1e-7, atol=1e-7)


# All presets but those with gears, which MuJoCo does not know
CHAINS = {name: Chain.preset(name) for name in PRESETS if not name.startswith("realaigym")} | {
    "bobs": Chain([1.0, 0.5, 0.7], [1.0, 0.4, 0.8], 9.5, damping=[0.1, 0.0, 0.2]),
    "many bobs on a cart": Chain.uniform(30, base=Cart(2.0, 0.1)),
    "links": Chain(
        [1.0, 0.7, 0.4], [0.8, 0.5, 0.6], centres=[0.5, -0.2, 0.9], inertias=[0.02, 0.0, 0.01],
        armature=[0.01, 0.0, 0.02], friction=0.1, damping=0.3,
    ),
    "a last link above its joint": Chain([1.0, 1.0], 1.0, centres=[0.0, -0.3], inertias=0.1),
    "without gravity": Chain.uniform(2, gravity=0.0),
}  # fmt: skip


@pytest.mark.parametrize("name", CHAINS)
def test_what_to_mjcf_writes_is_read_back(name, tmp_path):
    chain, path = CHAINS[name], tmp_path / "chain.xml"
    path.write_text(chain.to_mjcf(motors=[0]))
    for found in (Chain.from_mjcf(chain.to_mjcf()), from_mjcf(path), chain.from_mjcf(str(path))):
        given, read = chain.as_dict(), found.as_dict()
        assert read.keys() == given.keys()
        for key in given.keys() - {"base"}:
            np.testing.assert_allclose(read[key], given[key], rtol=1e-12, atol=1e-14, err_msg=key)
        assert found.base == chain.base
        np.testing.assert_array_equal(found.has_bobs, chain.has_bobs)


@pytest.mark.parametrize("text", [ARM, ON_CART], ids=["arm", "cart"])
def test_dynamics_of_a_model_written_by_hand_are_those_of_its_chain(text):
    model = mujoco.MjModel.from_xml_string(text)
    check_dynamics(model, from_mjcf(text))


def test_numbers_of_a_model_written_by_hand():
    chain = from_mjcf(ARM)
    np.testing.assert_allclose(chain.lengths, [0.5, 0.4, np.hypot(0.2, 0.1)])
    np.testing.assert_allclose(chain.centres[:2], [0.25, 0.2])
    volume = np.pi * 0.03**2 * (0.5 + 4.0 / 3.0 * 0.03)
    np.testing.assert_allclose(chain.masses, [700.0 * volume, chain.masses[1], 0.3])
    assert chain.damping.tolist() == [0.05, 0.05, 0.05]
    assert chain.armature.tolist() == [0.01, 0.01, 0.01]
    assert chain.gravity == pytest.approx(9.7)
    assert from_mjcf(ON_CART).base == Cart(1.7, 0.7)


def test_models_of_dm_control_are_read_from_their_files():
    spec = importlib.util.find_spec("dm_control")
    if spec is None:
        pytest.skip("dm_control is not installed")
    suite = Path(spec.origin).parent / "suite"
    found, known = from_mjcf(suite / "acrobot.xml"), Chain.preset("dm_control acrobot")
    for name in ("masses", "lengths", "damping", "centres", "inertias", "gravity"):
        np.testing.assert_allclose(getattr(found, name), getattr(known, name), rtol=1e-9)
    with pytest.warns(UserWarning, match=r"'slider' from -1\.8 to 1\.8 m \(rail=1\.8 of"):
        pole = from_mjcf(suite / "cartpole.xml")
    assert pole.base == Cart(1.0, 5e-4)


ASSETS = Path(gymnasium.__file__).parent / "envs" / "mujoco" / "assets"


@pytest.mark.parametrize(("name", "message"), [
    ("inverted_pendulum", r"joint 'slider' from -1 to 1 m .*, joint 'hinge' from -1.5708 to 1.57"),
    ("inverted_double_pendulum", r"joint 'slider' from -1 to 1 m"),
    ("reacher", r"joint 'joint1' from -3 to 3 rad$"),
])  # fmt: skip
def test_models_of_gymnasium_are_read_and_move_as_their_chains_within_the_ranges(
    name, message, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its warnings to a file
    path = ASSETS / f"{name}.xml"
    with pytest.warns(UserWarning, match=message):
        chain = from_mjcf(path)
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT.value
    if name == "inverted_double_pendulum":  # 1e-5 along the rail is rounding
        model.opt.gravity[:2] = 0.0
    if name == "reacher":  # without the target, which moves apart
        assert chain.gravity == 0.0
        text = re.sub(
            "<!-- Target -->.*</worldbody>", "</worldbody>", path.read_text(), flags=re.DOTALL
        )
        text = text.replace('limited="true"', 'limited="false"')
        model = mujoco.MjModel.from_xml_string(text)
    check_dynamics(model, chain)


@pytest.mark.parametrize(("old", "new", "message"), [
    ('<joint name="wrist"/>', '<joint name="wrist"/><joint/>', "body 'c' must have one joint, got"),
    ('<joint name="wrist"/>', '<joint type="ball" name="w"/>', "joint 'w' must be a hinge$"),
    ('<joint name="shoulder"/>', '<joint type="slide"/>', "joint number 0 must be perpendicular"),
    ('name="elbow" axis="0 -1 0"', 'name="elbow" axis="0 1 0.01"', "'elbow' must be parallel to"),
    ('axis="0 -1 0"', 'stiffness="2"', "joint 'elbow' must have no stiffness"),
    ("<actuator>", PASSIVE_MOTOR, "actuator 'p' must be a plain motor"),
    ('gravity="3 0 -9"', 'gravity="3.01 0 -9"', "joint 'rail' must be perpendicular to gravity"),
    ('gravity="0 0 -9.7"', 'density="1.2"', "density and no viscosity"),
    ('<flag contact="disable"/>', "", "geom .* and geom .* must not touch"),
    ('name="c" pos="0 0 0.4"', 'name="c" pos="0.01 0 0.4"', "body 'b' must have its centre of m"),
    ('name="c" pos="0 0 0.4"', 'name="c" pos="0 0.1 0"', "body 'b' must have a length"),
    ('name="c"', 'name="c" gravcomp="1"', "body 'c' must have no gravcomp"),
    ('<motor joint="elbow" gear="1"/>', '<position name="s" joint="elbow"/>', "actuator 's' must"),
    ('<motor joint="elbow" gear="1"/>', '<motor name="m" joint="elbow" damping="0 0.7"/>',
     "actuator 'm' must be a plain motor"),
    ("</worldbody>", '<body name="d"><joint/><geom fromto="0 0 0 0 0 1"/></body></worldbody>',
     "body 'd' must hang from body 'c': a chain has no branches"),
    ("<actuator>", '<equality><joint joint1="elbow"/></equality><actuator>', "no <equality>"),
    ("<actuator>", '<tendon><fixed><joint joint="wrist" coef="1"/></fixed></tendon><actuator>',
     "no <tendon>"),
    ("<mujoco>", "<mujoco><nothing/>", "MuJoCo cannot read the model"),
    ('armature="0.2"', 'frictionloss="0.2"', "joint 'rail' must have no frictionloss"),
    ('type="slide" axis="3 0 1"', 'type="slide" axis="1 0 0"', "joint 'rail' must be perpen"),
    ('"knee" axis="0 1 0"', '"knee" type="slide" axis="1 0 0"', "joint 'knee' must be a hinge$"),
])  # fmt: skip
def test_what_no_chain_has_is_refused_by_its_name(old, new, message):
    model = ARM if old in ARM else ON_CART
    assert old in model
    with pytest.raises(ValueError, match=message):
        from_mjcf(model.replace(old, new, 1))


def test_what_a_model_disables_is_not_in_the_chain():
    off = '<flag contact="disable" damper="disable" gravity="disable" limit="disable"/>'
    text = ARM.replace('<flag contact="disable"/>', off)
    chain = from_mjcf(text.replace('axis="0 -1 0"', 'range="-90 90"'))  # no warning
    assert (chain.gravity, chain.damping.max()) == (0.0, 0.0)


@pytest.mark.parametrize("text", [
    ARM.replace('gravity="0 0 -9.7"', 'gravity="1e-5 0.5 -9.7"'),  # 0.5 is along the hinges
    ARM.replace('gravity="0 0 -9.7"', 'gravity="0 9.7 0"'),
    ON_CART.replace('gravity="3 0 -9"', 'gravity="3 2 -9"'),
    ARM.replace('<joint name="wrist"/>', ""),  # c is part of b
    ARM.replace('name="wrist"/>', f'name="wrist"/>{TOOL}'),
], ids=["inclined", "horizontal", "rail", "fixed link", "fixed tool"])  # fmt: skip
def test_hinges_bear_gravity_along_them_and_fixed_bodies_are_part_of_links(text):
    model = mujoco.MjModel.from_xml_string(text)
    chain = from_mjcf(text)
    assert chain.n == model.nv - (chain.base is not None)
    check_dynamics(model, chain)


@pytest.mark.parametrize("name", ["bobs", "many bobs on a cart", "arm"])
def test_what_mujoco_saves_again_with_six_digits_is_read_with_its_bobs(name, tmp_path):
    text, path = ARM if name == "arm" else CHAINS[name].to_mjcf(), tmp_path / "saved.xml"
    if name != "arm" and mujoco.__version__ < "4":
        pytest.skip("MuJoCo 3 does not read the inertias of bobs that it saves")
    mujoco.mj_saveLastXML(str(path), mujoco.MjModel.from_xml_string(text))
    given, found = from_mjcf(text), from_mjcf(path)
    np.testing.assert_array_equal(found.has_bobs, given.has_bobs)
    for key in ("masses", "lengths", "centres", "inertias", "armature"):
        np.testing.assert_allclose(getattr(found, key), getattr(given, key), rtol=1e-5, atol=1e-9)


def test_a_controller_in_a_plugin_is_refused():
    for plugin in (Path(mujoco.__file__).parent / "plugin").glob("*actuator*"):
        mujoco.mj_loadPluginLibrary(str(plugin))
    pid = """<extension><plugin plugin="mujoco.pid"><instance name="pid"><config key="kp"
    value="40"/></instance></plugin></extension><worldbody>"""
    text = ARM.replace("<worldbody>", pid).replace(
        '<motor joint="elbow" gear="1"/>',
        '<plugin name="pid" joint="elbow" plugin="mujoco.pid" instance="pid"/>',
    )
    with pytest.raises(ValueError, match="actuator 'pid' must be a plain motor"):
        from_mjcf(text)


def test_an_elastic_body_is_refused():
    """MuJoCo 3 brings a plugin that acts on bodies, a cable; MuJoCo 4 brings none."""
    plugins = [*(Path(mujoco.__file__).parent / "plugin").glob("*elasticity*")]
    if not plugins:
        pytest.skip("this MuJoCo has no plugin of bodies")
    mujoco.mj_loadPluginLibrary(str(plugins[0]))
    cable = '<plugin plugin="mujoco.elasticity.cable"/>'
    text = ARM.replace("<worldbody>", f"<extension>{cable}</extension><worldbody>")
    text = text.replace('<joint name="elbow"', f'{cable}<joint name="elbow"')
    with pytest.raises(ValueError, match="body 'b' must have no plugin"):
        from_mjcf(text)


def test_what_does_not_act_is_no_reason_to_refuse():
    servo = ARM.replace("<motor joint", '<position kp="3" joint').replace(
        'contact="disable"', 'contact="disable" actuation="disable"'
    )
    grouped = ARM.replace("<motor joint", '<position group="3" kp="3" joint').replace(
        'gravity="0 0 -9.7"', 'gravity="0 0 -9.7" actuatorgroupdisable="3"'
    )
    equal = '<equality><joint joint1="elbow" {}/></equality><actuator>'
    inactive = ARM.replace("<actuator>", equal.format('active="false"'))
    disabled = ARM.replace("<actuator>", equal.format("")).replace(
        'contact="disable"', 'contact="disable" equality="disable"'
    )
    expected = from_mjcf(ARM).as_dict()
    for text in (servo, grouped, inactive, disabled):
        assert from_mjcf(text).as_dict() == expected


FLOOR = '<worldbody><geom name="floor" type="{}" pos="0 0 {}" size="1 1 1"/>'


@pytest.mark.parametrize(("kind", "height", "reaches"), [
    ("plane", -2.2, False), ("plane", -1.9, True), ("box", -4.0, False), ("box", -2.9, True),
])  # fmt: skip
def test_a_floor_out_of_reach_is_no_reason_to_refuse(kind, height, reaches):
    text = TOUCHING.format(flag='filterparent="enable"', third="", contact="")
    text = text.replace("<worldbody>", FLOOR.format(kind, height))
    if not reaches:
        assert from_mjcf(text).n == 2
        return
    with pytest.raises(ValueError, match=r"geom 'floor' and geom number \d must not"):
        from_mjcf(text)


@pytest.mark.parametrize(("height", "more", "reaches"), [
    (-2.0, "", False), (-1.0, "", True), (-2.0, "zaxis='1 0 3'", True),  # rises along the rail
])  # fmt: skip
def test_a_cart_may_be_above_a_floor_that_its_pole_does_not_reach(height, more, reaches):
    text = ON_CART.replace('gravity="3 0 -9"', 'gravity="0 0 -9"').replace("3 0 1", "1 0 0")
    text = text.replace('<geom contype="0" conaffinity="0"/>', "")
    text = text.replace("<worldbody>", FLOOR.format("plane", height))
    text = text.replace('size="1 1 1"', f'size="1 1 1" {more}').replace(
        "</mujoco>", '<contact><exclude body1="sledge" body2="second"/></contact></mujoco>'
    )
    if not reaches:
        assert from_mjcf(text).n == 2
        return
    with pytest.raises(ValueError, match=r"geom 'floor' and geom number \d must not"):
        from_mjcf(text)


TOUCHING = """<mujoco><option><flag {flag}/></option><worldbody><body name="a">
<joint axis="0 -1 0"/><geom type="capsule" fromto="0 0 0 0 0 -1" size=".05"/>
<body name="b" pos="0 0 -1">
<joint axis="0 -1 0"/><geom type="capsule" fromto="0 0 0 0 0 -1" size=".05"/>{third}
</body></body></worldbody>{contact}</mujoco>"""
THIRD = """<body name="c" pos="0 0 -1"><joint axis="0 -1 0"/>
<geom type="capsule" fromto="0 0 0 0 0 -1" size=".05"/></body>"""


def test_links_may_be_near_only_where_mujoco_lets_them_pass():
    usual, excluded = 'filterparent="enable"', '<contact><exclude body1="c" body2="a"/></contact>'
    assert from_mjcf(TOUCHING.format(flag=usual, third="", contact="")).n == 2
    assert from_mjcf(TOUCHING.format(flag=usual, third=THIRD, contact=excluded)).n == 3
    for flag, third in (('filterparent="disable"', ""), (usual, THIRD)):
        with pytest.raises(ValueError, match="must not touch"):
            from_mjcf(TOUCHING.format(flag=flag, third=third, contact=""))


def test_a_model_without_hinges_and_a_chain_with_springs_are_refused():
    with pytest.raises(ValueError, match="the model must have a hinge"):
        from_mjcf("<mujoco/>")
    springs = Chain([1.0, 0.5], 1.0, stiffness=500.0)
    with pytest.raises(ValueError, match="body 'link0' must have one joint, got 2"):
        from_mjcf(springs.to_mjcf())


def test_what_is_no_file_is_refused_before_mujoco_prints(capfd):
    for source in ("", ".", "no such file.xml"):
        with pytest.raises(ValueError, match=f"source must be XML or a file of it, got '{source}'"):
            from_mjcf(source)
    with pytest.raises(TypeError, match="source must be a string or path-like, got 3"):
        from_mjcf(3)
    assert capfd.readouterr() == ("", "")
