"""Train in the distributed way, with Ray RLlib: environments step in worker processes.

Run it with `python examples/train_rllib.py`; `--iterations 1 --runners 0` is a quick look. It needs
`pip install "ray[rllib]" torch`. Ray requires another version of Gymnasium, so install it in a
virtual environment of its own.
"""

from __future__ import annotations

import argparse

import ray
from ray.rllib.algorithms.ppo import PPOConfig

TASK_ID = "npend_gym:npend/SwingUp-v1"  # the workers import the package
TASK = {"n": 2, "max_episode_steps": 200}


def main() -> None:
    """Train PPO on remote environments and print how the return grows."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--iterations", type=int, default=500, help="of 4096 steps each")
    parser.add_argument("--runners", type=int, default=2, help="worker processes; 0: none")
    parser.add_argument("--batch", type=int, default=4096, help="steps of an iteration")
    arguments = parser.parse_args()
    ray.init(num_cpus=arguments.runners + 1, include_dashboard=False, log_to_driver=False)
    config = (
        PPOConfig()
        .environment(TASK_ID, env_config=TASK)
        .env_runners(
            num_env_runners=arguments.runners,
            num_envs_per_env_runner=16,
            gym_env_vectorize_mode="vector_entry_point",  # the native vector environment
            sample_timeout_s=600,  # the first step compiles
        )
        .training(
            train_batch_size_per_learner=arguments.batch,
            minibatch_size=min(256, arguments.batch),
            num_epochs=10,
            lr=1e-3,
            gamma=0.98,
        )
        .debugging(seed=0)
    )
    algorithm = config.build_algo()
    for k in range(arguments.iterations):
        outputs = algorithm.train()["env_runners"]
        mean = outputs.get("episode_return_mean", float("nan"))  # NaN before an episode has ended
        steps = outputs["num_env_steps_sampled_lifetime"]
        print(f"iteration {k + 1}: {steps:.0f} steps, return {mean:.2f} of at most 200", flush=True)
    algorithm.stop()
    ray.shutdown()


if __name__ == "__main__":
    main()
