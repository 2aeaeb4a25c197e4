"""Analyse a campaign: fit the law of the pseudo-period, or summarise another study.

Of releases, the period against N and the amplitude is fitted with confidence intervals, outliers
are listed and a report is written, see docs/campaigns.md. Of another study, each number has its
mean, standard deviation and range over the trials of a cell. It uses the finished tasks, so it can
also run during a campaign.

Examples
--------
  npend analyse results                    tables, figures and report.html in results/analysis
  npend analyse results -o elsewhere
"""

from __future__ import annotations

from pathlib import Path

from npend_gym.cli.common import OK, can_draw, finishing, show_written, warn


def run(results: Path | str, *, out: Path | None = None) -> int:
    """Analyse, print and write; return the exit code.

    Parameters
    ----------
    results : folder
        A campaign's folder, or its URL.
    out : folder, optional
        Where to write (default FOLDER/analysis).
    """
    from npend_gym.experiments import analyse
    from npend_gym.experiments.campaign.folder import open_folder
    from npend_gym.report.campaign_report import analysis_text, write_analysis

    if out is None and open_folder(results).is_store:
        raise ValueError(f"--out must be given for {results}: a folder of this machine")
    result = analyse(results)
    print(analysis_text(result))
    if text := result.status.text():
        warn(text)
    with finishing():
        written = write_analysis(result, out or result.out / "analysis", figures=can_draw())
        show_written(written)
    return OK
