"""Programs of a closed-loop mechanism: each method as one SX graph with a Newton solver before it.

Inverse dynamics needs no matrix G: with the rows' second derivative D at zd = -K_z^-1 K_y v and zdd = 0,

    zdd = -K_z^-1 D,    tau = tau_y - K_y^T K_z^-T tau_z,    (tau_y, tau_z) = virtual work of the bodies' loads,

three solutions with one factor, however many independent coordinates there are.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import casadi
import numpy as np

from leg_dynamics.description.model import STANDSTILL
from leg_dynamics.errors import ActuationError, MissingFootError
from leg_dynamics.kernels.program import Argument, Program, Solver
from leg_dynamics.symbolic.closure import evaluate_rows, second_derivatives
from leg_dynamics.symbolic.dynamics import Load, project, tree_loads
from leg_dynamics.symbolic.elimination import Factor, choose_pivots
from leg_dynamics.symbolic.model import Model
from leg_dynamics.symbolic.motion import Motion, Orientation
from leg_dynamics.symbolic.numbers import Numbers
from leg_dynamics.symbolic.scalars import ZERO, Scalar, Vector, add, dot, is_zero, mul, neg, sub, total

__all__ = ["Graphs"]

# A pivot this much smaller than its row's usual size: the row goes to the fallback.
SMALLEST_PIVOT = 1e-7
# Pivots of the mass matrix with unit diagonal: below this a motion has no mass of its own.
SMALLEST_MASS = 1e-6
# The actuators hold every motion: pivots of their transfer relative to its rows.
SMALLEST_TRANSFER = 1e-7
TOLERANCE = 1e-13
# Residual of every loop row, dimensionless, and cosine of axes that must point the same way.
CLOSED = 1e-9
SAME_WAY_COSINE = 0.5
# Largest changes of the independent coordinates in one stage that are tried at closed samples, rad or shares of the
# mechanism's length. This share of the largest one that always arrives is used.
CONTINUATION_STEPS = (1.2, 1.0, 0.8, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1)
CONTINUATION_SHARE = 0.7
# Samples at the edge of the mode's reach are not reached with any step.
LOST_SHARE = 0.01
ITERATIONS = 12
NEWTON_TRIALS = 8
MOST_STAGES = 64
# A walk: its longest step in the coordinates' norm, rad or shares of the length; how far off the closed pose it may
# be, and how far off it may be to go on; its steps; the share of a step that the determinant allows.
WALK_STEP = 0.4
WALK_LOST = 0.5
WALK_ON = 0.05
WALK_ITERATIONS = 120
WALK_TOLERANCE = 2e-13
WALK_SHARE = 0.8
WALK_PHASE = 0.7
# On a walk pivots may change their signs, their product not: only their size counts.
SMALLEST_WALK_PIVOT = 1e-5


class _State:
    """The closed pose: symbols of u, the loop rows' derivatives and their factor."""

    def __init__(self, model: Model, y: Sequence[Scalar], z: Sequence[Scalar]) -> None:
        self.model = model
        self.u: Sequence[Scalar] = [*y, *z]
        self.pose = Motion(self.with_extras(self.u))
        self.closing: list[Scalar] = []
        if model.explicit is not None:
            self.pose, self.closing = model.explicit.solve(y)
            self.u = self.pose.u
        self.ground: Orientation = model.ground
        n, nz = model.n, model.nz
        self.residuals, partials = evaluate_rows(model.rows, self.pose)
        partials = [self._without_extras(row) for row in partials]
        self.K_y = [[row.get(k, 0.0) for k in range(n)] for row in partials]
        entries: list[dict[int, Scalar]] = []
        for i, row in enumerate(partials):
            entries.append({j: row.get(n + model.columns[j], 0.0) for j in range(nz) if model.pattern[i, j] or i == j})
        self.factor = Factor(entries)

    def with_extras(self, values: Sequence[Scalar], constant: bool = True) -> list[Scalar]:
        """Values of u's coordinates, or (not `constant`) their rates, and those of the extra coordinates."""
        result = list(values)
        for extra in self.model.extras:
            value: Scalar = extra.value if constant else 0.0
            for k, slope in extra.slopes.items():
                value = add(value, mul(slope, values[k]))
            result.append(value)
        return result

    def _without_extras(self, derivatives: dict[int, Scalar]) -> dict[int, Scalar]:
        """Derivatives by u alone, from those by u and the extra coordinates."""
        size = self.model.n + self.model.nz
        result = {k: x for k, x in derivatives.items() if k < size}
        for number, extra in enumerate(self.model.extras):
            along = derivatives.get(size + number, 0.0)
            for k, slope in extra.slopes.items():
                result[k] = add(result.get(k, 0.0), mul(slope, along))
        return result

    def solve(self, right: Sequence[Scalar]) -> list[Scalar]:
        """K_z^-1 right, in the order of z."""
        result: list[Scalar] = [0.0] * self.model.nz
        for column, value in zip(self.model.columns, self.factor.solve(right), strict=True):
            result[column] = value
        return result

    def solve_transposed(self, right: Sequence[Scalar]) -> list[Scalar]:
        """K_z^-T right, in the order of the rows; `right` in the order of z."""
        return self.factor.solve_transposed([right[column] for column in self.model.columns])

    def times_K_y(self, v: Sequence[Scalar]) -> list[Scalar]:
        """K_y v."""
        return [total(mul(entry, x) for entry, x in zip(row, v, strict=True)) for row in self.K_y]

    def reduce(self, tau: Sequence[Scalar]) -> list[Scalar]:
        """Generalised forces at y that do the same work as those at u and the extra coordinates."""
        n = self.model.n
        tau = self._at_u(tau)
        if not self.model.nz:
            return list(tau[:n])
        multipliers = self.solve_transposed(tau[n:])
        result = list(tau[:n])
        for i, multiplier in enumerate(multipliers):
            for k in range(n):
                result[k] = sub(result[k], mul(self.K_y[i][k], multiplier))
        return result

    def _at_u(self, tau: Sequence[Scalar]) -> list[Scalar]:
        folded = self._without_extras(dict(enumerate(tau)))
        return [folded[k] for k in range(self.model.n + self.model.nz)]

    @cached_property
    def directions(self) -> list[list[Scalar]]:
        """du/dy_k as columns: n lists of nu scalars."""
        columns = []
        for k in range(self.model.n):
            z = self.solve([neg(row[k]) for row in self.K_y])
            columns.append([*(1.0 if j == k else 0.0 for j in range(self.model.n)), *z])
        return columns

    def rates(self, v: Sequence[Scalar]) -> list[Scalar]:
        """Rates of u at the independent velocities v."""
        return [*v, *self.solve([neg(x) for x in self.times_K_y(v)])]

    def moving(self, rates: Sequence[Scalar], accelerations: Sequence[Scalar]) -> Motion:
        """The motion at this pose; what depends on the pose alone is shared."""
        return self.pose.moving(self.with_extras(rates, False), self.with_extras(accelerations, False))

    def accelerations(self, rates: Sequence[Scalar], a: Sequence[Scalar]) -> list[Scalar]:
        """Accelerations of u at the independent accelerations a."""
        if not self.model.nz:
            return list(a)
        drift = second_derivatives(self.model.rows, self.moving(rates, [0.0] * len(self.u)))
        pushed = self.times_K_y(a)
        return [*a, *self.solve([neg(add(x, y)) for x, y in zip(drift, pushed, strict=True)])]

    @property
    def guards(self) -> list[Scalar]:
        """At least 0 where every pivot is large enough and has the seed's sign."""
        model = self.model
        values = list(self.closing)
        for pivot, sign, size in zip(self.factor.pivots, model.signs, model.sizes, strict=True):
            if not isinstance(pivot, float):
                if model.walks:
                    values.append(casadi.fabs(pivot) - SMALLEST_WALK_PIVOT * size)
                else:
                    values.append(sign * pivot - SMALLEST_PIVOT * size)
        return values + self._room() + self._checks()

    def _room(self) -> list[Scalar]:
        """At least 0 in the box in which no way from home meets a singular pose, where ways are not walked."""
        regularity = self.model.regularity
        if regularity is None or regularity.crosses:
            return []
        values: list[Scalar] = []
        for y, lower, upper in zip(self.u, regularity.lower.tolist(), regularity.upper.tolist(), strict=False):
            if lower > -np.inf:
                values.append(y - lower)
            if upper < np.inf:
                values.append(upper - y)
        return values

    def _checks(self) -> list[Scalar]:
        """At least 0 where all loops are closed, also by rows that were not solved, and no pair is turned over."""
        residuals, _ = evaluate_rows(self.model.checked, self.pose, columns=False)
        # A sum, because the larger of a number and NaN is the number.
        open_by = total(casadi.fabs(value) for value in residuals if not isinstance(value, float))
        checks = [] if is_zero(open_by) else [CLOSED - open_by]
        cosines, _ = evaluate_rows(self.model.same_way, self.pose, columns=False)
        return checks + [cosine - SAME_WAY_COSINE for cosine in cosines if not isinstance(cosine, float)]


def _follow(step: casadi.Function, start: np.ndarray, y: np.ndarray, stages: np.ndarray) -> np.ndarray:
    """Unknowns (S, nz) at y (S, n), by Newton's method in the given numbers of stages from one state `start` (nu,)."""
    count, n = y.shape
    mapped = step.map(count)
    z = np.tile(start[n:], (count, 1))
    stages = np.maximum(stages, 1.0)
    begin = np.tile(start[:n], (count, 1))
    for stage in range(1, int(stages.max()) + 1):
        s = np.minimum(stage / stages, 1.0)[None]
        active = (stage <= stages)[:, None]
        for _ in range(NEWTON_TRIALS):
            change, _ = mapped(y.T, begin.T, np.tile(start[n:], (count, 1)).T, s, z.T)
            change = np.asarray(change).T
            z = np.where(active, z - change, z)
            if not (np.abs(change[active[:, 0]]) > 1e-14).any():
                break
    return z


def _column(values: Sequence[Scalar]) -> casadi.SX:
    column: casadi.SX = casadi.SX(casadi.vertcat(*values)) if len(values) else casadi.SX(0, 1)
    return column


def _entries(symbol: casadi.SX) -> list[casadi.SX]:
    return [symbol[i] for i in range(symbol.numel())]


class _Build:
    """Symbols of one Program and what it is made of."""

    def __init__(self, model: Model, names: Sequence[str], continuation_step: float) -> None:
        self.model = model
        self.continuation_step = continuation_step
        sizes = {"foot_force": 3, "gravity": 3, "tau": len(model.actuated)}
        self.arguments = [Argument(name, (sizes.get(name, model.n),)) for name in names]
        # A walk begins at home: where it leads must not depend on what was asked before.
        if model.restarts:
            self.arguments += [Argument("y_start", (model.n,)), Argument("z_start", (model.nz,))]
        self.symbols = {arg.name: casadi.SX.sym(arg.name, arg.size) for arg in self.arguments}
        self.z = casadi.SX.sym("z", model.nz if model.iterates else 0)
        self.values = {name: _entries(symbol) for name, symbol in self.symbols.items()}
        self.state = _State(model, self.values["q"], _entries(self.z))
        self.guards = list(self.state.guards)
        if model.restarts:
            self.guards.append(MOST_STAGES - self._stages(self.values["q"], self.values["y_start"]))

    def __getitem__(self, name: str) -> list[casadi.SX]:
        return self.values[name]

    def vector(self, name: str) -> Vector:
        """A three-component input."""
        x, y, z = self.values[name]
        return (x, y, z)

    def _stages(self, y: Sequence[casadi.SX], start: Sequence[casadi.SX]) -> casadi.SX:
        """Scaled distance from the start, in continuation steps."""
        step = self.continuation_step * self.model.unit
        result = casadi.SX(0)
        for k in range(self.model.n):
            result = casadi.fmax(result, casadi.fabs(y[k] - start[k]) / float(step[k]))
        return result

    @cached_property
    def solver(self) -> Solver:
        """Newton's method for z."""
        model = self.model
        inputs = list(self.symbols.values())
        s = casadi.SX.sym("s")
        start, end = self["y_start"], self["q"]
        y = [a + s * (b - a) for a, b in zip(start, end, strict=True)]
        there = _State(model, y, _entries(self.z))
        # A sum, because the larger of a number and NaN is the number.
        residual = casadi.SX(total(casadi.fabs(value) for value in there.residuals))
        step = there.solve(there.residuals)
        # NaN where a pivot has lost the seed's sign: the way there leads over a singular pose of the chosen rows, and
        # behind it another assembly mode may be found with the right signs again. The row cannot recover.
        least = casadi.SX(1.0)
        for pivot, sign in zip(there.factor.pivots, model.signs, strict=True):
            if not isinstance(pivot, float):
                least = casadi.fmin(least, sign * pivot)
        kept = casadi.sqrt(least) / casadi.sqrt(casadi.fabs(least))
        step = [value * kept for value in step]
        return Solver(
            size=model.nz,
            start=_function("start", inputs, [self.symbols["z_start"]], model.numbers),
            stages=_function("stages", inputs, [self._stages(end, start)], model.numbers),
            step=_function("step", [*inputs, s, self.z], [_column(step), residual], model.numbers),
            tolerance=TOLERANCE,
            iterations=ITERATIONS,
            most_stages=MOST_STAGES,
        )

    @cached_property
    def walk(self) -> Solver:
        """Walk the straight way from home to q and see on every step that no singular pose lies on it.

        One iteration makes one step along the way's tangent, as far as the determinant's square f cannot vanish
        by its slope and the bound of its curvature, and one of Newton's across it. The share s of the way is an unknown
        beside z.
        """
        model = self.model
        regularity = model.regularity
        assert regularity is not None
        assert regularity.block is not None
        n, nz = model.n, model.nz
        inputs = list(self.symbols.values())
        z, s, unused = casadi.SX.sym("z", nz), casadi.SX.sym("s"), casadi.SX.sym("stage")
        home = [float(x) for x in model.seed[:n]]
        change = [end - begin for begin, end in zip(home, self["q"], strict=True)]
        there = _State(model, [begin + s * x for begin, x in zip(home, change, strict=True)], _entries(z))
        tangent = there.solve([neg(x) for x in there.times_K_y(change)])
        correction = there.solve(there.residuals)
        value = casadi.SX(regularity.block.determinant(there.pose))
        arguments = casadi.vertcat(s, z)
        slope = casadi.jtimes(value, arguments, casadi.vertcat(1.0, _column(tangent)))
        f = value * value / regularity.scale - regularity.floor
        slope = 2.0 * value * slope / regularity.scale
        units = [float(x) for x in model.unit]
        farthest = casadi.SX(0)
        for x, unit in zip(change, units, strict=False):
            farthest = casadi.fmax(farthest, casadi.fabs(x) / unit)
        # At home itself the way has no length, and the step is any.
        squared = farthest * farthest + 1e-12
        bend = (regularity.bend + regularity.bend_share * casadi.fmax(f, 0.0)) * squared
        allowed = WALK_SHARE * (slope + casadi.sqrt(slope * slope + 2.0 * bend * f)) / bend
        speed = total((x / unit) * (x / unit) for x, unit in zip([*change, *tangent], units, strict=True))
        # The bound of the bend is one of f at the same place: it holds for a part of f's oscillation.
        slowest = casadi.fmax(speed / WALK_STEP**2, squared * (regularity.bend_share / WALK_PHASE**2))
        allowed = casadi.fmin(allowed, 1.0 / casadi.sqrt(slowest + 1e-12))
        off = total((x / unit) * (x / unit) for x, unit in zip(correction, units[n:], strict=True))
        # NaN behind a singular pose, and where the walk has lost the closed pose: the row ends. Newton's iterates where
        # no closed pose is left wander about until they fall into another mode, but not without a change of sign.
        fine = casadi.fmin(f, regularity.sign * value)
        fine = casadi.fmin(fine, WALK_LOST**2 - off) if nz else fine
        # 0 or NaN. Added, since CasADi takes a factor into the choice below, which then takes NaN out again.
        lost = casadi.sqrt(fine) - casadi.sqrt(casadi.fabs(fine))
        left = 1.0 - s
        ahead = casadi.fmin(allowed, left)
        if nz:
            ahead = casadi.if_else(off <= WALK_ON**2, ahead, 0.0)
        ahead = ahead + lost
        residual = total(casadi.fabs(x) for x in there.residuals) + casadi.fabs(left) + lost
        step = [x - ahead * y for x, y in zip(correction, tangent, strict=True)]
        start = [casadi.SX(float(x)) for x in [*model.seed[n:], 0.0]]
        return Solver(
            size=nz + 1,
            start=_function("start", inputs, [_column(start)], model.numbers),
            stages=_function("stages", inputs, [casadi.SX(1.0)], model.numbers),
            step=_function(
                "step", [*inputs, unused, casadi.vertcat(z, s)], [_column([*step, -ahead]), residual], model.numbers
            ),
            tolerance=WALK_TOLERANCE,
            iterations=WALK_ITERATIONS,
            most_stages=1,
        )

    def program(self, name: str, outputs: Sequence[tuple[str, tuple[int, ...], Sequence[Scalar]]]) -> Program:
        """Pack outputs, each (name, shape, entries row by row), into a Program; z comes last, for the next start."""
        inputs = list(self.symbols.values())
        solver = None
        if self.model.walks:
            inputs.append(casadi.vertcat(self.z, casadi.SX.sym("s")))
            solver = self.walk
        elif self.model.restarts:
            inputs.append(self.z)
            solver = self.solver
            unknowns = ("z", (self.model.nz,), _entries(self.z))
            outputs = [*outputs, unknowns]
        columns = [_column(values) for _, _, values in outputs]
        formula = _function(name, inputs, [*columns, _column(self.guards)], self.model.numbers)
        return Program(
            name=name,
            inputs=tuple(self.arguments),
            outputs=tuple(Argument(label, shape) for label, shape, _ in outputs),
            formula=formula,
            solver=solver,
        )


def _function(name: str, inputs: list[casadi.SX], outputs: list[casadi.SX], numbers: Numbers) -> casadi.Function:
    """Function of the inputs, parameters replaced by their values in the file."""
    dense = [casadi.densify(casadi.SX(output)) for output in outputs]
    if numbers.symbols:
        symbols = casadi.vertcat(*numbers.symbols)
        dense = casadi.substitute(dense, [symbols], [casadi.SX(casadi.DM(numbers.nominal))])
    return casadi.Function(name, inputs, casadi.cse(dense))


class Graphs:
    """The Programs of one mechanism, each made when it is asked for.

    Inputs are ``q`` and, as the method needs them, ``v``, ``a``, ``tau``, ``foot_force``, ``gravity``; where loops are
    closed by Newton's method alone, ``y_start`` and ``z_start`` follow: a closed pose to start from.

    Parameters
    ----------
    model : Model
    """

    def __init__(self, model: Model) -> None:
        self.model = model

    def _build(self, names: Sequence[str]) -> _Build:
        return _Build(self.model, names, self.continuation_step)

    @cached_property
    def continuation_step(self) -> float:
        """How far the independent coordinates may move in one stage of Newton's method, found by trial.

        From the seed to every closed sample, with ever smaller stages, until nearly as many arrive at that very pose as
        with the smallest; another pose, or the same a whole turn away, does not count.
        """
        model = self.model
        if not model.restarts:
            return CONTINUATION_STEPS[0]
        solver = _Build(model, ["q"], 1.0).solver
        n, start, target = model.n, model.seed, model.samples
        distance = np.abs((target[:, :n] - start[:n]) / model.unit[:n]).max(axis=1)
        arrived: list[int] = []
        for step in CONTINUATION_STEPS:
            z = _follow(solver.step, start, target[:, :n], np.ceil(distance / step))
            error = np.abs((z - target[:, n:]) / model.unit[n:]).max(axis=1)
            arrived.append(int((error < 1e-6).sum()))
        enough = max(arrived) - LOST_SHARE * len(target)
        for step, count in zip(CONTINUATION_STEPS, arrived, strict=True):
            if count >= enough:
                return CONTINUATION_SHARE * step
        return CONTINUATION_SHARE * CONTINUATION_STEPS[-1]

    # ------------------------------------------------------------------ kinematics

    def tree_coordinates(self) -> Program:
        """All tree joint coordinates that close the loops, in the tree's order."""
        build = self._build(["q"])
        values = [joint.form.of(build.state.pose.u) for joint in self.model.tree.joints]
        return build.program("tree_coordinates", [("tree_coordinates", (len(values),), values)])

    def _foot(self) -> None:
        if self.model.foot is None:
            raise MissingFootError("the foot is not named: load the mechanism with foot='LINK'")

    def foot_position(self) -> Program:
        """Foot position, (3,) m."""
        self._foot()
        build = self._build(["q"])
        assert self.model.foot is not None
        return build.program("foot_position", [("position", (3,), build.state.pose.position(self.model.foot))])

    def _foot_jacobian(self, state: _State) -> list[Scalar]:
        assert self.model.foot is not None
        partials = state.pose.partials(self.model.foot)
        rows = []
        for i in range(3):
            for direction in state.directions:
                along = enumerate(state.with_extras(direction, False))
                rows.append(total(mul(partials.get(k, ZERO)[i], x) for k, x in along if not is_zero(x)))
        return rows

    def foot_jacobian(self) -> Program:
        """Foot Jacobian, (3, n)."""
        self._foot()
        build = self._build(["q"])
        entries = self._foot_jacobian(build.state)
        return build.program("foot_jacobian", [("jacobian", (3, self.model.n), entries)])

    def foot_jacobian_derivative(self) -> Program:
        """Time derivative of the foot Jacobian, (3, n)."""
        self._foot()
        build = self._build(["q", "v"])
        J = _column(self._foot_jacobian(build.state))
        rates = _column(build.state.rates(build["v"]))
        if self.model.iterates:
            rate = casadi.jtimes(J, casadi.vertcat(build.symbols["q"], build.z), rates)
        else:
            rate = casadi.jtimes(J, build.symbols["q"], build.symbols["v"])
        return build.program("foot_jacobian_derivative", [("jacobian_derivative", (3, self.model.n), _entries(rate))])

    def foot_bias_acceleration(self) -> Program:
        """Foot acceleration at zero acceleration of the independent coordinates, (3,) m/s²."""
        self._foot()
        build = self._build(["q", "v"])
        assert self.model.foot is not None
        rates = build.state.rates(build["v"])
        accelerations = build.state.accelerations(rates, [0.0] * self.model.n)
        value = build.state.moving(rates, accelerations).acceleration(self.model.foot)
        return build.program("foot_bias_acceleration", [("acceleration", (3,), value)])

    # ------------------------------------------------------------------ dynamics

    def _generalized(
        self,
        state: _State,
        v: Sequence[Scalar],
        a: Sequence[Scalar],
        foot_force: Vector | None,
        gravity: Vector,
    ) -> list[Scalar]:
        """Inverse dynamics at the independent coordinates."""
        rates = state.rates(v)
        return self._force(state, v, rates, state.accelerations(rates, a), foot_force, gravity)

    def _force(
        self,
        state: _State,
        v: Sequence[Scalar],
        rates: Sequence[Scalar],
        accelerations: Sequence[Scalar],
        foot_force: Vector | None,
        gravity: Vector,
    ) -> list[Scalar]:
        model = self.model
        motion = state.moving(rates, accelerations)
        loads = tree_loads(model.bodies, motion, gravity)
        if foot_force is not None:
            assert model.foot is not None
            force = (neg(foot_force[0]), neg(foot_force[1]), neg(foot_force[2]))
            loads.append(Load(model.foot, force, state.ground, ZERO))
        tau = project(loads, motion, len(motion.u))
        self._add_joint_forces(tau, v, motion)
        return state.reduce(tau)

    def _add_joint_forces(self, tau: list[Scalar], v: Sequence[Scalar], motion: Motion) -> None:
        """Damping, Coulomb friction and rotor inertia, on the joint side."""
        share: Scalar = None
        for joint in self.model.tree.joints:
            force: Scalar = 0.0
            if not is_zero(joint.rotor):
                force = add(force, mul(joint.rotor, motion.acceleration_of(joint.form.linear)))
            if not (is_zero(joint.damping) and is_zero(joint.friction)):
                rate = motion.rate_of(joint.form.linear)
                force = add(force, mul(joint.damping, rate))
                if not is_zero(joint.friction) and not is_zero(rate):
                    if share is None:
                        units = self.model.unit
                        share = STANDSTILL * total(casadi.fabs(x) / float(units[k]) for k, x in enumerate(v))
                    moves = casadi.fabs(rate) / joint.unit > share
                    force = add(force, joint.friction * casadi.if_else(moves, casadi.sign(rate), 0.0))
            for k, coefficient in joint.form.terms:
                tau[k] = add(tau[k], mul(coefficient, force))

    def _transfer(self, state: _State) -> list[list[Scalar]]:
        """Rates of the actuated joints per independent velocity: m lists of n scalars."""
        forms = {joint.name: joint.form for joint in self.model.tree.joints}
        directions = [state.with_extras(direction, False) for direction in state.directions]
        return [[forms[name].rate(direction) for direction in directions] for name in self.model.actuated]

    def actuator_jacobian(self) -> Program:
        """Rates of the actuated joints per independent velocity, (m, n)."""
        build = self._build(["q"])
        transfer = self._transfer(build.state)
        shape = (len(transfer), self.model.n)
        return build.program("actuator_jacobian", [("A", shape, [x for row in transfer for x in row])])

    def _effort(self, build: _Build, generalized: Sequence[Scalar]) -> list[Scalar]:
        """Actuator efforts that do the same work as a generalised force at y."""
        model = self.model
        independent = model.coordinates.names[: model.n]
        if sorted(model.actuated) == sorted(independent):
            return [generalized[independent.index(name)] for name in model.actuated]
        if len(model.actuated) != model.n:
            raise ActuationError.of_counts("the mechanism", independent, model.actuated)
        transfer = self._transfer(build.state)
        sampled = self._sampled_transfer()
        # Work balance: sum over actuators of transfer[actuator][k] effort = force[k].
        pivots = choose_pivots(sampled, [1.0] * model.n, [0] * model.n)
        matrix = [
            {j: transfer[column][row] for j, column in enumerate(pivots.columns) if pivots.pattern[i, j]}
            for i, row in enumerate(pivots.rows)
        ]
        factor = Factor(matrix)
        for pivot, sign, size in zip(factor.pivots, pivots.signs, pivots.sizes, strict=True):
            if not isinstance(pivot, float):
                build.guards.append(sign * pivot - SMALLEST_TRANSFER * size)
            elif pivot == 0.0:
                build.guards.append(-1.0)
        solved = factor.solve([generalized[row] for row in pivots.rows])
        efforts: list[Scalar] = [0.0] * model.n
        for column, value in zip(pivots.columns, solved, strict=True):
            efforts[column] = value
        return efforts

    def _sampled_transfer(self) -> np.ndarray:
        """Transposed transfer (S, n, m) at closed samples, for the choice of pivots."""
        forms = {joint.name: joint.form for joint in self.model.tree.joints}
        directions = self.model.directions[np.isfinite(self.model.directions).all(axis=(1, 2))]
        rates = [directions[:, k] for k in range(directions.shape[1])]
        # At the file's numbers extra coordinates rest.
        rates += [np.zeros(len(directions)) for _ in self.model.extras]
        return np.stack([np.asarray(forms[name].rate(rates)) for name in self.model.actuated], axis=-1)

    def mass_matrix(self) -> Program:
        """Mass matrix at the independent coordinates, (n, n)."""
        build = self._build(["q"])
        M = self._mass_matrix(build.state)
        return build.program("mass_matrix", [("M", (self.model.n, self.model.n), [x for row in M for x in row])])

    def _mass_matrix(self, state: _State) -> list[list[Scalar]]:
        n, size = self.model.n, len(state.pose.u)
        M: list[list[Scalar]] = [[0.0] * n for _ in range(n)]
        still: list[Scalar] = [0.0] * size
        for k in range(n):
            motion = state.moving(still, state.directions[k])
            tau = project(tree_loads(self.model.bodies, motion, ZERO), motion, size)
            for joint in self.model.tree.joints:
                if not is_zero(joint.rotor):
                    force = mul(joint.rotor, motion.acceleration_of(joint.form.linear))
                    for index, coefficient in joint.form.terms:
                        tau[index] = add(tau[index], mul(coefficient, force))
            for j in range(k + 1):
                along = state.with_extras(state.directions[j], False)
                M[j][k] = M[k][j] = total(mul(x, y) for x, y in zip(along, tau, strict=True))
        return M

    def bias(self) -> Program:
        """Generalised force at zero acceleration, (n,)."""
        build = self._build(["q", "v", "gravity"])
        force = self._generalized(build.state, build["v"], [0.0] * self.model.n, None, build.vector("gravity"))
        return build.program("bias", [("bias", (self.model.n,), force)])

    def potential_energy(self) -> Program:
        """Potential energy of gravity, J, zero for masses at the hip's origin."""
        build = self._build(["q", "gravity"])
        moment = build.state.pose.position(self.model.moment)
        return build.program("potential_energy", [("energy", (), [neg(dot(build.vector("gravity"), moment))])])

    def _inverse(self, efforts: bool) -> tuple[_Build, list[Scalar]]:
        names = ["q", "v", "a", *(["foot_force"] if self.model.foot is not None else []), "gravity"]
        build = self._build(names)
        foot_force = build.vector("foot_force") if self.model.foot is not None else None
        force = self._generalized(build.state, build["v"], build["a"], foot_force, build.vector("gravity"))
        return build, self._effort(build, force) if efforts else force

    def generalized_force(self) -> Program:
        """Inverse dynamics at the independent coordinates, (n,); without a foot there is no ``foot_force``."""
        build, force = self._inverse(efforts=False)
        return build.program("generalized_force", [("force", (self.model.n,), force)])

    def torque(self) -> Program:
        """Inverse dynamics at the actuators, (m,); without a foot there is no ``foot_force``."""
        build, effort = self._inverse(efforts=True)
        return build.program("torque", [("torque", (len(effort),), effort)])

    def _forward(
        self, build: _Build
    ) -> tuple[list[Scalar], list[list[Scalar]], Callable[[list[Scalar]], list[Scalar]]]:
        """Accelerations, the drive's transfer, and the solver of M x = right."""
        model, state = self.model, build.state
        foot_force = build.vector("foot_force") if model.foot is not None else None
        rates = [
            total(mul(direction[k], x) for direction, x in zip(state.directions, build["v"], strict=True))
            for k in range(len(state.u))
        ]
        accelerations = state.accelerations(rates, [0.0] * model.n)
        bias = self._force(state, build["v"], rates, accelerations, foot_force, build.vector("gravity"))
        transfer = self._transfer(state)
        right = []
        for k in range(model.n):
            drive = total(mul(row[k], x) for row, x in zip(transfer, build["tau"] if transfer else [], strict=True))
            right.append(sub(drive, bias[k]))
        M = self._mass_matrix(state)
        factor = Factor([dict(enumerate(row)) for row in M])
        for k, pivot in enumerate(factor.pivots):
            margin = sub(pivot, mul(SMALLEST_MASS, M[k][k]))
            if not isinstance(margin, float):
                build.guards.append(margin)
            elif not margin > 0.0:
                # A motion that carries nothing in any pose: no row is valid.
                build.guards.append(-1.0)
        return factor.solve(right), transfer, factor.solve

    def _forward_names(self) -> list[str]:
        return [
            "q",
            "v",
            *(["tau"] if self.model.actuated else []),
            *(["foot_force"] if self.model.foot is not None else []),
            "gravity",
        ]

    def acceleration(self) -> Program:
        """Forward dynamics: M ydd = G_a^T tau - bias + J^T foot_force, (n,)."""
        build = self._build(self._forward_names())
        result, _, _ = self._forward(build)
        return build.program("acceleration", [("acceleration", (self.model.n,), result)])

    # ------------------------------------------------------------------ derivatives

    def _total(self, build: _Build, values: Sequence[Scalar]) -> list[Scalar]:
        """Derivatives along the loops with respect to the independent coordinates, (values, n) row by row."""
        if not self.model.iterates:
            return _rows(casadi.jacobian(_column(values), build.symbols["q"]))
        u = casadi.vertcat(build.symbols["q"], build.z)
        directions = casadi.horzcat(*(_column(direction) for direction in build.state.directions))
        return _rows(casadi.jtimes(_column(values), u, directions))

    def torque_derivatives(self) -> Program:
        """Actuator efforts differentiated by q, v and a, columns side by side, (m, 3 n)."""
        build, effort = self._inverse(efforts=True)
        column, n = _column(effort), self.model.n
        by_v = _rows(casadi.jacobian(column, build.symbols["v"]))
        by_a = _rows(casadi.jacobian(column, build.symbols["a"]))
        blocks = [(self._total(build, effort), n), (by_v, n), (by_a, n)]
        entries = _side_by_side(blocks, len(effort))
        return build.program("torque_derivatives", [("derivatives", (len(effort), 3 * n), entries)])

    def _unbalanced(self) -> tuple[_Build, list[Scalar], list[list[Scalar]], Callable[..., Any], Callable[..., Any]]:
        """The balance G_a^T tau - M ydd - h at the solution of forward dynamics, ready to be differentiated.

        Returned are its n entries as functions of the symbol `a`, the drive's transfer, the solver of M x = right, and
        the function that puts the solution in the place of `a`.
        """
        model = self.model
        build = self._build(self._forward_names())
        accelerations, transfer, solve = self._forward(build)
        a = casadi.SX.sym("a", model.n)
        foot_force = build.vector("foot_force") if model.foot is not None else None
        force = self._generalized(build.state, build["v"], _entries(a), foot_force, build.vector("gravity"))
        drive = [
            total(mul(row[k], x) for row, x in zip(transfer, build["tau"] if transfer else [], strict=True))
            for k in range(model.n)
        ]
        solution = _column(accelerations)

        def settle(matrices: Sequence[casadi.SX]) -> list[casadi.SX]:
            return list(casadi.substitute(list(matrices), [a], [solution]))

        return build, [sub(d, f) for d, f in zip(drive, force, strict=True)], transfer, solve, settle

    def acceleration_derivatives(self) -> Program:
        """Accelerations differentiated by q, v and the actuator efforts, columns side by side, (n, 2 n + m).

        The balance M ydd + h = G_a^T tau is differentiated at its solution, and M is solved once for each column.
        """
        n = self.model.n
        build, unbalanced, transfer, solve, settle = self._unbalanced()
        by_q = casadi.reshape(_column(self._total(build, unbalanced)), n, n).T
        by_v = casadi.jacobian(_column(unbalanced), build.symbols["v"])
        columns = [solve(_entries(casadi.densify(each[:, k]))) for each in settle([by_q, by_v]) for k in range(n)]
        columns += [solve(list(row)) for row in transfer]
        entries = [column[i] for i in range(n) for column in columns]
        return build.program("acceleration_derivatives", [("derivatives", (n, len(columns)), entries)])

    def torque_parameter_derivatives(self) -> Program:
        """Actuator efforts differentiated by the model's parameters at their values in the file, (m, p)."""
        build, effort = self._inverse(efforts=True)
        derivative = self._by_parameters(build, effort)
        shape = (len(effort), derivative.size2())
        return build.program("torque_parameter_derivatives", [("derivatives", shape, _rows(derivative))])

    def acceleration_parameter_derivatives(self) -> Program:
        """Accelerations differentiated by the model's parameters at their values in the file, (n, p)."""
        n = self.model.n
        build, unbalanced, _, solve, settle = self._unbalanced()
        (derivative,) = settle([self._by_parameters(build, unbalanced)])
        columns = [solve(_entries(casadi.densify(derivative[:, k]))) for k in range(derivative.size2())]
        entries = [column[i] for i in range(n) for column in columns]
        return build.program("acceleration_parameter_derivatives", [("derivatives", (n, len(columns)), entries)])

    def _by_parameters(self, build: _Build, values: Sequence[Scalar]) -> casadi.SX:
        """Derivatives by the parameters, (values, p), the loops kept closed: dz/dp = -K_z^-1 d(phi)/dp."""
        parameters = _column(self.model.numbers.symbols)
        column = _column(values)
        derivative = casadi.jacobian(column, parameters)
        if not self.model.iterates:
            return derivative
        moved = casadi.jacobian(_column(build.state.residuals), parameters)
        # By multipliers: as many solutions as there are values, however many parameters.
        by_z = casadi.densify(casadi.jacobian(column, build.z))
        multipliers = [
            _column(build.state.solve_transposed(_entries(casadi.densify(by_z[i, :].T)))) for i in range(column.numel())
        ]
        return derivative - casadi.mtimes(casadi.horzcat(*multipliers).T, moved)


def _side_by_side(blocks: Sequence[tuple[Sequence[casadi.SX], int]], height: int) -> list[casadi.SX]:
    """Entries row by row of matrices with the given widths, themselves row by row, put beside each other."""
    return [x for i in range(height) for entries, width in blocks for x in entries[i * width : (i + 1) * width]]


def _rows(matrix: casadi.SX) -> list[casadi.SX]:
    """Entries of a matrix row by row."""
    dense = casadi.densify(matrix)
    return [dense[i, j] for i in range(dense.size1()) for j in range(dense.size2())]
