"""Write episodes for offline learning, as a data set of Minari.

"expert" is the policy of the package, and "medium" the same with noise on its actions. "robust" is
the robust policy with a new chain in every episode. The kind "plans" follows planned motions, and
"free" is for releases. Minari keeps the data in a folder of the user, or in that of the variable
MINARI_DATASETS_PATH; see docs/howto/offline.md.

Examples
--------
  npend dataset swingup-2 --kind medium
  npend dataset swingup-2 --kind robust --episodes 500 --seed 1000
  npend dataset transition-2 --kind plans --plans plans.npz
  npend dataset release-5 --kind free
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Literal

from npend_gym.cli.common import OK


def run(
    task: str,
    *,
    kind: Literal["random", "medium", "expert", "robust", "plans", "free"] = "expert",
    episodes: int = 100,
    seed: int = 0,
    plans: Path | None = None,
    as_json: bool = False,
) -> int:
    """Play, write and report; return the exit code.

    Parameters
    ----------
    task : task
        Such as swingup-2, balance-3-cart or release-5.
    kind : name
        Who chooses the actions.
    episodes : int
        Number of episodes.
    seed : int
        Seed of the first episode; the others have the following ones.
    plans : file, optional
        File (.npz) of the plans between equilibria, written where it is missing.
    as_json : bool
        Print what was written as JSON.
    """
    from npend_gym.rl.datasets import write_dataset

    found = write_dataset(task, kind, episodes=episodes, seed=seed, plans=plans)
    if as_json:
        print(json.dumps(found, indent=2))
    else:
        print(
            f"{found['id']}: {found['episodes']} episodes, {found['steps']} steps, "
            f"{found['success']:.0%} succeeded, mean return {found['return']:.1f}"
        )
    return OK
