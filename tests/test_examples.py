"""The examples run as a user starts them."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

import leg_dynamics as ld

EXAMPLES = Path(__file__).parents[1] / "examples"

# Planted fault, equation, what the report says of it.
PLANTED = {
    "position": ("foot_position (2)", "true if theta2 counted in the opposite direction"),
    "inverse": ("inverse_kinematics (3)", "is not inverse to the own position"),
    "jacobian": ("jacobian (4)", "d foot z / d theta2 is the negative of the reference: a sign error"),
    "jacobian_derivative": ("jacobian_derivative (5)", "d/dt d foot x / d theta1 is the negative of the reference"),
    "mass": ("mass_matrix (7)", "M[theta1, theta2], M[theta2, theta1] are 1.38"),
    "gravity": ("gravity_torque (9)", "theta2 is the negative of the reference: a sign error"),
    "coriolis": ("bias (10)", "theta2: wrong sign of the velocity terms"),
    "foot_force": ("torque (11)", "wrong sign of the foot force's term"),
}


def run(*arguments):
    command = [sys.executable, str(EXAMPLES / "my_leg.py"), "--samples", "20", *arguments]
    environment = os.environ | {"COLUMNS": "200", "PYTHONIOENCODING": "utf-8"}
    return subprocess.run(command, capture_output=True, encoding="utf-8", env=environment)


def faults():
    tree = ast.parse((EXAMPLES / "my_leg.py").read_text(encoding="utf-8"))
    (value,) = [
        node.value
        for node in tree.body
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "FAULTS"
    ]
    return ast.literal_eval(value)


def test_every_fault_is_listed_here():
    assert set(faults()) == set(PLANTED)


def test_the_right_formulas():
    result = run()
    assert (result.returncode, result.stderr) == (0, "")
    assert "DISAGREES" not in result.stdout
    assert result.stdout.count("agrees") == 14


@pytest.mark.parametrize(
    "fault", ["jacobian", *(pytest.param(each, marks=pytest.mark.slow) for each in PLANTED if each != "jacobian")]
)
def test_a_planted_sign_error_is_found(fault):
    equation, said = PLANTED[fault]
    result = run("--plant", fault)
    assert (result.returncode, result.stderr) == (1, "")
    lines = result.stdout.splitlines()
    headings = [line for line in lines if ": " in line and line.split(":")[0] == equation]
    assert len(headings) == 1
    assert said in result.stdout
    assert sum("DISAGREES" in line for line in lines) == 1


def test_the_file_itself_is_sound(recwarn):
    leg = ld.load(EXAMPLES / "my_leg.urdf")
    assert not recwarn.list
    assert (leg.joint_names, leg.actuator_names) == (("theta1", "theta2"), ("thigh_motor", "crank_motor"))


@pytest.mark.slow
def test_the_routes_agree_on_the_file():
    ld.crosscheck(EXAMPLES / "my_leg.urdf", samples=50).raise_if_failed()
