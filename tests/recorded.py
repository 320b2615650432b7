"""What runs give, in few numbers: recorded, and compared with what they give now.

    recorded.py                make all runs and write what they give into regression/recorded
    recorded.py track budget   those whose names hold one of these

It says what a change moves, and not what is right: that is for the judge. Who means to move numbers records them anew,
reads the difference, and tells users in the changelog. Of a column or a layer its number of values, mean, spread and
slopes along its axes are kept, of texts the words and the numbers in them.
"""

from __future__ import annotations

import csv
import json
import math
import re
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import ArrayLike, NDArray

from scanner_sim.config.preset import shipped_presets
from scanner_sim.signals.processing import MARGIN
from scanner_sim.signals.waveform.settings import TIMINGS

REPOSITORY = Path(__file__).resolve().parents[1]
RECORDS = REPOSITORY / "tests" / "regression" / "recorded"
SMALL = ("scan.rows=40", "scan.columns=40")
FEW = ("scan.rows=24", "scan.columns=24")
SHORT = ("scan.duration=120 ms",)
_CLOSE = 1e-3
"""Part of a column's spread or of its number of values by which it may differ: other processors make less."""
_ONE_CLOSE, _NOTHING = 0.1, 5e-7
"""The same of a number that stands alone, and what is none: of what one seed gives and of differences."""
_NUMBER = re.compile(r"(?<![\w.])[-+−]?\d+(?:\.\d+)?(?:e[-+]?\d+)?", re.IGNORECASE)
_UNTOLD = re.compile(
    r"made_by|^made on|version|commit|created|^date$|seconds|threads|digest|sha256|llvm|effect", re.IGNORECASE
)
"""Names of what another machine, day or release changes, and of departures that should be none."""
_MANY = 200
"""Values of a column from which on it is told so closely."""
_DIGEST = re.compile(r"[0-9a-f]{32,}")
_EXACT = 50
"""Largest whole number that stays as it is; of larger ones a few voxels may be others."""
_FEW = 6
"""Longest list of numbers that are kept one by one."""
_FEW_TEXTS = 12
"""Most texts of a column that are kept one by one, or counted."""


def _run(config: str, *sets: str) -> list[list[str]]:
    return [["run", f"configs/{config}.yaml", "-o", "OUT", *_set(*sets, "output.pictures=false")]]


def _shipped(path: Path) -> list[list[str]]:
    """Return the command for a shipped scenario: images small, tracks short."""
    kind = yaml.safe_load(path.read_text(encoding="utf-8"))["scan"]["type"]
    changes = {"raster": (*SMALL, "output.truth=[normal, incidence]"), "track": SHORT}
    return _run(path.stem, *changes.get(kind, ()))


def _set(*sets: str) -> list[str]:
    return [word for one in sets for word in ("--set", one)]


AS_BUILT = (
    "scanner.as_built={base: 0.2 mm, focal_length: 0.1 mm, axis_offset: 0.1 mm, axis_skew: 0.2 mrad, "
    "phi_scale: 200 ppm, theta_zero: 0.1 mrad, theta_cubic: 1e-3 rad^-2, array_offset: 5 um, "
    "array_scale: 100 ppm, array_tilt: 0.2 deg, radial_1: 0.01, tof_zero: 3 mm, power_noise: 0.5 %, "
    "pulse_noise: 0.5 %, stray_light: 0.1 %, "
    "vibration: {turn: [[5 Hz, 1e-10 rad^2/Hz], [500 Hz, 1e-14 rad^2/Hz]]}}"
)
DRIFT = "scanner.mirrors.temperature={rate: 5 K/h}"
SUN = "lighting.sun={direction: [-0.4, -0.3, -0.87]}"
PEAKS = sorted(set(MARGIN) - {"maximum_likelihood"})
"""Estimators that no other run asks for; so are the timings."""
KEPT = ("output.lines=all", "output.waveforms=all", *FEW)
RUNS: dict[str, list[list[str]]] = {
    **{path.stem: _shipped(path) for path in sorted((REPOSITORY / "configs").glob("*.yaml"))},
    **{f"peak_{name}": _run("quickstart", *SMALL, f"processing.peak={name}") for name in PEAKS},
    **{f"timing_{name}": _run("tof_both", *SMALL, f"processing.pulse.timing={name}") for name in TIMINGS[1:]},
    "as_built": _run("tof_both", *SMALL, AS_BUILT, DRIFT),
    "stepped": _run("node_near", *SMALL, "scan.motion=stepped", "transport.bounces=2", SUN),
    "lit_rows_close": _run("lighting_normal", *SMALL, "scan.vertical=[-1.5 deg, 1.5 deg]"),
    "track_lit": _run("track_still", *SHORT, SUN, "scanner.laser_off=0.4", DRIFT),
    "track_tof": _run("track_still", *SHORT, "ranging=tof"),
    "reprocess": [
        ["run", "configs/tof_both.yaml", "-o", "OUT", *_set(*KEPT, "output.pictures=false")],
        ["reprocess", "OUT", "--seed", "5", "-o", "OUT2", *_set("processing.peak=parabola")],
        ["difference", "OUT", "OUT2", "-o", "OUT3"],
    ],
    "convert": [
        ["run", "configs/tof_both.yaml", "-o", "OUT", *_set(*FEW, "output.pictures=false")],
        ["convert", "OUT", "--to", "las", "--to", "pcd_ascii", "-o", "OUT2"],
    ],
    "show": [
        ["run", "configs/tof_both.yaml", "-o", "OUT", *_set(*KEPT)],
        ["show", "OUT", "--voxel", "12", "12", "-o", "OUT2"],
    ],
    "show_pattern": [
        ["run", "configs/track_still.yaml", "-o", "OUT", *_set(*SHORT)],
        ["show", "OUT", "--pattern", "5", "-o", "OUT2"],
    ],
    "scene": [["scene", "configs/node_near.yaml", "-o", "OUT.png"]],
    "check": [["check", "configs/track_moving.yaml"]],
    "budget": [["budget", "configs/plane.yaml", "--image", "-o", "OUT"]],
    "budget_tof": [["budget", "configs/tof_both.yaml", "-o", "OUT"]],
    "calibrate": [
        ["calibrate", "configs/quickstart.yaml", "-o", "OUT.csv", "--set", "processing.peak=parabola"]
    ],
    "selfcal": [["selfcal", "configs/calibration/two_boards.yaml", "-o", "OUT.yaml"]],
    "acceptance": [["acceptance", "configs/acceptance/prototype.yaml", "-o", "OUT"]],
    "orbit": [["orbit", "configs/lighting_orbit.yaml", "-o", "OUT", "--steps", "18"]],
    "campaign": [["campaign", "configs/campaigns/power.yaml", "-o", "OUT", "--workers", "0"]],
    "pose_study": [["pose-study", "configs/target_board.yaml", "--quick", "-o", "OUT"]],
    "compare": [["compare", "configs/plane.yaml", "--quick", "-o", "OUT"]],
    "reproduce": [["reproduce", "--quick", "-o", "OUT"]],
    "family": [["reproduce", "--family", "--quick", "-o", "OUT"]],
    **{f"instrument_{name}": [["instruments", name]] for name in shipped_presets()},
}
"""Commands, one after the other, by the name of their record; OUT is a result, a folder or with an ending a file."""


def column(values: ArrayLike) -> list[float]:
    """Return number of values, mean, spread, and slopes along the axes over both halves of each."""
    given: NDArray[np.float64] = np.asarray(values, dtype=np.float64)
    known = np.isfinite(given)
    if not known.any():
        return [0]
    mean = float(given[known].mean())
    apart = np.where(known, given - mean, 0.0)
    slopes = []
    for axis, length in enumerate(given.shape):
        place = np.linspace(-1.0, 1.0, length) if length > 1 else np.zeros(1)
        along = np.moveaxis(apart, axis, -1) * place
        slopes.append(float(along.sum() / known.sum()))
    return [int(known.sum()), mean, float(given[known].std()), *slopes]


def digest(folder: Path) -> dict[str, Any]:
    """Return what the files of a folder hold, pictures left out: by file and by what they call it."""
    found = {}
    for path in sorted(folder.rglob("*")):
        read = _READERS.get(path.suffix)
        if read and path.name != "scenario.yaml":
            found[path.relative_to(folder).as_posix().replace("OUT", "result")] = read(path)
    return found


def _columns(path: Path) -> dict[str, Any]:
    with path.open(encoding="utf-8", newline="") as file:
        lines = [line for line in file if not line.startswith("#")]
    rows = list(csv.DictReader(lines))
    return {name: _values([row[name] for row in rows]) for name in (rows[0] if rows else ())}


def _parquet(path: Path) -> dict[str, Any]:
    from pyarrow import parquet

    table = parquet.read_table(path)
    return {name: _values(table[name].to_pylist()) for name in table.column_names if not _UNTOLD.search(name)}


def _values(values: list[Any]) -> Any:
    """Return a column of numbers, texts that hold numbers, or how often each other text stands in it."""
    try:
        return column([math.nan if one in (None, "") else one for one in values])
    except (TypeError, ValueError):
        texts = [str(one) for one in values]
    if len(texts) <= _FEW_TEXTS or (len(texts) <= _MANY and any(map(_NUMBER.search, texts))):
        return texts
    kinds = [_NUMBER.sub("#", text) for text in texts]
    return (
        {kind: kinds.count(kind) for kind in sorted(set(kinds))}
        if len(set(kinds)) <= _FEW_TEXTS
        else [len(kinds)]
    )


def _layers(path: Path) -> dict[str, Any]:
    from scanner_sim.products.files.exr import read_range_image

    image = read_range_image(path)
    layers = {name: column(np.asarray(image[name], dtype=np.float64)) for name in image.channels}
    table = image.to_xarray()
    return layers | {
        f"coordinate {name}": column(values) for name, values in table.coords.items() if values.ndim
    }


def _cloud(path: Path) -> dict[str, Any]:
    import laspy

    cloud = laspy.read(path)
    return {name: column(cloud[name]) for name in ("x", "y", "z", *cloud.point_format.dimension_names)}


def _points(path: Path) -> dict[str, Any]:
    head, _, body = path.read_text(encoding="ascii").partition("DATA ascii\n")
    names = next(line.split()[1:] for line in head.splitlines() if line.startswith("FIELDS "))
    return dict(zip(names, map(column, np.loadtxt(body.splitlines(), ndmin=2).T), strict=True))


def _leaves(path: Path) -> dict[str, Any]:
    return dict(_flat(json.loads(path.read_text(encoding="utf-8")), ""))


def _flat(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict):
        for key, one in value.items():
            if not (_UNTOLD.search(str(key)) or (isinstance(one, str) and _DIGEST.fullmatch(one))):
                yield from _flat(one, f"{name}.{_placeless(str(key))}".lstrip("."))
    elif isinstance(value, list) and len(value) > _FEW and all(isinstance(one, dict) for one in value):
        for key in dict.fromkeys(key for one in value for key in one if not _UNTOLD.search(key)):
            entries = [one.get(key) for one in value]
            if any(isinstance(entry, (dict, list)) for entry in entries):
                yield from _flat(dict(enumerate(entries)), f"{name}.{key}")
            else:
                yield f"{name}.{key}", _values(entries)
    elif isinstance(value, list) and (len(value) <= _FEW or not all(map(_is_number, value))):
        for number, one in enumerate(value):
            yield from _flat(one, f"{name}[{number}]")
    elif isinstance(value, list):
        yield name, column(value)
    else:
        yield name, _placeless(value) if isinstance(value, str) else value


def _placeless(text: str) -> str:
    """Return a text without the folders of this clone and of what is written."""
    return re.sub(rf"{re.escape(str(REPOSITORY))}/?|{re.escape(tempfile.gettempdir())}/[^/]*/?", "", text)


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float))


def _text(path: Path) -> dict[str, Any]:
    return words(path.read_text(encoding="utf-8"))


def words(text: str) -> dict[str, Any]:
    """Return the lines of a text, numbers and all, without those that tell of the machine."""
    lines = [" ".join(line.split()) for line in text.splitlines()]
    return {"lines": [line for line in lines if line and not _UNTOLD.search(line)]}


_READERS = {
    ".csv": _columns, ".exr": _layers, ".json": _leaves, ".las": _cloud, ".md": _text, ".parquet": _parquet,
    ".pcd": _points, ".txt": _text,
}  # fmt: skip


def made(name: str) -> dict[str, Any]:
    """Make a run of :data:`RUNS`; return what it says and what its files hold."""
    from typer.testing import CliRunner

    from scanner_sim.cli import app

    with tempfile.TemporaryDirectory() as folder:

        def placed(word: str) -> str:
            if word.startswith("OUT"):
                return str(Path(folder) / word)
            return str(REPOSITORY / word) if word.startswith("configs/") else word

        said = []
        for command in RUNS[name]:
            result = CliRunner().invoke(app, [placed(word) for word in command])
            if result.exit_code:
                raise RuntimeError(f"{name}: {result.output}") from result.exception
            said.append(_placeless(result.stdout))
        return {"said": words("\n".join(said)), **digest(Path(folder))}


def differences(recorded: Any, found: Any, name: str = "") -> Iterator[str]:
    """Yield what differs by more than another processor makes: names, what was and what is."""
    if isinstance(recorded, dict) and isinstance(found, dict):
        for key in sorted({*recorded, *found}):
            if key not in found or key not in recorded:
                yield f"{name}/{key}: {'new' if key in found else 'gone'}"
            else:
                yield from differences(recorded[key], found[key], f"{name}/{key}")
    elif _numbers(recorded) and _numbers(found):
        if not _alike(recorded, found):
            yield f"{name}: {recorded} was recorded, {found} it is"
    elif isinstance(recorded, list) and isinstance(found, list) and len(recorded) == len(found):
        for number, (was, now) in enumerate(zip(recorded, found, strict=True)):
            yield from differences(was, now, f"{name}[{number}]")
    elif isinstance(recorded, str) and isinstance(found, str):
        if not _reads_alike(recorded, found):
            yield f"{name}: {recorded!r} was recorded, {found!r} it is"
    elif not _one_alike(recorded, found):
        yield f"{name}: {recorded!r} was recorded, {found!r} it is"


def _numbers(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(map(_is_number, value))


def _alike(recorded: list[float], found: list[float]) -> bool:
    """Tell whether two columns agree; some values more or less move their mean as well."""
    if len(recorded) != len(found):
        return False
    (count, *was), (other, *now) = recorded, found
    if abs(count - other) > max(2.0, _CLOSE * count):
        return False
    spread = max(was[1], now[1]) if was else 0.0
    mean = max(abs(was[0]), abs(now[0])) if was else 0.0
    # One of few values that is another has its share in the mean.
    close = _CLOSE * max(1.0, _MANY / max(count, 1)) + 4.0 * abs(count - other) / max(count, 1)
    allowed = close * spread + 1e-5 * mean + 1e-12
    return all(abs(one - two) <= allowed for one, two in zip(was, now, strict=True))


def _one_alike(recorded: Any, found: Any) -> bool:
    if not (_is_number(recorded) and _is_number(found)) or recorded is found:
        return bool(recorded == found)
    if isinstance(recorded, bool) or isinstance(found, bool):
        return False
    if math.isnan(recorded) or math.isnan(found):
        return math.isnan(recorded) and math.isnan(found)
    if isinstance(recorded, int) and isinstance(found, int):
        return abs(recorded - found) <= max(2.0 if abs(recorded) > _EXACT else 0.0, _CLOSE * abs(recorded))
    return math.isclose(recorded, found, rel_tol=_ONE_CLOSE, abs_tol=_NOTHING)


def _reads_alike(recorded: str, found: str) -> bool:
    """Tell whether two texts have the same words, and numbers that agree within their last digits."""
    if _NUMBER.sub("#", recorded) != _NUMBER.sub("#", found):
        return False
    pairs = zip(_NUMBER.findall(recorded), _NUMBER.findall(found), strict=True)
    return all(_printed_alike(one, two) for one, two in pairs)


def _printed_alike(recorded: str, found: str) -> bool:
    was, now = (float(text.replace("−", "-")) for text in (recorded, found))
    digits = re.sub(r"e.*", "", recorded, flags=re.IGNORECASE).partition(".")[2]
    power = float(recorded.lower().partition("e")[2] or 0.0)
    if "." not in recorded and abs(was) <= _EXACT:
        return was == now
    last = 3.0 * 10.0 ** (power - len(digits))
    return abs(was - now) <= max(last, _ONE_CLOSE * abs(was))


def rounded(value: Any) -> Any:
    """Return what a record holds, numbers with seven digits."""
    if isinstance(value, dict):
        return {key: rounded(one) for key, one in value.items()}
    if isinstance(value, list):
        return [rounded(one) for one in value]
    return float(f"{value:.7g}") if isinstance(value, float) else value


def record(name: str) -> None:
    """Make a run and write down what it gives: a line for each column, so that differences read well."""
    RECORDS.mkdir(exist_ok=True)
    lines = []
    for file, entries in sorted(rounded(made(name)).items()):
        inner = [
            f"  {json.dumps(key)}: {json.dumps(value, ensure_ascii=False)}" for key, value in entries.items()
        ]
        lines.append(f" {json.dumps(file)}: {{\n" + ",\n".join(inner) + "\n }")
    (RECORDS / f"{name}.json").write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


def main() -> None:
    """Record the runs whose names hold one of the arguments, all without."""
    chosen = [name for name in RUNS if not sys.argv[1:] or any(part in name for part in sys.argv[1:])]
    for name in chosen:
        sys.stdout.write(f"{name}\n")
        sys.stdout.flush()
        record(name)


if __name__ == "__main__":
    main()
