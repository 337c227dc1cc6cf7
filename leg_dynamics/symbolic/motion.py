"""Orientations as reduced words of rotations, positions as sums over them, and their first and second derivatives.

An orientation relative to a reference frame is a word of constant rotations and turns about coordinate axes. Words are
kept reduced: neighbouring turns about one axis add their angles, constants move to the left where they commute. So
R_x(a) R_x(-a) is no rotation, and a body that only translates is seen to do so before any code is made.

A position is a sum of constant vectors in the axes of orientations, p = sum_O O l_O, with l_O free of components along
the last turn's axis (they belong to the orientation before it). Equal terms of two positions cancel.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from leg_dynamics.symbolic.coordinates import Form
from leg_dynamics.symbolic.scalars import (
    IDENTITY,
    ZERO,
    Matrix,
    Scalar,
    Vector,
    add,
    add_vectors,
    align_z,
    axis_rotation,
    clean,
    clean_matrix,
    cos,
    cross,
    is_zero,
    matmul,
    matvec,
    mul,
    neg,
    scale,
    sin,
    sub,
    transpose,
)
from leg_dynamics.symbolic.tree import GROUND, Placement, Tree

__all__ = ["Frames", "Motion", "Orientation", "Position"]

# Off-axis components of a unit vector along an axis. The component along it would not do: its cosine hides 1e-7 rad.
ALONG_AXIS = 1e-14


def _is_along(vector: Sequence[Scalar], axis: int) -> bool:
    """Whether a constant unit vector is a coordinate axis or its opposite."""
    return all(abs(component) < ALONG_AXIS for number, component in enumerate(vector) if number != axis)


class Orientation:
    """A node of the trie of reduced words: its parent word and one more factor.

    `axis` is 0, 1 or 2 for a turn by `form` (without constant), None for the constant rotation `matrix`; both None at
    the root.
    """

    __slots__ = ("axis", "children", "depth", "form", "matrix", "parent")

    def __init__(self, parent: Orientation | None, axis: int | None, form: Form | None, matrix: Matrix | None) -> None:
        self.parent = parent
        self.axis = axis
        self.form = form
        self.matrix = matrix
        self.children: dict[object, Orientation] = {}
        turns = axis is not None
        self.depth: int = 0 if parent is None else parent.depth + (1 if turns else 0)

    def constant(self, matrix: Matrix) -> Orientation:
        """Word followed by a constant rotation, reduced."""
        if matrix == IDENTITY:
            return self
        if self.axis is not None:
            along = matrix[self.axis][self.axis]
            if _is_along([row[self.axis] for row in matrix], self.axis):
                assert self.parent is not None
                assert self.form is not None
                # R_a(f) C = C R_a(+-f) where C maps the axis to itself or its opposite.
                return self.parent.constant(matrix).turn(self.axis, self.form.scaled(math.copysign(1.0, along)))
        elif self.parent is not None:
            assert self.matrix is not None
            return self.parent.constant(clean_matrix(matmul(self.matrix, matrix)))
        key = tuple(round(x, 12) + 0.0 for row in matrix for x in row)
        if key not in self.children:
            self.children[key] = Orientation(self, None, None, matrix)
        return self.children[key]

    def turn(self, axis: int, form: Form) -> Orientation:
        """Word followed by a turn about a coordinate axis, reduced."""
        if form.constant != 0.0:
            return self.constant(axis_rotation(axis, form.constant)).turn(axis, form.linear)
        if not form.terms:
            return self
        if self.axis == axis:
            assert self.parent is not None
            assert self.form is not None
            return self.parent.turn(axis, self.form + form)
        before = self.parent
        if self.matrix is not None and before is not None and before.axis is not None:
            along = self.matrix[before.axis][axis]
            if _is_along([row[axis] for row in self.matrix], before.axis):
                assert before.form is not None
                assert before.parent is not None
                # R_b(f) C R_a(g) = R_b(f +- g) C where C maps a to +-b.
                merged = before.form + form.scaled(math.copysign(1.0, along))
                return before.parent.turn(before.axis, merged).constant(self.matrix)
        key = (axis, form)
        if key not in self.children:
            self.children[key] = Orientation(self, axis, form, None)
        return self.children[key]

    def turn_about(self, axis: tuple[float, float, float], form: Form) -> Orientation:
        """Word followed by a turn about any constant unit axis."""
        for number, component in enumerate(axis):
            if _is_along(axis, number):
                return self.turn(number, form.scaled(math.copysign(1.0, component)))
        align = align_z(axis)
        return self.constant(align).turn(2, form).constant(transpose(align))


class Position:
    """sum over orientations O of O l_O (1 + u_k terms): `terms` maps (O, k or None) to a constant vector, m.

    k None is a constant term, otherwise the term is proportional to u_k. Free vectors are positions too.
    """

    __slots__ = ("size", "terms")

    def __init__(self, size: float, terms: dict[tuple[Orientation, int | None], Vector] | None = None) -> None:
        self.size = size
        self.terms: dict[tuple[Orientation, int | None], Vector] = {} if terms is None else terms

    def plus(self, orientation: Orientation, vector: Vector, k: int | None = None, sign: float = 1.0) -> Position:
        """Position with one more term."""
        terms = dict(self.terms)
        if sign != 1.0:
            vector = scale(sign, vector)
        node = orientation
        while True:
            if all(is_zero(component) for component in vector):
                return Position(self.size, terms)
            if node.axis is not None:
                assert node.parent is not None
                along = vector[node.axis]
                if not is_zero(along):
                    parts: list[Scalar] = [0.0, 0.0, 0.0]
                    parts[node.axis] = along
                    terms = Position(self.size, terms).plus(node.parent, (parts[0], parts[1], parts[2]), k).terms
                    rest = list(vector)
                    rest[node.axis] = 0.0
                    vector = (rest[0], rest[1], rest[2])
                break
            if node.parent is None:
                break
            assert node.matrix is not None
            vector = matvec(node.matrix, vector)
            node = node.parent
        old = terms.pop((node, k), ZERO)
        summed = add_vectors(old, vector)
        summed = (clean(summed[0], self.size), clean(summed[1], self.size), clean(summed[2], self.size))
        if not all(is_zero(component) for component in summed):
            terms[node, k] = summed
        return Position(self.size, terms)

    def minus(self, other: Position) -> Position:
        """Difference of two positions; equal terms cancel."""
        result = self
        for (node, k), vector in other.terms.items():
            result = result.plus(node, vector, k, -1.0)
        return result

    @property
    def cost(self) -> int:
        """A measure of the work to evaluate it: turns before each term."""
        return sum(node.depth for node, _ in self.terms)


class Frames:
    """Orientations and origins of bodies relative to a frame on one of them.

    Parameters
    ----------
    tree : Tree
    body : int
        The body that counts as fixed.
    axes : Matrix, optional
        Orientation of the reference axes in that body.
    """

    def __init__(self, tree: Tree, body: int = GROUND, axes: Matrix = IDENTITY) -> None:
        self.tree = tree
        self.root = Orientation(None, None, None, None)
        start = self.root.constant(transpose(axes))
        self._known: dict[int, tuple[Orientation, Position]] = {body: (start, Position(tree.length))}
        # Upwards from the reference the joints are passed backwards.
        while body != GROUND:
            joint = tree.joints[body]
            orientation, origin = self._known[body]
            place = joint.placement
            if joint.turns:
                before = orientation.turn_about(joint.axis, joint.form.scaled(-1.0))
            else:
                before = orientation
                origin = self._slide(origin, orientation, joint.axis, joint.form, -1.0)
            parent = before.constant(transpose(place.rotation))
            self._known[place.body] = (parent, origin.plus(parent, place.origin, None, -1.0))
            body = place.body

    @staticmethod
    def _slide(origin: Position, orientation: Orientation, axis: Sequence[float], form: Form, sign: float) -> Position:
        for k, coefficient in form.terms:
            origin = origin.plus(orientation, scale(coefficient, (axis[0], axis[1], axis[2])), k, sign)
        return origin.plus(orientation, scale(form.constant + 0.0, (axis[0], axis[1], axis[2])), None, sign)

    def body(self, body: int) -> tuple[Orientation, Position]:
        """Orientation and origin of a body's frame."""
        if body not in self._known:
            joint = self.tree.joints[body]
            parent, origin = self.body(joint.parent)
            origin = origin.plus(parent, joint.placement.origin)
            orientation = parent.constant(joint.placement.rotation)
            if joint.turns:
                orientation = orientation.turn_about(joint.axis, joint.form)
            else:
                origin = self._slide(origin, orientation, joint.axis, joint.form, 1.0)
            self._known[body] = (orientation, origin)
        return self._known[body]

    def place(self, placement: Placement) -> tuple[Orientation, Position]:
        """Orientation and origin of a frame fixed to a body."""
        orientation, origin = self.body(placement.body)
        return orientation.constant(placement.rotation), origin.plus(orientation, placement.origin)


class Motion:
    """Values of orientations and positions for coordinates u and, where given, their two time derivatives.

    Parameters
    ----------
    u, rates, accelerations : sequence of scalars
    sincos : dict, optional
        Sines and cosines already made, to be shared between motions of the same u.
    """

    def __init__(
        self,
        u: Sequence[Scalar],
        rates: Sequence[Scalar] = (),
        accelerations: Sequence[Scalar] = (),
        sincos: dict[Form, tuple[Scalar, Scalar]] | None = None,
    ) -> None:
        self.u = u
        self.rates = rates
        self.accelerations = accelerations
        self.known_sincos: dict[Form, tuple[Scalar, Scalar]] = {} if sincos is None else sincos
        self._matrix: dict[Orientation, Matrix] = {}
        self._spin: dict[Orientation, Vector] = {}
        self._spin_rate: dict[Orientation, Vector] = {}
        self._local: dict[Orientation, tuple[Vector, Vector]] = {}
        self._gyration: dict[Orientation, Matrix] = {}
        self._arm: dict[tuple[Orientation, tuple[object, ...]], tuple[Vector, Vector]] = {}
        self._rate: dict[Form, Scalar] = {}
        self._acceleration: dict[Form, Scalar] = {}

    def moving(self, rates: Sequence[Scalar], accelerations: Sequence[Scalar]) -> Motion:
        """The motion with other rates at the same u; what depends on u alone is shared."""
        other = Motion(self.u, rates, accelerations, self.known_sincos)
        other._matrix = self._matrix
        other._arm = self._arm
        return other

    # ------------------------------------------------------------------ angles

    def sincos(self, form: Form) -> tuple[Scalar, Scalar]:
        """Sine and cosine of a form without constant.

        Small whole multiples and sums go by the addition theorems: four products instead of another sine and cosine.
        """
        known = self.known_sincos
        if form in known:
            return known[form]
        opposite = form.scaled(-1.0)
        if opposite in known:
            s, c = known[opposite]
            known[form] = (neg(s), c)
            return known[form]
        (k, coefficient), rest = form.terms[0], form.terms[1:]
        if rest:
            part = self._known_part(form)
            if part is None:
                part = Form(((k, coefficient),))
            known[form] = _sum_of_angles(self.sincos(part), self.sincos(form + part.scaled(-1.0)))
        elif coefficient < 0.0:
            s, c = self.sincos(opposite)
            known[form] = (neg(s), c)
        elif coefficient in (2.0, 3.0, 4.0):
            half = float(coefficient // 2)
            first, second = self.sincos(Form(((k, half),))), self.sincos(Form(((k, coefficient - half),)))
            known[form] = _sum_of_angles(first, second)
        else:
            angle = mul(coefficient, self.u[k])
            known[form] = (sin(angle), cos(angle))
        return known[form]

    def _known_part(self, form: Form) -> Form | None:
        """A sum of angles whose sine and cosine are known, and which leaves the shortest rest of the form."""
        best, shortest = None, len(form.terms) - 1
        for each in list(self.known_sincos):
            for part in (each, each.scaled(-1.0)):
                left = len((form + part.scaled(-1.0)).terms)
                if len(each.terms) > 1 and 0 < left < shortest:
                    best, shortest = part, left
        return best

    def rate_of(self, form: Form) -> Scalar:
        """Rate of a form, rad/s or m/s."""
        if form not in self._rate:
            self._rate[form] = form.rate(self.rates)
        return self._rate[form]

    def acceleration_of(self, form: Form) -> Scalar:
        """Acceleration of a form, rad/s² or m/s²."""
        if form not in self._acceleration:
            self._acceleration[form] = form.rate(self.accelerations)
        return self._acceleration[form]

    # ------------------------------------------------------------------ orientations

    def matrix(self, node: Orientation) -> Matrix:
        """Rotation from the node's axes to the reference axes."""
        if node.parent is None:
            return IDENTITY
        if node not in self._matrix:
            before = self.matrix(node.parent)
            if node.axis is None:
                assert node.matrix is not None
                self._matrix[node] = matmul(before, node.matrix)
            else:
                assert node.form is not None
                s, c = self.sincos(node.form)
                columns = list(transpose(before))
                b, d = (node.axis + 1) % 3, (node.axis + 2) % 3
                one, other = columns[b], columns[d]
                columns[b] = add_vectors(scale(c, one), scale(s, other))
                columns[d] = _sub(scale(c, other), scale(s, one))
                self._matrix[node] = transpose((columns[0], columns[1], columns[2]))
        return self._matrix[node]

    def axis(self, node: Orientation) -> Vector:
        """Axis of the node's last turn, in reference axes."""
        assert node.parent is not None
        assert node.axis is not None
        rows = self.matrix(node.parent)
        return (rows[0][node.axis], rows[1][node.axis], rows[2][node.axis])

    def arm(self, node: Orientation, vector: Vector) -> Vector:
        """A constant vector of the node's axes, in reference axes."""
        if node.parent is None:
            return vector
        key = (node, tuple(x if isinstance(x, float) else id(x) for x in vector))
        if key not in self._arm:
            # The vector is kept: an identity is taken again by another object once its own is gone.
            self._arm[key] = (vector, matvec(self.matrix(node), vector))
        return self._arm[key][1]

    def spin(self, node: Orientation) -> Vector:
        """Angular velocity in reference axes, rad/s."""
        if node.parent is None:
            return ZERO
        if node.axis is None:
            return self.spin(node.parent)
        if node not in self._spin:
            assert node.form is not None
            turn = scale(self.rate_of(node.form), self.axis(node))
            self._spin[node] = add_vectors(self.spin(node.parent), turn)
        return self._spin[node]

    def spin_rate(self, node: Orientation) -> Vector:
        """Angular acceleration in reference axes, rad/s²."""
        if node.parent is None:
            return ZERO
        if node.axis is None:
            return self.spin_rate(node.parent)
        if node not in self._spin_rate:
            assert node.form is not None
            axis = self.axis(node)
            own = scale(self.acceleration_of(node.form), axis)
            carried = scale(self.rate_of(node.form), cross(self.spin(node.parent), axis))
            self._spin_rate[node] = add_vectors(add_vectors(self.spin_rate(node.parent), carried), own)
        return self._spin_rate[node]

    def gyration(self, node: Orientation) -> Matrix:
        """Second derivative of a vector fixed in the node, as a matrix: [alpha] + [omega]²."""
        if node.axis is None and node.parent is not None:
            return self.gyration(node.parent)
        if node not in self._gyration:
            self._gyration[node] = _gyration(self.spin(node), self.spin_rate(node))
        return self._gyration[node]

    def local_spin(self, node: Orientation) -> tuple[Vector, Vector]:
        """Angular velocity and acceleration in the node's own axes."""
        if node.parent is None:
            return ZERO, ZERO
        if node not in self._local:
            spin, rate = self.local_spin(node.parent)
            if node.axis is None:
                assert node.matrix is not None
                back = transpose(node.matrix)
                self._local[node] = (matvec(back, spin), matvec(back, rate))
            else:
                assert node.form is not None
                s, c = self.sincos(node.form)
                spin, rate = _turn_back(node.axis, s, c, spin), _turn_back(node.axis, s, c, rate)
                turning = self.rate_of(node.form)
                b, d = (node.axis + 1) % 3, (node.axis + 2) % 3
                new_rate, new_spin = list(rate), list(spin)
                # omega x e_a: (b, d) components (omega_d, -omega_b).
                new_rate[b] = add(rate[b], mul(spin[d], turning))
                new_rate[d] = sub(rate[d], mul(spin[b], turning))
                new_rate[node.axis] = add(rate[node.axis], self.acceleration_of(node.form))
                new_spin[node.axis] = add(spin[node.axis], turning)
                self._local[node] = (
                    (new_spin[0], new_spin[1], new_spin[2]),
                    (new_rate[0], new_rate[1], new_rate[2]),
                )
        return self._local[node]

    # ------------------------------------------------------------------ positions

    def _term(self, node: Orientation, k: int | None, vector: Vector) -> Vector:
        arm = self.arm(node, vector)
        return arm if k is None else scale(self.u[k], arm)

    def position(self, position: Position) -> Vector:
        """Value in reference axes."""
        result = ZERO
        for (node, k), vector in position.terms.items():
            result = add_vectors(result, self._term(node, k, vector))
        return result

    def velocity(self, position: Position) -> Vector:
        """First time derivative in reference axes."""
        result = ZERO
        for (node, k), vector in position.terms.items():
            arm = self.arm(node, vector)
            result = add_vectors(result, cross(self.spin(node), self._term(node, k, vector)))
            if k is not None:
                result = add_vectors(result, scale(self.rates[k], arm))
        return result

    def acceleration(self, position: Position) -> Vector:
        """Second time derivative in reference axes."""
        result = ZERO
        for (node, k), vector in position.terms.items():
            if node.parent is None and k is None:
                continue
            arm = self.arm(node, vector)
            result = add_vectors(result, matvec(self.gyration(node), self._term(node, k, vector)))
            if k is not None:
                result = add_vectors(result, scale(self.accelerations[k], arm))
                result = add_vectors(result, scale(mul(2.0, self.rates[k]), cross(self.spin(node), arm)))
        return result

    def partials(self, position: Position) -> dict[int, Vector]:
        """Derivatives of a position with respect to each u_k that moves it."""
        columns: dict[int, Vector] = {}
        levers: dict[Orientation, Vector] = {}
        for (node, k), vector in position.terms.items():
            if k is not None:
                columns[k] = add_vectors(columns.get(k, ZERO), self.arm(node, vector))
            term = self._term(node, k, vector)
            word: Orientation | None = node
            while word is not None:
                if word.axis is not None:
                    levers[word] = add_vectors(levers.get(word, ZERO), term)
                word = word.parent
        for node, lever in levers.items():
            assert node.form is not None
            swing = cross(self.axis(node), lever)
            for k, coefficient in node.form.terms:
                columns[k] = add_vectors(columns.get(k, ZERO), scale(coefficient, swing))
        return columns

    def spin_partials(self, node: Orientation) -> dict[int, Vector]:
        """Derivatives of the node's angular velocity with respect to each rate of u."""
        columns: dict[int, Vector] = {}
        word: Orientation | None = node
        while word is not None:
            if word.axis is not None:
                assert word.form is not None
                for k, coefficient in word.form.terms:
                    columns[k] = add_vectors(columns.get(k, ZERO), scale(coefficient, self.axis(word)))
            word = word.parent
        return columns


def _sub(a: Vector, b: Vector) -> Vector:
    return (sub(a[0], b[0]), sub(a[1], b[1]), sub(a[2], b[2]))


def _sum_of_angles(first: tuple[Scalar, Scalar], second: tuple[Scalar, Scalar]) -> tuple[Scalar, Scalar]:
    (s1, c1), (s2, c2) = first, second
    return add(mul(s1, c2), mul(c1, s2)), sub(mul(c1, c2), mul(s1, s2))


def _turn_back(axis: int, s: Scalar, c: Scalar, vector: Vector) -> Vector:
    b, d = (axis + 1) % 3, (axis + 2) % 3
    turned = list(vector)
    turned[b] = add(mul(c, vector[b]), mul(s, vector[d]))
    turned[d] = sub(mul(c, vector[d]), mul(s, vector[b]))
    return (turned[0], turned[1], turned[2])


def _gyration(spin: Vector, rate: Vector) -> Matrix:
    x, y, z = spin
    xx, yy, zz = mul(x, x), mul(y, y), mul(z, z)
    xy, xz, yz = mul(x, y), mul(x, z), mul(y, z)
    a, b, c = rate
    return (
        (neg(add(yy, zz)), sub(xy, c), add(xz, b)),
        (add(xy, c), neg(add(xx, zz)), sub(yz, a)),
        (sub(xz, b), add(yz, a), neg(add(xx, yy))),
    )
