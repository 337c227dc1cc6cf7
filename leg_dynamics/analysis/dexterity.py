"""How well a leg's actuators move its foot: condition number, its mean and deviation, singular values.

The Jacobian is that of the foot by the actuated coordinates, J = dx/dl. Its condition number k = sigma_max/sigma_min is
also that of dl/dx, the form in which Rong 2012 (24) has it. Where the coordinates mix rad and m, or a length must be
set against a radian at all, k depends on a length: columns in m/rad are divided by the `characteristic_length` first.
Where all actuators have the same unit, k does not depend on it, and it is not used.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from leg_dynamics.analysis.arguments import number
from leg_dynamics.errors import NonFiniteError, ParameterError, ShapeError, WorkspaceError

if TYPE_CHECKING:
    from leg_dynamics.kernels import Kernel
    from leg_dynamics.leg import Leg

__all__ = [
    "Conditioning",
    "Dexterity",
    "actuator_jacobian",
    "column_scales",
    "conditioning",
    "conditioning_kernel",
    "conditioning_program",
    "dexterity",
    "home_coordinates",
    "home_length",
    "weighted_dexterity",
]


@dataclass(frozen=True)
class Conditioning:
    """Singular values of scaled foot Jacobians.

    Attributes
    ----------
    condition : (...,) array
        k = sigma_max / sigma_min, at least 1; infinite at a singularity.
    smallest, largest : (...,) array
        Singular values, in the unit that `Dexterity.unit` states.
    volume : (...,) array
        sqrt(det(J^T J)) of the unscaled Jacobian, m^n per product of the coordinates' units; for n = 3 det J, with its
        sign.
    """

    condition: np.ndarray
    smallest: np.ndarray
    largest: np.ndarray
    volume: np.ndarray


@dataclass(frozen=True)
class Dexterity:
    """Dexterity over a set of poses, each weighted by the foot volume that it stands for.

    Attributes
    ----------
    mean : float
        Rong 2012 (31): the integral of k dV over V.
    deviation : float
        (32), corrected: the root of the integral of (k - mean)^2 dV over V. As printed, with the root of the integral
        over V outside, it has the dimension of 1/sqrt(V).
    smallest, largest : float
        Extreme condition numbers among the poses.
    inverse_mean : float
        Integral of 1/k dV over V: finite also where k is not (Gosselin and Angeles 1991, global conditioning index).
    smallest_singular_value : float
        The least sigma_min among the poses.
    unit : str
        Of the singular values.
    characteristic_length : float or None
        m; None where all actuators have the same unit and k needs no length.
    """

    mean: float
    deviation: float
    smallest: float
    largest: float
    inverse_mean: float
    smallest_singular_value: float
    unit: str
    characteristic_length: float | None

    def to_dict(self) -> dict[str, Any]:
        """The numbers as JSON-ready values."""
        return asdict(self)


def column_scales(leg: Leg, characteristic_length: float | None = None) -> tuple[np.ndarray, str, float | None]:
    """Factors of the Jacobian's columns that make its singular values comparable.

    Parameters
    ----------
    leg : Leg
    characteristic_length : float, optional
        m; by default, where units are mixed, the distance from the hip to the foot in the leg's home pose.

    Returns
    -------
    scales : (m,) array
        One an actuator, in their order.
    unit : str
        Of the singular values: ``m/rad``, ``m/m`` or, with a characteristic length, ``1``.
    characteristic_length : float or None
        The one used; None where none is needed.

    Raises
    ------
    ParameterError
        It is not a positive finite number.
    ShapeError
        It is no number.
    """
    if characteristic_length is not None:
        characteristic_length = number("characteristic_length", characteristic_length)
        if not (math.isfinite(characteristic_length) and characteristic_length > 0):
            raise ParameterError(
                f"characteristic_length = {characteristic_length!r} is not a positive number of metres: it divides the "
                "columns in m/rad"
            )
    turning = np.array([unit == "N·m" for unit in leg.units.actuators])
    if turning.all() or not turning.any():
        return np.ones(len(turning)), "m/rad" if turning.all() else "m/m", None
    length = home_length(leg) if characteristic_length is None else characteristic_length
    return np.where(turning, 1.0 / length, 1.0), "1", length


def home_coordinates(leg: Leg) -> np.ndarray:
    """Independent coordinates of the file's home configuration, shape (n,); 0 where it does not say."""
    home = leg.description.home
    return np.array([0.0 if home is None else home.values.get(name, 0.0) for name in leg.joint_names])


def home_length(leg: Leg) -> float:
    """Distance from the hip to the foot in the home pose, m; 1 where that is no length."""
    distance = float(np.linalg.norm(leg.foot_position(home_coordinates(leg), on_error="nan")))
    return distance if math.isfinite(distance) and distance > 0.0 else 1.0


def actuator_jacobian(leg: Leg, q: ArrayLike) -> np.ndarray:
    """Foot Jacobian by the actuated coordinates, foot velocity = J * actuator rates.

    Parameters
    ----------
    leg : Leg
    q : (..., n) array_like
        Independent coordinates. Rows whose loops cannot be closed give NaN.

    Returns
    -------
    (..., 3, m) array
        m/rad or m/m, in the order of the actuators.
    """
    joints, actuated = leg.joint_names, leg.backend.actuator_joints
    if set(actuated) == set(joints):
        return leg.jacobian(q, on_error="nan")[..., [joints.index(name) for name in actuated]]
    # Elsewhere by virtual work: an actuator spares J^T F of its effort when a force F acts on the foot.
    q = np.asarray(q, dtype=float)
    still, weightless = np.zeros_like(q), np.zeros(3)
    spared = [-leg.torque(q, still, still, unit, weightless, on_error="nan") for unit in np.eye(3)]
    free = leg.torque(q, still, still, None, weightless, on_error="nan")
    return np.stack([force + free for force in spared], axis=-2)


def conditioning(jacobian: ArrayLike, scales: ArrayLike | None = None) -> Conditioning:
    """Singular values of foot Jacobians.

    Parameters
    ----------
    jacobian : (..., 3, m) array_like
        NaN rows give NaN.
    scales : (m,) array_like, optional
        Factors of the columns (see `column_scales`).

    Returns
    -------
    Conditioning
        Three columns go through a compiled closed form, relative accuracy about 1e-8; others through LAPACK.
    """
    J = np.asarray(jacobian, dtype=float)
    if J.ndim < 2 or J.shape[-2] != 3:
        raise ShapeError(f"a foot Jacobian has shape (..., 3, m), got {J.shape}", shape=J.shape)
    columns = J.shape[-1]
    factors = np.ones(columns) if scales is None else np.asarray(scales, dtype=float)
    if columns == 3:
        numbers = conditioning_kernel().ufunc(J, factors)
        smallest, largest, volume = np.moveaxis(numbers, -1, 0)
    else:
        flat = J.reshape(-1, 3, columns)
        sigma = np.full((len(flat), min(3, columns)), np.nan)
        volume = np.full(len(flat), np.nan)
        good = np.isfinite(flat).all(axis=(1, 2))
        if good.any():
            sigma[good] = np.linalg.svd(flat[good] * factors, compute_uv=False)
            volume[good] = np.prod(np.linalg.svd(flat[good], compute_uv=False), axis=-1)
        smallest, largest = (sigma[:, k].reshape(J.shape[:-2]) for k in (-1, 0))
        volume = volume.reshape(J.shape[:-2])
    with np.errstate(divide="ignore", invalid="ignore"):
        return Conditioning(largest / smallest, smallest, largest, volume)


def conditioning_kernel() -> Kernel:
    """Compiled (J (3, 3), scales (3,)) -> (sigma_min, sigma_max of J diag(scales), det J)."""
    from leg_dynamics.kernels import kernel
    from leg_dynamics.kernels.cache import key_of, source_fingerprint

    if "kernel" not in _MADE:
        key = key_of("conditioning", source_fingerprint(__name__))
        _MADE["kernel"] = kernel("conditioning", key, conditioning_program)
    return _MADE["kernel"]


_MADE: dict[str, Kernel] = {}


def conditioning_program() -> Any:
    """The formulas of `conditioning_kernel`: (J (3, 3), factors of its columns (3,)) -> sigma_min, sigma_max, det J.

    Eigenvalues of the scaled J^T J by the cosine form of the cubic; the smallest from the determinant, for the cubic
    loses the digits of a small eigenvalue beside a large one, and the determinant does not.
    """
    import casadi

    from leg_dynamics.kernels import Argument, Program

    flat, scales = casadi.SX.sym("J", 9), casadi.SX.sym("scales", 3)
    J = casadi.reshape(flat, 3, 3).T
    scaled = J @ casadi.diag(scales)
    G = scaled.T @ scaled
    third = casadi.trace(G) / 3.0
    shifted = G - third * casadi.SX.eye(3)
    radius = casadi.sqrt(casadi.sumsqr(shifted) / 6.0)
    # all three equal: any angle will do
    unit = shifted / casadi.fmax(radius, 1e-300)
    cosine = casadi.fmin(casadi.fmax(_determinant(unit) / 2.0, -1.0), 1.0)
    angle = casadi.acos(cosine) / 3.0
    largest = third + 2.0 * radius * casadi.cos(angle)
    middle = 3.0 * third - largest - (third + 2.0 * radius * casadi.cos(angle + 2.0 * math.pi / 3.0))
    determinant = _determinant(J)
    product = casadi.fabs(determinant * scales[0] * scales[1] * scales[2])
    smallest = product / casadi.fmax(casadi.sqrt(casadi.fmax(largest * middle, 0.0)), 1e-300)
    largest = casadi.sqrt(largest)
    result = casadi.vertcat(casadi.fmin(smallest, largest), largest, determinant)
    graph = casadi.Function("conditioning", [flat, scales], casadi.cse([result, casadi.SX(0, 1)]))
    arguments = (Argument("jacobian", (3, 3)), Argument("scales", (3,)))
    return Program("conditioning", arguments, (Argument("conditioning", (3,)),), graph)


def _determinant(A: Any) -> Any:
    return (
        A[0, 0] * (A[1, 1] * A[2, 2] - A[1, 2] * A[2, 1])
        - A[0, 1] * (A[1, 0] * A[2, 2] - A[1, 2] * A[2, 0])
        + A[0, 2] * (A[1, 0] * A[2, 1] - A[1, 1] * A[2, 0])
    )


def dexterity(
    leg: Leg, q: ArrayLike, weights: ArrayLike | None = None, *, characteristic_length: float | None = None
) -> Dexterity:
    """Weighted statistics of the condition number over poses.

    Parameters
    ----------
    leg : Leg
    q : (N, n) array_like
        Poses; all must close.
    weights : (N,) array_like, optional
        Foot volume that each stands for (`leg_dynamics.analysis.workspace` gives both); equal by default, which is
        the right weight only for poses spread evenly over the foot's positions.
    characteristic_length : float, optional
        See `column_scales`.

    Returns
    -------
    Dexterity

    Raises
    ------
    WorkspaceError
        There is no pose.
    NonFiniteError
        A weight is negative, NaN or infinite, or a pose does not close.
    """
    scales, unit, length = column_scales(leg, characteristic_length)
    values = conditioning(actuator_jacobian(leg, q), scales)
    condition, smallest = np.atleast_1d(values.condition), np.atleast_1d(values.smallest)
    weight = np.ones(condition.shape) if weights is None else np.asarray(weights, dtype=float)
    if weight.shape != condition.shape:
        raise ShapeError(f"weights have shape {weight.shape}, but there are {condition.shape} poses")
    return weighted_dexterity(condition, smallest, weight, unit, length)


def weighted_dexterity(
    condition: np.ndarray, smallest: np.ndarray, weight: np.ndarray, unit: str, length: float | None
) -> Dexterity:
    """Statistics (31) and (32) of condition numbers and smallest singular values, shape (N,) each."""
    if condition.size == 0:
        raise WorkspaceError("there is no pose to take the mean condition number of: sample the workspace first")
    bad = np.flatnonzero(~(np.isfinite(weight) & (weight >= 0.0)) | np.isnan(condition))
    if bad.size:
        raise NonFiniteError(
            f"{bad.size} of {condition.size} poses have no condition number or a weight that is no volume, first row "
            f"{bad[0]}: leave out poses that do not close",
            rows=bad,
        )
    share = weight / weight.sum()
    mean = float(share @ condition)
    return Dexterity(
        mean=mean,
        deviation=float(np.sqrt(share @ (condition - mean) ** 2)),
        smallest=float(condition.min()),
        largest=float(condition.max()),
        inverse_mean=float(share @ (1.0 / condition)),
        smallest_singular_value=float(smallest.min()),
        unit=unit,
        characteristic_length=length,
    )
