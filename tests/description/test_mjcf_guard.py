"""Models made of several files: circles, depth and copies are refused before MuJoCo follows them."""

from __future__ import annotations

import re

import pytest

from leg_dynamics.description.mjcf_guard import check_mjcf
from leg_dynamics.description.xml_reader import Document, read_root
from leg_dynamics.errors import DescriptionError

ATTACH = '<body name="z{0}"><attach model="{1}" body="base" prefix="p{0}_"/></body>'


def model(assets="", inner="", top=""):
    return (
        f'<mujoco>{top}\n<asset>{assets}</asset><worldbody><body name="base"><geom size="1"/>{inner}</body></worldbody>'
        "</mujoco>"
    )


def names(file, name="m"):
    return f'<model name="{name}" file="{file}"/>'


def include(file):
    return f'<include file="{file}"/>'


@pytest.fixture
def check(tmp_path):
    def run(**files):
        for name, text in files.items():
            path = tmp_path / f"{name.replace('__', '/')}.xml"
            path.parent.mkdir(exist_ok=True)
            path.write_text(text, encoding="utf-8")
        path = tmp_path / f"{next(iter(files))}.xml"
        document = Document(str(path))
        check_mjcf(read_root(path.read_text(encoding="utf-8"), document), document, path)

    return run


@pytest.mark.parametrize(
    ("files", "where", "line", "circle"),
    [
        ({"a": model(names("a.xml"), ATTACH.format(0, "m"))}, "a", 2, "a.xml -> a.xml"),
        ({"a": model(names("a.xml"))}, "a", 2, "a.xml -> a.xml"),
        ({"a": model(names("./b/../a.xml")), "b__c": ""}, "a", 2, "a.xml -> a.xml"),
        ({"a": model(names("b.xml")), "b": model(names("a.xml"))}, "b", 2, "a.xml -> b.xml -> a.xml"),
        ({"a": model(top=include("a.xml"))}, "a", 1, "a.xml -> a.xml"),
        ({"a": model(top=include("b.xml")), "b": model(top=include("b.xml"))}, "b", 1, "b.xml -> b.xml"),
        ({"a": model(top=include("b.xml")), "b": model(names("a.xml"))}, "b", 2, "a.xml -> b.xml -> a.xml"),
        ({"a": model(names("b.xml")), "b": model(top=include("a.xml"))}, "b", 1, "a.xml -> b.xml -> a.xml"),
        (
            {"a": model(names("b.xml")), "b": model(top=include("c.xml")), "c": model(names("b.xml"))},
            "c",
            2,
            "b.xml -> c.xml -> b.xml",
        ),
        # A model in a folder of its own names files from there.
        ({"a": model(names("b/a.xml")), "b__a": model(names("../a.xml"))}, "b/a", 2, "a.xml -> a.xml -> a.xml"),
        # MuJoCo looks for what an included file includes beside the model, then beside that file.
        ({"a": model(top=include("b/c.xml")), "b__c": model(top=include("c.xml"))}, "b/c", 1, "c.xml -> c.xml"),
    ],
)
def test_a_circle_of_files_is_named_with_file_and_line(check, tmp_path, files, where, line, circle):
    with pytest.raises(DescriptionError, match=f"closes a circle of files, {re.escape(circle)}:") as caught:
        check(**files)
    assert (caught.value.file, caught.value.line) == (str(tmp_path / f"{where}.xml"), line)


def test_a_file_may_be_named_twice_without_a_circle(check):
    part = model(top=include("shared.xml"))
    check(a=model(names("b.xml", "b") + names("c.xml", "c")), b=part, c=part, shared=model())
    # Of the same name, in the folder from which it is named.
    check(a=model(names("sub/b.xml")), sub__b=model(names("c.xml")), sub__c=model(), c=model(names("sub/b.xml")))


@pytest.mark.parametrize("inside", [lambda file: model(names(file)), lambda file: model(top=include(file))])
def test_files_within_files_within_files(check, inside):
    check(**{f"f{n}": inside(f"f{n + 1}.xml") for n in range(16)}, f16=model())
    with pytest.raises(DescriptionError, match="nested more than 16 deep") as caught:
        check(**{f"f{n}": inside(f"f{n + 1}.xml") for n in range(17)}, f17=model())
    assert caught.value.file.endswith("f16.xml")


def test_files_that_each_name_the_next_twice(check):
    twice = {f"f{n}": model(names(f"f{n + 1}.xml", "b") + names(f"f{n + 1}.xml", "c")) for n in range(12)}
    with pytest.raises(DescriptionError, match="more than 200 files"):
        check(**twice, f12=model())


def test_models_count_as_often_as_they_are_attached(check):
    def ten(file):
        return model(names(file), "".join(ATTACH.format(n, "m") for n in range(10)))

    check(a=ten("b.xml"), b=ten("c.xml"), c=model())
    with pytest.raises(DescriptionError, match="more than 2000 bodies"):
        check(a=ten("b.xml"), b=ten("c.xml"), c=ten("d.xml"), d=ten("e.xml"), e=model())
    # By an included file too.
    included = {"top": model(names("c.xml"), top=include("list.xml")), "list": ten("none.xml"), "c": ten("d.xml")}
    with pytest.raises(DescriptionError, match="more than 2000 bodies"):
        check(**included, d=ten("e.xml"), e=ten("f.xml"), f=model())


def test_a_pipe_beside_an_included_file_is_not_opened(check, tmp_path):
    import os

    (tmp_path / "sub").mkdir()
    os.mkfifo(tmp_path / "sub" / "pipe.xml")
    with pytest.raises(DescriptionError, match="no regular file"):
        check(a=model(top=include("sub/b.xml")), sub__b=model(top=include("pipe.xml")))


LARGE = "9" * 101


@pytest.mark.parametrize(
    ("inner", "message"),
    [
        ('<body pos="0 0 1e308"/>', "pos of <body> is 1e\\+308, too large"),
        (f'<body pos="0 -{LARGE} 0"/>', "pos of <body> is 1e\\+101, too large"),
        ('<geom size="1" mass="1E+300"/>', "mass of <geom> is 1e\\+300, too large"),
        ('<joint name="knee" armature="-1"/>', "negative armature -1 of <joint> 'knee'"),
        ('<joint damping="-0.5"/>', "negative damping -0.5 of <joint>"),
        ('<joint frictionloss="-2"/>', "negative frictionloss -2 of <joint>"),
        (f'<joint name="{"x" * 5000}"/>', "name of <joint> has 5000 characters"),
    ],
)
def test_what_no_mechanism_can_have_is_named_with_its_line(check, inner, message):
    with pytest.raises(DescriptionError, match=message) as caught:
        check(a=model(inner=f"\n\n{inner}"))
    assert caught.value.line == 4


@pytest.mark.parametrize(
    "inner", ['<joint range="-1e300 1e300"/>', '<body name="1e300"/>', '<geom size="1e99" material="a1e300"/>']
)
def test_what_only_looks_large_passes(check, inner):
    check(a=model(inner=inner))


def test_more_constraints_than_joints_could_need_are_refused(check):
    connect = '<connect body1="a" body2="b" anchor="0 0 0"/>\n'
    joints = "<body><joint/></body><body><freejoint/></body>"

    def text(count):
        return model(inner=joints, top=f"<equality>\n{connect * count}</equality>")

    check(a=text(64))
    with pytest.raises(DescriptionError, match=r"65 constraints in <equality> on 7 joints, the most is 64") as caught:
        check(a=text(65))
    assert caught.value.line == 66
