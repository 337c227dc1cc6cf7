"""Motions from CSV files: what is read, and what is refused with file and line."""

from __future__ import annotations

import os
import warnings
from types import SimpleNamespace

import numpy as np
import pytest

from leg_dynamics.analysis.trajectories import csv_file, from_csv
from leg_dynamics.errors import JointLimitError, LegDynamicsWarning, OutOfReachError, TrajectoryError


class TwoBar:
    """A planar 2R arm in the x-y plane with unit links: its inverse kinematics is a textbook's."""

    joint_names = ("shoulder", "elbow")
    units = SimpleNamespace(joints=("rad", "rad"))
    limits = SimpleNamespace(lower=np.array([-3.0, 0.0]), upper=np.array([3.0, 2.5]))

    def inverse_kinematics(self, p, *, limits="error"):
        x, y = p[:, 0], p[:, 1]
        cosine = (x**2 + y**2 - 2.0) / 2.0
        rows = np.flatnonzero(np.abs(cosine) > 1.0)
        if rows.size:
            raise OutOfReachError("the foot is out of reach", rows=rows, margin=-1.0)
        elbow = np.arccos(cosine)
        return np.stack([np.arctan2(y, x) - np.arctan2(np.sin(elbow), 1.0 + np.cos(elbow)), elbow], axis=1)


ARM = TwoBar()
TIME = np.linspace(0.0, 2.0, 41)


def coordinates(time):
    return np.stack([0.4 * np.sin(time), 0.8 + 0.3 * np.cos(time)], axis=1)


def rates(time):
    return np.stack([0.4 * np.cos(time), -0.3 * np.sin(time)], axis=1)


def table(header="t,q1,q2", time=TIME, values=None, delimiter=",", end="\n"):
    values = coordinates(time) if values is None else values
    rows = [header] + [
        delimiter.join(f"{number:.17g}" for number in (t, *row)) for t, row in zip(time, values, strict=True)
    ]
    return end.join(rows) + end


@pytest.fixture
def write(tmp_path):
    def write(content):
        path = tmp_path / "motion.csv"
        path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8"))
        return path

    return write


def test_joint_columns_and_derivatives(write):
    motion = from_csv(write(table()), ARM)
    np.testing.assert_array_equal(motion.q, coordinates(TIME))
    np.testing.assert_allclose(motion.v, rates(TIME), atol=2e-7)
    # Second derivative of (sin, cos) is minus itself; a quintic's error is worst at the ends.
    np.testing.assert_allclose(motion.a, [0.0, 0.8] - coordinates(TIME), atol=2e-5)
    assert motion.name == "motion"
    assert motion.foot_force is None


def test_quintic_is_reproduced_exactly_on_uneven_times(write):
    time = np.array([0.0, 0.1, 0.35, 0.5, 0.9, 1.0, 1.4]) + 100.0
    s = time - 100.0
    values = np.stack([s**5 - s**2, 0.5 + 0.2 * s], axis=1)
    motion = from_csv(write(table(time=time, values=values)), ARM, limits="ignore")
    np.testing.assert_allclose(motion.v, np.stack([5 * s**4 - 2 * s, 0.2 + 0 * s], axis=1), atol=1e-9)
    np.testing.assert_allclose(motion.a, np.stack([20 * s**3 - 2, 0 * s], axis=1), atol=1e-8)


def test_time_scale_does_not_cost_accuracy(write):
    motion = from_csv(write(table(time=TIME * 1e-3 + 5.0, values=coordinates(TIME))), ARM)
    np.testing.assert_allclose(motion.v * 1e-3, rates(TIME), atol=1e-6)


@pytest.mark.parametrize(
    "header", ["t,shoulder,elbow", "time,q1,q2", "t [s],shoulder [rad],q2[rad]", ' t ,"q1", "q2" ', "t,q1,elbow"]
)
def test_header_variants(write, header):
    np.testing.assert_array_equal(from_csv(write(table(header)), ARM).q, coordinates(TIME))


def test_columns_in_any_order(write):
    motion = from_csv(write(table("t,elbow,shoulder", values=coordinates(TIME)[:, ::-1])), ARM)
    np.testing.assert_array_equal(motion.q, coordinates(TIME))


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_line_ends_and_delimiters(write, delimiter, end):
    text = table(delimiter.join(["t", "q1", "q2"]), delimiter=delimiter, end=end)
    np.testing.assert_array_equal(from_csv(write(text), ARM).q, coordinates(TIME))


def test_byte_order_mark_and_blank_lines(write):
    content = b"\xef\xbb\xbf\n" + table().replace("\n", "\n\n").encode() + b"\n \n"
    np.testing.assert_array_equal(from_csv(write(content), ARM).q, coordinates(TIME))


def foot(time):
    q = coordinates(time)
    both = q.sum(axis=1)
    return np.stack([np.cos(q[:, 0]) + np.cos(both), np.sin(q[:, 0]) + np.sin(both), 0.0 * time], axis=1)


def test_foot_path_goes_through_inverse_kinematics(write):
    motion = from_csv(write(table("t,x,y,z", values=foot(TIME))), ARM)
    np.testing.assert_allclose(motion.q, coordinates(TIME), atol=1e-13)
    np.testing.assert_allclose(motion.v, rates(TIME), atol=2e-7)


def test_foot_path_out_of_reach_names_the_line(write):
    path = foot(TIME)
    path[7] = [2.1, 0.0, 0.0]
    with pytest.raises(OutOfReachError, match=r"motion\.csv:9: .*out of reach") as caught:
        from_csv(write(table("t [s],x [m],y [m],z [m]", values=path)), ARM)
    assert caught.value.line == 9
    assert caught.value.rows.tolist() == [7]


def test_limits_name_the_line_and_can_be_ignored(write):
    values = coordinates(TIME)
    values[:, 0] += np.linspace(0.0, 4.0, TIME.size)
    first = int(np.flatnonzero(values[:, 0] > 3.0)[0])
    path = write("\n" + table(values=values))
    with pytest.raises(JointLimitError, match=rf"motion\.csv:{first + 3}: .*shoulder"):
        from_csv(path, ARM)
    np.testing.assert_array_equal(from_csv(path, ARM, limits="ignore").q, values)
    with pytest.raises(TrajectoryError, match="limits must be"):
        from_csv(path, ARM, limits="perhaps")


ROWS = table().splitlines()


def changed(line, text):
    """The table with one line replaced; lines count from 1."""
    return "\n".join([*ROWS[: line - 1], text, *ROWS[line:]]) + "\n"


@pytest.mark.parametrize(
    ("content", "place", "text"),
    [
        ("", ":1:", "empty"),
        ("\n \n", ":1:", "empty"),
        (b"\xef\xbb\xbf", ":1:", "empty"),
        ("\n".join(ROWS[1:]), ":1:", "header is missing"),
        ("\n\n" + "\n".join(ROWS[1:]), ":3:", "header is missing"),
        (ROWS[0] + "\n", ":1:", "no row under it"),
        ("\n".join(ROWS[:6]), ":6:", "5 rows are too few"),
        (changed(1, "t,q1,q3"), ":1:", "unknown column 'q3'; the columns must be t and q1, q2"),
        (changed(1, "t,q1,x"), ":1:", "mixed"),
        (changed(1, "t,q1,q1"), ":1:", "'q1' is given twice"),
        (changed(1, "t,q1,shoulder"), ":1:", "'shoulder' is given twice"),
        ("t,q1\n0,1\n", ":1:", "column 'elbow' is missing"),
        ("q1,q2\n0,1\n", ":1:", "column 't' is missing"),
        ("t,x,y\n0,1,2\n", ":1:", "column 'z' is missing"),
        (changed(1, "t,q1 [deg],q2"), ":1:", "'q1' is in 'deg', but only rad is read"),
        (changed(1, "t [ms],q1,q2"), ":1:", "only s is read"),
        (changed(1, "t q1 q2"), ":1:", "unknown column 't q1 q2'"),
        (changed(5, "0.15,1.0"), ":5:", "2 values under 3 column names"),
        (changed(5, "0.15,1,2,3"), ":5:", "4 values under 3 column names"),
        (changed(5, "0.15,one,2"), ":5:", "q1: 'one' is not a number"),
        (changed(5, "0.15,,2"), ":5:", "q1: the value is missing"),
        (changed(5, "0.15,1_0,2"), ":5:", "'1_0' is not a number"),
        (changed(5, "0.15,\N{ARABIC-INDIC DIGIT ONE},2"), ":5:", "is not a number"),
        (changed(5, "0.15,0x1,2"), ":5:", "is not a number"),
        (changed(5, "0.15,nan,2"), ":5:", "q1 is nan; every value must be finite"),
        (changed(5, "0.15,-Infinity,2"), ":5:", "must be finite"),
        (changed(5, "0.15,1e999,2"), ":5:", "too large"),
        (changed(5, "0.15,1,-1e308"), ":5:", r"q2 = -1e\+308 is out of range: its magnitude may be 1e\+09 at most"),
        (changed(42, "1e308,1,1"), ":42:", r"t = 1e\+308 is out of range: its magnitude may be 1e\+12"),
        (changed(2, "-1e308,1,1"), ":2:", "out of range"),
        (table(time=np.arange(41) * 1e300), ":3:", "out of range"),
        (table(time=np.arange(41) * 1e-300), ":3:", "1e-300 s from the row before is shorter than 1e-12 s"),
        ("t,q_shoulder,q_elbow,mass\n0,1,1,1\n", ":1:", "unknown column 'mass'"),
        ("t,q_shoulder,q_elbow,q1\n0,1,1,1\n", ":1:", "unknown column 'q1'"),
        ("t,q_shoulder,q_elbow,q_elbow\n0,1,1,1\n", ":1:", "given twice"),
        ("t,q_shoulder,v_shoulder\n0,1,1\n", ":1:", "unknown column 'v_shoulder'"),
        ("t,q_shoulder\n0,1\n", ":1:", "column 'elbow' is missing"),
        ("q_shoulder,q_elbow,tau_A\n0,1,1\n", ":1:", "column 't' is missing"),
        ("t,q_shoulder [deg],q_elbow\n0,1,1\n", ":1:", "only rad is read"),
        (changed(5, '0.15,"1,2'), ":5:", "2 values under 3"),
        (changed(5, "0.15,1," + "2" * 200_000), ":5:", "not a CSV row"),
        (changed(5, "0.1,1,2"), ":5:", r"0\.1\d* s follows 0\.1\d* s"),
        (changed(5, "-3,1,2"), ":5:", "time must increase"),
        ("t;q1;q2\n0;0,5;1\n", ":2:", "q1: '0,5' is not a number; write decimals with a point"),
        (table().encode("utf-16"), ":1:", "not UTF-8"),
        (table().encode() + b"2.1,\xff,1\n", ":43:", "not UTF-8"),
        (changed(5, "0.15,\0,1"), ":5:", "NUL"),
    ],
)
def test_bad_files_name_file_and_line(write, content, place, text):
    path = write(content)
    with pytest.raises(TrajectoryError, match=text) as caught:
        from_csv(path, ARM)
    assert str(caught.value).startswith(f"{path}{place} ")
    assert f":{caught.value.line}:" == place


RESULTS = "t [s],q_shoulder [rad],q_elbow [rad],v_shoulder [rad/s],tau_A [N*m],foot_x [m],foot_force_x [N]"


def test_table_of_results_is_read_again(write):
    values = np.c_[coordinates(TIME), np.full((TIME.size, 4), np.nan)]
    path = write(table(RESULTS, values=values))
    with pytest.warns(LegDynamicsWarning, match=r"motion\.csv:1: .*not v_shoulder, tau_A, foot_x, foot_force_x; "):
        motion = from_csv(path, ARM)
    np.testing.assert_array_equal(motion.q, coordinates(TIME))
    np.testing.assert_allclose(motion.v, rates(TIME), atol=2e-7)
    assert motion.foot_force is None


def test_coordinates_of_a_table_of_results_alone_need_no_warning(write):
    for header in ("t,q_shoulder,q_elbow", "t,q_shoulder,elbow"):
        np.testing.assert_array_equal(from_csv(write(table(header)), ARM).q, coordinates(TIME))


def test_a_joint_called_like_a_result(write):
    class Arm(TwoBar):
        joint_names = ("q_b", "b")

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        np.testing.assert_array_equal(from_csv(write(table("t,q_b,b")), Arm()).q, coordinates(TIME))
        np.testing.assert_array_equal(from_csv(write(table("t,q_q_b,q_b")), Arm()).q, coordinates(TIME))


@pytest.mark.parametrize(
    ("time", "value"), [(np.arange(41) * 1.01e-12, 1.0), (np.arange(41) * 2.5e10, 1e9), (TIME, -1e9)]
)
def test_largest_and_smallest_numbers(write, time, value):
    values = np.full((41, 2), value)
    motion = from_csv(write(table(time=time, values=values)), ARM, limits="ignore")
    np.testing.assert_array_equal(motion.q, values)


def test_only_regular_files_are_opened(tmp_path, write):
    os.mkfifo(tmp_path / "pipe.csv")
    with pytest.raises(TrajectoryError, match=r"pipe\.csv: this is not a regular file"):
        from_csv(tmp_path / "pipe.csv", ARM)
    (tmp_path / "link.csv").symlink_to(write(table()))
    np.testing.assert_array_equal(from_csv(tmp_path / "link.csv", ARM).q, coordinates(TIME))


def test_size_is_capped(tmp_path, monkeypatch, write):
    huge = tmp_path / "huge.csv"
    with huge.open("wb") as file:
        file.truncate(csv_file.MAX_BYTES + 1)  # sparse
    with pytest.raises(TrajectoryError, match=r"huge\.csv: the file is larger than 200 MB"):
        from_csv(huge, ARM)
    path = write(table())
    size = path.stat().st_size
    monkeypatch.setattr(csv_file, "MAX_BYTES", size)
    np.testing.assert_array_equal(from_csv(path, ARM).q, coordinates(TIME))
    # A file may grow, or not tell its size.
    monkeypatch.setattr(csv_file, "MAX_BYTES", size - 1)
    monkeypatch.setattr(type(path), "stat", lambda self: SimpleNamespace(st_mode=0o100644, st_size=0))
    with pytest.raises(TrajectoryError, match="larger"):
        from_csv(path, ARM)


def test_unreadable_files(tmp_path):
    for path in (tmp_path / "absent.csv", tmp_path):
        with pytest.raises(TrajectoryError, match="cannot be read"):
            from_csv(path, ARM)


def test_times_too_uneven_for_a_spline(write):
    time = np.array([0.0, 1e-9, 2e-9, 3e-9, 4e-9, 1e6, 2e6, 3e6])
    with pytest.raises(TrajectoryError, match="evenly"):
        from_csv(write(table(time=time, values=coordinates(np.arange(8.0)))), ARM)
