"""Ways to a torque, one function each: from a `Workload` to a `Work`."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks import native
from benchmarks.cases import NotAvailableError, Work, Workload
from benchmarks.mechanisms import symbolic_note

# ---------------------------------------------------------------------- pinocchio


def rnea(workload: Workload) -> Work:
    """The yardstick; its answer is checked after projection onto the closed motion."""
    import pinocchio as pin

    model = workload.mechanism().tree.model.copy()
    data = model.createData()
    motion = workload.tree_motion
    return Work(
        pin.rnea,
        [(model, data, q, qd, qdd) for q, _, _, qd, qdd in motion],
        # Its motion comes from the pinocchio route, so the closed form judges it.
        workload.torques("states", other=False),
        period=1,
        answer=lambda result, index: motion[index][1].T @ result,
    )


def mechanism_closed(workload: Workload) -> Work:
    mechanism = workload.mechanism()

    def torque(q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        # The three steps of `Mechanism.close` without the search for q.
        state = mechanism.state_of(q)
        return mechanism.actuator_effort(state, mechanism.generalized_force(state, v, a))

    arguments = list(zip(workload.tree_coordinates, *workload.states[1:], strict=True))
    # It is part of the pinocchio route, and held against the closed form.
    return Work(torque, arguments, workload.torques("states", other=False), period=1)


def mechanism_trajectory(workload: Workload) -> Work:
    mechanism = workload.mechanism()

    def torque(y: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        state = mechanism.close(y)
        return mechanism.actuator_effort(state, mechanism.generalized_force(state, v, a))

    return workload.along(torque, other=False)


def naive_closed(workload: Workload) -> Work:
    from benchmarks.naive import Naive

    naive = Naive(workload.closed_form.description)
    return workload.at_states(naive.torque, workload.tree_coordinates, *workload.states[1:])


def naive_trajectory(workload: Workload) -> Work:
    from benchmarks.naive import Naive

    return workload.along(Naive(workload.closed_form.description).torque_with_newton)


def naive_rows(workload: Workload, rows: int) -> Work:
    """A Python loop, closed tree coordinates given."""
    from benchmarks.naive import Naive

    naive = Naive(workload.closed_form.description)
    poses = workload.tree_coordinates[:rows]

    def torque(q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        return np.array([naive.torque(*row) for row in zip(poses, v, a, strict=True)])

    return workload.batch(torque, rows)


def _well_used(workload: Workload) -> Callable[..., np.ndarray]:
    """One rnea; passive coordinates, their rates and drift from the closed form, compiled."""
    import casadi
    import pinocchio as pin

    from leg_dynamics.kernels import Argument, Program, compile_program

    leg = workload.closed_form
    model = workload.mechanism().tree.model.copy()
    data = model.createData()
    plain = leg.backend.kernels.program("tree_coordinates")  # type: ignore[attr-defined]
    names = workload.reference.backend.tree_joint_names
    order = [leg.backend.tree_joint_names.index(name) for name in names]
    q, v = casadi.SX.sym("q", 3), casadi.SX.sym("v", 3)
    tree = plain.formula(q)[0][order]
    G = casadi.jacobian(tree, q)
    drift = casadi.jtimes(casadi.jtimes(tree, q, v), q, v)
    count = len(names)
    outputs = [tree, casadi.reshape(G.T, -1, 1), drift]
    graph = casadi.Function("tree", [q, v], [casadi.densify(x) for x in casadi.cse(outputs)] + [casadi.SX(0, 1)])
    sides = (Argument("tree", (count,)), Argument("G", (count, 3)), Argument("drift", (count,)))
    passive = compile_program(Program("tree", (Argument("q", (3,)), Argument("v", (3,))), sides, graph)).ufunc

    def torque(y: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        q, G, drift = passive(y, v)
        return pin.rnea(model, data, q, G @ v, G @ a + drift) @ G

    return torque


def well_used(workload: Workload) -> Work:
    return workload.at_states(_well_used(workload))


def well_used_rows(workload: Workload, rows: int) -> Work:
    one = _well_used(workload)

    def torque(q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        return np.array([one(*row) for row in zip(q, v, a, strict=True)])

    return workload.batch(torque, rows)


# ---------------------------------------------------------------------- MuJoCo


class _MuJoCo:
    """The leg as a MuJoCo model: hinges of the loops as pairs of points, gears as joint equalities."""

    def __init__(self, workload: Workload) -> None:
        from leg_dynamics.description.mjcf import has_mujoco, mujoco_model

        if not has_mujoco():
            raise NotAvailableError("MuJoCo is not installed: it is in the extra `bench`")
        import mujoco

        self.mujoco = mujoco
        self.model = mujoco_model(workload.closed_form.description)
        self.model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        self.data = mujoco.MjData(self.model)
        names = [self.model.joint(i).name for i in range(self.model.njnt)]
        tree = list(workload.reference.backend.tree_joint_names)
        self.order = np.array([tree.index(name) for name in names])
        self.driven = np.array([names.index(name) for name in workload.closed_form.joint_names])
        self.dependent = np.setdiff1d(np.arange(self.model.nv), self.driven)

    def motion(self, workload: Workload) -> list[tuple[np.ndarray, ...]]:
        """q, drift, qd, qdd in MuJoCo's order of joints."""
        return [
            tuple(np.ascontiguousarray(x[self.order]) for x in (q, drift, qd, qdd))
            for q, _, drift, qd, qdd in workload.tree_motion
        ]

    def raw(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """What `mj_inverse` says at the motors, given the whole closed motion of the tree."""
        data = self.data
        data.qpos[:], data.qvel[:], data.qacc[:] = q, qd, qdd
        self.mujoco.mj_inverse(self.model, data)
        return data.qfrc_inverse[self.driven]

    def projected(self, q: np.ndarray, drift: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """`mj_inverse` projected on the motions that the constraint Jacobian allows; closed q and drift given."""
        mujoco, model, data = self.mujoco, self.model, self.data
        data.qpos[:] = q
        mujoco.mj_fwdPosition(model, data)
        K = data.efc_J.reshape(data.nefc, model.nv)
        G = np.zeros((model.nv, len(self.driven)))
        G[self.driven] = np.eye(len(self.driven))
        # Closed poses are exact to rounding, and so must the rank be.
        G[self.dependent] = -np.linalg.pinv(K[:, self.dependent], rcond=1e-10) @ K[:, self.driven]
        data.qvel[:] = G @ v
        data.qacc[:] = G @ a + drift
        mujoco.mj_inverseSkip(model, data, mujoco.mjtStage.mjSTAGE_POS, 0)
        return data.qfrc_inverse @ G


def mujoco_raw(workload: Workload) -> Work:
    peer = _MuJoCo(workload)
    q, _, qd, qdd = zip(*peer.motion(workload), strict=True)
    return workload.at_states(peer.raw, q, qd, qdd)


def mujoco_projected(workload: Workload) -> Work:
    peer = _MuJoCo(workload)
    q, drift, _, _ = zip(*peer.motion(workload), strict=True)
    return workload.at_states(peer.projected, q, drift, *workload.states[1:])


def mujoco_rows(workload: Workload, rows: int) -> Work:
    peer = _MuJoCo(workload)
    given = [(q, drift) for q, drift, _, _ in peer.motion(workload)[:rows]]

    def torque(q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        return np.array([peer.projected(*pose, *row) for pose, *row in zip(given, v, a, strict=True)])

    return workload.batch(torque, rows)


# ---------------------------------------------------------------------- toolbox-parallel-robots


def toolbox(workload: Workload) -> Work:
    """The quadratic programme of toolbox-parallel-robots: torques and loop forces of a closed tree motion.

    It knows no gear couplings: their rows go in as further columns of its actuation matrix, which leaves the motors'
    torques unique.
    """
    from toolbox_parallel_robots import inverse_dynamics

    from benchmarks.naive import Naive

    naive = Naive(workload.closed_form.description)
    motors = np.zeros((naive.model.nv, len(naive.independent)))
    motors[naive.independent, np.arange(len(naive.independent))] = 1.0
    actuation = np.hstack([motors, naive.couplings.T])
    reference = np.zeros(actuation.shape[1])
    constraints = list(naive.constraints)

    def torque(q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        # It prints what it does.
        with contextlib.redirect_stdout(io.StringIO()):
            efforts, _ = inverse_dynamics.closedLoopInverseDynamicsCasadi(
                naive.model, constraints, q, qd, qdd, actuation, reference, tol=1e-12
            )
        return efforts[: motors.shape[1]]

    columns = list(zip(*workload.tree_motion, strict=True))
    return workload.at_states(torque, columns[0], columns[3], columns[4])


# ---------------------------------------------------------------------- forward dynamics


def projected(workload: Workload) -> Work:
    mechanism = workload.mechanism()

    def acceleration(q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> np.ndarray:
        state = mechanism.state_of(q)
        return mechanism.acceleration(state, v, tau)

    return workload.forward(acceleration, workload.tree_coordinates, other=False)


def constrained(algorithm: str) -> Callable[[Workload], Work]:
    """Pinocchio's own constrained dynamics on closed states: q and qd are given, nothing is factorised for it."""

    def prepare(workload: Workload) -> Work:
        from leg_dynamics.mechanism.constrained import ConstrainedDynamics

        mechanism = workload.mechanism()
        dynamics = ConstrainedDynamics(mechanism)
        closed = [mechanism.close(q) for q in workload.states[0]]

        def acceleration(state: Any, v: np.ndarray, tau: np.ndarray) -> np.ndarray:
            return dynamics.acceleration(state, v, tau, algorithm=algorithm)  # type: ignore[arg-type]

        return workload.forward(acceleration, closed)

    return prepare


# ---------------------------------------------------------------------- the symbolic route


def symbolic_fixed(workload: Workload) -> Work:
    return workload.at_states(workload.symbolic.torque, note=symbolic_note(workload.symbolic))


def symbolic_rows(workload: Workload, rows: int) -> Work:
    return workload.batch(workload.symbolic.torque, rows, note=symbolic_note(workload.symbolic))


# ---------------------------------------------------------------------- the closed form


def _vectorised(workload: Workload) -> Callable[..., np.ndarray]:
    route: Any = workload.closed_form.backend
    module, numbers = route.module, route.numbers
    parameters = module.composite_parameters(numbers)

    def formula(leg: Any, q: Any, v: Any, a: Any) -> Any:
        return module.composite_inverse_dynamics(leg, parameters, q, v, a, leg.gravity)

    return lambda q, v, a: route.plain(formula, q, v, a)


def plain_formulas(workload: Workload) -> Work:
    return workload.at_states(_vectorised(workload))


def vectorised_rows(workload: Workload, rows: int) -> Work:
    """The formulas on NumPy arrays, in blocks that stay in the cache."""
    return workload.batch(_vectorised(workload), rows)


def kernel_alone(workload: Workload) -> Work:
    """The compiled gufunc without the interface around it."""
    return workload.at_states(workload.closed_form.backend.kernel("torque").ufunc)  # type: ignore[attr-defined]


def limit_by_row(workload: Workload) -> Work:
    """The limit called once a row inside C."""
    kernel = native.limit(workload.closed_form, "torque_by_row")
    arguments, expected = workload.rows(workload.settings.states)
    out = np.empty_like(arguments[0])
    return Work(lambda q, v, a: kernel(q, v, a, out), [arguments], [expected], period=1)


def _into(function: Callable[..., Any], workload: Workload, rows: int) -> Work:
    """A batch with the output given."""
    out = np.empty_like(workload.rows(rows)[0][0])
    return workload.batch(lambda q, v, a: function(q, v, a, out), rows)


def limit_rows(workload: Workload, rows: int) -> Work:
    return _into(native.limit(workload.closed_form), workload, rows)


def limit_on_two_threads(workload: Workload, rows: int) -> Work:
    return _into(native.limit(workload.closed_form).threaded(2), workload, rows)


def generated_rows(workload: Workload, rows: int) -> Work:
    return _into(native.generated(workload.closed_form), workload, rows)


def kernel_rows(workload: Workload, rows: int) -> Work:
    ufunc = workload.closed_form.backend.kernel("torque").ufunc  # type: ignore[attr-defined]
    return _into(lambda q, v, a, out: ufunc(q, v, a, out=out), workload, rows)


def torque_into_rows(workload: Workload, rows: int, threads: int = 1) -> Work:
    import leg_dynamics as ld

    leg = ld.load(workload.name, route="closed_form", threads=threads)
    return _into(lambda q, v, a, out: leg.torque(q, v, a, out=out), workload, rows)
