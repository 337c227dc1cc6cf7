"""From xacro to URDF+ to a validated, immutable description of a mechanism."""

from leg_dynamics.description.frames import link_transforms
from leg_dynamics.description.model import (
    Clearance,
    Cone,
    Configuration,
    Coupling,
    Description,
    Equation,
    Geometry,
    Inertial,
    Joint,
    JointLimits,
    Link,
    Loop,
    LoopEnd,
    Mimic,
    Parameter,
    Pose,
    Segment,
    Telescope,
    Transmission,
    Visual,
)
from leg_dynamics.description.parse import parse
from leg_dynamics.description.reading import read
from leg_dynamics.description.render import render, rendered_name
from leg_dynamics.description.shipped import shipped_names, shipped_urdf, shipped_xacro
from leg_dynamics.description.topology import (
    actuated_joints,
    coupling_equations,
    independent_joints,
    joints_depth_first,
)

__all__ = [
    "Clearance",
    "Cone",
    "Configuration",
    "Coupling",
    "Description",
    "Equation",
    "Geometry",
    "Inertial",
    "Joint",
    "JointLimits",
    "Link",
    "Loop",
    "LoopEnd",
    "Mimic",
    "Parameter",
    "Pose",
    "Segment",
    "Telescope",
    "Transmission",
    "Visual",
    "actuated_joints",
    "coupling_equations",
    "independent_joints",
    "joints_depth_first",
    "link_transforms",
    "parse",
    "read",
    "render",
    "rendered_name",
    "shipped_names",
    "shipped_urdf",
    "shipped_xacro",
]
