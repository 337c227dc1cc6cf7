"""What the paper reports, typed a second time from its text."""

from __future__ import annotations

import pytest

import leg_dynamics as ld
from leg_dynamics.papers.hexapod_leg import reported

# Sections 4.1 and 6.1 and Table 1, in mm and deg.
PRELIMINARY = "a=200 b=80 c=50 l1=500-900 l2=350-650 l3=500-900 e=450 h=700 ball=35 universal=60"
FINAL = "a=200 b=70 l2=330-600 c=50 e=450 l1=530-900 l3=530-900"
BOX = "a=100-350 b=20-150 l2min=100-400 l2max=450-800"
TUBES = "sleeve_13 500x65x5 rod_13 500x30x3 sleeve_2 310x65x5 rod_2 310x30x3"


def typed(text):
    found = {}
    for item in text.split():
        name, _, value = item.partition("=")
        if "-" in value:
            low, high = (float(end) / 1e3 for end in value.split("-"))
            found |= {f"{name}_min": low, f"{name}_max": high}
        else:
            angle = name in ("ball", "universal")
            found[f"{name}_range" if angle else name] = float(value) / (1.0 if angle else 1e3)
    return found


def test_designs():
    assert dict(reported.PRELIMINARY) == pytest.approx(typed(PRELIMINARY), abs=1e-15)
    assert dict(reported.FINAL) == pytest.approx(typed(FINAL), abs=1e-15)


def test_box_of_the_monte_carlo_method():
    ends = {}
    for item in BOX.split():
        name, _, span = item.partition("=")
        ends[name.replace("l2m", "l2_m")] = tuple(float(end) / 1e3 for end in span.split("-"))
    assert dict(reported.PRIMARY_RANGES) == ends
    assert dict(reported.ACCEPTED) == {"Z": 0.35, "L": 1.0, "kbar": 4.3, "ktilde": 4.7}
    assert reported.SECTION_6["relations"] == (">=", ">=", "<=", "=")
    assert reported.SECTION_6["workspace indices"] == ("L", "H")
    assert reported.SECONDARY == ("c", "e", "l1_min", "l3_min", "l3_max")


def test_table_1():
    words = TUBES.split()
    tubes = {
        name: tuple(float(size) / 1e3 for size in sizes.split("x"))
        for name, sizes in zip(words[::2], words[1::2], strict=True)
    }
    assert dict(reported.TUBES) == tubes
    assert dict(reported.TABLE_1) == {"a": 0.2, "b": 0.07, "c": 0.05, "e": 0.45}


def test_numbers_cannot_be_changed():
    with pytest.raises(TypeError):
        reported.ACCEPTED["kbar"] = 9.2


@pytest.mark.parametrize(
    ("name", "given"), [("hexapod_leg", reported.FINAL), ("hexapod_leg_preliminary", reported.PRELIMINARY)]
)
def test_the_files_have_them(name, given):
    parameters = ld.load(name).parameters
    assert {key: parameters[key].value for key in given} == dict(given)
