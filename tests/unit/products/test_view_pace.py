"""How many points the page of a result draws while it turns: its own script, run by QuickJS."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import quickjs

import scanner_sim.products.view.page as page

HERE = Path(page.__file__).parent
SCRIPTS = sorted(HERE.glob("*.js"))


@pytest.fixture
def browser() -> Any:
    return quickjs.Context()


@pytest.fixture
def pace(browser: Any) -> Any:
    browser.eval((HERE / "pace.js").read_text(encoding="utf-8"))
    return browser


def ask(engine: Any, text: str) -> Any:
    return json.loads(engine.eval(f"JSON.stringify({text})"))


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.name)
def test_every_script_is_javascript(browser: Any, path: Path) -> None:
    """Claim: each parses; a function is compiled and not called, so that nothing of a browser is asked for."""
    browser.eval(f"new Function({json.dumps(path.read_text(encoding='utf-8'))}); true")


def test_the_order_is_a_permutation_and_its_beginnings_are_even(pace: Any) -> None:
    """Claim: of n points in the order, each tenth of the cloud has n/10 within 5 σ of a draw without replacement."""
    order = np.array(ask(pace, "Array.from(shuffled(20000))"))
    assert np.array_equal(np.sort(order), np.arange(20000))
    assert np.array_equal(order, ask(pace, "Array.from(shuffled(20000))")), "the same each time"
    for n in (500, 2000, 8000):
        counts = np.bincount(order[:n] // 2000, minlength=10)
        sigma = np.sqrt(n * 0.1 * 0.9 * (1.0 - n / 20000))
        assert np.abs(counts - n / 10).max() < 5.0 * sigma


def test_hidden_points_are_not_drawn(pace: Any) -> None:
    found = ask(
        pace,
        "(() => { const index = new Uint32Array(4), colours = new Uint8Array(16); colours[3] = colours[11] = 255;"
        " const count = indexShown([2, 1, 3, 0], colours, index); return [count, ...index.slice(0, count)]; })()",
    )
    assert found == [2, 2, 0]


def test_thinned_points_cover_what_all_cover(pace: Any) -> None:
    """Claim: drawn × width² is never less than that of all points, and small clouds are never thinned."""
    for count, share in ((262144, 1.0), (262144, 0.05), (262144, 1e-9), (3000, 0.01), (0, 0.5)):
        found = ask(pace, f"thinned({count}, {share})")
        assert 0 <= found["drawn"] <= count
        assert found["drawn"] >= min(count, 4000)
        assert found["drawn"] * found["wider"] ** 2 >= 0.999 * count
        assert (found["wider"] == 1.0) == (found["drawn"] == count)


@pytest.mark.parametrize("nanoseconds", [20.0, 200.0, 1500.0])
def test_the_share_settles_where_a_frame_takes_what_it_may(pace: Any, nanoseconds: float) -> None:
    """Claim: frames of 3 ms and so many nanoseconds a point settle at 9 to 16 ms, or at all points where that is less.

    In 60 frames at most, from a tenth and from all, and there the share changes no more, though each seventh frame
    is 90 ms late.
    """
    for start in (0.1, 1.0):
        shares = ask(
            pace,
            f"(() => {{ const pace = new Pace({start}), shares = []; for (let i = 0; i < 200; i++) {{"
            f" shares.push(pace.share); pace.took(3 + 262144 * pace.share * {nanoseconds}e-6 + (i % 7 ? 0 : 90)); }}"
            " return shares; })()",
        )
        cost = 3.0 + 262144 * shares[-1] * nanoseconds * 1e-6
        assert len(set(shares[60:])) == 1
        assert shares[-1] == 1.0 or 9.0 <= cost <= 16.0
        assert cost <= 16.0


def test_an_outline_is_closed_and_keeps_its_half_axes(browser: Any) -> None:
    """Claim: lines that join, from u round to u, all at half axes of 3 and 2 cm about the place."""
    browser.eval((HERE / "frame.js").read_text(encoding="utf-8"))
    points = np.array(ask(browser, "Array.from(ring([1, 2, 8], [0.03, 0, 0, 0, 0, 0.02]))")).reshape(-1, 2, 3)
    assert np.array_equal(points[:-1, 1], points[1:, 0])
    assert points[0, 0] == pytest.approx([1.03, 2.0, 8.0])
    assert points[-1, 1] == pytest.approx(points[0, 0], abs=1e-6)
    x, y, z = (points[:, 0] - np.array([1.0, 2.0, 8.0])).T
    assert np.hypot(x / 0.03, z / 0.02) == pytest.approx(1.0, abs=1e-4)
    assert not y.any()
    assert np.ptp(z) == pytest.approx(0.04, rel=2e-3)
