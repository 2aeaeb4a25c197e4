"""Chains as robots in URDF: their mass matrix and forces by Pinocchio."""

from xml.etree import ElementTree as ET

import numpy as np
import pytest

from npend_gym import Cart, Chain
from npend_gym.cli import main
from npend_gym.export import to_urdf
from npend_gym.physics import accelerations, mass_matrix

CHAINS = {
    "bobs": Chain([1.0, 0.5, 0.7], [1.0, 0.4, 0.8]),
    "links": Chain([1.0, 0.7], [0.8, 0.5], centres=[0.5, -0.2], inertias=[0.02, 0.0]),
    "cart": Chain([1.0, 0.7], [0.8, 0.5], centres=[0.5, 0.2], inertias=0.02, base=Cart(1.5)),
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


@pytest.mark.long
def test_the_command_writes_the_robot(tmp_path):
    out = str(tmp_path / "chain.urdf")
    assert main(["export", "--chain", "multiarm 2", "--to", "urdf", "--out", out]) == 0
    assert (tmp_path / "chain.urdf").read_text() == to_urdf(Chain.preset("multiarm 2"))
