"""A multibody program as a witness: the same description simulated by MuJoCo, with prescribed motors.

MuJoCo shares no code with the routes: it has its own tree, its own mass matrix and soft loop constraints. Two checks:

* `Multibody.inverse_dynamics` takes MuJoCo's mass matrix, bias force and constraint Jacobian in one closed state and
  does the algebra of rigid loops on them: exact, so it must agree with a route to rounding.
* `Multibody.drive` simulates in time. The motors' positions are prescribed, everything else follows from forces; the
  drives' efforts and the foot's position are measured. Softness of the loops and the time step limit it.

With d the impedance of a constraint, R = (1 - d) / d times its inverse inertia and k its stiffness, a loop that carries
the force f opens by f R / k.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from leg_dynamics.description.mjcf import mujoco_model
from leg_dynamics.description.model import Description
from leg_dynamics.description.topology import actuated_joints, independent_joints
from leg_dynamics.errors import AssemblyError, ShapeError, UnsupportedError

__all__ = ["DrivenRun", "InverseDynamics", "Multibody", "Solver"]

CLOSED = 1e-9
"""m or rad; a state whose loops are open by more is no state of the mechanism."""

RANK_TOLERANCE = 1e-9
DIFFERENCE_STEP = 2e-4
"""s; with a fourth-order formula truncation and rounding are both below 1e-11 for rates of some rad/s."""


@dataclass(frozen=True)
class Solver:
    """How MuJoCo integrates and how stiff its loops are.

    Attributes
    ----------
    timestep : float
        s.
    time_constant : float
        Of a constraint's return to zero, s; MuJoCo allows no less than two time steps.
    damping_ratio : float
        Of that return; 1 is critical.
    impedance : float
        d: the share of the constraint's own acceleration that it enforces; MuJoCo takes 0.9999 at most.
    compliance : float
        Factor on MuJoCo's estimate of a constraint's inverse inertia, so on R: what makes loops stiffer than d can.
    integrator : str
        ``Euler``, ``implicitfast`` or ``implicit``. Euler's is semi-implicit with explicit dampers, and motors follow
        to rounding; the others take dampers implicitly, so that damped motors follow a little less closely.
    iterations : int
        At most, of the constraint solver (Newton); equality constraints need few.
    """

    timestep: float = 1e-4
    time_constant: float = 2e-4
    damping_ratio: float = 1.0
    impedance: float = 0.9999
    compliance: float = 1.0
    integrator: str = "Euler"
    iterations: int = 50

    def apply(self, model: Any) -> None:
        """Write the settings into a MuJoCo model."""
        import mujoco

        model.opt.timestep = self.timestep
        model.opt.solver = mujoco.mjtSolver.mjSOL_NEWTON
        model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{self.integrator.upper()}")
        model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        model.opt.iterations = self.iterations
        model.opt.tolerance = 0.0
        off = mujoco.mjtDisableBit
        model.opt.disableflags |= off.mjDSBL_CONTACT | off.mjDSBL_LIMIT | off.mjDSBL_EULERDAMP
        for weights in (model.body_invweight0, model.dof_invweight0, model.tendon_invweight0):
            weights[:] *= self.compliance
        model.eq_solref[:] = (self.time_constant, self.damping_ratio)
        model.eq_solimp[:] = (self.impedance, self.impedance, 0.001, 0.5, 2.0)


@dataclass(frozen=True, eq=False)
class InverseDynamics:
    """One state by MuJoCo's terms and rigid loops: `force` at the independent coordinates, mass matrix, rank."""

    force: np.ndarray
    """N·m or N, shape (n,)."""
    mass_matrix: np.ndarray
    """Shape (n, n)."""
    rank: int
    """Of the constraint Jacobian."""
    opening: float
    """Largest constraint residual of the state, m or rad."""


@dataclass(frozen=True, eq=False)
class DrivenRun:
    """What was measured while the motors were driven, at the T times of the time steps.

    Attributes
    ----------
    time : ndarray, shape (T,)
        s.
    q : ndarray, shape (T, n)
        Independent coordinates, rad or m.
    foot : ndarray, shape (T, 3)
        In the hip frame, m.
    force : ndarray, shape (T, n)
        Effort of the drives on the joint side, N·m or N, in the order of the independent coordinates.
    opening : float
        Largest constraint residual in the run, m or rad.
    solver : Solver
    """

    time: np.ndarray
    q: np.ndarray
    foot: np.ndarray
    force: np.ndarray
    opening: float
    solver: Solver

    @property
    def foot_velocity(self) -> np.ndarray:
        """Central differences of `foot`, m/s, at the inner T - 2 times."""
        velocity: np.ndarray = (self.foot[2:] - self.foot[:-2]) / (2.0 * self.solver.timestep)
        return velocity

    @property
    def foot_acceleration(self) -> np.ndarray:
        """Second differences of `foot`, m/s², at the inner T - 2 times."""
        change = self.foot[2:] - 2.0 * self.foot[1:-1] + self.foot[:-2]
        acceleration: np.ndarray = change / self.solver.timestep**2
        return acceleration


Motion = Callable[[float], tuple[np.ndarray, np.ndarray, np.ndarray]]
"""Time in s to (q, v, a) of the independent coordinates, each of shape (n,)."""


class Multibody:
    """A description in MuJoCo; not safe to use from several threads.

    Parameters
    ----------
    description : Description
        A mechanism with one actuator an independent coordinate.
    foot, hip : str
        Links whose origins, and whose frame for `hip`, positions and foot forces refer to.
    solver : Solver, optional

    Raises
    ------
    UnsupportedError
        MuJoCo is not installed, a joint or loop has no counterpart in it, or there is Coulomb friction.
    DescriptionError
        MuJoCo refuses the model.
    """

    def __init__(
        self, description: Description, *, foot: str = "foot", hip: str = "hip", solver: Solver | None = None
    ) -> None:
        rubbing = [joint.name for joint in description.joints if joint.friction]
        if rubbing:
            raise UnsupportedError(
                f"Coulomb friction at {', '.join(rubbing)}: MuJoCo makes it a soft constraint of its own, which "
                "cannot be held against the theory; set it to zero"
            )
        model = mujoco_model(description)
        import mujoco

        self._mujoco = mujoco
        self.solver = Solver() if solver is None else solver
        self.model = model
        self.solver.apply(self.model)
        self.data = mujoco.MjData(self.model)
        self.joint_names = tuple(self.model.joint(i).name for i in range(self.model.njnt))
        self.independent = independent_joints(description)
        self.actuated = actuated_joints(description)
        self._driven = np.array([self.joint_names.index(name) for name in self.independent])
        self._foot, self._hip = (description.link(name) and self.model.body(name).id for name in (foot, hip))

    def set_state(self, tree: Mapping[str, float], v: np.ndarray | None = None) -> None:
        """Set the joint coordinates, and rates that the loops allow for the independent rates `v`.

        Raises
        ------
        AssemblyError
            The loops are open there.
        """
        mujoco, model, data = self._mujoco, self.model, self.data
        mujoco.mj_resetData(model, data)
        data.qpos[:] = [float(tree[name]) for name in self.joint_names]
        mujoco.mj_forward(model, data)
        opening = self._opening()
        if not opening <= CLOSED:
            raise AssemblyError(
                f"the loops are open by {opening:.3g} (m or rad) where {CLOSED:g} is allowed: assemble the coordinates "
                "first",
                residual=np.array([opening]),
            )
        if v is not None:
            data.qvel[:] = self._rates() @ np.asarray(v, dtype=float)
            mujoco.mj_forward(model, data)

    def _opening(self) -> float:
        return float(np.abs(self.data.efc_pos).max(initial=0.0))

    def _jacobian(self) -> np.ndarray:
        return np.array(self.data.efc_J).reshape(self.data.nefc, self.model.nv)

    def _rates(self) -> np.ndarray:
        """G: tree rates for unit independent rates, with closed loops."""
        jacobian = self._jacobian()
        dependent = np.setdiff1d(np.arange(self.model.nv), self._driven)
        rates = np.zeros((self.model.nv, self._driven.size))
        rates[self._driven] = np.eye(self._driven.size)
        rates[dependent] = -np.linalg.lstsq(jacobian[:, dependent], jacobian[:, self._driven], rcond=RANK_TOLERANCE)[0]
        return rates

    def _drift(self) -> np.ndarray:
        """dK/dt qd by differences of the constraint Jacobian along the motion, fourth order."""
        mujoco, model, data = self._mujoco, self.model, self.data
        q, v = data.qpos.copy(), data.qvel.copy()
        drift = np.zeros(data.nefc)
        for steps, weight in ((1, 8.0), (-1, -8.0), (2, -1.0), (-2, 1.0)):
            data.qpos[:] = q + steps * DIFFERENCE_STEP * v
            mujoco.mj_fwdPosition(model, data)
            drift += weight / (12.0 * DIFFERENCE_STEP) * (self._jacobian() @ v)
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        return drift

    def _mass(self) -> np.ndarray:
        columns = np.empty((self.model.nv, self.model.nv))
        for column, unit in zip(columns, np.eye(self.model.nv), strict=True):
            self._mujoco.mj_mulM(self.model, self.data, column, unit)
        return columns

    def _foot_load(self, force: np.ndarray | None) -> np.ndarray:
        """Joint forces of a force on the foot, given in the hip frame."""
        if force is None:
            return np.zeros(self.model.nv)
        jacobian = np.zeros((3, self.model.nv))
        self._mujoco.mj_jac(self.model, self.data, jacobian, None, self.data.xpos[self._foot], self._foot)
        load: np.ndarray = jacobian.T @ (self._hip_rotation() @ np.asarray(force, dtype=float))
        return load

    def _hip_rotation(self) -> np.ndarray:
        rotation: np.ndarray = self.data.xmat[self._hip].reshape(3, 3)
        return rotation

    def foot_position(self) -> np.ndarray:
        """Foot in the hip frame, m, shape (3,)."""
        position: np.ndarray = self._hip_rotation().T @ (self.data.xpos[self._foot] - self.data.xpos[self._hip])
        return position

    def inverse_dynamics(
        self, tree: Mapping[str, float], v: np.ndarray, a: np.ndarray, foot_force: np.ndarray | None = None
    ) -> InverseDynamics:
        """Inverse dynamics with rigid loops, from MuJoCo's mass matrix, bias force and constraint Jacobian.

        Parameters
        ----------
        tree : mapping of str to float
            All tree joint coordinates of a closed state.
        v, a : array_like, shape (n,)
            Rates and accelerations of the independent coordinates.
        foot_force : array_like, shape (3,), optional
            Force that the environment applies to the foot, N, in the hip frame.

        Returns
        -------
        InverseDynamics

        Raises
        ------
        AssemblyError
            The loops are open.
        """
        self.set_state(tree, v)
        rates, jacobian, data = self._rates(), self._jacobian(), self.data
        drift = self._drift()
        free = np.setdiff1d(np.arange(self.model.nv), self._driven)
        acceleration = rates @ np.asarray(a, dtype=float)
        acceleration[free] -= np.linalg.lstsq(jacobian[:, free], drift, rcond=RANK_TOLERANCE)[0]
        mass = self._mass()
        load = mass @ acceleration + data.qfrc_bias - data.qfrc_passive - self._foot_load(foot_force)
        return InverseDynamics(
            rates.T @ load,
            rates.T @ mass @ rates,
            int(np.linalg.matrix_rank(jacobian, tol=RANK_TOLERANCE)),
            self._opening(),
        )

    def drive(
        self,
        motion: Motion,
        tree: Mapping[str, float],
        duration: float,
        foot_force: Callable[[float], np.ndarray | None] | None = None,
        *,
        lead: float = 0.0,
    ) -> DrivenRun:
        """Simulate with prescribed motors and measure.

        In each step the drives' effort is the one that puts the independent coordinates where `motion` has them one
        step later; it follows from the equations of motion with MuJoCo's own soft constraints. At the nodes the
        coordinates are then as prescribed, and the accelerations are central differences of the prescribed motion.

        Parameters
        ----------
        motion : callable
            Time to (q, v, a).
        tree : mapping of str to float
            Tree joint coordinates at time -`lead`.
        duration : float
            s.
        foot_force : callable, optional
            Time to the force on the foot, N, in the hip frame.
        lead : float
            s, how long to simulate before time 0 without recording: soft loops start unloaded and have to settle.

        Returns
        -------
        DrivenRun

        Raises
        ------
        AssemblyError
            The loops are open at the start.
        ShapeError
            The duration is shorter than two time steps.
        """
        mujoco, model, data, step = self._mujoco, self.model, self.data, self.solver.timestep
        count, before = round(duration / step) + 1, round(lead / step)
        if count < 3:
            raise ShapeError(f"a run of {duration:g} s is shorter than two time steps of {step:g} s: make it longer")
        _, rate, growth = motion(-before * step)
        # The integrator keeps the velocity of the middle of the step before.
        self.set_state(tree, rate - 0.5 * step * growth)
        size = self._driven.size
        time = step * np.arange(count)
        q, foot, force = (np.empty((count, width)) for width in (size, 3, size))
        opening = 0.0
        for node in range(-before, count):
            now = node * step
            mujoco.mj_step1(model, data)
            load = self._foot_load(None if foot_force is None else foot_force(now))
            driven = data.qpos[self._driven]
            wanted = (motion(now + step)[0] - driven - step * data.qvel[self._driven]) / step**2
            effort = self._effort(wanted, load)
            if node >= 0:
                q[node], foot[node], force[node] = driven, self.foot_position(), effort
                opening = max(opening, self._opening())
            data.qfrc_applied[:] = load
            data.qfrc_applied[self._driven] += effort
            mujoco.mj_step2(model, data)
        return DrivenRun(time, q, foot, force, opening, self.solver)

    def _effort(self, wanted: np.ndarray, load: np.ndarray) -> np.ndarray:
        """Effort for accelerations `wanted`: M a = tau + load + J^T f, J a + R f = a_ref, f the loops' forces."""
        data, nv, rows, size = self.data, self.model.nv, self.data.nefc, self._driven.size
        matrix = np.zeros((nv + rows + size, nv + rows + size))
        right = np.zeros(nv + rows + size)
        jacobian = self._jacobian()
        matrix[:nv, :nv] = self._mass()
        matrix[:nv, nv : nv + rows] = -jacobian.T
        matrix[nv : nv + rows, :nv] = jacobian
        matrix[range(nv, nv + rows), range(nv, nv + rows)] = data.efc_R
        matrix[self._driven, range(nv + rows, nv + rows + size)] = -1.0
        matrix[range(nv + rows, nv + rows + size), self._driven] = 1.0
        right[:nv] = load + data.qfrc_passive - data.qfrc_bias
        right[nv : nv + rows] = data.efc_aref
        right[nv + rows :] = wanted
        effort: np.ndarray = np.linalg.solve(matrix, right)[nv + rows :]
        return effort
