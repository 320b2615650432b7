"""Names do not steer a terminal, a page, a picture or a file: what they hold is shown to the letter."""

from __future__ import annotations

import dataclasses
import io
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from scanner_sim.cli import app
from scanner_sim.cli.tables import print_rows, print_table
from scanner_sim.foundation.errors import printable
from scanner_sim.products import comparison_page as comparison_module
from scanner_sim.products.comparison import Change, Check, Comparison, Finding
from scanner_sim.products.comparison_page import comparison_page
from scanner_sim.products.files.run_folder import write_run
from scanner_sim.products.image import RangeImage
from scanner_sim.validation.reproduce.page import markdown_text

NASTY = "\x1b[31mred\x07[/red]\r\n\x9b2J\u202e<script>alert('$')</script>`$\\bad$|![x](y)"


def shown(text: str) -> set[str]:
    """Characters of a text that act on a terminal."""
    return {
        letter for letter in text if (ord(letter) < 32 and letter != "\n") or 127 <= ord(letter) < 160
    } | (set(text) & set("\u202a\u202b\u202d\u202e\u2066\u2067\u2028\u2029"))


def test_a_text_loses_nothing_but_its_effect() -> None:
    assert printable("σ of 12 µm, Θ → “wall” 漢字") == "σ of 12 µm, Θ → “wall” 漢字"
    assert printable("a\x1b[0m\n") == r"a\x1b[0m\n"
    assert printable("a\nb\t", lines=True) == "a\nb\\t"
    assert printable("b\udc80") == r"b\udc80"
    assert not shown(printable(NASTY))


def test_tables_show_names_to_the_letter(capsys: pytest.CaptureFixture[str]) -> None:
    print_table({"folder": NASTY})
    print_rows([["name", "count"], [NASTY, "1"]])
    told = capsys.readouterr().out
    assert not shown(told)
    assert told.count("[/red]") == 2
    assert len(told.splitlines()) == 3


@pytest.mark.parametrize("verb", ["run", "check", "budget", "orbit", "calibrate", "show"])
def test_messages_show_file_names_to_the_letter(verb: str, tmp_path: Path) -> None:
    name = NASTY.replace("/", "") + ".yaml"
    result = CliRunner().invoke(app, [verb, str(tmp_path / name)])
    assert result.exit_code == 2
    assert not shown(result.output)
    (tmp_path / name).write_text(f"schema: 1\n? {NASTY.encode('unicode_escape').decode()!r}\n: 1\n")
    result = CliRunner().invoke(app, [verb, str(tmp_path / name)])
    assert result.exit_code == 2
    assert not shown(result.output)


def test_pages_get_no_tags_of_a_name() -> None:
    text = markdown_text(NASTY)
    assert "<" not in text.replace("&lt;", "")
    assert not shown(text)
    assert "script&gt;" in text


def test_the_page_of_a_comparison_gets_no_tags_of_anything_in_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: each text of a comparison stands on its page to the letter, in an attribute, a cell or a line alike."""
    numbers = dict.fromkeys(
        ("predicted", "accuracy", "simulated", "error", "freedom", "low", "high", "effect", "scale", "p", "adjusted_p",
         "detects_90", "detects_99"), 0.5,
    )  # fmt: skip
    check = Check(NASTY, NASTY, NASTY, "mean", relative_to=NASTY, broken=True, **numbers)
    finding = Finding(NASTY, NASTY, NASTY, NASTY, NASTY, NASTY, (check,))
    none = dataclasses.replace(finding, checks=())
    change = Change(NASTY, NASTY, NASTY, NASTY, 0.1, 0.2, 0.3)
    found = Comparison(1, 2, 0.01, True, NASTY, (finding, none), {NASTY: NASTY}, (change,))
    monkeypatch.setattr(comparison_module, "finding_picture", lambda finding: "data:,")
    page = comparison_page(found, NASTY)
    assert "<script" not in page
    assert "alert('" not in page
    assert not shown(page)
    # Target, two of the versions, broken law; name, title, unit of the overview, and name, title, reason of the other;
    # law, case and what changed; six of the law and its picture's; case, quantity and unit; the scenario.
    assert page.count("script&gt;alert(&#39;") == 4 + 3 + 2 + 3 + 7 + 3 + 1


def test_a_cell_of_a_page_stays_a_cell() -> None:
    assert markdown_text("a|b") == r"a\|b"
    assert markdown_text("![x](http://y) [l](javascript:z)") == r"\![x\](http://y) [l\](javascript:z)"
    assert markdown_text("σ_R of 1 % [mm], 10⁻³") == "σ_R of 1 % [mm], 10⁻³"


def test_pictures_and_point_clouds_take_any_name(tmp_path: Path) -> None:
    ranges = np.full((3, 4), 9.0, np.float32)
    layers = dict.fromkeys(("range_m", "P.X", "P.Y", "P.Z", "Y", "truth.range_m"), ranges)
    image = RangeImage(
        channels={**layers, "status": np.zeros((3, 4), np.float32)},
        theta=np.linspace(-0.1, 0.1, 4),
        phi=np.linspace(-0.1, 0.1, 3),
        objects=("$\\bad$", "\x1b[31m\rend_header"),
        seed=0,
        scenario_yaml="schema: 1\n",
    )
    write_run(image, tmp_path / "out")
    header = io.BytesIO((tmp_path / "out" / "points.ply").read_bytes())
    lines = list(iter(header.readline, b"end_header\n"))
    assert sum(line.startswith(b"element vertex") for line in lines) == 1
    assert not shown(b"".join(lines).decode())
