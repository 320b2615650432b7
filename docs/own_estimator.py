"""The picture of the guide to own estimators: ``python docs/own_estimator.py`` follows the guide and writes it.

The guide's comparison in full, with the law of the stated σ.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from scanner_sim import compare
from scanner_sim.products.pictures.comparison import draw_comparison

DOCS = Path(__file__).resolve().parent
GUIDE, PICTURE = DOCS / "guides" / "own_estimator.md", DOCS / "pictures" / "own_estimator.png"


def main() -> None:
    text = GUIDE.read_text(encoding="utf-8").partition("## A pulse")[0]
    names: dict[str, Any] = {}
    for block in re.findall(r"^```python[^\n]*\n(.*?)^```", text, re.M | re.S):
        exec(compile(block, str(GUIDE), "exec"), names)
    how = names["how"] | {"only": [*names["laws"], "coverage"], "quick": False}
    found = compare(names["scenario"], closed_forms={"position": names["centroid_of_line"]}, **how)
    draw_comparison(found, PICTURE)
    for finding in found.findings:
        print(finding.name, finding.verdict, *(f"{check.simulated:.4g}" for check in finding.checks))


if __name__ == "__main__":
    main()
