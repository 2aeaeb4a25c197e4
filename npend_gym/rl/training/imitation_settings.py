"""Settings of imitation: what a run depends on, and those of each task."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from npend_gym.rl.training.error_lanes import CHAIN, NOTHING, PUSHES, SEVERAL
from npend_gym.rl.training.tasks import TrainingSettings, env_of_task


@dataclass(frozen=True)
class Settings(TrainingSettings):
    """The settings of a training run; its result depends on nothing else."""

    seconds: float = 4.5  # of a planned trajectory
    guesses: int = 4  # that may lead to trajectories, each an expert
    plan_seed: int | None = None  # of the first guess; by default another for each `seed`
    tries: int = 1  # for each of them; the least sensitive trajectory counts
    plan_guess: str = "mpc"  # or "waves", see `planned_swing_up`
    speed_weight: float = 0.0  # [s/rad] of a plan: for slow joints, likewise
    change_weight: float = 0.0  # [s] of a plan: for smooth torques
    slow_from: float = 0.0  # [s] when the speeds of a plan begin to count
    cart_position: float = 0.0  # [m] where a plan ends
    variants: int = 0  # of a plan that are tried, to keep what errors lead less astray from
    error_weight: float = 0.0  # of slightly wrong chains, and of lags, where plans are compared
    rescuer: str = ""  # acts where an expert has lost the chain: a policy or its file, or "mpc"
    disturbed: float = 0.0  # share of the episodes that start after a knock-down, with a rescuer
    turns: float = 0.0  # standard deviation of whole turns by which these turn joints further
    errors: dict[str, float] = field(default_factory=dict[str, float])  # shares of `KINDS`
    chain_factors: int = 4  # below 1 and above, of each parameter of a rod that may be wrong
    first_level: float = 1.0  # of errors of sensors and motors at first, over the largest
    margin: float = 0.0  # by which they grow beyond the largest
    rounds: int = 24  # after a first one, in which the expert acts alone
    num_envs: int = 512
    expert_fraction: float = 0.25  # of the environments: the expert acts, with noise
    student_fraction: float = 0.25  # of the environments: the student acts, and nobody takes over
    noise_std: float = 0.1  # largest standard deviation of the noise on the expert's actions
    take_over: float = 3.0  # from this cost on the expert acts; 1 is the mean at the start
    hand_back: float = 1.0  # below it the student acts again
    lost: float = 100.0  # nothing more is learned from an environment that has been beyond
    standing: int = 120  # steps after the trajectory; success needs 100
    kept: float = 0.25  # fraction of the states that come into the dataset
    max_states: int = 1_000_000  # in the dataset; then new ones take the place of old ones
    first_updates: int = 1000  # after the first round
    updates: int = 500  # after every other round
    minibatch_size: int = 1024
    learning_rate: float = 2e-3  # of Adam; falls to zero along a cosine
    muon_learning_rate: float = 0.0  # of Muon for the matrices; 0: Adam learns them too
    spring_learning_rate: float = 0.0  # of SPRING, which then learns in place of both
    averaging: float = 0.0  # of the student's parameters: what is left of them after an update
    length: int = 1  # observations that the student is given
    hidden: int = 192  # units in each hidden layer
    layers: int = 2  # that are hidden
    feedback_units: int = 0  # of the first layer, which begin as the feedback along the plans
    by_goal: bool = False  # whether each goal has a network of its own
    obs_scale: tuple[float, float, float] = (0.3, 0.3, 1.5)  # of sines, cosines, speeds [rad/s]
    change_scale: tuple[float, float, float] = (0.1, 0.1, 1.0)  # of their changes in a step


# What is wrong in robust training, and in which share of the environments
ERRORS = {
    NOTHING: 0.05, CHAIN: 0.35, "velocity_noise": 0.1, "torque_noise": 0.05, "motor_lag": 0.02,
    "delay": 0.1, PUSHES: 0.28, SEVERAL: 0.05,
}  # fmt: skip
_ROBUST: dict[str, Any] = {
    "errors": ERRORS, "first_level": 0.4, "guesses": 1, "plan_seed": 5, "rounds": 120,
    "num_envs": 320, "student_fraction": 0.35, "expert_fraction": 0.2, "kept": 0.4,
    "first_updates": 400, "minibatch_size": 512, "averaging": 0.998, "length": 5, "hidden": 256,
}  # fmt: skip
_LONG = _ROBUST | {"seconds": 7.0, "rounds": 400, "updates": 600}
_THREE: dict[str, Any] = {
    "seconds": 4.0, "plan_seed": 11, "standing": 160, "rounds": 125, "length": 10,
    "updates": 400, "minibatch_size": 1024, "muon_learning_rate": 0.02,
    "rescuer": "mpc", "margin": 0.6,  # so that sensors a whole step late are no rare case
    "errors": {NOTHING: 0.05, CHAIN: 0.42, "torque_noise": 0.08, "motor_lag": 0.02, "delay": 0.26,
               PUSHES: 0.14, SEVERAL: 0.03},
}  # fmt: skip
_STEADY: dict[str, Any] = _LONG | {"plan_seed": 0, "tries": 4, "muon_learning_rate": 0.015}
_FOUR: dict[str, Any] = _STEADY | {
    "seconds": 5.0, "plan_seed": 1, "variants": 1200, "error_weight": 1.0, "chain_factors": 8,
    "first_level": 0.2, "standing": 220, "length": 10, "rounds": 230, "hidden": 320,
    "minibatch_size": 768, "max_states": 1_500_000,
    "errors": {NOTHING: 0.05, CHAIN: 0.43, "torque_noise": 0.16, "motor_lag": 0.1, "delay": 0.2,
               PUSHES: 0.06},
}  # fmt: skip
_FIVE: dict[str, Any] = _STEADY | {
    "variants": 300, "first_level": 0.1, "standing": 220, "length": 10, "rounds": 240,
    "hidden": 288,
    "errors": {NOTHING: 0.13, CHAIN: 0.32, "torque_noise": 0.15, "motor_lag": 0.08, "delay": 0.22,
               PUSHES: 0.1},
}  # fmt: skip
_ROBOT: dict[str, Any] = {  # of RealAIGym: steps of 0.02 s
    "seconds": 3.0, "plan_seed": 1, "rounds": 60, "standing": 220, "length": 6, "hidden": 128,
    "obs_scale": (0.5, 0.5, 4.0),
}  # fmt: skip
# Plans that RealAIGym's performance scores well; each step of the environment changes the torque
_SMOOTH: dict[str, Any] = {
    "seconds": 2.0, "plan_guess": "waves", "plan_seed": 1, "guesses": 1, "speed_weight": 0.045,
    "change_weight": 0.1, "rounds": 40, "num_envs": 128, "disturbed": 0.6, "noise_std": 0.3,
    "student_fraction": 0.5, "standing": 300, "kept": 0.15, "averaging": 0.998, "hidden": 192,
    "muon_learning_rate": 0.01, "obs_scale": (0.5, 0.5, 4.0),
}  # fmt: skip
_SMOOTH_ELBOW: dict[str, Any] = {
    "seconds": 1.6, "plan_seed": 518, "speed_weight": 0.043, "change_weight": 0.153, "hidden": 256,
    "disturbed": 0.7, "turns": 1.0, "rounds": 60, "updates": 800, "kept": 0.12, "lost": 40.0,
    "errors": {NOTHING: 0.6, "velocity_noise": 0.15, "delay": 0.25},
}  # fmt: skip
_PERFORMANCE: dict[str, Any] = {  # alone, for the acrobot
    "seconds": 2.3, "plan_seed": 204, "speed_weight": 0.0425, "change_weight": 0.089,
    "disturbed": 0.0, "rounds": 24, "noise_std": 0.1,
}  # fmt: skip
_QUICK: dict[str, Any] = {"guesses": 1, "averaging": 0.998}
_SIX: dict[str, Any] = _QUICK | {
    "seconds": 8.0, "plan_seed": 5, "tries": 4, "variants": 40, "noise_std": 0.02, "rounds": 60,
    "student_fraction": 0.1, "take_over": 1.5, "hand_back": 0.5, "lost": 6.0,
    "minibatch_size": 512, "spring_learning_rate": 0.3,
}  # fmt: skip
_TWO_POLES: dict[str, Any] = {
    "seconds": 6.0, "rounds": 12, "averaging": 0.998, "muon_learning_rate": 0.015,
}  # fmt: skip
_FOUR_POLES: dict[str, Any] = _QUICK | {
    "seconds": 10.0, "plan_seed": 4, "variants": 100, "rounds": 80, "hidden": 256,
    "muon_learning_rate": 0.015,
}  # fmt: skip
_FIVE_POLES: dict[str, Any] = _FOUR_POLES | {
    "seconds": 14.0, "plan_seed": 0, "tries": 4, "variants": 60, "rounds": 180,
}  # fmt: skip
_SIX_POLES: dict[str, Any] = _QUICK | {
    "seconds": 14.0, "plan_seed": 1, "variants": 160, "rounds": 80,
    "student_fraction": 0.15, "take_over": 1.5, "hand_back": 0.5, "lost": 20.0, "standing": 200,
    "kept": 0.15, "muon_learning_rate": 0.02, "hidden": 256, "feedback_units": 192,
}  # fmt: skip
_ALL_PAIRS: dict[str, Any] = {  # of equilibria of three rods
    "seconds": 5.0, "guesses": 8, "rounds": 80, "num_envs": 4096, "updates": 600,
    "minibatch_size": 8192, "max_states": 6_000_000, "muon_learning_rate": 0.015,
    "averaging": 0.998, "by_goal": True,
}  # fmt: skip
_ALL_PAIRS_CART: dict[str, Any] = {
    "seconds": 8.0, "plan_guess": "waves", "guesses": 20, "variants": 40,
    "hidden": 256, "feedback_units": 192,
}  # fmt: skip
_POLES: dict[str, Any] = {"seconds": 3.0, "rounds": 8, "averaging": 0.998, "hidden": 64}
TASKS: dict[str, dict[str, Any]] = {
    "swingup-1": _QUICK | {"seconds": 3.0, "plan_seed": 0, "rounds": 4, "hidden": 32},
    "swingup-2": _QUICK | {"seconds": 3.0, "plan_seed": 0, "rounds": 10, "hidden": 64},
    "swingup-3": _QUICK | {"seconds": 4.0, "plan_seed": 4, "rounds": 10},
    "swingup-4": _QUICK | {"seconds": 5.0, "plan_seed": 10, "rounds": 24, "variants": 100},
    "swingup-5": _STEADY | {"errors": {}, "variants": 160, "rounds": 100},
    "swingup-6": _SIX,
    "swingup-2-robust": {"rescuer": "swingup-2"},
    "swingup-2-acrobot-robust": _ROBOT | {"rescuer": "swingup-2-acrobot"},
    "swingup-2-pendubot-robust": _ROBOT | {"rescuer": "swingup-2-pendubot"},
    "swingup-2-acrobot-smooth": _SMOOTH | _SMOOTH_ELBOW | {"rescuer": "swingup-2-acrobot-recovery"},
    "swingup-2-pendubot-smooth": _SMOOTH | {"rescuer": "swingup-2-pendubot-recovery"},
    "swingup-2-acrobot-performance": _SMOOTH | _PERFORMANCE,
    "swingup-3-robust": _THREE,
    "swingup-4-robust": _FOUR,
    "swingup-5-robust": _FIVE,
    "calm-2-robust": {"rounds": 20, "hidden": 48},
    "swingup-2-cart": _TWO_POLES,
    "swingup-3-cart": _TWO_POLES | _QUICK | {"seconds": 8.0, "plan_seed": 0, "rounds": 24},
    "swingup-4-cart": _FOUR_POLES,
    "swingup-5-cart": _FIVE_POLES,
    "swingup-6-cart": _SIX_POLES,
    "transition-2": {
        "seconds": 4.0,
        "rounds": 45,
        "first_updates": 1500,
        "muon_learning_rate": 0.01,
        "averaging": 0.998,
    },
    "transition-3": _ALL_PAIRS,
    "transition-3-cart": _ALL_PAIRS | _ALL_PAIRS_CART,
    "balance-4-cart": _POLES | {"obs_scale": (0.005, 1.0, 0.03)},
    "balance-5-cart": _POLES | {"obs_scale": (0.002, 1.0, 0.01)},
}
_FROM_ANGLES = "swingup-5", *(f"swingup-{n}-robust" for n in (3, 4, 5))  # without velocities


def settings_of(task: str, **changes: Any) -> Settings:
    """Return the settings for a task such as "swingup-3", or "swingup-3-robust" with `errors`."""
    env = env_of_task(task)
    robust = _ROBUST if env.pop("randomize", None) else {}  # errors are drawn by `ErrorLanes`
    if task in _FROM_ANGLES:
        env["observe_velocities"] = False
    fields: dict[str, Any] = {"env": env, **robust, **TASKS.get(task, {}), **changes}
    return Settings(**fields)
