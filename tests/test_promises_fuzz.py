"""Environments under calls in any order: they answer, or refuse with a declared error."""

import gymnasium as gym
import hypothesis
import numpy as np
import pytest
from gymnasium.error import Error
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, precondition, rule, run_state_machine_as_test
from test_env_combinations import HARDWARE, KEYWORDS, OF_CARTS, OF_LINKS

import npend_gym  # noqa: F401 - registers the environments

DECLARED = (ValueError, TypeError, RuntimeError, Error)
CALLS = 2_000  # a night makes two million

DTYPES = st.sampled_from(["f2", "f4", "f8", "i1", "i8", "u1", "?", "c16", "U3", "O"])
ODD = st.sampled_from([None, "x", b"", {}, np.nan, 10**400, [[1], 2], np.zeros((3, 3)), 1j])
# With values for two rods, which other chains refuse
POOL = OF_LINKS | KEYWORDS | HARDWARE | OF_CARTS
# What changes within a step is computed for each substep in turn; by default there are hundreds
SUBSTEPS = st.sampled_from([1, 2, 5, 5, 20, 20, 20, None])
EXTRAS = st.lists(st.sampled_from(sorted(POOL)), max_size=8, unique=True).flatmap(
    lambda names: st.fixed_dictionaries({k: POOL[k](2) for k in names} | {"substeps": SUBSTEPS})
)


class LifeCycle(RuleBasedStateMachine):
    """Make, reset, step, render and close environments in any order, with anything for arguments.

    `calls` counts them, over all runs; with `extras` environments also get the keywords of carts,
    goals, motors, sensors, pushes and randomisation, which may contradict each other.
    """

    calls = 0
    extras = False

    def __init__(self):
        super().__init__()
        self.env = self.options = None
        self.ready = False

    def call(self, function, *arguments, **keywords):
        """Return what the call gives; None where it is refused as declared."""
        LifeCycle.calls += 1
        try:
            return function(*arguments, **keywords)
        except DECLARED:
            return None

    @rule(
        n=st.integers(1, 4),
        lanes=st.sampled_from([None, 1, 3, 17]),
        mode=st.sampled_from(["passive", "swingup", "balance", "calm"]),
        observation=st.sampled_from(["angles", "sincos", "scaled"]),
        autoreset=st.sampled_from(list(gym.vector.AutoresetMode)),
        steps=st.integers(1, 30),
        picture=st.sampled_from([None, None, None, "rgb_array"]),
        reward_type=st.sampled_from(["dense", "sparse"]),
        levels=st.sampled_from([None, None, 2, 3]),
        extras=EXTRAS,
    )
    def make(self, lanes, mode, autoreset, steps, picture, levels, extras, **keywords):
        keywords |= {"mode": mode, "render_mode": picture}
        keywords |= {} if mode == "passive" else {"torque_levels": levels}
        keywords |= extras if LifeCycle.extras else {}
        keywords |= {"id": "NPendulum-v0", "max_episode_steps": steps}
        if lanes is None:
            made = self.call(gym.make, disable_env_checker=True, **keywords)
        else:
            made = self.call(gym.make_vec, num_envs=lanes, autoreset_mode=autoreset, **keywords)
        assert made is not None or LifeCycle.extras
        self.env, self.ready = made or self.env, self.ready and made is None

    def look(self, seen):
        assert self.env.observation_space.contains(seen[0])
        for value in seen[-1].values():
            if isinstance(value, np.ndarray) and value.dtype.kind == "f":
                assert np.isfinite(value).all()

    @precondition(lambda self: self.env is not None)
    @rule(
        seed=st.one_of(st.none(), st.integers(0, 2**70), ODD),
        options=st.one_of(
            st.none(),
            st.dictionaries(
                st.sampled_from(["theta", "omega", "gravity", "masses", "damping", "no such"]),
                st.one_of(st.floats(), st.floats(0.1, 10.0), ODD),
                max_size=2,
            ),
        ),
    )
    def reset(self, seed, options):
        seen = self.call(self.env.reset, seed=seed, options=options)
        if seen is not None:
            self.ready = True
            self.look(seen)

    @precondition(lambda self: self.ready)
    @rule(count=st.integers(1, 400), seed=st.integers(0, 2**32 - 1))
    def step_well(self, count, seed):
        self.env.action_space.seed(seed)
        for _ in range(count):
            seen = self.call(self.env.step, self.env.action_space.sample())
            if seen is None:
                return
            self.look(seen)
            assert np.isfinite(seen[1]).all()
            if seen[2] is True or seen[3] is True:  # a single one, that has ended
                self.look(self.call(self.env.reset))

    @precondition(lambda self: self.env is not None)
    @rule(dtype=DTYPES, size=st.integers(0, 20), odd=st.one_of(st.none(), ODD))
    def step_oddly(self, dtype, size, odd):
        action = np.ones((size, 1) if size > 4 else (size,)).astype(dtype) if odd is None else odd
        seen = self.call(self.env.step, action)
        if seen is not None:
            self.look(seen)

    @precondition(lambda self: self.env is not None)
    @rule()
    def render(self):
        self.call(self.env.render)

    @precondition(lambda self: self.env is not None)
    @rule()
    def close(self):
        self.call(self.env.close)


def fuzz(examples, number=0, *, extras=False):
    """Run so many random life cycles, others for each number; return how many calls were made."""
    LifeCycle.calls, LifeCycle.extras = 0, extras
    run_state_machine_as_test(
        hypothesis.seed(number)(LifeCycle),
        settings=settings(max_examples=examples, stateful_step_count=40, deadline=None),
    )
    return LifeCycle.calls


@pytest.mark.long
@pytest.mark.filterwarnings("ignore")  # Gymnasium's own, about what is done to its environments
@pytest.mark.parametrize(
    "extras",
    [
        pytest.param(False, id="usual keywords"),
        pytest.param(True, id="any keywords", marks=pytest.mark.nightly),
    ],
)
def test_calls_in_any_order_are_answered_or_refused_as_declared(extras):
    calls = number = 0
    while calls < CALLS:
        calls += fuzz(10, number, extras=extras)
        number += 1
