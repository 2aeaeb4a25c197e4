"""Trainers of policies (extra "rl"): a module for each algorithm, all with the same three names.

`Settings` has everything that a result depends on, `settings_of(task)` those for a task such as
"swingup-2", and ``train(settings)`` returns the policy and its learning curve.
"""

from npend_gym._faces import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
