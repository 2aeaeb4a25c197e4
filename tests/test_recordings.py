"""Files of other programs, in the layout of each, read back as the simulated motion in them."""

import io
import re
import sys
import tarfile
import zipfile
from types import SimpleNamespace

import numpy as np
import pytest

from npend_gym import Chain, simulate
from npend_gym.cli import main
from npend_gym.identification import read_motion
from npend_gym.identification.recordings import read_recording

ONE, TWO = Chain([0.5], [0.3], damping=0.0005), Chain([0.5, 0.3], [0.3, 0.2])
TIMES = np.arange(240) / 60.0
SWING = simulate(ONE, 0.5, 0.0, TIMES)
BOTH = simulate(TWO, [0.7, 1.1], 0.0, TIMES)
UPRIGHT = simulate(Chain([0.05, 0.007], [0.091, 0.07]), [3.13, 3.12], 0.0, np.arange(400) / 400.0)


def places(theta, lengths):
    """Positions of bobs (T, n, 2) with y up, from the pivot on."""
    x, y = np.sin(theta) * lengths, -np.cos(theta) * lengths
    return np.stack([np.cumsum(x, axis=1), np.cumsum(y, axis=1)], axis=2)


def table(rows, separator="\t", end="", comma=False, digits=8):
    """Lines of numbers; None stands for an empty cell."""
    text = "".join(
        separator.join("" if c is None else f"{c:.{digits}g}" for c in row) + end + "\n"
        for row in rows
    )
    return text.replace(".", ",") if comma else text


def tracker(comma=False, separator="\t"):
    bob = places(SWING.theta, ONE.lengths)[:, 0]
    rows = [[t, *xy] for t, xy in zip(TIMES, bob.tolist(), strict=True)]
    rows[7][1:] = rows[30][1:] = [None, None]
    head = f"{separator}mass A\nt{separator}x{separator}y{separator}\n"
    return head + table(rows, separator, comma=comma)


def tracker_theta():
    degrees = np.degrees(np.angle(np.exp(1j * (SWING.theta[:, 0] - 0.5 * np.pi))))
    return "\tbob\nt\tθ_{r}\t\n" + table(zip(TIMES, degrees, strict=True))


def tracker_multi():
    bobs = places(BOTH.theta, TWO.lengths).reshape(-1, 4)
    head = "#multi:\n\tmass A\t\tmass B\t\t\nt\tx\ty\tx\ty\t\n"
    return head + table(np.column_stack([TIMES, bobs]))


def phyphox_rows():
    axis = np.array([0.1, -0.2, 0.97]) / np.linalg.norm([0.1, -0.2, 0.97])
    rates = SWING.omega * axis + [0.003, -0.002, 0.004]  # the bias of a sensor
    head = '"Time (s)","Gyroscope x (rad/s)","Gyroscope y (rad/s)","Gyroscope z (rad/s)","Absolute'
    rows = np.column_stack([TIMES + 0.0447, rates, np.linalg.norm(rates, axis=1)])
    lines = [",".join(f"{cell:.9E}" for cell in row) for row in rows.tolist()]
    lines[5] = re.sub(r",[^,]*", ",NaN", lines[5])
    return head + ' (rad/s)"\n' + "\n".join(lines) + "\n"


def archive(name, text):
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w") as file:
        file.writestr("meta/device.csv", "property,value\n")
        file.writestr(name, text)
    return held.getvalue()


def capstone(comma=False):
    second = simulate(ONE, 0.3, 0.0, TIMES[:200]).theta[:, 0]
    rows = [[t, a, t if k < 200 else None, second[k] if k < 200 else None]
            for k, (t, a) in enumerate(zip(TIMES, SWING.theta[:, 0], strict=True))]  # fmt: skip
    rows.insert(50, [0.8251, None, None, None])  # an instant of a photogate
    separator = ";" if comma else ","
    names = [f"{name} Run #{run}" for run in (1, 2) for name in ("Time (s)", "Angle (rad)")]
    return "\ufeff" + separator.join(names) + "\n" + table(rows, separator, comma=comma)


def logger_pro():
    columns = ""
    for name, unit, values in (("Time", "s", TIMES), ("Angle", "rad", SWING.theta[:, 0])):
        cells = [f"{value:.8g}" for value in values]
        cells[9] = "Z1 1:" if name == "Angle" else cells[9]
        columns += (f"<DataColumn><DataObjectName>{name}</DataObjectName><ColumnUnits>{unit}"
                    "</ColumnUnits><ColumnCells>\n" + "\n".join(cells) + "\n</ColumnCells>"
                    "</DataColumn>")  # fmt: skip
    return f'<?xml version="1.0"?>\n<Document><DataSet>{columns}</DataSet></Document>\n'


def gambl():
    held, data = io.BytesIO(), logger_pro().encode()
    with tarfile.open(fileobj=held, mode="w") as file:
        entry = tarfile.TarInfo("main.xml")
        entry.size = len(data)
        file.addfile(entry, io.BytesIO(data))
    return held.getvalue()


def graphical_analysis():
    head = "Data Set 1:Time(s),Data Set 1:Angle(deg)\n"
    return head + table(np.column_stack([TIMES, np.degrees(SWING.theta)]), ",")


def realaigym(late=False):
    relative = np.diff(BOTH.theta, axis=1, prepend=0.0)
    if not late:
        zeros = np.zeros((TIMES.size, 2))
        return "time,pos1,pos2,vel1,vel2,tau1,tau2\n" + table(
            np.column_stack([TIMES, relative, zeros, zeros]), ","
        )
    kinds = "pos_meas", "vel_meas", "pos_filt", "vel_filt", "tau_con", "tau_fric", "tau_meas"
    names = [f"{kind}{k}" for kind in kinds for k in (1, 2)]
    rows = np.column_stack([TIMES, relative, np.zeros((TIMES.size, 12))])
    return ",".join(["time", *names]) + "\n" + table(rows, ",")


def schmidt():
    trial = np.zeros_like(TIMES)
    rates = np.column_stack([BOTH.omega, BOTH.omega, BOTH.omega])
    rows = np.column_stack([trial, TIMES, BOTH.theta, rates])
    return "% o1 o2 w1 w2\n" + table(rows, " ")


def pixels():
    bobs = np.concatenate([np.zeros((400, 1, 2)), places(UPRIGHT.theta, [0.091, 0.07])], axis=1)
    shown = np.rint(5.0 * (bobs * [1600.0, -1600.0] + [960.0, 540.0]))
    return table(shown.reshape(400, 6), " ", digits=6)


CASES = {
    "tracker": (tracker(), SWING, "Tracker", 1e-6),
    "tracker with decimal commas": (tracker(comma=True), SWING, "Tracker", 1e-6),
    "tracker with semicolons": (tracker(True, ";"), SWING, "Tracker", 1e-6),
    "tracker with commas": (tracker(False, ","), SWING, "Tracker", 1e-6),
    "tracker, angles": (tracker_theta(), SWING, "degrees, from the x axis", 1e-6),
    "tracker, two masses": (tracker_multi(), BOTH, "Tracker", 1e-6),
    "phyphox": (phyphox_rows(), SWING, "phyphox", 0.02),
    "phyphox, zip": (archive("Raw Data.csv", phyphox_rows()), SWING, "phyphox", 0.02),
    "logger pro": (logger_pro(), SWING, "Logger Pro", 1e-6),
    "gambl": (gambl(), SWING, "Logger Pro", 1e-6),
    "graphical analysis": (graphical_analysis(), SWING, "in degrees", 1e-6),
    "realaigym": (realaigym(), BOTH, "relative to the link above", 1e-6),
    "realaigym, late": (realaigym(late=True), BOTH, "relative to the link above", 1e-6),
    "schmidt": (schmidt(), BOTH, "a table of blanks", 1e-6),
}


@pytest.mark.parametrize("case", CASES)
def test_the_motion_in_a_file_of_another_program_is_read_without_a_flag(case, written):
    content, truth, said, within = CASES[case]
    read = read_recording(written(content))
    rows = np.searchsorted(TIMES, read.motion.times - read.motion.times[0] + TIMES[0] - 1e-4)
    assert read.motion.times.size >= TIMES.size - 2
    assert np.abs(read.motion.theta - truth.theta[rows]).max() < within
    assert said in read.said[0]
    missing = TIMES.size - read.motion.times.size
    assert (f"{missing} of 240 rows have empty cells" in read.said[0]) == (missing > 0)


def test_positions_show_lengths_and_angles_wherever_the_origin_is(written):
    bob = places(SWING.theta, ONE.lengths)[:, 0] * 1000.0
    for shift, down in (((0.0, 0.0), 1.0), ((500.0, 200.0), 1.0), ((500.0, 200.0), -1.0)):
        moved = bob * [1.0, down] + shift
        text = "time,x,y\n" + table(np.column_stack([TIMES, moved]), ",", digits=10)
        read = read_recording(written(text))
        assert read.lengths == pytest.approx([300.0], rel=1e-4)
        assert read.motion.theta == pytest.approx(SWING.theta, abs=1e-4)


def test_pixels_of_markers_with_y_down_and_no_times_are_read_with_frames_a_second(written):
    read = read_recording(written(pixels(), "0.txt"), fps=400.0)
    assert read.motion.times == pytest.approx(np.arange(400) / 400.0)
    turned = read.motion.theta - UPRIGHT.theta
    assert np.abs(turned - 2.0 * np.pi * np.rint(turned[0] / 2.0 / np.pi)).max() < 2e-3
    assert read.lengths[1] / read.lengths[0] == pytest.approx(70.0 / 91.0, rel=2e-3)
    assert "y down and the pivot at the first marker" in read.said[0]
    with pytest.raises(ValueError, match="frames a second by fps"):
        read_motion(written(pixels(), "0.txt"))


@pytest.mark.parametrize("comma", [False, True])
def test_runs_side_by_side_become_pieces_and_rows_of_photogates_are_left_out(comma, written):
    read = read_recording(written(capstone(comma)))
    assert np.bincount(read.motion.piece).tolist() == [240, 200]
    first = read.motion.piece == 0
    assert read.motion.theta[first] == pytest.approx(SWING.theta, abs=1e-6)
    assert "1 of 241 rows have empty cells and are left out" in read.said[0]
    assert "recognised as Capstone" in read.said[0]


def test_columns_overrule_what_is_recognised_and_names_may_have_a_comma(written, capsys):
    text = '"t, all";"angle, left";y\n' + table(
        np.column_stack([TIMES, SWING.theta, 9.0 + TIMES]), ";", comma=True
    )
    path = written(text)
    named = {"time": "t, all", "theta0": "angle, left"}
    assert read_motion(path, columns=named).theta == pytest.approx(SWING.theta, abs=1e-6)
    option = 'time="t, all",theta0="angle, left"'
    with pytest.raises(SystemExit):
        main(["identify", str(path), "--columns", option])
    shown = capsys.readouterr().err
    assert "angles are 'angle, left', in radians, from where a link hangs" in shown
    assert "--lengths or --chain must be given" in shown


def test_columns_without_names_are_named_by_their_places(written):
    path = written(table(np.column_stack([TIMES, SWING.theta]), " "))
    read = read_motion(path, columns={"time": "1", "theta0": "2"})
    assert read.theta == pytest.approx(SWING.theta, abs=1e-6)


JOINT_STATE = """\
std_msgs/Header header

string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
STRING = "string data\n"


def bag(motion, names=("shoulder", "elbow"), topics=("/joint_states",), stamps=True, **columns):
    """A bag as `ros2 bag record` writes it: stamps of the clock, the log later by 2 to 30 ms."""
    ros = pytest.importorskip("mcap_ros2.writer", reason="mcap-ros2-support is not installed")
    rng, held = np.random.default_rng(0), io.BytesIO()
    writer = ros.Writer(held)
    state = writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE)
    text = writer.register_msgdef("std_msgs/msg/String", STRING)
    writer.write_message("/robot_description", text, {"data": "<robot/>"}, log_time=10**18)
    angles = np.diff(motion.theta, axis=1, prepend=0.0)
    rates = np.diff(motion.omega, axis=1, prepend=0.0)
    given = {
        "position": angles,
        "velocity": rates,
        "effort": np.full_like(angles, np.nan),
    } | columns
    for k, time in enumerate(motion.times):
        nanoseconds = 1_764_426_000 * 10**9 + round(time * 1e9)
        sec, nanosec = divmod(nanoseconds, 10**9) if stamps else (0, 0)
        header = {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": ""}
        turn = k % 2  # a controller may name joints in another order
        message = {name: list(np.roll(rows[k], turn)) for name, rows in given.items()}
        message |= {"header": header, "name": list(np.roll(names, turn))}
        late = 0 if not stamps else int(rng.integers(2_000_000, 30_000_000))
        for topic in topics:
            writer.write_message(topic, state, message, log_time=nanoseconds + late)
    writer.finish()
    return held.getvalue()


def test_a_ros_bag_is_read_by_the_stamps_of_its_headers(written):
    read = read_recording(written(bag(BOTH), "rosbag2_0.mcap"))
    assert read.motion.times == pytest.approx(TIMES, abs=1e-9)
    assert read.motion.theta == pytest.approx(BOTH.theta, abs=1e-12)
    assert read.motion.torque is None  # no joint reports an effort
    (said,) = read.said
    assert said == (
        "rosbag2_0.mcap: recognised as a ROS bag, topic /joint_states; times are 'header.stamp', "
        "in seconds; angles are 'shoulder', 'elbow', in radians, relative to the link above, "
        "counter-clockwise positive"
    )
    unstamped = read_recording(written(bag(BOTH, stamps=False)))
    assert unstamped.motion.times == pytest.approx(TIMES, abs=1e-9)
    assert "times are 'log time'" in unstamped.said[0]


def test_the_folder_of_a_ros_bag_is_read_as_one_recording(tmp_path, capsys):
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information:\n")
    parts = np.array_split(np.arange(TIMES.size), 11)  # whose files are not in the order of names
    for k, rows in enumerate(parts):
        part = SimpleNamespace(
            times=TIMES[rows], theta=BOTH.theta[rows], omega=np.zeros((rows.size, 2))
        )
        (tmp_path / f"swing_{k}.mcap").write_bytes(bag(part))
    read = read_motion(tmp_path)
    assert read.times == pytest.approx(TIMES, abs=1e-9)
    assert read.theta == pytest.approx(BOTH.theta, abs=1e-12)
    assert read.piece is None or np.ptp(read.piece) == 0.0
    (tmp_path / "empty").mkdir()
    for folder, said in ((tmp_path, "--lengths or --chain"), (tmp_path / "empty", "no folder of")):
        with pytest.raises(SystemExit):
            main(["identify", str(folder)])
        assert said in capsys.readouterr().err


def test_joints_of_a_ros_bag_are_columns_by_their_names(written, capsys):
    torque = np.column_stack([np.full(240, np.nan), np.sin(TIMES)])
    path = written(bag(BOTH, names=("b_elbow", "a_motor"), effort=torque))
    read = read_motion(path)
    assert read.torque == pytest.approx(np.nan_to_num(torque))
    chosen = {"theta0": "b_elbow", "theta1": "a_motor", "tau1": "a_motor.effort"}
    assert read_motion(path, columns=chosen, relative=True).torque == pytest.approx(read.torque)
    one = read_motion(path, columns={"omega0": "b_elbow.velocity"})
    swing = BOTH.theta[:, 0] - BOTH.theta[:, 0].mean()
    assert np.corrcoef(one.theta[:, 0], swing)[0, 1] > 0.99
    cart = read_motion(path, columns={"theta0": "b_elbow", "position": "a_motor"})
    assert cart.position == pytest.approx(np.diff(BOTH.theta, axis=1)[:, 0])
    with pytest.raises(SystemExit):
        main(["identify", str(path), "--columns", "theta0=wrist"])
    shown = capsys.readouterr().err
    assert (
        "has no column 'wrist': it has 'header.stamp, b_elbow, b_elbow.velocity, a_motor" in shown
    )


def test_a_ros_bag_that_tells_no_motion_says_what_is_in_it(written):
    several = bag(BOTH, topics=("/arm/joint_states", "/rail/joint_states"))
    with pytest.raises(ValueError, match=r"got /arm/joint_states, /rail/joint_states: record it"):
        read_motion(written(several))
    usual = bag(BOTH, topics=("/arm/joint_states", "/joint_states"))
    assert "topic /joint_states" in read_recording(written(usual)).said[0]
    with pytest.raises(ValueError, match="got /robot_description"):
        read_motion(written(bag(BOTH, topics=())))
    with pytest.raises(ValueError, match="is damaged, or was not closed"):
        read_motion(written(several[: len(several) // 2]))


def test_a_ros_bag_without_its_reader_names_the_command_that_installs_it(written, monkeypatch):
    monkeypatch.setitem(sys.modules, "mcap", None)
    monkeypatch.setitem(sys.modules, "mcap.reader", None)
    path = written(b"\x89MCAP0\r\n")
    with pytest.raises(ImportError, match=re.escape('pip install "npend-gym[ros]"')):
        read_motion(path)


def test_torques_of_a_table_belong_to_the_joints_of_their_numbers(written):
    rows = np.column_stack([TIMES, BOTH.theta, np.cos(TIMES)])
    path = written("t\ta\tb\tmotor\n" + table(rows))
    columns = {"time": "t", "theta0": "a", "theta1": "b", "tau1": "motor"}
    read = read_motion(path, columns=columns)
    assert read.torque == pytest.approx(np.column_stack([0.0 * TIMES, np.cos(TIMES)]), abs=1e-7)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"SQLite format 3\0", "is SQLite: ros2 bag convert makes MCAP of a ROS bag"),
        (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "is an old Excel file (.xls): save or export it as"),
        (archive("xl/workbook.xml", "<a/>"), "is an Excel file (.xlsx): save or export it as CSV"),
        (b"\x00\xff\x80\x01", "must be a CSV file in UTF-8"),
        (b"PAR1\x15\x04", "is a Parquet file: write it as CSV"),
        ('<?xml?>\n<object class="org.open.cabrillo.tracker.Panel">', "a project of Tracker"),
        ("<phyphox><title>Pendulum</title>", "is an experiment of phyphox without data"),
        ("hello\nworld\n", "must be a table: lines with equally many numbers"),
        (tracker().replace("\tx\t", "\tr\t"), "positions x and y, or rates of a gyroscope"),
        ("<Document><A>\n", "the XML of the file is damaged"),
        (b"PK\x03\x04zip", "is an archive that cannot be read"),
    ],
)
def test_what_cannot_be_read_says_why_in_a_sentence(content, message, written):
    with pytest.raises(ValueError, match=re.escape(message)):
        read_motion(written(content))
