"""Ctrl-C and termination in the middle of a kernel: one sentence, its status, and nothing half-written, in every verb.

The signal comes from within a loop that the renderer is recording, where what Python raises comes out as an error of
the renderer. No clock is involved: the loop itself sends it.
"""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

# The first loop, or else the first evaluation, after the verb has begun sends the signal.
INTERRUPTED = """
import os, sys
import scanner_sim.cli as cli
from scanner_sim.render.device import activate
activate("cpu")
import drjit as dr
number, where = int(sys.argv.pop(1)), sys.argv.pop(1)
loop, evaluate = dr.while_loop, dr.eval
def sent(*_):
    os.kill(os.getpid(), number)
def while_loop(state, cond, body, *rest, **options):
    def interrupted(*values):
        sent()
        return body(*values)
    return loop(state, cond, interrupted, *rest, **options)
def evaluated(*values):
    sent()
    return evaluate(*values)
if where == "loop":
    dr.while_loop = while_loop
else:
    dr.eval = evaluated
cli.main()
"""

TRACK = ROOT / "configs" / "track_still.yaml"
VERBS = {
    "run": ["run", "{small}", "-o", "{out}"],
    "track": ["run", str(TRACK), "-o", "{out}"],
    "budget": ["budget", "{small}", "-o", "{out}", "--distances", "2"],
    "calibrate": ["calibrate", "{small}", "-o", "{out}.csv"],
    "compare": ["compare", "{small}", "-o", "{out}", "--quick"],
    "pose-study": ["pose-study", str(ROOT / "configs" / "target_board.yaml"), "-o", "{out}", "--quick"],
    "orbit": ["orbit", str(ROOT / "configs" / "lighting_orbit.yaml"), "-o", "{out}", "--steps", "1"],
    "reproduce": ["reproduce", "-o", "{out}", "--quick", "--only", "fig12"],
}
NO_LOOP = {"orbit", "calibrate"}
"""Verbs whose kernels have none; the others are asked within a loop, which is the harder place, and one at both."""


def ended(arguments: list[str], where: str, number: int, small: Path) -> subprocess.CompletedProcess[str]:
    out = small.parent.parent / "out"
    filled = [word.format(small=small, out=out) for word in arguments]
    command = [sys.executable, "-c", INTERRUPTED, str(int(number)), where, *filled]
    return subprocess.run(command, capture_output=True, text=True, encoding="utf-8", cwd=ROOT, timeout=300)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("verb", "where"),
    [("run", "eval"), *((verb, "eval" if verb in NO_LOOP else "loop") for verb in VERBS)],
)
def test_an_interrupt_within_a_kernel_ends_a_verb_in_one_sentence(
    verb: str, where: str, small: Path, tmp_path: Path
) -> None:
    done = ended(VERBS[verb], where, signal.SIGINT, small)
    assert done.returncode == 130, done.stderr
    told = [line for line in done.stderr.splitlines() if not line.startswith("warning:")]
    assert told == ["stopped: interrupted; nothing is half-written.", "The same command starts again."]
    assert [path.name for path in tmp_path.iterdir()] == ["scenarios"]


@pytest.mark.slow
def test_termination_is_told_too(small: Path, tmp_path: Path) -> None:
    done = ended(VERBS["budget"], "loop", signal.SIGTERM, small)
    assert done.returncode == 143, done.stderr
    assert "stopped: terminated; nothing is half-written." in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["scenarios"]
