"""Mutations of results that know their form; each is made again from its address ``result/SEED/NUMBER`` alone.

The originals are one small result of each kind, made once by :func:`write_originals`.
"""

from __future__ import annotations

import json
import math
import random
import shutil
import struct
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

REPOSITORY = Path(__file__).resolve().parents[2]
ODD: tuple[Any, ...] = (
    None, True, -1, 0, 1, 2**31, 2**63, 10**30, 1e300, -1e300, math.nan, math.inf, "", "x", "a\nb", "\x1b[2J", "<b>",
    "$\\frac{", [], {}, [[]], {"a": 1}, "é" * 3000,
)  # fmt: skip
COUNTS = (-1, 0, 1, 2, 3, 255, 2**15, 2**24, 2**31 - 1, -(2**31), 2**32 - 1)
KINDS = (
    "exr",
    "exr",
    "exr",
    "lines",
    "waveforms",
    "track",
    "track",
    "patterns",
    "pose",
    "compare",
    "csv",
    "reproduce",
)


def write_originals(folder: Path) -> None:
    """Make an image, waveforms, a tracking run with poses, and small files of the other kinds."""
    from scanner_sim.config import load_scenario
    from scanner_sim.instrument.closed_loop.poses import poses_of
    from scanner_sim.instrument.closed_loop.tracker import Tracker
    from scanner_sim.instrument.simulate import simulate
    from scanner_sim.instrument.simulate_signals import signal_parts
    from scanner_sim.products.files.exr import write_exr
    from scanner_sim.products.files.signal_files import write_signals
    from scanner_sim.products.files.track_folder import write_track
    from scanner_sim.products.settings import Output

    some = "[[0, 0], [3, 3], [7, 5]]"
    small = ["scan.rows=8", "scan.columns=6", f"output.lines={some}", f"output.waveforms={some}"]
    scenario = load_scenario(REPOSITORY / "configs/tof_both.yaml", small)
    image = simulate(scenario, device="cpu")
    for kind in ("zip", "rle", "piz", "none"):
        write_exr(folder / f"{kind}.exr", image, kind)  # type: ignore[arg-type]
    (folder / "kept").mkdir()
    for name, file in (("triangulation", "lines"), ("tof", "waveforms")):
        parts = signal_parts(scenario, name, device="cpu")
        assert parts is not None
        write_signals(folder / "kept" / f"{file}.parquet", parts)
    moving = load_scenario(REPOSITORY / "configs/track_moving.yaml", ["scan.pattern.points=32"])
    tracker = Tracker(moving, device="cpu")
    found = tracker.track(record for record, _ in zip(tracker, range(16), strict=False))
    write_track(found, folder / "run", Output(pictures=False), poses=poses_of(found))
    _write_texts(folder)


def _write_texts(folder: Path) -> None:
    from scanner_sim.products.comparison import Comparison, Finding, comparison_json
    from scanner_sim.signals.line.bias_table import BiasTable, write_bias
    from scanner_sim.validation.compare.judge import judge_checks
    from scanner_sim.validation.compare.law import Measured, Predicted

    cases = [
        ("one", Measured("mean", 1.01, 0.01, 9.0), Predicted("length", "m", 1.0, 0.001)),
        ("two", Measured("spread", 2.0, 0.1, 19.0), Predicted("scatter", "m", 2.1, 0.001)),
        ("three", Measured("exact", 3.0), Predicted("ratio", "", 3.0, 0.001)),
    ]
    finding = Finding("law", "Law", "eq 1", "as stated", "plane", "", tuple(judge_checks(cases, 0.01)))
    comparison = Comparison(1, 2, 0.01, True, "plane", (finding,), {"numpy": "2"})
    (folder / "compare.json").write_text(comparison_json(comparison), encoding="utf-8")
    shifts = np.linspace(-0.5, 0.5, 5)
    write_bias(BiasTable("parabola", np.array([1.0, 2.0]), shifts, np.zeros((2, 5))), folder / "bias.csv")
    (folder / "pulse.csv").write_text("0,0\n1e-9,1\n2e-9,0.5\n3e-9,0\n")
    rows = "".join(f"{t},0,0,{5 + t},1,0,0,0\n" for t in range(4))
    (folder / "motion.csv").write_text(f"time_s,x_m,y_m,z_m,qw,qx,qy,qz\n{rows}")
    row = {"what": "a", "paper": "1", "expected": "1", "found": "1", "verdict": "agrees"}
    made = {
        "key": "fig12",
        "rows": [row],
        "quick": True,
        "seed": 1,
        "date": "2000-01-01",
        "made_by": {"a": "1"},
    }
    (folder / "fig12.json").write_text(json.dumps(made))


def sound_results(originals: Path, folder: Path) -> Iterator[Path]:
    """Yield the originals by the names under which they are opened; images in folders of their own."""
    for image in sorted(originals.glob("*.exr")):
        path = folder / image.stem / "range.exr"
        path.parent.mkdir()
        shutil.copy(image, path)
        yield path
    yield from sorted(path for path in originals.iterdir() if path.suffix != ".exr")


def result_mutant(seed: int, number: int, originals: Path, folder: Path) -> Path:
    """Write a mutant into an empty folder, and return the path that is to be opened."""
    rng = random.Random(f"result/{seed}/{number}")
    return _WRITERS[rng.choice(KINDS)](rng, originals, folder)


def _exr(rng: random.Random, originals: Path, folder: Path) -> Path:
    path = folder / "range.exr"
    content = (originals / f"{rng.choice(('zip', 'zip', 'rle', 'piz', 'none'))}.exr").read_bytes()
    edit = rng.choice((_header_of_exr, _header_of_exr, _values_of_exr, _strange_exr, spoilt))
    if edit is _strange_exr:
        _strange_exr(rng, path)
    elif edit is _values_of_exr:
        path.write_bytes(content)
        _values_of_exr(rng, path)
    else:
        path.write_bytes(edit(rng, content))
    return path


def _header_of_exr(rng: random.Random, content: bytes) -> bytes:
    """Change an attribute's size or value, the version, or the table of blocks."""
    places: list[tuple[int, int]] = []
    at = 8
    while content[at]:
        middle = content.index(0, content.index(0, at) + 1) + 1
        (size,) = struct.unpack("<i", content[middle : middle + 4])
        places.append((middle, size))
        at = middle + 4 + size
    data = bytearray(content)
    where = rng.random()
    if where < 0.1:
        data[4:8] = struct.pack("<I", rng.choice((2, 2 | 0x200, 2 | 0x400, 2 | 0x800, 2 | 0x1000, 3, 2**31)))
    elif where < 0.3:
        block = at + 1 + 8 * rng.randrange(2)
        data[block : block + 8] = struct.pack("<q", rng.choice(COUNTS))
    elif where < 0.5:
        (first,) = struct.unpack("<q", content[at + 1 : at + 9])
        field = first + 4 * rng.randrange(2)
        data[field : field + 4] = struct.pack("<i", rng.choice(COUNTS[:-1]))
    else:
        # The windows, the channels and our own numbers more often than the many sentences.
        short = [place for place in places if place[1] in (1, 4, 8, 16) or place[1] > 1000]
        middle, size = rng.choice(short if rng.random() < 0.8 else places)
        if rng.random() < 0.2 or size < 4:
            data[middle : middle + 4] = struct.pack("<i", rng.choice(COUNTS[:-1]))
        else:
            field = middle + 4 + 4 * rng.randrange(size // 4)
            number = rng.choice((*map(struct.Struct("<i").pack, COUNTS[:-1]), *map(_float, (math.nan, 1e30))))
            data[field : field + 4] = number
    return bytes(data)


def _float(value: float) -> bytes:
    return struct.pack("<f", value)


def _values_of_exr(rng: random.Random, path: Path) -> None:
    """Write an image again with layers missing or full of odd numbers, or with odd attributes."""
    import OpenEXR

    file = OpenEXR.File(str(path), separate_channels=True)
    header, layers = file.header(), {name: part.pixels for name, part in file.channels().items()}
    for _ in range(rng.choice((1, 1, 2, 3))):
        name = rng.choice(sorted(layers))
        if (edit := rng.random()) < 0.2:
            del layers[name]
        elif edit < 0.55:
            where = np.random.default_rng(rng.randrange(2**32)).random(layers[name].shape) < rng.choice(
                (0.1, 1)
            )
            value = rng.choice(
                (math.nan, math.inf, -math.inf, -1.0, 0.0, 3e38, -3e38, 1e-45, 0.5, 9.0, 255.0)
            )
            layers[name][where] = value
        else:
            ours = [key for key in header if key.startswith(("scannerSim", "legend"))]
            key = rng.choice(ours)
            odd = rng.choice(ODD)
            header[key] = rng.choice((json.dumps(odd), str(odd), _bomb(), np.array([1.0, 1e300]), 3, 2.5))
            if rng.random() < 0.2:
                del header[key]
    try:
        OpenEXR.File(header, layers).write(str(path))
    except (RuntimeError, ValueError, TypeError):
        path.write_bytes(path.read_bytes()[:100])


def _strange_exr(rng: random.Random, path: Path) -> None:
    """Write a good file of another form: halves, tiles, several parts, windows that are shifted."""
    import OpenEXR

    kind = rng.choice(("half", "uint", "tiled", "parts", "large"))
    values = np.zeros((16, 16) if kind != "large" else (4000, 4000), np.float32)
    values = values.astype({"half": np.float16, "uint": np.uint32}.get(kind, np.float32))
    header: dict[str, Any] = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    if kind == "tiled":
        header |= {"type": OpenEXR.tiledimage, "tiles": OpenEXR.TileDescription()}
    header["scannerSim.seed"] = "1"
    if kind == "parts":
        parts = [OpenEXR.Part(dict(header), {"Y": values}, name) for name in ("a", "b")]
        OpenEXR.File(parts).write(str(path))
        return
    OpenEXR.File(header, {"status": values, "Y": values}).write(str(path))


def _signals(name: str) -> Callable[[random.Random, Path, Path], Path]:
    """Change bytes of lines or waveforms, or write them again with odd or missing columns, rows or metadata."""

    def write(rng: random.Random, originals: Path, folder: Path) -> Path:
        kept = folder / "kept"
        shutil.copytree(originals / "kept", kept)
        path = kept / f"{name}.parquet"
        if (edit := rng.random()) < 0.4:
            path.write_bytes(spoilt(rng, path.read_bytes()))
        elif edit < 0.5:
            (kept / "scenario.yaml").write_text(rng.choice(("", "schema: 1", "\x00")))
        else:
            _values_of_signals(rng, path)
        return kept

    return write


def _values_of_signals(rng: random.Random, path: Path) -> None:
    import pyarrow
    import pyarrow.parquet

    table = pyarrow.parquet.read_table(path)
    about = json.loads(table.schema.metadata[b"scanner_sim"])
    for _ in range(rng.choice((1, 1, 2))):
        edit, at = rng.random(), rng.randrange(table.num_columns)
        name, column = table.column_names[at], table.column(at).combine_chunks()
        if edit < 0.15:
            table = table.remove_column(at)
        elif edit < 0.3:
            table = table.slice(0, rng.choice((0, 1, 2)))
        elif edit < 0.7:
            values = column.to_pylist()
            odd: Any = rng.choice((math.nan, math.inf, -1.0, 0.0, 1e30, -1e30, 7.0, 2.0**31 - 1))
            row = rng.randrange(max(len(values), 1))
            if values and isinstance(values[row], list):
                values[row][rng.randrange(len(values[row]) or 1) : 1] = [odd] * rng.choice((1, 1, 300))
            elif values:
                values[row] = odd if isinstance(values[row], float) or not math.isfinite(odd) else int(odd)
            try:
                changed = pyarrow.array(values, column.type if rng.random() < 0.7 else None)
            except (pyarrow.ArrowException, TypeError, ValueError, OverflowError):
                continue
            table = table.set_column(at, name, changed)
        else:
            about = _odd_within(rng, about)
    table = table.replace_schema_metadata({b"scanner_sim": json.dumps(about).encode()})
    pyarrow.parquet.write_table(table, path, compression=rng.choice(("zstd", "snappy", "none")))


def _table(name: str) -> Callable[[random.Random, Path, Path], Path]:
    def write(rng: random.Random, originals: Path, folder: Path) -> Path:
        run = folder / "run"
        shutil.copytree(originals / "run", run)
        path = run / name
        if rng.random() < 0.4:
            path.write_bytes(spoilt(rng, path.read_bytes()))
        else:
            _values_of_table(rng, path)
        return run

    return write


def _values_of_table(rng: random.Random, path: Path) -> None:
    """Write a table again with odd columns, metadata or lengths."""
    import pyarrow
    import pyarrow.parquet

    table = pyarrow.parquet.read_table(path)
    about = json.loads(table.schema.metadata[b"scanner_sim"])
    columns = {name: table[name].to_pylist() for name in table.column_names}
    options: dict[str, Any] = {"compression": rng.choice(("zstd", "snappy", "none"))}
    for _ in range(rng.choice((1, 1, 2, 3))):
        name = rng.choice(list(columns))
        edit = rng.random()
        if edit < 0.12:
            del columns[name]
        elif edit < 0.45 and columns[name]:
            sort = type(columns[name][0])
            numbers: tuple[Any, ...] = (
                math.nan,
                math.inf,
                -math.inf,
                0.0,
                -1.0,
                1e300,
                -1e300,
                1e20,
                1e9,
                5e-324,
            )
            odd = rng.choice(
                {
                    float: numbers,
                    int: (-1, 0, 7, 99, 2**31 - 1, -(2**31)),
                    str: ("", "x", "\x1b", "track", "$"),
                }[sort]
            )
            for row in (
                range(len(columns[name])) if rng.random() < 0.3 else [rng.randrange(len(columns[name]))]
            ):
                columns[name][row] = odd
        elif edit < 0.55:
            columns[name] = [rng.choice((None, [1.0], "x", 1, 2.0, True, b"\xff"))] * len(columns[name])
        elif edit < 0.6:
            rows = rng.choice((0, 1, 2))
            columns = {key: values[:rows] for key, values in columns.items()}
        elif edit < 0.65:
            columns = {key: values[:1] * 1_000_000 for key, values in list(columns.items())[:4]}
        else:
            about = _odd_within(rng, about)
    said = json.dumps(about).encode()
    if rng.random() < 0.05:
        said = rng.choice((b"{", b"\xff", b"[" * 100_000, b"9" * 9000))
    try:
        made = pyarrow.table(columns).replace_schema_metadata({b"scanner_sim": said})
        pyarrow.parquet.write_table(made, path, **options)
    except (pyarrow.ArrowException, TypeError, ValueError):
        path.write_bytes(b"PAR1")


def _odd_within(rng: random.Random, data: Any) -> Any:
    """Return plain data with one odd value or one gap somewhere in it."""
    if not isinstance(data, dict | list) or not data or rng.random() < 0.15:
        return rng.choice(ODD)
    key: Any = rng.choice(list(data)) if isinstance(data, dict) else rng.randrange(len(data))
    if rng.random() < 0.15:
        del data[key]
    else:
        data[key] = _odd_within(rng, data[key])
    return data


def _json(name: str) -> Callable[[random.Random, Path, Path], Path]:
    def write(rng: random.Random, originals: Path, folder: Path) -> Path:
        path = folder / name
        content = (originals / name).read_bytes()
        if rng.random() < 0.75:
            data = json.loads(content)
            for _ in range(rng.choice((1, 1, 2, 3))):
                data = _odd_within(rng, data)
            content = json.dumps(data).encode()
        else:
            content = rng.choice((spoilt(rng, content), b"[" * 200_000, b'{"a":' * 100_000, b"9" * 10_000))
        path.write_bytes(content)
        return path

    return write


def _csv(rng: random.Random, originals: Path, folder: Path) -> Path:
    name = rng.choice(("bias.csv", "pulse.csv", "motion.csv"))
    lines = (originals / name).read_text().splitlines()
    row = rng.randrange(len(lines))
    odd = (
        "nan",
        "inf",
        "1e400",
        "-1",
        "",
        "x",
        '"',
        "1e300",
        "0",
        "1" * 5000,
        "\x00",
        "٣",
        "é",
        "1_0",
        "0x1",
    )
    words = lines[row].split(",")
    words[rng.randrange(len(words))] = rng.choice(odd)
    lines[row] = ",".join(words)
    content = "\n".join(lines * rng.choice((1, 1, 1, 30_000))).encode()
    (folder / name).write_bytes(spoilt(rng, content) if rng.random() < 0.3 else content)
    return folder / name


def spoilt(rng: random.Random, content: bytes) -> bytes:
    """Return bytes that are cut, flipped, swapped, repeated or overwritten."""
    data = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 5, 20))):
        if not data:
            break
        at = rng.randrange(len(data))
        match rng.randrange(6):
            case 0:
                del data[at:]
            case 1 | 2:
                data[at] ^= 1 << rng.randrange(8)
            case 3:
                data[at : at + 4] = data[at : at + 4][::-1]
            case 4:
                data[at:at] = data[at : at + rng.choice((1, 8, 300))]
            case _:
                data[at : at + 4] = struct.pack("<I", rng.choice(COUNTS) % 2**32)
    return bytes(data)


def _bomb() -> str:
    """Return a YAML text whose aliases stand for a billion values."""
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 10)]
    return "\n".join(["schema: 1", *lines, "scanner: *a9"])


_WRITERS: dict[str, Callable[[random.Random, Path, Path], Path]] = {
    "exr": _exr,
    "lines": _signals("lines"),
    "waveforms": _signals("waveforms"),
    "track": _table("track.parquet"),
    "patterns": _table("patterns.parquet"),
    "pose": _table("pose.parquet"),
    "compare": _json("compare.json"),
    "csv": _csv,
    "reproduce": _json("fig12.json"),
}

if __name__ == "__main__":
    write_originals(Path(sys.argv[1]))
