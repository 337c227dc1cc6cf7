"""Somebody's own formulas for a leg held against its file, equation by equation.

The formulas are an object with any of the interface's methods (`METHODS`), in the interface's units and frames: SI,
radians, the hip frame. Each is called with one state at a time, arrays of shape (n,) or (3,), so that formulas written
with `math` will do. Arguments `foot_force` and `gravity` are passed by name where a method's signature has them;
`foot_force` also where it takes any name (``**options``). A foot force that a method has no argument of that name for
is not compared, and a note says so. The object may also have

* ``joint_names``: the independent coordinates in its own order, where that is not the file's;
* ``actuator_names``: the order of its torques, where it is neither that of its joint names nor the file's;
* ``equations``: names of its equations by method, such as ``{"jacobian": "(12)"}``; for a method that is not in it,
  numbers in brackets at the end of the first line of its docstring count;
* ``gravity``: the gravity its formulas compute with, a vector in the hip frame or a magnitude along the file's.

Where a result is wrong, results that depend on it are too. They are held against each other as well (the Jacobian
against differences of the own position, and so on), and what follows from an error further up is reported as such. So
is what a method cannot do since another one that it calls raises, returns nothing of use or cannot be called: where
results are missing, the calls are observed. One order of the joints' names that explains several results is one error.
"""

from __future__ import annotations

import copy
import dataclasses
import difflib
import functools
import inspect
import os
import re
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import CodeType
from typing import Any

import numpy as np

from leg_dynamics.errors import MissingFootError, ParameterError
from leg_dynamics.leg import Leg
from leg_dynamics.verification.calls import names_that_failed, observed
from leg_dynamics.verification.diagnosis import Entries

__all__ = [
    "METHODS",
    "QUANTITIES",
    "Inputs",
    "Observed",
    "OwnFormulas",
    "Quantity",
    "Raised",
    "Values",
    "side_of_all",
]

METHODS = (
    "assemble",
    "foot_position",
    "inverse_kinematics",
    "jacobian",
    "jacobian_derivative",
    "foot_velocity",
    "foot_acceleration",
    "mass_matrix",
    "kinetic_energy",
    "potential_energy",
    "gravity_torque",
    "bias",
    "generalized_force",
    "torque",
    "acceleration",
)
"""The interface's methods that own formulas may have, each after those that it depends on."""

SAME_GRAVITY = 1e-12
_NUMBERED = re.compile(r"((?:\(\d+[a-z]?\)(?:\s*(?:-|–|,|to|and)\s*)?)+)\.?\s*$")


@dataclass(frozen=True)
class Quantity:
    """One method of the interface: its arguments, its result's axes and what it may be given by name."""

    method: str
    title: str
    arguments: tuple[str, ...]
    form: str
    axes: tuple[str, ...]
    options: tuple[str, ...] = ()

    @property
    def of_foot(self) -> bool:
        """Whether a leg without a foot has none of it."""
        return "foot" in self.axes or "p" in self.arguments


_LOADS = ("foot_force", "gravity")
QUANTITIES = {
    quantity.method: quantity
    for quantity in (
        Quantity("assemble", "joint angles that close the loops", ("q",), "{}", ("tree",)),
        Quantity("foot_position", "foot position", ("q",), "foot {}", ("foot",)),
        Quantity("inverse_kinematics", "inverse kinematics", ("p",), "{}", ("joint",)),
        Quantity("jacobian", "foot Jacobian", ("q",), "d foot {} / d {}", ("foot", "joint")),
        Quantity("jacobian_derivative", "Jacobian derivative", ("q", "v"), "d/dt d foot {} / d {}", ("foot", "joint")),
        Quantity("foot_velocity", "foot velocity", ("q", "v"), "velocity of foot {}", ("foot",)),
        Quantity("foot_acceleration", "foot acceleration", ("q", "v", "a"), "acceleration of foot {}", ("foot",)),
        Quantity("mass_matrix", "mass matrix", ("q",), "M[{}, {}]", ("joint", "joint")),
        Quantity("kinetic_energy", "kinetic energy", ("q", "v"), "", ()),
        Quantity("potential_energy", "potential energy", ("q",), "", (), ("gravity",)),
        Quantity("gravity_torque", "gravity torque", ("q",), "{}", ("joint",), ("gravity",)),
        Quantity("bias", "bias force", ("q", "v"), "{}", ("joint",), ("gravity",)),
        Quantity("generalized_force", "generalized force", ("q", "v", "a"), "{}", ("joint",), _LOADS),
        Quantity("torque", "torque", ("q", "v", "a"), "{}", ("actuator",), _LOADS),
        Quantity("acceleration", "acceleration", ("q", "v", "tau"), "{}", ("joint",), _LOADS),
    )
}


@dataclass(frozen=True)
class Inputs:
    """Arguments of N states, all in the reference's order; no foot force where it is None."""

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    tau: np.ndarray
    gravity: np.ndarray
    foot_force: np.ndarray | None = None
    p: np.ndarray | None = None

    def take(self, rows: np.ndarray) -> Inputs:
        """Those of some states."""
        values = {each.name: getattr(self, each.name) for each in dataclasses.fields(self)}
        taken: dict[str, Any] = {name: None if array is None else array[rows] for name, array in values.items()}
        return Inputs(**taken)

    def without(self, *names: str) -> Inputs:
        """The same with some arguments zero, or no foot force."""
        changed: dict[str, Any] = {}
        for name in names:
            changed[name] = None if name == "foot_force" else np.zeros_like(getattr(self, name))
        return replace(self, **changed)

    def at(self, q: np.ndarray, **others: np.ndarray) -> Inputs:
        """Inputs at other coordinates (k, n), at rest where not said otherwise."""
        n, m = self.q.shape[1], self.tau.shape[1]
        zero = np.zeros((len(q), n))
        gravity = np.broadcast_to(self.gravity[0], (len(q), 3))
        given = {"v": zero, "a": zero, "tau": np.zeros((len(q), m)), "gravity": gravity} | others
        return Inputs(q=q, **given)


@dataclass(frozen=True)
class Raised:
    """What a method gave no number for: its exception with the code that this came through, innermost first.

    A result of no use has no kind and no code.
    """

    kind: str
    text: str
    codes: tuple[CodeType, ...] = ()


@dataclass(frozen=True)
class Values:
    """Results of one method at N states, NaN where it gave none, and what it gave instead."""

    array: np.ndarray
    complaint: str = ""
    raised: tuple[Raised, ...] = ()


@dataclass(frozen=True)
class Observed:
    """One call of a method: which others ended in it, the innermost first, and what it raised.

    Attributes
    ----------
    called : frozenset of str
        All other methods.
    useless : tuple of (str, bool)
        Those that returned nothing of use, and whether they may have raised.
    raised : Raised or None
    names : frozenset of str
        Names in the expression that raised a TypeError: of what could not be called.
    """

    called: frozenset[str]
    useless: tuple[tuple[str, bool], ...]
    raised: Raised | None
    names: frozenset[str]


@dataclass(frozen=True)
class _Method:
    function: Callable[..., Any]
    signature: inspect.Signature | None
    options: frozenset[str]
    required: frozenset[str]
    any_name: bool = False
    """Whether it takes arguments of any name, so that only a call shows whether it takes one of the options."""


class OwnFormulas:
    """An object with some of the interface's methods, called one state at a time, its results in a leg's order.

    Parameters
    ----------
    own : object
        See `leg_dynamics.verification.own_formulas`.
    reference : Leg
        The leg that it is meant to describe.

    Raises
    ------
    ParameterError
        The object has none of the methods, or its joint names, actuator names, equations or gravity do not fit.
    MissingFootError
        It has methods of the foot, and the leg names none.
    """

    def __init__(self, own: Any, reference: Leg) -> None:
        self.reference = reference
        self.name = getattr(own, "__name__", type(own).__name__)
        self.notes: list[str] = []
        self.not_callable: dict[str, str] = {}
        if inspect.isclass(own):
            raise ParameterError(f"{self.name} is a class: pass an object, {self.name}(...)", parameter="leg")
        self.methods = dict(self._methods(own))
        if not self.methods:
            raise ParameterError(
                f"{self.name} object has none of the interface's methods, so that there is nothing to compare: give it "
                f"one or more of {', '.join(METHODS)}",
                parameter="leg",
            )
        foot_methods = [name for name in self.methods if QUANTITIES[name].of_foot]
        if foot_methods and reference.foot is None:
            raise MissingFootError(
                f"{', '.join(foot_methods)} of {self.name} cannot be compared: {reference.name!r} names no foot; pass "
                "foot= with the name of its link"
            )
        self._actuator_names = _names(own, "actuator_names")
        self.order, self.actuator_order = self._orders(_names(own, "joint_names"))
        self.equations = self._equations(own)
        self.gravity = self._gravity(own)
        self.codes = self._codes()

    def _methods(self, own: Any) -> Iterator[tuple[str, _Method]]:
        for name in METHODS:
            function = _attribute(own, name)
            if not callable(function):
                # None may say that a method is not there; where another one calls it, it is missed.
                if function is not None or name in vars(type(own)) or name in getattr(own, "__dict__", {}):
                    self.not_callable[name] = type(function).__name__
                continue
            try:
                signature = inspect.signature(function)
            except (TypeError, ValueError):
                signature = None
            possible = QUANTITIES[name].options
            named = {} if signature is None else signature.parameters
            options = {option for option in possible if option in named}
            required = {option for option in options if named[option].default is inspect.Parameter.empty}
            if "gravity" in options and isinstance(named["gravity"].default, (int, float)):
                self.notes.append(f"gravity of {name} is a number, so that it was not tilted")
                options.discard("gravity")
            any_name = any(each.kind is inspect.Parameter.VAR_KEYWORD for each in named.values())
            any_name = any_name and "foot_force" in possible and "foot_force" not in named
            if any_name:
                options.add("foot_force")
            elif "foot_force" in possible and "foot_force" not in options and self.reference.foot is not None:
                self._note_foot_force(name, signature)
            yield name, _Method(function, signature, frozenset(options), frozenset(required), any_name)

    def _note_foot_force(self, name: str, signature: inspect.Signature | None) -> None:
        """Say that a foot force was not compared where one may be meant."""
        if signature is None:
            self.notes.append(f"foot force was not compared in {name}: the names of its arguments cannot be read")
            return
        arguments = [
            ("*" if each.kind is inspect.Parameter.VAR_POSITIONAL else "") + each.name
            for each in signature.parameters.values()
        ]
        # Without further arguments forward dynamics is whole, and the torque has the force.
        if name != "acceleration" or len(arguments) > len(_arguments(name)) or "*" in "".join(arguments):
            self.notes.append(
                f"foot force was not compared in {name}: no argument of {name}({', '.join(arguments)}) is called "
                "foot_force"
            )

    def _codes(self) -> dict[CodeType, str]:
        """The method that each piece of code belongs to; none for code that several methods share."""
        found: dict[CodeType, list[str]] = {}
        for name, method in self.methods.items():
            code = _code(method.function)
            if code is not None:
                found.setdefault(code, []).append(name)
        return {code: names[0] for code, names in found.items() if len(names) == 1}

    def with_joint_names(self, joints: Sequence[str]) -> OwnFormulas:
        """The same formulas as they would be read with other `joint_names`; notes are its own."""
        other = copy.copy(self)
        other.notes = list(self.notes)
        other.order, other.actuator_order = self._orders(joints)
        return other

    def _orders(self, joints: Sequence[str] | None) -> tuple[np.ndarray, np.ndarray]:
        """Places in the reference's joints and actuators of the object's own ones."""
        leg = self.reference
        order = np.arange(len(leg.joint_names)) if joints is None else _places(joints, leg.joint_names, "joint_names")
        actuators = self._actuator_names
        driven = leg.backend.actuator_joints
        if actuators is not None:
            known = driven if set(actuators) == set(driven) else leg.actuator_names
            return order, _places(actuators, known, "actuator_names")
        if joints is not None and set(joints) == set(driven):
            return order, _places(joints, driven, "joint_names")
        return order, np.arange(len(driven))

    def _equations(self, own: Any) -> dict[str, str]:
        labels = {}
        for name, method in self.methods.items():
            lines = (inspect.getdoc(method.function) or "").strip().splitlines()
            found = _NUMBERED.search(lines[0]) if lines else None
            if found:
                labels[name] = found[1]
        given = _attribute(own, "equations")
        if given is None or callable(given):
            return labels
        if not isinstance(given, Mapping):
            raise ParameterError(
                f"equations must be a mapping of method to equation, such as {{'jacobian': '(12)'}}, got {given!r}",
                parameter="equations",
            )
        for name, label in given.items():
            if name not in METHODS:
                near = difflib.get_close_matches(str(name), METHODS, n=1)
                hint = f"; did you mean {near[0]!r}?" if near else f": they are {', '.join(METHODS)}"
                raise ParameterError(f"equations names {name!r}, which is no method{hint}", parameter="equations")
            labels[name] = str(label)
        return labels

    def _gravity(self, own: Any) -> np.ndarray:
        """Gravity that the formulas compute with, (3,)."""
        file = self.reference.gravity
        given = _attribute(own, "gravity")
        if given is None or callable(given):
            return file
        try:
            vector = np.asarray(given, dtype=float)
        except (TypeError, ValueError):
            vector = np.array(np.nan)
        if vector.ndim == 0 and np.isfinite(vector) and file.any():
            vector = abs(float(vector)) * file / np.linalg.norm(file)
        if vector.shape != (3,) or not np.isfinite(vector).all():
            raise ParameterError(
                f"gravity must be a vector (3,) in the hip frame, or its magnitude, m/s², got {given!r}",
                parameter="gravity",
            )
        if np.abs(vector - file).max() > SAME_GRAVITY * np.abs(file).max():
            listing = " and ".join("(" + ", ".join(f"{x:.6g}" for x in each) + ")" for each in (vector, file))
            self.notes.append(f"compared with the gravity of the own formulas instead of the file's: {listing} m/s²")
        return vector

    def size(self, axis: str) -> tuple[str, ...]:
        """Names along an axis of results."""
        leg = self.reference
        names = {"foot": ("x", "y", "z"), "joint": leg.joint_names, "actuator": leg.actuator_names}
        return (names | {"tree": leg.tree_joint_names})[axis]

    def entries(self, name: str) -> Entries:
        """Names of the entries of a method's result."""
        quantity = QUANTITIES[name]
        return Entries(quantity.form, tuple(self.size(axis) for axis in quantity.axes))

    def values(self, name: str, inputs: Inputs, *, with_gravity: bool = False) -> Values:
        """Results at N states; a foot force is passed where the inputs have one, gravity where asked for or needed."""
        quantity = QUANTITIES[name]
        arguments, options = self._given(name, inputs, with_gravity)
        shape = self._shape(name)
        result = self._each(name, arguments, options, shape, inputs.q, lambda value: _read(value, shape))
        array = result.array
        for axis, kind in enumerate(quantity.axes, start=1):
            if kind != "foot":
                order = self.order if kind == "joint" else self.actuator_order
                array = array.take(np.argsort(order), axis=axis)
        return replace(result, array=array)

    def _shape(self, name: str) -> tuple[int, ...]:
        return tuple(len(self.size(axis)) for axis in QUANTITIES[name].axes)

    def _given(self, name: str, inputs: Inputs, with_gravity: bool) -> tuple[list[np.ndarray], dict[str, np.ndarray]]:
        """Arguments and options of a method at N states, in its own order."""
        quantity, method = QUANTITIES[name], self.methods[name]
        options: dict[str, np.ndarray] = {}
        if "foot_force" in method.options and (inputs.foot_force is not None or "foot_force" in method.required):
            options["foot_force"] = np.zeros_like(inputs.gravity) if inputs.foot_force is None else inputs.foot_force
        if "gravity" in method.options and (with_gravity or "gravity" in method.required):
            options["gravity"] = inputs.gravity
        arguments = []
        for argument in quantity.arguments:
            array = getattr(inputs, argument)
            order = {"p": slice(None), "tau": self.actuator_order}.get(argument, self.order)
            arguments.append(array[:, order])
        return arguments, options

    def observed(self, name: str, inputs: Inputs, *, with_gravity: bool = False) -> Iterator[Observed]:
        """What happens in a method's calls at N states."""
        function = self.methods[name].function
        arguments, options = self._given(name, inputs, with_gravity)
        for row in range(len(inputs.q)):
            called: set[str] = set()
            useless: dict[str, bool] = {}

            def tell(method: str, value: Any, called: set[str] = called, useless: dict[str, bool] = useless) -> None:
                if method != name:
                    called.add(method)
                    if not self._is_useful(method, value):
                        useless.setdefault(method, value is None)

            call = functools.partial(
                function,
                *(array[row].copy() for array in arguments),
                **{option: array[row].copy() for option, array in options.items()},
            )
            raised, names = None, frozenset[str]()
            try:
                observed(call, self.codes, tell)
            except (Exception, SystemExit) as error:
                raised = Raised(type(error).__name__, str(error), _way(error))
                if isinstance(error, TypeError):
                    names = names_that_failed(error.__traceback__)
            yield Observed(frozenset(called), tuple(useless.items()), raised, names)

    def _is_useful(self, name: str, value: Any) -> bool:
        """Whether what a method returned has the numbers that it should have."""
        try:
            if name == "assemble":
                return bool(value) and all(_read(each, ()) is not None for each in value.values())
            _read(value, self._shape(name))
        except Exception:  # whatever it is, it is no array of numbers
            return False
        return True

    def coordinates(self, q: np.ndarray) -> tuple[Values, tuple[str, ...]]:
        """Joint coordinates of `assemble`, (N, k), and the joints that it gives."""
        known = self.reference.tree_joint_names
        names: list[str] = []

        def read(value: Any) -> np.ndarray:
            if not isinstance(value, Mapping):
                raise _UnusableError(f"returned {_kind(value)}, expected a mapping of joint name to coordinate")
            if not value:
                raise _UnusableError("returned a mapping without joints")
            unknown = [str(name) for name in value if name not in known]
            if unknown:
                raise _UnusableError(f"names {', '.join(unknown)}: the file's joints are {', '.join(known)}")
            if not names:
                names.extend(name for name in known if name in value)
            missing = [name for name in names if name not in value]
            if missing or len(value) != len(names):
                raise _UnusableError(f"names other joints than at the first state: {', '.join(map(str, value))}")
            return np.array([_read(value[name], ()) for name in names])

        result = self._each("assemble", [q[:, self.order]], {}, None, q, read)
        return result, tuple(names) if result.array.shape[1:] == (len(names),) else ()

    def _each(
        self,
        name: str,
        arguments: Sequence[np.ndarray],
        options: Mapping[str, np.ndarray],
        shape: tuple[int, ...] | None,
        q: np.ndarray,
        read: Callable[[Any], np.ndarray],
    ) -> Values:
        """Call a method state by state; what it raises or returns instead of numbers is part of the result."""
        method = self.methods[name]
        rows: list[np.ndarray | None] = []
        complaints: dict[str, list[int]] = {}
        messages: dict[str, str] = {}
        raised: dict[Raised, None] = {}
        # A signature that does not take the arguments is one finding, not an exception of the formulas.
        if method.signature is not None:
            try:
                method.signature.bind(*arguments, **options)
            except TypeError as error:
                called = f"{name}({', '.join(_arguments(name) + tuple(options))})"
                complaint = f"cannot be called as {called}: {error}"
                return Values(np.full((len(q), *(shape or ())), np.nan), complaint, (Raised("", complaint),))
        for row in range(len(q)):
            value: np.ndarray | None = None
            try:
                # Copies: formulas may change what they are given, or return the same array each time.
                result = method.function(
                    *(array[row].copy() for array in arguments),
                    **{option: array[row].copy() for option, array in options.items()},
                )
                value = np.array(read(result), dtype=float)
            except _UnusableError as error:
                kind, message = str(error), str(error)
                raised[Raised("", message)] = None
            except (Exception, SystemExit) as error:  # formulas that end the process are no reason to end it
                kind, message = type(error).__name__, f"raised {type(error).__name__}: {error}{_line(error)}"
                raised[Raised(kind, str(error), _way(error))] = None
            rows.append(value)
            if value is None:
                complaints.setdefault(kind, []).append(row)
                messages.setdefault(kind, message)
        if shape is None:
            shape = next((value.shape for value in rows if value is not None), ())
        array = np.array([np.full(shape, np.nan) if value is None else value for value in rows])
        array = array.reshape(len(rows), *shape)
        joints = self.reference.joint_names
        texts = [
            f"{messages[kind]}, at {len(where)} of {len(q)} states{side_of_all(where, q, joints)}, first at "
            + ", ".join(f"{joint} = {x:.6g}" for joint, x in zip(joints, q[where[0]], strict=True))
            for kind, where in complaints.items()
        ]
        return Values(array, "; ".join(texts), tuple(raised))


class _UnusableError(Exception):
    """A result that is no array of numbers of the right shape."""


def _attribute(own: Any, name: str) -> Any:
    try:
        return getattr(own, name, None)
    except (Exception, SystemExit) as error:
        raise ParameterError(
            f"{name} of {type(own).__name__} cannot be read: {type(error).__name__}: {error}", parameter=name
        ) from error


def _names(own: Any, attribute: str) -> tuple[str, ...] | None:
    given = _attribute(own, attribute)
    if given is None or callable(given):
        return None
    if isinstance(given, str) or not isinstance(given, Iterable):
        raise ParameterError(f"{attribute} must be a list of names, got {given!r}", parameter=attribute)
    return tuple(map(str, given))


def _places(given: Sequence[str], known: Sequence[str], attribute: str) -> np.ndarray:
    if sorted(given) != sorted(known):
        raise ParameterError(
            f"{attribute} is ({', '.join(given)}), but the leg's names are ({', '.join(known)}): give these, in the "
            "order of the own formulas",
            parameter=attribute,
        )
    return np.array([known.index(name) for name in given], dtype=np.intp)


def _arguments(name: str) -> tuple[str, ...]:
    return QUANTITIES[name].arguments


def _kind(value: Any) -> str:
    return "nothing: is a return missing?" if value is None else type(value).__name__


def _read(value: Any, shape: tuple[int, ...]) -> np.ndarray:
    """The numbers that a method returned.

    Raises
    ------
    _UnusableError
        It returned something else.
    """
    if value is None:
        raise _UnusableError(f"returned {_kind(value)}")
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):
        raise _UnusableError(f"returned {_kind(value)} that is no regular array of numbers") from None
    if array.dtype.kind not in "iuf":
        what = "complex numbers" if array.dtype.kind == "c" else f"{_kind(value)} that is no array of numbers"
        raise _UnusableError(f"returned {what}")
    if array.shape != shape:
        flat = ": return a flat array, .ravel()" if array.size == np.prod(shape) and len(shape) < array.ndim else ""
        raise _UnusableError(f"returned shape {array.shape}, expected {shape}{flat}")
    if not np.isfinite(array).all():
        raise _UnusableError("returned NaN or infinity")
    return array


def _code(function: Callable[..., Any]) -> CodeType | None:
    """The Python code that a function runs, without what wraps it."""
    while isinstance(function, functools.partial):
        function = function.func
    try:
        function = inspect.unwrap(function)
    except ValueError:  # wraps itself
        return None
    code = getattr(function, "__code__", None)
    if code is None:  # an object that can be called
        code = getattr(getattr(function, "__call__"), "__code__", None)  # noqa: B004, B009
    return code if isinstance(code, CodeType) else None


def _way(error: BaseException) -> tuple[CodeType, ...]:
    """The code that an exception came through below the call of the method, innermost first, each once."""
    frames = [frame.f_code for frame, _ in traceback.walk_tb(error.__traceback__)][1:]
    return tuple(dict.fromkeys(reversed(frames)))


def _line(error: BaseException) -> str:
    """Last line of the formulas' own file that an exception came through."""
    frames = traceback.extract_tb(error.__traceback__)[1:]
    if not frames:
        return ""
    own = [frame for frame in frames if frame.filename == frames[0].filename]
    return f" ({os.path.basename(own[-1].filename)}:{own[-1].lineno})"


def side_of_all(rows: Sequence[int] | np.ndarray, q: np.ndarray, joints: Sequence[str]) -> str:
    """On which side of which value of one coordinate all these states are and no other; empty where there is none."""
    inside = np.zeros(len(q), dtype=bool)
    inside[rows] = True
    if inside.sum() < 3 or (~inside).sum() < 3:
        return ""
    for joint, values in zip(joints, q.T, strict=True):
        for sign, word in ((1.0, ">"), (-1.0, "<")):
            least, most = (sign * values[inside]).min(), (sign * values[~inside]).max()
            if least > most:
                border = 0.0 if most <= 0.0 <= least else 0.5 * sign * (least + most)
                return f", all those where {joint} {word} {border:.3g}"
    return ""
