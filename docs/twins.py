"""Shipped scenarios in Python: ``python docs/twins.py`` writes two of them into ``configs/python``, for reading.

``python docs/twins.py NAME`` prints that of any other. They are ordinary programs that a reader may copy;
``tests/system/test_twins.py`` makes all of them and holds them equal to the YAML.
"""

from __future__ import annotations

import pprint
import re
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import yaml

CONFIGS = Path(__file__).resolve().parents[1] / "configs"
TWINS = CONFIGS / "python"
SHIPPED = ("quickstart", "track_still")
FILES = ("file", "mesh")
"""Keys whose values are paths that count from the scenario's folder."""

TEMPLATE = '''\
"""{about}

The same in YAML: ``configs/{name}.yaml``.
"""

{imports}

scenario = load_scenario(
{scenario}
)

if __name__ == "__main__":
    {run}
'''
RASTER = "print(simulate(scenario))"
SHOTS = "print(simulate_shots(scenario))"
TRACK = """\
for record in track(scenario).records:
        print(f"{record.time:.4f} s {record.target} {record.mode.name} {record.position}")"""


class Code(str):
    """A piece of program among data."""

    __slots__ = ()

    def __repr__(self) -> str:
        return str(self)


def main() -> None:
    if len(sys.argv) > 1:
        print(twin(CONFIGS / f"{sys.argv[1]}.yaml"))
        return
    for name in SHIPPED:
        (TWINS / f"{name}.py").write_text(twin(CONFIGS / f"{name}.yaml"), encoding="utf-8")


def twin(path: Path) -> str:
    """Return the program that makes the scenario of a file, as the formatter leaves it."""
    text = path.read_text(encoding="utf-8")
    content = yaml.safe_load(text)
    kind = content["scan"].get("type", "raster")
    function, run = {"raster": ("simulate", RASTER), "track": ("track", TRACK)}.get(
        kind, ("simulate_shots", SHOTS)
    )
    placed = with_paths(content)
    imports = f"from scanner_sim import load_scenario, {function}\n"
    if "CONFIGS" in repr(placed):
        imports = f"from pathlib import Path\n\n{imports}\nCONFIGS = Path(__file__).resolve().parents[1]\n"
    source = TEMPLATE.format(
        about=about(text),
        name=path.stem,
        imports=imports.rstrip(),
        scenario=pprint.pformat(placed, width=96, sort_dicts=False),
        run=run,
    )
    command = [
        sys.executable,
        "-m",
        "ruff",
        "format",
        "--quiet",
        "--stdin-filename",
        str(TWINS / f"{path.stem}.py"),
        "-",
    ]
    return subprocess.run(command, input=source, capture_output=True, text=True, check=True).stdout


def with_paths(node: Any) -> Any:
    """Return the content of a scenario with the paths of its files as expressions."""
    if isinstance(node, list):
        return [with_paths(item) for item in node]
    if not isinstance(node, dict):
        return node
    return {
        key: Code(f'CONFIGS / "{value}"') if key in FILES and isinstance(value, str) else with_paths(value)
        for key, value in node.items()
    }


def about(text: str) -> str:
    """Return what the file's first comment says, without the remarks on how to run the YAML."""
    lines = re.findall(r"^#(.*)$", text.partition("\nschema:")[0], flags=re.MULTILINE)
    kept = [line.strip() for line in lines if "yaml-language-server" not in line]
    paragraphs = "\n".join(kept).strip().replace("\\", "").split("\n\n")
    return "\n\n".join(textwrap.fill(paragraph, 106) for paragraph in paragraphs)


if __name__ == "__main__":
    main()
