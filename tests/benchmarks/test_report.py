"""A whole run with next to no repetitions: the form of the report, and every real case through the gate."""

from __future__ import annotations

import json
import platform
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from benchmarks import __main__ as command
from benchmarks.blocks import all_blocks
from benchmarks.cases import FULL, QUICK, YARDSTICK, Block, Case, NotAvailableError, Work, available_legs
from benchmarks.environment import environment
from benchmarks.report import SCHEMA, Figure, digits
from benchmarks.suite import run

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def report(tiny):
    return run("omnileg", tiny, fresh=False)


def constant(key, value, expected=0.0, **more):
    work = Work(lambda: np.array([value]), [()], [np.array([expected])], period=1)
    return Case(key, f"the case {key}", lambda subject: work, **more)


def single(*cases, **more):
    return [Block("single", "One call", lambda: None, cases, chart="single", **more)]


def measured(tiny, *cases, **more):
    return run("omnileg", tiny, single(*cases, **more), fresh=False)


# ---------------------------------------------------------------------- the whole run


def test_every_case_is_in_every_rendering(report, tiny):
    cases = [case for block in all_blocks("omnileg", tiny) for case in block.cases]
    assert [result.key for result in report.results] == [case.key for case in cases]
    assert len({case.key for case in cases}) == len(cases)
    values = json.loads(report.to_json())
    assert [result["key"] for result in values["results"]] == [case.key for case in cases]
    methods = {case.title.split(": ")[-1] if "methods" in case.key else case.title for case in cases}
    markdown, page = report.to_markdown(), report.to_html()
    for title in methods:
        if not title.startswith(("closed_form: ", "symbolic: ", "pinocchio: ")):
            assert title in markdown
            assert title.replace("'", "&#x27;") in page


def test_the_project_s_own_cases_are_right(report):
    assert report.sound, report.failures()
    for result in report.results:
        if result.status != "not available" and (not result.peer or result.key.startswith("naive")):
            assert result.status == "ok", result.reason
            assert len(result.samples) >= 1


def test_what_does_not_rank_says_why(report):
    failures = "\n".join(report.failures())
    for result in report.results:
        assert (result.status == "ok") == (result.reason is None)
        if result.status != "ok":
            assert result.title in failures
        # A wrong case with an error has times to be greyed.
        assert bool(result.samples) == (result.status == "ok" or result.error is not None)


def test_raw_mujoco_is_wrong_and_projected_is_right(report):
    pytest.importorskip("mujoco")
    raw, projected = report.find("mujoco_raw"), report.find("mujoco_projected")
    assert raw.status == "wrong"
    assert raw.error > 1e-3
    assert projected.status == "ok"


def test_ratios_are_taken_within_a_round(report):
    for key, _, _, _ in report.blocks:
        yardstick, *others = report.of(key)
        assert yardstick.key.endswith(YARDSTICK)
        assert yardstick.ratio == (1.0, 1.0, 1.0, 1.0)
        for result in others:
            if result.samples:
                np.testing.assert_allclose(np.array(result.ratios) * yardstick.samples * result.rows, result.samples)


def test_ratios_to_the_limit(report):
    if report.find("limit_batch_7").status == "not available":
        pytest.skip("no compiler")
    limit, own = report.find("limit_batch_7"), report.find("closed_form_batch_7")
    assert limit.limit_ratio == (1.0, 1.0, 1.0, 1.0)
    np.testing.assert_allclose(own.limit_ratios, np.array(own.samples) / limit.samples)


def test_json_schema(report):
    values = json.loads(report.to_json())
    wanted = {"schema", "leg", "yardstick", "settings", "environment", "sound", "blocks", "results", "figures", "goals"}
    assert set(values) == wanted | {"references", "comparison"}
    assert (values["schema"], values["leg"], values["yardstick"]) == (SCHEMA, "omnileg", YARDSTICK)
    assert values["references"]["grbda"]["remark"] == "measured elsewhere on this kind of machine"
    spread = {"minimum", "lower_quartile", "median", "upper_quartile"}
    for result in values["results"]:
        assert result["status"] in ("ok", "wrong", "cannot run", "not available")
        if result["status"] == "ok":
            for name in ("ns_per_row", "ratio"):
                assert set(result[name]) == spread
                ordered = list(result[name].values())
                assert ordered == sorted(ordered)
    facts = values["environment"]
    assert {"date", "cpu", "cores", "vectors", "compiler", "python", "versions", "threads", "commit"} <= set(facts)
    assert {"numpy", "pin", "scipy", "llvmlite"} <= set(facts["versions"])
    assert facts["commit"] is None or set(facts["commit"]) == {"name", "dirty"}
    assert all(goal["verdict"] in ("met", "missed", "not measured") for goal in values["goals"])


def test_no_host_and_no_path_in_the_output(report):
    for text in (report.to_json(), report.to_markdown(), report.to_html()):
        assert str(ROOT) not in text
        assert str(Path.home()) + "/" not in text
        assert len(platform.node()) < 4 or platform.node() not in text


class Page(HTMLParser):
    """Headings, and everything that a browser would fetch."""

    def __init__(self):
        super().__init__()
        self.fetched, self.anchors, self.links, self.tags = [], [], [], []

    def handle_starttag(self, tag, attributes):
        values = dict(attributes)
        self.tags.append(tag)
        if tag == "h2":
            self.anchors.append(values["id"])
        if tag == "a":
            self.links.append(values["href"])
        self.fetched += [v for k, v in values.items() if k in ("src", "data", "poster", "srcset", "action")]
        if tag in ("link", "script", "iframe", "object", "embed", "img"):
            self.fetched.append(tag)
        if tag in ("use", "image"):
            self.fetched += [v for k, v in values.items() if k.endswith("href") and not v.startswith("#")]


def test_the_page_has_every_section_and_needs_no_network(report):
    text = report.to_html()
    page = Page()
    page.feed(text)
    assert page.fetched == []
    keys = [section.key for section in report.sections()]
    assert page.anchors == keys
    assert page.links == [f"#{key}" for key in keys]
    assert page.tags.count("svg") == 4
    assert keys[-1] == "goals"
    assert {"single", "batch", "threads", "forward", "methods", "chains", "method"} <= set(keys)
    # Names of XML vocabularies are no addresses.
    outside = set(re.findall(r"https?://[^\s\"'<>)]+", text))
    assert outside <= {"http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"}
    assert "@import" not in text
    assert "url(http" not in text


def test_markdown_has_every_section(report):
    headings = [line[3:] for line in report.to_markdown().splitlines() if line.startswith("## ")]
    assert headings == [section.title for section in report.sections()]


def test_tables_are_rectangular(report):
    for section in report.sections():
        assert {len(line.cells) for line in section.lines} <= {len(section.header)}, section.key


def test_the_report_says_how_loops_were_closed(report):
    if report.find("chain_1_symbolic_batch").status == "not available":
        pytest.skip("no symbolic route")
    assert re.search(r"loops closed by (explicit formulas|Newton)", report.to_markdown())


def test_environment_reports_threads_and_does_not_set_them(monkeypatch):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "3")
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    threads = environment()["threads"]
    assert (threads["OPENBLAS_NUM_THREADS"], threads["OMP_NUM_THREADS"]) == ("3", None)


# ---------------------------------------------------------------------- planted cases


def test_a_planted_wrong_peer_is_greyed_and_never_ranked(tiny):
    report = measured(
        tiny,
        constant(YARDSTICK, 0.0),
        constant("wrong", 1e-6, peer=True),
        constant("poisoned", np.nan, peer=True),
        Case("slow", "the case slow", lambda subject: Work(_slow, [()], [np.zeros(1)], period=1), peer=True),
    )
    assert [(r.status, bool(r.samples)) for r in report.results] == [
        ("ok", True),
        ("wrong", True),
        ("wrong", False),
        ("ok", True),
    ]
    assert report.sound
    # The wrong one is the fastest but for the yardstick, and last but for what has no time.
    assert [r.key for r in report.ranked("single")] == [YARDSTICK, "slow", "wrong", "poisoned"]
    (section,) = (section for section in report.sections() if section.key == "single")
    line = next(line for line in section.lines if "the case wrong" in line.cells)
    assert line.cells[0] == "–"
    assert line.tone == "wrong"
    assert line.cells[2].startswith("WRONG")
    assert line.cells[-1] == "1e-06"
    assert '<tr class="wrong">' in report.to_html()
    assert re.search(r"\| – \| the case wrong \| WRONG [\d.]+ \| ~~", report.to_markdown())
    assert "differs by 1.0e-06" in "\n".join(report.failures())
    assert not measured(tiny, constant(YARDSTICK, 0.0), constant("wrong", 1e-6)).sound


def _slow():
    return np.array([float(sum(range(3000)) * 0)])


def test_what_is_not_available_does_not_make_a_run_unsound(tiny):
    def absent(subject):
        raise NotAvailableError("route symbolic: it is not there")

    def broken(subject):
        raise ArithmeticError("lost")

    report = measured(tiny, constant(YARDSTICK, 0.0), Case("symbolic", "the case symbolic", absent))
    assert report.sound
    assert "the case symbolic: NOT AVAILABLE: route symbolic: it is not there" in report.failures()
    assert not measured(tiny, constant(YARDSTICK, 0.0), Case("symbolic", "the case symbolic", broken)).sound


def test_a_case_that_goes_wrong_while_timed_is_wrong(tiny):
    calls = []

    def drifting():
        calls.append(None)
        return np.array([1e-7 * (len(calls) > 1)])

    def breaking():
        calls.append(None)
        return np.array([0.0 if len(calls) == 1 else 1 // 0])

    work = Work(drifting, [()], [np.zeros(1)], period=1)
    report = measured(tiny, constant(YARDSTICK, 0.0), Case("drifting", "the case drifting", lambda _: work))
    assert (report.results[1].status, report.results[1].samples) == ("wrong", ())
    assert "while it was timed" in report.results[1].reason

    calls.clear()
    broken = Case("breaking", "the case breaking", lambda _: replace(work, function=breaking))
    report = measured(tiny, constant(YARDSTICK, 0.0), broken)
    assert (report.results[1].status, report.results[1].samples) == ("cannot run", ())
    assert "ZeroDivisionError" in report.results[1].reason


def test_without_a_yardstick_or_a_limit_there_are_times_and_no_ratios(tiny):
    report = measured(
        tiny, constant(YARDSTICK, 1.0), constant("limit", 1.0, peer=True), constant("alone", 0.0), limit="limit"
    )
    alone = report.results[2]
    assert alone.samples
    assert alone.ratios == alone.limit_ratios == ()
    assert not report.sound


def test_a_figure_without_samples_is_shown_with_its_reason(tiny):
    report = replace(
        measured(tiny, constant(YARDSTICK, 0.0)), figures=(Figure("import", "the import", "ms", (), "no such module"),)
    )
    assert "the import: NOT AVAILABLE: no such module" in report.failures()
    assert "NOT AVAILABLE" in report.to_markdown()


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0.00"), (1234.5, "1,234"), (99.94, "99.9"), (1.005, "1.00"), (0.4, "0.400"), (0.0073, "0.00730")],
)
def test_digits(value, text):
    assert digits(value) == text


# ---------------------------------------------------------------------- the settings and the command


def test_issue_s_sizes():
    assert FULL.batch_rows == (1, 10, 100, 1_000, 10_000, 100_000, 1_000_000)
    assert FULL.states >= 1000
    assert QUICK.states >= 1000
    assert FULL.minimum_ns >= 2_000_000
    assert QUICK.minimum_ns >= 2_000_000
    assert FULL.loops[:4] == (1, 2, 4, 8)
    assert FULL.thread_rows == 1_000_000


def few(tiny):
    def stand_in(leg, settings, progress):
        assert settings in (QUICK, FULL)
        return run(leg, tiny, single(constant(YARDSTICK, 0.0)), progress, fresh=False)

    return stand_in


def test_command_writes_what_it_is_asked_for(monkeypatch, tmp_path, capsys, tiny):
    monkeypatch.setattr(command, "run", few(tiny))
    files = tmp_path / "out.json", tmp_path / "out.md", tmp_path / "out.html"
    options = [*("--json", str(files[0])), *("--markdown", str(files[1])), *("--html", str(files[2]))]
    assert command.main(["--quick", *options]) == 0
    assert json.loads(files[0].read_text(encoding="utf-8"))["sound"] is True
    assert files[1].read_text(encoding="utf-8").startswith("# omnileg")
    assert files[2].read_text(encoding="utf-8").startswith("<!doctype html>")
    printed = capsys.readouterr().out
    assert "the case pin_rnea" in printed
    assert printed.index("the case pin_rnea") < printed.index("MISSED" if "MISSED" in printed else "not measured")


def test_json_alone_is_all_of_standard_output(monkeypatch, capsys, tiny, tmp_path):
    monkeypatch.setattr(command, "run", few(tiny))
    assert command.main(["--json", "--html", str(tmp_path / "out.html")]) == 0
    assert json.loads(capsys.readouterr().out)["schema"] == SCHEMA


def test_command_compares_with_its_own_file(monkeypatch, capsys, tiny, tmp_path):
    monkeypatch.setattr(command, "run", few(tiny))
    earlier = tmp_path / "earlier.json"
    assert command.main(["--json", str(earlier)]) == 0
    assert command.main(["--compare", str(earlier)]) == 0
    assert "Compared with an earlier run" in capsys.readouterr().out


def test_missed_goals_leave_the_exit_status_alone(monkeypatch, tiny):
    def slow(leg, settings, progress):
        return run(leg, tiny, single(constant(YARDSTICK, 0.0), constant("closed_form_fixed", 0.0)), fresh=False)

    monkeypatch.setattr(command, "run", slow)
    assert command.main([]) == 0


def test_command_fails_when_the_project_is_wrong(monkeypatch, tiny):
    monkeypatch.setattr(command, "run", lambda leg, settings, progress: measured(tiny, constant(YARDSTICK, 1.0)))
    assert command.main([]) == 1


@pytest.mark.parametrize(
    "arguments",
    [
        ["--leg", "nobody"],
        ["--json", "no/such/folder/out.json"],
        ["--markdown", "."],
        ["--html", "no/such/folder/out.html"],
        ["--compare", "no/such/file.json"],
        ["--compare", __file__],
        ["--frobnicate"],
    ],
)
def test_command_refuses_bad_usage_before_measuring(monkeypatch, capsys, arguments):
    monkeypatch.setattr(command, "run", lambda *_, **__: pytest.fail("measured"))
    with pytest.raises(SystemExit) as refusal:
        command.main(arguments)
    assert refusal.value.code == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1


def test_available_legs():
    assert "omnileg" in available_legs()


@pytest.mark.parametrize(("second", "judged"), [(100.0, False), (52.0, True)])
def test_threads_are_judged_only_where_the_limit_gains_by_them(report, second, judged):
    first = replace(report.results[0], key="limit_threads_1", samples=(100.0,) * 3)
    other = replace(first, key="limit_threads_2", samples=(second,) * 3)
    (said,) = replace(report, results=(first, other))._control()
    assert f"{100.0 / second:.2f} times" in said
    assert ("cannot be judged" not in said) is judged
