"""Files that are wrong in every way, made where and when a test needs them, and a child process that loads them.

python malformed.py FOLDER NAME...     loads those cases and prints a JSON line for each
"""

from __future__ import annotations

import importlib
import json
import os
import resource
import signal
import stat
import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

Source = str | Path
BIG = 10_000_000
LARGE = 2_000_000
LEGAL = "legal"
INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>'
ARM = f"""<?xml version="1.0"?>
<robot name="arm">
  <link name="base"/>
  <link name="upper">{INERTIAL}</link>
  <link name="lower">{INERTIAL}</link>
  <joint name="shoulder" type="revolute">
    <parent link="base"/><child link="upper"/><origin xyz="0 0 1"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/>
  </joint>
  <joint name="elbow" type="revolute">
    <parent link="upper"/><child link="lower"/><origin xyz="0 0 1"/><axis xyz="0 1 0"/>
  </joint>
</robot>
"""


@dataclass(frozen=True)
class Case:
    """How a source is made, and what reading it must say.

    `error` names the class, or is `LEGAL`; `match` is a part of the message; `line` is where, None where there is no
    line, and -1 where any line will do. Large files may take `seconds` of processor time.
    """

    make: Callable[[Path], Source]
    error: str = "DescriptionError"
    match: str = ""
    line: int | None = -1
    seconds: float = 2.0
    load: bool = False
    """By `leg_dynamics.load` and a torque, instead of by reading alone."""


def text(content: str) -> Callable[[Path], Source]:
    return lambda _: content


def file(content: str | bytes, name: str = "robot.urdf") -> Callable[[Path], Source]:
    def make(folder: Path) -> Path:
        path = folder / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return make


def pair(sidecar: str | bytes, urdf: str = ARM) -> Callable[[Path], Source]:
    """A URDF file and the YAML file beside it."""

    def make(folder: Path) -> Path:
        file(sidecar, "robot.yaml")(folder)
        return Path(file(urdf)(folder))

    return make


def swapped(old: str, new: str) -> str:
    assert old in ARM, old
    return ARM.replace(old, new, 1)


def robot(*parts: str) -> str:
    return '<robot name="x"><link name="a"/>' + "".join(parts) + "</robot>"


def child(name: str, parent: str = "a", kind: str = "revolute", body: str = INERTIAL) -> str:
    return (
        f'<link name="{name}">{body}</link><joint name="to_{name}" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{name}"/><axis xyz="0 0 1"/></joint>\n'
    )


def chain(size: int, kind: str = "revolute") -> str:
    """A chain of about so many bytes."""
    link = child("l10000", "l10000", kind)
    return robot(child("l0"), *(child(f"l{n}", f"l{n - 1}", kind) for n in range(1, size // len(link))))


def followers(count: int) -> str:
    """Joints that each mimic the one behind."""
    mimic = "<mimic joint='to_f{}'/></joint>"
    return robot(
        *(child(f"f{n}").replace("</joint>", mimic.format(n + 1)) for n in range(count - 1)), child(f"f{count - 1}")
    )


def entangled(joints: int, couplings: int) -> str:
    ends = f'<predecessor link="a"/><successor link="l{joints - 1}"/><ratio value="2"/>'
    links = (child(f"l{n}", f"l{n - 1}" if n else "a") for n in range(joints))
    return robot(*links, *(f'<coupling name="c{n}">{ends}</coupling>' for n in range(couplings)))


def laughs(external: str = "") -> str:
    entities = "".join(f'<!ENTITY l{n} "{f"&l{n - 1};" * 10}">' for n in range(1, 10))
    return f'<!DOCTYPE r [<!ENTITY l0 "ha">{entities}{external}]>\n<robot name="&l9;"><link name="a"/></robot>'


def fifo(folder: Path) -> Path:
    path = folder / "robot.urdf"
    os.mkfifo(path)
    return path


def forbidden(folder: Path) -> Path:
    path = Path(file(ARM)(folder))
    path.chmod(0)
    return path


def dangling(folder: Path) -> Path:
    path = folder / "robot.urdf"
    path.symlink_to(folder / "robot.urdf")
    return path


def padded(folder: Path) -> Path:
    return Path(file(ARM + "\n" * (2 * BIG))(folder))


def sidecar_fifo(folder: Path) -> Path:
    os.mkfifo(folder / "robot.yaml")
    return Path(file(ARM)(folder))


MESH = '<visual><geometry><mesh filename="{}"/></geometry></visual>'
LOST_MESHES = (
    "package://../../etc/passwd",
    "package://robot/../../etc/passwd",
    "package://robot/%2e%2e/%2e%2e/passwd",
    "file://../../../../etc/passwd",
    "../../../../../../../../etc/passwd",
    "..\\..\\..\\..\\etc\\passwd",
    "a/../../../../../b.stl",
)
MESHES = (
    "package://robot/meshes/../a.stl",
    "package:///a.stl",
    "../../meshes/a.stl",
    "file:///etc/passwd",
    "/etc/passwd",
    "http://127.0.0.1:9/a.stl",
    "a\\..\\..\\b.stl",
    "/dev/zero",
)
LOOP = '<loop name="l" type="{}"><predecessor link="{}"/><successor link="{}"/>{}</loop></robot>'


def loops(count: int) -> str:
    ends = '<predecessor link="base"/><successor link="lower"/>'
    return "".join(f'<loop name="l{n}" type="spherical">{ends}</loop>\n' for n in range(count)) + "</robot>"


MOTOR = '<transmission name="t"><joint name="{}"/><actuator name="m"/></transmission></robot>'
EXTREME = ("1e308", "-1e308", "1e-320", "1.7976931348623157e308", "5e-324")
BOMB = "closed_loop: [[a1, a2]]\nz0: &a0 [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"z{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]\n" for n in range(1, 12)
)

CASES: dict[str, Case] = {
    # ------------------------------------------------------------------ bytes that are no text
    "empty file": Case(file(b""), match="empty", line=None),
    "one byte": Case(file(b"<"), match="malformed", line=1),
    "binary": Case(file(bytes(range(256)) * 40), match="not UTF-8"),
    "zeros": Case(file(b"\x00" * 5000), match="malformed"),
    "NUL in a name": Case(file(swapped('"lower"', '"lo\x00wer"')), match="malformed", line=5),
    "NUL at the end": Case(file(ARM + "\x00"), match="malformed|junk", line=14),
    "control character": Case(file(swapped('"lower"', '"lo\x07wer"')), match="malformed", line=5),
    "UTF-16": Case(file(ARM.encode("utf-16")), LEGAL),
    "UTF-16, cut": Case(file(ARM.encode("utf-16")[:-3]), match="not UTF-16"),
    "UTF-16 without mark": Case(file(ARM.encode("utf-16-le")), match="NUL character", line=1),
    "UTF-16 text, UTF-8 bytes": Case(file(ARM.replace("?>", ' encoding="UTF-16"?>')), LEGAL),
    "UTF-32": Case(file(ARM.encode("utf-32")), match="not UTF-8|malformed", line=1),
    "Latin-1 declared": Case(file(ARM.replace("?>", ' encoding="latin-1"?>').encode()), LEGAL),
    "Latin-1 in fact": Case(file(ARM.replace("arm", "\u00e4rm").encode("latin-1")), match="not UTF-8", line=2),
    "unknown encoding": Case(file(ARM.replace("?>", ' encoding="klingon"?>')), LEGAL),
    "two byte order marks": Case(file("\ufeff\ufeff" + ARM), match="two byte order marks", line=1),
    "byte order mark": Case(file("\ufeff" + ARM), LEGAL, load=True, seconds=6.0),
    "byte order mark inside": Case(file(swapped("<link", "\ufeff<link")), LEGAL),
    "overlong slash": Case(file(ARM.encode().replace(b"arm", b"\xc0\xaf")), match="not UTF-8", line=2),
    "surrogate bytes": Case(file(ARM.encode().replace(b"arm", b"\xed\xa0\x80")), match="not UTF-8", line=2),
    "surrogate reference": Case(text(swapped("arm", "&#xD800;")), match="malformed", line=2),
    "NUL reference": Case(text(swapped("arm", "&#0;")), match="malformed", line=2),
    "gzip": Case(file(b"\x1f\x8b\x08\x00" + b"\x00" * 50), match="not UTF-8", line=1),
    # ------------------------------------------------------------------ what is no regular file
    "folder": Case(lambda folder: folder, "LegNotFoundError", "it is a folder", None),
    "folder with suffix": Case(
        lambda folder: (folder / "a.urdf").mkdir() or folder / "a.urdf", "LegNotFoundError", "folder", None
    ),
    "named pipe": Case(fifo, "LegNotFoundError", "not a regular file", None),
    "named pipe as text": Case(lambda folder: str(fifo(folder)), "LegNotFoundError", "not a regular file", None),
    "endless device": Case(lambda _: Path("/dev/zero"), "LegNotFoundError", "not a regular file", None),
    "empty device": Case(lambda _: "/dev/null", "LegNotFoundError", "not a regular file", None),
    "link to itself": Case(dangling, "LegNotFoundError", "no such file", None),
    "no permission": Case(forbidden, match="cannot be read", line=None),
    "sidecar is a pipe": Case(sidecar_fifo, match="robot.yaml: .*no regular file", line=None),
    "NUL in the path": Case(text("a\x00b.urdf"), "LegNotFoundError", "no such file", None),
    "surrogate in the path": Case(text("a\udc80.urdf"), "LegNotFoundError", "no such file", None),
    # ------------------------------------------------------------------ XML that eats memory
    "laughs": Case(text(laughs()), "UnsafeXmlError", "DOCTYPE", 1),
    "laughs in a file": Case(file(laughs()), "UnsafeXmlError", "DOCTYPE", 1, load=True),
    "external entity": Case(text(laughs('<!ENTITY x SYSTEM "file:///etc/passwd">')), "UnsafeXmlError", "DOCTYPE", 1),
    "endless entity": Case(text(laughs('<!ENTITY x SYSTEM "file:///dev/zero">')), "UnsafeXmlError", "DOCTYPE", 1),
    "parameter entity": Case(
        text(laughs('<!ENTITY % x SYSTEM "http://127.0.0.1:9/"> %x;')), "UnsafeXmlError", "DOCTYPE", 1
    ),
    "second DOCTYPE": Case(text(ARM + laughs()), match="malformed", line=14),
    "DOCTYPE inside": Case(text(swapped("<link", "<!DOCTYPE r>\n<link")), match="malformed", line=3),
    "xinclude": Case(text(robot('<xi:include xmlns:xi="http://www.w3.org/2001/XInclude" href="/etc/passwd"/>')), LEGAL),
    "stylesheet": Case(text('<?xml-stylesheet href="file:///etc/passwd"?>' + robot()), LEGAL),
    "many links, loaded": Case(lambda _: chain(BIG), "UnsafeXmlError", "more than 10000 <link>", -1, load=True),
    "many joints, loaded": Case(
        lambda _: chain(BIG // 6), "UnsupportedError", "tree joints are too many", -1, load=True
    ),
    "many welded links, loaded": Case(
        lambda _: robot(
            child("m"), chain(3_000_000, "fixed")[len('<robot name="x"><link name="a"/>') : -len("</robot>")]
        ),
        "UnsafeXmlError",
        "more than 10000 <link>",
        load=True,
    ),
    "long welded chain, loaded": Case(
        lambda _: robot(
            child("m"), chain(400_000, "fixed")[len('<robot name="x"><link name="a"/>') : -len("</robot>")]
        ),
        "UnsupportedError",
        "joints in a chain",
        -1,
        load=True,
    ),
    "links without joints": Case(
        lambda _: robot(*(f'<link name="k{n}"/>\n' for n in range(160_000))),
        "UnsafeXmlError",
        "more than 10000 <link>",
        10_000,
    ),
    "one link twice, far apart": Case(
        lambda _: robot(*(f'<link name="k{n}"/>\n' for n in range(9_998)), '<link name="k0"/>'),
        match="duplicate <link> name 'k0'",
        line=9_999,
    ),
    "a name that is nearly all others": Case(
        lambda _: robot(*(f'<link name="link_{n}"/>\n' for n in range(9_990)), child("x", "link_")),
        match="unknown link 'link_'",
        line=9_991,
    ),
    "many unknown elements": Case(
        lambda _: robot(*(f"<q{n}/>" for n in range(LARGE // 10))), "UnsafeXmlError", "more than"
    ),
    "some unknown elements": Case(lambda _: robot(*(f"<q{n}/>" for n in range(50_000))), LEGAL),
    "many foreign elements": Case(lambda _: robot("<gazebo/>" * (LARGE // 9)), LEGAL, seconds=6.0),
    "many elements in one": Case(
        lambda _: swapped("</link>", "<q/>" * (LARGE // 4) + "</link>"), "UnsafeXmlError", "100000 elements"
    ),
    "many poses": Case(
        lambda _: robot(*(f'<configuration name="c{n}"/>' for n in range(160_000))), "UnsafeXmlError", "more than"
    ),
    "huge comment": Case(lambda _: robot(f"<!--{'y' * BIG}-->"), LEGAL),
    "huge instruction": Case(lambda _: robot(f"<?x {'y' * LARGE}?>"), LEGAL),
    "huge comment, not closed": Case(lambda _: robot(f"<!--{'y' * LARGE}"), match="malformed.*truncated"),
    "huge name": Case(lambda _: robot(f'<link name="{"y" * BIG}"/>'), match="00000 characters", line=1),
    "huge parent": Case(lambda _: robot(child("b", "y" * BIG)), match="00000 characters", line=1),
    "huge type": Case(lambda _: robot(child("b", kind="y" * LARGE)), match="00000 characters"),
    "huge tag": Case(lambda _: robot(f"<{'y' * LARGE}/>"), "UnsafeXmlError", "00000 characters", 1),
    "huge root": Case(lambda _: f"<{'y' * LARGE}/>", "UnsafeXmlError", "00000 characters", 1),
    "huge number": Case(
        lambda _: swapped('mass value="1"', f'mass value="{"1" * LARGE}"'), match="00000 characters", line=4
    ),
    "huge vector": Case(lambda _: swapped("0 0 1", "0 " * (LARGE // 2)), match="3 numbers, got 1000000", line=7),
    "many attributes": Case(
        lambda _: swapped('"base"', '"base" ' + " ".join(f'a{n}="1"' for n in range(LARGE // 20))),
        "UnsafeXmlError",
        "100001 attributes, the most is 1000",
        3,
    ),
    "very many attributes": Case(
        lambda _: swapped('"base"', '"base" ' + " ".join(f'a{n}="1"' for n in range(BIG // 8))),
        "UnsafeXmlError",
        "a tag has more than 4000000 characters",
        3,
    ),
    "many loops": Case(
        lambda _: swapped("</robot>", loops(5000)), match="5000 loops on 2 moving joints, the most is 54", line=67
    ),
    "very many loops": Case(
        lambda _: swapped("</robot>", loops(20_000)), "UnsafeXmlError", "more than 10000 <loop>", 10_013
    ),
    "many couplings": Case(
        lambda _: entangled(3, 1000), match="1000 couplings on 3 moving joints, the most is 56", line=4
    ),
    "file of 20 MB": Case(padded, match="20000\\d+ bytes, the most is 16000000"),
    "huge flag": Case(
        lambda _: swapped('type="revolute"', f'type="revolute" independent="{"y" * LARGE}"'),
        match="true or false",
        line=6,
    ),
    "huge text": Case(
        lambda _: robot("<transmission name='t'><joint name='j'>", "7" * LARGE, "</joint></transmission>"),
        "UnsafeXmlError",
        "65536 characters",
    ),
    "huge file name": Case(
        lambda _: robot('<link name="b">', MESH.format("y" * LARGE), "</link>"), match="00000 characters", line=1
    ),
    "deep": Case(lambda _: robot("<q>" * (BIG // 7), "</q>" * (BIG // 7)), "UnsafeXmlError", "64 deep", 1),
    "deep, not closed": Case(lambda _: "<q>" * (LARGE // 3), "UnsafeXmlError", "64 deep", 1),
    "huge file that ends early": Case(lambda _: chain(1_600_000)[:-9], match="truncated"),
    "parents in a large cycle": Case(
        lambda _: chain(1_000_000).replace(
            '<link name="a"/>',
            '<link name="a"/>'
            + child("b", "l2000")
            .replace('<link name="b">', '<link name="c">')
            .replace('child link="b"', 'child link="a"'),
            1,
        ),
        match="cycle: .*\\.\\.\\.",
    ),
    "followers in a long row": Case(lambda _: followers(9_000), LEGAL, seconds=6.0),
    "followers in a large cycle": Case(
        lambda _: followers(9_000).replace("</joint>\n</robot>", "<mimic joint='to_f0'/></joint></robot>"),
        match="mimic joints form a cycle: .*\\.\\.\\.",
    ),
    "couplings over everything": Case(lambda _: entangled(8000, 3000), match="run over more than 300000 joints"),
    # ------------------------------------------------------------------ numbers at the ends of the scale
    **{
        f"{word} in {where}": Case(
            text(swapped(old, old.replace(old.split('"')[1].split()[-1], word))),
            "DescriptionError" if word.startswith(("nan", "inf", "1e309", "-1e999")) else LEGAL,
            "finite",
        )
        for word in ("nan", "inf", "1e309", "-1e999", "1e-9999")
        for where, old in (("an origin", 'xyz="0 0 1"'), ("a limit", 'upper="1"'), ("a mass", 'value="1"'))
        if not (word == "1e-9999" and where == "a limit")
    },
    # ------------------------------------------------------------------ meshes elsewhere: names only, nothing is opened
    **{
        f"mesh {name}": Case(text(swapped(f'"upper">{INERTIAL}', f'"upper">{INERTIAL}{MESH.format(name)}')), LEGAL)
        for name in MESHES
    },
    **{
        f"mesh {name}": Case(
            text(swapped(f'"upper">{INERTIAL}', f'"upper">{INERTIAL}\n{MESH.format(name)}')),
            match="leaves its package|climbs",
            line=5,
        )
        for name in LOST_MESHES
    },
    "mesh of a collision": Case(
        text(swapped("</link>", f"\n{MESH.format(LOST_MESHES[0]).replace('visual', 'collision')}</link>")),
        match="leaves its package",
        line=5,
    ),
    **{
        f"{value} in a pose": Case(
            text(
                swapped('type="revolute"', f'type="{kind}"').replace(
                    "</robot>",
                    f'<configuration name="home">\n<joint name="shoulder" value="{value}"/></configuration></robot>',
                )
            ),
            match="too large to compute with",
            line=14,
        )
        for value, kind in (("1e308", "revolute"), ("-1e308", "prismatic"), ("2e6", "continuous"))
    },
    "mesh without name": Case(text(robot('<link name="b">', MESH.format(""), "</link>")), match="filename.*empty"),
    # ------------------------------------------------------------------ structure
    "robot without anything": Case(text('<robot name="x"/>'), match="no <link>", line=1),
    "one link": Case(text(robot()), LEGAL),
    "one link, loaded": Case(text(robot()), match="no joint is independent|no moving joint", line=None, load=True),
    "joints only": Case(text('<robot name="x"><joint name="j" type="fixed"/></robot>'), match="no <link>", line=1),
    "robot in a robot": Case(text(f"<robot name='y'>\n{robot()}</robot>"), match="no <link>", line=1),
    "child is the root": Case(text(swapped('child link="upper"', 'child link="base"')), match="itself", line=6),
    "two cycles, no root": Case(
        text(swapped('parent link="base"', 'parent link="lower"').replace('  <link name="base"/>\n', "")),
        match="cycle",
    ),
    "loop of an unknown type": Case(
        text(swapped("</robot>", LOOP.format("gear", "base", "lower", ""))), match="unsupported type 'gear'", line=13
    ),
    "loop to nowhere": Case(
        text(swapped("</robot>", LOOP.format("fixed", "base", "Lower", ""))), match="unknown link 'Lower'", line=13
    ),
    "loop on itself": Case(
        text(swapped("</robot>", LOOP.format("fixed", "lower", "lower", ""))), match="both ends", line=13
    ),
    "loop with a tiny axis": Case(
        text(swapped("</robot>", LOOP.format("revolute", "base", "lower", '<axis xyz="0 0 1e-300"/>'))),
        match="zero axis",
        line=13,
    ),
    "loop that cannot close, loaded": Case(
        text(
            swapped(
                "</robot>",
                LOOP.format("spherical", "base", "lower", "").replace(
                    '<successor link="lower"/>', '<successor link="lower"><origin xyz="9 9 9"/></successor>'
                ),
            )
        ),
        "LegDynamicsError",
        seconds=6.0,
        load=True,
        line=-1,
    ),
    "motor on a welded joint": Case(
        text(swapped('type="revolute"', 'type="fixed"').replace("</robot>", MOTOR.format("shoulder"))),
        match="is fixed",
        line=13,
    ),
    "motor on nothing": Case(text(swapped("</robot>", MOTOR.format("knee"))), match="unknown joint 'knee'", line=13),
    "attribute in a namespace": Case(
        text(swapped('link="base"', 'x:link="base"')), match="<parent> has no link", line=7
    ),
    "uppercase tags": Case(text(ARM.replace("link", "Link").replace("joint", "Joint")), match="no <link>", line=2),
    "HTML": Case(text("<!DOCTYPE html>\n<html><body>404</body></html>"), "UnsafeXmlError", "DOCTYPE", 1),
    "unbound prefix": Case(text(robot("<xacro:macro name='m'/>")), match="xacro.*render", line=1),
    # ------------------------------------------------------------------ the YAML file beside
    "alias bomb": Case(pair(BOMB), match="unknown key", line=2),
    "alias bomb in place": Case(
        pair(
            BOMB.replace("closed_loop: [[a1, a2]]\n", "").replace("z0", "joint_name").replace("z1:", "type:")
            + "closed_loop: *a11\n"
        ),
        match="",
        line=-1,
    ),
    "alias of itself": Case(pair("closed_loop: &a [*a]\n"), match="must be a list of 2|recursive", line=1),
    "alias of nothing": Case(pair("closed_loop: *a\n"), match="undefined alias", line=1),
    "Python tag": Case(pair("closed_loop: !!python/object/apply:os.system ['true']\n"), match="must be a list", line=1),
    "Python tag as a value": Case(
        pair("closed_loop: [[shoulder, elbow]]\nname_mot: !!python/name:os.system\n"), match="must be text", line=2
    ),
    "key twice": Case(pair("closed_loop: []\nclosed_loop: []\n"), match="twice", line=2),
    "merge key": Case(pair("closed_loop: []\n<<: {type: []}\n"), match="unknown key '<<'", line=2),
    "two documents": Case(pair("closed_loop: []\n---\nclosed_loop: []\n"), match="malformed YAML", line=2),
    "YAML list": Case(pair("- closed_loop: []\n"), match="must be a mapping", line=1),
    "YAML word": Case(pair("hello"), match="must be a mapping", line=1),
    "empty YAML": Case(pair(""), match="file is empty", line=1),
    "YAML of random bytes": Case(pair(bytes(range(128, 256)) * 40), match="not UTF-8", line=1),
    "YAML cut in the first key": Case(pair("closed_l"), match="must be a mapping", line=1),
    "YAML one level too deep": Case(pair("robot: {closed_loop: []}\n"), match="unknown key 'robot'", line=1),
    "YAML after a huge comment": Case(pair(f"# {'x' * LARGE}\nclosed_loop: []\n"), match="2000019 characters", line=1),
    "YAML of 4 MB": Case(pair("# x\n" * 1_000_001 + "closed_loop: []\n"), match="4000000", line=1_000_001),
    "YAML null": Case(pair("closed_loop:\n"), match="must be a list", line=1),
    "YAML in UTF-16": Case(pair("closed_loop: []\n".encode("utf-16")), LEGAL),
    "YAML with NUL": Case(pair("closed_loop: []\n\x00"), match="malformed YAML", line=-1),
    "YAML with a tab": Case(pair("closed_loop:\n\t- [a, b]\n"), match="malformed YAML", line=2),
    "YAML in Latin-1": Case(pair(b"closed_loop: []\nname_mot: \xe9\n"), match="not UTF-8", line=2),
    "deep YAML": Case(pair("closed_loop: " + "[" * 100_000), match="deep|malformed", line=-1),
    "deep closed YAML": Case(pair("closed_loop: " + "[" * 100_000 + "]" * 100_000), match="deep|malformed", line=-1),
    "deep YAML mappings": Case(pair("closed_loop: " + "{a: " * 50_000 + "}" * 50_000), match="deep|malformed", line=-1),
    "huge YAML": Case(pair("closed_loop: []\nname_mot: [" + "a, " * (LARGE // 3) + "]\n"), match="characters", line=2),
    "huge YAML key": Case(pair("closed_loop: []\n? " + "a" * LARGE + "\n: 1\n"), match="characters", line=2),
    "assembly bomb": Case(
        file(BOMB.replace("closed_loop: [[a1, a2]]\n", "modules: {}\n"), "bomb.yaml"), match="unknown key", line=2
    ),
    "assembly of a pipe": Case(
        lambda folder: fifo(folder).rename(folder / "pipe.yaml"), "LegNotFoundError", "not a regular file", None
    ),
    "deep assembly": Case(file("modules: " + "[" * 100_000 + "]" * 100_000, "deep.yaml"), match="deep|malformed"),
    # ------------------------------------------------------------------ by load, up to a number
    "half a file, loaded": Case(file(ARM[: len(ARM) // 2]), match="truncated", load=True),
    "binary, loaded": Case(file(bytes(range(256))), match="not UTF-8", load=True),
    "named pipe, loaded": Case(fifo, "LegNotFoundError", "not a regular file", None, load=True),
    "arm, loaded": Case(file(ARM), LEGAL, load=True, seconds=6.0),
    **{
        f"length {word}, loaded": Case(
            text(ARM.replace('xyz="0 0 1"', f'xyz="0 0 {word}"')), "any", line=-1, load=True, seconds=6.0
        )
        for word in EXTREME
    },
    **{
        f"mass {word}, loaded": Case(
            text(ARM.replace('mass value="1"', f'mass value="{word}"')), "any", line=-1, load=True, seconds=6.0
        )
        for word in EXTREME[2:] + EXTREME[:1]
    },
    **{
        f"inertia {word}, loaded": Case(
            text(ARM.replace('ixx="1"', f'ixx="{word}"')), "any", line=-1, load=True, seconds=6.0
        )
        for word in EXTREME
    },
    "everything 1e308, loaded": Case(
        text(ARM.replace('xyz="0 0 1"', 'xyz="0 0 1e308"').replace('"1"/>', '"1e308"/>')), "any", load=True, seconds=6.0
    ),
}
# Cut anywhere, a file says where it ends.
CASES |= {
    f"cut after {size}": Case(
        text(ARM[:size]), match="malformed|truncated|empty", line=-1 if ARM[:size].strip() else None
    )
    for size in range(1, ARM.index("</robot>") + len("</robot>"), 23)
}


def _loaded(source: Source) -> Any:
    """The mechanism by two routes, up to a torque; NaN without an error is no answer."""
    import numpy as np

    import leg_dynamics as ld

    for route in ("pinocchio", "symbolic"):
        leg = ld.load(source, route=route)
        n = len(leg.joint_names)
        q, v = np.full(n, 0.1), np.full(n, 0.2)
        torque = leg.torque(q, v, v)
        if not np.isfinite([*torque, *leg.mass_matrix(q).ravel(), *leg.bias(q, v)]).all():
            raise AssertionError(f"not finite without an error: {torque} by {route}")
    return leg


def attempt(case: Case, folder: Path) -> dict[str, Any]:
    """Load one case; what it raised, where, and what it took."""
    from leg_dynamics.description import read
    from leg_dynamics.errors import LegDynamicsError

    source = case.make(folder)
    before = time.process_time()
    found: dict[str, Any] = {"error": LEGAL}
    try:
        (_loaded if case.load else read)(source)
    except LegDynamicsError as error:
        kinds = [kind.__name__ for kind in type(error).__mro__]
        found = {"error": kinds[0], "kinds": kinds, "message": str(error)[:5000], "line": getattr(error, "line", None)}
        found["length"] = len(str(error))
    except BaseException as error:
        found = {"error": type(error).__name__, "stray": True, "message": str(error)[:2000]}
    return found | {"seconds": time.process_time() - before}


def main(folder: Path, names: list[str]) -> None:
    """Load cases one after another, in so much memory and time and no more."""
    from leg_dynamics.mechanism import route  # noqa: F401
    from leg_dynamics.symbolic import model  # noqa: F401

    # No compiler: its time and memory are not this test's. The package has a function of the module's name.
    kernels: Any = importlib.import_module("leg_dynamics.kernels.kernel")
    kernels.llvm_is_available = lambda: False
    warnings.simplefilter("ignore")
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * resource.getpagesize() + 500 * 2**20
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    for number, name in enumerate(names):
        own = folder / str(number)
        own.mkdir(mode=stat.S_IRWXU)
        os.chdir(own)
        print(json.dumps({"start": name}), flush=True)
        signal.alarm(120)  # ends the process; a machine may be busy with others
        found = attempt(CASES[name], own)
        signal.alarm(0)
        print(json.dumps({"name": name} | found), flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
