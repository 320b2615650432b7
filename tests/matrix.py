"""Test with the oldest and the newest packages that pyproject.toml allows, on every Python that is found.

    matrix.py                       all that are found, and the table of docs/tested.md
    matrix.py python3.13 -- tests/unit

The oldest are the lowest versions of what the package asks for itself (not of what those ask for), as uv resolves them;
pip cannot. Each pair gets an environment of its own, which is deleted again.
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
                "-m",
                "",
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
    pythons = given.split() or [name for name in PYTHONS if shutil.which(name)]
    rows, failed = [], False
    for python in pythons:
        said = subprocess.run(
            [python, "--version"], capture_output=True, text=True, check=True
        ).stdout.split()[-1]
        for resolution, word in RESOLUTIONS.items():
            versions, result = outcome(python, resolution, places.split() or ROOMS)
            failed |= "passed" not in result or "failed" in result or "error" in result
            rows.append(f"| {said} | {word} | {versions} | {result} |")
            print(rows[-1], flush=True)
    if not places:
        today = datetime.now(UTC).date().isoformat()
        table = [
            f"{today}, {platform.system()} {platform.machine()}:",
            "",
            "| Python | packages | of them | tests |",
        ]
        made = "\n".join([*table, "|---|---|---|---|", *rows, ""])
        text = PAGE.read_text(encoding="utf-8")
        before, _, rest = text.partition(BEGIN)
        PAGE.write_text(before + BEGIN + made + END + rest.partition(END)[2], encoding="utf-8")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
