"""Pages as text: what they hold, what they must not, and what is refused."""

import json
import re
import sys
from base64 import b64encode
from hashlib import sha256
from html.parser import HTMLParser

import pytest

from tests.results.report.conftest import SCRIPT
from vrbench.config.suite import load_suite
from vrbench.errors import ConfigError, DataError
from vrbench.results.bundle import Bundle
from vrbench.results.leaderboard import leaderboard
from vrbench.results.report import pages
from vrbench.results.report.pages import TURNING, cells, fixed, json_text, number, sentence, three
from vrbench.results.report.run_intervals import forests
from vrbench.results.report.run_page import run_page, write_report
from vrbench.results.report.run_tables import (
    columns,
    headline,
    numbers_of,
    ranking,
    results_of,
    shown,
)
from vrbench.results.tables import Row, parse_cells, read_rows, rows_of, write_rows

PROTOCOL = "vrbench-1"
TABLE = "metrics/vrbench-1.csv"


class Page(HTMLParser):
    """The elements of a page: scripts and styles with their text, attributes of all."""

    def __init__(self, text):
        super().__init__()
        self.elements, self.texts, self._inside = [], {}, None
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.elements.append((tag, dict(attributes)))
        if tag in ("script", "style"):
            self._inside = (tag, dict(attributes).get("type"))

    def handle_endtag(self, tag):
        if tag in ("script", "style"):
            self._inside = None

    def handle_data(self, data):
        if self._inside:
            self.texts.setdefault(self._inside, []).append(data)

    def all(self, tag):
        return [attributes for name, attributes in self.elements if name == tag]


@pytest.fixture
def page(run):
    return Page(run_page(Bundle.open(run), PROTOCOL))


def test_the_report_shows_the_pooled_number_with_its_interval(run):
    text = run_page(Bundle.open(run), PROTOCOL)
    (row,) = [
        row
        for row in read_rows(run / TABLE)
        if (row.case, row.repeat, row.metric) == ("replay", "all", "ape.translation.aligned")
        and (row.point, row.statistic, row.band, row.variant) == ("eye", "rmse", "all", "main")
    ]
    assert f"{three(row.value)} mm" in text
    assert f"{three(row.ci_low)} to {three(row.ci_high)}" in text
    assert "speaks for these takes only" in text


def test_the_report_says_what_it_rests_on(run):
    record = Bundle.open(run).record
    text = run_page(Bundle.open(run), PROTOCOL)
    assert record.suite_digest in text
    assert all(take.sha256 in text for take in record.takes)
    assert "Thinned for display" in text
    assert "not ranked, take scope" in text


def test_the_policy_names_the_only_script_and_the_only_style(page):
    (policy,) = [a["content"] for a in page.all("meta") if "http-equiv" in a]
    assert policy.startswith("default-src 'none'")
    for key, directive in ((("script", None), "script-src"), (("style", None), "style-src")):
        (content,) = page.texts[key]
        digest = b64encode(sha256(content.encode()).digest()).decode()
        assert f"{directive} 'sha256-{digest}'" in policy


def test_the_report_asks_nothing_of_any_network(run, page):
    links = [a["href"] for a in page.all("link") + page.all("a")]
    assert all(link.startswith(("#", "data:")) for link in links)
    assert all("src" not in attributes for attributes in page.all("script"))
    addresses = re.findall(r"https?://[^\s\"'<>]+", run_page(Bundle.open(run), PROTOCOL))
    assert set(addresses) <= {"http://www.w3.org/2000/svg"}
    assert not [a for _, a in page.elements if any(name.startswith("on") for name in a)]
    assert not [a for _, a in page.elements if "style" in a]


def test_the_curves_in_the_page_are_those_of_the_bundle(run, page):
    _, curves = page.texts["script", "application/json"]
    assert json.loads(curves) == json.loads((run / "metrics/vrbench-1.plots.json").read_bytes())


def test_a_script_in_a_name_is_text(runs):
    text = run_page(Bundle.open(runs[-1]), PROTOCOL)
    assert SCRIPT not in text
    assert SCRIPT.replace("<", "&lt;").replace(">", "&gt;").replace("'", "&#39;") in text


def test_nothing_turns_texts_round(runs, site):
    assert "\u202e" in Bundle.open(runs[-1]).record.lab
    pages = [
        run_page(Bundle.open(runs[-1]), PROTOCOL),
        *(p.read_text() for p in site.glob("*.html")),
    ]
    assert not any(character in page for page in pages for character in TURNING)


def test_a_note_begins_large_and_keeps_its_names():
    assert sentence("ranked apart: PUT Poznan") == "Ranked apart: PUT Poznan"


def test_the_report_shows_the_floors_that_the_board_shows(run, page):
    """Of takes together it is the largest of theirs, and calibrations have floors of their own."""
    forests, _ = page.texts["script", "application/json"]
    (forest,) = json.loads(forests)
    floors = {row["name"]: row["floor"] for row in forest["rows"]}
    (board,) = leaderboard([run], PROTOCOL).boards
    assert floors["replay, all takes"] == board.entries[0].floor
    assert floors["calibrate, all takes"] == max(
        floor for name, floor in floors.items() if name.startswith("calibrate, mount")
    )
    assert floors["calibrate, all takes"] != floors["replay, all takes"]


def test_json_can_not_end_its_element():
    hostile = json.dumps({"a": "</script><!--&"})
    assert "<" not in json_text(hostile)
    assert json.loads(str(json_text(hostile))) == json.loads(hostile)


def test_cells_are_escaped():
    assert cells(["<b>", "a&b", ""]) == "<td>&lt;b&gt;</td><td>a&amp;b</td><td></td>"


def test_numbers_read_well():
    assert number(None) == ""
    assert number(-1.23456) == "\N{MINUS SIGN}1.235"
    assert number(123456.7) == "123457"
    assert fixed(2.0, 2) == "2.00"
    assert (three(1.8), three(262.0), three(1234.5), three(0.0)) == ("1.80", "262", "1234", "0")


def test_the_report_is_entered_in_the_bundle(run):
    bundle = Bundle.open(run)
    write_report(bundle, PROTOCOL)
    again = Bundle.open(run)
    assert again.content("report.html") == (run / "report.html").read_bytes()
    # what the page says doesn't change by its being written
    before = (run / "report.html").read_text()
    write_report(again, PROTOCOL)
    assert (run / "report.html").read_text() == before


def test_a_run_without_curves_says_how_to_get_them(run):
    record = json.loads((run / "run.json").read_text())
    del record["files"]["metrics/vrbench-1.plots.json"]
    (run / "run.json").write_text(json.dumps(record))
    text = run_page(Bundle.open(run), PROTOCOL)
    assert "vrbench evaluate RUN" in text
    assert 'id="take"' not in text


def test_metrics_that_were_changed_are_refused(run):
    (run / TABLE).write_text((run / TABLE).read_text().replace("replay", "repla1"))
    with pytest.raises(DataError, match="was changed since it was written"):
        run_page(Bundle.open(run), PROTOCOL)


def test_a_protocol_that_did_not_score_the_run_is_told(run):
    with pytest.raises(DataError, match="vrbench evaluate RUN"):
        run_page(Bundle.open(run), "banaszczyk2024")


def test_without_jinja2_the_fix_is_told(run, monkeypatch):
    pages._environment.cache_clear()
    monkeypatch.setitem(sys.modules, "jinja2", None)
    with pytest.raises(ConfigError, match=r"vrbench\[report\]"):
        run_page(Bundle.open(run), PROTOCOL)
    pages._environment.cache_clear()


def as_row(**cells):
    common = {
        "protocol": PROTOCOL,
        "device": "d",
        "suite": "s@1",
        "case": "replay",
        "condition": "default",
        "sitting": "1",
        "mount": "1",
        "repeat": "1",
        "segment": "all",
        "reference": "robot",
        "variant": "main",
        "metric": "ape.translation.aligned",
        "point": "eye",
        "band": "all",
        "statistic": "rmse",
        "value": None,
        "unit": "mm",
    }
    return Row(**{**common, **cells})


def test_a_take_of_several_world_frames_counts_as_the_worst_of_them(short_suite):
    rows = [
        as_row(metric="clock.offset", point="", statistic="value", value=1.0, unit="ms"),
        as_row(metric="latency.lead", statistic="value", status="skipped", reason="not asked"),
        as_row(segment="epoch:0", value=2.0),
        as_row(segment="epoch:1", status="invalid", reason="no calibration"),
    ]
    (lines,) = results_of(rows, numbers_of(rows), short_suite).values()
    assert [(line.status, line.reason) for line in lines] == [("invalid", "no calibration")]


def test_what_is_ranked_stands_in_the_table_of_takes(short_suite):
    """Also where it isn't the APE; of the usual columns there are those that the run has."""
    rest = short_suite.model_copy(
        update={"rank": short_suite.rank.model_copy(update={"metric": "jitter.position"})}
    )
    rows = [as_row(value=2.0), as_row(metric="jitter.position", value=0.5)]
    assert [column[:2] for column in columns(rows, rest)] == [
        ("jitter.position", "mm"),
        ("rmse", "mm"),
    ]
    assert ranking(rest) == "jitter.position, rmse at the eye"
    (line,) = results_of(rows, numbers_of(rows), rest)["robot"]
    assert [cell.value for cell in line.cells] == [0.5, 2.0]
    (forest,) = forests({"robot": [line]}, numbers_of(rows), rest)
    assert forest["label"] == "jitter.position, rmse at the eye"
    assert "no intervals" in forest["note"]
    assert [column[0] for column in columns(rows, short_suite)] == ["rmse"]


def test_conditions_stand_in_the_order_of_the_suite_and_none_is_left_out():
    """Takes are recorded in an order drawn by lot."""
    suite = load_suite("speed-sweep")
    drawn = ["speed-125", "speed-50", "speed-150", "speed-100", "speed-75"]
    rows = [as_row(case="sweep", condition=c, mount="all", repeat="all", value=2.0) for c in drawn]
    numbers = numbers_of(rows)
    results = results_of(rows, numbers, suite)
    wanted = [condition.id for condition in suite.conditions]
    assert [line.place[2] for line in results["robot"]] == wanted
    named = [tile["name"].split(":")[0] for tile in headline(results, numbers, suite)]
    assert named == [f"sweep {condition}" for condition in wanted]


def test_rows_that_the_page_needs_are_kept_and_their_number_is_small(run):
    lines = parse_cells((run / TABLE).read_bytes(), run / TABLE)
    suite = Bundle.open(run).record.resolved_suite()
    kept = rows_of(shown(lines, suite), run / TABLE)
    every = rows_of(lines, run / TABLE)
    assert len(kept) < 0.6 * len(every)
    assert results_of(kept, numbers_of(kept), suite).keys() == {"robot"}
    for few, all_ in zip(
        results_of(kept, numbers_of(kept), suite)["robot"],
        results_of(every, numbers_of(every), suite)["robot"],
        strict=True,
    ):
        assert few == all_


@pytest.mark.parametrize(
    ("low", "scope", "verdict"),
    [(0.5, "mount", "separable"), (-0.5, "mount", "not separable"), (0.5, "take", "can&#39;t")],
)
def test_changes_against_the_baseline_are_told_apart_or_not(run, low, scope, verdict):
    record = json.loads((run / "run.json").read_text())
    record["suite"]["conditions"] = [{"id": "none", "baseline": True}, {"id": "two"}]
    (run / "run.json").write_text(json.dumps(record))
    change = as_row(
        condition="two",
        mount="all",
        repeat="all",
        variant="vs-baseline",
        value=1.0,
        ci_low=low,
        ci_high=1.5,
        ci_scope=scope,
    )
    write_rows([*read_rows(run / TABLE), change], run / TABLE)
    bundle = Bundle.open(run)
    bundle.enter(TABLE)
    text = " ".join(run_page(bundle, PROTOCOL).split())
    assert "Change against the baseline, condition none" in text
    assert f"<td>mm</td><td>{verdict}" in text
