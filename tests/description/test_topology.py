"""Coupling equations, independent and actuated joints, and the order of the tree."""

from __future__ import annotations

import warnings

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from leg_dynamics.description import (
    Description,
    actuated_joints,
    coupling_equations,
    independent_joints,
    joints_depth_first,
    parse,
)
from leg_dynamics.description.topology import split_independent
from leg_dynamics.errors import DescriptionError, LegDynamicsWarning


def joint(name: str, parent: str, child: str, kind: str = "revolute", inside: str = "", **attributes: str) -> str:
    extra = "".join(f' {key}="{value}"' for key, value in attributes.items())
    return (
        f'<joint name="{name}" type="{kind}"{extra}><parent link="{parent}"/><child link="{child}"/>{inside}</joint>\n'
    )


def mechanism(*elements: str) -> Description:
    text = "".join(elements)
    names = dict.fromkeys(piece.split('"')[0] for piece in text.split('link="')[1:])
    return parse('<robot name="m">' + "".join(f'<link name="{name}"/>' for name in names) + text + "</robot>")


def coupling(predecessor: str, successor: str, ratio: float = 3.0, name: str = "c") -> str:
    return (
        f'<coupling name="{name}"><predecessor link="{predecessor}"/><successor link="{successor}"/>'
        f'<ratio value="{ratio}"/></coupling>\n'
    )


#  base - a - b - gear (fixed)
#           \ c - d
TREE = (
    joint("q_a", "base", "a"),
    joint("q_b", "a", "b"),
    joint("weld", "b", "gear", "fixed"),
    joint("q_c", "a", "c", "prismatic"),
    joint("q_d", "c", "d", "continuous"),
)


def test_paths_start_at_the_nearest_common_ancestor() -> None:
    (equation,) = coupling_equations(mechanism(*TREE, coupling("d", "gear")))
    assert (equation.name, equation.constant) == ("c", 0.0)
    assert dict(equation.coefficients) == {"q_b": 1.0, "q_c": -3.0, "q_d": -3.0}  # not q_a, which both share


def test_mimics_are_equations_after_the_couplings() -> None:
    mimic = '<mimic joint="q_b" multiplier="-2" offset="0.5"/>'
    first, second = coupling_equations(
        mechanism(joint("q_m", "base", "m", inside=mimic), *TREE, coupling("b", "c", -1))
    )
    assert dict(first.coefficients) == {"q_c": 1.0, "q_b": 1.0}
    assert (second.name, dict(second.coefficients), second.constant) == ("q_m", {"q_m": 1.0, "q_b": 2.0}, 0.5)


@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_joints_of_several_coordinates_cannot_be_coupled(kind: str) -> None:
    tree = (*TREE, joint("free", "d", "e", kind))
    with pytest.raises(DescriptionError, match=f"{kind} joint 'free'"):
        mechanism(*tree, coupling("gear", "e"))
    # Above the common ancestor such a joint does not matter.
    floating_base = (joint("free", "world", "base", kind), *TREE)
    assert coupling_equations(mechanism(*floating_base, coupling("c", "b")))[0].name == "c"


def test_flags_decide_where_they_are_stated() -> None:
    mimic = '<mimic joint="q_d"/>'
    stated = mechanism(
        *TREE, joint("passive", "d", "e", independent="false"), joint("q_m", "e", "f", inside=mimic), coupling("c", "b")
    )
    assert independent_joints(stated) == ("q_a", "q_b", "q_c", "q_d")
    assert actuated_joints(stated) == ("q_a", "q_b", "q_c", "q_d")


def test_without_flags_the_couplings_decide_and_say_so() -> None:
    silent = mechanism(*TREE, coupling("d", "gear"))
    with pytest.warns(LegDynamicsWarning, match="successor joints q_b are taken as dependent"):
        assert independent_joints(silent) == ("q_a", "q_c", "q_d")
    with pytest.warns(LegDynamicsWarning):
        assert actuated_joints(silent) == ("q_a", "q_c", "q_d")
    # The second coupling with the same successor takes the next joint up that path, then the other path's.
    twice = mechanism(*TREE, coupling("gear", "d"), coupling("gear", "d", 2, "e"), coupling("gear", "d", 1, "f"))
    with pytest.warns(LegDynamicsWarning, match="q_d, q_c, q_b"):
        assert independent_joints(twice) == ("q_a",)


def test_without_couplings_there_is_nothing_to_say() -> None:
    assert independent_joints(mechanism(*TREE)) == ("q_a", "q_b", "q_c", "q_d")


def test_transmissions_name_the_actuated_joints_in_file_order() -> None:
    drives = "".join(f'<transmission name="t_{name}"><joint name="{name}"/></transmission>' for name in ("q_d", "q_a"))
    assert actuated_joints(mechanism(*TREE, drives)) == ("q_d", "q_a")


@given(st.lists(st.integers(0, 10**6), max_size=30), st.randoms(use_true_random=False))
@settings(max_examples=60, deadline=None)
def test_depth_first_order_of_any_tree(parents: list[int], shuffle: object) -> None:
    joints = [joint(f"j{n}", f"l{parent % (n + 1)}", f"l{n + 1}") for n, parent in enumerate(parents)]
    shuffle.shuffle(joints)  # type: ignore[attr-defined]
    links = "".join(f'<link name="l{n}"/>' for n in range(len(parents) + 1))
    description = parse(f'<robot name="m">{links}{"".join(joints)}</robot>')
    ordered = joints_depth_first(description)
    assert sorted(each.name for each in ordered) == sorted(each.name for each in description.joints)
    # Depth first: each joint hangs on the branch that leads to the previous one.
    trail = ["l0"]
    for each in ordered:
        while trail[-1] != each.parent:
            trail.pop()  # IndexError if the parent has not been reached or was left already
        trail.append(each.child)
    file_order = {each.name: index for index, each in enumerate(description.joints)}
    for link in description.links:
        siblings = [file_order[each.name] for each in ordered if each.parent == link.name]
        assert siblings == sorted(siblings)


def test_a_deep_chain_needs_no_recursion() -> None:
    count = 3000
    description = mechanism(*(joint(f"j{n}", f"l{n}", f"l{n + 1}") for n in range(count)))
    assert len(joints_depth_first(description)) == len(description.path(f"l{count}")) == count


def test_summary_does_not_warn() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        text = str(mechanism(*TREE, coupling("d", "gear")))
    assert "q_a; q_c; q_d (couplings decided on q_b)" in text
    assert "c (gear = 3 d)" in text


def test_the_predecessors_joints_become_dependent_from_its_own_one_upwards() -> None:
    names = "cef"
    for count, demoted in enumerate((("q_b",), ("q_b", "q_d"), ("q_b", "q_d", "q_c")), 1):
        pairs = (coupling("d", "gear", ratio, name) for ratio, name in enumerate(names[:count], 1))
        independent, found = split_independent(mechanism(*TREE, *pairs))
        assert found == demoted
        assert independent == tuple(name for name in ("q_a", "q_b", "q_c", "q_d") if name not in demoted)
