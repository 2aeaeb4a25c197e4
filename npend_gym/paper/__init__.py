"""The source paper, audited: every equation, number and claim computed again and judged.

`claims.ini` has the claims: what the paper says and where, and our text about it. The modules in
`checks` have one check per claim, beside its figures and tables. `audit` puts both together.
"""

from npend_gym.paper.audit import KANE_N, Finding, audit, selected
from npend_gym.paper.registry import Verdict

__all__ = ["KANE_N", "Finding", "Verdict", "audit", "selected"]
