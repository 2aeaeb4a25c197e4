"""First steps with the environments: random actions in one chain, then in 64 chains at once.

Run it with `python examples/quickstart.py`, or with the number of steps: `... quickstart.py 100`.
"""

import sys

import gymnasium as gym

import npend_gym  # noqa: F401  the import registers the environments with Gymnasium

steps = int(sys.argv[1]) if len(sys.argv) > 1 else 1000

# A double pendulum with a motor at the pivot, hanging down. The task: swing it up and hold it.
# Angles are observed as sines and cosines, which do not jump where an angle passes 180 degrees.
env = gym.make("npend/SwingUp-v1", n=2, max_episode_steps=steps)
env.action_space.seed(0)  # the same random actions in every run
observation, info = env.reset(seed=0)  # the same start
total, best, done = 0.0, info["tip_height"], False
while not done:
    action = env.action_space.sample()  # a trained policy goes here
    observation, reward, terminated, truncated, info = env.step(action)
    total += reward  # between 0 and 1 in each step
    best = max(best, info["tip_height"])
    done = terminated or truncated  # failed, or out of time
print(f"one chain: return {total:.2f} of at most {steps} in {info['time']:g} s of swinging")
print(f"best height of the tip: {best:.2f} m, where hanging is -2 and upright is 2")
print(
    f"energy is wrong by {info['energy_error']:.0e} of itself"
)  # the work of the motor is counted

# Learning needs many steps: 64 chains in one call, with one row of every array for each of them.
envs = gym.make_vec("npend/SwingUp-v1", num_envs=64, n=2)
envs.action_space.seed(0)
observations, infos = envs.reset(seed=0)
total = 0.0
for _ in range(rounds := min(steps, 300)):
    observations, rewards, terminated, truncated, infos = envs.step(envs.action_space.sample())
    total += rewards.sum()  # finished episodes restart by themselves
print(f"64 chains: {64 * rounds} steps, mean reward {total / (64 * rounds):.3f}")
