"""Chains as robots in URDF: their mass matrix and forces by Pinocchio."""

import csv
import json
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from npend_gym import Cart, Chain
from npend_gym.cli import main
from npend_gym.export import from_urdf, readers, to_urdf
from npend_gym.physics import accelerations, mass_matrix

ROOT = Path(__file__).parent.parent
CHAINS = {
    "bobs": Chain([1.0, 0.5, 0.7], [1.0, 0.4, 0.8]),
    "links": Chain([1.0, 0.7], [0.8, 0.5], centres=[0.5, -0.2], inertias=[0.02, 0.0]),
    "cart": Chain([1.0, 0.7], [0.8, 0.5], centres=[0.5, 0.2], inertias=0.02, base=Cart(1.5)),
    "a motor on the base": Chain([1.0, 0.7], [0.8, 0.5], armature=[0.3, 0.0], gear=5.0),
}


@pytest.mark.parametrize("name", CHAINS)
def test_mass_matrix_and_accelerations_of_pinocchio_are_those_of_the_chain(name):
    pin = pytest.importorskip("pinocchio", reason="Pinocchio is not installed")
    chain, rng = CHAINS[name], np.random.default_rng(0)
    n, on_cart = chain.n, int(chain.base is not None)
    theta, omega = rng.uniform(-3.0, 3.0, n), rng.normal(size=n)
    model = pin.buildModelFromXML(to_urdf(chain))
    data = model.createData()
    angles = np.diff(theta, prepend=0.0)
    q = np.r_[[0.3] * on_cart, np.stack([np.cos(angles), np.sin(angles)], -1).ravel()]
    # Velocities of (theta, position) from those of Pinocchio, (position, joints)
    turns = np.zeros((n + on_cart,) * 2)
    turns[:n, on_cart:] = np.tri(n)
    turns[n:, :on_cart] = 1.0
    ours = turns.T @ mass_matrix(chain, theta) @ turns
    upper = np.triu(pin.crba(model, data, q))
    np.testing.assert_allclose(upper, np.triu(ours), rtol=1e-12, atol=1e-12 * abs(ours).max())
    model.gravity.linear = np.array([0.0, 0.0, -chain.gravity])
    speeds = np.r_[[0.7] * on_cart, np.diff(omega, prepend=0.0)]
    found = turns @ pin.aba(model, data, q, speeds, np.zeros(n + on_cart))
    expected = accelerations(chain, theta, omega)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


LIGHT = {
    "100 g on 50 cm": Chain.uniform(2, mass=0.1, length=0.5),
    "0.1 g on 5 cm": Chain.uniform(3, mass=1e-4, length=0.05),
    "a light cart": Chain.uniform(2, mass=0.01, length=0.1, base=Cart(1e-3)),
    "losses": Chain.uniform(2, mass=0.1, length=0.5, damping=0.01),
}


@pytest.mark.parametrize("name", [*CHAINS, *LIGHT])
def test_mujoco_reads_light_links_and_accelerates_them_as_the_chain(name):
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    chain, rng = (CHAINS | LIGHT)[name], np.random.default_rng(0)
    model = mujoco.MjModel.from_xml_string(to_urdf(chain))
    data, carts = mujoco.MjData(model), int(chain.base is not None)
    for _ in range(20):
        theta, omega = rng.uniform(-3.0, 3.0, chain.n), rng.normal(size=chain.n)
        data.qpos[carts:] = np.diff(theta, prepend=0.0)
        data.qvel[carts:] = np.diff(omega, prepend=0.0)
        mujoco.mj_forward(model, data)
        found = np.append(np.cumsum(data.qacc[carts:]), data.qacc[:carts])
        expected = accelerations(chain, theta, omega)
        # MuJoCo takes 2e-14 kg m^2 for the inertia of a bob of 2.5e-7 kg m^2
        within = 1e-5 if "0.1 g" in name else 1e-7
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=within * abs(expected).max())


def test_the_root_is_the_world_which_drake_dart_and_genesis_hold():
    for chain in CHAINS.values():
        root = ET.fromstring(chain.to_urdf())
        children = {each.get("link") for each in root.iter("child")}
        assert [
            each.get("name") for each in root.iterfind("link") if each.get("name") not in children
        ] == ["world"]


def test_losses_and_the_cart_stand_in_the_file():
    chain = Chain(1.0, [1.0, 2.0], damping=[0.1, 0.2], friction=0.3, base=Cart(2.0, 0.4))
    root = ET.fromstring(chain.to_urdf())
    joints = {joint.get("name"): joint for joint in root.iter("joint")}
    assert [joint.get("type") for joint in joints.values()] == ["prismatic"] + ["continuous"] * 2
    assert joints["joint1"].find("dynamics").attrib == {"damping": "0.2", "friction": "0.3"}
    assert joints["cart"].find("dynamics").get("damping") == "0.4"
    assert joints["joint1"].find("origin").get("xyz") == "0.0 0.0 -1.0"


@pytest.mark.parametrize("keywords", [
    {"drag": 0.1}, {"quadratic_drag": 0.1}, {"armature": 0.1}, {"stiffness": 100.0},
])  # fmt: skip
def test_what_urdf_does_not_know_is_refused_by_its_name(keywords):
    (name,) = keywords
    with pytest.raises(ValueError, match=f"^{name} must be left out: URDF has no such thing"):
        to_urdf(Chain(1.0, [1.0, 1.0], **keywords))


def test_armature_is_dropped_where_a_user_says_so_but_that_of_the_base_stays(tmp_path, capsys):
    file, out = tmp_path / "chain.json", tmp_path / "chain.urdf"
    given = {"masses": [1.0, 1.0], "lengths": 1.0}
    file.write_text(json.dumps(Chain(**given, armature=[0.3, 0.1]).as_dict()))
    words = ["export", "--chain", str(file), "--to", "urdf", "-o", str(out), "--drop", "armature"]
    assert main(words) == 0
    assert "drops armature = [0.3, 0.1]" in capsys.readouterr().err
    assert out.read_text() == to_urdf(Chain(**given, armature=[0.3, 0.0]))


def test_the_command_says_what_an_engine_loses_of_this_chain_and_how_to_mend_it(tmp_path, capsys):
    file, out = tmp_path / "chain.json", str(tmp_path / "out")
    chain = Chain([1.0, 1.0], 1.0, 3.7, damping=0.1, armature=[0.0, 0.1], inertias=0.1)
    file.write_text(json.dumps(chain.as_dict()))
    words = ["export", "--chain", str(file), "--for"]
    assert main([*words, "drake", "--to", "mjcf", "-o", out + ".xml"]) == 0
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("npend export: drake needs for the armature of this one: plant.AddJoint")
    urdf = ["--to", "urdf", "-o", out + ".urdf", "--drop", "armature"]
    assert main([*words, "pinocchio", *urdf]) == 0
    said = capsys.readouterr().err
    assert "for the gravity of this one: model.gravity.linear = numpy.array([0, 0, -g])" in said
    assert "for the damping of this one: tau -= model.damping * v" in said
    for engine, message in (("mjx", "mjx must have --to mjcf"), ("ode", "the engine must be one")):
        with pytest.raises(SystemExit):
            main([*words, engine, *urdf])
        assert message in capsys.readouterr().err


def test_each_property_that_an_engine_loses_has_a_line_that_mends_it_or_says_that_none_does():
    path = ROOT / "benchmarks" / "results" / "engines_read.csv"
    rows = csv.DictReader(path.read_text().splitlines())
    known = {"MuJoCo Warp": "mujoco_warp"}
    for row in rows:
        engine = known.get(row["engine"], row["engine"].lower())
        assert engine in readers.ENGINES
        name = row["property"].split()[0]
        lines = [
            line for (program, kind, about), line in readers.MENDS.items()
            if program == engine and kind in ("", row["format"]) and about in ("any", name)
        ]  # fmt: skip
        if row["as_it_is"] not in ("kept", "not in the format"):
            assert lines, row
        if row["mended"] not in ("kept", ""):
            assert any("no line" in line or "tau" in line for line in lines), row


@pytest.mark.long
def test_the_command_writes_the_robot(tmp_path):
    out = str(tmp_path / "chain.urdf")
    assert main(["export", "--chain", "multiarm 2", "--to", "urdf", "--out", out]) == 0
    assert (tmp_path / "chain.urdf").read_text() == to_urdf(Chain.preset("multiarm 2"))


BY_HAND = """
<robot name="arm">
  <link name="base"><inertial><mass value="9"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0"
    izz="0"/></inertial></link>
  <link name="upper"><inertial><origin xyz="0.2 0 0"/><mass value="2"/><inertia ixx="0.1" ixy="0"
    ixz="0" iyy="0.1" iyz="0" izz="0.03"/></inertial>
    <visual><geometry><mesh filename="package://none/arm.stl"/></geometry></visual>
    <collision><geometry><sphere radius="3"/></geometry></collision></link>
  <link name="lower"><inertial><origin xyz="0 0.3 0"/><mass value="1"/><inertia ixx="0" ixy="0"
    ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link>
  <link name="tool"><inertial><mass value="0.5"/><inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02"
    iyz="0" izz="0.02"/></inertial></link>
  <joint name="held" type="fixed"><parent link="world"/><child link="base"/></joint>
  <joint name="a" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
    <origin xyz="0 0 1" rpy="1.5707963267948966 0 0"/><limit lower="-2" upper="2" effort="3"
    velocity="9"/><dynamics damping="0.1" friction="0.2"/></joint>
  <joint name="b" type="continuous"><parent link="upper"/><child link="lower"/><axis xyz="0 0 -1"/>
    <origin xyz="0.7 0 0"/></joint>
  <joint name="c" type="fixed"><parent link="lower"/><child link="tool"/><origin xyz="0 0.6 0"/>
  </joint>
</robot>
"""


def test_a_robot_of_drake_s_kind_is_read_without_its_meshes():
    pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    with pytest.warns(UserWarning, match=r"ranges of joint 'a' from -2 to 2 rad$"):
        chain = from_urdf(BY_HAND)
    np.testing.assert_allclose(chain.masses, [2.0, 1.5])
    np.testing.assert_allclose(chain.lengths, [0.7, 0.4])
    np.testing.assert_allclose(chain.centres, [0.2, 0.4])
    # Of the tool itself, and by the parallel axis theorem 1 kg at 0.1 m, 0.5 kg at 0.2 m
    np.testing.assert_allclose(chain.inertias, [0.03, 0.02 + 0.01 + 0.02])
    assert (chain.damping.tolist(), chain.friction.tolist()) == ([0.1, 0.0], [0.2, 0.0])
    assert (chain.gravity, chain.base) == (9.81, None)
    bob = BY_HAND.replace('iyy="0.02"', 'iyy="0"').replace('value="0.5"', 'value="0"')
    with pytest.warns(UserWarning, match="ranges"):
        point = Chain.from_urdf(bob.replace('"0.02"', '"0"'))
    assert (point.masses[1], point.inertias[1], point.centres[1]) == (1.0, 0.0, point.lengths[1])


@pytest.mark.parametrize("name", [*CHAINS, *LIGHT])
def test_what_to_urdf_writes_is_read_back(name, tmp_path):
    pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    chain, path = (CHAINS | LIGHT)[name], tmp_path / "chain.urdf"
    path.write_text(chain.to_urdf())
    found = from_urdf(path)
    given = chain.inertias + np.r_[chain.armature[0], np.zeros(chain.n - 1)]
    np.testing.assert_allclose(found.inertias, given, rtol=1e-12, atol=0.0)
    np.testing.assert_allclose(found.lengths[:-1], chain.lengths[:-1])
    np.testing.assert_allclose(found.centres, [*chain.centres[:-1], abs(chain.centres[-1])])
    for key in ("masses", "damping", "friction"):
        np.testing.assert_allclose(getattr(found, key), getattr(chain, key), rtol=1e-12)
    assert found.base == chain.base


@pytest.mark.parametrize(("source", "message"), [
    ("<mujoco/>", "source must be URDF, whose root is <robot>, got <mujoco>"),
    ("<robot", "source must be XML: "),
    ("none.urdf", "source must be XML or a file of it, got 'none.urdf'"),
    (BY_HAND.replace('"0 0 -1"', '"0 1 0"'), "joint 'b' must be parallel to joint 'a'"),
])  # fmt: skip
def test_what_is_no_chain_in_urdf_is_refused(source, message):
    pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    with pytest.raises(ValueError, match=message):
        from_urdf(source)
