"""What is wrong on a command line is named in one line, and nothing is made."""

import pytest

REFUSED = [
    ("", "COMMAND"),
    ("fly", "invalid choice: 'fly'"),
    ("release --n 0", "n must be between 1 and 1000000, got 0"),
    ("release --n two", "--n: must be whole numbers joined by commas such as 1,2,3; got two"),
    ("release --n 1 --lengths 0.25,0.5,1", "lengths must be one number for n = 1, got shape"),
    ("release --lengths 1;2", "--lengths: must be a number, or numbers joined by commas"),
    ("release --amplitude 4", "must stay within pi rad, got 4\n"),
    ("release --amplitude 60", "must stay within pi rad, got 60: 60 degrees are 1.047 rad"),
    ("release --amplitude 60grad", "in degrees such as 60deg; got 60grad"),
    ("release --amplitude pi/0", "in radians such as 0.5 or pi/3"),
    ("release --definition swing", "one of bob, link, height, com, horizontal; got 'swing'"),
    ("release --definition listing", "is `listing_periods` in paper/estimator.py of a clone"),
    ("release --masses 1,2", "masses must be one number or 5"),
    ("chaos map --colour red", "chaos: error: unrecognized arguments: --colour red; See "),
    ("play --angle 60", "--angle 60; did you mean --amplitude? See npend play --help"),
    ("simulate --film a.gif --friction=1", "did you mean --damping?"),
    ("simulate --time 5", "did you mean --duration?"),
    ("release --page a.html --nn 3", "did you mean --n?"),
    ("campaign --out a --trails 3", "did you mean --trials?"),
    (f"release --chain {'x' * 300}", "xxx cannot be read: File name too long"),
    (f"evaluate --env x={'[' * 50_000}", "x has too many lists inside each other"),
    ("chaos map --masses 1,2,3", "masses must be one number or an array of shape (2,), got"),
    ("chaos map --centre 1,2,3", "centre must be one number or an array of shape (2,), got"),
    ("chaos map --gravity -1", "gravity must be zero or more"),
    ("chaos map --rtol 0", "rtol must be at least"),
    ("simulate --n 2 --masses 1,2,3 --film {new}/a.gif", "masses must be one number or 2"),
    ("release --n 2 --masses 1,2,3 --page {new}/a.html", "masses must be one number or 2"),
    ("campaign --n 2 --masses 1:2:3 --out {new}", "masses must"),
    ("release {new}/none --page {new}/a.html", "none"),
    ("chaos map --size 10 --threads 0 --out {new}", "threads must be between 1 and"),
    ("chaos map --out map.png", "out must be a folder, in which map.png and map.npz appear"),
    ("release --n 1 --out /dev/null/x", "out must be a folder"),
    # motions and films
    ("simulate --film a.png", "film must be a file that ends in .gif or .mp4, got a.png"),
    ("simulate --film .", "film must be a file"),
    ("simulate --csv a.txt", "csv must be a file that ends in .csv, got a.txt"),
    ("simulate --plot a.jpg", "plot must be a file that ends in .png or .pdf, got a.jpg"),
    ("simulate --n 0 --film a.gif", "n must be between 1"),
    ("simulate --fps 0 --film a.gif", "fps must be greater than zero"),
    ("simulate -n 1 --fps 60 --film a.gif", "fps must be at most 50 in a GIF"),
    ("simulate --speed -1 --film a.gif", "speed must be greater than zero"),
    ("simulate --size 241 --film a.gif", "size must be even"),
    ("simulate --size 8 --film a.gif", "size must be between"),
    ("simulate --interval 0", "interval must be greater than zero"),
    ("simulate --duration 0", "duration must be greater than zero"),
    ("simulate --theta 1,2 --omega 1,2,3", "theta must be one number or an array of shape (3,)"),
    ("simulate --theta 1,2 --n 3", "theta must be one number or an array of shape (3,)"),
    ("simulate --n 3 --chain acrobot", "--n must be left out where chain is given"),
    ("simulate --theta 60grad", "in degrees such as 60deg; got 60grad"),
    ("simulate --definition listing --film a.gif", "definition must be one of bob, link, height"),
    ("simulate swingup-2 --n 3 --film a.gif", "--n must be left out with a policy"),
    ("simulate swingup-2 --chain acrobot", "--chain must be left out with a policy"),
    ("simulate --seed 3", "--seed is for policies: name one"),
    ("simulate nowhere --film a.gif", "policy must be a file or one of balance-1,"),
    ("simulate --amplitude 2 -n 3", "did you mean --theta?"),
    ("simulate swingup-2 --seed -1 --film a.gif", "seed must be at least 0, got -1"),
    ("simulate swingup-2 --duration 0 --film a.gif", "duration must be greater than zero"),
    ("simulate swingup-2 --duration 1e12 --film a.gif", "at most 20000000 angles"),
    # pages
    ("release --page a.htm", "page must be a file that ends in .html"),
    ("release nowhere --page a.html", "nowhere must hold results"),
    ("release . --n 3 --page a.html", "--n must be left out with results"),
    ("release --n 0 --page a.html", "n must be between 1"),
    ("release --definition listing --page a.html", "definition must be one of"),
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
    ("campaign --out {new} --n 2 --workers 0", "workers must be between 1 and 1000"),
    ("campaign --out {new} --n 2 --address auto", "address must be left out"),
    ("campaign --out /dev/null/x --n 2", "out must be a folder"),
    ("campaign nowhere.toml --out {new}", "No such file"),
    ("analyse {new}", "there is no campaign"),
    ("campaign --status {new} --n 3", "n must be left out with --status and --merge"),
    ("campaign --merge {new} --out elsewhere", "out must be left out with --status and --merge"),
    ("campaign --status {new} --dry-run", "--dry-run must be left out with --status and --merge"),
    ("campaign --status {new} --set a=1", "--set must be left out with --status and --merge"),
    ("campaign --out {new} --n 2 --shards 0", "--shards must be left out without --slurm; got 0"),
    ("campaign --out {new} --n 2 --slurm --shard 1/2", "--shard must be left out with --slurm"),
    ("campaign --out {new} --n 2 --n 3", "--n: must be given once: join its values by commas"),
    # learning
    ("evaluate", "give either a policy, or --controller"),
    ("evaluate swingup-1 --controller LQR", "give either a policy"),
    ("evaluate swingup-1 --task calm-1", "--task is for a --controller"),
    ("evaluate swingup1", "got swingup1; did you mean 'swingup-1'?"),
    ("evaluate swingup-1 --set damping=1", "did you mean --env?"),
    ("evaluate swingup-1 --env id=npend/Balance-v1", "--env id must be left out, --env-id says it"),
    ("evaluate --controller PID", "controller must be one of LQR, MPC"),
    ("evaluate swingup-1 --env n=1 --env n=2", "--env: must have each name once, got n twice"),
    ("evaluate swingup-1 --env dampign=1", "did you mean 'damping'"),
    ("evaluate swingup-1 --env chain=none.json", "must be one of acrobot"),
    ("evaluate swingup-1 --env damping", "must be NAME=VALUE, got damping"),
    ("evaluate swingup-1 --env max_torque=-1 --out {new}", "max_torque must be zero or more"),
    ("train swingup-2 --around a.json --env chain=acrobot", "chain must be left out, --around"),
    ("train swingup-2-fast", 'task must be like "swingup-2" or "swingup-2-robust"'),
    ("train swing-2", 'task must be like "swingup-2"'),
    ("train calm", 'task must be like "swingup-2"'),
    ("train calm-2 --algorithm dqn", "algorithm must be one of shac, imitation"),
    ("train calm-2 --set gama=0.9", "--set must name one of total_timesteps"),
    ("train swingup-1 --set total_timesteps=0", "total_timesteps must be at least 1"),
    ("train swingup-1 --env threads=2", "shac does not use threads: leave it out; got 2"),
    ("train swingup-1 --algorithm imitation --set rounds=1", "rounds must be at least 2"),
    ("train swingup-1 --out {new}/a --seed -1", "seed must be between 0 and 2147483647"),
    ("train swingup-1 --set critic_hidden=0.5", "critic_hidden must be an integer, got 0.5"),
    *(
        (f"train swingup-1 --algorithm imitation --set {setting}", message)
        for setting, message in (
            ("minibatch_size=0", "minibatch_size must be at least 1, got 0"),
            ("learning_rate=-1", "learning_rate must be zero or more, got -1"),
            ("averaging=1", "averaging must lie from 0 to below 1, got 1"),
            ("plan_seed=-1", "plan_seed must be at least 0, got -1"),
            ("max_states=1", "max_states must be at least 512, got 1"),
            ("kept=2", "kept must be at most 1, got 2"),
            ("obs_scale=1", "obs_scale must be 3 numbers, got 1"),
            ("obs_scale=[0,1,1]", "obs_scale must be greater than zero"),
            ("rescuer=5", "rescuer must be a text, got 5"),
            ("errors=5", "errors must be a dict, got 5"),
        )
    ),
    ("train swingup-2 --algorithm imitation --seed -1", "seed must be between 0 and 2147483647"),
    *(
        (f"train swingup-2 --algorithm shac --seed {seed}", f"and 2147483647, got {seed}")
        for seed in (-1, 2**31, 2**70)
    ),
    *(
        (f"train swingup-2 --algorithm shac --env {setting}", "shac does not use " + name)
        for name, setting in [
            ("randomize", 'randomize={{"velocity_noise":{{"low":0,"high":1}}}}'),
            *((name, f"{name}=1") for name in (
                "velocity_noise", "observation_delay", "action_delay", "motor_lag", "torque_noise",
            )),
            *((name, f"{name}=3") for name in ("torque_levels", "max_episode_steps")),
        ]
    ),
    (
        "train swingup-2 --algorithm imitation --env max_episode_steps=3",
        "imitation does not use max_episode_steps",
    ),
    *(
        (f"train swingup-2 --algorithm {name} --env {setting}", message)
        for name, setting, message in (
            ("imitation", "observation=angles", 'observation must be "sincos" for imitation'),
            ("imitation", "mode=passive", "mode must be one with an expert"),
            ("shac", "observation=angles", 'observation must be "sincos" for shac'),
            ("shac", "mode=passive", "mode must have a motor for shac"),
            ("shac", "dampign=1", "did you mean 'damping'"),
        )
    ),
    # exports
    ("export --to mjcf --out a.xml", "--to mjcf needs --chain"),
    ("export --chain acrobot --to mjcf --out a.xml calm-1", "policy and --controller must be"),
    ("export --chain acrobot --to mjcf --out a.xml --controller LQR", "--controller must be left"),
    ("export calm-1 --to c --out a.h --motors 1", "--motors is for --to mjcf"),
    ("export --chain acrobot --to urdf --out a.urdf --motors 0", "--motors is for --to mjcf"),
    ("export --chain acrobot --to c --out a.h", "--chain is for --to mjcf, urdf, sdf or usd"),
    ("export calm-1 --to c --prefix 1a --out {new}/a.h", "prefix must be a letter"),
    ("export calm-1 --to c --out policy.c", "out must be a file that ends in .h"),
    ("export calm --to c --prefix arm --relative --out a.h", "policy must be a file or one of"),
]  # fmt: skip


@pytest.mark.parametrize(("line", "message"), REFUSED)
def test_bad_arguments_exit_with_2_and_one_line_that_names_them(
    line, message, refusal, tmp_path, monkeypatch
):
    if line.startswith("train"):
        pytest.importorskip("torch")
    monkeypatch.chdir(tmp_path)
    assert message in refusal(*line.format(new=tmp_path / "new").split())
    assert not list(tmp_path.iterdir())  # no folder is made for a command that is refused
