"""Trainers by name: those of this package, and those that other packages offer."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import entry_points
from typing import Any, Protocol

from npend_gym import _checks
from npend_gym.rl.policies.policy import Policy
from npend_gym.rl.training.checkpoints import Checkpoint
from npend_gym.rl.training.tasks import Curve

GROUP = "npend_gym.trainers"  # of entry points
PREFERRED = "shac", "imitation"  # where several know a task, the first


class Trainer(Protocol):
    """A module, or an object, that `npend train` can call.

    A package offers its own by an entry point, in its pyproject.toml::

        [project.entry-points."npend_gym.trainers"]
        mine = "my_package.my_trainer"

    Attributes
    ----------
    Settings : type
        A dataclass of everything that the result depends on; two fields are "env", the keywords of
        the environment, and "seed".
    TASKS : mapping
        Changes of the default settings, by the names of the tasks.
    """

    Settings: type[Any]
    TASKS: Mapping[str, Mapping[str, Any]]

    def settings_of(self, task: str, **changes: Any) -> Any:
        """Return the settings for a task such as "swingup-2"."""
        ...

    def train(
        self, settings: Any, progress: str | None = None, checkpoint: Checkpoint | None = None
    ) -> tuple[Policy, Curve]:
        """Return the policy and its learning curve, whose rows have "steps" at least.

        Parameters
        ----------
        settings : Settings
        progress : str, optional
            Title of the progress display; without it there is none.
        checkpoint : Checkpoint, optional
            Its `rounds` yields the remaining rounds and stores what changes in them, so that
            ``npend train --resume`` continues from there.
        """
        ...


def trainer_names() -> list[str]:
    """Return the names of all installed trainers, this package's own first."""
    found = entry_points(group=GROUP).names
    return [*(name for name in PREFERRED if name in found), *sorted(found - {*PREFERRED})]


def trainer(name: str) -> Trainer:
    """Return a trainer by its name.

    Raises
    ------
    ValueError
        If none of this name is installed.
    """
    _checks.choice("algorithm", name, (*trainer_names(),))
    return entry_points(group=GROUP)[name].load()
