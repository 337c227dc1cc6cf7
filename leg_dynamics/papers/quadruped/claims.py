"""Claims of Chen & Dong 2021 on modules, connections and legs, judged by numbers; its walk is in `stability`."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from leg_dynamics.description import link_transforms, read
from leg_dynamics.papers.comparison import EXACT, claim
from leg_dynamics.papers.figures import COLOURS, drawing, dress, legend_below
from leg_dynamics.papers.framework import Context, Figure, Plot, Section, Status, Verdict
from leg_dynamics.papers.judge import judge, text, worst
from leg_dynamics.papers.quadruped import printed, reported
from leg_dynamics.papers.quadruped.equations import unseen_terms
from leg_dynamics.papers.quadruped.facts import facts_of, foot_poses, hip_in_body, mount_of_iv, robot_file
from leg_dynamics.verification.first_principles import loop_residual

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

    from leg_dynamics.description.model import Description, Visual
    from leg_dynamics.description.modules import Assembly
    from leg_dynamics.leg import Leg

__all__ = ["VERDICTS", "assembly", "body_faces", "foot_screws", "plots", "sections", "six_joint_leg"]

Array = np.ndarray

TURNS = 200
"""Random poses of a module, and of the leg with six joints."""

RANK = 1e-9
"""Singular values below this are zero: lengths are in m, so that those of a generic pose are above 1e-3."""


def assembly(context: Context) -> Assembly:
    """The robot of ten modules as the graph of its bonds."""
    from leg_dynamics.description.modules import read_assembly
    from leg_dynamics.description.shipped import shipped_xacro

    found: Assembly = context.once("quadruped: assembly", lambda: read_assembly(shipped_xacro("quadruped")))
    return found


def _file(context: Context, name: str) -> Description:
    description: Description = context.once(f"quadruped: {name} file", lambda: read(name))
    return description


# ---------------------------------------------------------------------- section 1.1: the module


def _corners(visual: Visual) -> Array:
    """Corners of a shape's box in its link, (8, 3) m."""
    sizes: Mapping[str, Callable[[], tuple[float, ...]]] = {
        "box": lambda: visual.geometry.size,
        "cylinder": lambda: (2.0 * visual.geometry.size[0], 2.0 * visual.geometry.size[0], visual.geometry.size[1]),
        "sphere": lambda: (2.0 * visual.geometry.size[0],) * 3,
    }
    half = 0.5 * np.array(sizes[visual.geometry.kind]())
    signs = np.stack(np.meshgrid(*([-1.0, 1.0],) * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    pose = visual.origin.matrix()
    return np.asarray((signs * half) @ pose[:3, :3].T + pose[:3, 3])


def module_size(context: Context) -> Verdict:
    """Outer size of the file's module."""
    snake = _file(context, "snake")
    links = link_transforms(snake, {})
    frame = np.linalg.inv(links["m02_lower_half"])
    bodies = [link for link in snake.links if link.name.startswith("m02_") and link.visuals]
    points = np.concatenate(
        [
            corners @ (frame @ links[link.name])[:3, :3].T + (frame @ links[link.name])[:3, 3]
            for link in bodies
            for corners in map(_corners, link.visuals)
        ]
    )
    size = points.max(axis=0) - points.min(axis=0)
    faces = [(frame @ links[f"m02_face_{face}"])[:3, 3] for face in "LU"]
    length = float(np.linalg.norm(faces[1] - faces[0]))
    values = context.leg.parameters
    return claim(
        "a module measures 150 mm × 110 mm × 110 mm",
        "Section 1.1: size of a module",
        judge(np.array([length, *size[1:]]) - reported.SIZE, 1e-6),
        f"The file's module does: {1e3 * length:.1f} mm from face to face, {1e3 * size[1]:.1f} × {1e3 * size[2]:.1f} "
        "mm "
        f"across; the pins of its active face stand out by {1e3 * (size[0] - length):.1f} mm, into the next module. "
        f"Where in it the swing axes are is not printed; assumed are "
        f"{1e3 * values['f'].value:.4g} mm to a face and {1e3 * values['s'].value:.4g} mm between them, and from these "
        "follow l₁, l₂, l₃ and a.",
        [
            Figure("face to face", length, "m", "all joints at zero"),
            *(
                Figure(f"extent along {axis}", value, "m", "all shapes of one module")
                for axis, value in zip("xyz", size, strict=True)
            ),
        ],
    )


def module_freedoms(context: Context) -> Verdict:
    """Three joints of a module and their ranges."""
    snake = _file(context, "snake")
    names = [f"m02_{kind}" for kind in ("lower", "middle", "upper")]
    joints = [snake.joint(name) for name in names]
    swing = np.radians(reported.SWING)
    values = context.rng(30).uniform(-1.0, 1.0, (TURNS, 3)) * [swing, np.pi, swing]
    links = link_transforms(snake, dict(zip(names, values.T, strict=True)))
    screws = []
    for joint in joints:
        pose = np.broadcast_to(links[joint.child], (TURNS, 4, 4))
        axis = pose[:, :3, :3] @ np.array(joint.axis)
        screws.append(np.concatenate([np.cross(pose[:, :3, 3], axis), axis], axis=-1))
    sigma = np.linalg.svd(np.stack(screws, axis=1), compute_uv=False)[:, 2]
    limits = [abs(each) - swing for k in (0, 2) for each in (joints[k].limits.lower, joints[k].limits.upper)]
    f, width = context.leg.parameters["f"].value, reported.SIZE[1]
    behind = -(f * np.cos(swing) - 0.5 * width * np.sin(swing))
    turns = joints[1].type == "continuous"
    return claim(
        "two swings of ±70°, a full turn, all independent",
        "Section 1.1: both arms swing by ±70°, the middle turns by 360°, and the three are independent",
        judge([*limits, float((sigma < RANK).sum()), 0.0 if turns else 1.0], EXACT),
        f"The file's module has these ranges, and its three screws stay independent in all of {TURNS} random poses "
        f"(least singular value {text(sigma.min())}). Room is another matter: a face as wide as the module, "
        f"{1e3 * f:.4g} mm from its axis, comes {1e3 * behind:.0f} mm behind the axis at {reported.SWING:.0f}°.",
        [
            Figure("least singular value of the three screws", sigma.min(), "m, 1", f"{TURNS} random poses"),
            Figure("face behind its axis at the limit", behind, "m", "edge of a face 110 mm wide, assumed f"),
        ],
    )


# ---------------------------------------------------------------------- section 1.2: the robot


def ten_modules(context: Context) -> Verdict:
    """2 + 4 · 2."""
    found = assembly(context)
    body = [name for name in found.modules if name in reported.BODY_GENDERS]
    legs = {leg: [name for name in found.modules if name.startswith(f"{leg}_")] for leg in reported.ORDER}
    total = reported.BODY + reported.LEGS * reported.LEG_MODULES
    return claim(
        "ten modules: two in the body, two in each of four legs",
        "Section 1.2: what the robot is built of",
        judge(
            [
                total - reported.MODULES,
                len(found.modules) - reported.MODULES,
                len(body) - reported.BODY,
                *(len(names) - reported.LEG_MODULES for names in legs.values()),
            ],
            0.0,
        ),
        f"{reported.BODY} + {reported.LEGS} × {reported.LEG_MODULES} = {total}; the robot's file has "
        f"{len(found.modules)}, in one tree of {len(found.bonds)} bonds.",
        [
            Figure("modules", len(found.modules), "", "of the robot's file"),
            Figure("bonds", len(found.bonds), "", "of the robot's file"),
        ],
    )


def mixed_bonds(context: Context) -> Verdict:
    """Active on passive."""
    found = assembly(context)
    pairs = [
        {found.modules[face.module].genders[face.face] for face in (bond.first, bond.second)} for bond in found.bonds
    ]
    own = [
        found.modules[name].genders[face] != gender
        for name, genders in reported.BODY_GENDERS.items()
        for face, gender in genders.items()
    ] + [
        found.modules[name].genders[face] != gender
        for name in found.modules
        if name not in reported.BODY_GENDERS
        for face, gender in reported.USUAL_GENDERS.items()
    ]
    odd = sum(pair != {"active", "passive"} for pair in pairs)
    return claim(
        "every bond joins an active and a passive face",
        "Section 1.2: all modules are joined active on passive; module 6 has active faces, module 3 passive ones",
        judge([odd, sum(own)], 0.0),
        f"It can be done: the file's {len(pairs)} bonds are such, with the genders of the text on all faces that the "
        "text gives. It takes a third face and legs that differ, which have verdicts of their own.",
        [Figure("bonds of equal gender", odd, "", f"of {len(pairs)} in the robot's file")],
    )


def body_faces(context: Context) -> tuple[int, int, int]:
    """Faces of the body's modules: those that the file's bonds take, those the paper gives, and pieces without a third.

    The last is how many pieces the robot falls into when bonds of faces that the paper does not have are taken away.
    """
    found = assembly(context)
    taken = [face for bond in found.bonds for face in (bond.first, bond.second) if face.module in reported.BODY_GENDERS]
    given = sum(len(genders) for genders in reported.BODY_GENDERS.values())
    piece = {name: name for name in found.modules}

    def root(name: str) -> str:
        while piece[name] != name:
            name = piece[name]
        return name

    for bond in found.bonds:
        if all(face.face in reported.FACES for face in (bond.first, bond.second)):
            piece[root(bond.first.module)] = root(bond.second.module)
    return len(taken), given, len({root(name) for name in found.modules})


def two_faces(context: Context) -> Verdict:
    """Six faces wanted, four there."""
    taken, given, pieces = body_faces(context)
    needed = reported.LEGS + 2 * (reported.BODY - 1)
    third = sum(
        assembly(context).modules[name].genders[face] != "none"
        for name in reported.BODY_GENDERS
        for face in "LUS"
        if face not in reported.FACES
    )
    return claim(
        "two connection faces a module",
        "Sections 1.1 and 1.2: a module has one face on either arm; two modules make a body that carries four legs",
        judge(
            needed - given, 0.0, corrected=[needed - given - third, taken - needed], explained=needed - given - third
        ),
        f"Not possible: four legs and the bond between the two take {needed} faces of the body, and it has {given}. "
        f"With no more than those the robot is {pieces} pieces. The file gives each body module a third face at its "
        "middle.",
        [
            Figure("faces needed", needed, "", "four legs and both ends of one bond"),
            Figure("faces by the paper", given, "", "two modules with two each"),
            Figure("faces taken", taken, "", "of the body, in the robot's file"),
            Figure("third faces", third, "", "of the body, in the robot's file"),
            Figure("pieces without third faces", pieces, "", "of the robot's file"),
        ],
        ("two faces", "a third face on both modules of the body"),
    )


def legs_alike(context: Context) -> Verdict:
    """Legs at module 6 are turned round."""
    found = assembly(context)
    held: dict[str, str] = {}
    conflicts, left = 0, 0
    for bond in found.bonds:
        ends = {face.module in reported.BODY_GENDERS: face for face in (bond.first, bond.second)}
        if len(ends) < 2:
            continue
        body, own = ends[True], ends[False]
        held[own.module.partition("_")[0]] = own.face
        gender = reported.BODY_GENDERS[body.module][body.face]
        # As leg IV: the upper arm of its module 2 is at the body.
        conflicts += reported.USUAL_GENDERS["U"] == gender
        left += reported.USUAL_GENDERS[own.face] == gender
    reversed_legs = sorted(leg for leg, face in held.items() if face != held["IV"])
    other = _other_leg(context)
    q = facts_of(context)[0].q
    same = worst(foot_poses(other, q) - foot_poses(facts_of(context)[0].leg, q))
    return claim(
        "the other legs are like leg IV",
        "Section 1.2: every leg is held by the upper arm of its module 2 and keeps the same joints as leg IV",
        judge(conflicts, EXACT, corrected=[left, same], explained=left),
        f"Not with the genders of the text: held like leg IV, {conflicts} legs would put an active face on an active "
        "one "
        f"of module 6. Legs {' and '.join(reversed_legs)} have to be turned round, with the lower arm of module 2 at "
        f"the body and the upper swing of module 1 at rest. Their kinematics is the same (to {text(same)} in all "
        "entries of the foot's pose).",
        [
            Figure("bonds of equal gender, all legs like IV", conflicts, "", f"of {len(held)}"),
            Figure("bonds of equal gender, legs turned round", left, "", f"of {len(held)}"),
            Figure("foot's pose, turned round, worst difference", same, "m, 1", f"{len(q)} poses"),
        ],
        ("all legs like leg IV", "legs at module 6 turned round"),
    )


def _other_leg(context: Context) -> Leg:
    import leg_dynamics

    leg: Leg = context.once(
        "quadruped: reversed leg", lambda: leg_dynamics.load("quadruped_leg_reversed", route="pinocchio")
    )
    return leg


# ---------------------------------------------------------------------- section 1.2: the leg


def six_joint_leg(context: Context) -> Leg:
    """Leg IV with nothing held."""
    leg: Leg = context.once("quadruped: six joints", lambda: facts_of(context)[0].leg.replace(frozen=0))
    return leg


def foot_screws(leg: Leg, q: Array) -> Array:
    """Velocity and angular velocity of the foot by the joints of a leg, from axes of its file, (N, 6, n)."""
    links = link_transforms(leg.description, leg.assemble(q))
    shape = (len(q), 4, 4)
    foot = np.broadcast_to(links["foot"], shape)[:, :3, 3]
    columns = []
    for name in leg.joint_names:
        joint = leg.description.joint(name)
        pose = np.broadcast_to(links[joint.child], shape)
        axis = pose[:, :3, :3] @ np.array(joint.axis)
        columns.append(np.concatenate([np.cross(axis, foot - pose[:, :3, 3]), axis], axis=-1))
    return np.stack(columns, axis=-1)


def _ranks(matrices: Array) -> Array:
    return np.asarray((np.linalg.svd(matrices, compute_uv=False) > RANK).sum(axis=-1))


def six_are_redundant(context: Context) -> Verdict:
    """Ranks of the leg with six joints."""
    leg = six_joint_leg(context)
    swing = np.radians(reported.SWING)
    free = np.array(["middle" in name for name in leg.joint_names])
    q = context.rng(31).uniform(-1.0, 1.0, (TURNS, 6)) * np.where(free, np.pi, swing)
    straight = np.zeros((2, 6))
    straight[1, leg.joint_names.index("m02_middle")] = 0.5 * np.pi
    screws, special = foot_screws(leg, q), _ranks(foot_screws(leg, straight))
    place, pose = _ranks(screws[:, :3]), _ranks(screws)
    spare = 6 - place
    return claim(
        "six joints a leg are redundant",
        "Section 1.2: if all six joints of a leg move, its motion is redundant",
        judge([float((spare <= 0).sum())], 0.0),
        f"True for the place of the foot: of 6 joints {int(spare.min())} are spare in all of {TURNS} random poses. "
        "Place "
        f"and direction of the foot together use all of them (rank {int(pose.min())}). A straight leg has rank "
        f"{int(special[0])}, with the middle of module 2 at 90° {int(special[1])}.",
        [
            Figure("joints to spare for the foot's place", spare.min(), "", f"{TURNS} random poses"),
            Figure("rank for the foot's pose, least", pose.min(), "", f"{TURNS} random poses"),
            Figure("rank, straight", special[0], "", "all joints at zero"),
            Figure("rank, straight, middle of module 2 at 90°", special[1], "", "all others at zero"),
        ],
    )


def three_are_left(context: Context) -> Verdict:
    """The middle of module 2 has to rest at 90 deg."""
    leg = six_joint_leg(context)
    middle = leg.joint_names.index("m02_middle")
    turns = np.radians([0.0, 30.0, 60.0, 90.0])
    q = np.zeros((len(turns), 6))
    q[:, middle] = turns
    axes = foot_screws(leg, q)[:, 3:]
    first, second = (axes[:, :, leg.joint_names.index(name)] for name in ("theta1", "theta2"))
    twist = np.arctan2(np.linalg.norm(np.cross(first, second), axis=1), np.einsum("ni,ni->n", first, second))
    meant = printed.table_rows(facts_of(context)[0].lengths)[0][1]
    return claim(
        "with three joints at rest three are left",
        "Section 1.2: the lower swing and the middle of module 1 and the middle of module 2 count as rigid",
        judge(twist[0] - meant, EXACT, corrected=twist[-1] - meant, explained=twist - turns),
        f"What angle the middle of module 2 rests at is not said, and it matters: it is the twist α₁ of Table 1 (to "
        f"{text(worst(twist - turns))} rad). Table 1 asks for {np.degrees(meant):.0f}°; at rest in the middle of its "
        f"range, at 0°, the first two axes are parallel (α₁ = {np.degrees(twist[0]) + 0.0:.0f}°) and the leg moves in "
        "one plane.",
        [
            Figure(f"α₁, middle of module 2 at {np.degrees(turn):.0f}°", angle, "rad", "axes of the leg's file")
            for turn, angle in zip(turns, twist, strict=True)
        ],
        ("the middle of module 2 is rigid", "the middle of module 2 is rigid at 90°"),
    )


def origin(context: Context) -> Verdict:
    """O_0, not O_c, is at (a, b, c)."""
    mount = mount_of_iv(context)
    own = np.zeros(3)
    return claim(
        "the origin O_c is at (a, b, c)",
        "Section 2.1: place of the hip's frame in the body",
        judge(
            own - mount,
            EXACT,
            corrected=hip_in_body(context, "IV")[:3, 3] - printed.hip_to_body(mount)[:3, 3],
            explained=printed.hip_to_body(mount)[:3, 3] - mount,
        ),
        f"A slip: O_c is the body's own origin, at 0; by (1) O_0 is at (a, b, c). In the file they are "
        f"{1e3 * np.linalg.norm(mount):.0f} mm apart.",
        [Figure("distance of O_0 from O_c", float(np.linalg.norm(mount)), "m", "leg IV of the robot's file")],
        ("O_c at (a, b, c)", "O_0 at (a, b, c)"),
    )


def one_pose(context: Context) -> Verdict:
    """What (4) cannot see."""
    second = facts_of(context)[1]
    unseen = unseen_terms(second, slice(0, 1))
    left = unseen_terms(second, slice(None))
    return claim(
        "agreement at one pose shows that (3) is right",
        "Section 2.2: (4) agrees with Fig. 4, so the forward kinematics is right",
        judge(float(len(unseen)), 0.0, corrected=float(len(left)), explained=float(len(left))),
        f"(3) is right, but this does not show it: at (0°, −30°, −60°) the signs of {len(unseen)} of its "
        f"{len(printed.TERMS)} terms ({', '.join(unseen)}) could be wrong and (4) would be the same. Over "
        f"{len(second.q)} poses no wrong sign is left unseen.",
        [
            Figure("terms whose sign (4) does not test", len(unseen), "", f"of {len(printed.TERMS)}"),
            Figure("the same, random poses", len(left), "", f"{len(second.q)} poses"),
        ],
        ("one pose", "all poses"),
    )


def rings(context: Context) -> Verdict:
    """Ten modules in a ring."""
    ring = _file(context, "ring")
    assert ring.home is not None
    values = {name: np.array([value]) for name, value in ring.home.values.items()}
    residual = worst(loop_residual(ring, values))
    modules = {link.name.partition("_")[0] for link in ring.links if "_lower_half" in link.name}
    return claim(
        "the same modules make a ring as well",
        "Section 0: several of the modules make a ring-shaped robot or a quadruped",
        judge(residual, EXACT),
        f"Ten modules of the file close a ring, to {text(residual)} m or rad in its home pose.",
        [
            Figure("loop residual", residual, "m, rad", "home pose of the ring's file"),
            Figure("modules", len(modules), "", "of the ring's file"),
        ],
    )


def virtues(context: Context) -> Verdict:
    """Latches, rubber, energy."""
    return claim(
        "latches, rubber feet, less energy, quick repair",
        "Sections 0 and 1: pins latch the faces, rubber softens the ground's impact, fewer joints save energy, a "
        "broken "
        "module is quickly exchanged",
        Status.OUT_OF_REACH,
        "There is neither a latch, a stiffness, a drive nor a prototype to compute with.",
    )


VERDICTS: tuple[Callable[[Context], Verdict], ...] = (
    rings,
    module_size,
    module_freedoms,
    ten_modules,
    mixed_bonds,
    two_faces,
    legs_alike,
    six_are_redundant,
    three_are_left,
    virtues,
    origin,
    one_pose,
)
"""One function a claim, in the paper's order."""


# ---------------------------------------------------------------------- page


def plots(context: Context) -> tuple[Plot, ...]:
    """Drawings of this module."""
    return (
        Plot(
            "modules",
            "The ten modules and their faces, from above",
            "The robot's file with all joints at zero but those at rest. Each line is a module between its faces L and "
            "U; the short ones in the middle are the third faces that hold the body together.",
            functools.partial(_draw_modules, context),
            ("Fig. 3", "claim: two connection faces a module", "claim: the other legs are like leg IV"),
        ),
    )


def _draw_modules(context: Context) -> Drawing:
    figure = drawing(10.5, 3.6)
    axis = figure.subplots(1, 1)
    found, links = assembly(context), link_transforms(robot_file(context), {})
    shades = {"active": COLOURS[1], "passive": COLOURS[0]}
    for name, module in found.modules.items():
        lower, upper = (links[f"{name}_face_{face}"][:3, 3] for face in "LU")
        axis.plot(*(1e3 * np.stack([lower, upper])[:, k] for k in (1, 0)), color="0.75", linewidth=13.0, zorder=1)
        middle = 0.5 * (lower + upper)
        for face, gender in module.genders.items():
            if gender == "none":
                continue
            at = 1e3 * links[f"{name}_face_{face}"][:3, 3]
            inside = at + 0.12 * (1e3 * middle - at)
            if face not in reported.FACES:
                axis.plot([1e3 * middle[1], at[1]], [1e3 * middle[0], at[0]], color="0.75", linewidth=7.0, zorder=1)
            axis.plot(inside[1], inside[0], color=shades[gender], marker="s", markersize=7, linestyle="none", zorder=3)
            aside = (0, -13) if face in reported.FACES else (10, -3)
            axis.annotate(face, (inside[1], inside[0]), aside, textcoords="offset points", ha="center", fontsize=8)
        axis.annotate(
            name.replace("_", " "),
            (1e3 * middle[1], 1e3 * middle[0]),
            (26 if name in reported.BODY_GENDERS else 0, 11),
            textcoords="offset points",
            ha="center",
            fontsize=9,
        )
    for gender, colour in shades.items():
        axis.plot([], [], color=colour, marker="s", linestyle="none", label=f"{gender} face")
    axis.invert_xaxis()
    axis.set_aspect("equal")
    dress(axis, xlabel="to the left [mm]", ylabel="ahead [mm]")
    axis.margins(x=0.04, y=0.25)
    legend_below(figure, axis)
    return figure


def sections(context: Context) -> tuple[Section, ...]:
    """Modules and bonds."""
    found = assembly(context)
    rows = []
    for bond in found.bonds:
        genders = [found.modules[face.module].genders[face.face] for face in (bond.first, bond.second)]
        third = any(face.face not in reported.FACES for face in (bond.first, bond.second))
        rows.append(
            (str(bond.first), genders[0], str(bond.second), genders[1], "not in the paper" if third else "two arms")
        )
    return (
        Section(
            "modules-and-bonds",
            "Modules and bonds",
            (
                "The robot's file follows the genders of the text. Module 6 takes legs by active faces only and module "
                "3 by passive ones, so that the legs differ; and the body is held together by faces that the paper's "
                "modules do not have.",
            ),
            ("face", "gender", "on face", "gender ", "faces"),
            tuple(rows),
            ("modules",),
        ),
    )
