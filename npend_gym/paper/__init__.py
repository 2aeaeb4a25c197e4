"""The source paper, audited: every equation, number and claim computed again and judged.

`claims.ini` has the claims: what the paper says and where, and our text about it. The modules in
`checks` have one check per claim, beside its figures and tables. `audit` puts both together.
"""

from npend_gym._faces import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
