"""What is told of instruments, of two of them, and of two results: which rows, in which columns, warned of what."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from scanner_sim.cli import differing, explaining
from scanner_sim.foundation.errors import InputError


def printed(monkeypatch: pytest.MonkeyPatch, module: Any) -> list[Any]:
    """Return where tables come together, each with the columns that stand to the left."""
    found: list[Any] = []
    monkeypatch.setattr(module, "print_rows", lambda rows, left=(0,): found.append((rows, set(left))))
    monkeypatch.setattr(module, "print_table", found.append)
    monkeypatch.setattr(module, "warn", lambda sentence: found.append(f"warned: {sentence}"), raising=False)
    monkeypatch.setattr(module.typer, "echo", lambda text="": found.append(text))
    return found


PRESETS = {
    "one": {
        ("scanner", "rate"): ("2 kHz", "printed", "p. 1"), ("scanner", "laser", "power"): ("5 mW", "chosen", "ours"),
    },
    "two": {("scanner", "rate"): ("2 kHz", "printed", "p. 9"), ("scanner", "tilt"): ("3 deg", "inferred", "p. 2")},
    "same": {("scanner", "rate"): ("2 kHz", "derived", "p. 7")},
}  # fmt: skip
VALUES = {
    "one": {"rate": "2 kHz", "laser": {"power": "5 mW"}, "tilt": "0 deg"},
    "two": {"rate": "2 kHz", "laser": {"power": "7 mW"}, "tilt": "3 deg"},
    "same": {"rate": "2 kHz", "laser": {"power": "5 mW"}, "tilt": "0 deg"},
}  # fmt: skip


def instruments(monkeypatch: pytest.MonkeyPatch) -> None:
    """Put three instruments in the place of the shipped ones."""

    def scanner(name: str) -> Any:
        return SimpleNamespace(name=name, model_dump=lambda mode, by_alias: VALUES[name])

    def preset(name: str) -> Any:
        stated = {
            at: SimpleNamespace(value=value, mark=mark, source=source)
            for at, (value, mark, source) in PRESETS[name].items()
        }
        return SimpleNamespace(about=f"about {name}", stated=stated)

    def properties(one: Any, sheet: Any) -> dict[str, str]:
        assert sheet == ("sheet", one.name)
        return {"beam": f"{VALUES[one.name]['laser']['power']} wide", "rate": "2000 voxels/s"}  # type: ignore[index]

    monkeypatch.setattr(explaining, "load_scanner", scanner)
    monkeypatch.setattr(explaining, "read_preset", preset)
    monkeypatch.setattr(explaining, "instrument_properties", properties)
    where = "scanner_sim.validation.compare.instrument_sheet"
    monkeypatch.setattr(f"{where}.instrument_sheet", lambda one: ("sheet", one.name))
    monkeypatch.setattr(f"{where}.alone", lambda one: f"{one.name} alone")


@pytest.mark.parametrize("drawn", [True, False])
def test_an_instrument_is_printed_with_its_values(monkeypatch: pytest.MonkeyPatch, drawn: bool) -> None:
    """Claim: warned of what is the instrument's, not the scenario's; what follows from its values, then its table, then
    each value by its key with mark and source, all of them words, which stand to the left."""
    found = printed(monkeypatch, explaining)
    instruments(monkeypatch)
    written: list[Any] = []
    monkeypatch.setattr(
        explaining, "scenario_warnings", lambda one: [f"scanner.x: {one}", f"scan.rows: {one}"]
    )
    monkeypatch.setattr(explaining, "_table", lambda sheet: iter([("range",), sheet]))
    monkeypatch.setattr(
        "scanner_sim.products.pictures.instrument.draw_instrument", lambda *given: written.append(given)
    )
    monkeypatch.setattr("scanner_sim.products.files.exchange.write_file", lambda path, write, overwrite: (
        write("p"), written.append(overwrite), path)[2])  # fmt: skip
    explaining.print_instrument("one", Path("o.png") if drawn else None, overwrite=True)
    warned, table, blank, (rows, _), second, (values, left) = found
    assert warned == "warned: scanner.x: one alone"
    picture = {"picture": "o.png"} if drawn else {}
    assert table == {"instrument": "about one", "beam": "5 mW wide", "rate": "2000 voxels/s"} | picture
    assert (blank, second) == ("", "")
    assert rows == [("range",), ("sheet", "one")]
    assert values == [
        ("key", "value", "mark", "source"), ("rate", "2 kHz", "printed", "p. 1"),
        ("laser.power", "5 mW", "chosen", "ours"),
    ]  # fmt: skip
    assert left == {0, 1, 2, 3}
    assert written == ([(("sheet", "one"), "one, the instrument", "p"), True] if drawn else [])


def test_two_instruments_are_told_by_what_is_unlike(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: what follows first, then each value that differs and that either states, with the mark that it has there,
    – where it has none; equal values are left out."""
    found = printed(monkeypatch, explaining)
    instruments(monkeypatch)
    explaining.print_differences("one", "two")
    ((rows, left),) = found
    assert rows == [
        ("", "one", "two"), ("beam", "5 mW wide", "7 mW wide"), ("laser.power", "5 mW (chosen)", "–"),
        ("tilt", "–", "3 deg (inferred)"),
    ]  # fmt: skip
    assert left == {0, 1, 2}
    found.clear()
    explaining.print_differences("one", "same")
    assert found == ["one and same have the same values."]


@pytest.mark.parametrize("quiet", [True, False])
@pytest.mark.parametrize(("same_seed", "output"), [(True, None), (False, Path("o"))])
def test_two_results_are_compared_into_a_folder(
    monkeypatch: pytest.MonkeyPatch, quiet: bool, same_seed: bool, output: Path | None
) -> None:
    """Claim: the second less the first names the folder; results of one seed are warned of, for they share noise; the
    picture and the numbers are of that difference, in that order; told but where it is to be quiet."""
    found = printed(monkeypatch, differing)
    difference: Any = SimpleNamespace(same_seed=same_seed, seeds=(7, 7))
    written: dict[str, Any] = {}
    monkeypatch.setattr(differing, "_scan", lambda place: f"scan of {place}")
    monkeypatch.setattr(differing, "_name", lambda place: f"n{place}")
    monkeypatch.setattr(
        differing, "difference_of", lambda *given: difference if given == ("scan of a", "scan of b") else None
    )
    monkeypatch.setattr(differing, "_changed", lambda results, names: [*results, *names])
    monkeypatch.setattr(differing, "difference_json", lambda of, about: (of, about))
    monkeypatch.setattr(differing, "write_text", lambda path, text: text)
    monkeypatch.setattr("scanner_sim.products.pictures.difference.draw_difference", lambda *given: given)
    monkeypatch.setattr(
        differing, "claim_folder", lambda *given: (written.update(claimed=given), nullcontext())[1]
    )
    monkeypatch.setattr(
        differing,
        "write_folder",
        lambda folder, kind, writers, overwrite: (
            written.update({name: write("p") for name, write in writers.items()}, overwrite=overwrite),
            [folder / "x"],
        )[1],
    )
    monkeypatch.setattr(differing, "_print", lambda *given: found.append(given))  # fmt: skip
    differing.compare_results(Path("a"), Path("b"), output, overwrite=True, quiet=quiet)
    folder, names, keys = (
        output or Path("output/nb_less_na"),
        ("na", "nb"),
        ["scan of a", "scan of b", "na", "nb"],
    )
    assert written["claimed"] == (folder, True, differing.DIFFERENCE)
    assert written[differing.DIFFERENCE.result] == (
        difference,
        {"first": "a", "second": "b", "changed_keys": keys},
    )
    assert written["difference.png"] == (difference, names, "p")
    warned = [one for one in found if isinstance(one, str)]
    assert [one.startswith("warned: both have seed 7") for one in warned] == (
        [True] if same_seed and not quiet else []
    )
    told = [one for one in found if not isinstance(one, str)]
    assert told == ([] if quiet else [(difference, names, keys), {"folder": str(folder), "files": "x"}])


def test_a_result_has_the_name_of_its_folder(tmp_path: Path) -> None:
    folder = tmp_path / "own"
    folder.mkdir()
    (folder / "range.exr").touch()
    assert [differing._name(place) for place in (folder, folder / "range.exr")] == ["own", "own"]


def test_a_track_is_no_scan_to_compare(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(differing, "result_in", lambda _: ("a track", ()))
    with pytest.raises(InputError, match="tracking run"):
        differing._scan(Path("t"))
