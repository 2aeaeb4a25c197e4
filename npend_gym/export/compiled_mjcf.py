"""Compiled models of MuJoCo: what acts on their bodies beside gravity and joints."""

from __future__ import annotations

from typing import Any

import numpy as np

from npend_gym._checks import FloatArray

_WITHOUT = {"ntendon": "tendon", "nflex": "flex", "npair": "pair"}


class CompiledModel:
    """A model, in the configuration in which it is defined."""

    def __init__(self, mujoco: Any, model: Any) -> None:
        self.mujoco, self.model, self.data = mujoco, model, mujoco.MjData(model)
        mujoco.mj_kinematics(model, self.data)
        mujoco.mj_comPos(model, self.data)

    def check_forces(self) -> None:
        """Refuse what acts on the bodies beside gravity, joints and plain motors."""
        model = self.model
        for count, element in _WITHOUT.items():
            if getattr(model, count, 0):
                raise ValueError(f"the model must have no <{element}>, got {getattr(model, count)}")
        active = int(np.count_nonzero(model.eq_active0))
        if active and not self.without("EQUALITY", "CONSTRAINT"):
            raise ValueError(f"the model must have no <equality>, got {active}")
        if model.opt.density or model.opt.viscosity:
            raise ValueError("the option must have no density and no viscosity of a fluid")
        for body in np.flatnonzero(model.body_gravcomp).tolist():
            raise ValueError(f"{self.body(body)} must have no gravcomp")
        for body in np.flatnonzero(model.body_plugin >= 0).tolist():
            raise ValueError(f"{self.body(body)} must have no plugin")
        # MuJoCo 4 has actuators without a control; `nu` counts controls
        for k in range(getattr(model, "nactuator", model.nu)):
            if self._acts_by_itself(k):
                raise ValueError(f"{named('actuator', model.actuator(k))} must be a plain motor")

    def _acts_by_itself(self, k: int) -> bool:
        """Return whether actuator k acts on its joint without a control."""
        model = self.model
        names = "armature", "damping", "dampingpoly"  # the last is newer than the oldest MuJoCo
        passive = [getattr(model, f"actuator_{name}", None) for name in names]
        if any(np.any(each[k]) for each in passive if each is not None):
            return True  # even where actuation is disabled
        group = int(model.actuator_group[k])
        disabled = 0 <= group < 31 and int(model.opt.disableactuator) >> group & 1
        if disabled or self.without("ACTUATION"):
            return False
        return bool(model.actuator_biastype[k] or model.actuator_plugin[k] >= 0)

    def check_contacts(self, moving: list[int]) -> None:
        """Refuse geoms that could touch; the bodies of the chain are `moving`, from its base."""
        model = self.model
        if self.without("CONTACT", "CONSTRAINT"):
            return
        touches, welded = model.geom_contype[:, None] & model.geom_conaffinity, model.body_weldid
        of = welded[model.geom_bodyid]
        near = of[:, None] == of
        if not self.without("FILTERPARENT"):
            above = welded[model.body_parentid[of]]  # the link above is left out, not the world
            near |= (above == of[:, None]) & (of[:, None] != 0)
        for signature in model.exclude_signature.tolist():  # two bodies, of 16 bits each
            one, other = (model.geom_bodyid == body for body in divmod(signature, 1 << 16))
            near |= one[:, None] & other
        near |= self._far(of, moving)
        for pair in np.argwhere((touches | touches.T) & ~(near | near.T)):
            one, other = (named("geom", model.geom(k)) for k in pair)
            raise ValueError(
                f"{one} and {other} must not touch: give them contype and conaffinity 0, or "
                'disable contact by <flag contact="disable"/>'
            )

    def _far(self, of: Any, moving: list[int]) -> Any:
        """Return which geoms of the chain (columns) cannot reach which of the world (rows)."""
        model, data = self.model, self.data
        joints = model.body_jntadr[moving]
        slides = model.jnt_type[joints[0]] == self.mujoco.mjtJoint.mjJNT_SLIDE
        anchors = data.xanchor[joints]
        steps = np.linalg.norm(np.diff(anchors, axis=0), axis=1)
        far = np.zeros((model.ngeom, model.ngeom), bool)
        # No geom is farther from the first anchor than this, less the way of the cart
        reach = np.full(model.ngeom, np.inf)
        for body, anchor, joint_reach in zip(
            moving, anchors, np.cumsum(np.append(0.0, steps)), strict=True
        ):
            mine = of == body
            away = np.linalg.norm(data.geom_xpos[mine] - anchor, axis=1)
            reach[mine] = joint_reach + away + model.geom_rbound[mine] + model.geom_margin[mine]
        for k in np.flatnonzero(of == 0):
            between: FloatArray = anchors[0] - data.geom_xpos[k]
            if model.geom_type[k] == self.mujoco.mjtGeom.mjGEOM_PLANE:
                normal = data.geom_xmat[k].reshape(3, 3)[:, 2]
                along = abs(normal @ data.xaxis[joints[0]]) if slides else 0.0
                distance = between @ normal if along < 1e-8 else -np.inf
            else:
                distance = np.linalg.norm(between) - model.geom_rbound[k] if not slides else -np.inf
            far[k] = distance - model.geom_margin[k] > reach
        return far

    def without(self, *flags: str) -> bool:
        """Return whether the model disables any of the flags that this MuJoCo has."""
        kinds = self.mujoco.mjtDisableBit
        bits = [getattr(kinds, f"mjDSBL_{flag}", None) for flag in flags]
        return any(self.model.opt.disableflags & bit.value for bit in bits if bit is not None)

    def body(self, body: int) -> str:
        """Return a body as errors name it."""
        return named("body", self.model.body(body))

    def joint(self, joint: int) -> str:
        """Return a joint as errors name it."""
        return named("joint", self.model.joint(joint))


def named(kind: str, element: Any) -> str:
    """Return an element as errors name it, by its number where it has no name."""
    return f"{kind} {element.name!r}" if element.name else f"{kind} number {element.id}"
