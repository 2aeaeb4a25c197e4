"""Models of MuJoCo (MJCF) as chains: MuJoCo compiles the model, and its hinges are read."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import numpy as np

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym._extras import require
from npend_gym.chain import Cart, Chain
from npend_gym.export.compiled_mjcf import CompiledModel
from npend_gym.export.mjcf import MIN_INERTIA, OF_NO_MOTOR, OF_POINT_MASS
from npend_gym.physics.arguments import warn_caller

_CLOSE = 1e-8  # lengths over the length of a link, below which they are zero
_ENDLESS = 1000.0  # m or rad: prismatic joints of URDF must have limits
_ROUNDED = 1e-5  # of directions, and of lengths over that of a link: MuJoCo saves six digits


def from_mjcf(source: str | PathLike[str]) -> Chain:
    """Return the chain that a model of MuJoCo describes: hinges in a plane, perhaps on a cart.

    Each body has one hinge and hangs from the body before it; the first may have a slide, across
    gravity, and is the cart then. A body without a joint is part of the body or the world that
    carries it. Trees without hinges, such as a target, are left out. The plane, the signs of the
    axes and the angles at rest are free: `theta` of the chain is zero where a link hangs. Gravity
    is what acts in the plane: hinges along it make a chain without gravity. The last link ends
    where its longest capsule or cylinder does, or at its centre of mass; no motion depends on that.

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
        chain springs, contacts, active equalities, tendons, servos, plugins, passive motors, or a
        fluid. The error names the element. Geoms that cannot reach each other need no exclusion.
    ImportError
        If MuJoCo is not installed.

    Warns
    -----
    UserWarning
        If joints have a range, because a chain has none: within it, both move alike.

    Notes
    -----
    What `to_mjcf` writes is read back, but for rods that stretch, `gear`, and `friction_speed`,
    which MuJoCo does not know. An inertia up to ten times that of a point mass there is taken as
    zero. Directions and lengths that differ by less than 1e-5 are equal, because MuJoCo saves six
    digits.

    Examples
    --------
    >>> from npend_gym import Chain
    >>> Chain.from_mjcf(Chain.uniform(3).to_mjcf()).n  # or a file: Chain.from_mjcf("arm.xml")
    3
    """
    is_text = _is_text(source)
    return _read(str(source if is_text else _file(source)), is_text=is_text)


def chain_of_text(text: str) -> Chain:
    """Return the chain in a text of MJCF or URDF, as `from_mjcf` does."""
    return _read(text, is_text=True)


def text_of_source(source: str | PathLike[str]) -> str:
    """Return XML that is given itself, or as its file."""
    return str(source) if _is_text(source) else _file(source).read_text("utf-8")


def _is_text(source: str | PathLike[str]) -> bool:
    return isinstance(source, str) and source.lstrip().startswith("<")


def _file(source: str | PathLike[str]) -> Path:
    if not _checks.path("source", source).is_file():
        raise ValueError(f"source must be XML or a file of it, got {_checks.show(source)}")
    return Path(source)


def _read(source: str, *, is_text: bool) -> Chain:
    mujoco = require("mujoco", "mujoco", "models of MuJoCo")
    load = mujoco.MjModel.from_xml_string if is_text else mujoco.MjModel.from_xml_path
    try:
        model = load(source)
    except (ValueError, OSError) as error:
        raise ValueError(f"MuJoCo cannot read the model: {error}") from error
    return _Reader(mujoco, model).chain()


class _Reader(CompiledModel):
    """A compiled model that is read as a chain."""

    def chain(self) -> Chain:
        """Return the chain, or name the element that none has."""
        model, bodies = self.model, self._bodies()
        self.check_forces()
        self.check_contacts(bodies)
        cart = bodies.pop(0) if self._is_slide(bodies[0]) else None
        if not bodies:
            raise ValueError("the model must have a hinge")
        joints = model.body_jntadr[bodies]
        axis = self.data.xaxis[joints[0]]
        plane = np.eye(3) - np.outer(axis, axis)
        # Hinges bear what of gravity is along them
        gravity: FloatArray = np.zeros(3) if self.without("GRAVITY") else model.opt.gravity @ plane
        if np.linalg.norm(gravity) <= _CLOSE * np.linalg.norm(model.opt.gravity):
            gravity = np.zeros(3)
        self._check_axes(bodies, cart, gravity)
        masses, about = self._merged(bodies)
        anchors = self.data.xanchor[joints] @ plane
        centres = about @ plane - anchors
        spans = np.diff(anchors, axis=0, append=anchors[-1:])
        spans[-1] = self._end(bodies[-1], centres[-1], anchors[-1], plane)
        lengths = np.linalg.norm(spans, axis=1)
        for body, length in zip(bodies, lengths, strict=True):
            if length < _CLOSE:
                raise ValueError(f"{self.body(body)} must have a length: no joint may be on one")
        places: FloatArray = np.sum(centres * spans, axis=1) / lengths
        beside = np.linalg.norm(centres - (places / lengths)[:, None] * spans, axis=1)
        for body, distance, length in zip(bodies, beside, lengths, strict=True):
            if distance > _ROUNDED * length:
                raise ValueError(
                    f"{self.body(body)} must have its centre of mass on the line between its "
                    f"joint and the next, got {distance:.3g} m beside it"
                )
        inertias = self._inertias(bodies, axis, places, masses, about @ plane)
        near = np.where(inertias == 0.0, _ROUNDED, 1e-12) * lengths
        places = np.where(abs(places - lengths) < near, lengths, places)
        dofs = model.jnt_dofadr[joints]
        damping, friction = self._losses()
        self._warn_of_ranges(bodies if cart is None else [cart, *bodies])
        return Chain(
            masses, lengths, float(np.linalg.norm(gravity)), damping[dofs],
            centres=places, inertias=inertias,
            friction=friction[dofs], armature=self._armature()[dofs],
            base=None if cart is None else self._cart(cart),
        )  # fmt: skip

    def _bodies(self) -> list[int]:
        """Return the bodies that move, each of which has one joint and hangs from the last.

        Bodies without a joint are part of the body above. Bodies that hang from the world and
        carry no hinge move apart from the chain: they are left out.
        """
        model, moving = self.model, list[int]()
        hinges = model.jnt_type == self.mujoco.mjtJoint.mjJNT_HINGE
        roots = {int(model.body_rootid[body]) for body in model.jnt_bodyid[hinges]}
        for body in range(1, model.nbody):
            welded = int(model.body_weldid[body])
            apart = roots and int(model.body_rootid[body]) not in roots
            if welded in (0, *moving) or apart:
                continue
            above, joints = moving[-1] if moving else 0, model.body_jntnum[body]
            if joints != 1:
                raise ValueError(f"{self.body(body)} must have one joint, got {joints}")
            if model.body_weldid[model.body_parentid[body]] != above:
                below = f"hang from {self.body(above)}" if above else "be the only one"
                raise ValueError(f"{self.body(body)} must {below}: a chain has no branches")
            self._check_joint(body, first=not moving)
            moving.append(body)
        if not moving:
            raise ValueError("the model must have a hinge")
        return moving

    def _check_joint(self, body: int, *, first: bool) -> None:
        """Refuse a joint that is no plain hinge, or a slide of the first body."""
        model, j = self.model, int(self.model.body_jntadr[body])
        name, kind = self.joint(j), int(model.jnt_type[j])
        if kind != self.mujoco.mjtJoint.mjJNT_HINGE and not (first and self._is_slide(body)):
            slide = ", or a slide that carries the first one" if first else ""
            raise ValueError(f"{name} must be a hinge{slide}")
        # Polynomials are newer than the oldest MuJoCo that the extra allows
        polynomials = getattr(model, "jnt_stiffnesspoly", np.zeros((model.njnt, 1)))
        stiff = model.jnt_stiffness[j] != 0.0 or polynomials[j].any()
        if stiff and not self.without("SPRING", "PASSIVE"):
            raise ValueError(f"{name} must have no stiffness")
        polynomials = getattr(model, "dof_dampingpoly", np.zeros((model.nv, 1)))
        if polynomials[model.jnt_dofadr[j]].any():
            raise ValueError(f"{name} must have a damping that is one number")

    def _warn_of_ranges(self, bodies: list[int]) -> None:
        """Say which joints have ends, as a chain has none."""
        model, shown = self.model, list[str]()
        if self.without("LIMIT", "CONSTRAINT"):
            return
        for j in model.body_jntadr[bodies]:
            if model.jnt_limited[j]:
                low, high = model.jnt_range[j].tolist()
                if min(-low, high) >= _ENDLESS:
                    continue
                unit = "m" if model.jnt_type[j] == self.mujoco.mjtJoint.mjJNT_SLIDE else "rad"
                rail = f" (rail={high:g} of the environments)" if unit == "m" else ""
                shown.append(f"{self.joint(j)} from {low:g} to {high:g} {unit}{rail}")
        if shown:
            warn_caller(
                f"a chain has no ends of joints: its motion is that of the model within the ranges "
                f"of {', '.join(shown)}"
            )

    def _merged(self, bodies: list[int]) -> tuple[FloatArray, FloatArray]:
        """Return masses and centres of mass of bodies with all that is fixed to them."""
        model, parts = self.model, self._parts(bodies)
        masses: FloatArray = parts @ model.body_mass
        moments = (parts * model.body_mass) @ self.data.xipos
        return masses, moments / masses[:, None]

    def _parts(self, bodies: list[int]) -> FloatArray:
        """Return 1 where a body (columns) is fixed to one of the chain (rows), else 0."""
        fixed = np.equal.outer(np.array(bodies), self.model.body_weldid)
        return fixed.astype(np.float64)

    def _is_slide(self, body: int) -> bool:
        joint = self.model.body_jntadr[body]
        return int(self.model.jnt_type[joint]) == self.mujoco.mjtJoint.mjJNT_SLIDE

    def _check_axes(self, bodies: list[int], cart: int | None, gravity: FloatArray) -> None:
        """Refuse axes by which the motion is not in a plane, or the rail is not level there."""
        axes, first = self.data.xaxis, self.model.body_jntadr[bodies[0]]
        for joint in self.model.body_jntadr[bodies[1:]]:
            if np.linalg.norm(np.cross(axes[joint], axes[first])) > _ROUNDED:
                raise ValueError(f"{self.joint(joint)} must be parallel to {self.joint(first)}")
        if cart is None:
            return
        slide = self.model.body_jntadr[cart]
        along = abs(
            np.array([axes[first], gravity / (np.linalg.norm(gravity) or 1.0)]) @ axes[slide]
        )
        if along.max() > _ROUNDED:
            raise ValueError(
                f"{self.joint(slide)} must be perpendicular to gravity and to {self.joint(first)}, "
                f"got axes {axes[slide]} and {axes[first]}, and gravity {gravity} in the plane"
            )

    def _end(
        self, body: int, centre: FloatArray, anchor: FloatArray, plane: FloatArray
    ) -> FloatArray:
        """Return where the last link ends from its joint, on the line through its centre."""
        kinds, ends = self.mujoco.mjtGeom, [np.zeros(3)]
        long = kinds.mjGEOM_CAPSULE, kinds.mjGEOM_CYLINDER
        for geom in np.flatnonzero(self.model.body_weldid[self.model.geom_bodyid] == body):
            if int(self.model.geom_type[geom]) in long:
                half = self.model.geom_size[geom, 1] * self.data.geom_xmat[geom].reshape(3, 3)[:, 2]
                ends += [self.data.geom_xpos[geom] + sign * half - anchor for sign in (-1.0, 1.0)]
        end = max((each @ plane for each in ends), key=lambda each: float(np.linalg.norm(each)))
        square = centre @ centre
        if square <= (_CLOSE * np.linalg.norm(end)) ** 2:
            return end
        on_line = (end @ centre / square) * centre
        return on_line if np.linalg.norm(on_line) > _CLOSE else centre

    def _inertias(
        self, bodies: list[int], axis: FloatArray, places: FloatArray, masses: FloatArray,
        centres: FloatArray,
    ) -> FloatArray:  # fmt: skip
        """Return the inertias about the centres of mass, zero for point masses."""
        model, plane = self.model, np.eye(3) - np.outer(axis, axis)
        turned = self.data.ximat.reshape(-1, 3, 3)
        own = np.sum(model.body_inertia * np.einsum("bij,i->bj", turned, axis) ** 2, axis=1)
        away = self.data.xipos @ plane - centres[:, None]  # of each body from each centre
        distances = np.sum(away**2, axis=-1)
        inertias = np.sum(self._parts(bodies) * (own + model.body_mass * distances), axis=1)
        of_points = OF_POINT_MASS * masses * places**2
        return np.where(inertias <= 10.0 * np.maximum(of_points, MIN_INERTIA), 0.0, inertias)

    def _losses(self) -> tuple[FloatArray, FloatArray]:
        """Return damping and dry friction of all joints, where they act."""
        damping, friction = self.model.dof_damping.copy(), self.model.dof_frictionloss.copy()
        if self.without("DAMPER", "PASSIVE"):
            damping[:] = 0.0
        if self.without("FRICTIONLOSS", "CONSTRAINT"):
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
            joint = self.joint(self.model.body_jntadr[body])
            raise ValueError(f"{joint} must have no frictionloss: a cart has damping only")
        mass = self._merged([body])[0][0] + self._armature()[dof]
        return Cart(float(mass), float(damping[dof]))
