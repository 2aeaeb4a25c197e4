"""The audit: each claim of the paper computed and judged."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from typing import Any

from npend_gym.tools import count, show
from paper.checks.kane import KANE_N
from paper.claims import Claim, claims, render
from paper.registry import CHECKS, Outcome, Verdict, call


@dataclass(frozen=True)
class Finding(Claim):
    """A claim with the computed numbers in its text, and the verdict that follows from them."""

    verdict: Verdict = Verdict.UNDECIDABLE
    numbers: Mapping[str, Any] = field(default_factory=dict[str, Any])


def groups() -> dict[str, str]:
    """Return the group of each claim, the module that checks it, in the order of the paper."""
    return {key: CHECKS[key].__module__.rpartition(".")[-1] for key in claims()}


def selected(only: Sequence[str] | None = None) -> list[str]:
    """Return the keys of the claims that `only` names, by key or by group, in the paper's order."""
    known = groups()
    names = {*known, *known.values()}
    for name in only or ():
        if name not in names:
            near = get_close_matches(name, sorted(names), cutoff=0.0)
            raise ValueError(
                f"only must name findings or modules of the audit, such as {', '.join(near)}; "
                f"got {show(name)}"
            )
    return [key for key, group in known.items() if only is None or key in only or group in only]


def audit(only: Sequence[str] | None = None, *, kane_n: int = KANE_N) -> Iterator[Finding]:
    """Return an iterator over the findings, each computed when asked for, in the paper's order.

    Parameters
    ----------
    only : sequence of str, optional
        Keys of claims or names of groups, see `selected`.
    kane_n : int
        Largest chain whose equations are derived by Kane's method; the time grows fast.

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule.
    ImportError
        If SymPy is not installed and a finding needs it.
    """
    kane_n = count("kane_n", kane_n, low=4, high=30)
    return (finding(key, kane_n=kane_n) for key in selected(only))


def outcome(key: str, **options: Any) -> Outcome:
    """Compute the verdict and the numbers of one claim, with `options` of its check."""
    return call(CHECKS[key], key=key, **options)


def finding(key: str, **options: Any) -> Finding:
    """Compute one claim and put its numbers into its text."""
    verdict, numbers = outcome(key, **options)
    texts = {field: render(text, numbers) for field, text in vars(claims()[key]).items()}
    return Finding(**texts, verdict=verdict, numbers=numbers)


def by_section(findings: Iterable[Finding]) -> dict[str, list[Finding]]:
    """Return `findings` by sections of the paper, both in the paper's order."""
    order = list(claims())
    sections: dict[str, list[Finding]] = {}
    for one in sorted(findings, key=lambda one: order.index(one.key)):
        sections.setdefault(one.section, []).append(one)
    return sections
