"""What CCSDS files may hold, up to the last number that is possible, and segments that follow one another."""

from __future__ import annotations

import datetime
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scanner_sim.foundation.errors import InputError
from scanner_sim.scene import ccsds
from scanner_sim.scene.ccsds import parse_epoch, read_attitude, read_orbit
from scanner_sim.scene.ephemeris import _interpolation, _same_signs


@pytest.mark.parametrize(
    ("text", "day", "second"),
    [
        ("1972-01-01T00:00:00", (1972, 1, 1), 0.0),
        ("2024-02-29T23:59:60.75Z", (2024, 2, 29), 86400.75),
        ("2024-366T07:08:09.5", (2024, 12, 31), 25689.5),
        ("2023-001T00:59:00", (2023, 1, 1), 3540.0),
    ],
)
def test_an_epoch_is_its_day_and_second(text: str, day: tuple[int, int, int], second: float) -> None:
    found = parse_epoch(text, "TAI")
    assert found.since(parse_epoch(f"{datetime.date(*day).isoformat()}T00:00:00", "TAI")) == pytest.approx(
        second
    )


@pytest.mark.parametrize(
    "text",
    ["2024-02-30T00:00:00", "2024-000T00:00:00", "2024-367T00:00:00", "2023-366T00:00:00", "2024-01-01T24:00:00",
     "2024-01-01T00:60:00", "2024-01-01T00:00:61", "2024-13-01T00:00:00", f"{ccsds.FIRST_YEAR - 1}-01-01T00:00:00",
     f"{ccsds.LAST_YEAR + 1}-01-01T00:00:00", "2024-01-01", "yesterday"],
)  # fmt: skip
def test_what_is_no_epoch_is_refused(text: str) -> None:
    parse_epoch(f"{ccsds.FIRST_YEAR}-01-01T00:00:00", "TAI")
    parse_epoch(f"{ccsds.LAST_YEAR}-12-31T23:59:60.9", "TAI")
    with pytest.raises(ValueError, match=r"epoch|day|month|range"):
        parse_epoch(text, "TAI")


META = "META_START\nREF_FRAME = {frame}\nCENTER_NAME = {centre}\nTIME_SYSTEM = TAI\n{more}META_STOP\n"
NAMES = "OBJECT_NAME = A\nOBJECT_ID = A\nSTART_TIME = x\nSTOP_TIME = x\n"


def segment(first: float, rows: int = 2, frame: str = "EME2000", centre: str = "EARTH", **more: Any) -> str:
    """Return a segment of epochs three seconds apart, with metadata, a covariance between, and remarks."""
    data = [
        f"2026-03-20T12:00:{first + 3 * n:011.8f} "
        + " ".join(str(more.get("x", 7000.0 + n + k)) for k in range(6))
        for n in range(rows)
    ]
    data.insert(1, "COMMENT 1 2 3\n\nCOVARIANCE_START\n1.0 2.0\nnothing\nCOVARIANCE_STOP")
    return META.format(frame=frame, centre=centre, more=NAMES) + "\n".join(data) + "\n"


def orbit(folder: Path, *parts: str) -> Any:
    path = folder / "a.oem"
    path.write_text("CCSDS_OEM_VERS = 2.0\n" + "".join(parts))
    return read_orbit(path)


def test_segments_follow_one_another(tmp_path: Path) -> None:
    """Claim: times count from the first epoch, kilometres become metres, and the next segment begins where one ends."""
    found = orbit(tmp_path, segment(1.5), segment(4.5, 3), segment(10.5))
    assert [one.time.tolist() for one in found.segments] == [
        pytest.approx(times) for times in ([0.0, 3.0], [3.0, 6.0, 9.0], [9.0, 12.0])
    ]
    np.testing.assert_allclose(found.segments[1].rows[2], 1e3 * np.array([7002.0 + k for k in range(6)]))
    assert (found.time_system, found.segments[0].meta["CENTER_NAME"]) == ("TAI", "EARTH")


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ((segment(1.5), segment(4.500002)), "segment 2 .* does not begin"),
        ((segment(1.5), segment(4.4)), "segment 2 .* does not begin"),
        ((segment(1.5), segment(4.5, frame="TEME")), "another REF_FRAME"),
        ((segment(1.5), segment(4.5, centre="MARS")), "another CENTER_NAME"),
        ((segment(1.5, 1),), "segment 1 .* fewer than two"),
        ((segment(1.5), segment(4.5, 1)), "segment 2 .* fewer than two"),
        ((segment(1.5, x=1.1 * ccsds.FARTHEST_KM),), "is beyond"),
        (("2026-03-20T12:00:00 1 2 3 4 5 6\n",), "line 2 .*before any metadata"),
        (("META_STOP\n",), "line 2 .*without META_START"),
        ((), "holds no segment"),
    ],
)
def test_segments_that_do_not_are_refused(parts: tuple[str, ...], words: str, tmp_path: Path) -> None:
    orbit(tmp_path, segment(1.5), segment(4.5000009, x=ccsds.FARTHEST_KM))
    with pytest.raises(InputError, match=words):
        orbit(tmp_path, *parts)


ATTITUDE_HEAD = (
    "META_START\nREF_FRAME_A = EME2000\nREF_FRAME_B = BODY\nTIME_SYSTEM = TAI\nATTITUDE_TYPE = QUATERNION\n"
)


@pytest.mark.parametrize("written", ["", r"\1 =\n"], ids=["absent", "empty"])
@pytest.mark.parametrize(
    ("read", "text", "needed"),
    [
        (
            read_orbit,
            f"CCSDS_OEM_VERS = 2.0\n{segment(1.5)}",
            ("CENTER_NAME", "REF_FRAME", "TIME_SYSTEM"),
        ),
        (
            read_attitude,
            f"CCSDS_AEM_VERS = 1.0\n{ATTITUDE_HEAD}META_STOP\n"
            "2026-03-20T12:00:01 0 0 0 1\n2026-03-20T12:00:02 0 0 0 1\n",
            ("REF_FRAME_A", "REF_FRAME_B", "TIME_SYSTEM", "ATTITUDE_TYPE"),
        ),
    ],
    ids=["orbit", "attitude"],
)
def test_metadata_lack_what_has_no_value(
    read: Any, text: str, needed: tuple[str, ...], written: str, tmp_path: Path
) -> None:
    """Claim: a keyword that is not there, or stands without a value, is named at the line where the metadata end: each
    by itself, and all of them in order."""
    path = tmp_path / "a.txt"
    path.write_text(text)
    read(path)
    for keys in (*((key,) for key in needed), needed):
        poorer = re.sub(rf"^({'|'.join(keys)}) = .*\n", written, text, flags=re.MULTILINE)
        path.write_text(poorer)
        end = poorer.split("\n").index("META_STOP") + 1
        with pytest.raises(
            InputError, match=rf"^line {end} of a\.txt: the metadata lack {', '.join(keys)}\.$"
        ):
            read(path)


def test_so_many_epochs_may_there_be(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ccsds, "MOST_ROWS", 18)
    orbit(tmp_path, segment(1.5, 18))
    with pytest.raises(InputError, match="more than 18 epochs"):
        orbit(tmp_path, segment(1.5, 19))


@pytest.mark.parametrize(
    ("length", "taken"), [(1.0009, True), (0.9991, True), (1.0011, False), (0.9989, False)]
)
def test_a_quaternion_is_one_long_to_a_thousandth(length: float, taken: bool, tmp_path: Path) -> None:
    own = length * np.array([0.1, -0.5, 0.7, 0.5]) / np.linalg.norm([0.1, -0.5, 0.7, 0.5])
    rows = "".join(
        f"2026-03-20T12:00:0{n} " + " ".join(f"{one:.12f}" for one in np.roll(own, 1)) + "\n" for n in (1, 2)
    )
    meta = (
        "META_START\nREF_FRAME_A = EME2000\nREF_FRAME_B = SC\nTIME_SYSTEM = TAI\nATTITUDE_TYPE = quaternion\n"
    )
    path = tmp_path / "a.aem"
    path.write_text(
        f"CCSDS_AEM_VERS = 1.0\n{meta}ATTITUDE_DIR = b2a\nQUATERNION_TYPE = first\n{NAMES}META_STOP\n{rows}"
    )
    if not taken:
        with pytest.raises(InputError, match="long, not 1"):
            read_attitude(path)
        return
    np.testing.assert_allclose(
        read_attitude(path).segments[0].rows, np.tile(own * [-1.0, -1.0, -1.0, 1.0], (2, 1)), atol=1e-11
    )


def test_each_segment_is_read_by_its_own_spelling(tmp_path: Path) -> None:
    """Claim: order and sense of the quaternions are those of the segment in which they stand, whatever the one before
    said; times count from the first epoch of all."""
    own = np.array([0.1, -0.5, 0.7, 0.5]) / np.linalg.norm([0.1, -0.5, 0.7, 0.5])
    spelt = {"LAST": own, "FIRST": np.roll(own * [-1.0, -1.0, -1.0, 1.0], 1)}
    text = "CCSDS_AEM_VERS = 1.0\n"
    for begin, (order, sense) in enumerate((("LAST", "A2B"), ("FIRST", "B2A"), ("LAST", "A2B"))):
        text += (
            "META_START\nREF_FRAME_A = EME2000\nREF_FRAME_B = SC\nTIME_SYSTEM = TAI\nATTITUDE_TYPE = QUATERNION\n"
            f"ATTITUDE_DIR = {sense}\nQUATERNION_TYPE = {order}\n{NAMES}META_STOP\n"
        )
        for second in (begin, begin + 1):
            numbers = " ".join(f"{value:.12f}" for value in spelt[order])
            text += f"2026-03-20T12:00:0{second} {numbers}\n"
    (tmp_path / "a.aem").write_text(text)
    found = read_attitude(tmp_path / "a.aem")
    assert found.start == parse_epoch("2026-03-20T12:00:00", "TAI")
    assert [one.time.tolist() for one in found.segments] == [[0.0, 1.0], [1.0, 2.0], [2.0, 3.0]]
    for one in found.segments:
        np.testing.assert_allclose(one.rows, np.tile(own, (2, 1)), atol=1e-11)


def test_signs_of_quaternions_follow_the_first() -> None:
    given = np.array(
        [[0.0, 0.1, 0.2, 1.0], [0.0, -0.1, -0.3, -1.0], [0.0, -0.2, -0.3, -1.0], [0.1, 0.2, 0.4, 0.9]]
    )
    np.testing.assert_array_equal(_same_signs(given), given * np.array([[1.0], [-1.0], [-1.0], [1.0]]))


@pytest.mark.parametrize(
    ("meta", "wanted"),
    [
        ({}, ("HERMITE", 7)), ({"I": "lagrange", "INTERPOLATION_DEGREE": "1"}, ("LAGRANGE", 1)),
        ({"I": "LINEAR", "INTERPOLATION_DEGREE": "9"}, ("LINEAR", 1)),
        ({"INTERPOLATION_DEGREE": "15"}, ("HERMITE", 15)),
        ({"INTERPOLATION_DEGREE": "16"}, None), ({"INTERPOLATION_DEGREE": "0"}, None),
        ({"INTERPOLATION_DEGREE": "many"}, None), ({"I": "SPLINE"}, None),
    ],
)  # fmt: skip
def test_an_interpolation_is_known_and_of_a_degree_from_1_to_15(
    meta: dict[str, str], wanted: tuple[str, int] | None
) -> None:
    if wanted is not None:
        assert _interpolation(meta, "I", "HERMITE", 7) == wanted
        return
    with pytest.raises(InputError, match=r"is not known|from 1 to 15"):
        _interpolation(meta, "I", "HERMITE", 7)


def test_attitudes_have_no_hermite_interpolation() -> None:
    with pytest.raises(InputError, match="HERMITE"):
        _interpolation({"INTERPOLATION_METHOD": "HERMITE"}, "INTERPOLATION_METHOD", "LINEAR", 1)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_place_is_as_far_as_may_be_along_each_axis(axis: int, sign: float, tmp_path: Path) -> None:
    """Claim: each coordinate has the limit, and the velocity none of it."""
    row = [7000.0, 100.0, -200.0, 2e7, -2e7, 2e7]
    for share, possible in ((1.0, True), (1.0001, False)):
        row[axis] = sign * share * ccsds.FARTHEST_KM
        text = segment(1.5).split("\n")
        text = [
            " ".join([line.split()[0], *map(str, row)]) if line.startswith("2026") else line for line in text
        ]
        if possible:
            found = orbit(tmp_path, "\n".join(text))
            np.testing.assert_allclose(found.segments[0].rows[0], 1e3 * np.array(row))
            continue
        with pytest.raises(InputError, match="a coordinate is beyond"):
            orbit(tmp_path, "\n".join(text))


@pytest.mark.parametrize("key", ["REF_FRAME_A", "REF_FRAME_B", "TIME_SYSTEM"])
def test_segments_of_an_attitude_have_one_pair_of_frames(key: str, tmp_path: Path) -> None:
    """Claim: frames and time system are those of the first segment, each by its key."""
    first, second = (
        f"{ATTITUDE_HEAD}META_STOP\n2026-03-20T12:00:0{at} 0 0 0 1\n2026-03-20T12:00:0{at + 1} 0 0 0.6 0.8\n"
        for at in (1, 2)
    )
    path = tmp_path / "a.aem"
    path.write_text("CCSDS_AEM_VERS = 1.0\n" + first + second)
    assert len(read_attitude(path).segments) == 2
    value = {"REF_FRAME_A": "EME2000", "REF_FRAME_B": "BODY", "TIME_SYSTEM": "TAI"}[key]
    path.write_text("CCSDS_AEM_VERS = 1.0\n" + first + second.replace(f"{key} = {value}", f"{key} = UTC"))
    with pytest.raises(InputError, match=f"segment 2 .* another {key}"):
        read_attitude(path)
