"""What the audit of the paper says about one equation, number or claim."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Verdict(Enum):
    """Whether what the paper says is true."""

    HOLDS = "holds"
    CORRECTED = "holds with a correction"
    FAILS = "does not hold"
    UNDECIDABLE = "not decidable"

    @classmethod
    def of(cls, holds: bool, otherwise: Verdict | None = None) -> Verdict:
        """Return HOLDS if the comparison `holds`, else `otherwise` (FAILS)."""
        return cls.HOLDS if holds else otherwise or cls.FAILS


@dataclass(frozen=True)
class Finding:
    """One equation, number or claim of the paper, and what was computed about it.

    Attributes
    ----------
    key : str
        Short unique name, such as "eom"; `npend paper --only KEY` shows the finding.
    place : str
        Where in its section the paper says it, such as "Eq. (18)" or "Table 1".
    claim : str
        What is said, in a few words.
    printed : str
        The paper's own formula or number.
    ours : str
        Our value, formatted from computed numbers.
    verdict : Verdict
        Follows from a comparison of computed numbers wherever it can.
    note : str
        Why, in one or two sentences; empty where there is nothing to add.
    """

    key: str
    place: str
    claim: str
    printed: str
    ours: str
    verdict: Verdict
    note: str = ""
