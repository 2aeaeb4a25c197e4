"""Models of MuJoCo (MJCF) as chains: MuJoCo compiles the model, and its hinges are read."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym._extras import require
from npend_gym.chain import Cart, Chain
from npend_gym.export.mjcf import MIN_INERTIA, OF_NO_MOTOR, OF_POINT_MASS

_CLOSE = 1e-8  # of directions, and of lengths over the length of a link
_WITHOUT = {"neq": "equality", "ntendon": "tendon", "nflex": "flex", "npair": "pair"}


def from_mjcf(source: str | PathLike[str]) -> Chain:
    """Return the chain that a model of MuJoCo describes: hinges in a plane, perhaps on a cart.

    Each body has one hinge and hangs from the body before it; the first may have a slide, across
    gravity, and is the cart then. Bodies that are fixed to the world are part of it. The plane, the
    signs of the axes and the angles at rest are free: `theta` of the chain is zero where a link
    hangs. The last link ends where its longest capsule or cylinder does, or at its centre of mass;
    no motion depends on that.

    Parameters
    ----------
    source : str or path-like
        The model in XML, or its file.

    Returns
    -------
    Chain
        Plain motors are left out: see `actuated` of the environments.

    Raises
    ------
    ValueError
        If MuJoCo cannot read the model, or it has what no chain has: branches, other joints, axes
        that are not parallel, or centres of mass beside the line between two joints. Nor has a
        chain springs, limits, contacts, equalities, tendons, servos, or a fluid. The error names
        the element.
    ImportError
        If MuJoCo is not installed.

    Notes
    -----
    What `to_mjcf` writes is read back, but for rods that stretch, `gear`, and `friction_speed`,
    which MuJoCo does not know. An inertia up to ten times that of a point mass there is taken as
    zero.

    Examples
    --------
    >>> from npend_gym import Chain
    >>> Chain.from_mjcf(Chain.uniform(3).to_mjcf()).n  # or a file: Chain.from_mjcf("arm.xml")
    3
    """
    mujoco = require("mujoco", "mujoco", "models of MuJoCo")
    is_text = isinstance(source, str) and source.lstrip().startswith("<")
    load = mujoco.MjModel.from_xml_string if is_text else mujoco.MjModel.from_xml_path
    try:
        if not is_text and not _checks.path("source", source).is_file():
            raise ValueError(f"source must be XML or a file of it, got {_checks.show(source)}")
        model = load(source if is_text else str(Path(source)))
    except (ValueError, OSError) as error:
        raise ValueError(f"MuJoCo cannot read the model: {error}") from error
    return _Reader(mujoco, model).chain()


class _Reader:
    """A compiled model, in the configuration in which it is defined."""

    def __init__(self, mujoco: Any, model: Any) -> None:
        self.mujoco, self.model, self.data = mujoco, model, mujoco.MjData(model)
        mujoco.mj_kinematics(model, self.data)
        mujoco.mj_comPos(model, self.data)

    def chain(self) -> Chain:
        """Return the chain, or name the element that none has."""
        model, bodies = self.model, self._bodies()
        self._check_forces()
        self._check_contacts()
        cart = bodies.pop(0) if self._is_slide(bodies[0]) else None
        if not bodies:
            raise ValueError("the model must have a hinge")
        joints = model.body_jntadr[bodies]
        axis, gravity = self.data.xaxis[joints[0]], model.opt.gravity.copy()
        if self._without("GRAVITY"):
            gravity[:] = 0.0
        self._check_axes(bodies, cart, gravity)
        plane = np.eye(3) - np.outer(axis, axis)
        anchors = self.data.xanchor[joints] @ plane
        centres = self.data.xipos[bodies] @ plane - anchors
        spans = np.diff(anchors, axis=0, append=anchors[-1:])
        spans[-1] = self._end(bodies[-1], centres[-1], anchors[-1], plane)
        lengths = np.linalg.norm(spans, axis=1)
        for body, length in zip(bodies, lengths, strict=True):
            if length < _CLOSE:
                raise ValueError(f"{self._body(body)} must have a length: no joint may be on one")
        places: FloatArray = np.sum(centres * spans, axis=1) / lengths
        beside = np.linalg.norm(centres - (places / lengths)[:, None] * spans, axis=1)
        for body, distance, length in zip(bodies, beside, lengths, strict=True):
            if distance > _CLOSE * length:
                raise ValueError(
                    f"{self._body(body)} must have its centre of mass on the line between its "
                    f"joint and the next, got {distance:.3g} m beside it"
                )
        places = np.where(abs(places - lengths) < 1e-12 * lengths, lengths, places)
        dofs = model.jnt_dofadr[joints]
        damping, friction = self._losses()
        return Chain(
            model.body_mass[bodies], lengths, float(np.linalg.norm(gravity)), damping[dofs],
            centres=places, inertias=self._inertias(bodies, axis, places),
            friction=friction[dofs], armature=self._armature()[dofs],
            base=None if cart is None else self._cart(cart),
        )  # fmt: skip

    def _bodies(self) -> list[int]:
        """Return the bodies that move, each of which has one joint and hangs from the last."""
        model, moving = self.model, list[int]()
        for body in range(1, model.nbody):
            if model.body_weldid[body] == 0:
                continue
            above, joints = moving[-1] if moving else 0, model.body_jntnum[body]
            if joints != 1:
                fixed = ' (<compiler fusestatic="true"/> merges it with its parent)'
                hint = fixed if joints == 0 else ""
                raise ValueError(f"{self._body(body)} must have one joint, got {joints}{hint}")
            if model.body_weldid[model.body_parentid[body]] != above:
                below = f"hang from {self._body(above)}" if above else "be the only one"
                raise ValueError(f"{self._body(body)} must {below}: a chain has no branches")
            self._check_joint(body, first=not moving)
            moving.append(body)
        if not moving:
            raise ValueError("the model must have a hinge")
        return moving

    def _check_joint(self, body: int, *, first: bool) -> None:
        """Refuse a joint that is no plain hinge, or a slide of the first body."""
        model, j = self.model, int(self.model.body_jntadr[body])
        name, kind = self._joint(j), int(model.jnt_type[j])
        if kind != self.mujoco.mjtJoint.mjJNT_HINGE and not (first and self._is_slide(body)):
            slide = ", or a slide that carries the first one" if first else ""
            raise ValueError(f"{name} must be a hinge{slide}")
        if model.jnt_limited[j] and not self._without("LIMIT", "CONSTRAINT"):
            raise ValueError(f"{name} must have no range: leave it out, or disable limits")
        # Polynomials are newer than the oldest MuJoCo that the extra allows
        polynomials = getattr(model, "jnt_stiffnesspoly", np.zeros((model.njnt, 1)))
        stiff = model.jnt_stiffness[j] != 0.0 or polynomials[j].any()
        if stiff and not self._without("SPRING", "PASSIVE"):
            raise ValueError(f"{name} must have no stiffness")
        polynomials = getattr(model, "dof_dampingpoly", np.zeros((model.nv, 1)))
        if polynomials[model.jnt_dofadr[j]].any():
            raise ValueError(f"{name} must have a damping that is one number")

    def _is_slide(self, body: int) -> bool:
        joint = self.model.body_jntadr[body]
        return int(self.model.jnt_type[joint]) == self.mujoco.mjtJoint.mjJNT_SLIDE

    def _check_axes(self, bodies: list[int], cart: int | None, gravity: FloatArray) -> None:
        """Refuse axes by which the motion is not in a plane that gravity lies in."""
        axes, first = self.data.xaxis, self.model.body_jntadr[bodies[0]]
        for joint in self.model.body_jntadr[bodies[1:]]:
            if np.linalg.norm(np.cross(axes[joint], axes[first])) > _CLOSE:
                raise ValueError(f"{self._joint(joint)} must be parallel to {self._joint(first)}")
        if abs(axes[first] @ gravity) > _CLOSE * np.linalg.norm(gravity):
            raise ValueError(
                f"{self._joint(first)} must be perpendicular to gravity, got gravity {gravity}"
            )
        if cart is None:
            return
        slide = self.model.body_jntadr[cart]
        along = abs(
            np.array([axes[first], gravity / (np.linalg.norm(gravity) or 1.0)]) @ axes[slide]
        )
        if along.max() > _CLOSE:
            raise ValueError(
                f"{self._joint(slide)} must be perpendicular to gravity and to {self._joint(first)}"
            )

    def _check_forces(self) -> None:
        """Refuse what acts on the bodies beside gravity, joints and plain motors."""
        model = self.model
        for count, element in _WITHOUT.items():
            if getattr(model, count, 0):
                raise ValueError(f"the model must have no <{element}>, got {getattr(model, count)}")
        if model.opt.density or model.opt.viscosity:
            raise ValueError("the option must have no density and no viscosity of a fluid")
        for body in np.flatnonzero(model.body_gravcomp).tolist():
            raise ValueError(f"{self._body(body)} must have no gravcomp")
        names = "armature", "damping", "dampingpoly"  # the last is newer than the oldest MuJoCo
        more = [getattr(model, f"actuator_{name}", None) for name in names]
        acts = [model.actuator_biastype, *(each for each in more if each is not None)]
        for k in range(model.nu):
            if any(np.any(each[k]) for each in acts):
                raise ValueError(f"{_named('actuator', model.actuator(k))} must be a plain motor")

    def _check_contacts(self) -> None:
        """Refuse geoms that could touch."""
        model = self.model
        if self._without("CONTACT", "CONSTRAINT"):
            return
        touches, welded = model.geom_contype[:, None] & model.geom_conaffinity, model.body_weldid
        of = welded[model.geom_bodyid]
        near = of[:, None] == of
        if not self._without("FILTERPARENT"):
            above = welded[model.body_parentid[of]]  # the link above is left out, not the world
            near |= (above == of[:, None]) & (of[:, None] != 0)
        for signature in model.exclude_signature.tolist():  # two bodies, of 16 bits each
            one, other = (model.geom_bodyid == body for body in divmod(signature, 1 << 16))
            near |= one[:, None] & other
        for pair in np.argwhere((touches | touches.T) & ~(near | near.T)):
            one, other = (_named("geom", model.geom(k)) for k in pair)
            raise ValueError(
                f"{one} and {other} must not touch: give them contype and conaffinity 0, or "
                'disable contact by <flag contact="disable"/>'
            )

    def _end(
        self, body: int, centre: FloatArray, anchor: FloatArray, plane: FloatArray
    ) -> FloatArray:
        """Return where the last link ends from its joint, on the line through its centre."""
        kinds, ends = self.mujoco.mjtGeom, [np.zeros(3)]
        long = kinds.mjGEOM_CAPSULE, kinds.mjGEOM_CYLINDER
        for geom in np.flatnonzero(self.model.geom_bodyid == body):
            if int(self.model.geom_type[geom]) in long:
                half = self.model.geom_size[geom, 1] * self.data.geom_xmat[geom].reshape(3, 3)[:, 2]
                ends += [self.data.geom_xpos[geom] + sign * half - anchor for sign in (-1.0, 1.0)]
        end = max((each @ plane for each in ends), key=lambda each: float(np.linalg.norm(each)))
        square = centre @ centre
        if square <= (_CLOSE * np.linalg.norm(end)) ** 2:
            return end
        on_line = (end @ centre / square) * centre
        return on_line if np.linalg.norm(on_line) > _CLOSE else centre

    def _inertias(self, bodies: list[int], axis: FloatArray, places: FloatArray) -> FloatArray:
        """Return the inertias about the centres of mass, zero for point masses."""
        turned = self.data.ximat[bodies].reshape(-1, 3, 3)
        about = np.einsum("bij,i->bj", turned, axis) ** 2
        inertias = np.sum(self.model.body_inertia[bodies] * about, axis=1)
        of_points = OF_POINT_MASS * self.model.body_mass[bodies] * places**2
        return np.where(inertias <= 10.0 * np.maximum(of_points, MIN_INERTIA), 0.0, inertias)

    def _losses(self) -> tuple[FloatArray, FloatArray]:
        """Return damping and dry friction of all joints, where they act."""
        damping, friction = self.model.dof_damping.copy(), self.model.dof_frictionloss.copy()
        if self._without("DAMPER", "PASSIVE"):
            damping[:] = 0.0
        if self._without("FRICTIONLOSS", "CONSTRAINT"):
            friction[:] = 0.0
        return damping, friction

    def _armature(self) -> FloatArray:
        """Return the armature of all joints, zero where it is too small for any motion."""
        armature = self.model.dof_armature
        return np.where(armature <= 10.0 * OF_NO_MOTOR * self.model.dof_M0, 0.0, armature)

    def _cart(self, body: int) -> Cart:
        """Return the cart, whose armature is as good as mass."""
        dof = int(self.model.jnt_dofadr[self.model.body_jntadr[body]])
        damping, friction = self._losses()
        if friction[dof]:
            joint = self._joint(self.model.body_jntadr[body])
            raise ValueError(f"{joint} must have no frictionloss: a cart has damping only")
        mass = self.model.body_mass[body] + self._armature()[dof]
        return Cart(float(mass), float(damping[dof]))

    def _without(self, *flags: str) -> bool:
        """Return whether the model disables any of the flags that this MuJoCo has."""
        kinds = self.mujoco.mjtDisableBit
        bits = [getattr(kinds, f"mjDSBL_{flag}", None) for flag in flags]
        return any(self.model.opt.disableflags & bit.value for bit in bits if bit is not None)

    def _body(self, body: int) -> str:
        return _named("body", self.model.body(body))

    def _joint(self, joint: int) -> str:
        return _named("joint", self.model.joint(joint))


def _named(kind: str, element: Any) -> str:
    """Return an element as errors name it, by its number where it has no name."""
    return f"{kind} {element.name!r}" if element.name else f"{kind} number {element.id}"
