"""The page of a campaign, from rows that were put in."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import html5lib
import numpy as np
import pytest

from scanner_sim.campaign import report
from scanner_sim.campaign.reading import read_campaign
from scanner_sim.campaign.report import report_page
from scanner_sim.campaign.result import CampaignResult
from scanner_sim.campaign.sensitivity import design_of
from scanner_sim.campaign.store import Row, Store, column_of, opened

MEASURES = ("sigma_range", "coverage", "bias_range")


def opened_by_a_browser(page: str) -> str:
    """Return the page without its pictures, which has no fault of HTML 5, runs nothing and fetches nothing."""
    tree = html5lib.HTMLParser(strict=True).parse(page)
    for element in tree.iter():
        assert not str(element.tag).endswith(("script", "iframe", "object", "link"))
        for name, value in element.attrib.items():
            assert not name.startswith("on")
            assert name not in {"src", "href"} or value.startswith(("data:image/png;base64,", "#"))
    return re.sub(r'src="[^"]*"', "", page)


def verdicts(page: str, measure: str) -> dict[str, str]:
    """Return what the page says of each key of a measure."""
    part = page.split(f'<h2 id="{measure}">')[1].split("<h2")[0]
    return dict(
        re.findall(
            r'<tr><td>((?:scan|processing|scene)[^<]*)</td>.*?<td class="words[^>]*>(.*?)</td></tr>',
            part,
            re.S,
        )
    )


@pytest.fixture
def store(tmp_path: Path, small_scenario: str) -> Store:
    """σ follows the power and nothing else, coverage nothing; run 3 failed, and nothing has a bias."""
    (tmp_path / "small.yaml").write_text(small_scenario, encoding="utf-8")
    (tmp_path / "plan.yaml").write_text(
        "schema: 1\nbase: small.yaml\nrepeat: 4\nmeasure: [sigma_range, coverage, bias_range]\n"
        "vary:\n  - keys: {scanner.laser.power: [5 mW, 10 mW, 15 mW]}\n"
        "  - keys: {processing.threshold: {uniform: [5, 7]}, processing.peak: [parabola, gaussian, parabola]}\n"
        "    count: 3\n",
        encoding="utf-8",
    )
    campaign = read_campaign(tmp_path / "plan.yaml")
    rng = np.random.default_rng(1)
    with opened(tmp_path / "out", campaign, MEASURES) as found:
        for run in range(len(campaign)):
            if run == 3:
                found.add(Row(run, 1, "<b>it</b> broke.", 0.1, {}))
                continue
            sigma = 1e-3 * (3 - campaign.place(run)[0]) + 1e-5 * rng.normal()
            row = {"sigma_range": sigma, "coverage": 0.95 + 0.01 * rng.normal(), "bias_range": np.nan}
            found.add(Row(run, 1, "", 0.1, row))
    return found


@pytest.mark.pinned
def test_the_page_tells_what_does_something_what_is_dead_and_what_failed(store: Store) -> None:
    text = opened_by_a_browser(report_page(store))
    sigma, coverage = (text.split(f'<h2 id="{name}">')[1].split("<h2")[0] for name in MEASURES[:2])
    rows = dict(re.findall(r"<tr><td>((?:scanner|processing)\.[^<]*)</td>(.*?)</tr>", sigma, re.S))
    assert "dead" not in rows["scanner.laser.power"]
    assert re.search(r"<td>0\.00(2|19|20)\d*</td>", rows["scanner.laser.power"]), "2 mm between 5 and 15 mW"
    dead = dict(re.findall(r"<tr><td>(scanner\.[^<]*)</td>(.*?)</tr>", coverage, re.S))
    assert "dead: no change beyond chance" in dead["scanner.laser.power"]
    assert "&lt;b&gt;it&lt;/b&gt; broke." in text
    assert "bias_range: no run has it." in text
    worst = re.search(r"campaign rerun \S+ --run (\d+)", sigma)
    assert worst is not None
    assert store.campaign.place(int(worst[1]))[0] == 0, "the weakest laser has the largest σ"


def test_runs_that_have_a_measure_are_its_worst(store: Store, tmp_path: Path) -> None:
    """Claim: far from the best value on either side is bad; where most runs are ideal, those that failed are not among
    the worst, and all that have a number are."""
    with opened(tmp_path / "ideal", store.campaign, MEASURES) as found:
        for run in range(8):
            measures = {} if run in (0, 2) else {"bias_range": {5: 0.5, 6: -0.7}.get(run, 0.0)}
            found.add(Row(run, 1, "" if measures else "it broke.", 0.1, measures))
    part = report._part(found, CampaignResult(found).table(), "bias_range")
    assert [one[:2] for one in part.worst] == [(6, -0.7), (5, 0.5), (1, 0.0), (3, 0.0), (4, 0.0)]


def test_a_campaign_without_rows_has_a_page(store: Store, tmp_path: Path) -> None:
    with opened(tmp_path / "empty", store.campaign, MEASURES) as empty:
        pass
    page = report_page(empty)
    opened_by_a_browser(page)
    assert "0 runs are done" in page


def page_of(folder: Path, scenario: str, vary: str, sigma: Callable[..., float]) -> str:
    """Return the page of a campaign whose σ is a function of each run's values [SI] and of a noise of 1 %."""
    (folder / "small.yaml").write_text(scenario, encoding="utf-8")
    text = f"schema: 1\nbase: small.yaml\nseed: 2\nmeasure: [sigma_range]\n{vary}"
    (folder / "plan.yaml").write_text(text, encoding="utf-8")
    campaign = read_campaign(folder / "plan.yaml")
    rng = np.random.default_rng(3)
    with opened(folder / "out", campaign, ("sigma_range",)) as store:
        values = [campaign.values(run) for run in range(len(campaign))]
        columns = {key: column_of(campaign, key, [one[key] for one in values]) for key in values[0]}
        for run in range(len(campaign)):
            row = {key: column[run] for key, column in columns.items()}
            store.add(Row(run, 1, "", 0.1, {"sigma_range": sigma(row) * (1.0 + 0.01 * rng.normal())}))
        return opened_by_a_browser(report_page(store))


WIDTH, POWER, THRESHOLD = "scanner.filter.bandwidth", "scanner.laser.power", "processing.threshold"


@pytest.mark.pinned
@pytest.mark.parametrize(
    "form",
    [
        "- keys: {WIDTH: {log_uniform: [2 nm, 30 nm]}, POWER: {uniform: [5 mW, 15 mW]}}\n    count: 14\n",
        "- keys: {WIDTH: {log_uniform: [2 nm, 30 nm]}, POWER: {uniform: [5 mW, 15 mW]}}\n    count: 16\n"
        "    sample: saltelli\n",
        "- keys: {WIDTH: [2 nm, 8 nm, 30 nm]}\n  - keys: {POWER: [5 mW, 10 mW, 15 mW]}\nrepeat: 3\n",
    ],
)
def test_a_dead_axis_is_named_however_it_varies(tmp_path: Path, small_scenario: str, form: str) -> None:
    """Claim: σ that follows the power alone has a dead axis in the filter's width: drawn, by the design, or crossed.

    One table of 20 would call a dead key alive; these are the plan's own seeds. With 14 drawn points of two keys there
    are too few for cubics, and straight lines take out the other key.
    """
    vary = "vary:\n  " + form.replace("WIDTH", WIDTH).replace("POWER", POWER)
    page = page_of(tmp_path, small_scenario, vary, lambda row: 1e-5 / row[POWER])
    found = verdicts(page, "sigma_range")
    assert found[WIDTH].startswith("dead: no change beyond chance; one of "), found
    assert re.search(r"one of [\d.e-]+ m \([\d.]+ % of the median\) would have been seen", found[WIDTH])
    assert found[POWER] == "", "it does something, and there is nothing to say"
    assert page.count("<img") == (2 if "saltelli" in form else 1)


def test_a_slight_axis_is_named_and_paired_keys_are_told_together(
    tmp_path: Path, small_scenario: str
) -> None:
    """Claim: 3 % between 2 and 30 nm are found and called slight; keys that go together have one change."""
    vary = (
        f"vary:\n  - keys: {{{WIDTH}: [2 nm, 8 nm, 30 nm]}}\n"
        f"  - keys: {{{POWER}: [5 mW, 10 mW, 15 mW], {THRESHOLD}: [5, 6, 7]}}\nrepeat: 20\n"
    )

    def sigma(row: dict[str, float]) -> float:
        return 1e-5 / row[POWER] * (1.0 + 0.03 * (row[WIDTH] - 2e-9) / 28e-9)

    found = verdicts(page_of(tmp_path, small_scenario, vary, sigma), "sigma_range")
    assert re.match(r"slight: [\d.e-]+ m \(\d\.\d % of the median\)", found[WIDTH]), found
    assert found[f"{POWER}, with {THRESHOLD}"] == ""
    assert THRESHOLD not in found


def test_few_drawn_points_are_drawn_and_said_to_be_few(tmp_path: Path, small_scenario: str) -> None:
    vary = f"vary:\n  - keys: {{{POWER}: {{uniform: [5 mW, 15 mW]}}}}\n    count: 5\n"
    page = page_of(tmp_path, small_scenario, vary, lambda row: 1e-5 / row[POWER])
    assert verdicts(page, "sigma_range") == {POWER: "too few runs to tell"}


@pytest.mark.slow
def test_a_browser_shows_what_the_parser_reads(store: Store, tmp_path: Path) -> None:
    """Claim: headings, cells and pictures are those that the page's text has; offline, by a headless Chromium.

    Where there is no Chromium the parser's reading stands alone: a machine that has Python, git and make has none.
    """
    page = tmp_path / "report.html"
    page.write_text(report_page(store), encoding="utf-8")
    browser = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    shown = page.read_text(encoding="utf-8")
    if browser is not None:
        offline = ["--headless", "--no-sandbox", "--disable-gpu", "--host-resolver-rules=MAP * ~NOTFOUND"]
        command = [browser, *offline, f"--user-data-dir={tmp_path / 'profile'}", "--dump-dom", page.as_uri()]
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
        # A command of that name that opens nothing is no browser.
        shown = shown if done.returncode else done.stdout
    wanted, found = (
        [
            (element.tag, "".join(element.itertext()).strip(), element.attrib.get("src"))
            for element in html5lib.parse(text, namespaceHTMLElements=False).iter()
            if element.tag in ("h1", "h2", "td", "th", "img")
        ]
        for text in (page.read_text(encoding="utf-8"), shown)
    )
    assert len(wanted) > 20
    assert found == wanted


def test_few_values_are_compared_one_by_one_and_more_in_bins(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: thirty stated values of keys that vary together are levels of the first of them; of more, and of drawn
    ones, each key has bins of its own, beside all the others."""
    monkeypatch.setattr(report, "by_level", lambda key, *about: ("levels", key, about[-1]))
    monkeypatch.setattr(report, "by_bin", lambda key, *about: ("bins", key, about[-1]))
    for length, drawn, levels in ((30, False, True), (31, False, False), (8, True, False)):
        group = SimpleNamespace(keys=("a", "b", "c"), drawn=drawn, length=length, sample="random")
        points = SimpleNamespace(at=lambda point: dict.fromkeys("abc", point))
        known: Any = SimpleNamespace(
            campaign=SimpleNamespace(
                plan=SimpleNamespace(vary=[group]), points=lambda _, points=points: points
            )
        )
        values = np.zeros((length, 2))
        monkeypatch.setattr(
            report, "CampaignResult", lambda _, values=values: SimpleNamespace(measured=lambda _: values)
        )
        monkeypatch.setattr(report, "_numbers", lambda _, key, values: ord(key) + np.arange(len(values)))
        found: Any = report.dependences(known, "sigma")
        if levels:
            assert found == (("levels", "a", ("b", "c")),)
            continue
        assert [one[:2] for one in found] == [("bins", "a"), ("bins", "b"), ("bins", "c")]
        for (*_, beside), others in zip(found, ("bc", "ac", "ab"), strict=True):
            np.testing.assert_array_equal(beside, np.arange(length)[:, None] + [ord(key) for key in others])


@pytest.mark.parametrize("keys", [1, 2, 5])
def test_every_point_that_is_drawn_for_itself_counts_once(keys: int) -> None:
    """Claim: of Saltelli's design those of both samples, and none that has its coordinates from them; of all other
    groups every one."""
    first, second = np.random.default_rng(3).random((2, 16, keys))
    names = tuple(f"key{number}" for number in range(keys))
    design = design_of(first, second)
    group: Any = SimpleNamespace(keys=names, length=len(design), sample="saltelli")
    found = design[report._independent(group)]
    assert sorted(map(tuple, found)) == sorted(map(tuple, [*first, *second]))
    for sample in ("random", "sobol", "latin_hypercube"):
        other: Any = SimpleNamespace(keys=names, length=37, sample=sample)
        assert report._independent(other).tolist() == list(range(37))
