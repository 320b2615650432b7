"""The page of a campaign, from rows that were put in."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from scanner_sim.campaign.reading import read_campaign
from scanner_sim.campaign.report import report_page
from scanner_sim.campaign.store import Row, Store, opened

MEASURES = ("sigma_range", "coverage", "bias_range")


class Tags(HTMLParser):
    """Fails where tags are not closed in order or something would be fetched."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.feed(page)
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert tag != "script"
        self.open += [] if tag in {"meta", "img"} else [tag]
        for name, value in attrs:
            assert name not in {"src", "href"} or (value or "").startswith(("data:", "#"))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


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


def test_the_page_tells_what_does_something_what_is_dead_and_what_failed(store: Store) -> None:
    page = report_page(store)
    Tags(page)
    text = re.sub(r'src="[^"]*"', "", page)
    sigma, coverage = (text.split(f'<h2 id="{name}">')[1].split("<h2")[0] for name in MEASURES[:2])
    rows = dict(re.findall(r"<tr><td>((?:scanner|processing)\.[^<]*)</td>(.*?)</tr>", sigma, re.S))
    assert "dead" not in rows["scanner.laser.power"]
    assert re.search(r"<td>0\.00(2|19|20)\d*</td>", rows["scanner.laser.power"]), "2 mm between 5 and 15 mW"
    dead = dict(re.findall(r"<tr><td>(scanner\.[^<]*)</td>(.*?)</tr>", coverage, re.S))
    assert "dead: no change beyond" in dead["scanner.laser.power"]
    assert "&lt;b&gt;it&lt;/b&gt; broke." in text
    assert "bias_range: no run has it." in text
    worst = re.search(r"campaign rerun \S+ --run (\d+)", sigma)
    assert worst is not None
    assert store.campaign.place(int(worst[1]))[0] == 0, "the weakest laser has the largest σ"


def test_a_campaign_without_rows_has_a_page(store: Store, tmp_path: Path) -> None:
    with opened(tmp_path / "empty", store.campaign, MEASURES) as empty:
        pass
    page = report_page(empty)
    Tags(page)
    assert "0 runs are done" in page
