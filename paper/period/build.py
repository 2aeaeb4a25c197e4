"""Set "The period of a released chain" as PDF: `python -m paper.period.build` (extra "paper")."""

from pathlib import Path

import typst

from npend_gym.report import prepare_folder
from npend_gym.tools import Parser, replacing

HERE = Path(__file__).parent

if __name__ == "__main__":
    parser = Parser(prog="python -m paper.period.build", description=__doc__)
    docs = HERE.parents[1] / "docs"
    parser.add_argument("folder", nargs="?", type=Path, default=docs, help="in place of docs")
    parser.add_argument("--pages", action="store_true", help="write each page as PNG, too")
    options = parser.parse_args()
    prepare_folder(options.folder, "FOLDER must be")
    with replacing(options.folder / "period_of_a_released_chain.pdf", binary=True) as file:
        file.write(typst.compile(HERE / "period.typ"))
    print("set:", options.folder / "period_of_a_released_chain.pdf")
    if options.pages:
        pages = options.folder / "period_{p}.png"
        typst.compile(HERE / "period.typ", output=pages, format="png", ppi=110.0)
        print("drawn:", pages)
