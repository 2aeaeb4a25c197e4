"""Judge a policy or a controller on held-out episodes, and film it.

Run it with `python examples/evaluate.py --pretrained swingup-2 --video swingup-2.gif`.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from npend_gym.rl import controllers
from npend_gym.rl.evaluation import HELD_OUT, Agent, Evaluation, evaluate, wilson_interval
from npend_gym.rl.planning import planned_swing_up
from npend_gym.rl.policies import Policy, pretrained_names

CONTROLLERS = ("LQR", "damping", "energy", "plan")
# swing-ups planned for long chains: seconds, and seconds of calming before
PLANS: dict[int, dict[str, float]] = {
    2: {}, 3: {}, 4: {"seconds": 8.0}, 5: {"seconds": 12.0, "settle": 10.0}
}  # fmt: skip


def controller(name: str, keywords: dict[str, Any]) -> Agent:
    """Return a reference controller for the task."""
    config = gym.make("NPendulum-v0", **keywords).unwrapped.config
    if name == "energy":
        return controllers.swing_up(config)
    if name == "plan":
        return planned_swing_up(config, **PLANS.get(config.chain.n, {}))
    if name == "damping":
        return controllers.damper(config)
    return controllers.lqr(config, 0.0 if keywords["mode"] == "calm" else np.pi)


def chosen(arguments: argparse.Namespace) -> tuple[Agent, dict[str, Any]]:
    """Return the agent asked for and the keywords of its environment."""
    if arguments.run:
        from train_sb3 import agent_of, held_out, load_run

        model, config = load_run(arguments.run)
        return agent_of(model), held_out(config)
    if arguments.controller:
        mode, n = arguments.task.rsplit("-", 1)
        keywords: dict[str, Any] = {"mode": mode, "n": int(n)}
        return controller(arguments.controller, keywords), keywords
    policy = (
        Policy.load(arguments.policy)
        if arguments.policy
        else Policy.pretrained(arguments.pretrained)
    )
    return policy, policy.provenance["env"]


def film(agent: Agent, keywords: dict[str, Any], seed: int, seconds: float, path: Path) -> None:
    """Write the start of an episode as .mp4 or .gif, 25 frames a second, or 12 frames as .png."""
    import imageio.v3 as imageio

    env: Any = gym.make("NPendulum-v0", render_mode="rgb_array", **keywords)
    observation, info = env.reset(seed=seed)
    frames, done = [env.render()], False
    skip = max(1, round(env.metadata["render_fps"] / 25))
    while not done:
        batch = {key: np.asarray(value)[None] for key, value in info.items()}
        action = agent(observation[None], batch)[0].astype(np.float32)
        observation, _, terminated, truncated, info = env.step(action)
        done = terminated or truncated or info["time"] >= seconds
        if round(info["time"] / env.unwrapped.config.dt) % skip == 0:
            frames.append(env.render())
    env.close()
    if path.suffix == ".png":
        shown = np.linspace(0, len(frames) - 1, 12).astype(int)
        small = [frames[k][::2, ::2] for k in shown]
        imageio.imwrite(path, np.vstack([np.hstack(small[:6]), np.hstack(small[6:])]))
        return
    rate = env.metadata["render_fps"] / skip
    timing = {"duration": 1000.0 / rate, "loop": 0} if path.suffix == ".gif" else {"fps": rate}
    imageio.imwrite(path, np.stack(frames), **timing)


def report(seen: Evaluation) -> str:
    """Return the figures as text."""
    successes, episodes = int(seen.success.sum()), seen.success.size
    low, high = wilson_interval(successes, episodes)
    interval = f"95 % confidence {low:.1%} to {high:.1%} (Wilson)"
    lines = [
        f"success  {successes}/{episodes} = {seen.rate:.1%}, {interval}",
        f"return   {seen.returns.mean():.2f} +- {seen.returns.std():.2f} over episodes",
        f"work     {seen.spent.mean():.2f} J done by or on the motors in an episode",
    ]
    if successes:
        lines.insert(1, f"goal met from {np.nanmean(seen.since):.2f} s on, in successful episodes")
    return "\n".join(lines)


def main() -> None:
    """Evaluate what the command line names."""
    parser = argparse.ArgumentParser(description=__doc__)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--pretrained", choices=pretrained_names(), help="comes with the package")
    what.add_argument("--policy", type=Path, help=".npz that train_cleanrl.py, say, has written")
    what.add_argument("--run", type=Path, help="folder that train_sb3.py has written")
    what.add_argument("--controller", choices=CONTROLLERS)
    parser.add_argument("--task", default="swingup-2", help='of the controller, as in "balance-3"')
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--seed", type=int, default=HELD_OUT, help="of the first episode")
    parser.add_argument("--video", type=Path, help="of the first episode: .mp4, .gif or .png")
    parser.add_argument("--seconds", type=float, default=15.0, help="length of the film")
    arguments = parser.parse_args()
    agent, keywords = chosen(arguments)
    print(f"NPendulum-v0 {keywords}")
    print(report(evaluate(agent, keywords, episodes=arguments.episodes, seed=arguments.seed)))
    if arguments.video:
        film(agent, keywords, arguments.seed, arguments.seconds, arguments.video)
        print(f"written: {arguments.video}")


if __name__ == "__main__":
    main()
