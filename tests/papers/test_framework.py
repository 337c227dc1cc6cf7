from __future__ import annotations

import base64
import io
import json
import math
import re
from html.parser import HTMLParser
from types import ModuleType

import numpy as np
import pytest

from leg_dynamics.errors import OutputError, ParameterError, UnsupportedError
from leg_dynamics.papers import find, names
from leg_dynamics.papers.framework import (
    Check,
    Context,
    Figure,
    PaperReport,
    Plot,
    Section,
    Status,
    Verdict,
    reproduce,
)
from leg_dynamics.papers.page import render_page
from leg_dynamics.papers.table import summary


def _verdict(item="(9)", kind="equation", status=Status.CORRECTED, finding="Differs by 0.1 m, see (11).", **more):
    return Verdict(item, kind, "position of the knee", status, finding, **more)


def _drawing():
    from leg_dynamics.papers import figures

    figure = figures.drawing(3.0, 2.0)
    axis = figure.subplots()
    figures.panel(axis, np.arange(3.0), np.eye(3), ("a", "b", "c"), ylabel="m", title="t", xlabel="s")
    figures.shade(axis, 0.5, 1.0, "here")
    figures.legend_below(figure, axis)
    return figure


def _report(**more):
    values = {
        "name": "omnileg",
        "paper": "A <paper> & its authors",
        "title": "A paper, reproduced",
        "verdicts": (
            _verdict(
                figures=(Figure("difference", 0.1, "m", "<200> states"), Figure("none", math.nan, "", "nothing")),
                printed="x = cos β",
                corrected="x = sin β",
            ),
            _verdict("(11)", status=Status.CONFIRMED),
            _verdict("Fig. 12", "figure", Status.OUT_OF_REACH, "Hardware."),
            _verdict("claim: error below 1 %", "claim", Status.NOT_REPRODUCIBLE, "No masses."),
        ),
        "plots": (
            Plot("first", "First plot", "What it shows", _drawing, ("(9)",)),
            Plot("second", "Second plot", "More", _drawing),
        ),
        "sections": (Section("part", "A part", ("Text on (9).",), ("a", "b"), (("1", "<2>"),), ("first",), "a note"),),
        "checks": (Check("closes", 1e-16, 1e-9, "m", "all states"),),
        "versions": {"numpy": "1"},
        "samples": 200,
    }
    return PaperReport(**(values | more))


class _Page(HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.ids, self.links, self.sources, self.open = [], [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        self.ids += [values["id"]] if "id" in values else []
        self.links += [values["href"]] if "href" in values else []
        self.sources += [values["src"]] if "src" in values else []
        if tag not in ("meta", "img", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.mark.parametrize(
    ("item", "kind", "anchor"),
    [
        ("(9)", "equation", "eq-9"),
        ("(26)-(27)", "equation", "eq-26-27"),
        ("Table 2", "table", "table-2"),
        ("Fig. 11", "figure", "fig-11"),
        ("claim: 25° or 45°?", "claim", "claim-25-or-45"),
        ("°", "claim", "claim"),
    ],
)
def test_anchors_say_the_item(item, kind, anchor):
    assert _verdict(item, kind).anchor == anchor


def test_unknown_kind_and_status_are_refused():
    with pytest.raises(ValueError, match="not 'theorem'"):
        _verdict(kind="theorem")
    with pytest.raises(ValueError, match="perhaps"):
        _verdict(status="perhaps")


def test_figures_become_plain_floats():
    value = Figure("error", np.float64(0.25), "m", "one state")
    assert type(value.value) is float
    assert str(value) == "0.25 m"


@pytest.mark.parametrize(("value", "passed"), [(1e-10, True), (1e-9, True), (2e-9, False), (math.nan, False)])
def test_check_holds_up_to_its_tolerance(value, passed):
    check = Check("closes", value, 1e-9)
    assert check.passed is passed
    assert _report(checks=(check,)).passed is passed


def test_a_check_that_was_not_run_neither_holds_nor_fails():
    left_out, holds, fails = Check("a", None, 1e-9), Check("b", 0.0, 1e-9), Check("c", 1.0, 1e-9)
    assert left_out.passed is None
    assert (left_out.to_dict()["value"], left_out.to_dict()["state"]) == (None, "not run")
    assert _report(checks=(left_out, holds)).passed
    assert not _report(checks=(left_out, holds, fails)).passed
    assert _report(checks=(left_out, holds, holds, left_out)).held() == "2 of 2 hold, 2 not run"
    report = _report(checks=(left_out, holds))
    assert summary(report).endswith("checks: 1 of 1 hold, 1 not run")
    text = render_page(report, {plot.name: plot.svg() for plot in report.plots})
    assert '<td data-label="error">–</td>' in text
    assert "<td>not run</td>" in text
    assert "not counted above: 1 of 1 hold, 1 not run." in text


@pytest.mark.parametrize("samples", [0, -1, 1.5, "5", True, None])
def test_context_refuses_a_number_of_samples_that_is_none(samples):
    with pytest.raises(ParameterError, match="samples must be a whole number, at least 1"):
        Context("omnileg", samples=samples)


@pytest.mark.parametrize("seed", [-1, "a", 0.5])
def test_context_refuses_a_seed_that_is_none(seed):
    with pytest.raises(ParameterError, match="seed must be a whole number, at least 0"):
        Context("omnileg", seed=seed)


def test_report_counts_and_finds_verdicts():
    report = _report()
    assert [*report.counts().values()] == [1, 1, 1, 1]
    assert report.counts_by_kind()["equation"] == {
        Status.CONFIRMED: 1,
        Status.CORRECTED: 1,
        Status.NOT_REPRODUCIBLE: 0,
        Status.OUT_OF_REACH: 0,
    }
    assert "table" not in report.counts_by_kind()
    assert report.verdict("(11)").status is Status.CONFIRMED
    with pytest.raises(KeyError):
        report.verdict("(12)")
    assert summary(report).startswith("4 items: 1 confirmed, 1 corrected")


@pytest.mark.parametrize(
    "twice",
    [
        {"verdicts": (_verdict(), _verdict())},
        {"verdicts": (_verdict("claim: a.b", "claim"), _verdict("claim: a b", "claim"))},
        {"plots": (Plot("p", "", "", _drawing), Plot("p", "", "", _drawing))},
    ],
)
def test_nothing_appears_twice(twice):
    with pytest.raises(ValueError, match="twice"):
        _report(**twice)


def test_section_refuses_ragged_rows():
    with pytest.raises(ValueError, match="1 cells under 2 headings"):
        Section("s", "S", (), ("a", "b"), (("1",),))


def test_json_has_null_for_nan_and_no_date():
    values = json.loads(_report().to_json())
    assert values["verdicts"][0]["figures"][1]["value"] is None
    assert values["counts"] == {s.value: 1 for s in Status}
    assert values["passed"] is True
    assert not re.search(r"20\d\d-\d\d-\d\d", _report().to_json())


def test_terminal_table_shows_each_finding_and_a_failing_check():
    from rich.console import Console

    console = Console(width=160, record=True, file=io.StringIO())
    console.print(_report(checks=(Check("closes", 1.0, 1e-9, "m"), Check("repeats", 0.0, 1e-9))))
    text = console.export_text()
    for part in ("(9)", "corrected", "Differs by 0.1 m", "FAILS", "holds", "checks: 1 of 2 hold", "out of reach here"):
        assert part in text


def test_page_is_self_contained_and_its_links_lead_somewhere():
    report = _report()
    text = render_page(report, {plot.name: plot.svg() for plot in report.plots})
    page = _Page(text)
    assert not page.open
    assert len(page.ids) == len(set(page.ids))
    assert all(link.startswith("#") and link[1:] in page.ids for link in page.links)
    assert len(page.sources) == 2
    assert all(source.startswith("data:image/svg+xml;base64,") for source in page.sources)
    assert b"<svg" in base64.b64decode(page.sources[0].partition(",")[2])
    assert not re.search(r"(src|href)=.https?:", text)
    assert "A &lt;paper&gt; &amp; its authors" in text
    assert "&lt;200&gt; states" in text
    assert '<a href="#eq-11">(11)</a>' in text  # the finding of (9)
    assert "<dd>x = cos β</dd>" in text
    assert 'id="plots"' in text  # the second plot has no section of its own


def test_page_shows_powers_of_ten_and_a_failing_check():
    verdict = _verdict(finding="Within 1e-05 rad, 3.2e+10 N, at -1.5e-15 m, e-9, L1e-2.")
    failing = _report(verdicts=(verdict,), checks=(Check("closes", 2.5e-5, 1e-9, "m"),), sections=(), plots=())
    text = render_page(failing, {})
    assert "Within 1 × 10⁻⁵ rad, 3.2 × 10¹⁰ N, at -1.5 × 10⁻¹⁵ m, e-9, L1e-2." in text
    assert "2.5 × 10⁻⁵ m" in text
    assert '<span class="fails">fails</span>' in text


def test_drawing_is_the_same_each_time():
    plot = Plot("p", "P", "", _drawing)
    assert plot.svg() == plot.svg()
    assert plot.png(50) == plot.png(50)
    assert plot.png(50).startswith(b"\x89PNG")


def test_write_makes_the_folder_and_repeats_itself(tmp_path):
    report = _report()
    told = []
    written = report.write(tmp_path / "a" / "b", progress=lambda what, share: told.append((what, share)))
    assert [path.relative_to(tmp_path / "a" / "b").as_posix() for path in written] == [
        "index.html",
        "report.json",
        "plots/first.png",
        "plots/second.png",
    ]
    assert told[-1] == ("done", 1.0)
    assert [share for _, share in told] == sorted(share for _, share in told)
    first = [path.read_bytes() for path in written]
    assert [path.read_bytes() for path in report.write(tmp_path / "a" / "b")] == first
    assert not list((tmp_path / "a" / "b").rglob(".*"))


def test_write_refuses_a_file_as_folder(tmp_path):
    (tmp_path / "taken").write_text("")
    with pytest.raises(OutputError, match=r"taken is a file where a folder is needed; move it away"):
        _report().write(tmp_path / "taken")


@pytest.mark.parametrize("culprit", ["index.html", "report.json", "plots/second.png"])
def test_a_folder_in_the_way_is_found_before_anything_is_written(tmp_path, culprit):
    (tmp_path / culprit).mkdir(parents=True)
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(OutputError, match=rf"{culprit} is a folder where a file is to be written; move it away, or"):
        _report().write(tmp_path)
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("dangling", [False, True])
def test_what_is_in_the_way_of_the_plots_is_named(tmp_path, dangling):
    if dangling:
        (tmp_path / "plots").symlink_to(tmp_path / "nowhere")
    else:
        (tmp_path / "plots").write_text("")
    what = "a link that leads nowhere" if dangling else "a file"
    with pytest.raises(OutputError, match=rf"plots is {what} where a folder is needed; move it away") as caught:
        _report().write(tmp_path)
    assert caught.value.path == str(tmp_path / "plots")
    assert not (tmp_path / "index.html").exists()


def test_tables_can_be_stacked_and_nothing_is_kept_on_one_line():
    report = _report()
    text = render_page(report, {plot.name: plot.svg() for plot in report.plots})
    assert "nowrap" not in text
    assert '<td data-label="a">1</td><td data-label="b">&lt;2&gt;</td>' in text
    narrow = text[text.index("@media (max-width: 44rem)") :]
    assert "attr(data-label)" in narrow
    assert re.search(r"figure img \{ width: \d+rem; max-width: none; \}", narrow)
    assert '<div class="scroll" tabindex="0"><img' in text


def test_reproduce_gathers_modules_in_order_and_tells_progress():
    first, second = ModuleType("first"), ModuleType("second")
    first.VERDICTS = (lambda context: _verdict("claim: x", "claim"), lambda context: _verdict("(2)"))
    second.VERDICTS = (lambda context: _verdict("(1)"),)
    second.CHECKS = (lambda context: Check("c", context.rng(1).random(), 1.0),)
    second.plots = lambda context: (Plot("p", "P", "", _drawing),)
    first.sections = lambda context: (Section("s", "S"),)
    told = []
    context = Context("omnileg", seed=3, samples=5)
    report = reproduce(context, (first, second), paper="p", title="t", progress=lambda *step: told.append(step))
    assert [verdict.item for verdict in report.verdicts] == ["(2)", "(1)", "claim: x"]
    assert (len(report.checks), len(report.plots), len(report.sections)) == (1, 1, 1)
    assert (report.seed, report.samples) == (3, 5)
    assert told[0][1] == 0.0
    assert told[-1] == ("done", 1.0)
    assert {"python", "numpy", "leg-dynamics"} <= set(report.versions)


def test_context_is_seeded_and_stays_inside_the_limits():
    one, same, other = Context("omnileg", samples=50), Context("omnileg", samples=50), Context("omnileg", 1, 50)
    # The order of the requests does not matter.
    np.testing.assert_array_equal(one.a, same.a)
    np.testing.assert_array_equal(one.q, same.q)
    assert not np.array_equal(one.q, other.q)
    assert not np.array_equal(one.v, one.a)
    lower, upper = one.limits
    assert np.all((one.q > lower) & (one.q < upper))
    assert one.q.shape == one.v.shape == (50, 3)
    grid = one.grid(3)
    assert grid.shape == (27, 3)
    np.testing.assert_array_equal([grid.min(axis=0), grid.max(axis=0)], [lower, upper])


def test_context_computes_shared_results_once():
    context, calls = Context("omnileg"), []
    for _ in range(2):
        assert context.once("x", lambda: calls.append(1) or 7) == 7
    assert calls == [1]


def test_papers_are_found_by_name():
    assert "omnileg" in names()
    assert hasattr(find("omnileg"), "reproduce")
    with pytest.raises(UnsupportedError, match=r"known: .*omnileg"):
        find("../omnileg")
