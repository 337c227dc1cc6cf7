"""The same mechanism with random masses, centres of mass and full inertia tensors."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np

from leg_dynamics.description.model import Description

__all__ = ["with_random_inertia"]


def _random_tensor(generator: np.random.Generator, mass: float, radius: float) -> np.ndarray:
    """A physical inertia tensor: that of a random point cloud, in random axes."""
    points = generator.normal(scale=radius, size=(12, 3)) * generator.uniform(0.2, 1.0, 3)
    points -= points.mean(axis=0)
    axes, _ = np.linalg.qr(generator.standard_normal((3, 3)))
    second_moment = axes @ (points.T @ points / len(points)) @ axes.T
    return mass * (np.trace(second_moment) * np.eye(3) - second_moment)


def with_random_inertia(description: Description, seed: int, radius: float = 0.04) -> str:
    """Mechanism text in which every body with an inertia gets another one.

    Parameters
    ----------
    description : Description
    seed : int
    radius : float
        Scale of the offsets and of the radii of gyration, m.

    Returns
    -------
    str
        URDF+ text; geometry, loops and couplings are unchanged.
    """
    generator = np.random.default_rng(seed)
    robot = ET.fromstring(description.urdf)
    for inertial in robot.iter("inertial"):
        mass = float(generator.uniform(0.05, 1.0))
        tensor = _random_tensor(generator, mass, radius)
        com = generator.normal(scale=radius, size=3)
        for child in list(inertial):
            inertial.remove(child)
        rpy = generator.uniform(-np.pi, np.pi, 3)
        ET.SubElement(inertial, "origin", xyz=_text(com), rpy=_text(rpy))
        ET.SubElement(inertial, "mass", value=repr(mass))
        entries = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
        ET.SubElement(inertial, "inertia", {key: repr(float(tensor[index])) for key, index in entries.items()})
    return ET.tostring(robot, encoding="unicode")


def _text(vector: np.ndarray) -> str:
    return " ".join(repr(float(value)) for value in vector)
