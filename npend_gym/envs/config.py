"""The keywords of the environments: checked once, what depends on mode and chain filled in."""

from __future__ import annotations

import difflib
import inspect
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray
from typing_extensions import TypedDict, Unpack

from npend_gym import _checks
from npend_gym.chain import MAX_RODS, STANDARD_GRAVITY, Chain
from npend_gym.compiled.sincos import MAX_ANGLE
from npend_gym.envs.modes import Mode, find_mode
from npend_gym.physics.kernels.layout import MAX_SPEED
from npend_gym.physics.substeps import MAX_ROTATION, MAX_SUBSTEPS, default_substeps

OBSERVATIONS = ("angles", "sincos")

CHAIN_KEYWORDS = ("masses", "lengths", "gravity", "damping", "drag", "quadratic_drag")

_EnvClass = TypeVar("_EnvClass", bound=type)


class EnvKeywords(TypedDict, total=False):
    """The keywords that both environments take and `EnvConfig` describes."""

    n: int
    mode: str | Mode
    masses: ArrayLike
    lengths: ArrayLike
    gravity: float
    damping: ArrayLike
    drag: ArrayLike
    quadratic_drag: ArrayLike
    actuated: Sequence[int]
    max_torque: float | None
    dt: float | None
    substeps: int | None
    observation: str
    amplitude: float
    spread: float


@dataclass(frozen=True, eq=False, kw_only=True)
class EnvConfig:
    """The settings of an environment: its keywords, checked, and what follows from them.

    Parameters
    ----------
    **keywords
        Those of `NPendulumEnv`, all optional. As attributes they have the values that are used:
        `mode` is an instance, and `dt` and `max_torque` are numbers.

    Attributes
    ----------
    chain : Chain
        The chain of these masses, lengths and resistances.
    joints : ndarray, int64
        Actuated joints; none in a mode without a motor.
    min_substeps : int
        Substeps of a step in which no rod turns fast.
    max_rotation : float
        A substep in which a rod turns by more than this is divided [rad].

    Raises
    ------
    TypeError, ValueError
        If a keyword breaks its rule.
    """

    n: int = 2
    mode: Mode = field(default="swingup")  # type: ignore[assignment]
    masses: ArrayLike = 1.0
    lengths: ArrayLike = 1.0
    gravity: float = STANDARD_GRAVITY
    damping: ArrayLike = 0.0
    drag: ArrayLike = 0.0
    quadratic_drag: ArrayLike = 0.0
    actuated: Sequence[int] = (0,)
    max_torque: float = field(default=None)  # type: ignore[assignment]
    dt: float = field(default=None)  # type: ignore[assignment]
    substeps: int | None = None
    observation: str = "angles"
    amplitude: float = math.pi / 4
    spread: float = 0.017

    chain: Chain = field(init=False, repr=False)
    joints: NDArray[np.int64] = field(init=False, repr=False)
    min_substeps: int = field(init=False, repr=False)
    max_rotation: float = field(init=False, repr=False)

    if TYPE_CHECKING:  # what the keywords may be is wider than what they are once checked

        def __init__(self, **keywords: Unpack[EnvKeywords]) -> None: ...

    def __post_init__(self) -> None:
        given: Any = self  # the fields as passed, of wider types than declared
        n = _checks.count("n", given.n, high=MAX_RODS)
        masses = _checks.vector("masses", self.masses, n)
        lengths = _checks.vector("lengths", self.lengths, n)
        chain = Chain(masses, lengths, self.gravity, self.damping, self.drag, self.quadratic_drag)
        mode = find_mode(given.mode)
        joints = _joints(self.actuated, n) if mode.torque_share > 0.0 else ()
        dt = mode.dt if given.dt is None else _checks.positive_number("dt", given.dt)
        max_torque = 0.5 * mode.torque_share * chain.lifting_energy
        if given.max_torque is not None:
            max_torque = _checks.nonnegative_number("max_torque", given.max_torque)
        substeps, max_rotation = _substeps(self.substeps, dt, chain)
        _checks.choice("observation", self.observation, OBSERVATIONS)
        checked = {name: getattr(chain, name) for name in CHAIN_KEYWORDS}
        checked |= {
            "n": n,
            "mode": mode,
            "max_torque": max_torque,
            "dt": dt,
            "amplitude": _angle("amplitude", _checks.number("amplitude", self.amplitude)),
            "spread": _angle("spread", _checks.nonnegative_number("spread", self.spread)),
            "chain": chain,
            "joints": np.array(joints, np.int64),
            "min_substeps": substeps,
            "max_rotation": max_rotation,
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @property
    def with_sines(self) -> bool:
        """Whether observations hold the sines and cosines of the angles."""
        return self.observation == "sincos"

    @property
    def hold_steps(self) -> int:
        """Number of steps over which the mode's goal must have held to count as success."""
        return math.ceil(self.mode.hold / self.dt * (1.0 - 1e-12))  # 5 s of 0.05 s are 100 steps

    @property
    def render_fps(self) -> int:
        """Pictures a second at which an episode is shown in its own time."""
        return max(1, round(1.0 / self.dt))

    @property
    def action_space(self) -> spaces.Space[Any]:
        """Box(-1, 1) with an entry for each actuated joint; Discrete(1) where there is none."""
        if self.joints.size == 0:
            return spaces.Discrete(1)
        return spaces.Box(-1.0, 1.0, (self.joints.size,), np.float32)

    @property
    def observation_space(self) -> spaces.Space[Any]:
        """Angles (or sines and cosines), then angular velocities, float32."""
        n = self.chain.n
        bound = np.full(3 * n if self.with_sines else 2 * n, MAX_SPEED, np.float32)
        angles = 2 * n if self.with_sines else n
        bound[:angles] = 1.0 if self.with_sines else np.pi
        return spaces.Box(-bound, bound, dtype=np.float32)


_DEFAULTS = {each.name: each.default for each in fields(EnvConfig) if each.init}


def with_config_keywords(env: _EnvClass) -> _EnvClass:
    """Give an environment's class, for `help` and `inspect`, the signature that it really has."""
    own = inspect.signature(env).parameters.values()
    given = [
        inspect.Parameter(
            name,
            inspect.Parameter.KEYWORD_ONLY,
            default=_DEFAULTS[name],
            annotation=getattr(kind, "__forward_arg__", kind),
        )
        for name, kind in EnvKeywords.__annotations__.items()
    ]
    positional = [p for p in own if p.kind is p.POSITIONAL_OR_KEYWORD]
    keyword_only = [p for p in own if p.kind is p.KEYWORD_ONLY]
    signature = inspect.Signature([*positional, *given, *keyword_only])
    env.__signature__ = signature  # type: ignore[attr-defined]
    return env


def make_config(env: type, keywords: EnvKeywords) -> EnvConfig:
    """Return the settings of an environment, or name the keyword that the environment lacks."""
    for name in keywords:
        if name not in EnvKeywords.__annotations__:
            valid = list(inspect.signature(env).parameters)
            close = difflib.get_close_matches(name, valid, n=1)
            hint = f"; did you mean {close[0]!r}?" if close else ";"
            raise TypeError(
                f"{env.__name__} got an unexpected keyword argument {name!r}{hint} "
                f"It takes {', '.join(valid)}"
            )
    return EnvConfig(**keywords)


def _substeps(given: int | None, dt: float, chain: Chain) -> tuple[int, float]:
    """Return the least number of substeps, and the rotation that divides one [rad]."""
    if given is not None:
        return _checks.count("substeps", given, high=MAX_SUBSTEPS), math.inf
    return default_substeps(chain, dt), MAX_ROTATION


def _angle(name: str, value: float) -> float:
    return float(_checks.within(name, np.array(value), 0.5 * MAX_ANGLE))


def _joints(actuated: Any, n: int) -> tuple[int, ...]:
    if isinstance(actuated, str) or not isinstance(actuated, (Sequence, np.ndarray)):
        raise TypeError(
            f"actuated must be a list of joints such as (0,), got {_checks.show(actuated)}"
        )
    listed: list[Any] = list(actuated)  # pyright: ignore[reportUnknownArgumentType]
    joints = tuple(_checks.count("actuated", joint, low=0, high=n - 1) for joint in listed)
    if len(joints) == 0 or len(set(joints)) != len(joints):
        raise ValueError(
            f"actuated must name at least one joint, and each once, got {_checks.show(listed)}"
        )
    return joints
