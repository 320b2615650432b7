"""The simulator as a guest in another program: what it changes of it, it gives back."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]

HOST = """
import faulthandler, gc, locale, os, signal, sys, warnings
import drjit as dr, matplotlib, mitsuba as mi, numpy as np
mi.set_variant("llvm_ad_rgb")
foreign = mi.Float([1.0, 2.0, 3.0])
pending = foreign * 2.0 + mi.UInt32([1, 2, 3])
mi.set_variant("scalar_rgb")
mi.set_log_level(mi.LogLevel.Info)
dr.set_thread_count(1)
dr.set_backend("llvm")
np.seterr(divide="print", under="ignore")
warnings.filterwarnings("always", "a filter of the host")
matplotlib.rcParams["lines.linewidth"] = 3.25
signal.signal(signal.SIGUSR1, lambda *_: None)
os.environ.pop("DRJIT_LIBLLVM_PATH", None)
scene = mi.load_dict({"type": "scene", "ball": {"type": "sphere"}})

def state():
    import drjit.auto
    return {
        "variant": mi.variant(), "level": mi.log_level(), "threads": dr.thread_count(),
        "backend": dr.backend_v(drjit.auto.Float), "environment": dict(os.environ), "errors": np.geterr(),
        "filters": [f for f in warnings.filters if f[1] and "host" in f[1].pattern],
        "style": dict(matplotlib.rcParams), "display": matplotlib.get_backend(),
        "signals": {n: signal.getsignal(n) for n in signal.valid_signals()}, "locale": locale.setlocale(locale.LC_ALL),
        "random": np.random.get_state()[1].tolist(), "folder": os.getcwd(), "precision": np.get_printoptions(),
        "path": [str(p) for p in mi.file_resolver()], "recursion": sys.getrecursionlimit(), "types": mi.Float,
        "flags": {str(flag): dr.flag(flag) for flag in dr.JitFlag},
    }

def compare(before, what):
    after = state()
    changed = {key: (before[key], after[key]) for key in before if before[key] != after[key]}
    assert not changed, (what, changed)

before = state()
from scanner_sim import Instrument, Tracker, load_scenario, simulate
scenario = load_scenario(sys.argv[1])
first = simulate(scenario, device="cpu", threads=2)
compare(before, "simulate")
second = simulate(scenario, device="cpu")
assert first["range_m"].tobytes() == second["range_m"].tobytes()
from scanner_sim.products.files.run_folder import write_run
write_run(first, sys.argv[3])
compare(before, "write_run")
tracker = Tracker(load_scenario(sys.argv[2]), device="cpu", threads=2)
compare(before, "Tracker")
records = [next(tracker) for _ in range(3)]
compare(before, "visits")
instrument = Instrument(scenario, device="cpu", threads=2)
compare(before, "Instrument")
instrument.measure(instrument.aim(np.linspace(-0.1, 0.1, 5), 0.0))
compare(before, "measure")
try:
    simulate(scenario, device="tpu")
except Exception:
    pass
compare(before, "a fault")
assert dr.allclose(pending, [3.0, 6.0, 9.0]) and dr.allclose(foreign, [1.0, 2.0, 3.0])
assert scene.ray_intersect(mi.Ray3f([0, 0, -5], [0, 0, 1])).is_valid()
# The same numbers as in a process that has no other life.
import json
print(json.dumps([record.position.tolist() for record in records]))
"""

ALONE = """
import json, sys
from scanner_sim import Tracker, load_scenario
tracker = Tracker(load_scenario(sys.argv[1]), device="cpu")
print(json.dumps([next(tracker).position.tolist() for _ in range(3)]))
"""


@pytest.mark.slow
def test_a_host_finds_everything_as_it_was(small: Path, tmp_path: Path, python: Any) -> None:
    """Claim: variant, log level, threads, back end, environment, error states, warnings, styles, signals, locale,
    random numbers and search paths of a host are the same after each public function, its arrays and scenes stay valid,
    and it gets the numbers that a process of our own gets."""
    config = ROOT / "configs" / "track_still.yaml"
    done = python(HOST, small, config, tmp_path / "out")
    assert done.returncode == 0, done.stderr
    alone = python(ALONE, config)
    assert done.stdout.splitlines()[-1] == alone.stdout.strip(), alone.stderr
