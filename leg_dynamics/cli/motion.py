"""Poses and efforts along a motion, computed in chunks; their summary, table and plot."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from leg_dynamics.cli.files import write_atomically
from leg_dynamics.cli.output import add_row, chunks, error_console, new_table, output_console, say
from leg_dynamics.errors import NonFiniteError, RowError

if TYPE_CHECKING:
    import numpy as np

    from leg_dynamics.analysis.trajectories import Trajectory
    from leg_dynamics.leg import Leg

AGREEMENT = 1e-9
"""Two routes agree where their difference is at most this times (1 + magnitude)."""
MAX_EFFORT = 1e150
"""N·m or N; the square of a larger torque leaves the range of floating-point numbers."""
FORCE_NOTE = (
    "The foot force is the one that the environment applies to the foot, in the hip frame "
    "(Xu 2025 eq. 49-50 count the opposite one, which the foot exerts)."
)


@contextmanager
def followed(leg: Leg, motion: Trajectory) -> Iterator[None]:
    """Follow a motion in one assembly mode; while inside, the leg's poses at its samples are those."""
    from leg_dynamics.analysis.trajectories import along

    with ExitStack() as stack:
        with error_console().status("following the assembly mode"):
            stack.enter_context(along(leg, motion))
        yield


def torque_along(leg: Leg, motion: Trajectory) -> np.ndarray:
    """Actuator efforts along a motion, (N, m), in one assembly mode."""
    with followed(leg, motion):
        return efforts_along(leg, motion)[0]


def efforts_along(
    leg: Leg, motion: Trajectory, allow_idle: bool = False, bounded: bool = False
) -> tuple[np.ndarray, np.ndarray | None]:
    """Efforts along a `followed` motion, (N, m), and what they leave unbalanced, (N, n), where allowed."""
    import numpy as np

    from leg_dynamics.analysis.trajectories.following import located

    policy: dict[str, Any] = {"bounds": True} if bounded else {}
    parts: list[np.ndarray] = []
    left: list[np.ndarray] = []
    for rows in chunks(len(motion), f"torque, {leg.route}"):
        force = None if motion.foot_force is None else motion.foot_force[rows]
        state: Any = motion.q[rows], motion.v[rows], motion.a[rows], force
        try:
            # An overflow is told below.
            with np.errstate(over="ignore", invalid="ignore"):
                if allow_idle:
                    torque, residual = leg.torque(*state, allow_idle=True, **policy)
                    left.append(residual)
                else:
                    torque = leg.torque(*state, **policy)
        except RowError as error:
            raise located(error, leg, motion, rows.start) from error
        parts.append(torque)
    efforts = np.concatenate(parts)
    # Written so that a NaN fails.
    bad = np.argwhere(~(np.abs(efforts) <= MAX_EFFORT))
    if bad.size:
        row, k = bad[0]
        raise NonFiniteError(
            f"the torque overflows: {leg.actuator_names[k]} is {efforts[row, k]:.3g} {leg.units.actuators[k]} at "
            f"t = {motion.time[row]:g} s, beyond {MAX_EFFORT:g}; slow the motion down, or lower the force and the "
            "parameters",
            rows=np.unique(bad[:, 0]),
        )
    return efforts, np.concatenate(left) if left else None


def poses_along(leg: Leg, motion: Trajectory) -> tuple[dict[str, np.ndarray], np.ndarray | None]:
    """Tree joint coordinates along the motion, and the foot's path in the root frame."""
    import numpy as np

    from leg_dynamics.description import link_transforms

    parts = [leg.assemble(motion.q[rows]) for rows in chunks(len(motion), "poses")]
    values = {joint: np.concatenate([part[joint] for part in parts]) for joint in parts[0]}
    if leg.foot is None:
        return values, None
    return values, link_transforms(leg.description, values)[leg.foot][..., :3, 3]


def summarize(leg: Leg, motion: Trajectory, efforts: np.ndarray, residual: np.ndarray | None = None) -> dict[str, Any]:
    """What `torque` says of the efforts along a motion."""
    import numpy as np

    from leg_dynamics.analysis.trajectories.following import limit_flags

    peaks = np.abs(efforts).argmax(axis=0)
    flags = limit_flags(leg.feasible(motion.q, motion.v, motion.a, torque=efforts), motion.time)
    idle = {}
    if residual is not None:
        idle = {
            name: float(np.abs(residual[:, leg.joint_names.index(name)]).max(initial=0.0))
            for name in leg.actuation.idle
        }
    return {
        "leg": leg.description.name,
        "route": leg.route,
        "transmission": leg.recipe.transmission,
        "trajectory": motion.name,
        "samples": len(motion),
        "start": float(motion.time[0]),
        "end": float(motion.time[-1]),
        "foot_force": None if motion.foot_force is None else FORCE_NOTE,
        "feasible": all(flag["feasible"] for flag in flags),
        "actuation": leg.actuation.to_dict(),
        "unbalanced": idle,
        "actuators": [
            {
                "name": name,
                "unit": unit,
                "peak": float(efforts[peaks[k], k]),
                "time_of_peak": float(motion.time[peaks[k]]),
                "rms": float(np.sqrt(np.mean(efforts[:, k] ** 2))),
                "limits": {key: value for key, value in flags[k].items() if key != "actuator"},
            }
            for k, (name, unit) in enumerate(zip(leg.actuator_names, leg.units.actuators, strict=True))
        ],
    }


def compare_efforts(first: Leg, second: Leg, efforts: np.ndarray, other: np.ndarray) -> dict[str, Any]:
    """The difference between the efforts by two routes, and whether they agree."""
    import numpy as np

    difference = np.abs(efforts - other)
    relative = difference / (1.0 + np.maximum(np.abs(efforts), np.abs(other)))
    return {
        "routes": [first.route, second.route],
        "largest_difference": float(difference.max()),
        "largest_relative_difference": float(relative.max()),
        "tolerance": AGREEMENT,
        # Written so that a NaN fails.
        "passed": bool(relative.max() <= AGREEMENT),
    }


def show_summary(result: Mapping[str, Any]) -> None:
    """Print a summary and, where it has one, its comparison."""
    console = output_console()
    say(
        f"{result['leg']} along {result['trajectory']}, {result['start']:g} to {result['end']:g} s, "
        f"{result['samples']} samples, route {result['route']}"
        + ("" if result["transmission"] == "exact" else f", transmission {result['transmission']}")
    )
    table = new_table("", "actuator", "peak", "at", "rms", "unit", "limits")
    for row in result["actuators"]:
        cells = f"{row['peak']:+.6f}", f"{row['time_of_peak']:.3f} s", f"{row['rms']:.6f}", row["unit"]
        add_row(table, row["name"], *cells, _limit_text(row["limits"]))
    console.print(table)
    for name, value in result["unbalanced"].items():
        say(f"no actuator holds {name}: up to {value:.6g} N·m (or N) are left unbalanced there")
    if result["foot_force"] is not None:
        say(result["foot_force"])
    if "comparison" in result:
        comparison = result["comparison"]
        say(
            f"largest difference between {' and '.join(comparison['routes'])}: "
            f"{comparison['largest_difference']:.3g} (relative to 1 + magnitude: "
            f"{comparison['largest_relative_difference']:.3g}, tolerance {comparison['tolerance']:g}): "
            f"{'agree' if comparison['passed'] else 'DISAGREE'}"
        )


def _limit_text(flags: Mapping[str, Any]) -> str:
    """The nearest of an actuator's limits, or the broken ones with their times."""
    names = {"effort": "effort", "speed": "speed", "curve": "torque-speed line"}
    broken = [
        f"BEYOND {name}{_excess(flags[f'{kind}_margin'])} at {flags[f'{kind}_time']:.3f} s"
        for kind, name in names.items()
        if not flags[f"{kind}_margin"] >= 0.0
    ]
    if broken:
        return ", ".join(broken)
    least = min(names, key=lambda kind: flags[f"{kind}_margin"])
    return f"{flags[f'{least}_margin']:.1%} of {names[least]} left"


def _excess(margin: float) -> str:
    """How far a broken limit is exceeded; of a limit of 0 no share says it."""
    from leg_dynamics.actuation import LEAST_MARGIN

    return ", whose limit is 0," if margin <= LEAST_MARGIN else f" by {-margin:.1%}"


def write_table(path: Path, leg: Leg, motion: Trajectory, efforts: np.ndarray) -> None:
    """Write a motion with its efforts as a CSV file."""
    import numpy as np

    header, columns = ["t [s]"], [motion.time[:, None], motion.q, motion.v, motion.a, efforts]
    for symbol, suffix in (("q", ""), ("v", "/s"), ("a", "/s^2")):
        header += [f"{symbol}_{n} [{u}{suffix}]" for n, u in zip(leg.joint_names, leg.units.joints, strict=True)]
    # ASCII, because spreadsheets guess encodings.
    header += [f"tau_{n} [{u.replace('·', '*')}]" for n, u in zip(leg.actuator_names, leg.units.actuators, strict=True)]
    if leg.foot is not None:
        header += [f"foot_{axis} [m]" for axis in "xyz"]
        columns.append(leg.foot_position(motion.q))
    if motion.foot_force is not None:
        header += [f"foot_force_{axis} [N]" for axis in "xyz"]
        columns.append(motion.foot_force)
    # Adding zero turns -0 into 0.
    rows = np.hstack(columns) + 0.0

    def write(temporary: Path) -> None:
        with temporary.open("w", encoding="utf-8", newline="\n") as file:
            np.savetxt(file, rows, fmt="%.17g", delimiter=",", header=",".join(header), comments="")

    write_atomically(path, write)


def write_plot(
    path: Path, leg: Leg, motion: Trajectory, efforts: np.ndarray, route: str | None, other: np.ndarray | None
) -> None:
    """Draw a motion with its efforts, and those of a second route if there are any."""
    from leg_dynamics.analysis.plots import torque_figure

    figure = torque_figure(
        motion,
        efforts,
        joint_names=leg.joint_names,
        units=leg.units.joints,
        actuator_names=leg.actuator_names,
        actuator_units=leg.units.actuators,
        route=leg.route,
        second_torque=other,
        second_route=route or "",
        title=f"{leg.description.name} along {motion.name}",
    )
    write_atomically(path, lambda temporary: figure.savefig(temporary, format=path.suffix.lower().lstrip(".")))
