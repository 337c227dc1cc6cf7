"""The command `leg-dynamics`."""

from leg_dynamics.cli.application import add_command, app, main
from leg_dynamics.cli.bench import OWN_OPTIONS, run_benchmarks
from leg_dynamics.cli.crosscheck import crosscheck_leg
from leg_dynamics.cli.design import design_leg
from leg_dynamics.cli.gait import gait_robot
from leg_dynamics.cli.legs import info_leg, list_legs, render_leg
from leg_dynamics.cli.papers import demo, reproduce_paper
from leg_dynamics.cli.preview import preview_leg
from leg_dynamics.cli.torque import torque_leg
from leg_dynamics.cli.workspace import workspace_leg

__all__ = ["app", "main"]

# In the order of `--help`.
add_command("list", list_legs)
add_command("info", info_leg)
add_command("render", render_leg)
add_command("torque", torque_leg)
add_command("crosscheck", crosscheck_leg)
add_command("preview", preview_leg)
add_command("bench", run_benchmarks, add_help_option=False, context_settings=OWN_OPTIONS)
add_command("design", design_leg)
add_command("workspace", workspace_leg)
add_command("gait", gait_robot)
add_command("demo", demo)
add_command("reproduce", reproduce_paper)
