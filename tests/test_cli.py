"""The command line: what it prints, where it exits, what it writes."""

from __future__ import annotations

import csv
import importlib
import io
import json
import os
import re
import socket
import subprocess
import sys
import warnings
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

import leg_dynamics
from leg_dynamics import cli
from leg_dynamics.analysis.trajectories import omnileg_eq52
from leg_dynamics.cli.files import write_atomically
from leg_dynamics.cli.motion import summarize, torque_along
from leg_dynamics.cli.output import ascii_substitute, chunks, complain
from leg_dynamics.errors import CrosscheckError, LegDynamicsWarning, NonFiniteError, OutputError

# The package's attribute of that name is the function.
CROSSCHECK = importlib.import_module("leg_dynamics.verification.crosscheck")
SHORT = ("--duration", "0.1", "--rate", "100")


PENDULUM = """
<robot name="pendulum">
  <link name="base"/>
  <link name="[bold]rod"><inertial><mass value="1"/>
    <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <link name="bob"><inertial><origin xyz="0 0 -1"/><mass value="1"/>
    <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <joint name="[red]swing" type="continuous"><parent link="base"/><child link="[bold]rod"/><axis xyz="0 1 0"/></joint>
  <joint name="nod" type="continuous"><parent link="[bold]rod"/><child link="bob"/><axis xyz="0 1 0"/></joint>
  <configuration name="home"><joint name="nod" value="0.5"/></configuration>
</robot>
"""


@dataclass
class Result:
    code: int
    out: str
    err: str


def run(*arguments):
    result = CliRunner().invoke(cli.app, [str(argument) for argument in arguments])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return Result(result.exit_code, result.stdout, result.stderr)


def as_json(*arguments):
    result = run(*arguments, "--json")
    assert result.code == 0, result.err

    def refuse(constant):
        raise AssertionError(f"{constant} is not JSON")

    return json.loads(result.out, parse_constant=refuse)


def refused(*arguments):
    """One readable line on stderr, nothing on stdout, exit code 2."""
    result = run(*arguments)
    assert (result.code, result.out) == (2, "")
    assert result.err.startswith("leg-dynamics: error: ")
    assert result.err.count("\n") == 1
    return result.err


def table(path):
    with path.open(encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    return header, np.array(rows, dtype=float)


# The command as a whole.


COMMANDS = (
    "list",
    "info",
    "render",
    "torque",
    "crosscheck",
    "preview",
    "workspace",
    "design",
    "gait",
    "demo",
    "reproduce",
)


def test_help_lists_every_command():
    listed = run("--help").out
    for command in (*COMMANDS, "bench"):
        assert re.search(rf"\b{command}\b", listed), command


@pytest.mark.parametrize("command", [[], *([name] for name in COMMANDS)])
def test_help_documents_exit_codes(command):
    result = run(*command, "--help")
    text = " ".join(result.out.split())
    assert result.code == 0
    for part in ("0 done", "1 a check failed", "2 bad usage", "130 interrupted"):
        assert part in text


def test_version():
    assert run("--version") == Result(0, f"leg-dynamics {leg_dynamics.__version__}\n", "")


@pytest.mark.parametrize("arguments", [["no-such-command"], ["torque"], ["torque", "omnileg", "--no-such-option"]])
def test_bad_usage(arguments):
    result = run(*arguments)
    assert (result.code, result.out) == (2, "")
    assert "Error" in result.err


def test_interrupt(monkeypatch):
    def interrupted():
        raise KeyboardInterrupt

    monkeypatch.setattr(leg_dynamics, "available", interrupted, raising=False)
    assert run("list") == Result(130, "", "leg-dynamics: interrupted\n")


def test_disagreement_raised_as_an_error_is_exit_code_1(monkeypatch):
    def disagree():
        raise CrosscheckError("two derivations\ndiffer")

    monkeypatch.setattr(leg_dynamics, "available", disagree, raising=False)
    assert run("list") == Result(1, "", "leg-dynamics: error: two derivations differ\n")


def test_warnings_are_one_line_and_do_not_stop(monkeypatch):
    def odd():
        warnings.warn("an odd\ninput", LegDynamicsWarning, stacklevel=1)
        return ()

    monkeypatch.setattr(leg_dynamics, "available", odd, raising=False)
    result = run("list", "--json")
    assert (result.code, result.err) == (0, "leg-dynamics: warning: an odd input\n")
    assert json.loads(result.out) == {"legs": []}


def test_a_programming_error_is_not_hidden(monkeypatch):
    def broken():
        raise ZeroDivisionError

    monkeypatch.setattr(leg_dynamics, "available", broken, raising=False)
    with pytest.raises(ZeroDivisionError):
        run("list")


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "utf-8"])
def test_every_terminal_encoding_works(encoding):
    environment = {"PYTHONIOENCODING": encoding, "PYTHONPATH": str(Path(cli.__file__).parents[2]), "PATH": ""}
    command = [sys.executable, "-m", "leg_dynamics.cli", "torque", "omnileg", *SHORT]
    result = subprocess.run(command, capture_output=True, env=environment, check=False)
    text = result.stdout.decode(encoding)
    assert (result.returncode, result.stderr) == (0, b"")
    assert ("N*m" if encoding == "ascii" else "N·m") in text


def test_substitutes_are_readable():
    error = UnicodeEncodeError("ascii", "2 N·m² α", 3, 4, "")
    assert ascii_substitute(error) == ("*", 4)
    error.start, error.end = 5, 8
    assert ascii_substitute(error) == ("^2??", 8)
    with pytest.raises(UnicodeDecodeError):
        ascii_substitute(UnicodeDecodeError("ascii", b"\xff", 0, 1, ""))


def launch(*arguments, stdout, size=None, prefix=()):
    """The command as a process, whose files may have at most `size` bytes."""

    def limit():
        import resource

        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))

    environment = {"PYTHONPATH": str(Path(cli.__file__).parents[2]), "PATH": os.defpath, "PYTHONDONTWRITEBYTECODE": "1"}
    return subprocess.run(
        [*prefix, sys.executable, "-m", "leg_dynamics.cli", *arguments],
        stdout=stdout,
        stderr=subprocess.PIPE,
        env=environment,
        preexec_fn=None if size is None else limit,
        check=False,
    )


needs_posix = pytest.mark.skipif(os.name != "posix", reason="POSIX files and limits")
OUTPUTS = [("list",), ("list", "--json"), ("render", "omnileg"), ("--version",)]


@needs_posix
@pytest.mark.parametrize("arguments", OUTPUTS)
def test_full_standard_output_is_one_line(tmp_path, arguments):
    with (tmp_path / "out").open("wb") as file:
        # Room for the temporary folder's own test, which a rendering asks for.
        result = launch(*arguments, stdout=file, size=16)
    assert result.stderr == b"leg-dynamics: error: the output cannot be written: File too large\n"
    assert result.returncode == 2


@needs_posix
@pytest.mark.parametrize("arguments", OUTPUTS)
def test_broken_pipe_is_silent(arguments):
    reader, writer = os.pipe()
    os.close(reader)
    result = launch(*arguments, stdout=writer)
    os.close(writer)
    assert (result.returncode, result.stderr) == (2, b"")


@needs_posix
def test_closed_standard_streams():
    def closed(stream):
        prefix = ("/bin/sh", "-c", f'exec "$@" {stream}>&-', "sh")
        return launch("list", "--json", stdout=subprocess.PIPE, prefix=prefix)

    result = closed(1)
    assert (result.returncode, result.stdout) == (2, b"")
    assert result.stderr.startswith(b"leg-dynamics: error: standard output is closed")
    assert result.stderr.count(b"\n") == 1
    result = closed(2)
    assert result.returncode == 0
    assert json.loads(result.stdout)["legs"]


def test_full_standard_error_keeps_the_exit_code(monkeypatch):
    class Full(io.StringIO):
        def write(self, text):
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(sys, "stderr", Full())
    complain("lost")


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (OSError(28, "No space left on device"), "the output cannot be written: No space left on device"),
        (OSError(36, "File name too long", "aaa"), "aaa: File name too long"),
    ],
)
def test_system_errors_are_one_line(monkeypatch, error, text):
    def fail():
        raise error

    monkeypatch.setattr(leg_dynamics, "available", fail, raising=False)
    assert text in refused("list")


def test_a_system_error_without_a_file_is_not_taken_for_output(monkeypatch):
    def fail():
        raise OSError(98, "Address already in use")

    monkeypatch.setattr(leg_dynamics, "available", fail, raising=False)
    with pytest.raises(OSError, match="Address"):
        run("list")


# list, info, render.


def test_list():
    assert "omnileg" in run("list").out
    (leg,) = (row for row in as_json("list")["legs"] if row["name"] == "omnileg")
    assert leg["joints"] == ["alpha", "beta", "gamma"]
    assert leg["actuators"] == ["M2", "M1", "M3"]
    assert leg["trajectories"][0] == "eq52"


def test_info():
    facts = as_json("info", "omnileg")
    assert (facts["loops"], facts["couplings"], facts["foot"]) == (5, 3, "foot")
    np.testing.assert_allclose([joint["upper"] for joint in facts["joints"]], np.radians([65.0, 65.0, 85.0]))
    assert (facts["mobility"]["mobility"], facts["mobility"]["redundant"]) == (3, 9)
    assert {parameter["name"]: parameter["value"] for parameter in facts["parameters"]}["L1"] == 0.15
    text = run("info", "omnileg").out
    for part in ("gamma", "1.48353", "N·m", "Table 2", "redundant"):
        assert part in text


def test_info_with_a_parameter_set():
    parameters = as_json("info", "omnileg", "--set", "L1=0.2", "--set", "foot_mass=1")["parameters"]
    values = {parameter["name"]: parameter["value"] for parameter in parameters}
    assert (values["L1"], values["foot_mass"], values["L4"]) == (0.2, 1.0, 0.095)


@pytest.mark.parametrize("command", ["info", "preview", "torque"])
def test_advice_on_routes_is_an_option(command):
    result = run(command, "quadruped_leg", "--set", "frozen=0")
    assert result.code == 2
    assert "change the file, or use --route pinocchio, which has no such assumption" in " ".join(result.err.split())
    assert "route=" not in result.err


def test_infinite_limits_become_null(tmp_path):
    file = tmp_path / "pendulum[1].urdf"
    file.write_text(PENDULUM, encoding="utf-8")
    facts = as_json("info", file)
    assert facts["joints"][0]["upper"] is None
    assert facts["foot"] is None
    # Names from files are text, never markup.
    assert "[red]swing" in run("info", file).out


def test_render_to_stdout_and_file(tmp_path):
    from leg_dynamics.description import shipped_urdf

    shipped = shipped_urdf("omnileg").read_text(encoding="utf-8")
    assert run("render", "omnileg").out == shipped
    result = run("render", "omnileg", "--output", tmp_path / "leg.urdf")
    assert (result.code, result.out) == (0, f"wrote {tmp_path / 'leg.urdf'}\n")
    assert (tmp_path / "leg.urdf").read_text(encoding="utf-8") == shipped
    changed = run("render", "omnileg", "--set", "L1=0.2").out
    assert changed.startswith("<?xml")
    assert changed != shipped


@pytest.mark.parametrize(
    ("leg", "change", "words"),
    [
        ("hexapod_leg", "l1_min=1", "l1_min = 1 m must be at most l1_max = 0.9 m"),
        ("hexapod_leg", "a=-1", "a = -1 m must be greater than 0 m"),
        ("hexapod_leg", "side=0.5", "alpha3"),
        ("hexapod", "rod_2_diameter=0.06", "at most sleeve_2_diameter - 2*sleeve_2_wall = 0.055 m"),
        ("omnileg", "L1=-0.1", "L1"),
    ],
)
def test_render_writes_no_impossible_leg(tmp_path, leg, change, words):
    file = tmp_path / "leg.urdf"
    rendered, loaded = (run(*way, leg, "--set", change) for way in (("render",), ("info",)))
    refused = run("render", leg, "--set", change, "--output", file)
    assert (rendered.code, rendered.out, refused.code) == (2, "", 2)
    assert words in refused.err
    if leg != "hexapod":  # a robot is no leg, which `info` says first
        assert refused.err == rendered.err
        # Only `info` can choose the route; what is rendered is loaded from Python or by another command.
        assert loaded.err.replace("--route pinocchio", "route='pinocchio'") == refused.err
    assert not file.exists()


def test_render_writes_a_leg_at_its_limits(tmp_path):
    file = tmp_path / "leg.urdf"
    assert run("render", "hexapod_leg", "--set", "rod_2_diameter=0.055", "--output", file).code == 0
    assert run("info", file).code == 0


def test_a_file_that_renders_to_no_mechanism_is_not_written(tmp_path):
    source, file = tmp_path / "my.urdf.xacro", tmp_path / "my.urdf"
    text = '<robot name="my" xmlns:xacro="http://www.ros.org/wiki/xacro"><link name="a"/>{}</robot>'
    source.write_text(text.format('<joint name="j" type="fixed"><parent link="a"/><child link="b"/></joint>'))
    refused = run("render", source, "--output", file)
    assert (refused.code, file.exists()) == (2, False)
    assert "unknown link 'b'" in refused.err
    source.write_text(text.format(""))
    assert run("render", source, "--output", file).code == 0
    assert file.exists()


def test_help_of_reproduce_names_every_paper():
    from leg_dynamics import papers

    text = run("reproduce", "--help").out
    assert papers.names()
    assert all(name in text for name in papers.names())


def test_render_check(tmp_path, monkeypatch):
    from leg_dynamics import description

    assert run("render", "omnileg", "--check") == Result(0, "omnileg: up to date\n", "")
    shipped = description.shipped_urdf("omnileg").read_text(encoding="utf-8")
    stale = tmp_path / "omnileg.urdf"
    monkeypatch.setattr(description, "shipped_urdf", lambda name: stale)
    lines = shipped.splitlines(keepends=True)
    for text, line in (
        ("".join([*lines[:4], "<!-- changed -->" + lines[4], *lines[5:]]), 5),
        ("".join(lines[:7]), 8),
        (shipped + "<!-- more -->\n", len(lines) + 1),
    ):
        stale.write_text(text, encoding="utf-8")
        result = run("render", "omnileg", "--check")
        assert (result.code, result.out) == (1, "")
        assert f"omnileg.urdf:{line}: stale" in result.err
    stale.unlink()
    assert run("render", "omnileg", "--check").code == 1


@pytest.mark.parametrize("more", [("--set", "L1=0.2"), ("--output", "leg.urdf")])
def test_render_check_goes_alone(more):
    assert run("render", "omnileg", "--check", *more).code == 2


# torque.


def test_torque_prints_peaks():
    result = run("torque", "omnileg", "--trajectory", "eq52", *SHORT)
    assert result.code == 0
    for part in ("omnileg along eq52, 0 to 0.1 s, 11 samples", "M1", "M2", "M3", "N·m"):
        assert part in result.out
    assert "environment" not in result.out


def test_torque_table_is_the_legs_torque(tmp_path):
    file = tmp_path / "torque.csv"
    result = run("torque", "omnileg", *SHORT, "--foot-force", "0,-20,20", "--force-window", "0,0.05", "--output", file)
    assert "environment applies to the foot" in result.out
    assert f"wrote {file}" in result.out
    header, rows = table(file)
    assert ",".join(header).isascii()
    assert header[:2] == ["t [s]", "q_alpha [rad]"]
    leg = leg_dynamics.load("omnileg")
    motion = omnileg_eq52(0.1, 100.0).with_foot_force((0.0, -20.0, 20.0), 0.0, 0.05)
    column = {name: k for k, name in enumerate(header)}
    efforts = rows[:, [column[f"tau_{name} [N*m]"] for name in ("M2", "M1", "M3")]]
    np.testing.assert_array_equal(efforts, leg.torque(motion.q, motion.v, motion.a, foot_force=motion.foot_force))
    np.testing.assert_array_equal(rows[:, [column[f"foot_{axis} [m]"] for axis in "xyz"]], leg.foot_position(motion.q))
    np.testing.assert_array_equal(rows[:, [column[f"foot_force_{axis} [N]"] for axis in "xyz"]], motion.foot_force)
    # The audit's golden value at t = 0 (shipped masses).
    np.testing.assert_allclose(efforts[0], [-3.0, -0.000002, 0.0], atol=1e-5)


def test_torque_json():
    result = as_json("torque", "omnileg", *SHORT, "--foot-force", "0,-20,20")
    assert result["samples"] == 11
    assert "environment applies" in result["foot_force"]
    peak = result["actuators"][0]
    assert (peak["name"], peak["unit"], peak["time_of_peak"]) == ("M2", "N·m", 0.0)
    assert peak["peak"] == pytest.approx(-3.0, abs=1e-5)
    assert as_json("torque", "omnileg", *SHORT)["foot_force"] is None


def test_set_changes_the_torque():
    force = ("--foot-force", "0,-20,0")
    short, long = (
        as_json("torque", "omnileg", *SHORT, *force, *more)["actuators"][0]["peak"]
        for more in ((), ("--set", "L1=0.3"))
    )
    # J^T F at the straight pose: the lever of alpha is L1.
    assert (short, long) == (pytest.approx(-3.0, abs=1e-3), pytest.approx(-6.0, abs=1e-3))


def test_torque_compares_two_routes(tmp_path):
    plot = tmp_path / "torque.svg"
    result = as_json("torque", "omnileg", *SHORT, "--compare", "pinocchio", "--plot", plot)
    comparison = result["comparison"]
    assert comparison["routes"] == ["closed_form", "pinocchio"]
    assert comparison["passed"]
    assert 0.0 <= comparison["largest_difference"] < 1e-9
    assert result["files"] == {"plot": str(plot)}
    assert "<svg" in plot.read_text(encoding="utf-8")


def test_torque_fails_where_routes_disagree(monkeypatch):
    monkeypatch.setattr("leg_dynamics.cli.motion.AGREEMENT", -1.0)
    result = run("torque", "omnileg", *SHORT, "--compare", "pinocchio")
    assert result.code == 1
    assert "DISAGREE" in result.out
    assert "the routes closed_form and pinocchio disagree" in result.err


def test_a_route_is_not_compared_with_itself():
    for arguments in (("--compare", "closed_form"), ("--route", "pinocchio", "--compare", "pinocchio")):
        result = run("torque", "omnileg", *SHORT, *arguments)
        assert (result.code, result.out) == (2, "")
        assert "is the route itself" in " ".join(result.err.replace("│", " ").split())
    assert run("torque", "omnileg", *SHORT, "--route", "pinocchio", "--compare", "closed_form").code == 0


def test_forces_out_of_range(tmp_path):
    for command in ("torque", "preview"):
        result = run(
            command, "omnileg", "--foot-force=0,-1e308,0", "--html" if command == "preview" else "--plot", "x.png"
        )
        assert (result.code, result.out) == (2, "")
        assert "out of range" in result.err
    largest = as_json("torque", "omnileg", *SHORT, "--foot-force=1e30,1e30,1e30", "--plot", tmp_path / "torque.png")
    assert all(0.0 < actuator["rms"] <= abs(actuator["peak"]) for actuator in largest["actuators"][:2])
    page = tmp_path / "page.html"
    assert run("preview", "omnileg", "--duration", "0.1", "--foot-force=0,-1e30,0", "--html", page).code == 0


@pytest.mark.parametrize("value", [1e150, 1.1e150, -1.1e150, np.inf, np.nan])
def test_torques_out_of_range(monkeypatch, value):
    leg = leg_dynamics.load("omnileg")
    motion = omnileg_eq52(0.1, 100.0)

    def torque(self, q, v, a, foot_force=None):
        efforts = np.zeros_like(q)
        efforts[3, 1] = value
        return efforts

    monkeypatch.setattr(type(leg), "torque", torque)
    if value == 1e150:
        peak = summarize(leg, motion, torque_along(leg, motion))["actuators"][1]
        assert (peak["peak"], peak["time_of_peak"], np.isfinite(peak["rms"])) == (1e150, 0.03, True)
    else:
        with pytest.raises(NonFiniteError, match=r"torque overflows: M1 is .* at t = 0\.03 s") as caught:
            torque_along(leg, motion)
        assert caught.value.rows.tolist() == [3]


def test_the_support_force_acts_in_stance_only(tmp_path, monkeypatch):
    from leg_dynamics.analysis.trajectories import omnileg_eq53_cycle

    file = tmp_path / "torque.csv"
    gait = ("--trajectory", "eq53", "--duration", "4", "--support-force", "0,0,-44")
    assert run("torque", "omnileg", *gait, "--rate", "20", "--output", file).code == 0
    header, rows = table(file)
    time, force = rows[:, 0], rows[:, header.index("foot_force_x [N]") :]
    np.testing.assert_array_equal(force, omnileg_eq53_cycle().support_force(time, (0.0, 0.0, -44.0)))
    swing = (time % 2.0 > 0.01) & (time % 2.0 < 0.99)
    assert not force[swing].any()
    assert (force[~swing] == [0.0, 0.0, -44.0]).all()
    leg = leg_dynamics.load("omnileg")
    q, v, a, efforts = (rows[:, k : k + 3] for k in (1, 4, 7, 10))
    np.testing.assert_array_equal(efforts, leg.torque(q, v, a, foot_force=force))

    seen = {}
    monkeypatch.setattr("leg_dynamics.preview.write_html", lambda *_, **options: seen.update(options))
    assert run("preview", "omnileg", *gait, "--html", tmp_path / "page.html").code == 0
    stance = omnileg_eq53_cycle().in_stance(np.arange(241) / 60.0)
    assert seen["foot_force"].any(axis=1).tolist() == stance.tolist()


def test_transmission_models():
    arguments = ("torque", "omnileg", "--trajectory", "eq53", "--rate", "20")
    exact, paper, none = (as_json(*arguments, "--transmission", model) for model in ("exact", "paper", "none"))
    assert as_json(*arguments) == exact
    assert [result["transmission"] for result in (exact, paper, none)] == ["exact", "paper", "none"]
    rms = [result["actuators"][0]["rms"] for result in (exact, paper, none)]
    assert len(set(rms)) == 3
    assert rms == pytest.approx([rms[0]] * 3, rel=0.01)
    assert "route closed_form, transmission paper" in run(*arguments, "--transmission", "paper").out
    assert "transmission" not in run(*arguments).out


def test_crosscheck_and_preview_take_the_transmission_model(monkeypatch, tmp_path):
    report = as_json("crosscheck", "omnileg", "--samples", "5", "--transmission", "none")
    assert report["passed"]
    seen = []
    monkeypatch.setattr("leg_dynamics.preview.write_html", lambda *_, **options: seen.append(options["efforts"]["M2"]))
    for model in ("exact", "none"):
        page = ("--html", tmp_path / "page.html", "--transmission", model)
        assert run("preview", "omnileg", "--duration", "1", *page).code == 0
    assert 0.0 < np.abs(seen[0] - seen[1]).max() < 0.01 * np.abs(seen[0]).max()


def test_the_torque_table_is_a_trajectory(tmp_path):
    first, second = tmp_path / "first.csv", tmp_path / "second.csv"
    arguments = ("torque", "omnileg", "--duration", "1", "--rate", "100", "--foot-force", "0,-20,20")
    assert run(*arguments, "--output", first).code == 0
    assert not any(cell == "-0" for line in first.read_text(encoding="utf-8").splitlines() for cell in line.split(","))
    result = run("torque", "omnileg", "--trajectory", first, "--output", second)
    assert result.code == 0
    assert result.err.startswith(f"leg-dynamics: warning: {first}:1: only times and coordinates are read, not v_alpha")
    assert result.err.count("\n") == 1
    (header, rows), (again, more) = table(first), table(second)
    assert [name for name in header if name not in again] == [f"foot_force_{axis} [N]" for axis in "xyz"]
    np.testing.assert_array_equal(more[:, :4], rows[:, :4])
    np.testing.assert_allclose(more[:, 4:7], rows[:, 4:7], atol=1e-6)


def test_torque_plot_is_a_picture(tmp_path):
    from PIL import Image

    assert run("torque", "omnileg", *SHORT, "--plot", tmp_path / "torque.png").code == 0
    with Image.open(tmp_path / "torque.png") as image:
        assert min(image.size) > 700
        assert len(image.convert("RGB").getcolors(1 << 20)) > 50


def test_torque_along_files(tmp_path):
    motion = omnileg_eq52(1.0, 50.0)
    leg = leg_dynamics.load("omnileg")
    start = 10  # away from the straight leg, where a path of the foot has no smooth gamma
    for name, header, columns in (
        ("joints.csv", "t,alpha,beta,gamma", motion.q),
        ("foot.csv", "t,x,y,z", leg.foot_position(motion.q)),
    ):
        file = tmp_path / name
        np.savetxt(file, np.c_[motion.time, columns][start:], delimiter=",", header=header, comments="", fmt="%.17g")
        result = run("torque", "omnileg", "--trajectory", file, "--output", tmp_path / "out.csv")
        assert result.code == 0, result.err
        rows = table(tmp_path / "out.csv")[1]
        np.testing.assert_allclose(rows[:, 1:4], motion.q[start:], atol=1e-9)
        expected = leg.torque(motion.q, motion.v, motion.a)[start:]
        np.testing.assert_allclose(rows[:, 10:13], expected, atol=2e-4)


def test_limits_are_kept_unless_told_otherwise():
    arguments = ("torque", "omnileg", "--duration", "3.5", "--rate", "20")
    assert "gamma = " in refused(*arguments)
    assert run(*arguments, "--ignore-limits").code == 0


def test_bad_csv_is_one_line(tmp_path):
    file = tmp_path / "bad [red].csv"
    file.write_text("t,alpha,beta,gamma\n0,0,0,zero\n", encoding="utf-8")
    assert f"{file}:2: gamma: 'zero' is not a number" in refused("torque", "omnileg", "--trajectory", file)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("torque", "no_such_leg"), "no_such_leg"),
        (("torque", "no_such_file.urdf"), "no_such_file.urdf"),
        (("torque", "omnileg", "--trajectory", "no_such"), "named ones of 'omnileg': eq52"),
        (("torque", "omnileg", "--trajectory", "no_such.csv"), "cannot be read"),
        (("torque", "omnileg", "--route", "no_such"), "no_such"),
        (("torque", "omnileg", "--set", "L17=1"), "L17"),
        (("torque", "omnileg", "--duration", "-1"), "duration"),
        (("torque", "omnileg", "--rate", "nan"), "rate"),
        (("torque", "omnileg", *SHORT, "--foot-force", "0,0,1", "--force-window", "5,6"), "window"),
        (("torque", "omnileg", "--output", "no_such_folder/torque.csv"), "folder no_such_folder"),
        (("torque", "omnileg", "--plot", "no_such_folder/torque.png"), "folder no_such_folder"),
        (("render", "omnileg", "--output", "no_such_folder/leg.urdf"), "folder no_such_folder"),
        (("preview", "omnileg", "--html", "no_such_folder/page.html"), "folder no_such_folder"),
        (("info", "omnileg", "--urdf", "no_such.urdf"), "no_such.urdf"),
        (("crosscheck", "no_such_leg"), "no_such_leg"),
        (("torque", "omnileg", "--trajectory", ""), "neither a trajectory nor a file ''"),
        (("torque", "omnileg", "--set", "PL_1_ratio=1e300"), "'beta_transmission' felt at its joint"),
        (("torque", "omnileg", "--set", "M2_gear_ratio=1e200"), "with M2_gear_ratio = 1e+200"),
        (("torque", "omnileg", "--set", "PL_1_ratio=0"), "with PL_1_ratio = 0"),
        (("torque", "omnileg", "--transmission", "cardan"), "choose one of exact, paper, none"),
        (("torque", "omnileg", "--transmission", "none", "--route", "pinocchio"), "a model of the closed form only"),
        (("torque", "omnileg", *SHORT, "--transmission", "none", "--compare", "pinocchio"), "closed form only"),
        (("torque", "omnileg", "--support-force", "0,0,-44"), "'eq52' is no gait with a stance"),
        (("torque", "omnileg", "--trajectory", "eq51", "--support-force", "0,0,-44"), "(gaits of 'omnileg': eq53)"),
    ],
)
def test_bad_input_is_one_line(arguments, text):
    assert text in refused(*arguments)


@pytest.mark.parametrize(
    "arguments",
    [
        ("--foot-force", "1,2"),
        ("--foot-force", "1,2,nan"),
        ("--foot-force", "1,2,x"),
        ("--force-window", "0,1"),
        ("--foot-force", "1,2,3", "--force-window", "0"),
        ("--support-force", "1,2"),
        ("--support-force", "1,2,1e31"),
        ("--support-force", "1,2,3", "--foot-force", "1,2,3"),
        ("--support-force", "1,2,3", "--force-window", "0,1"),
        ("--output", ""),
        ("--plot", ""),
        ("--urdf", ""),
        ("--set", "L1"),
        ("--set", "L1=long"),
        ("--set", "=1"),
        ("--set", "L1=1", "--set", "L1=2"),
        ("--plot", "torque.docx"),
    ],
)
def test_bad_options(arguments):
    result = run("torque", "omnileg", *arguments)
    assert (result.code, result.out) == (2, "")
    assert "Invalid value" in result.err


def test_duration_and_rate_do_not_go_with_a_file(tmp_path):
    file = tmp_path / "motion.csv"
    file.write_text("t,q1,q2,q3\n", encoding="utf-8")
    assert run("torque", "omnileg", "--trajectory", file, "--rate", "5").code == 2


# Output files.


def test_a_failed_write_leaves_nothing_behind(tmp_path):
    target = tmp_path / "result.txt"
    target.write_text("old", encoding="utf-8")

    def fail(path):
        path.write_text("half", encoding="utf-8")
        raise OSError(28, "No space left on device")

    with pytest.raises(OutputError, match=r"result\.txt cannot be written: No space left on device"):
        write_atomically(target, fail)
    assert [path.name for path in tmp_path.iterdir()] == ["result.txt"]
    assert target.read_text(encoding="utf-8") == "old"


def test_a_written_file_is_whole_and_readable_like_any_other(tmp_path):
    (tmp_path / "other").touch()
    write_atomically(tmp_path / "result.txt", lambda path: path.write_text("new", encoding="utf-8"))
    assert (tmp_path / "result.txt").read_text(encoding="utf-8") == "new"
    assert (tmp_path / "result.txt").stat().st_mode == (tmp_path / "other").stat().st_mode


def test_a_folder_is_no_output_file(tmp_path):
    assert "is a folder" in refused("render", "omnileg", "--output", tmp_path)
    (tmp_path / "link").symlink_to(tmp_path)
    assert f"(a link to {tmp_path}) is a folder" in refused("render", "omnileg", "--output", tmp_path / "link")


def write(path):
    write_atomically(path, lambda temporary: temporary.write_text("new", encoding="utf-8"))


def test_a_link_stays_and_its_target_is_written(tmp_path):
    (tmp_path / "there").mkdir()
    target, link, second = tmp_path / "there" / "target.txt", tmp_path / "link.txt", tmp_path / "second.txt"
    link.symlink_to(Path("there", "target.txt"))
    second.symlink_to(link)
    for _ in ("dangling", "existing"):
        write(second)
        assert target.read_text(encoding="utf-8") == "new"
        assert link.is_symlink()
        assert second.is_symlink()
        target.write_text("old", encoding="utf-8")
    assert [path.name for path in target.parent.iterdir()] == ["target.txt"]


def test_links_to_nowhere_are_refused(tmp_path):
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    with pytest.raises(OutputError, match="loop of symbolic links"):
        write(tmp_path / "loop")
    (tmp_path / "link").symlink_to(tmp_path / "absent" / "file")
    with pytest.raises(OutputError, match=r"the folder .*absent of file does not exist"):
        write(tmp_path / "link")


@needs_posix
@pytest.mark.parametrize("linked", [False, True])
def test_only_regular_files_are_replaced(tmp_path, monkeypatch, linked):
    monkeypatch.chdir(tmp_path)  # the path of a socket must be short
    os.mkfifo("pipe")
    with socket.socket(socket.AF_UNIX) as server:
        server.bind("socket")
        for name, kind in (("pipe", "a named pipe"), ("socket", "a socket")):
            path, mode = Path(name), os.lstat(name).st_mode
            if linked:
                path = Path(f"link_to_{name}")
                path.symlink_to(name)
            with pytest.raises(OutputError, match=f"{path}.* is {kind}; name a file"):
                write(path)
            assert os.lstat(name).st_mode == mode


def load_nothing(monkeypatch):
    for room in ("papers", "preview", "torque"):
        monkeypatch.setattr(f"leg_dynamics.cli.{room}.load_leg", None)


def test_every_output_option_is_checked_before_the_computation(tmp_path, monkeypatch):
    load_nothing(monkeypatch)
    file = tmp_path / "kept.png"
    file.write_text("old", encoding="utf-8")
    file.chmod(0o444)
    for arguments in (
        ("torque", "omnileg", "--output"),
        ("torque", "omnileg", "--plot"),
        ("preview", "omnileg", "--html"),
    ):
        assert "write-protected (mode 444)" in refused(*arguments, file)
    assert file.read_text(encoding="utf-8") == "old"


def test_write_protection_of_others_counts_too(tmp_path, monkeypatch):
    file = tmp_path / "file.txt"
    file.write_text("old", encoding="utf-8")
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    with pytest.raises(OutputError, match="write-protected"):
        write(file)
    monkeypatch.undo()
    file.chmod(0o600)
    write(file)
    assert file.read_text(encoding="utf-8") == "new"
    assert file.stat().st_mode & 0o777 == 0o600


def test_an_empty_output_is_not_the_current_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for arguments in (
        ("reproduce", "omnileg", "--output"),
        ("demo", "--output"),
        ("render", "omnileg", "--output"),
        ("preview", "omnileg", "--html"),
    ):
        result = run(*arguments, "")
        assert (result.code, result.out) == (2, "")
        assert "the path is empty" in result.err
    assert not list(tmp_path.iterdir())


def test_what_stands_where_a_folder_is_needed_is_named(tmp_path, monkeypatch):
    load_nothing(monkeypatch)
    monkeypatch.setattr("leg_dynamics.papers.find", None)
    folder, plots = tmp_path / "out", tmp_path / "out" / "plots"
    folder.mkdir()
    plots.touch()
    assert f"{plots} is a file, but a folder is needed there" in refused("reproduce", "omnileg", "--output", folder)
    plots.unlink()
    plots.symlink_to("nowhere")
    assert f"{plots} is a link to nowhere, which is no folder" in refused("reproduce", "omnileg", "--output", folder)
    assert f"{plots} is a link to nowhere" in refused("demo", "--output", plots)
    assert f"{plots} is a link to nowhere" in refused("torque", "omnileg", "--output", plots / "deeper" / "torque.csv")
    plots.unlink()
    (folder / "index.html").mkdir()
    assert "index.html is a folder, but a file is written" in refused("reproduce", "omnileg", "--output", folder)
    assert sorted(path.name for path in folder.iterdir()) == ["index.html"]


def test_no_file_of_a_reproduction_is_written_where_one_cannot_be(tmp_path, monkeypatch):
    class Paper:
        plots = (SimpleNamespace(name="fig9"),)

        def reproduce(self, progress):
            return self

        def write(self, folder, progress):
            raise AssertionError("written")

    monkeypatch.setattr("leg_dynamics.papers.find", lambda name: Paper())
    (tmp_path / "plots" / "fig9.png").mkdir(parents=True)
    assert "fig9.png is a folder, but a file is written there" in refused("reproduce", "omnileg", "--output", tmp_path)


def test_an_impossible_file_name_is_one_line(tmp_path):
    assert "name too long" in refused("render", "omnileg", "--output", tmp_path / ("a" * 300))
    assert "name too long" in refused("torque", "omnileg", "--trajectory", "a" * 300)


# crosscheck, preview, demo.


class Report:
    def __init__(self, passed):
        self.passed = passed

    def to_dict(self):
        return {"passed": self.passed, "worst": np.float64(np.nan), "at": np.array([1.0, np.inf])}

    def __rich__(self):
        return "[green]a table[/green]"


@pytest.mark.parametrize(("passed", "code"), [(True, 0), (False, 1)])
def test_crosscheck_exit_code_and_json(monkeypatch, passed, code):
    calls = []

    def crosscheck(leg, samples, seed, progress, **options):
        progress("torque", 0.5)
        calls.append((leg, samples, seed, options["parameters"]))
        return Report(passed)

    monkeypatch.setattr(CROSSCHECK, "crosscheck", crosscheck)
    result = run("crosscheck", "omnileg", "--samples", "7", "--seed", "3", "--set", "L1=0.2", "--json")
    assert result.code == code
    assert json.loads(result.out) == {"passed": passed, "worst": None, "at": [1.0, None]}
    assert calls == [("omnileg", 7, 3, {"L1": 0.2})]
    assert run("crosscheck", "omnileg") == Result(code, "a table\n", "")


@pytest.mark.parametrize("arguments", [("--samples", "0"), ("--seed", "-1")])
def test_crosscheck_ranges(arguments):
    assert run("crosscheck", "omnileg", *arguments).code == 2


@pytest.mark.slow
def test_crosscheck_of_the_real_leg():
    report = as_json("crosscheck", "omnileg", "--samples", "20")
    assert report["passed"]
    assert all(check["passed"] for check in report["checks"])


def test_preview_page(tmp_path):
    page = tmp_path / "preview.html"
    result = run("preview", "omnileg", "--html", page, *SHORT)
    assert (result.code, result.out) == (0, f"wrote {page}\n")
    assert "omnileg, eq52" in page.read_text(encoding="utf-8")


def test_preview_gets_the_foot_in_the_root_frame(monkeypatch, tmp_path):
    seen = {}

    def write_html(description, times, joint_values, path, *, foot_trace, title, efforts):
        seen.update(times=times, values=joint_values, trace=foot_trace)
        path.write_text("page", encoding="utf-8")

    monkeypatch.setattr("leg_dynamics.preview.write_html", write_html)
    assert run("preview", "omnileg", "--html", tmp_path / "page.html", "--duration", "1").code == 0
    assert len(seen["times"]) == 61
    motion = omnileg_eq52(1.0, 60.0)
    np.testing.assert_allclose(seen["values"]["phi_D2"], -2.0 * motion.q[:, 2], atol=1e-9)
    # The root is z-up, the hip frame z-down (turned about x): y and z change sign.
    foot = leg_dynamics.load("omnileg").foot_position(motion.q) * [1.0, -1.0, -1.0]
    np.testing.assert_allclose(seen["trace"] - seen["trace"][0], foot - foot[0], atol=1e-9)


@pytest.mark.parametrize(("more", "opened"), [((), True), (("--no-browser",), False)])
def test_live_preview(monkeypatch, more, opened):
    seen = {}

    class View:
        url = "http://127.0.0.1:7000/static/"

        def wait(self):
            seen["waited"] = True

    def show_live(description, times, joint_values, *, foot_trace, open_browser, loop, efforts):
        seen["opened"] = open_browser
        return View()

    monkeypatch.setattr("leg_dynamics.preview.show_live", show_live)
    result = run("preview", "omnileg", *SHORT, *more)
    assert result.code == 0
    assert result.out.startswith(View.url)
    assert seen == {"opened": opened, "waited": True}


def test_preview_shows_the_force_in_the_root_frame_and_the_torques(monkeypatch, tmp_path):
    seen = {}
    monkeypatch.setattr("leg_dynamics.preview.write_html", lambda *_, **options: seen.update(options))
    force = ("--foot-force", "1,-20,20", "--force-window", "0,0.5")
    assert run("preview", "omnileg", "--html", tmp_path / "page.html", "--duration", "1", *force).code == 0
    motion = omnileg_eq52(1.0, 60.0).with_foot_force((1.0, -20.0, 20.0), 0.0, 0.5)
    np.testing.assert_allclose(seen["foot_force"], motion.foot_force * [1.0, -1.0, -1.0], atol=1e-12)
    assert seen["foot_force"].any(axis=1).tolist() == (motion.time <= 0.5).tolist()
    leg = leg_dynamics.load("omnileg")
    torque = leg.torque(motion.q, motion.v, motion.a, foot_force=motion.foot_force)
    assert tuple(seen["efforts"]) == leg.actuator_names
    np.testing.assert_allclose(np.stack(list(seen["efforts"].values()), axis=-1), torque, atol=1e-12)


def test_preview_refuses_a_force_without_sense(tmp_path):
    result = run("preview", "omnileg", "--html", tmp_path / "page.html", "--force-window", "0,1")
    assert (result.code, "--foot-force" in result.err) == (2, True)
    file = tmp_path / "pendulum.urdf"
    file.write_text(PENDULUM, encoding="utf-8")
    result = run("preview", file, "--html", tmp_path / "page.html", "--foot-force", "0,0,1")
    assert (result.code, "no foot" in result.err) == (2, True)
    assert not (tmp_path / "page.html").exists()


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("--rate", "0.1"), "1 sample shows nothing of how 'eq52' moves in 2 s"),
        (("--rate", "2"), "5 samples show nothing.* a --rate of 2.5 a second"),
        (("--trajectory", "eq53", "--duration", "0.001"), "1 sample shows .* in 0.001 s.* longer --duration"),
    ],
)
def test_a_preview_of_too_few_samples_is_refused(tmp_path, arguments, text):
    page = tmp_path / "page.html"
    assert re.search(text, refused("preview", "omnileg", "--html", page, *arguments))
    assert not page.exists()
    assert run("preview", "omnileg", "--html", page, "--rate", "2.5").code == 0


def test_preview_of_a_leg_without_trajectories_is_a_still(monkeypatch, tmp_path):
    file = tmp_path / "pendulum.urdf"
    file.write_text(PENDULUM, encoding="utf-8")
    seen = {}

    def write_html(description, times, joint_values, path, *, foot_trace, title):
        seen.update(times=times.tolist(), nod=joint_values["nod"].tolist(), trace=foot_trace)

    monkeypatch.setattr("leg_dynamics.preview.write_html", write_html)
    assert run("preview", file, "--html", tmp_path / "page.html").code == 0
    assert seen == {"times": [0.0], "nod": [0.5], "trace": None}


@pytest.fixture
def quick_demo(monkeypatch):
    """The demo at a tenth of its rate and with a stand-in for the long cross-check."""
    full = omnileg_eq52
    monkeypatch.setattr(
        "leg_dynamics.analysis.trajectories.omnileg_eq52", lambda duration, rate: full(duration, min(rate, 20.0))
    )
    passed = [True]
    monkeypatch.setattr(CROSSCHECK, "crosscheck", lambda *_, **__: Report(passed[0]))
    return passed


def test_demo_writes_its_three_files(quick_demo, tmp_path):
    folder = tmp_path / "new" / "demo"
    result = run("demo", "--output", folder)
    assert result.code == 0, result.err
    for name in ("torque.csv", "torque.png", "preview.html"):
        assert (folder / name).stat().st_size > 5_000
        assert f"wrote {folder / name}\n" in result.out
    for part in ("a table", "agree", "environment applies to the foot", "closed_form and pinocchio"):
        assert part in result.out
    header, rows = table(folder / "torque.csv")
    # The audit's golden torques with the shipped masses, at t = 1 s (still loaded) and 1.5 s.
    efforts = rows[:, header.index("tau_M2 [N*m]") :][:, :3]
    np.testing.assert_allclose(efforts[20], [-0.781006, 2.275804, 1.634104], atol=1e-5)
    np.testing.assert_allclose(efforts[30], [0.823331, 0.823327, 0.264922], atol=1e-5)


def test_demo_fails_with_the_crosscheck_but_still_writes(quick_demo, tmp_path):
    quick_demo[0] = False
    assert run("demo", "--output", tmp_path).code == 1
    assert (tmp_path / "preview.html").exists()


def test_demo_folder_cannot_be_a_file(tmp_path):
    (tmp_path / "demo").touch()
    assert f"{tmp_path / 'demo'} is a file, but a folder is needed there" in refused(
        "demo", "--output", tmp_path / "demo"
    )


def test_progress_is_shown_on_a_terminal_only(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    monkeypatch.setattr(sys, "stderr", Terminal())
    monkeypatch.setenv("TERM", "xterm")
    assert [rows.start for rows in chunks(600, "torque rows")] == [0, 256, 512]
    assert "torque rows" in sys.stderr.getvalue()
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    assert len(list(chunks(600, "torque rows"))) == 3
    assert sys.stderr.getvalue() == ""


def test_the_package_is_the_command():
    result = subprocess.run([sys.executable, "-m", "leg_dynamics", "list"], capture_output=True, text=True, check=True)
    assert "omnileg" in result.stdout


def test_limits_along_a_file_name_the_module(tmp_path):
    file = tmp_path / "motion.csv"
    rows = "\n".join(f"{t},0,-0.5,{-0.5 - 0.1 * t}" for t in range(12))
    file.write_text(f"time [s],theta1 [rad],theta2 [rad],theta3 [rad]\n{rows}\n")
    refused = run("torque", "quadruped_leg", "--trajectory", file)
    assert refused.code == 2
    assert "theta3 is a joint of module 'm01'" in refused.err
    assert refused.err.count("module") == 1
