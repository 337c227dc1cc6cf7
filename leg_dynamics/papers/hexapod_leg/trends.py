"""What the text reads off Figs 3 and 5, one sentence a verdict: statements that a computed curve can break."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from leg_dynamics.papers.comparison import claim
from leg_dynamics.papers.framework import Context, Figure, Verdict
from leg_dynamics.papers.hexapod_leg import second, study
from leg_dynamics.papers.hexapod_leg.study import LENGTH_NOISE, Sweep, sweep
from leg_dynamics.papers.judge import judge

__all__ = [
    "NAMES",
    "SMALL",
    "VERDICTS",
    "Statement",
    "accelerates",
    "falls",
    "flat",
    "flattens",
    "length_statements",
    "rises",
    "small",
]

Array = np.ndarray

SMALL = 0.1
"""Share of the mean below which a change counts as small; the paper gives no number."""

NAMES = {name: name for name in "abce"} | {
    f"l{i}_{end}": f"l{sign}{end}" for i, sign in ((1, "₁"), (2, "₂"), (3, "₃")) for end in ("min", "max")
}
"""Of lengths, in sentences."""


def rises(values: Array, noise: float) -> bool:
    """Whether values grow on the whole and never fall by more than the noise."""
    fall = float((np.maximum.accumulate(values) - values).max())
    return bool(values[-1] - values[0] > noise and fall <= noise)


def falls(values: Array, noise: float) -> bool:
    """Whether values shrink on the whole and never rise by more than the noise."""
    return rises(-values, noise)


def flat(values: Array, noise: float) -> bool:
    """Whether values stay within the noise."""
    return float(np.ptp(values)) <= noise


def accelerates(values: Array) -> bool:
    """Whether the second half of the range changes them by more than the first."""
    middle = len(values) // 2
    return abs(float(values[-1] - values[middle])) > abs(float(values[middle] - values[0]))


def flattens(values: Array, noise: float) -> bool:
    """Whether values grow on the whole, and the second half of the range changes them by less than the first.

    A fall after the greatest value counts as flattening where it takes back less than half of the rise.
    """
    top = float(values.max())
    rise, back = top - float(values[0]), top - float(values[-1])
    after = float(np.ptp(values[int(values.argmax()) :]))
    return rise > noise and after < 0.5 * rise and back < 0.5 * rise and not accelerates(values)


def small(values: Array) -> bool:
    """Whether the whole change is below `SMALL` of the mean."""
    return float(np.ptp(values)) < SMALL * float(values.mean())


class Statement(NamedTuple):
    """Something that the text says of one curve."""

    of: str
    says: str
    holds: bool


def _failing(statements: Sequence[Statement]) -> int:
    return sum(not each.holds for each in statements)


def _list(statements: Sequence[Statement], holding: bool) -> str:
    return ", ".join(f"{each.of} {each.says}" for each in statements if each.holds is holding) or "none"


def _ends(name: str, values: Array, unit: str, of: str) -> list[Figure]:
    return [
        Figure(f"{name}, first", values[0], unit, of),
        Figure(f"{name}, last", values[-1], unit, of),
        Figure(f"{name}, least", values.min(), unit, of),
        Figure(f"{name}, greatest", values.max(), unit, of),
    ]


# ---------------------------------------------------------------------- Fig. 3


def length_statements(
    context: Context, back: bool = True, towards: bool = True
) -> dict[str, tuple[Statement, Statement]]:
    """The directions of L and Z that the text states, by parameter; Z is Z_b or Z_f, b points to A2 or away from it."""
    found = {}
    for name, step, height in (
        ("a", "falls", "falls"),
        ("b", "rises", "rises"),
        ("l2_min", "falls", "stays"),
        ("l2_max", "rises", "rises"),
    ):
        curves = sweep(context, name).steps if towards else study.steps_with_b_away(context, name)
        z = curves.back if back else curves.front
        tests = {"falls": falls, "rises": rises, "stays": flat}
        found[name] = (
            Statement("L", step, tests[step](curves.length, LENGTH_NOISE)),
            Statement("Z", height, tests[height](z, LENGTH_NOISE)),
        )
    return found


def _of(swept: Sweep) -> str:
    values = 1e3 * swept.values
    return f"{NAMES[swept.name]} from {values[0]:.0f} to {values[-1]:.0f} mm, others as in section 4.1"


def _length_figures(swept: Sweep) -> list[Figure]:
    of = _of(swept)
    return [
        *_ends("L", swept.steps.length, "m", of),
        *_ends("Z behind", swept.steps.back, "m", of),
        *_ends("Z ahead", swept.steps.front, "m", of),
    ]


def _span(values: Array, unit: float = 1e3) -> str:
    return f"{unit * values[0]:.0f} to {unit * values[-1]:.0f} mm"


def length_by_a(context: Context) -> Verdict:
    """L and Z against a."""
    swept = sweep(context, "a")
    length, back = swept.steps.length, swept.steps.back
    statements = [
        *length_statements(context)["a"],
        Statement("L", "ever faster", accelerates(length)),
        Statement("Z", "ever faster", accelerates(back)),
    ]
    return claim(
        "L and Z fall with a, ever faster",
        "Fig. 3 (a): L and Z fall as a grows, faster and faster",
        judge(_failing(statements), 0.0),
        f"L {_span(length)}, Z_b {_span(back)}; Z_b stays at first, while the 60° of a U joint end it. "
        f"Faster: the second half of the range changes both by more than the first. Fails: {_list(statements, False)}.",
        _length_figures(swept),
    )


def length_by_b(context: Context) -> Verdict:
    """L and Z against b."""
    swept = sweep(context, "b")
    length, back = swept.steps.length, swept.steps.back
    height = [length_statements(context)["b"][1], Statement("Z", "flattens", flattens(back, LENGTH_NOISE))]
    statements = [
        *length_statements(context)["b"],
        height[1],
        Statement("L", "flattens", flattens(length, LENGTH_NOISE)),
    ]
    mended = [Statement("L", "falls", falls(length, LENGTH_NOISE)), *height]
    return claim(
        "L and Z rise with b and flatten",
        "Fig. 3 (b): L and Z rise with b, and flatten beyond some value",
        judge(_failing(statements), 0.0, corrected=_failing(mended), explained=_failing(height)),
        f"L falls, {_span(length)}. Z_b rises, {_span(back)}, and stays once the 60° of a U joint end it. Fails: "
        f"{_list(statements, False)}.",
        _length_figures(swept),
        ("L rises with b", "L falls with b; Z as printed, behind"),
    )


def length_by_l2_min(context: Context) -> Verdict:
    """L and Z against l2_min."""
    swept = sweep(context, "l2_min")
    length, front = swept.steps.length, swept.steps.front
    statements = length_statements(context)["l2_min"]
    return claim(
        "L falls with l2min, Z does not change",
        "Fig. 3 (c): L falls as l₂min grows, Z does not change",
        judge(_failing(statements), 0.0),
        f"L {_span(length)}, at first unchanged; Z_b stays at {1e3 * swept.steps.back[0]:.0f} mm. Z ahead does fall, "
        f"{_span(front)}: so the paper's Z must be the swing away from A2, though it says that A2 faces ahead.",
        _length_figures(swept),
    )


def length_by_l2_max(context: Context) -> Verdict:
    """L and Z against l2_max."""
    swept = sweep(context, "l2_max")
    statements = length_statements(context)["l2_max"]
    return claim(
        "L and Z rise with l2max",
        "Fig. 3 (d): L and Z rise with l₂max",
        judge(_failing(statements), 0.0),
        f"L {_span(swept.steps.length)}, Z_b {_span(swept.steps.back)}, until other limits end both. Below "
        f"{1e3 * swept.values[0]:.0f} mm strut 2 does not reach the initial pose.",
        _length_figures(swept),
    )


# ---------------------------------------------------------------------- Fig. 5


class Curves(NamedTuple):
    """Means and deviations along a sweep, and what is noise in them."""

    mean: Array
    deviation: Array
    mean_noise: float
    deviation_noise: float


def curves(swept: Sweep, which: str) -> Curves:
    """By the exact or the printed Jacobian."""
    found = swept.exact if which == "exact" else swept.printed
    return Curves(
        np.array([each.mean.value for each in found]),
        np.array([each.deviation.value for each in found]),
        # The same points serve every value of the parameter, so that curves are smoother than their means are certain.
        max(each.mean.half_width for each in found),
        max(each.deviation.half_width for each in found),
    )


def _both(found: Curves, says: str, test: Callable[[Array, float], bool]) -> list[Statement]:
    return [
        Statement("k̄", says, test(found.mean, found.mean_noise)),
        Statement("k̃", says, test(found.deviation, found.deviation_noise)),
    ]


def _k_figures(swept: Sweep) -> list[Figure]:
    of = _of(swept)
    return [
        figure
        for which in ("exact", "printed")
        for name, values in zip(("k̄", "k̃"), curves(swept, which)[:2], strict=True)
        for figure in _ends(f"{name}, {which} Jacobian", values, "", of)
    ]


def _k_span(values: Array) -> str:
    return f"{values[0]:.2f} to {values[-1]:.2f}"


def dexterity_by_a(context: Context) -> Verdict:
    """kbar and ktilde against a."""
    swept = sweep(context, "a")
    exact, other = curves(swept, "exact"), curves(swept, "printed")
    direction = _both(exact, "falls", falls)
    faster = _both(exact, "ever faster", lambda values, noise: accelerates(values))
    slower = _both(exact, "ever slower", lambda values, noise: not accelerates(values))
    return claim(
        "k̄ and k̃ fall with a, ever faster",
        "Fig. 5 (a): k̄ and k̃ fall as a grows, faster and faster",
        judge(
            _failing([*direction, *faster]),
            0.0,
            corrected=_failing([*direction, *slower]),
            explained=_failing(direction),
        ),
        f"They fall, k̄ {_k_span(exact.mean)}, k̃ {_k_span(exact.deviation)}, but slower and slower. With (24) as "
        f"printed k̄ would go from {other.mean[0]:.2f} down to {other.mean.min():.2f} and up to {other.mean[-1]:.2f}.",
        _k_figures(swept),
        ("faster and faster", "slower and slower"),
    )


def _level(name: str, letter: str) -> Callable[[Context], Verdict]:
    def verdict(context: Context) -> Verdict:
        swept = sweep(context, name)
        exact, other = curves(swept, "exact"), curves(swept, "printed")
        little = [Statement("k̄", "changes little", small(exact.mean))]
        rising = [
            *_both(exact, "rises", lambda values, noise: float(values[-1] - values[0]) > noise),
            *_both(exact, "flattens", flattens),
        ]
        falling = _both(exact, "falls", falls)
        return claim(
            f"k̄ and k̃ rise with {letter}, little, and flatten",
            f"Fig. 5 ({'b' if name == 'b' else 'c'}): k̄ and k̃ rise with {letter}, little on the whole, and flatten",
            judge(
                _failing([*rising, *little]),
                0.0,
                corrected=_failing([*falling, *little]),
                explained=_failing(little),
            ),
            f"k̄ {_k_span(exact.mean)} (between {exact.mean.min():.2f} and {exact.mean.max():.2f}), k̃ "
            f"{_k_span(exact.deviation)}. With (24) as printed k̄ would go from {other.mean[0]:.1f} to "
            f"{other.mean[-1]:.1f}. Fails: {_list([*rising, *little], False)}.",
            _k_figures(swept),
            ("", "") if not _failing([*rising, *little]) else ("rise", "fall, little"),
        )

    verdict.__name__ = f"dexterity_by_{name}"
    verdict.__doc__ = f"kbar and ktilde against {name}."
    return verdict


def dexterity_by_stroke(context: Context) -> Verdict:
    """kbar and ktilde against the stroke of strut 2."""
    raised, lowered = sweep(context, "l2_max"), sweep(context, "l2_min")
    up = curves(raised, "exact")
    down = curves(lowered, "exact")
    down = down._replace(mean=down.mean[::-1], deviation=down.deviation[::-1])
    readings = {"l₂max raised": _both(up, "falls", falls), "l₂min lowered": _both(down, "falls", falls)}
    little = [small(each.mean) for each in (up, down)]
    forced = second.brute_means(context)
    means = np.array([mean.value for mean in forced.values()])
    shown = ", ".join(f"{mean.value:.2f} ± {mean.half_width:.2f}" for mean in forced.values())
    return claim(
        "k̄ and k̃ fall slowly with the stroke of strut 2",
        "Fig. 5 (d): k̄ and k̃ fall slowly as the stroke Δl₂ grows, and very little",
        judge(min(_failing(each) for each in readings.values()) + little.count(False), 0.0),
        f"The text does not say which end moves. With l₂max k̄ goes from {up.mean[0]:.2f} to {up.mean[-1]:.2f}, with "
        f"l₂min lowered from {down.mean[0]:.2f} by {down.mean.min():.2f} to {down.mean[-1]:.2f}: little, but down in "
        "neither way. Random feet and differences of lengths, without any formula, give "
        f"{shown} at l₂min = {', '.join(f'{1e3 * value:.0f}' for value in forced)} mm: flat to "
        f"{100.0 * np.ptp(means) / means.mean():.1f} %, without the rise at an end that a few samples may show.",
        [
            *_k_figures(raised),
            *_k_figures(lowered),
            *(
                Figure(f"k̄ by force, l₂min {1e3 * value:.0f} mm", mean.value, "", f"± {mean.half_width:.2g} at 99 %")
                for value, mean in forced.items()
            ),
        ],
    )


dexterity_by_b = _level("b", "b")
dexterity_by_c = _level("c", "c")

VERDICTS: tuple[Callable[[Context], Verdict], ...] = (
    length_by_a,
    length_by_b,
    length_by_l2_min,
    length_by_l2_max,
    dexterity_by_a,
    dexterity_by_b,
    dexterity_by_c,
    dexterity_by_stroke,
)
"""One function a sentence, in the paper's order."""
