"""Layouts of files that public repositories have, each written with a simulated motion in it."""

import io
import zipfile

import numpy as np
import pytest

from npend_gym import Chain, simulate
from npend_gym.identification import measure_swings, read_motion
from npend_gym.identification.recordings import read_recording

TIMES = np.arange(300) / 60.0
ONE = simulate(Chain([0.5], [0.3], damping=0.0005), 0.5, 0.0, TIMES)
SWING, SPEED = ONE.theta, ONE.omega[:, 0]
BOTH = simulate(Chain([0.5, 0.3], [0.3, 0.2]), [0.7, 1.1], 0.0, TIMES)
THREE = simulate(Chain.uniform(3, length=0.1), [0.3, -0.2, 0.4], 0.0, TIMES)
BOB = 207.0 * np.column_stack([np.sin(SWING), np.cos(SWING)]) + [420.0, 90.0]  # pixels, y down
FIRST, BEYOND = (
    length * np.column_stack([np.sin(angle), -np.cos(angle)])
    for length, angle in zip((444.0, 333.0), BOTH.theta.T, strict=True)
)
DAY = 1_647_055_180  # s since 1970
RATES = np.outer(SPEED, [0.1, 0.97, -0.2]) + np.array([0.01, -0.02, 0.004])
ZERO = np.zeros_like(TIMES)


def table(head, *columns, separator=",", form=".8g", end="\n"):
    """Text of a table; columns of text stay as they are."""
    rows = zip(*(c if isinstance(c, list) else [format(v, form) for v in np.ravel(c).tolist()]
                 for c in columns), strict=True)  # fmt: skip
    return (head + end) * bool(head) + "".join(separator.join(row) + end for row in rows)


def zipped(**files):
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w") as archive:
        for name, text in files.items():
            archive.writestr(f"{name}.csv", text)
    return held.getvalue()


def clock(form, day=DAY):
    return [np.datetime64(round(1e6 * (day + t)), "us").item().strftime(form) for t in TIMES]


def apart(text, at, added):
    """Text with lines added at a place."""
    lines = text.splitlines()
    return "\n".join(lines[:at] + added + lines[at:]) + "\n"


SENSORS = table("time,seconds_elapsed,z,y,x", [str(round(1e9 * (DAY + t))) for t in TIMES], TIMES,
                RATES[:, 2], RATES[:, 1], RATES[:, 0])  # fmt: skip
PLAIN = table("time,angle", TIMES, SWING)
CART = ("# This is an experiment\n#\n# Units:\n# time: s\n"
        + table("time,ms,angle_raw,angle,position,measurement,sent", TIMES, ZERO + 20.0, ZERO,
                SWING, ZERO, ["idle:sp:-0.5:Q:0.0"] * 300, ["False"] * 300))  # fmt: skip

# name of the case: file, its name, the angles, how far they may be off, and what is said
CASES = {
    "a phone's gyroscope": (SENSORS, "Gyroscope.csv", SWING, 0.03, "axis of the hinge"),
    "sensors of a phone in a zip": (
        zipped(Accelerometer=SENSORS, Gyroscope=SENSORS), "a.zip", SWING, 0.03, "integrated",
    ),
    "rates in degrees a second": (
        table("t_ms,wx (°/s),wy (°/s),wz (°/s)", 1e3 * TIMES, *np.degrees(RATES).T), "a.csv", SWING,
        0.03, "milliseconds",
    ),
    "an index, and angles that are all zero": (
        table("Unnamed: 0,time,x,y,theta", np.arange(300), TIMES, BOB[:, 0], BOB[:, 1], ZERO),
        "a.csv", SWING, 1e-3, "y down and the pivot at the centre",
    ),
    "time and angle without names": (
        table("", TIMES, SWING, separator=", "), "a.csv", SWING, 1e-6, "without names",
    ),
    "time, x and y without names": (
        table("", TIMES, BOB[:, 0], -BOB[:, 1], separator="\t", end="\r\n"), "a.txt", SWING, 1e-3,
        "positions",
    ),
    "names after a hash": (
        table("# t theta_rad", TIMES, SWING, separator=" "), "a.txt", SWING, 1e-6, "theta_rad",
    ),
    "names after a hash, commas": (
        table("# time,theta", TIMES, SWING), "a.txt", SWING, 1e-6, "'theta', in radians",
    ),
    "microseconds of a microcontroller": (
        table("packet,time_us, angle_deg", ZERO, 1e6 * TIMES + 492_306_565, np.degrees(SWING),
              form=".12g"), "a.csv", SWING, 1e-6, "microseconds",
    ),
    "a joint of ROS": (
        table("time,position,velocity,effort", TIMES, SWING, SPEED, ZERO), "a.csv", SWING, 1e-6,
        "'position', in radians",
    ),
    "comments, text and a cart that rests": (CART, "a.csv", SWING, 1e-6, "'angle', in radians"),
    "measured and simulated": (
        table("temps_s,theta1_mesure_deg,theta1_simule_deg,theta2_mesure_deg,erreur_deg", TIMES,
              np.degrees(BOTH.theta[:, 0]), ZERO, np.degrees(BOTH.theta[:, 1]), ZERO), "a.csv",
        BOTH.theta, 1e-6, "'theta1_mesure_deg', 'theta2_mesure_deg', in degrees",
    ),
    "markers in another order": (
        "\ufeff" + table("t;x_m2;y_m2;r_m2;x_m1;y_m1;r_m1", TIMES, *(FIRST + BEYOND).T, ZERO,
                         *FIRST.T, ZERO, separator=";"), "a.csv", BOTH.theta, 1e-4, "444, 333 long",
    ),
    "dates": (
        table("timestamp,angle", clock("%Y-%m-%dT%H:%M:%S.%fZ"), SWING), "a.csv", SWING,
        1e-6, "angle",
    ),
    "clock times": (
        table("time\tangle", clock("%H:%M:%S.%f"), SWING, separator="\t"), "a.txt", SWING,
        1e-6, "time",
    ),
    "milliseconds since 1970": (
        table("timestamp,angle", 1e3 * (TIMES + DAY), SWING, form=".17g"), "a.csv", SWING, 1e-6,
        "milliseconds",
    ),
    "names twice, and a last line that is cut": (
        apart(PLAIN, 100, ["time,angle"]) + "5.0", "a.csv", SWING, 1e-6, "1 lines are no rows",
    ),
    "units in a line of their own": (
        table("Zeit;Winkel\nms;deg", 1e3 * TIMES, np.degrees(SWING), separator=";"), "a.csv", SWING,
        1e-6, "'Winkel (deg)', in degrees",
    ),
    "a sample that was reported twice": (
        apart(PLAIN, 201, [PLAIN.splitlines()[199]]), "a.csv", SWING, 1e-6, "1 rows are no later",
    ),
    "an angle in two units": (
        table("Time (s),Angle (deg),Angle (rad)", TIMES, np.degrees(SWING), SWING), "a.csv", SWING,
        1e-6, "'Angle (rad)', in radians",
    ),
    "turns": (table("t,angle (rev)", TIMES, SWING / (2 * np.pi)), "a.csv", SWING, 1e-6, "angle"),
    "a file of Windows": (
        table("Zeit (s);Winkel (°)", TIMES, np.degrees(SWING), separator=";").encode("cp1252"),
        "a.csv", SWING, 1e-6, "in degrees",
    ),
    "decimal commas within quotation marks": (
        table("t,angle", *([f'"{v:.6f}"'.replace(".", ",") for v in column] for column in
                           (TIMES, SWING[:, 0]))), "a.csv", SWING, 1e-6, "'angle', in radians",
    ),
    "a preamble": (
        "Sample;7\nOperator;me\n\n" + table("t;theta", TIMES, SWING, separator=";"), "a.csv", SWING,
        1e-6, "'theta', in radians",
    ),
    "rates of three links": (
        table("time,omega1,omega2,omega3", TIMES, *THREE.omega.T), "a.csv", None, 0.0, "integrated",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_a_layout_of_a_public_file_is_read_as_the_motion_in_it(case, written):
    content, name, truth, within, said = CASES[case]
    read = read_recording(written(content, name))
    assert said in read.said[0]
    times = read.motion.times - read.motion.times[0]
    assert times == pytest.approx(TIMES, abs=2e-5)
    if truth is None:
        assert read.motion.links == 3
    else:
        assert np.abs(read.motion.theta - truth).max() < within
    assert read.motion.position is None


def test_the_cart_of_a_recording_of_another_program_is_read_as_one_that_moves(written):
    place = 0.1 * np.sin(3.0 * TIMES)
    text = table("pwm, time_us, position, angle", ZERO, 1e6 * TIMES, place, SWING)
    read = read_recording(written(text))
    assert read.motion.position == pytest.approx(place, abs=1e-6)
    assert "'position' is the position of a cart, in metres" in read.said[0]
    with pytest.raises(ValueError, match="got a pivot, or a cart, that moves"):
        measure_swings(read.motion)


def test_comments_names_that_stand_twice_and_units_are_read_in_our_own_layout(written):
    text = table("time,theta0", TIMES, SWING)
    for more in ("# stopped by hand\n", "time, theta0\n"):
        read = read_recording(written(text + more))
        assert read.motion.theta == pytest.approx(SWING, abs=1e-6)
        assert read.said == []
    for units, angles in (("s,rad", SWING), ("(s),(deg)", np.degrees(SWING))):
        read = read_recording(written(table(f"time,theta0\n{units}", TIMES, angles)))
        assert read.motion.theta == pytest.approx(SWING, abs=1e-6)
    with pytest.raises(ValueError, match="line 302: theta0 must be a number, got 'stopped'"):
        read_motion(written(text + "5.0,stopped\n"))


@pytest.mark.parametrize(
    ("heads", "times", "angles"),
    [
        ("Time,Angle1,Angle2\nseconds,degrees,degrees", TIMES, np.degrees(BOTH.theta)),
        ("time,theta0,theta1\nseconds,degrees,degrees", TIMES, np.degrees(BOTH.theta)),
        ("Time,Angle1,Angle2\nms,rev,rev", 1e3 * TIMES, BOTH.theta / (2.0 * np.pi)),
        ("time,theta0,theta1,,", TIMES, BOTH.theta),
    ],
)
def test_units_and_empty_columns_of_spreadsheets_are_read(heads, times, angles, written):
    read = read_motion(
        written(table(heads, times, *angles.T, *[[""] * 300] * heads.count(",,") * 2))
    )
    assert read.theta == pytest.approx(BOTH.theta, abs=1e-6)
    rows = table("Time;Angle;Speed;No\ns;deg;rpm;-", TIMES, np.degrees(SWING), ZERO, ZERO,
                 separator=";")  # fmt: skip
    assert read_motion(written(rows)).theta == pytest.approx(SWING, abs=1e-6)


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        ("theta1,theta2,tau0,tau1", [1.0, 2.0]),
        ("q0,q1,tau_1,tau_2", [1.0, 2.0]),
        ("theta1,theta2,tau2,tau1", [2.0, 1.0]),
    ],
)
def test_each_torque_acts_at_its_joint(names, expected, written):
    ones = np.ones_like(TIMES)
    read = read_motion(written(table(f"t,{names}", TIMES, *BOTH.theta.T, ones, 2.0 * ones)))
    assert read.torque[0].tolist() == expected


def test_rates_may_be_relative_to_the_link_above(written):
    rates = np.diff(BOTH.omega, axis=1, prepend=0.0)
    read = read_motion(written(table("t,omega0,omega1", TIMES, *rates.T)), relative=True)
    expected = read_motion(written(table("t,omega0,omega1", TIMES, *BOTH.omega.T)))
    assert read.theta == pytest.approx(expected.theta, abs=1e-6)
    with pytest.raises(ValueError, match="relative must be left out where positions show"):
        read_motion(written(table("t,x,y", TIMES, *FIRST.T)), relative=True)


def test_a_place_beside_an_angle_is_said_to_be_left_out(written):
    read = read_recording(written(table("t,theta,x", TIMES, SWING, 0.1 * SWING)))
    assert read.motion.position is None
    assert "'x' is not read: position=x in columns makes it that of a cart" in read.said[0]


@pytest.mark.parametrize("separator", [",", ";"])
def test_columns_name_what_has_other_names_alone(separator, written):
    text = table("time,theta0,b".replace(",", separator), TIMES, *BOTH.theta.T, separator=separator)
    read = read_motion(written(text), columns={"theta1": "b"})
    assert read.theta == pytest.approx(BOTH.theta, abs=1e-6)


def test_rows_without_a_time_are_counted_among_those_left_out(written):
    times = [f"{time:.8g}" if k % 10 else "" for k, time in enumerate(TIMES.tolist())]
    read = read_recording(written(table("t,angle", times, SWING)))
    assert read.motion.times.size == 270
    assert "30 of 300 rows have empty cells and are left out" in read.said[0]


@pytest.mark.parametrize(("unit", "size"), [("s", 1.0), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_times_since_1970_begin_at_zero_whatever_their_unit(unit, size, written):
    rows = [str(round(size * DAY) + round(size * time)) for time in np.arange(300).tolist()]
    read = read_recording(written(table(f"time_{unit},angle", rows, SWING)))
    assert read.motion.times == pytest.approx(np.arange(300.0), abs=1e-5)


def test_of_rows_that_stand_twice_one_is_taken(written):
    twice = table("t,angle", np.repeat(TIMES, 2), np.repeat(SWING, 2))
    read = read_recording(written(twice))
    assert read.motion.times == pytest.approx(TIMES)
    assert "300 rows are the same as those before them and are left out" in read.said[0]


def test_a_first_row_without_a_date_is_left_out(written):
    start = np.datetime64("2024-05-01T12:00:00.000000")
    dates = [str(start + np.timedelta64(round(1e6 * time), "us")) for time in TIMES.tolist()]
    read = read_recording(written(table("time,angle", ["", *dates[1:]], SWING)))
    assert read.motion.times == pytest.approx(TIMES[1:] - TIMES[1], abs=1e-6)


def test_cells_in_which_r_and_excel_write_that_they_are_empty_are_so(written):
    cells = [("NA", "#N/A", f"{angle:.9g}")[min(k % 9, 2)] for k, angle in enumerate(SWING[:, 0])]
    assert read_recording(written(table("t,angle", TIMES, cells))).motion.times.size == 232


def test_times_that_begin_again_are_another_recording(written):
    read = read_recording(written(PLAIN + PLAIN.replace("time,angle\n", "")))
    assert np.bincount(read.motion.piece).tolist() == [300, 300]
    assert "these are 2 recordings" in read.said[0]


def rates_of(rows):
    """A table of the gyroscope, with a steady error, of rows of a long swing."""
    times = np.arange(0.0, 12.0, 0.02)
    swing = simulate(Chain([1.0], [0.5]), 0.5, 0.0, times)
    return swing.theta[rows], table("t,omega0", times[rows], swing.omega[rows] + 0.03)


def test_rates_are_not_integrated_across_a_gap(written):
    kept = np.r_[0:250, 285:320, 355:600]  # the part in the middle has no whole swing
    theta, text = rates_of(kept)
    read = read_recording(written(text))
    assert read.motion.times.size == 250 + 245
    assert "35 rows show no whole swing between two gaps and are left out" in read.said[0]
    assert np.abs(read.motion.theta - np.delete(theta, np.s_[250:285], axis=0)).max() < 0.02


def test_rates_are_not_integrated_from_one_recording_to_the_next(written):
    parts = [rates_of(rows) for rows in (np.s_[:300], np.s_[40:330])]
    (first, text), (second, more) = parts
    start = 40 * 0.02
    lines = [line.split(",") for line in more.splitlines()[1:]]
    more = "".join(f"{float(time) - start:.8g},{rate}\n" for time, rate in lines)
    read = read_recording(written(text + more))
    assert np.bincount(read.motion.piece).tolist() == [300, 290]
    assert np.abs(read.motion.theta - np.concatenate([first, second])).max() < 0.02


def test_rates_without_a_whole_swing_between_any_gaps_are_refused(written):
    with pytest.raises(ValueError, match="rates must show a whole swing of every link"):
        read_recording(written(rates_of(np.r_[0:30, 60:90, 120:150])[1]))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (SENSORS, "x, y and z may be places or the axes of a sensor"),
        (table("t,theta,alpha", TIMES, SWING, SWING), "'theta' and 'alpha' seem to be the same"),
        (table("t,angle (counts)", TIMES, SWING), "unit of the column 'angle (counts)' must"),
        (table("t,gyro_x", TIMES, SWING), "rates of a gyroscope must be about x, y and z"),
        (table("t,Acceleration x (m/s^2)", TIMES, SWING), "accelerations show no angle"),
        (table("t,q0,q1,q2,q3", TIMES, np.cos(SWING / 2), ZERO, np.sin(SWING / 2), ZERO),
         "'q0', 'q1', 'q2', 'q3' are a quaternion"),
        (table("t,x (cm),y (mm)", TIMES, FIRST[:, 0], 10.0 * FIRST[:, 1]),
         "positions must have one unit, but differ in it: 'x (cm)', 'y (mm)'"),
        (table("", SWING, TIMES, ZERO), "such as --columns time=1,theta0=2"),
        (table("t,angle", [""] * 300, SWING), "the column 't' must have times, but it is empty"),
        (table("t,angle", [f'"{997 + k:,}"' for k in range(300)], SWING), "t (text)"),
        (table("t;angle", [f"{997 + k:,}" for k in range(300)], SWING, separator=";"),
         "t (text)"),
        (table("t,theta1,theta2,tau1,tau_meas1", TIMES, *BOTH.theta.T, SWING, SWING),
         "'tau1' and 'tau_meas1' seem to be the same"),
        (table("t,gyro_x,gyro_y,gyro_z,tau0,tau1", TIMES, ZERO, np.gradient(SWING[:, 0], TIMES),
               ZERO, SWING, SWING), "the file must have an angle for each torque"),
        (table("t,q0,q1,tau_2", TIMES, *BOTH.theta.T, SWING),
         "torques 'tau_2' must be numbered as the angles 'q0', 'q1'"),
        (table("t,angle", TIMES, ["?"] * 9 + SWING[9:, 0].astype(str).tolist()), "must be a table"),
    ],
)  # fmt: skip
def test_a_table_that_may_mean_two_things_is_refused_with_the_way_out(text, message, written):
    with pytest.raises(ValueError, match=message.replace("(", r"\(").replace(")", r"\)")):
        read_motion(written(text, "a.csv"))
