"""The error family: the builtin that a caller expects, evidence as attributes, rows and margins of a batch."""

from __future__ import annotations

import copy
import inspect
import pickle

import numpy as np
import pytest

from leg_dynamics import errors
from leg_dynamics.errors import (
    AssemblyError,
    DescriptionError,
    JointLimitError,
    LegDynamicsError,
    NonFiniteError,
    OutOfReachError,
    RowError,
    RowFailures,
    SingularityError,
    UnsafeXmlError,
)

FAMILY = [kind for _, kind in inspect.getmembers(errors, inspect.isclass) if issubclass(kind, LegDynamicsError)]
BUILTIN = {
    "ActuationError": ValueError,
    "AssemblyError": ValueError,
    "BranchError": ValueError,
    "CrosscheckError": AssertionError,
    "DescriptionError": ValueError,
    "FormulaAssumptionError": ValueError,
    "JointLimitError": ValueError,
    "LegNotFoundError": FileNotFoundError,
    "MissingFootError": ValueError,
    "NonFiniteError": ValueError,
    "EffortLimitError": ValueError,
    "OutOfReachError": ValueError,
    "OutputError": OSError,
    "ParameterError": KeyError,
    "PreviewError": RuntimeError,
    "RenderError": ValueError,
    "RouteError": ValueError,
    "ShapeError": ValueError,
    "SingularityError": ArithmeticError,
    "StudyError": ValueError,
    "SupportError": ValueError,
    "TrajectoryError": ValueError,
    "UnsafeXmlError": ValueError,
    "UnsupportedError": NotImplementedError,
    "WorkspaceError": ValueError,
}


def test_everything_is_exported():
    assert {kind.__name__ for kind in FAMILY} <= set(errors.__all__)
    assert all(hasattr(errors, name) for name in errors.__all__)


def test_no_class_was_forgotten_here():
    assert {kind.__name__ for kind in FAMILY} - {"LegDynamicsError", "RowError"} == set(BUILTIN)


@pytest.mark.parametrize("name", BUILTIN)
def test_each_is_also_a_builtin(name):
    assert issubclass(getattr(errors, name), BUILTIN[name])


@pytest.mark.parametrize("kind", FAMILY, ids=lambda kind: kind.__name__)
@pytest.mark.parametrize("clone", [lambda error: pickle.loads(pickle.dumps(error)), copy.copy], ids=["pickle", "copy"])
def test_message_and_evidence_survive(kind, clone):
    error = clone(kind("the value is 3, the limit 2: take less", value=3, limit=2))
    assert type(error) is kind
    assert str(error).endswith("the value is 3, the limit 2: take less")
    assert (error.value, error.limit) == (3, 2)
    assert error.evidence["value"] == 3


@pytest.mark.parametrize("kind", FAMILY, ids=lambda kind: kind.__name__)
def test_a_clone_of_a_clone_says_the_same(kind):
    error = kind("words", value=3)
    again = pickle.loads(pickle.dumps(pickle.loads(pickle.dumps(error))))
    assert str(again) == str(error)


def test_a_key_error_does_not_quote_its_sentence():
    assert str(errors.ParameterError("no parameter 'L'")) == "no parameter 'L'"


@pytest.mark.parametrize("kind", [DescriptionError, UnsafeXmlError])
def test_a_description_error_starts_with_its_place_once(kind):
    error = kind("no joint", file="a.urdf", line=7)
    assert str(error) == "a.urdf:7: no joint"
    assert str(pickle.loads(pickle.dumps(error))) == "a.urdf:7: no joint"
    assert (error.file, error.line) == ("a.urdf", 7)
    assert str(kind("no root")) == "<string>: no root"


ROW_KINDS = [NonFiniteError, OutOfReachError, JointLimitError, AssemblyError, SingularityError]


@pytest.mark.parametrize("kind", ROW_KINDS)
def test_rows_and_margins_are_arrays_of_one_length(kind):
    single = kind("one sample", margin=-0.5)
    assert single.rows.tolist() == [0]
    assert single.margin.tolist() == [-0.5]
    batch = kind("some rows", rows=[4, 9], margin=-0.5, residual=[1.0, 2.0])
    assert batch.rows.tolist() == batch.all_rows.tolist() == [4, 9]
    assert batch.margin.tolist() == [-0.5, -0.5]
    assert batch.residual.tolist() == [1.0, 2.0]
    again = pickle.loads(pickle.dumps(batch))
    assert again.rows.tolist() == [4, 9]
    assert again.residual.tolist() == [1.0, 2.0]
    assert np.isnan(kind("nothing measured").margin).all()


def test_a_margin_per_row_that_does_not_fit_is_refused():
    with pytest.raises(ValueError, match="broadcast"):
        RowError("three rows, two margins", rows=[0, 1, 2], margin=[0.1, 0.2])


def test_no_failures():
    failures = RowFailures()
    assert not failures
    assert failures.rows.tolist() == []


@pytest.mark.parametrize("count", [None, 1])
def test_one_failure_of_a_single_sample_has_no_row_number(count):
    failures = RowFailures()
    failures.add(0, AssemblyError("cannot close", margin=-1e-3, residual=1e-3, reached=[1.0]))
    assert failures
    error = failures.combined(count)
    assert type(error) is AssemblyError
    assert str(error) == "cannot close"
    assert error.residual.tolist() == [1e-3]
    assert error.reached == [1.0]


def test_rows_of_one_kind_are_merged_in_order_with_their_own_evidence():
    failures = RowFailures()
    failures.add([7], AssemblyError("row seven", margin=-0.7, residual=0.7))
    failures.add([2, 5], AssemblyError("row two", rows=[2, 5], margin=[-0.2, -0.5], residual=[0.2, 0.5]))
    error = failures.combined(9)
    assert error.rows.tolist() == failures.rows.tolist() == [2, 5, 7]
    assert error.margin.tolist() == [-0.2, -0.5, -0.7]
    assert error.residual.tolist() == [0.2, 0.5, 0.7]
    assert str(error) == "3 of 9 rows failed; first row 2: row two"


def test_a_row_that_failed_twice_is_listed_once():
    failures = RowFailures()
    failures.add([3], SingularityError("first time", margin=0.25))
    failures.add([3, 1], SingularityError("second time", rows=[3, 1], margin=[0.5, 0.125]))
    error = failures.combined(4)
    assert error.rows.tolist() == [1, 3]
    assert error.margin.tolist() == [0.125, 0.25]
    assert str(error).startswith("2 of 4 rows failed; first row 1")


def test_the_first_failing_row_names_the_error_and_no_other_row_is_lost():
    failures = RowFailures()
    failures.add([6], SingularityError("singular", margin=0.0))
    failures.add([1], OutOfReachError("too far", margin=-0.1))
    error = failures.combined(8)
    assert type(error) is OutOfReachError
    assert error.rows.tolist() == [1]
    assert error.all_rows.tolist() == [1, 6]
    assert "2 of 8 rows failed (1 with OutOfReachError, the rest with SingularityError); first row 1" in str(error)
