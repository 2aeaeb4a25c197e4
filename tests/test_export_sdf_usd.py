"""Chains as worlds in SDF, by Drake, and as stages of USD, by MuJoCo."""

from xml.etree import ElementTree as ET

import numpy as np
import pytest
from test_export_urdf import CHAINS, LIGHT

from npend_gym import Cart, Chain
from npend_gym.cli import main
from npend_gym.export import readers, to_sdf, to_usd
from npend_gym.physics import accelerations

MACHINE = Chain(
    [1.0, 0.7], [0.8, 0.5], 3.7, damping=[0.1, 0.2], centres=[0.5, 0.2], inertias=0.02,
    base=Cart(1.5, 0.4),
)  # fmt: skip


def agrees(chain, read, within):
    """Whether accelerations `read(q, v)` of joints, the cart first, are those of a chain."""
    rng, carts = np.random.default_rng(0), int(chain.base is not None)
    for _ in range(20):
        theta, omega, speed = rng.uniform(-3.0, 3.0, chain.n), rng.normal(size=chain.n), 0.7
        q, v = (np.r_[[0.3] * carts, np.diff(theta, prepend=0.0)],
                np.r_[[speed] * carts, np.diff(omega, prepend=0.0)])  # fmt: skip
        found = np.asarray(read(q, v))
        found = np.append(np.cumsum(found[carts:]), found[:carts])
        moving = {"velocity": speed} if carts else {}
        expected = accelerations(chain, theta, omega, **moving)
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=within * abs(expected).max())


@pytest.mark.parametrize("name", [*CHAINS, *LIGHT, "machine"])
def test_drake_reads_the_world_and_accelerates_it_as_the_chain(name):
    every = pytest.importorskip("pydrake.all", reason="Drake is not installed")
    chain = (CHAINS | LIGHT | {"machine": MACHINE})[name]
    plant = every.MultibodyPlant(0.0)
    every.Parser(plant).AddModelsFromString(to_sdf(chain), "sdf")
    plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, -chain.gravity])
    plant.Finalize()
    context = plant.CreateDefaultContext()

    def read(q, v):
        plant.SetPositionsAndVelocities(context, np.r_[q, v])
        return plant.EvalTimeDerivatives(context).CopyToVector()[len(q) :]

    # of a bob of 2.5e-7 kg m^2 the format has 2e-14 kg m^2 more
    agrees(chain, read, 1e-6 if "0.1 g" in name else 1e-8)


@pytest.mark.parametrize("name", [*CHAINS, *LIGHT, "machine", "rotors"])
def test_mujoco_reads_the_stage_and_accelerates_it_as_the_chain(name, tmp_path):
    pytest.importorskip("mujoco._usd", reason="mujoco-usd is not installed")
    import mujoco

    rotors = Chain(1.0, [1.0, 0.5], armature=[0.1, 0.2], inertias=0.1)
    named = CHAINS | LIGHT | {"machine": MACHINE, "rotors": rotors}
    chain, path = named[name], tmp_path / "chain.usda"
    path.write_text(to_usd(chain))
    model = mujoco.MjSpec.from_file(str(path)).compile()
    data = mujoco.MjData(model)

    def read(q, v):
        data.qpos[:], data.qvel[:] = q, v
        mujoco.mj_forward(model, data)
        return data.qacc

    # numbers of USD are in float32; of bobs of 0.1 g MuJoCo raises the inertia
    agrees(chain, read, 1e-5 if "0.1 g" in name else 1e-6)


def test_the_world_has_gravity_losses_and_names_that_are_unique():
    root = ET.fromstring(MACHINE.to_sdf())
    assert root.findtext("world/gravity") == "0.0 0.0 -3.7"
    joints = {joint.get("name"): joint for joint in root.iter("joint")}
    damping = [float(each.findtext("axis/dynamics/damping")) for each in joints.values()]
    assert [*joints] == ["cart", "joint0", "joint1"]
    assert damping == [0.4, 0.1, 0.2]
    links = [link.get("name") for link in root.iter("link")]
    assert not {*links} & {*joints}  # SDF has one set of names
    heights = [link.findtext("pose").split()[2] for link in root.iter("link")]
    assert heights == ["0.0", "0.0", "-0.8"]  # in the frame of the model


def test_the_stage_has_gravity_and_damping_by_degrees():
    text = MACHINE.to_usd()
    assert "float physics:gravityMagnitude = 3.7\n" in text
    damping = [line.split()[-1] for line in text.splitlines() if "newton:damping" in line]
    assert [float(each) for each in damping] == pytest.approx([0.4, *np.radians([0.1, 0.2])])
    assert text.count("{") == text.count("}")


@pytest.mark.parametrize(
    ("write", "keywords"),
    [
        *((to_sdf, {name: 0.1}) for name in ("drag", "quadratic_drag", "armature", "stiffness")),
        *((to_usd, {name: 0.1}) for name in ("drag", "quadratic_drag", "stiffness")),
        (to_usd, {"gear": 5.0, "armature": 0.1}),
    ],
)
def test_what_a_format_does_not_know_is_refused_by_its_name(write, keywords):
    name, kind = next(iter(keywords)), write.__name__.removeprefix("to_").upper()
    with pytest.raises(ValueError, match=f"^{name} must be left out: {kind} has no such thing"):
        write(Chain(1.0, [1.0, 1.0], **keywords))


@pytest.mark.parametrize(
    ("to", "suffix", "write"), [("sdf", "sdf", to_sdf), ("usd", "usda", to_usd)]
)
def test_the_command_writes_the_file_without_what_is_dropped(to, suffix, write, tmp_path, capsys):
    out, file = tmp_path / f"chain.{suffix}", tmp_path / "chain.json"
    plain = Chain([1.0, 1.0], 1.0)
    file.write_text('{"masses": [1.0, 1.0], "lengths": 1.0, "drag": 0.1}')
    words = ["export", "--chain", str(file), "--to", to, "-o", str(out), "--drop", "drag"]
    assert main(words) == 0
    assert "drops drag = [0.1, 0.1]" in capsys.readouterr().err
    assert out.read_text() == write(plain)


def test_an_engine_that_does_not_read_a_format_says_which_it_reads():
    with pytest.raises(ValueError, match="drake must have --to mjcf or urdf or sdf, got usd"):
        readers.advice("drake", "usd", MACHINE)
    (line,) = readers.advice("drake", "sdf", MACHINE)
    assert "for the gravity of this one: plant.mutable_gravity_field()" in line
    assert readers.advice("newton", "usd", MACHINE) == []
