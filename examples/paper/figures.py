"""Draw figures of the paper's reproduction into a folder.

Run it with `python examples/paper/figures.py figures trajectory runge_kutta`; without names it
draws all of them, in some three minutes.
"""

import sys
from pathlib import Path

from npend_gym.paper import DRAWINGS, draw

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "figures")
folder.mkdir(parents=True, exist_ok=True)

for name in sys.argv[2:] or DRAWINGS:
    for path in draw(name, folder):
        print("drawn:", path)
