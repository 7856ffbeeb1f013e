"""A site: its pages hang together, and tell nothing of the machine they were made on."""

from pathlib import Path

import pytest

from tests.results.report.conftest import SCRIPT
from tests.results.report.test_pages import Page
from vrbench.errors import ConfigError
from vrbench.results.leaderboard import leaderboard
from vrbench.results.report.site import _named, write_site


def html(site):
    return sorted(site.glob("*.html"))


def test_there_is_a_page_for_each_board_and_each_run(site):
    kinds = [path.name.split("-")[0] for path in html(site)]
    assert kinds.count("run") == 4
    assert kinds.count("board") == 1
    assert {"index.html", "runs.html", "vrbench.js", "vrbench.css"} <= {
        path.name for path in site.iterdir()
    }


def test_every_link_leads_to_a_page_of_the_site(site):
    for path in html(site):
        page = Page(path.read_text())
        links = [a["href"] for a in page.all("a")] + [a["href"] for a in page.all("link")]
        links += [a["src"] for a in page.all("script") if "src" in a]
        for link in links:
            if not link.startswith(("#", "data:")):
                assert (site / link).is_file(), f"{path.name}: {link}"


def test_every_run_is_reached_from_its_board(site):
    board = Page(next(site.glob("board-*.html")).read_text())
    assert len([a for a in board.all("a") if a["href"].startswith("run-")]) == 4


def test_nothing_tells_where_the_runs_lie(site, runs):
    for path in html(site):
        assert "secret-place" not in path.read_text(), path.name
        assert str(Path.home()) not in path.read_text(), path.name


def test_a_script_in_a_name_is_text_on_all_pages(site):
    for path in html(site):
        assert SCRIPT not in path.read_text(), path.name


def test_a_run_that_can_not_be_read_is_left_out_and_told(site):
    text = (site / "index.html").read_text()
    assert "broken: is not a run" in text
    assert "4 runs" in text


def test_headings_and_rows_have_as_many_cells(site):
    for path in html(site):
        for table in path.read_text().split("<table")[1:]:
            rows = table.split("</table>")[0].split("<tr")[1:]
            counts = {row.count("<td") + row.count("<th ") for row in rows}
            assert len(counts) == 1, f"{path.name}: {counts}"


def test_page_names_are_safe_and_differ():
    names = _named(["A b", "a-b", "../../etc", "\N{SNOWMAN}", "x" * 300], "run")
    assert names[:4] == ["run-1-a-b.html", "run-2-a-b.html", "run-3-etc.html", "run-4.html"]
    assert len(names[4]) < 80


def test_a_folder_with_files_is_not_written_to(site, runs):
    with pytest.raises(ConfigError, match="holds files already"):
        write_site(leaderboard(runs, "vrbench-1"), runs, "vrbench-1", site, lambda *_: None)
