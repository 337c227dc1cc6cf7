"""The command `preview`."""

from __future__ import annotations

import math
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from leg_dynamics.cli.files import check_writable, write_atomically
from leg_dynamics.cli.loading import FULL_RATE, FootLoad, choose_trajectory, is_named, load_leg
from leg_dynamics.cli.motion import efforts_along, followed, poses_along
from leg_dynamics.cli.options import (
    DurationOption,
    FootForceOption,
    FootOption,
    LegName,
    LimitsOption,
    RateOption,
    RouteOption,
    SetOption,
    SupportOption,
    TrajectoryOption,
    TransmissionOption,
    UrdfOption,
    WindowOption,
    read_path,
)
from leg_dynamics.cli.output import complain, say_written, steps
from leg_dynamics.errors import ActuationError, MissingFootError, TrajectoryError

if TYPE_CHECKING:
    from leg_dynamics.analysis.trajectories import Trajectory
    from leg_dynamics.leg import Leg
    from leg_dynamics.preview import Cloud

PREVIEW_RATE = 60.0
"""Samples a second of a named trajectory that is shown."""
MIN_PREVIEW_SAMPLES = 6
"""Of a moving preview: as many as a file of samples must have."""


def preview_leg(
    leg: LegName,
    trajectory: TrajectoryOption = None,
    route: RouteOption = None,
    foot_force: FootForceOption = None,
    force_window: WindowOption = None,
    support_force: SupportOption = None,
    transmission: TransmissionOption = "exact",
    duration: DurationOption = None,
    rate: RateOption = None,
    ignore_limits: LimitsOption = False,
    set_: SetOption = None,
    foot: FootOption = None,
    urdf: UrdfOption = None,
    html: Annotated[
        Path | None,
        typer.Option(
            "--html", parser=read_path, metavar="F.html", help="Write one self-contained page, not a live view."
        ),
    ] = None,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Live view: do not open a browser.")] = False,
    workspace: Annotated[
        bool, typer.Option("--workspace", help="Show the foot's workspace as points, coloured by condition number.")
    ] = False,
) -> None:
    """Show the moving leg in 3-D: live on this machine, or as one HTML file that plays offline.

    Along a trajectory the motors are coloured by their torque; a force on the foot is an arrow.
    """
    from leg_dynamics.preview import show_live, write_html

    check_writable(html)
    load = FootLoad.read(foot_force, force_window, support_force)
    model = load_leg(leg, route, set_, foot, urdf, transmission)
    motion = _preview_motion(model, trajectory, duration, rate, ignore_limits)
    motion = load.on(motion, model, trajectory)
    # A still may show a singular pose.
    with followed(model, motion) if len(motion) > 1 else nullcontext():
        loads = _preview_loads(model, motion)
        values, trace = poses_along(model, motion)
    if workspace:
        loads["cloud"] = _workspace_cloud(model)
    if html is not None:
        title = f"{model.description.name}, {motion.name}"
        write_atomically(
            html,
            lambda path: write_html(
                model.description, motion.time, values, path, foot_trace=trace, title=title, **loads
            ),
        )
        say_written(html)
        return
    view = show_live(
        model.description, motion.time, values, foot_trace=trace, open_browser=not no_browser, loop=True, **loads
    )
    print(f"{view.url}  (Ctrl-C ends the view)", flush=True)
    view.wait()


def _preview_motion(
    leg: Leg, choice: str | None, duration: float | None, rate: float | None, ignore_limits: bool
) -> Trajectory:
    import numpy as np

    from leg_dynamics.analysis.trajectories import Trajectory, named

    if choice is None and not named(leg.description.name):
        home = leg.description.home
        pose = np.array([[0.0 if home is None else home.values.get(name, 0.0) for name in leg.joint_names]])
        return Trajectory([0.0], pose, 0.0 * pose, 0.0 * pose, name="home pose")  # type: ignore[arg-type]
    motion = choose_trajectory(
        leg, choice, duration, PREVIEW_RATE if rate is None and is_named(leg, choice) else rate, ignore_limits
    )
    if len(motion) < MIN_PREVIEW_SAMPLES and is_named(leg, choice):
        length = choose_trajectory(leg, choice, duration, FULL_RATE, ignore_limits).duration
        raise TrajectoryError(
            f"{len(motion)} {'samples show' if len(motion) > 1 else 'sample shows'} nothing of how {motion.name!r} "
            f"moves in {length:g} s: a preview needs at least {MIN_PREVIEW_SAMPLES}, so a --rate of "
            f"{(MIN_PREVIEW_SAMPLES - 1) / length if length else math.inf:.3g} a second or more, or a longer --duration"
        )
    return motion


def _preview_loads(leg: Leg, motion: Trajectory) -> dict[str, Any]:
    """What a preview draws of the forces: that on the foot in the root frame, and the efforts along a motion."""
    from leg_dynamics.preview import in_root_frame

    loads: dict[str, Any] = {}
    if motion.foot_force is not None:
        # The torque would say so too, but a still has none.
        if leg.foot is None:
            raise MissingFootError(f"{leg.description.name} has no foot for the force to act on; name it with --foot")
        loads["foot_force"] = in_root_frame(leg.description, motion.foot_force)
    if len(motion) > 1:
        try:
            efforts, _ = efforts_along(leg, motion)
        except ActuationError as error:
            complain(f"note: the motors are not coloured by torque: {error}")
        else:
            loads["efforts"] = dict(zip(leg.actuator_names, efforts.T, strict=True))
    return loads


def _workspace_cloud(leg: Leg) -> Cloud:
    """The leg's workspace in the root frame, one point for equal volumes."""
    import numpy as np

    from leg_dynamics.analysis.workspace import workspace
    from leg_dynamics.description import link_transforms
    from leg_dynamics.preview import Cloud

    with steps("workspace") as step:
        result = workspace(leg, tolerance=0.02, progress=step)
    share = result.weights / result.weights.sum()
    rows = np.random.default_rng(0).choice(len(share), 8000, p=share)
    poses = result.poses[np.unique(rows)]
    mechanism = leg.description
    hip = link_transforms(mechanism, {})["hip"] if mechanism.has_link("hip") else np.eye(4)
    return Cloud.of(poses.foot @ hip[:3, :3].T + hip[:3, 3], poses.condition, "points: condition number")
