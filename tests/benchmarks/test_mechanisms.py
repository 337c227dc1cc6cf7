"""Generated chains and foreign files are the mechanisms that they say they are."""

from __future__ import annotations

import numpy as np
import pytest

import leg_dynamics as ld
from benchmarks.cases import NotAvailableError
from benchmarks.gate import check
from benchmarks.mechanisms import GRBDA, SHARED, Subject, chain, foreign, platform

pytestmark = pytest.mark.filterwarnings("ignore::leg_dynamics.errors.LegDynamicsWarning")


@pytest.mark.parametrize("loops", [1, 3])
def test_chains(loops):
    leg = ld.load(chain(loops), route="pinocchio")
    assert len(leg.joint_names) == loops
    assert len(leg.description.loops) == loops
    assert len(leg.backend.tree_joint_names) == 3 * loops
    pose = dict(leg.description.configurations[0].values)
    closed = leg.assemble(np.array([pose[name] for name in leg.joint_names]))
    # The named pose is closed as it stands.
    np.testing.assert_allclose([closed[name] for name in pose], list(pose.values()), atol=1e-12)


def test_a_chain_is_no_parallelogram():
    leg = ld.load(chain(1), route="pinocchio")
    q = np.array([1.0, 1.2, 1.4])[:, None]
    b = leg.assemble(q)["b_1"]
    assert abs(np.diff(b)[0] - np.diff(b)[1]) > 1e-3


def test_the_platform(tiny):
    subject = Subject(platform, tiny)
    leg = subject.pinocchio
    pose = dict(leg.description.configurations[0].values)
    closed = leg.assemble(subject.home)
    np.testing.assert_allclose([closed[name] for name in pose], list(pose.values()), atol=1e-12)
    assert (len(leg.joint_names), len(leg.description.loops), len(pose)) == (3, 2, 7)
    assert check(subject.rnea()).status == "ok"


@pytest.mark.parametrize("name", list(GRBDA))
def test_foreign_files(name, tiny):
    if not SHARED.is_dir():
        pytest.skip("../shared/models is not beside this checkout")
    subject = Subject(lambda: foreign(name), tiny)
    assert check(subject.rnea()).status == "ok"
    assert check(subject.along(subject.pinocchio)).status == "ok"


def test_an_absent_file_is_named(monkeypatch, tmp_path):
    monkeypatch.setattr("benchmarks.mechanisms.SHARED", tmp_path)
    with pytest.raises(NotAvailableError, match=r"four_bar\.urdf is absent"):
        foreign("four_bar")
