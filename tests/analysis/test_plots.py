"""The torque figure: what it shows, and that it leaves matplotlib's global state alone."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from leg_dynamics.analysis.plots import torque_figure
from leg_dynamics.analysis.trajectories import omnileg_eq52
from leg_dynamics.errors import ShapeError

MOTION = omnileg_eq52(2.0, 50.0)
TORQUE = np.stack([MOTION.q[:, 0], -MOTION.q[:, 1], 2.0 * MOTION.q[:, 2]], axis=1)
NAMES = {
    "joint_names": ("alpha", "beta", "gamma"),
    "units": ("rad", "rad", "rad"),
    "actuator_names": ("M2", "M1", "M3"),
    "actuator_units": ("N·m", "N·m", "N·m"),
}


def labels(figure):
    return [axis.get_ylabel() for axis in figure.axes]


def test_panels_lines_and_units():
    figure = torque_figure(MOTION, TORQUE, **NAMES)
    assert labels(figure) == ["position [rad]", "velocity [rad/s]", "torque [N·m]"]
    assert figure.axes[-1].get_xlabel() == "time [s]"
    for axis, values in zip(figure.axes, (MOTION.q, MOTION.v, TORQUE), strict=True):
        assert len(axis.lines) == 3
        for k, line in enumerate(axis.lines):
            np.testing.assert_array_equal(line.get_ydata(), values[:, k])


def test_second_route_adds_markers_and_a_difference_panel():
    figure = torque_figure(MOTION, TORQUE, second_torque=TORQUE + 3e-12, route="one", second_route="two", **NAMES)
    assert labels(figure)[-1] == "|difference| [N·m]"
    assert figure.axes[-1].get_yscale() == "log"
    np.testing.assert_allclose(figure.axes[-1].lines[0].get_ydata(), 3e-12, rtol=1e-3)
    assert "largest difference 3e-12" in figure.axes[-1].get_title(loc="left")
    assert "two" in [text.get_text() for text in figure.axes[2].get_legend().get_texts()]


def test_identical_routes_have_no_logarithm():
    figure = torque_figure(MOTION, TORQUE, second_torque=TORQUE, **NAMES)
    assert figure.axes[-1].get_yscale() == "linear"


def test_force_window_is_shaded_only_where_it_ends():
    def shaded(motion):
        return len(torque_figure(motion, TORQUE, **NAMES).axes[0].patches)

    assert shaded(MOTION) == 0
    assert shaded(MOTION.with_foot_force((0.0, 0.0, 1.0))) == 0
    assert shaded(MOTION.with_foot_force((0.0, 0.0, 1.0), 0.0, 1.0)) == 1
    # A gait's force comes and goes: each stance is a span of its own.
    force = np.zeros((len(MOTION), 3))
    force[:2, 2] = force[4:6, 2] = 1.0
    assert shaded(MOTION.with_foot_force(force)) == 2


def test_mixed_units_are_all_named():
    mixed = NAMES | {"units": ("rad", "m", "rad"), "actuator_units": ("N·m", "N", "N·m")}
    figure = torque_figure(MOTION, TORQUE, **mixed)
    assert labels(figure) == ["position [rad, m]", "velocity [rad/s, m/s]", "effort [N·m, N]"]


@pytest.mark.parametrize(
    ("torque", "second", "text"),
    [(TORQUE[:-1], None, "torque has shape"), (TORQUE, TORQUE[:, :2], "second_torque has shape")],
)
def test_shapes_are_checked(torque, second, text):
    with pytest.raises(ShapeError, match=text):
        torque_figure(MOTION, torque, second_torque=second, **NAMES)


def test_one_sample_can_be_drawn(tmp_path):
    one = omnileg_eq52(0.001, 50.0)
    torque_figure(one, TORQUE[:1], second_torque=TORQUE[:1] + 1e-9, **NAMES).savefig(tmp_path / "one.png")
    assert (tmp_path / "one.png").stat().st_size > 10_000


def test_pyplot_stays_unloaded(tmp_path):
    code = (
        "import sys, numpy as np\n"
        "from leg_dynamics.analysis.plots import torque_figure\n"
        "assert 'matplotlib' not in sys.modules\n"
        "from leg_dynamics.analysis.trajectories import omnileg_eq52\n"
        "m = omnileg_eq52(1.0, 10.0)\n"
        "names = dict(joint_names='abc', units='rrr', actuator_names='abc', actuator_units='NNN')\n"
        "torque_figure(m, m.q, **names).savefig(sys.argv[1])\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code, str(tmp_path / "figure.png")], check=True)
