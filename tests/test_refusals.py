"""What is wrong on a command line is named in one line, and nothing is made."""

import pytest

REFUSED = [
    ("", "COMMAND"),
    ("fly", "invalid choice: 'fly'"),
    ("bench --only gpu", "run `python benchmarks/peers.py` in a clone"),
    ("paper --list", "paper is not in the package: run `python -m paper` in a clone"),
    ("law --full", "law is not in the package: run `python -m paper --only com-law`"),
    ("release --n 0", "n must be between 1 and 1000000, got 0"),
    ("release --n two", "--n: must be whole numbers joined by commas such as 1,2,3; got two"),
    ("release --n 1 --lengths 0.25,0.5,1", "lengths must be one number for n = 1, got shape"),
    ("release --lengths 1;2", "--lengths: must be a number, or numbers joined by commas"),
    ("release --amplitude 4", "must stay within pi rad, got 4\n"),
    ("release --amplitude 60", "must stay within pi rad, got 60: 60 degrees are 1.047 rad"),
    ("release --amplitude 60grad", "in degrees such as 60deg; got 60grad"),
    ("release --amplitude pi/0", "in radians such as 0.5 or pi/3"),
    ("release --reading swing", "reading must be one of bob, link, height, com; got 'swing'"),
    ("release --reading listing", "is `listing_periods` in paper/estimator.py of a clone"),
    ("release --masses 1,2", "masses must be one number or 5"),
    ("release --colour red", "release: error: unrecognized arguments: --colour red; See "),
    ("release --angle 60", "--angle 60; did you mean --amplitude? See npend release --help"),
    ("animate --out a.gif --friction=1", "did you mean --damping?"),
    ("page --out a.html --nn 3", "did you mean --n?"),
    ("campaign --out a --trails 3", "did you mean --trials?"),
    ("animate --policy calm-1 -o a.gif", "did you mean `npend animate calm-1 -o a.gif`?"),
    ("examples --copy=a", "did you mean `npend examples --out a`?"),
    (f"release --chain {'x' * 300}", "xxx cannot be read: File name too long"),
    (f"evaluate --env x={'[' * 50_000}", "x has too many lists inside each other"),
    ("chaos map --masses 1,2,3", "masses must be one number or an array of shape (2,), got"),
    ("chaos map --centre 1,2,3", "centre must be one number or an array of shape (2,), got"),
    ("chaos map --gravity -1", "gravity must be zero or more"),
    ("chaos map --rtol 0", "rtol must be at least"),
    ("animate --n 2 --masses 1,2,3 --out {new}/a.gif", "masses must be one number or 2"),
    ("page --n 2 --masses 1,2,3 --out {new}/a.html", "masses must be one number or 2"),
    ("campaign --n 2 --masses 1:2:3 --out {new}", "masses must"),
    ("page {new}/none --out {new}/a.html", "none"),
    ("chaos map --size 10 --threads 0 --out {new}", "threads must be between 1 and"),
    ("chaos map --out map.png", "out must be a folder, in which map.png and map.npz appear"),
    ("release --n 1 --out /dev/null/x", "out must be a folder"),
    # films
    ("animate --out a.png", "out must be a file that ends in .gif or .mp4, got a.png"),
    ("animate --out .", "out must be a file"),
    ("animate --n 0 --out a.gif", "n must be between 1"),
    ("animate --fps 0 --out a.gif", "fps must be greater than zero"),
    ("animate --speed -1 --out a.gif", "speed must be greater than zero"),
    ("animate --size 241 --out a.gif", "size must be even"),
    ("animate --size 8 --out a.gif", "size must be between"),
    ("animate --reading listing --out a.gif", "reading must be one of bob, link, height"),
    ("animate swingup-2 --n 3 --out a.gif", "--n is for releases"),
    ("animate nowhere --out a.gif", "policy must be a file or one of balance-1,"),
    ("animate", "--out"),
    ("animate swingup-2 --seed -1 --out a.gif", "seed must be at least 0, got -1"),
    ("animate swingup-2 --duration 0 --out a.gif", "duration must be greater than zero"),
    ("animate swingup-2 --duration 1e12 --out a.gif", "at most 20000000 angles"),
    # pages
    ("page --out a.htm", "out must be a file that ends in .html"),
    ("page nowhere --out a.html", "nowhere must hold results"),
    ("page . --n 3 --out a.html", "--n must be left out with results"),
    ("page --n 0 --out a.html", "n must be between 1"),
    ("page --reading listing --out a.html", "reading must be one of"),
    ("page", "--out"),
    ("page --live --out live.html", "npend play --out live.html"),
    ("play --n 0", "n must be between 1 and 100"),
    ("play --n 101", "n must be between 1 and 100"),
    ("play --amplitude 0", "amplitude must be within 0.09 to 3.05 rad, got 0"),
    ("play --amplitude 60", "got 60: 60 degrees are 1.047 rad"),
    ("play --amplitude nan", "amplitude must be finite"),
    ("play --n 3 --chain acrobot", "n must be left out where chain is given, got 3"),
    ("play --out live.htm", "out must be a file that ends in .html"),
    # campaigns
    ("campaign", "--out"),
    ("campaign --out {new}", "there is no campaign"),
    ("campaign --out {new} --n 0", "n must be at least 1"),
    ("campaign --out {new} --n two", "--n"),
    ("campaign --out {new} --n 3 --masses 1:2", "masses must be one number or 3"),
    ("campaign --out {new} --n 2 --backend mpi", "backend must be one of"),
    ("campaign --out {new} --n 2 --workers 0", "workers must be at least 1"),
    ("campaign --out {new} --n 2 --address auto", "address must be left out"),
    ("campaign --out /dev/null/x --n 2", "out must be a folder"),
    ("campaign nowhere.toml --out {new}", "No such file"),
    ("analyse {new}", "there is no campaign"),
    # learning
    ("evaluate", "give either a policy, or --controller"),
    ("evaluate swingup-1 --controller LQR", "give either a policy"),
    ("evaluate swingup-1 --task calm-1", "--task is for a --controller"),
    ("evaluate swingup-99", "policy must be a file or one of"),
    ("evaluate --controller PID", "controller must be one of LQR, MPC"),
    ("evaluate swingup-1 --env dampign=1", "did you mean 'damping'"),
    ("evaluate swingup-1 --env chain=none.json", "must be one of acrobot"),
    ("evaluate swingup-1 --env damping", "must be NAME=VALUE, got damping"),
    ("train swingup-2-fast", 'task must be like "swingup-2" or "swingup-2-robust"'),
    ("train swing-2", 'task must be like "swingup-2"'),
    ("train calm", 'task must be like "swingup-2"'),
    ("train calm-2 --algorithm dqn", "algorithm must be one of shac, imitation"),
    ("train calm-2 --set gama=0.9", "--set must name one of total_timesteps"),
]


@pytest.mark.parametrize(("line", "message"), REFUSED)
def test_bad_arguments_exit_with_2_and_one_line_that_names_them(
    line, message, refusal, tmp_path, monkeypatch
):
    if line.startswith("train"):
        pytest.importorskip("torch")
    monkeypatch.chdir(tmp_path)
    assert message in refusal(*line.format(new=tmp_path / "new").split())
    assert not list(tmp_path.iterdir())  # no folder is made for a command that is refused
