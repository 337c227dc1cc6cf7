"""Other mechanisms than the leg: generated chains of four-bar loops, and files that others wrote."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

import leg_dynamics as ld
from benchmarks.cases import NotAvailableError, Settings, Work, closure_of, cold, load_symbolic

SHARED = Path(__file__).parents[2] / "shared" / "models" / "urdf_plus"
"""Where the foreign files lie beside a checkout; see its README."""

GRBDA = {
    "four_bar": (39.0, 0.055),
    "six_bar": (71.0, 0.13),
    "mini_cheetah_leg": (3.7, 0.10),
}
"""µs a call of GRBDA (C++, positions given closed): as shipped, and by its generated C.

Measured elsewhere on this kind of machine (2 cores, AVX-512), not in this run.
"""

# The four-bar file closes at zero where the linkage is flat and its modes meet; the six-bar file is open there.
_HOME: Mapping[str, Mapping[str, float]] = {
    "four_bar": {"joint1": 1.0, "joint2": -1.0, "joint3": 1.0},
    "six_bar": {"joint1": 0.5, "joint2": 0.6, "joint3": 0.7},
}

CRANK, COUPLER, ROCKER, GROUND = 0.3, 0.5, 0.4, 0.5
CRANK_ANGLE = 1.2
SPEED, ACCELERATION, SWING = 2.0, 20.0, 0.25


def _two_links(x: float, y: float, first: float, second: float) -> tuple[float, float]:
    """Angles of two links whose end is at (x, y), the elbow to the left of the way there."""
    bend = -math.acos((x * x + y * y - first * first - second * second) / (2.0 * first * second))
    lean = math.atan2(second * math.sin(bend), first + second * math.cos(bend))
    return math.atan2(y, x) - lean, bend


def _link(name: str, length: float) -> str:
    mass = 2.0 * length
    across = mass * length * length / 12.0
    return (
        f'<link name="{name}"><inertial><origin xyz="{length / 2} 0 0.01"/><mass value="{mass}"/>'
        f'<inertia ixx="{0.1 * across}" iyy="{across}" izz="{1.1 * across}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )


def _joint(name: str, parent: str, child: str, at: float, independent: bool, z: float = 0.0) -> str:
    return (
        f'<joint name="{name}" type="revolute" independent="{str(independent).lower()}"><parent link="{parent}"/>'
        f'<child link="{child}"/><origin xyz="{at} 0 {z}"/><axis xyz="0 1 0"/>'
        '<limit lower="-3" upper="3" velocity="20" effort="100"/></joint>'
    )


def chain(loops: int) -> str:
    """URDF+ of a planar chain of four-bar linkages, each carried by the coupler of the one before.

    Parameters
    ----------
    loops : int
        Number of linkages: as many degrees of freedom and three times as many moving bodies.
    """
    # Turning about y takes z to x: plane angles are those of (x, -z).
    crank_x, crank_y = CRANK * math.cos(CRANK_ANGLE), CRANK * math.sin(CRANK_ANGLE)
    span_x, span_y = GROUND - crank_x, -crank_y
    coupler, elbow = _two_links(span_x, span_y, COUPLER, ROCKER)
    rocker = coupler + elbow + math.pi
    home = (CRANK_ANGLE, coupler - CRANK_ANGLE, rocker)
    parts = ['<link name="link_0"/>']
    poses = []
    for i in range(1, loops + 1):
        names = f"crank_{i}", f"coupler_{i}", f"rocker_{i}"
        carrier, offset = (f"coupler_{i - 1}", COUPLER) if i > 1 else ("link_0", 0.0)
        parts += [_link(name, length) for name, length in zip(names, (CRANK, COUPLER, ROCKER), strict=True)]
        parts += [
            _joint(f"a_{i}", carrier, names[0], offset, True),
            _joint(f"b_{i}", names[0], names[1], CRANK, False),
            _joint(f"c_{i}", carrier, names[2], offset + GROUND, False),
            f'<loop name="loop_{i}" type="revolute"><predecessor link="{names[1]}"><origin xyz="{COUPLER} 0 0"/>'
            f'</predecessor><successor link="{names[2]}"><origin xyz="{ROCKER} 0 0"/></successor>'
            '<axis xyz="0 1 0"/></loop>',
        ]
        poses += [f'<joint name="{j}_{i}" value="{x!r}"/>' for j, x in zip("abc", home, strict=True)]
    configuration = f'<configuration name="home">{"".join(poses)}</configuration>'
    return f'<robot name="chain_{loops}">{"".join(parts)}{configuration}</robot>'


def platform() -> str:
    """URDF+ of a planar 3-RRR platform driven by its three cranks.

    Its assembly modes are the roots of a polynomial of degree six: no formula closes it, a solver has to. The chains
    and the foreign files do not show what that costs.
    """
    # Rods that do not meet in a point: far from the singular poses of the platform.
    radius, corner, turned, crank, rod = 0.6, 0.3, 1.4, 0.25, 0.65
    around = [math.pi / 2.0 + 2.0 * math.pi * i / 3.0 for i in range(3)]
    bases = [(radius * math.cos(x), radius * math.sin(x)) for x in around]
    corners = [(corner * math.cos(x + turned) + 0.03, corner * math.sin(x + turned) - 0.02) for x in around]
    parts, pose = ['<link name="ground"/>'], {}
    for i, (base, end) in enumerate(zip(bases, corners, strict=True), start=1):
        parts += [_link(f"crank_{i}", crank), _link(f"rod_{i}", rod)]
        # Plane angles are those of (x, -z), as in the chain.
        parts.append(_joint(f"a_{i}", "ground", f"crank_{i}", base[0], True, -base[1]))
        parts.append(_joint(f"b_{i}", f"crank_{i}", f"rod_{i}", crank, False))
        pose[f"a_{i}"], pose[f"b_{i}"] = _two_links(end[0] - base[0], end[1] - base[1], crank, rod)
    parts += [_link("plate", corner), _joint("c", "rod_1", "plate", rod, False)]
    # The plate's frame is in its first corner, along x where the plate is.
    pose["c"] = -pose["a_1"] - pose["b_1"]
    for i in (2, 3):
        x, y = (end - start for end, start in zip(corners[i - 1], corners[0], strict=True))
        parts.append(
            f'<loop name="loop_{i}" type="revolute"><predecessor link="plate"><origin xyz="{x} 0 {-y}"/></predecessor>'
            f'<successor link="rod_{i}"><origin xyz="{rod} 0 0"/></successor><axis xyz="0 1 0"/></loop>'
        )
    joints = "".join(f'<joint name="{name}" value="{value!r}"/>' for name, value in pose.items())
    return f'<robot name="platform">{"".join(parts)}<configuration name="home">{joints}</configuration></robot>'


def foreign(name: str) -> str:
    """Text of a foreign file, a home configuration added where the file gives none that serves.

    Raises
    ------
    NotAvailableError
        The file is not there.
    """
    path = SHARED / f"{name}.urdf"
    if not path.is_file():
        raise NotAvailableError(f"{name}.urdf is absent: ../shared/models/urdf_plus is not beside this checkout")
    text = path.read_text(encoding="utf-8")
    home = dict(_HOME.get(name, {}))
    if name == "six_bar":
        angles = np.cumsum([home[f"joint{i}"] for i in (1, 2, 3)])
        x, y = (float(np.dot((0.1, 0.2, 0.3), wave(angles))) for wave in (np.cos, np.sin))
        home["joint4"], home["joint5"] = _two_links(x, y, 0.4, 0.5)
    if not home:
        return text
    joints = "".join(f'<joint name="{joint}" value="{value!r}"/>' for joint, value in home.items())
    return text.replace("</robot>", f'<configuration name="home">{joints}</configuration></robot>')


class Subject:
    """A mechanism by the two routes that serve any, around its home pose."""

    def __init__(self, text: Callable[[], str], settings: Settings) -> None:
        self._text = text
        self.settings = settings

    @cached_property
    def text(self) -> str:
        return self._text()

    @cached_property
    def pinocchio(self) -> ld.Leg:
        return ld.load(self.text, route="pinocchio")

    @cached_property
    def symbolic(self) -> ld.Leg:
        return load_symbolic(self.text, threads=1)

    @cached_property
    def home(self) -> np.ndarray:
        """Independent coordinates of the home pose."""
        description = self.pinocchio.description
        if not description.configurations:
            return np.zeros(len(self.pinocchio.joint_names))
        pose = dict(description.configurations[0].values)
        return np.array([float(pose[name]) for name in self.pinocchio.joint_names])

    @cached_property
    def states(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        generator = np.random.default_rng(self.settings.seed)
        shape = (self.settings.states, len(self.home))
        q = self.home + generator.uniform(-SWING, SWING, shape)
        q[0] = self.home
        return q, generator.uniform(-SPEED, SPEED, shape), generator.uniform(-ACCELERATION, ACCELERATION, shape)

    @cached_property
    def path(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A closed way around home, 1 kHz, every coordinate with its own phase."""
        t = np.arange(256)[:, None] * (2.0 * math.pi / 256.0)
        wave = t + np.arange(len(self.home))
        rate = 2.0 * math.pi * 1000.0 / 256.0
        q = self.home + SWING * np.sin(wave)
        return q, SWING * rate * np.cos(wave), -SWING * rate * rate * np.sin(wave)

    def expected(self, where: str) -> np.ndarray:
        key = f"_expected_{where}"
        if not hasattr(self, key):
            setattr(self, key, self.pinocchio.torque(*getattr(self, where)))
        return getattr(self, key)

    # ------------------------------------------------------------------ works

    def rnea(self) -> Work:
        import pinocchio as pin

        leg = self.pinocchio
        mechanism = leg.backend.mechanism  # type: ignore[attr-defined]
        model = mechanism.tree.model.copy()
        data = model.createData()
        arguments, maps = [], []
        for q, v, a in zip(*(column[:64] for column in self.states), strict=True):
            state = mechanism.close(q)
            qd = state.G @ v
            qdd = state.G @ a + mechanism.bias_acceleration(state, qd)
            arguments.append((model, data, mechanism.tree.to_configuration(state.q), qd, qdd))
            maps.append((state, state.G))

        def answer(result: Any, index: int) -> np.ndarray:
            state, G = maps[index]
            return mechanism.actuator_effort(state, G.T @ result)

        return Work(pin.rnea, arguments, self.expected("states")[: len(arguments)], period=1, answer=answer)

    def along(self, leg: ld.Leg) -> Work:
        """One call a state, each near the one before."""
        arguments = list(zip(*self.path, strict=True))
        return Work(leg.torque, arguments, self.expected("path"), period=len(arguments), note=symbolic_note(leg))

    def batch(self, leg: ld.Leg, rows: int) -> Work:
        """One call on rows that have nothing in common with their neighbours: every closure starts from home."""
        index = np.arange(rows) % len(self.states[0])
        arguments = tuple(column[index] for column in self.states)
        return Work(cold(leg), [arguments], [self.expected("states")[index]], period=1, note=symbolic_note(leg))


def symbolic_note(leg: ld.Leg) -> str:
    """What the symbolic route does about the loops, in words."""
    return f"loops closed by {closure_of(leg)}"
