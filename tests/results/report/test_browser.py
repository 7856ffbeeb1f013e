"""Pages in Chromium: drawn without complaint, used by keyboard, readable small and dark."""

import json
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import pytest

from tests.results.report.conftest import SCRIPT, TURNED
from vrbench.results.report import pages

# The ratio of luminances of WCAG 2, between a text's colour and what lies behind it.
CONTRAST = """() => {
  const light = (c) => { const [r, g, b] = c.match(/[\\d.]+/g).map(Number).map((v) => {
    v /= 255; return v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4; });
    return 0.2126 * r + 0.7152 * g + 0.0722 * b; };
  const behind = (e) => { for (; e; e = e.parentElement) {
    const c = getComputedStyle(e).backgroundColor;
    if (!/, 0\\)$/.test(c) && c !== 'transparent') return c; } return 'rgb(255,255,255)'; };
  const poor = [];
  const texts = 'p, td, th, a, dt, dd, li, label, caption, text, button, summary, span, h1, h2';
  for (const e of document.querySelectorAll(texts)) {
    if (!e.textContent.trim() || !e.getClientRects().length) continue;
    const style = getComputedStyle(e);
    const [a, b] = [light(e.tagName === 'text' ? style.fill : style.color), light(behind(e))];
    const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    if (ratio < 4.5) poor.push(`${e.tagName} ${e.textContent.trim()} ${ratio.toFixed(2)}`);
  }
  return poor;
}"""


def drawn(page):
    page.wait_for_function("document.querySelectorAll('#figures figure svg path').length > 50")
    return page


def board(site):
    return next(site.glob("board-*.html"))


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_report_is_drawn_without_complaint_and_asks_for_itself_alone(open_page, report, scheme):
    page = drawn(open_page(report, scheme=scheme))
    assert page.problems == []
    assert page.asked == [report.as_uri()]
    titles = page.locator("figcaption strong").all_text_contents()
    assert "First and last loop" not in titles
    for title in (
        "The ranking number by take",
        "Path of the eye",
        "Position by axis",
        "APE over time",
        "APE along the path",
        "Distribution of the error",
        "Error against speed",
        "Spectrum of the error",
        "Clock residual",
        "Coverage and speed",
    ):
        assert title in titles


def test_a_script_in_a_name_is_shown_and_not_run(open_page, report, site):
    page = open_page(report)
    assert SCRIPT in page.locator("h1").inner_text()
    assert page.title() != "taken"
    page = open_page(board(site))
    assert page.title() != "taken"
    assert page.get_by_role("link", name=SCRIPT).count() == 1


def test_the_policy_lets_no_other_script_run(open_page, report):
    page = open_page(report)
    page.evaluate(
        """() => { const s = document.createElement('script');
        s.textContent = 'window.taken = 1'; document.body.append(s); }"""
    )
    assert page.evaluate("window.taken") is None
    assert any("Content Security Policy" in problem for problem in page.problems)


def test_another_take_is_drawn_when_chosen(open_page, report):
    page = drawn(open_page(report))
    before = page.locator("#figures").inner_html()
    choice = page.get_by_role("combobox", name="Take")
    choice.select_option(index=0)
    assert "calibrate" in choice.locator("option:checked").inner_text()
    assert page.locator("#figures").inner_html() != before


def figure(page, title):
    return page.locator("figure", has=page.get_by_text(title, exact=True))


def test_arrow_keys_read_values_and_zoom(open_page, report):
    page = drawn(open_page(report))
    chart = figure(page, "APE over time")
    chart.locator("> svg").focus()
    page.keyboard.press("ArrowRight")
    first = chart.locator("output").inner_text()
    assert first.startswith("t ")
    assert " mm" in first
    page.keyboard.press("Shift+ArrowRight")
    assert chart.locator("output").inner_text() != first
    whole = chart.locator("> svg").inner_html()
    page.keyboard.press("+")
    assert chart.locator("> svg").inner_html() != whole
    page.keyboard.press("Escape")
    assert chart.locator(".tick").all_text_contents()[0] == "0"


def test_a_drag_zooms_and_a_double_click_shows_all(open_page, report):
    page = drawn(open_page(report))
    chart = figure(page, "APE over time").locator("> svg")
    chart.scroll_into_view_if_needed()
    box = chart.bounding_box()
    ticks = chart.locator(".tick").all_text_contents()
    page.mouse.move(box["x"] + 300, box["y"] + 80)
    page.mouse.down()
    page.mouse.move(box["x"] + 500, box["y"] + 80)
    page.mouse.up()
    assert chart.locator(".tick").all_text_contents() != ticks
    chart.dblclick()
    assert chart.locator(".tick").all_text_contents() == ticks


def test_the_path_turns_by_keyboard_and_has_plain_views(open_page, report):
    page = drawn(open_page(report))
    space = figure(page, "Path of the eye")
    path = space.locator("> svg")
    before = path.inner_html()
    path.focus()
    page.keyboard.press("ArrowLeft")
    assert path.inner_html() != before
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    assert path.inner_html() == before
    for view, sides in (("from above", "xy"), ("along y", "xz"), ("along x", "yz")):
        space.get_by_role("button", name=view).click()
        assert "".join(text[0] for text in path.locator("text").all_text_contents()) == sides


def test_a_path_as_slender_as_a_pillar_stays_within_its_figure(open_page, tmp_path):
    spec = {"title": "Pillar", "summary": "", "note": "", "top": 1, "error": None}
    spec["xyz"] = [[0, 0.1, 0], [0, 0, 0.1], [0, 1, 2]]
    folder = Path(pages.__file__).parent
    scripts = [(folder / name).read_text() for name in ("chart.js", "space.js")]
    scripts.append(f"new Space(document.body, {json.dumps(spec)})")
    (tmp_path / "pillar.html").write_text(f"<body><script>{''.join(scripts)}</script>")
    page = open_page(tmp_path / "pillar.html")
    pillar = figure(page, "Pillar").locator("> svg")
    pillar.locator(".cage").wait_for(state="attached")
    reach = "(all) => all.map((one) => one.getBBox()).flatMap((b) => [b.y, b.y + b.height])"
    for mark in (".cage", "text"):
        ends = pillar.locator(mark).evaluate_all(reach)
        assert min(ends) >= 0
        assert max(ends) <= float(pillar.get_attribute("height"))


def test_a_thumb_on_the_path_scrolls_the_page(open_page, report):
    page = drawn(open_page(report, width=390))
    for chart in page.locator("figure > svg").all():
        assert "pan-y" in chart.evaluate("(one) => getComputedStyle(one).touchAction")


def test_names_that_are_too_long_are_cut_and_told_whole(open_page, site):
    page = open_page(board(site))
    name = page.locator("#intervals text.name", has_text="…").first
    assert TURNED[1:] in name.locator("title").text_content()
    assert name.evaluate("(one) => one.getBBox().width") < 1280
    cell = page.locator("#board .name[title]", has_text=TURNED[1:]).first
    assert cell.bounding_box()["width"] < 400


def test_on_paper_tables_have_all_their_columns(open_page, report):
    page = drawn(open_page(report, width=700))
    page.evaluate("document.querySelectorAll('details').forEach((all) => { all.open = true; })")
    page.emulate_media(media="print")
    cut = "(all) => all.filter((e) => e.checkVisibility() && e.scrollWidth > e.clientWidth).length"
    assert page.locator(".scroll").evaluate_all(cut) == 0
    assert page.evaluate("document.documentElement.scrollWidth") <= 700


def test_a_figure_is_saved_as_svg_with_its_colours(open_page, report, tmp_path):
    page = drawn(open_page(report))
    with page.expect_download() as download:
        page.get_by_role("button", name="Save the figure APE over time as SVG").click()
    assert download.value.suggested_filename == "ape-over-time.svg"
    download.value.save_as(tmp_path / "figure.svg")
    root = ElementTree.parse(tmp_path / "figure.svg").getroot()
    strokes = {path.get("stroke") for path in root.iter("{http://www.w3.org/2000/svg}path")}
    assert "rgb(11, 98, 164)" in strokes


@pytest.mark.parametrize("width", [320, 390, 1280])
def test_no_page_is_wider_than_the_window(open_page, report, site, width):
    for path in (report, board(site), site / "index.html", site / "runs.html"):
        page = open_page(path, width=width)
        if path == report:
            drawn(page)
        assert page.evaluate("document.documentElement.scrollWidth") <= width, path.name


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_texts_can_be_read(open_page, report, site, scheme):
    for path in (report, board(site), site / "index.html"):
        page = open_page(path, scheme=scheme)
        if path == report:
            drawn(page)
        assert page.evaluate(CONTRAST) == [], path.name


def test_no_labels_of_an_axis_overlap(open_page, report):
    for width in (360, 1280):
        page = drawn(open_page(report, width=width))
        overlaps = page.evaluate(
            """() => { const found = [];
            for (const svg of document.querySelectorAll('figure > svg')) {
              const boxes = [...svg.querySelectorAll('text')].filter((t) => t.textContent)
                .map((t) => [t.textContent, t.getBoundingClientRect()]);
              boxes.forEach(([a, p], i) => boxes.slice(i + 1).forEach(([b, q]) => {
                if (p.left < q.right - 1 && q.left < p.right - 1 && p.top < q.bottom - 3
                    && q.top < p.bottom - 3) found.push(`${a} / ${b}`); }));
            } return found; }"""
        )
        assert overlaps == []


def column(page, index):
    return page.locator(f"#board tbody tr:not([hidden]) > *:nth-child({index})").all_text_contents()


def test_a_board_is_sorted_by_keyboard_and_says_so(open_page, site):
    page = open_page(board(site))
    heading = page.get_by_role("columnheader", name="device")
    heading.get_by_role("button").focus()
    page.keyboard.press("Enter")
    assert heading.get_attribute("aria-sort") == "ascending"
    rising = column(page, 2)
    assert rising == sorted(rising)
    page.keyboard.press("Space")
    assert heading.get_attribute("aria-sort") == "descending"
    assert column(page, 2) == rising[::-1]
    page.keyboard.press("Enter")
    assert heading.get_attribute("aria-sort") is None


def test_numbers_are_sorted_as_numbers(open_page, site):
    page = open_page(board(site))
    heading = page.get_by_role("columnheader", name="takes")
    heading.get_by_role("button").click()
    assert heading.get_attribute("aria-sort") == "ascending"
    values = [float(text.split()[0]) for text in column(page, 3)]
    page.get_by_role("columnheader", name="value").get_by_role("button").click()
    assert [float(text.split()[0]) for text in column(page, 3)] == sorted(values)


def test_a_board_is_filtered_and_the_count_is_told(open_page, site):
    page = open_page(board(site))
    told = page.locator("form output")
    assert told.inner_text() == "4 rows"
    page.get_by_label("Search").fill("ALPHA lab")
    assert told.inner_text() == "1 of 4 rows"
    assert column(page, 2) == ["alpha"]
    page.get_by_label("Search").fill("")
    page.get_by_label("Lab").select_option("other")
    assert column(page, 2) == ["gamma"]


def test_the_tab_key_goes_from_top_to_bottom(open_page, site):
    page = open_page(board(site))
    tops = []
    for _ in range(12):
        page.keyboard.press("Tab")
        tops.append(
            page.evaluate(
                "document.activeElement.className === 'skip' ? -1 "
                ": document.activeElement.getBoundingClientRect().top + scrollY"
            )
        )
    assert tops[0] == -1
    assert all(b >= a - 40 for a, b in pairwise(tops))


def test_every_table_and_figure_is_named(open_page, report, site):
    for path in (report, board(site), site / "index.html", site / "runs.html"):
        page = open_page(path)
        assert page.locator("table:not(:has(caption))").count() == 0
        assert page.locator("thead th:not([scope])").count() == 0
        assert page.locator("figure > svg:not([aria-label])").count() == 0
        assert page.locator("html[lang=en]").count() == 1


def test_without_scripts_the_numbers_are_there(open_page, report):
    page = open_page(report, script=False)
    assert page.locator("table").first.is_visible()
    assert "drawn by a script" in page.locator("noscript").first.inner_text()
