"""`npend identify`: CSV files, what is written, and what is refused."""

import json
import re

import gymnasium as gym
import numpy as np
import pytest
from test_identification import DATA, TRUE, recorded

from npend_gym import Chain, identify, simulate, theory
from npend_gym.cli import main
from npend_gym.identification import Identification, read_motion
from npend_gym.identification.motion import check_motion
from npend_gym.identification.parameters import new_model, values_of
from npend_gym.identification.problem import FitProblem
from npend_gym.identification.stages import hold_out
from npend_gym.identification.uncertainty import undetermined
from npend_gym.report.identification_report import identification_text

GOOD = "".join(f"{0.02 * k:.2f},{np.sin(0.15 * k):.6f}\n" for k in range(60))


@pytest.fixture
def motion_file(tmp_path):
    """A function that writes lines to a CSV file and returns its name."""

    def write(text, name="motion.csv"):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return str(path)

    return write


@pytest.mark.long
def test_the_command_writes_a_chain_that_environments_take(tmp_path, capsys):
    motion = read_motion(DATA / "multiarm_double.csv")
    lines = (DATA / "multiarm_double.csv").read_text().splitlines()
    few = [line for line in lines[1:] if int(line.split(",")[0]) >= 3][::2]  # at 62.5 Hz
    (tmp_path / "few.csv").write_text("\n".join([lines[0], *few]))
    out = tmp_path / "results"
    arguments = ["--chain", "multiarm 2", "--segment", "1.4", "--out", str(out)]
    assert main(["identify", str(tmp_path / "few.csv"), *arguments]) == 0
    text = capsys.readouterr().out
    assert "not determined by the data:" in text
    assert "  - the scale: free swings" in text
    chain = json.loads((out / "fit.json").read_text())
    env = gym.make("NPendulum-v0", chain=chain, mode="swingup")
    assert env.unwrapped.config.chain == Chain.from_dict(chain)
    env.reset(seed=0)
    assert np.isfinite(env.step(env.action_space.sample())[1])
    record = json.loads((out / "identification.json").read_text())
    assert record["held_out_rmse"] < 2e-3 < motion.links
    assert record["provenance"]["arguments"]["segment"] == 1.4
    rows = (out / "residuals.csv").read_text().splitlines()
    assert rows[0] == "piece,time,held_out,residual0,residual1"
    assert len(rows) == len(few) + 1
    written = {path.name for path in out.iterdir()}
    assert written >= {"held_out.png", "errors.png", "parameters.png", "manifest.json"}


@pytest.fixture
def found():
    """An identification of one segment: friction0 is not determined, damping0 at its bound."""
    segment = {"piece": 0, "start": 0.0, "end": 1.0, "held_out": False, "rmse": 1e-3}
    return Identification(
        chain=Chain.uniform(1), names=("inertia0", "damping0", "friction0"),
        units=("kg m^2", "N m s/rad", "N m"), values=np.array([1.0, 0.0, 0.1]),
        standard_errors=np.array([0.01, 1e-5, np.inf]), correlation=np.eye(3), chain_errors={},
        offsets=np.zeros(1), left_out=("damping: zero",), small_periods=np.array([2.0061]),
        small_period_errors=np.array([0.01]), mean_periods=np.array([np.nan]),
        given_rmse=np.nan, segments=(segment,),
        outliers=np.zeros((20, 1), bool), residuals=np.zeros((20, 1)),
        held_out=np.zeros(20, bool), undetermined=(), provenance={"arguments": {}},
    )  # fmt: skip


def test_values_at_their_bound_are_so_in_text_and_figure(found):
    from npend_gym.report import identification_figures as draw

    text = identification_text(found)
    assert re.search(r"damping0 +0 +1e-05 +N m s/rad, at its bound\n", text)
    assert re.search(r"friction0 +0.1 +not determined N m\n", text)
    notes = draw.parameters(found).axes[0].texts
    shown = [(note.get_text(), note.xy[1]) for note in notes]
    assert shown == [("at its bound", 1), ("not determined", 2)]


def test_the_errors_of_one_segment_have_whole_ticks_and_no_series_that_is_empty(found):
    from npend_gym.report import identification_figures as draw

    axes = draw.errors(found).axes[0]
    assert axes.get_xlim() == (-0.5, 0.5)
    assert all(tick == round(tick) for tick in axes.get_xticks())
    assert axes.get_legend_handles_labels()[1] == ["segments fitted, fitted chain"]


def test_columns_are_found_by_name_and_angles_of_joints_in_degrees_are_converted(motion_file):
    lines = [f"x,{k % 7},{0.5 * k},{0.1 * k},{30.0 + k},{0.3}\n" for k in range(40)]
    path = motion_file("\ufeffnote,theta1,tau0,time,theta0,more\n" + "".join(lines))
    motion = read_motion(path, degrees=True, relative=True)
    k = np.arange(40)
    assert motion.theta == pytest.approx(np.radians([30.0 + k, 30.0 + k + k % 7]).T)
    assert motion.torque == pytest.approx(np.array([0.5 * k, 0.0 * k]).T)
    assert motion.times == pytest.approx(0.1 * k)
    assert not motion.piece.any()


def test_columns_of_other_names_are_read_by_those_names(motion_file, capsys):
    lines = [f"{0.1 * k},{0.01 * k},7,{0.5 * k},8\n" for k in range(40)]
    path = motion_file("t [s],q1,theta0,u,tau1\n" + "".join(lines))
    named = {"time": "t [s]", "theta0": "q1", "tau0": "u", "tau1": "theta0"}
    with pytest.raises(ValueError, match="an angle for each torque"):
        read_motion(path, columns=named)
    motion = read_motion(path, columns=named | {"theta1": "theta0", "tau1": "tau1"})
    k = np.arange(40)
    assert motion.theta == pytest.approx(np.array([0.01 * k, 0.0 * k + 7.0]).T)
    assert motion.torque == pytest.approx(np.array([0.5 * k, 0.0 * k + 8.0]).T)
    with pytest.raises(SystemExit):
        main(["identify", path, "--lengths", "1", "--columns", "time=t [s],theta0=q2"])
    assert "has no column 'q2': it has 't [s], q1, theta0, u, tau1'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("more", "drive", "column"),
    [
        ({"stiffness": 900.0}, {}, "stretch0"),
        ({}, {"pivot_acceleration": [0.1, 0.0]}, "position_x"),
    ],
)
def test_of_a_chain_that_no_fit_takes_the_columns_that_are_not_read_are_named(
    more, drive, column, tmp_path
):
    path = tmp_path / "motion.csv"
    chain = Chain.uniform(1, **more)
    simulate(chain, 0.5, 0.0, np.arange(40) / 40, **drive).to_csv(path)
    with pytest.warns(UserWarning, match=f"column {column}, which is not read: identify takes"):
        read_motion(path)


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        ({"columns": {"q1": "theta0"}}, ValueError, "columns"),
        ({"columns": {"theta0": "q1", "theta1": "q1"}}, ValueError, "columns"),
        ({"columns": {"time": "theta0"}}, ValueError, "column theta0, or angles, positions x and"),
        ({"columns": {"time": 3}}, TypeError, "columns"),
        ({"columns": "t"}, TypeError, "columns"),
        ({"degrees": "no"}, TypeError, "degrees must be True or False, got 'no'"),
        ({"relative": "no"}, TypeError, "relative must be True or False, got 'no'"),
    ],
)
def test_arguments_that_read_motion_cannot_take_are_refused_by_name(
    given, error, message, motion_file
):
    with pytest.raises(error, match=message):
        read_motion(motion_file("time,theta0\n" + GOOD), **given)


def test_the_pieces_of_several_files_are_numbered_on(motion_file):
    paths = [motion_file("time,theta0\n" + GOOD, name) for name in ("a.csv", "b.csv")]
    with pytest.raises(TypeError, match="each of paths must be a string or path-like, got"):
        read_motion(paths)
    with pytest.raises(ValueError, match=r"paths must name each recording once, but .*a\.csv and"):
        read_motion(*paths)
    motion_file("time,theta0\n" + GOOD + "9.0,0.0\n", "b.csv")
    assert read_motion(*paths).piece.tolist() == [0] * 60 + [1] * 61


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "time,height\n0,1\n",
            "must have the column theta0, or angles, positions x and y, or rates",
        ),
        ("s,theta0\n0,1\n", "must have the column time, got 's, theta0': its first line"),
        ("", "must have the column time"),
        ("sep=,\ntime,height\n" + GOOD, "must have the column theta0, or angles, positions"),
        ("# my rig\ntime,height\n" + GOOD, "must have the column theta0, or angles, positions"),
        ("time,theta0,theta2\n0,1,1\n", "must number columns from 0 on without a gap"),
        ("time,theta0,tau0,tau1\n0,1,1,1\n", "must have an angle for each torque"),
        ("time,theta0,theta0\n0,1,1\n", "must name each column once"),
        ("time,theta0\n0,1\n", "times must hold 20 to 2000000 instants, got shape (1,)"),
        (
            "time,theta0\n" + GOOD + "0.5,1\n",
            "times must increase within a piece, got 0.5 s in row",
        ),
        ("time,theta0\n" + GOOD + "1.3,nan\n", "line 62: theta0 must be a number, got 'nan'"),
        ("time,theta0\n" + GOOD + "1.3,\n", "line 62: theta0 must be a number, got ''"),
        ("time,theta0\n0,1.2 rad\n", "line 2: theta0 must be a number, got '1.2 rad'"),
        ("time,theta0\n0,1,2\n", "line 2: 2 cells are needed, got 3"),
        ("time,theta0,piece\n" + GOOD.replace("\n", ",0.5\n"), "piece must be 60 integers"),
        (
            "time;theta0\n0,02;0.69 rad\n",
            "positions x and y, or rates of a gyroscope, got 'time, theta0 (text)'",
        ),
        ("time,theta0\n0,1_0.0\n", "line 2: theta0 must be a number, got '1_0.0'"),
        ("time,theta0\n" + GOOD.replace(",", ";"), "line 2: 2 cells are needed, got 1"),
    ],
)
def test_a_bad_file_is_refused_in_one_line_and_nothing_is_written(
    text, message, motion_file, refusal, tmp_path
):
    out = tmp_path / "results"
    error = refusal("identify", motion_file(text), "--lengths", "1", "--out", str(out))
    assert message in error
    assert "motion.csv" in error
    assert not out.exists()


@pytest.mark.parametrize(
    ("changes", "number"),
    [
        ({9: '"good"', 20: '"bad', 30: 'again"'}, 20),
        ({20: '"bad'}, 20),
        ({20: '"bad"ly'}, 20),
        ({1: '"note'}, 1),
    ],
)
def test_rows_at_a_stray_quotation_mark_are_refused_and_not_left_out(changes, number, motion_file):
    lines = ["time,theta0,note", *(f"{line},swings" for line in GOOD.splitlines())]
    for k, note in changes.items():
        lines[k - 1] = lines[k - 1].rpartition(",")[0] + f",{note}"
    rule = "quotation marks must begin and end a cell within its line"
    with pytest.raises(ValueError, match=rf"motion\.csv, line {number}: {rule}"):
        read_motion(motion_file("\n".join(lines)))


def test_cells_may_stand_in_quotation_marks(motion_file):
    quoted = "".join('"{}","{}"\r\n'.format(*line.split(",")) for line in GOOD.splitlines())
    assert read_motion(motion_file('"time","theta0"\r\n' + quoted)).times.size == 60


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("", "--lengths or --chain must be given: angles do not determine lengths"),
        ("--lengths 1,2", "chain must have a link for each of 1 angles, got 2"),
        ("--lengths 1 --chain acrobot", "--lengths must be left out with --chain"),
        ("--lengths 0", "lengths must be greater than zero"),
        ("--lengths 1 --fit mass", "fit must be one of inertia, lift"),
        ("--lengths 1 --fit inertia,gravity", 'fit must not name "gravity" beside "inertia"'),
        ("--lengths 1 --segment -1", "segment must be greater than zero"),
        (
            "--lengths 1 --segment 0.1",
            "segment must be at least 0.4 s, the time of 20 rows, got 0.1",
        ),
        ("--lengths 1 --held-out 2", "held_out must be a share between 0 and 0.5"),
        ("--chain nosuch", "must be one of"),
        (
            "none.csv --lengths 1",
            "files must be CSV files: none.csv cannot be read: No such file or directory",
        ),
    ],
)
def test_bad_arguments_are_refused_and_nothing_is_written(
    arguments, message, motion_file, refusal, tmp_path
):
    path, out = motion_file("time,theta0\n" + GOOD), tmp_path / "results"
    assert message in refusal("identify", path, *arguments.split(), "--out", str(out))
    assert not out.exists()


def test_degrees_in_place_of_radians_bring_one_line_of_warning(motion_file, capsys):
    path = motion_file("time,theta0\n" + "".join(f"{0.02 * k},{40 * np.sin(0.1 * k)}\n"
                                                 for k in range(60)))  # fmt: skip
    with pytest.raises(SystemExit):
        main(["identify", path, "--lengths", "0"])
    first = capsys.readouterr().err.splitlines()[0]
    assert first.startswith("npend identify: theta reaches 40 rad, 6.4 turns: are these degrees?")


@pytest.mark.parametrize(
    ("rate", "duration", "amplitude", "damping", "noise", "counts"),
    [
        (100.0, 20.0, 0.7, 0.05, 1e-3, None),
        (1000.0, 20.0, 0.3, 0.05, 0.0, 4096),  # more than half of the rows are equal to the last
        (1000.0, 20.0, 0.7, 0.05, 0.0, 1000),
        (1000.0, 10.0, 0.1, 0.05, 2e-3, None),  # noise is 40 times the step between two rows
        (100.0, 300.0, 0.7, 0.8, 1e-3, None),  # it moves for a thirtieth of the time
        (1000.0, 30.0, 0.7, 0.8, 1e-3, None),
    ],
)
def test_the_period_of_a_swing_does_not_depend_on_resolution_noise_or_its_end(
    rate, duration, amplitude, damping, noise, counts
):
    times = np.arange(0.0, duration, 1.0 / rate)
    theta = simulate(Chain([1.0], [0.8], damping=damping), amplitude, 0.0, times).theta
    theta += noise * np.random.default_rng(0).normal(size=theta.shape)
    unit = 2.0 * np.pi / counts if counts else 1e-12
    found = check_motion(times, np.round(theta / unit) * unit).period()
    within = 0.12 if damping < 0.1 else 0.25  # few swings are moving
    assert found == pytest.approx(theory.pendulum_period(amplitude, 0.8), rel=within)


@pytest.mark.parametrize(("rate", "digits", "missing"), [(60, 2, 0), (60, 2, 9), (30, 2, 9),
                                                         (240, 3, 9), (240, 2, 0)])  # fmt: skip
def test_times_that_are_rounded_become_evenly_spaced_again(rate, digits, missing):
    times = np.delete(np.arange(0.0, 12.0, 1.0 / rate) + 0.37, range(200, 200 + missing))
    theta = simulate(Chain([0.5], [0.29], damping=0.001), 0.6, 0.0, times).theta
    with pytest.warns(UserWarning, match="times are rounded: rows are taken as evenly spaced"):
        motion = check_motion(np.round(times, digits), theta)
    assert np.diff(motion.times) == pytest.approx(np.diff(times), rel=2e-3)
    assert motion.period() == pytest.approx(check_motion(times, theta).period(), rel=0.02)


def test_times_that_stand_twice_are_not_taken_as_rounded():
    times = np.repeat(np.arange(0.0, 6.0, 0.02), 2)
    with pytest.raises(ValueError, match="leave out rows that stand twice"):
        check_motion(times, np.sin(3.0 * times))


def test_jitter_that_is_real_is_kept_and_misleads_no_period():
    times = np.arange(0.0, 30.0, 1.0 / 60.0)
    times += np.random.default_rng(0).uniform(-0.007, 0.007, times.size)
    theta = simulate(Chain([0.5], [0.29], damping=0.001), 0.6, 0.0, times - times[0]).theta
    motion = check_motion(np.round(times, 4), theta)
    assert motion.times == pytest.approx(times, abs=6e-5)
    assert motion.period() == pytest.approx(theory.pendulum_period(0.6, 0.29), rel=0.06)


def test_the_period_of_a_link_that_turns_over_does_not_grow_with_the_recording():
    for duration in (30.0, 40.0):
        times = np.arange(0.0, duration, 0.05)
        assert check_motion(times, 0.6 * times).period() == pytest.approx(2.0 * np.pi**2 / 0.6)


def test_a_recording_that_becomes_slower_is_cut_into_parts_of_twenty_rows_or_more():
    times = np.r_[np.arange(0.0, 8.0, 0.01), np.arange(8.08, 40.0, 0.08)]
    motion = check_motion(times, np.sin(3.0 * times))
    parts = motion.cut(motion.stretches(), 1.0)
    assert [0, *(rows.stop for rows in parts)] == [*(rows.start for rows in parts), times.size]
    assert min(rows.stop - rows.start for rows in parts) >= 20
    even = check_motion(times[:800], np.sin(3.0 * times[:800]))
    assert [rows.stop for rows in even.cut(even.stretches(), 1.0)] == [*range(100, 801, 100)]


def test_a_slow_recording_beside_a_fast_one_is_used_and_a_short_one_is_reported():
    fast, slow = np.arange(0.0, 2.0, 0.002), np.arange(0.0, 9.0, 0.05)
    times, piece = np.r_[fast, slow], np.repeat([0, 3], [fast.size, slow.size])
    motion = check_motion(times, np.sin(3.0 * times), piece=piece)
    assert motion.stretches() == [slice(0, 1000), slice(1000, 1180)]
    assert sum(rows.stop - rows.start for rows in motion.cut(motion.stretches(), 0.3)) == 1180
    with pytest.warns(UserWarning, match="piece 3 is left out: it must have 20 rows without a gap"):
        short = check_motion(times[:1010], np.sin(3.0 * times[:1010]), piece=piece[:1010])
    assert short.stretches() == [slice(0, 1000)]


def test_held_out_segments_are_evenly_spaced_and_their_share_is_that_wanted():
    assert hold_out(10, 0.4) == [1, 3, 6, 8]
    assert hold_out(10, 0.25) == [1, 5, 9]
    assert hold_out(12, 1.0 / 6.0) == [2, 8]
    assert hold_out(2, 0.1) == [1]
    assert hold_out(1, 0.25) == hold_out(9, 0.0) == []
    assert all(len(hold_out(200, share)) == 2 * round(100 * share) for share in (0.1, 0.3, 0.45))


def test_the_licences_of_the_measured_data_stand_beside_them():
    about = (DATA / "README.md").read_text(encoding="utf-8")
    for path in DATA.glob("*.csv"):
        assert f"`{path.name}`" in about
    assert "MIT License" in (DATA / "LICENSE-multiarm").read_text()
    assert "BSD 3-Clause License" in (DATA / "LICENSE-realaigym").read_text()
    assert sum(path.stat().st_size for path in DATA.iterdir()) < 230_000


@pytest.mark.parametrize(
    ("unit", "arguments"), [(1000.0, "--lengths 1"), (1.0, "--lengths 0.1 --centres 90000")]
)
def test_times_and_lengths_in_other_units_are_refused(unit, arguments, motion_file, refusal):
    swings = "".join(f"{0.02 * k * unit:.6f},{np.sin(0.06 * k):.6f}\n" for k in range(200))
    error = refusal("identify", motion_file("time,theta0\n" + swings), *arguments.split())
    assert "times must be in seconds, and lengths and centres in metres" in error
    assert "are these milliseconds, centimetres or millimetres?" in error


def test_frame_numbers_and_repeated_times_are_said_to_be_so(motion_file, refusal):
    theta = [f"{np.sin(0.02 * k):.6f}" for k in range(400)]
    frames = "".join(f"{k},{angle}\n" for k, angle in enumerate(theta))
    error = refusal("identify", motion_file("time,theta0\n" + frames), "--lengths", "0.3")
    assert "are these frame numbers? Divide them by the frames a second" in error
    twice = "".join(f"{0.017 * (k - (k == 9))},{angle}\n" for k, angle in enumerate(theta))
    error = refusal("identify", motion_file("time,theta0\n" + twice), "--lengths", "0.3")
    assert "0.136 s in row 9 after 0.136 s: leave out rows that stand twice" in error


def test_lengths_in_millimetres_or_centimetres_bring_a_warning_before_the_fit():
    times = np.arange(200) * 0.02
    for length, period in ((300.0, 35), (60.0, 16)):  # g / 3^2 is 1.09 m
        about = f"with one of about {period} s; are these milliseconds, centimetres or milli"
        with pytest.warns(UserWarning, match=about):
            FitProblem(check_motion(times, np.sin(3.0 * times)), Chain(1.0, length))
    FitProblem(check_motion(times, np.sin(3.0 * times)), Chain(1.0, 1.0))  # warns of nothing
    slowly = check_motion(times * 50.0, np.sin(3.0 * times), np.sin(times))
    FitProblem(slowly, Chain(1.0, 1.0))  # nor where motors move the link so slowly


def test_what_was_taken_in_place_of_masses_and_centres_is_said():
    bobs = Chain([0.45, 0.32], [0.30, 0.25])
    links = Chain([0.563, 0.32], bobs.lengths, centres=[0.16, 0.12], inertias=[0.0042, 0.0021])
    model = new_model(bobs, None, driven=False)
    fitted = model.pack(values_of(links))
    sentences = undetermined(model, links, fitted, np.zeros(fitted.size), driven=False)
    assert (
        "lift0 = 0.231 kg m of the given chain was kept, whose centres of mass are at the "
        in (sentences[0])
    )
    changed = [one for one in sentences if one.startswith("masses[")]
    assert len(changed) == 1
    assert changed[0].startswith("masses[0]: 0.563 kg was taken for the given 0.45 kg")
    model = new_model(links, None, driven=False)
    sentences = undetermined(model, links, model.pack(values_of(links)), fitted * 0.0, driven=False)
    assert "centres" not in sentences[0]
    assert not any(one.startswith("masses[") for one in sentences)


def test_masses_centres_and_inertias_are_those_given_unless_they_are_fitted():
    bobs = Chain([0.45, 0.32], [0.30, 0.25], armature=0.01, gear=[6.0, -6.0])
    damped = Chain.from_dict(bobs.as_dict() | {"damping": 0.1})
    for fit, same in ((["damping"], True), (["inertia", "damping"], False)):
        model = new_model(bobs, fit, driven=False)
        found, fitted = model.chain_of(values_of(damped)), model.pack(values_of(damped))
        assert (found == damped) == same  # bobs have no margin, by which masses are larger
        assert found.masses == pytest.approx(bobs.masses, rel=2e-3)
        sentences = undetermined(model, found, fitted, 0.0 * fitted, driven=False)
        assert not any(one.startswith("masses[") for one in sentences)


@pytest.fixture
def swings(motion_file):
    """A function that writes a file of swings, whose columns were converted, and returns it."""

    def write(chain, start, convert):
        times = np.arange(0.0, 12.0, 0.04)
        motion = simulate(chain, start, 0.0, times)
        theta = convert(motion) + 1e-3 * np.random.default_rng(0).normal(size=motion.theta.shape)
        names = [f"theta{link}" for link in range(chain.n)]
        rows = [",".join(map(str, row)) for row in np.column_stack([times, theta]).tolist()]
        return motion_file("\n".join([",".join(["time", *names]), *rows]))

    return write


ONE, TWO = Chain([0.5], [0.689], damping=0.008), Chain([0.5, 0.3], [0.4, 0.3], damping=0.003)
LENGTHS = {1: ["--lengths", "0.689"], 2: ["--lengths", "0.4,0.3", "--masses", "0.5,0.3"]}
DAMPING = [*LENGTHS[2], "--fit", "damping"]


@pytest.mark.long
@pytest.mark.parametrize(
    ("chain", "start", "convert", "given", "message"),
    [
        (ONE, 0.2, lambda m: np.degrees(m.theta), LENGTHS[1], "degrees: np.radians converts"),
        (ONE, 1.2, lambda m: np.degrees(m.theta), LENGTHS[1], "degrees: np.radians converts"),
        pytest.param(
            TWO,
            0.3,
            lambda m: np.degrees(m.theta),
            LENGTHS[2],
            "or give --degrees of npend",
            marks=pytest.mark.nightly,
        ),
        (ONE, 0.45, lambda m: m.omega, LENGTHS[1], "angular velocities, as a gyroscope"),
        pytest.param(
            TWO,
            0.8,
            lambda m: np.diff(m.theta, axis=1, prepend=0.0),
            DAMPING,
            "give --relative",
            marks=pytest.mark.nightly,
        ),
        (ONE, 0.9, lambda m: m.theta - np.pi, LENGTHS[1], "upright: add np.pi to them"),
        (ONE, 0.5, lambda m: m.theta, ["--lengths", "68.9"], "place of 1 kg: centimetres"),
        (TWO, 0.5, lambda m: m.theta, ["--lengths", "40,30"], "otherwise than the data"),
    ],
)
def test_what_no_pendulum_can_be_ends_with_an_error_and_the_way_out(
    chain, start, convert, given, message, swings, capsys, tmp_path
):
    arguments = [swings(chain, start, convert), *given, "--out", str(tmp_path / "out")]
    try:
        code = main(["identify", *arguments])
    except SystemExit as error:
        code = error.code
    shown = capsys.readouterr()
    assert code in (1, 2)
    assert message in shown.err.splitlines()[-1]
    assert shown.out == ""
    assert not (tmp_path / "out").exists()


@pytest.mark.long
@pytest.mark.parametrize("slower", [4.0, 8.0])
@pytest.mark.parametrize("chain", [ONE, Chain.rods([0.5], [0.5])])
def test_a_film_in_slow_motion_brings_a_warning_with_its_factor(chain, slower):
    times = np.arange(0.0, 10.0, 0.02)
    theta = simulate(chain, 0.6, 0.0, times).theta
    with pytest.warns(UserWarning, match=f"are times {slower:.0f} times too slow, as of a film"):
        identify(slower * times, theta, chain=chain, fit=["inertia", "damping"])


@pytest.mark.long
def test_two_links_in_slow_motion_fit_better_with_times_in_seconds():
    times = np.arange(0.0, 8.0, 0.02)
    theta = simulate(TWO, [0.3, 0.6], 0.0, times).theta
    with pytest.raises(ValueError, match="times better if they were 4 times as short: a film in"):
        identify(4.0 * times, theta, chain=TWO, fit=["inertia", "lift"])


@pytest.mark.long
def test_the_text_has_periods_and_lengths_and_says_what_was_left_out(swings, capsys):
    assert main(["identify", swings(ONE, 0.5, lambda m: m.theta), *LENGTHS[1]]) == 0
    text, period = capsys.readouterr().out, 2.0 * np.pi * np.sqrt(0.689 / 9.81)
    mode = re.search(r"\n +0 +([\d.]+) +([\d.e-]+) +([\d.]+) +([\d.]+)\n", text)
    small, error, square, length = map(float, mode.groups())
    assert small == pytest.approx(period, abs=5.0 * error + 5e-6)
    assert error < 1e-3
    assert (square, length) == pytest.approx((9.81 / 0.689, 0.689), rel=1e-3)
    measured = float(re.search(r"theta0 ([\d.]+) s", text)[1])
    largest = theory.pendulum_period(0.5, 0.689)
    assert period * 1.001 < measured < largest  # swings become smaller
    assert "left out, because the data do not support it" in text
    assert "  - friction: zero; parts of the data are predicted" in text
    assert "  - quadratic_drag: zero; parts" in text


@pytest.mark.long
def test_the_command_fits_gravity_and_says_what_its_error_leaves_out(motion_file, capsys):
    true = Chain([0.5, 0.3], [0.6, 0.4], damping=1e-3, gravity=9.79)
    times = np.arange(0.0, 12.0, 0.02)
    theta = simulate(true, [0.8, 0.3], 0.0, times).theta
    theta += 1e-3 * np.random.default_rng(0).normal(size=theta.shape)
    rows = "".join(f"{t:.2f},{a:.6f},{b:.6f}\n" for t, (a, b) in zip(times, theta, strict=True))
    path = motion_file("time,theta0,theta1\n" + rows)
    given = "--lengths 0.6,0.4 --masses 0.5,0.3 --fit inertia,lift,damping,gravity"
    assert main(["identify", path, *given.split()]) == 0
    text = capsys.readouterr().out
    value, error, unit = re.search(r"^gravity +(\S+) +(\S+) +(\S+)$", text, re.MULTILINE).groups()
    assert abs(float(value) - 9.79) < 4.0 * float(error) < 0.02
    assert unit == "m/s^2"
    assert "gravity: its standard error contains no errors of lengths" in text


@pytest.mark.long
def test_angles_of_joints_are_absolute_ones_where_they_are_so(tmp_path, capsys):
    times, theta, piece = recorded(TRUE, 4)
    rows = [f"{p},{t},{a},{b}" for p, t, (a, b) in zip(piece, times, theta, strict=True)]
    (tmp_path / "m.csv").write_text("\n".join(["piece,time,theta0,theta1", *rows]))
    known = ["--lengths", "0.2,0.25", "--masses", "0.1,0.15"]
    assert main(["identify", str(tmp_path / "m.csv"), *known]) == 0
    assert capsys.readouterr().err == ""


def test_periods_are_measured_from_swing_to_swing_and_not_of_links_that_turn_over():
    times = np.arange(0.0, 10.0, 0.01)
    noise = 0.05 * np.random.default_rng(0).normal(size=(times.size, 2))
    theta = np.column_stack([0.4 * np.sin(3.0 * times + 1.0) + 2.0 * np.pi, 2.0 * times]) + noise
    slow = check_motion(np.r_[times, times], np.r_[theta, theta], piece=np.repeat([0, 1], 1000))
    found = slow.mean_periods()
    assert found[0] == pytest.approx(2.0 * np.pi / 3.0, rel=5e-3)
    assert np.isnan(found[1])
    assert np.isnan(check_motion(times[:150], 0.1 * times[:150]).mean_periods()).all()
