"""Test with the oldest and the newest packages that pyproject.toml allows, on every Python that is found.

    matrix.py                       all that are found
    matrix.py python3.13 -- tests/unit

Each pair of them has a row in the table of docs/tested.md, which says when it was tested last; a run replaces the rows
of its own and leaves the others. It runs the quick tests: what a version breaks, it breaks there. The oldest are the
lowest versions of what the package asks for itself (not of what those ask for) that are built for that Python, as uv
resolves them; pip cannot. Each pair gets an environment of its own, which is deleted again.
"""

from __future__ import annotations

import platform
import re
import shutil
import subprocess
import sys
import tempfile
from datetime import UTC, datetime
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[1]
PAGE = REPOSITORY / "docs" / "tested.md"
PYTHONS = ("python3.11", "python3.12", "python3.13", "python3.14", "python3.15")
RESOLUTIONS = {"lowest-direct": "oldest", "highest": "newest"}
ROOMS = ["tests/architecture", "tests/conventions", "tests/regression", "tests/unit", "tests/paper"]
SHOWN = ("mitsuba", "numpy", "scipy", "pydantic", "openexr", "typer")
BEGIN, END = "<!-- made by tests/matrix.py -->\n", "<!-- end -->"


def outcome(python: str, resolution: str, places: list[str]) -> tuple[str, str]:
    """Return the versions that were tested, and how many tests passed and failed."""
    with tempfile.TemporaryDirectory() as folder:
        uv = [sys.executable, "-m", "uv"]
        subprocess.run([*uv, "venv", "--quiet", "--python", python, folder], check=True)
        interpreter = Path(folder) / "bin" / "python"
        install = [*uv, "pip", "install", "--quiet", "--python", str(interpreter), "--resolution", resolution]
        install += ["--only-binary", ":all:"]
        done = subprocess.run([*install, "--editable", ".[test]"], cwd=REPOSITORY, check=False)
        if done.returncode:
            return "", "cannot be installed"
        listed = subprocess.run(
            [*uv, "pip", "list", "--python", str(interpreter)], capture_output=True, text=True, check=True
        ).stdout
        found = {
            name.lower(): version for name, version in re.findall(r"^(\S+) +(\d\S*)", listed, re.MULTILINE)
        }
        tested = subprocess.run(
            [
                str(interpreter),
                "-m",
                "pytest",
                "-q",
                "-p",
                "no:cacheprovider",
                "--tb=short",
                *places,
            ],
            cwd=REPOSITORY,
            capture_output=True,
            text=True,
            check=False,
        )
    print(tested.stdout[-4000:], tested.stderr[-2000:], flush=True)
    counts = re.findall(r"\d+ (?:passed|failed|errors?|skipped)", tested.stdout)
    return ", ".join(f"{name} {found.get(name, '?')}" for name in SHOWN), ", ".join(counts) or "no test ran"


def main() -> int:
    """Run as the module says; the exit status is 1 if a test fails."""
    given, _, places = " ".join(sys.argv[1:]).partition("--")
    pythons = given.split() or [name for name in PYTHONS if _runs(name)]
    rows, failed = _rows(), False
    for python in pythons:
        said = subprocess.run(
            [python, "--version"], capture_output=True, text=True, check=True
        ).stdout.split()[-1]
        for resolution, word in RESOLUTIONS.items():
            versions, result = outcome(python, resolution, places.split() or ROOMS)
            failed |= "passed" not in result or "failed" in result or "error" in result
            series = said.rpartition(".")[0]
            today = datetime.now(UTC).date().isoformat()
            rows[series, word] = f"| {said} | {word} | {versions} | {result} | {today} |"
            print(rows[series, word], flush=True)
    if not places:
        _write(rows)
    return int(failed)


def _runs(python: str) -> bool:
    """Return whether there is such a Python: a shim may have none behind it."""
    found = shutil.which(python)
    return found is not None and subprocess.run([found, "--version"], capture_output=True).returncode == 0


def _rows() -> dict[tuple[str, str], str]:
    """Return the rows of the table by Python and packages."""
    made = PAGE.read_text(encoding="utf-8").partition(BEGIN)[2].partition(END)[0]
    found = re.findall(r"^\| (3\.\d+)\S* \| (oldest|newest) \|.*", made, re.MULTILINE)
    lines = [line for line in made.splitlines() if re.match(r"\| 3\.", line)]
    return dict(zip(found, lines, strict=True))


def _write(rows: dict[tuple[str, str], str]) -> None:
    """Put the rows into the document, by Python."""
    head = [f"{platform.system()} {platform.machine()}:", "", "| Python | packages | of them | tests | on |"]
    order = sorted(rows, key=lambda pair: (int(pair[0].split(".")[1]), pair[1] == "newest"))
    made = "\n".join([*head, "|---|---|---|---|---|", *(rows[pair] for pair in order), ""])
    text = PAGE.read_text(encoding="utf-8")
    before, _, rest = text.partition(BEGIN)
    PAGE.write_text(before + BEGIN + made + END + rest.partition(END)[2], encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
