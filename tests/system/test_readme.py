"""The README keeps its promises: its examples run, all scenarios are listed, its links lead somewhere."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import typer

import scanner_sim
from scanner_sim.cli import app
from scanner_sim.config import scenario_from_text

PACKAGE_HOME = Path(scanner_sim.__file__).resolve().parents[1]


@pytest.fixture
def readme(repo_root: Path) -> str:
    return (repo_root / "README.md").read_text(encoding="utf-8")


def block(readme: str, language: str) -> str:
    (found,) = re.findall(rf"```{language}\n(.*?)```", readme, flags=re.DOTALL)
    return found


def test_the_yaml_and_the_python_example_are_the_same_and_run(
    readme: str, device: object, capsys: pytest.CaptureFixture[str]
) -> None:
    names: dict[str, Any] = {}
    exec(block(readme, "python"), names)
    assert names["scenario"] == scenario_from_text(block(readme, "yaml"), name="README.md")
    assert "64 rows × 64 columns" in capsys.readouterr().out
    assert names["dataset"]["range_m"].attrs["units"] == "m"


def test_every_scenario_is_listed(repo_root: Path) -> None:
    """Files and channels are listed by the generated reference: see test_docs.py."""
    page = (repo_root / "docs" / "scenarios.md").read_text(encoding="utf-8")
    scenarios = {path.name for path in (repo_root / "configs").glob("*.yaml")}
    assert scenarios == set(re.findall(r"^\| `([^`]+)` \|", page, flags=re.MULTILINE))


def test_every_verb_is_shown_and_every_command_is_one(readme: str, repo_root: Path) -> None:
    """Claim: each line of the examples names a verb, options and files that exist; no verb is left out."""
    group: Any = typer.main.get_command(app)
    lines = re.findall(r"^scanner-sim (.*?)(?:\s+#.*)?$", readme, flags=re.MULTILINE)
    shown = set()
    for line in lines:
        verb, *arguments = shlex.split(line.partition(">")[0])
        if verb == "--install-completion":
            continue
        options = {name for option in group.commands[verb].params for name in option.opts}
        assert {word for word in arguments if word.startswith("-")} <= options, line
        assert all((repo_root / word).is_file() for word in arguments if word.startswith("configs/")), line
        shown.add(verb)
    assert shown == set(group.commands)


def test_links_lead_somewhere(readme: str, repo_root: Path) -> None:
    links = [link for link in re.findall(r"\]\(([^)]+)\)", readme) if "://" not in link]
    assert links
    # The package may be installed elsewhere, without the repository around it.
    homes = {link: PACKAGE_HOME if link.startswith("scanner_sim/") else repo_root for link in links}
    assert not [link for link, home in homes.items() if not (home / link).exists()]
