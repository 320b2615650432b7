"""Results in notebooks and in other processes: pickled, drawn, shown."""

from __future__ import annotations

import io
import multiprocessing
import pickle
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from html_cells import cells
from PIL import Image

from scanner_sim.foundation.status import Status
from scanner_sim.products.files.exr import write_exr
from scanner_sim.products.grey import grey_levels, range_levels, thumbnail
from scanner_sim.products.image import RangeImage
from scanner_sim.products.shots import ShotTable
from scanner_sim.ranging.axes import Axes
from scanner_sim.tracking.record import Track

VOID = {"img", "br", "meta"}


def image(objects: tuple[str, ...] = ("plate",)) -> RangeImage:
    rows, columns = 3, 5
    status = np.zeros((rows, columns), dtype=np.float32)
    status[0, :2], status[2, 4] = Status.BELOW_THRESHOLD, Status.MIXED
    valid = status == Status.VALID
    ramp = np.linspace(4.0, 6.0, rows * columns, dtype=np.float32).reshape(rows, columns)
    layers = {name: np.where(valid, ramp, np.float32(np.nan)) for name in ("range_m", "P.X", "P.Y", "P.Z")}
    layers |= {"sigma_range_m": 1e-3 * layers["range_m"], "status": status, "Y": 1e4 * ramp}
    layers["truth.object"] = np.ones_like(status)
    return RangeImage(
        layers, 0.01 * np.arange(columns), 0.01 * np.arange(rows), objects=objects, seed=5, warnings=("<b>odd</b>",)
    )  # fmt: skip


def shots() -> ShotTable:
    flat = {name: layer.ravel() for name, layer in image().channels.items()}
    time = np.arange(15.0)
    return ShotTable(flat, time, 0.01 * time, 0.0 * time, objects=("plate",))


class Reader(HTMLParser):
    """Fails at tags that are not closed in order, and keeps the tags and the texts."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: set[str] = set()
        self.texts: list[str] = []
        self.feed(page)
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        self.open += [] if tag in VOID else [tag]
        assert not any("http" in (value or "") for _, value in attrs), "nothing is fetched"

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append(data)


def test_an_image_survives_pickling_to_the_last_byte(tmp_path: Path) -> None:
    first = image()
    again = pickle.loads(pickle.dumps(first))
    for number, one in enumerate((first, again)):
        write_exr(tmp_path / f"{number}.exr", one, "zip")
    assert (tmp_path / "0.exr").read_bytes() == (tmp_path / "1.exr").read_bytes()
    assert not again["range_m"].flags.writeable
    assert pickle.dumps(again) == pickle.dumps(pickle.loads(pickle.dumps(again)))


def test_a_result_keeps_the_versions_that_made_it() -> None:
    """Claim: what another version measured was measured by that one, in whichever process it is looked at."""
    first = replace(image(), made_by={"mitsuba": "3.5.0", "scanner-sim": "0.0.9"})
    assert dict(pickle.loads(pickle.dumps(first)).made_by) == {"mitsuba": "3.5.0", "scanner-sim": "0.0.9"}


def test_a_table_of_shots_survives_pickling() -> None:
    first = shots()
    again = pickle.loads(pickle.dumps(first))
    assert {name: values.tobytes() for name, values in first.columns.items()} == {
        name: values.tobytes() for name, values in again.columns.items()
    }


def middle(result: RangeImage) -> RangeImage:
    """Give back what came, from another process."""
    assert result.shape == (3, 5)
    return result


@pytest.mark.slow
def test_an_image_goes_to_a_spawned_process_and_back() -> None:
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        (again,) = pool.map(middle, [image()])
    assert {name: layer.tobytes() for name, layer in again.channels.items()} == {
        name: layer.tobytes() for name, layer in image().channels.items()
    }


@pytest.mark.parametrize("name", ["range_m", "Y", "sigma_range_m", "status", "truth.object"])
def test_a_plot_has_units_and_tells_why_voxels_are_empty(name: str) -> None:
    """Claim: axes in degrees about the centres of the voxels; a colour bar with unit; each cause with its sentence."""
    mpl.use("Agg")
    axes = image(objects=("pl$ate$",)).plot(name)
    assert axes.get_xlabel() == "Θ to the right [°]"
    left, right, bottom, top = axes.images[0].get_extent()
    step = np.degrees(0.01)
    assert (left, right, bottom, top) == pytest.approx((-step / 2, 4.5 * step, 2.5 * step, -step / 2))
    legend = axes.get_legend()
    said = [] if legend is None else [text.get_text() for text in legend.get_texts()]
    others = [other for other in axes.figure.axes if other is not axes]
    if name in ("range_m", "sigma_range_m"):
        (bar,) = others
        assert "[m]" in bar.get_ylabel()
        assert len(said) == 2
        assert any("the spot lies on an edge" in text for text in said)
    elif name == "Y":
        assert "electrons" in others[0].get_ylabel()
        assert not said
    else:
        assert not others
        assert len(said) == (3 if name == "status" else 1)
    axes.figure.savefig(io.BytesIO(), format="png")
    plt.close(axes.figure)


def test_a_plot_tells_what_voxels_with_a_range_lack() -> None:
    """Claim: of a σ by uneven spots, in decades, that it is 0 where it is; of a truth, evenly, that there is none."""
    mpl.use("Agg")
    whole = image()
    uneven, truth = whole["sigma_range_m"].copy(), whole["range_m"].copy()
    uneven[1, 1], truth[1, 1:4] = 0.0, np.nan
    layers = {**whole.channels, "sigma_texture_m": uneven, "truth.range_m": truth}
    for name, words in (
        ("sigma_texture_m", "6.7 %: 0, which has no place on this scale"),
        ("truth.range_m", "20.0 %: no value"),
    ):
        axes = replace(whole, channels=layers).plot(name)
        assert words in [text.get_text() for text in axes.get_legend().get_texts()]
        plt.close(axes.figure)


def test_a_plot_is_drawn_where_it_is_wanted() -> None:
    mpl.use("Agg")
    figure, (_, right) = plt.subplots(1, 2)
    assert image().plot(axes=right) is right
    with pytest.raises(KeyError, match="no channel 'rang_m'"):
        image().plot("rang_m")
    plt.close(figure)


RESULTS = (
    image(("<script>alert(1)</script>",)),
    shots(),
    Track((), (), 0, "", "", Axes(0.05), ("<i>none</i>",)),
)


@pytest.mark.parametrize("result", RESULTS, ids=lambda one: type(one).__name__)
def test_a_notebook_shows_a_result_as_text_and_fetches_nothing(
    result: RangeImage | ShotTable | Track,
) -> None:
    page = result._repr_html_()
    found = Reader(page)
    assert not found.tags & {"script", "i"}
    assert len(page) < 30_000
    if isinstance(result, RangeImage):
        assert "img" in found.tags
        assert "<b>odd</b>" in found.texts
        assert "<script>alert(1)</script>" in found.texts


def test_a_notebook_tells_why_there_is_no_range_and_how_often() -> None:
    """Claim: the share of all voxels that have a range, and of each other outcome that there is, and of no more."""
    status = np.zeros((4, 5), np.float32)
    status[0] = Status.BELOW_THRESHOLD
    status[1, :3] = Status.SATURATED
    page = replace(
        image(), channels={"status": status}, theta=np.arange(5.0), phi=np.arange(4.0)
    )._repr_html_()
    texts = Reader(page).texts
    assert "60 %" in texts
    for code, share in ((Status.BELOW_THRESHOLD, "25 %: "), (Status.SATURATED, "15 %: ")):
        assert f"{share}{code.sentence}" in texts
        assert code.name.lower().replace("_", " ") in texts
    assert sum(text.split(": ")[0].endswith(" %") for text in texts) == 3


@pytest.mark.parametrize("result", RESULTS[:2], ids=lambda one: type(one).__name__)
def test_a_notebook_lists_the_layers_with_units_and_meanings(result: RangeImage | ShotTable) -> None:
    rows = cells(result._repr_html_())
    at = rows.index(["name", "unit", "meaning"])
    assert [row[0] for row in rows[at + 1 :]] == list(result.channels)
    assert {row[0]: row[1] for row in rows[at + 1 :]}["range_m"] == "m"
    assert all(len(row) == 3 and row[2] for row in rows[at:])


@pytest.mark.parametrize(("shape", "most", "every"), [((5, 9), 4, 3), ((9, 5), 9, 1), ((9, 5), 8, 2)])
def test_a_thumbnail_leaves_out_dots_evenly(shape: tuple[int, int], most: int, every: int) -> None:
    """Claim: as few as keep both sides within so many dots, from the first row and column on, neither turned nor
    mirrored; nearer is brighter, and what has no range is black."""
    values = np.arange(float(shape[0] * shape[1])).reshape(shape).astype(np.float32) + 3.0
    values[0, 0] = np.nan
    found = np.asarray(Image.open(io.BytesIO(thumbnail(values, most))))
    assert max(found.shape) <= most
    np.testing.assert_array_equal(found, grey_levels(values[::every, ::every]))
    assert found[0, 0] == 0
    assert (np.diff(found[-1].astype(int)) < 0).all()
    assert (np.diff(found[1:, -1].astype(int)) < 0).all()


def test_grey_levels_go_from_near_to_far() -> None:
    levels = range_levels(np.array([[2.0, 4.0, 7.0, 1.0, 8.0, np.nan]]), 2.0, 7.0)
    assert levels.tolist() == [[255, round(40 + 215 * 0.6), 40, 255, 40, 0]]
