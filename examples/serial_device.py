"""A pendulum behind a serial port: a simulator at a pseudo-terminal, for tests of control loops.

`python examples/serial_device.py fit.json` prints the name of its port. The device sends a line,
"microseconds count count ...": the time of its clock, and what single-turn encoders in the joints
show. Then it waits for a line with a torque [N m] at the base, moves the chain for two
milliseconds, sends the next line, and so on. The line "stop" ends it. Its clock stands still while
it waits, so a slow computer changes no motion.
"""

import argparse
import json
import os
import signal
import tty
from pathlib import Path

import numpy as np

from npend_gym import Chain
from npend_gym.physics import Ensemble

PERIOD = 0.002  # s, between two readings
JITTER = 0.0002  # s, by which a reading is early or late at most
DELAY = 0.0003, 0.0008  # s, after which a torque acts
COUNTS = 4096  # of an encoder, in a turn
START = 0.05  # rad from hanging at most
PATIENCE = 60  # s, for which the device waits for the controller


def main(path: str) -> None:
    """Serve one controller."""
    chain = Chain.from_dict(json.loads(Path(path).read_text("utf-8")))
    ensemble, rng = Ensemble(chain, size=1), np.random.default_rng(0)
    ensemble.advance(0.0, PERIOD)  # the first call compiles
    ensemble.set_state([0], rng.uniform(-START, START, (1, chain.n)), 0.0)
    device, port = os.openpty()
    tty.setraw(port)
    print(os.ttyname(port), flush=True)
    torque, clock, upright, tick = 0.0, 0.0, 0.0, 0
    with os.fdopen(device, "r+b", buffering=0) as line:
        while True:
            angles = np.diff(ensemble.theta[0], prepend=0.0)
            counts = np.rint(angles * COUNTS / (2.0 * np.pi)).astype(int) % COUNTS
            line.write(" ".join(map(str, [round(1e6 * clock), *counts])).encode() + b"\n")
            signal.alarm(PATIENCE)
            answer = line.readline()
            if answer.strip() == b"stop":
                break
            tick += 1
            ends, late = PERIOD * tick + rng.uniform(-JITTER, JITTER), rng.uniform(*DELAY)
            ensemble.advance(torque, late)
            torque = float(answer)
            ensemble.advance(torque, ends - clock - late)
            upright = upright + ends - clock if np.all(np.cos(ensemble.theta) < -0.95) else 0.0
            clock = ends
    print(f"after {clock:.1f} s the chain has stood for {upright:.1f} s")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("chain", help="file of its parameters, such as fit.json")
    main(parser.parse_args().chain)
