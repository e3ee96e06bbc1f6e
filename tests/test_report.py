"""The report as a browser reads it: valid, self-contained, escaped, and with the numbers of the summary."""

import base64
import io
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from artists import failing
from PIL import Image
from worlds import full_scenario, problem

from lab.compare import compare
from lab.findings import findings
from lab.report import COLUMNS, MOST_FAILURES, write_report
from lab.solvers import rbpf, sir, sis

MINUS, DASH = "\N{MINUS SIGN}", "\N{EN DASH}"
VOID = {"meta", "img", "br", "hr", "link", "input"}
NASTY = '<b onclick="x">&amp; "mine"</b>'
CONFIG = {
    "repeat": f"slam-lab compare --solvers '{NASTY}'",
    "inputs": {NASTY: {"file": "<my> filters.py", "sha256": "ab" * 32}},
    "files": [],
    "versions": {"toy-slam-lab": "0.1.0", "numpy": "2.4.6"},
    "platform": "Linux <6.1>",
}


class Page(HTMLParser):
    """The elements of a page in order: tag, attributes, and the text inside, that of inner elements included."""

    def __init__(self, text):
        super().__init__()
        self.elements, self.open = [], []
        self.feed(text)
        self.close()
        assert not self.open, self.open

    def handle_starttag(self, tag, attrs):
        names = [name for name, _ in attrs]
        assert len(set(names)) == len(names), (tag, names)
        element = {"tag": tag, **dict(attrs), "text": "", "inside": [e["tag"] for e in self.open]}
        self.elements.append(element)
        if tag not in VOID:
            self.open.append(element)

    def handle_endtag(self, tag):
        assert self.open.pop()["tag"] == tag

    def handle_data(self, data):
        for element in self.open:
            element["text"] += data

    def all(self, *tags):
        return [element for element in self.elements if element["tag"] in tags]

    def tables(self):
        """Return each table as caption and rows of cells, each cell an element."""
        found = []
        for element in self.elements:
            if element["tag"] == "table":
                found.append((None, []))
            elif element["tag"] == "caption":
                found[-1] = (element["text"], found[-1][1])
            elif element["tag"] == "tr":
                found[-1][1].append([])
            elif element["tag"] in ("td", "th"):
                found[-1][1][-1].append(element)
        return found


def picture(folder, name, size=(30, 20)):
    Image.new("RGB", size, "white").save(folder / name)


def report(folder, comparison, figures=(), config=CONFIG, said=None):
    for file, *_ in figures:
        picture(folder, file)
    write_report(folder / "report.html", comparison, figures, config, findings(comparison) if said is None else said)
    text = (folder / "report.html").read_text(encoding="utf-8")
    return text, Page(text)


@pytest.fixture(scope="module")
def comparison():
    """Two data sets; a filter with a name and an error that would break a page fails with few particles."""

    def frail(problem, rng, *, n_particles):
        if n_particles < 20:
            raise ValueError("<script>alert('no')</script>")
        return rbpf(problem, rng, n_particles=n_particles)

    sets = [problem(full_scenario(3, n_steps=8), seed) for seed in (0, 1)]
    return compare(sets, {"sir": sir, NASTY: frail, "sis": sis}, n_particles=[10, 40], runs=3)


@pytest.fixture(scope="module")
def made(comparison, tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    figures = [("b.png", "The gap", "Gap & <more> of it"), ("a.png", f"Corridors of {NASTY}", 'Says "so"')]
    return (folder, figures, *report(folder, comparison, figures))


def test_the_page_is_whole_and_speaks_english(made):
    _, _, text, page = made
    assert text.startswith("<!doctype html>\n")
    (root,) = page.all("html")
    assert root["lang"] == "en"
    for tag in ("head", "body", "main", "h1", "title"):
        assert len(page.all(tag)) == 1
    assert next(meta.get("charset") for meta in page.all("meta")) == "utf-8"


def test_headings_are_in_order_and_links_lead_somewhere(made):
    page = made[3]
    levels = [int(heading["tag"][1]) for heading in page.all("h1", "h2", "h3", "h4", "h5", "h6")]
    assert levels[0] == 1
    assert max(np.diff(levels)) == 1
    ids = [element["id"] for element in page.elements if "id" in element]
    assert len(set(ids)) == len(ids)
    targets = [link["href"] for link in page.all("a")]
    targets += [f"#{element['aria-labelledby']}" for element in page.elements if "aria-labelledby" in element]
    assert len(targets) >= 10
    assert set(targets) <= {f"#{name}" for name in ids}


def test_it_needs_nothing_from_elsewhere(made):
    _, _, text, page = made
    assert not page.all("script", "link", "iframe", "object", "embed")
    for element in page.elements:
        assert not {"srcset", "style", "onclick", "action", "background"} & set(element)
        for name in ("href", "src"):
            assert element.get(name, "#").startswith(("#", "data:image/png;base64,"))
    assert "http" not in re.sub(r"base64,[^\"]*", "", text)
    assert "url(" not in page.all("style")[0]["text"]
    assert "@import" not in page.all("style")[0]["text"]


def test_it_can_be_read_in_the_dark_and_on_paper(made):
    page = made[3]
    (style,) = page.all("style")
    assert "prefers-color-scheme: dark" in style["text"]
    assert "@media print" in style["text"]
    assert {meta.get("content") for meta in page.all("meta") if meta.get("name") == "color-scheme"} == {"light dark"}


def test_every_figure_is_inside_with_its_size_its_words_and_its_caption(made):
    folder, figures, _, page = made
    images, captions = page.all("img"), page.all("figcaption")
    for i, ((file, title, alt), image, caption) in enumerate(zip(figures, images, captions, strict=True)):
        data = base64.b64decode(image["src"].removeprefix("data:image/png;base64,"), validate=True)
        assert data == (folder / file).read_bytes()
        with Image.open(io.BytesIO(data)) as inside:
            assert (int(image["width"]), int(image["height"])) == inside.size == (30, 20)
        assert image["alt"] == alt
        assert image["inside"][-1] == "figure"
        assert caption["text"] == f"Figure {i + 1}. {title}."


def test_what_users_wrote_is_text(made):
    _, _, text, page = made
    assert not page.all("b", "script", "my")
    assert "<script>" not in text
    cells = [element["text"] for element in page.all("td", "th")]
    assert cells.count(NASTY) >= 3  # in the summary, among the failures, among the inputs
    assert any("<script>alert('no')</script>" in cell for cell in cells)
    assert any(NASTY in item["text"] for item in page.all("li"))
    assert page.all("pre")[0]["text"] == CONFIG["repeat"]


def test_tables_have_captions_and_their_headers_a_scope(made):
    page = made[3]
    assert len(page.tables()) == 4
    for caption, rows in page.tables():
        assert caption
        assert len({len(row) for row in rows}) == 1
        assert {cell["scope"] for cell in rows[0]} == {"col"}
        for row in rows[1:]:
            assert [cell["tag"] for cell in row] == ["th"] + ["td"] * (len(row) - 1)
            assert row[0]["scope"] == "row"


def summary_table(page):
    (table,) = (rows for caption, rows in page.tables() if caption.startswith("Means over"))
    return table


def test_the_numbers_are_those_of_the_summary(made, comparison):
    page = made[3]
    header, *rows = summary_table(page)
    summary = comparison.summary()
    assert len(rows) == len(summary) == 6
    assert [cell["text"] for cell in header[:4]] == ["solver", "N [particles]", "data sets", "runs"]
    assert [cell["text"] for cell in header[4:]] == [f"{c.header} [{c.unit}]" for c in COLUMNS]
    exact = [element for element in page.elements if element["tag"] == "data"]
    for row, (_, expected) in zip(rows, summary.iterrows(), strict=True):
        assert row[0]["text"] == expected["solver"]
        assert [int(cell["text"]) for cell in row[1:4]] == [expected[n] for n in ("n_particles", "data_sets", "runs")]
        for cell, column in zip(row[4:], COLUMNS, strict=True):
            values = [expected[column.name], expected.get(f"{column.name}_se", np.nan)]
            shown = re.findall(r"[^\s()]+", cell["text"].replace(MINUS, "-"))
            if np.isnan(values[0]):
                assert shown == [DASH]
                continue
            written = [(v, n) for v, n in zip(values, (column.digits, 2), strict=True) if not np.isnan(v)]
            for text, (value, digits) in zip(shown, written, strict=True):
                assert float(text) == pytest.approx(value, rel=0.501 * 10.0 ** (1 - digits))
                assert "e" not in text or abs(value) < 1e-4
                assert float(exact.pop(0)["value"]) == value
    assert not exact


def test_a_number_is_rounded_as_in_the_table_of_the_terminal(made, comparison):
    from lab.cli.tables import _cell

    row = comparison.summary().iloc[0]
    cell = summary_table(made[3])[1][4]["text"]
    assert cell == _cell(row["mean_gap"], row["mean_gap_se"], 3)


def test_failed_runs_are_named_with_their_seed(made, comparison):
    (rows,) = (rows for caption, rows in made[3].tables() if "failed" in caption)
    for row, record in zip(rows[1:], comparison.failures, strict=True):
        unit = record.unit
        expected = [unit.solver, unit.n_particles, unit.data_set, unit.run, unit.seed, record.error]
        assert [cell["text"] for cell in row] == list(map(str, expected))
    assert len(rows) == 1 + 6
    assert "6 of 36 runs failed" in made[2]


def test_configuration_is_there(made):
    text = made[3].all("main")[0]["text"]
    for words in ("ab" * 32, "<my> filters.py", "Linux <6.1>", "toy-slam-lab", "2.4.6"):
        assert words in text


def test_the_scope_is_said(made):
    paragraph = made[3].all("p")[0]["text"]
    expected = "3 filters with N = 10 and 40 particles: 3 runs on each of 2 data sets; 8 instants, 3 landmarks."
    assert paragraph == expected


def test_findings_are_those_given(made, comparison):
    items = [item["text"] for item in made[3].all("li") if "nav" not in item["inside"]]
    assert items == findings(comparison)


def test_one_run_of_one_filter_without_figures(tmp_path):
    result = compare(problem(full_scenario(1, n_steps=4)), {"sir": sir}, n_particles=5, runs=1)
    text, page = report(tmp_path, result, config={}, said=[])
    assert page.all("p")[0]["text"] == "1 filter with N = 5 particles: one run; 4 instants, 1 landmark."
    assert not page.all("img", "pre")
    assert "Failed" not in text
    header, row = summary_table(page)
    assert [cell["text"] for cell in header[:3]] == ["solver", "N [particles]", "runs"]
    assert not any("(" in cell["text"] for cell in row)  # one run has no standard error
    assert not any("nan" in cell["text"] for cell in row)
    assert "Nothing remarkable" in text


def test_many_failures_are_cut_and_counted(tmp_path):
    result = compare(problem(full_scenario(1, n_steps=3)), {"a": failing}, n_particles=[1, 2], runs=60)
    text, page = report(tmp_path, result)
    (rows,) = (rows for caption, rows in page.tables() if "failed" in caption)
    assert len(rows) == 1 + MOST_FAILURES
    assert "120 of 120 runs failed" in text
    assert [cell["text"] for cell in summary_table(page)[1][3:]] == [DASH] * len(COLUMNS)


def test_a_figure_that_is_missing_is_an_error(tmp_path, comparison):
    with pytest.raises(FileNotFoundError, match=r"gone\.png"):
        write_report(tmp_path / "report.html", comparison, [("gone.png", "t", "a")], CONFIG, [])
    assert not (tmp_path / "report.html").exists()
