"""The legs of a robot: the groups of joints that hang on its trunk, each as a mechanism of its own.

The trunk is the root link with what is welded to it, or, where the only joint of those is floating or planar, the link
below that joint. Whatever hangs on the trunk falls into groups: the subtrees that begin with a joint on the trunk,
those that a loop, a coupling or a mimic joins taken together. A group is called a leg here, be it an arm or a head.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

from leg_dynamics.description.model import Description, Joint
from leg_dynamics.description.parse import build, driven_joints
from leg_dynamics.description.topology import coupling_paths
from leg_dynamics.description.xml_reader import Document, Node, nearest, read_root
from leg_dynamics.errors import DescriptionError, ParameterError

__all__ = ["LegPart", "leg_part", "legs_of", "part_of"]

_FOOT_WORDS = ("foot", "toe", "sole", "contact", "ankle")
_SENSOR_WORDS = ("imu", "sensor", "camera")
_IDLE_WORDS = frozenset({"joint", "link", "jnt", "j"})
_ROOT_ANCESTRY = ("floating", "planar")
_TOKEN = re.compile(r"[A-Z]+(?=[A-Z][a-z])\d*|[A-Z]?[a-z]+\d*|[A-Z]+\d*|\d+")
_START_TAG = re.compile(rb"""<[^\s/>]+(?:\s+[^\s=]+\s*=\s*(?:"[^"]*"|'[^']*'))*\s*(/?)>""")
_DRIVEN = re.compile(r"""\sdriven\s*=\s*(?:"[^"]*"|'[^']*')""")
_NAME = re.compile(r"""(?<=\s)name\s*=\s*(?:"[^"]*"|'[^']*')""")
_SHOWN = 8

_Names = Sequence[Sequence[str]]


@dataclass(frozen=True, slots=True)
class LegPart:
    """One leg of a robot.

    Attributes
    ----------
    name : str
        What tells it from the robot's other legs: the words that all its joints begin or end with, such as ``FL``,
        ``front_right`` or ``left``, without those that all legs share; else the name of its foot link.
    root : str
        The link of the trunk that it hangs on; where it hangs on several, the link that they are all welded to.
    foot : str or None
        Its foot link: the deepest one with foot, toe, sole, contact or ankle in its name, else the deepest link. None
        where several are equally good.
    joint_names : tuple of str
        Its joints that are not fixed, in file order.
    candidates : tuple of str
        The links that are equally good feet; the foot alone where there is one.
    """

    name: str
    root: str
    foot: str | None
    joint_names: tuple[str, ...]
    candidates: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Groups:
    """The trunk's links, and the joints and links of every group in file order."""

    trunk: str
    welded: frozenset[str]
    joints: tuple[tuple[Joint, ...], ...]
    links: tuple[tuple[str, ...], ...]


def legs_of(description: Description) -> Mapping[str, LegPart]:
    """The legs of a robot, by name.

    Foot quantities of a leg are in the frame of its link ``hip`` where it has a link of that very name, as the shipped
    legs have, and in the frame of the trunk, which is its root, everywhere else.

    Parameters
    ----------
    description : Description
        A robot with several groups of joints on its trunk.

    Returns
    -------
    mapping of str to LegPart
        In file order. Arms and heads on the trunk are among them.

    Raises
    ------
    DescriptionError
        The mechanism is a single leg, or a chain or ring that has no feet.
    """
    groups = _groups(description)
    if len(groups.joints) < 2:
        held = "nothing that moves" if not groups.joints else "one group of joints, so that the whole is one leg"
        raise DescriptionError(
            f"{description.name!r} has no several legs: on its trunk {groups.trunk!r} hangs {held}; load it as it is, "
            "and name its foot with foot=",
            file=description.file,
            legs=(),
        )
    feet = [_feet(description, links) for links in groups.links]
    named = _common_names(description, groups)
    if not any(named) and not any(_is_foot_like(link) for links in groups.links for link in links):
        raise DescriptionError(
            f"{description.name!r} has no legs: {len(groups.joints)} groups of joints hang on its trunk "
            f"{groups.trunk!r}, but the names within a group have nothing in common that tells it from the others, and "
            f"no link has {', '.join(_FOOT_WORDS)} in its name; load it as it is, and name its foot with foot=",
            file=description.file,
            legs=(),
        )
    legs: dict[str, LegPart] = {}
    for name, candidates, joints in zip(named, feet, groups.joints, strict=True):
        foot = candidates[0] if len(candidates) == 1 else None
        first = next(joint.child for joint in joints if joint.parent in groups.welded)
        # The last one is for a file that names a leg's first link like another leg.
        known = (name, foot, first, f"leg_{len(legs) + 1}")
        own = next(each for each in known if each and each not in legs)
        moving = tuple(joint.name for joint in joints if joint.type != "fixed")
        legs[own] = LegPart(own, _hold(description, joints, groups), foot, moving, candidates)
    return MappingProxyType(legs)


def part_of(description: Description, name: str, foot: str | None = None) -> LegPart:
    """One leg of a robot, with its foot.

    Parameters
    ----------
    description : Description
        A robot with several legs.
    name : str
        A key of `legs_of`, without regard to case where no other differs by case alone; or a link of the leg, which
        is then its foot.
    foot : str, optional
        The foot link.

    Returns
    -------
    LegPart
        With the foot that is asked for.

    Raises
    ------
    DescriptionError
        There is no such leg, the foot is no link of it, or several links are equally good feet and none is given.
    ParameterError
        The name or the foot is no text.
    """
    legs = legs_of(description)
    for what, value, known in (("a leg", name, legs), ("a foot", "" if foot is None else foot, ())):
        if not isinstance(value, str):
            raise ParameterError(
                f"{what} of {description.name!r} is asked for by its name, a text, not by {type(value).__name__} "
                f"{value!r:.80}" + (f"; its legs: {', '.join(known)}" if known else ": foot= is the name of a link"),
                parameter="name" if known else "foot",
            )
    groups = _groups(description)
    alike = [leg for leg in legs.values() if leg.name.lower() == name.lower()]
    part = legs.get(name) or (alike[0] if len(alike) == 1 else None)
    if part is None and description.has_link(name) and name not in groups.welded:
        owners = [leg for leg, links in zip(legs.values(), groups.links, strict=True) if name in links]
        part, foot = (owners[0] if owners else None), (name if foot is None else foot)
    listed = ", ".join(legs)
    if part is None:
        what = "a link of its trunk, not of a leg" if name in groups.welded else "neither a leg nor a link of one"
        raise DescriptionError(
            f"{name[:80]!r} of {description.name!r} is {what}{nearest(name[:80], [*legs])} (its legs: {listed})",
            file=description.file,
            legs=tuple(legs),
        )
    if foot is None:
        if part.foot is None:
            shown = ", ".join(part.candidates[:_SHOWN]) + (", ..." if len(part.candidates) > _SHOWN else "")
            raise DescriptionError(
                f"the leg {part.name!r} of {description.name!r} has {len(part.candidates)} links that are equally good "
                f"feet: {shown}; name one with foot=",
                file=description.file,
                candidates=part.candidates,
            )
        return part
    own = dict(zip(legs, groups.links, strict=True))[part.name]
    if foot not in own:
        raise DescriptionError(
            f"{foot[:80]!r} is no link of the leg {part.name!r} of {description.name!r}{nearest(foot[:80], own)} (its "
            f"links: {', '.join(own)})",
            file=description.file,
            candidates=own,
        )
    return replace(part, foot=foot, candidates=(foot,))


def leg_part(description: Description, name: str, foot: str | None = None) -> Description:
    """One leg of a robot as a mechanism of its own, on the trunk as its fixed base.

    It has the trunk's links and the leg's, under their names, with the loops, couplings, transmissions, limits,
    constraints and named poses among them. Its root is the trunk: gravity and foot quantities are in the trunk's frame,
    or, where there is a link named ``hip``, in that link's. Where the robot has transmissions and none of them is on
    the leg alone, nothing drives the leg; where it has none, its independent joints are driven as the robot's are.

    Parameters
    ----------
    description : Description
        A robot with several legs.
    name, foot : str
        As for `part_of`, which says which link the foot is: a description does not.

    Returns
    -------
    Description
        Named after robot and leg; `parameters` are the robot's.

    Raises
    ------
    DescriptionError
        As `part_of`.
    """
    leg = part_of(description, name, foot)
    groups = _groups(description)
    index = next(i for i, joints in enumerate(groups.joints) if leg.joint_names[0] in {each.name for each in joints})
    links = groups.welded | set(groups.links[index])
    joints = {each.name for each in description.joints if each.parent in links and each.child in links}
    text = _reduced(description, f"{description.name}_{leg.name}", links, joints)
    document = Document(description.file, source=description.source, quiet=True)
    return build(text, document, description.parameters)


def _groups(description: Description) -> _Groups:
    trunk = description.root
    children: dict[str, list[Joint]] = {}
    for joint in description.joints:
        children.setdefault(joint.parent, []).append(joint)

    def below(start: str, only_fixed: bool) -> list[str]:
        found, pending = [], [start]
        while pending:
            found.append(link := pending.pop())
            pending += [each.child for each in children.get(link, ()) if each.type == "fixed" or not only_fixed]
        return found

    while True:
        welded = frozenset(below(trunk, only_fixed=True))
        first = [joint for joint in description.joints if joint.parent in welded and joint.type != "fixed"]
        if len(first) != 1 or first[0].type not in _ROOT_ANCESTRY:
            break
        trunk = first[0].child
    subtree = {link: i for i, joint in enumerate(first) for link in below(joint.child, only_fixed=False)}
    owner = list(range(len(first)))

    def join(links: Iterable[str]) -> None:
        numbers = {owner[subtree[link]] for link in links if link in subtree}
        for i, number in enumerate(owner):
            if number in numbers:
                owner[i] = min(numbers)

    for loop in description.loops:
        join((loop.predecessor.link, loop.successor.link))
    for coupling in description.couplings:
        join(joint.child for path in coupling_paths(description, coupling) for joint in path)
    for joint in description.joints:
        if joint.mimic is not None:
            join((joint.child, description.joint(joint.mimic.joint).child))
    numbers = sorted(set(owner))
    return _Groups(
        trunk,
        welded,
        tuple(
            tuple(each for each in description.joints if each.child in subtree and owner[subtree[each.child]] == number)
            for number in numbers
        ),
        tuple(
            tuple(
                each.name for each in description.links if each.name in subtree and owner[subtree[each.name]] == number
            )
            for number in numbers
        ),
    )


def _hold(description: Description, joints: Iterable[Joint], groups: _Groups) -> str:
    """The link of the trunk that a group hangs on, or the nearest one that carries all that it hangs on."""
    held = {joint.parent for joint in joints if joint.parent in groups.welded}
    lines = []
    for link in held:
        line = [joint.parent for joint in description.path(link)] + [link]
        lines.append(line[line.index(groups.trunk) :])
    common = groups.trunk
    for level in zip(*lines, strict=False):
        if len(set(level)) > 1:
            break
        common = level[0]
    return common


def _feet(description: Description, links: Sequence[str]) -> tuple[str, ...]:
    """The links of a group that are its foot; several where none is better."""
    depth = {link: len(description.path(link)) for link in links}
    parents = {joint.parent for joint in description.joints}
    found = [link for link in links if _is_foot_like(link)]
    found = [link for link in found if not any(word in link.lower() for word in _SENSOR_WORDS)] or found
    found = _best(found or [link for link in links if link not in parents], lambda link: -depth[link])
    if _is_foot_like(found[0]):
        # A plain "l_foot" rather than "l_foot_camera_frame" beside it.
        found = _best(found, lambda link: _tokens(link)[-1].lower() not in _FOOT_WORDS)
        found = _best(found, lambda link: next(i for i, word in enumerate(_FOOT_WORDS) if word in link.lower()))
        found = _best(found, lambda link: len(_tokens(link)))
    return tuple(found)


def _is_foot_like(link: str) -> bool:
    return any(word in link.lower() for word in _FOOT_WORDS)


def _best(links: Sequence[str], cost: Callable[[str], float]) -> list[str]:
    least = min(map(cost, links))
    return [link for link in links if cost(link) == least]


def _tokens(name: str) -> list[str]:
    """The words of a name, by separators and capitals; the name itself where it has none."""
    return _TOKEN.findall(name) or [name]


def _spoken(name: str, words: Sequence[str]) -> str:
    """The piece of a name that some neighbouring words of it make up, without idle ones at its ends."""
    words = list(words)
    while words and words[-1].lower() in _IDLE_WORDS:
        words.pop()
    while words and words[0].lower() in _IDLE_WORDS:
        words.pop(0)
    found = re.search(r"[^A-Za-z0-9]*".join(map(re.escape, words)), name)
    return found[0] if found else ""


def _common_names(description: Description, groups: _Groups) -> list[str]:
    """What the names of each group have in common and no other group's have; empty where there is nothing."""
    joints = [[each.name for each in group if each.type != "fixed"] for group in groups.joints]
    found = [""] * len(joints)
    for names in (joints, groups.links):
        for backwards in (False, True):
            given = _apart(names, backwards)
            found = [old or (new if new not in found else "") for old, new in zip(found, given, strict=True)]
    return found


def _apart(groups: _Names, backwards: bool) -> list[str]:
    """The common beginning (or end) of each group's names, in words, cut down to what differs between the groups."""
    shared = [_shared(names, backwards) for names in groups]
    known = [words for words in shared if words]
    # Words that all groups begin or end with tell nothing: "leg" of leg_left and leg_right.
    lead, tail = _length(known, False), _length(known, True)
    cut = [words[min(lead, len(words)) : len(words) - tail] if len(known) > 1 else words for words in shared]
    names = [_spoken(group[0], words) for group, words in zip(groups, cut, strict=True)]
    folded = [name.lower() for name in names]
    return [name if folded.count(name.lower()) == 1 else "" for name in names]


def _shared(names: Sequence[str], backwards: bool) -> list[str]:
    """The words that all names begin (or end) with, fewer than any of them has."""
    lists = []
    for name in names:
        words = _tokens(name)
        while len(words) > 1 and words[-1].lower() in _IDLE_WORDS:
            words = words[:-1]
        while len(words) > 1 and words[0].lower() in _IDLE_WORDS:
            words = words[1:]
        lists.append(words)
    count = min(_length(lists, backwards), min(map(len, lists)) - 1)
    words = lists[0]
    return words[len(words) - count :] if backwards else words[:count]


def _length(lists: _Names, backwards: bool) -> int:
    """How many words all lists begin (or end) with."""
    count = 0
    for level in zip(*(reversed(words) if backwards else words for words in lists), strict=False):
        if len({word.lower() for word in level}) > 1:
            break
        count += 1
    return count


def _reduced(description: Description, name: str, links: Iterable[str], joints: Iterable[str]) -> str:
    """The text with these links and joints and what is among them; every element stays on its line."""
    links, joints = frozenset(links), frozenset(joints)
    text = description.urdf.removeprefix("\ufeff")
    root = read_root(text, Document(description.file))
    data = text.encode()
    spans = dict(zip(map(id, root.walk()), _spans(data), strict=True))
    driven = {each.joint for each in description.transmissions} & joints

    def drives(node: Node) -> bool:
        return node.tag == "transmission" and any(each.attributes.get("name") in driven for each in driven_joints(node))

    # A transmission to fixed joints was left out of the robot; alone in a part it would be taken for a mistake.
    kept_nodes = [
        node for node in root.children if _stays(node, links, joints) and (node.tag != "transmission" or drives(node))
    ]
    stays = {id(node) for node in kept_nodes}
    unwanted = [node for node in root.children if id(node) not in stays]
    for node in root.children:
        if node.tag == "configuration" and _stays(node, links, joints):
            unwanted += [value for value in node.children if value.attributes.get("name") not in joints]
    kept: list[bytes] = []
    position = 0
    for begin, end in sorted(spans[id(node)] for node in unwanted):
        kept += [data[position:begin], b"\n" * data.count(b"\n", begin, end)]
        position = end
    reduced = b"".join([*kept, data[position:]])
    begin, _ = spans[id(root)]
    tag = _START_TAG.match(reduced, begin)
    assert tag is not None
    named = _NAME.sub(lambda _: f"name={quoteattr(name)}", tag[0].decode(), count=1)
    if description.transmissions and not any(map(drives, kept_nodes)):
        # Without its transmissions the part would count as driven at its independent joints.
        named = _DRIVEN.sub("", named) if "driven" in root.attributes else named
        named = _NAME.sub(lambda own: f'{own[0]} driven="none"', named, count=1)
    return (reduced[:begin] + named.encode() + reduced[tag.end() :]).decode()


def _stays(node: Node, links: frozenset[str], joints: frozenset[str]) -> bool:
    """Whether an element below the root belongs to a part of the robot."""
    name = node.attributes.get("name")
    if node.tag == "link":
        return name in links
    if node.tag == "joint":
        return name in joints
    if node.tag == "transmission":
        return all(driven.attributes.get("name") in joints for driven in driven_joints(node))
    if node.tag == "configuration":
        return any(value.attributes.get("name") in joints for value in node.children)
    if node.tag == "telescope":
        return node.attributes.get("joint") in joints
    if node.tag in ("loop", "coupling", "cone", "clearance"):
        return all(each.attributes["link"] in links for each in node.walk() if "link" in each.attributes)
    return node.tag == "material"


def _spans(data: bytes) -> list[tuple[int, int]]:
    """Where each element begins and ends, in the order of the beginnings."""
    begins: list[int] = []
    ends: dict[int, int] = {}
    opened: list[int] = []
    parser = expat.ParserCreate("UTF-8")

    def start(_tag: str, _attributes: Mapping[str, str]) -> None:
        opened.append(len(begins))
        begins.append(parser.CurrentByteIndex)

    def end(_tag: str) -> None:
        number = opened.pop()
        tag = _START_TAG.match(data, begins[number])
        assert tag is not None
        # Of an empty element the parser's position is already behind it.
        ends[number] = tag.end() if tag[1] else data.index(b">", parser.CurrentByteIndex) + 1

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.Parse(data, True)
    return [(begin, ends[number]) for number, begin in enumerate(begins)]
