"""Whole turns of passive angles: no other pose, so that one rule says which of them is meant, for every route."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from leg_dynamics.description.model import Description
from leg_dynamics.description.topology import coupling_equations

__all__ = ["WholeTurns"]

TURN = 2.0 * np.pi
# A half turn to within rounding of the pose counts as one and not as minus one, and a limit as kept.
SLACK = 1e-6


class WholeTurns:
    """Brings passive angles to the turn that is within half a turn of the home pose, or else inside the limits.

    Where the angle within half a turn of home is outside the joint's limits and another whole turn is inside, it is
    that one. Angles in couplings stay: there a turn counts. So do independent ones.

    Parameters
    ----------
    description : Description
    names : sequence of str
        The tree's joints, in the order of the coordinates.
    independent : collection of str
    home : (nv,) array
        Tree coordinates of the home pose, in any turn; NaN where they are not known.
    """

    def __init__(
        self, description: Description, names: Sequence[str], independent: Collection[str], home: np.ndarray
    ) -> None:
        coupled = {name for equation in coupling_equations(description) for name in equation.coefficients}
        joints = [description.joint(name) for name in names]
        self.places = np.array(
            [
                place
                for place, joint in enumerate(joints)
                if joint.unit == "rad" and joint.name not in coupled and joint.name not in independent
            ],
            dtype=np.intp,
        )
        stated = {} if description.home is None else description.home.values
        values = np.array([stated.get(name, 0.0) for name in names])[self.places]
        found = np.asarray(home, dtype=float)[self.places]
        self._home = np.where(np.isnan(found), values, _within_half_a_turn(found, values))
        self._lower = np.array([joint.limits.lower for joint in joints])[self.places] - SLACK
        self._upper = np.array([joint.limits.upper for joint in joints])[self.places] + SLACK

    def __call__(self, coordinates: np.ndarray) -> np.ndarray:
        """The same poses, (..., nv); the argument itself where nothing changes."""
        angles = coordinates[..., self.places]
        found = _within_half_a_turn(angles, self._home)
        outside = (found < self._lower) | (found > self._upper)
        if outside.any():
            with np.errstate(invalid="ignore"):
                # The turn next to home that keeps the limit in question.
                up, down = np.ceil((self._lower - found) / TURN), np.floor((self._upper - found) / TURN)
                other = found + TURN * np.where(found < self._lower, up, down)
            inside = outside & (other >= self._lower) & (other <= self._upper)
            found = np.where(inside, other, found)
        if np.array_equal(found, angles, equal_nan=True):
            return coordinates
        result = coordinates.copy()
        result[..., self.places] = found
        return result


def _within_half_a_turn(angles: np.ndarray, around: np.ndarray) -> np.ndarray:
    turns = np.ceil((angles - around - np.pi - SLACK) / TURN)
    return np.where(turns == 0.0, angles, angles - TURN * turns)
