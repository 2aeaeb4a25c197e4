"""Set "The period of a released chain" as PDF: `python -m paper.period.build` (extra "paper").

A folder as argument takes the place of `docs`; `--pages` writes each page as PNG besides.
"""

import sys
from pathlib import Path

import typst

HERE = Path(__file__).parent

if __name__ == "__main__":
    folder = Path(next((one for one in sys.argv[1:] if one != "--pages"), HERE.parents[1] / "docs"))
    typst.compile(HERE / "period.typ", output=folder / "period_of_a_released_chain.pdf")
    print("set:", folder / "period_of_a_released_chain.pdf")
    if "--pages" in sys.argv:
        pages = folder / "period_{p}.png"
        typst.compile(HERE / "period.typ", output=pages, format="png", ppi=110.0)
        print("drawn:", pages)
