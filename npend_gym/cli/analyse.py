"""Fit the law of the pseudo-period to a campaign, list outliers, write a report.

The period against N and the amplitude is fitted with confidence intervals, see docs/campaigns.md.
It uses the finished tasks, so it can also run during a campaign.

Examples
--------
  npend analyse results                    tables, figures and report.html in results/analysis
  npend analyse results -o elsewhere
"""

from __future__ import annotations

from pathlib import Path

from npend_gym.cli.common import OK, can_draw, finishing, show_written, warn


def run(results: Path, *, out: Path | None = None) -> int:
    """Analyse, print and write; return the exit code.

    Parameters
    ----------
    results : folder
        A campaign's folder.
    out : folder, optional
        Where to write (default FOLDER/analysis).
    """
    from npend_gym.experiments import analyse
    from npend_gym.report.campaign_report import analysis_text, write_analysis

    result = analyse(results)
    print(analysis_text(result))
    if text := result.status.text():
        warn(text)
    with finishing():
        written = write_analysis(result, out or result.out / "analysis", figures=can_draw())
        show_written(written)
    return OK
