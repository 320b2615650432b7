"""A channel is one row of a table and its values: everything else follows from the row."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from scanner_sim.foundation import channels

ROW = """    Channel(
        "peak_width_px",
        "pixel",
        "width of the detected peak",
        "measured",
        _LINE,
        vertex="peak_width",
        pictures=(Picture("width.png", "width of the peak", "Width", "width [pixel]", "magma"),),
    ),
"""

WITH_THE_ROW = f"""\
import sys, types
from pathlib import Path

path = Path({channels.__file__!r})
before, mark, after = path.read_text(encoding="utf-8").partition('    Channel("status", "1", "0 where')
assert mark
module = types.ModuleType("scanner_sim.foundation.channels")
sys.modules[module.__name__] = module
exec(compile(before + {ROW!r} + mark + after, str(path), "exec"), module.__dict__)
"""

FOLLOWED = (
    WITH_THE_ROW
    + """
import json
import numpy as np
from scanner_sim.config import load_scenario
from scanner_sim.instrument.memory import memory
from scanner_sim.products.files.contents import RUN, planned_files
from scanner_sim.products.files.exr import read_range_image
from scanner_sim.products.files.run_folder import write_run
from scanner_sim.products.image import RangeImage
from scanner_sim.products.settings import Output
from scanner_sim.foundation.channels import MEASURED_BY

folder = Path(sys.argv[1])
assert "peak_width_px" in MEASURED_BY["status"]
status = np.array([[0, 1, 0]], dtype=np.float32)
layers = {name: np.where(status == 0, 9.0, np.nan) for name in ("range_m", "P.X", "P.Y", "P.Z", "sigma_range_m")}
layers |= {"Y": 1.0 - status, "peak_width_px": np.where(status == 0, 2.5, np.nan), "status": status}
image = RangeImage({name: layer.astype(np.float32) for name, layer in layers.items()}, np.arange(3.0), np.zeros(1))
try:
    RangeImage({"status": status, "peak_width_px": np.ones_like(status)}, np.arange(3.0), np.zeros(1))
except ValueError as error:
    assert "peak_width_px must be NaN" in str(error)
else:
    raise AssertionError("a width where nothing was measured")
written = [path.name for path in write_run(image, folder / "out")]
assert "width.png" in written and "width.png" in RUN.files
assert "width.png" in planned_files(Output()) and "width.png" not in planned_files(Output(), rangefinders=("tof",))
read = read_range_image(folder / "out" / "range.exr")
np.testing.assert_array_equal(read["peak_width_px"], image["peak_width_px"])
data = read.to_xarray()["peak_width_px"]
assert (data.attrs["units"], data.attrs["long_name"]) == ("pixel", "width of the detected peak")
assert b"property float peak_width" in (folder / "out" / "points.ply").read_bytes()
assert "peak_width_px" in json.loads((folder / "out" / "summary.json").read_text())["channels"]

sys.path.insert(0, sys.argv[2])
import reference_pages
page = reference_pages.files_page()
assert "| `peak_width_px` | pixel | width of the detected peak |" in page
assert "| `width.png` | width of the peak |" in page
scenario = load_scenario(sys.argv[3])
print(memory(scenario) / scenario.raster.shots)
"""
)


@pytest.mark.slow
def test_a_row_and_its_values_arrive_everywhere(tmp_path: Path, repo_root: Path) -> None:
    """Claim: EXR, xarray, points, pictures, planned files, summary, documents and memory follow from a row alone.

    Set-up: the table's own file is loaded with a row more, by a new process, before anything reads it; nothing else
    is changed. Expected: the channel is in each, and a voxel of the estimate takes the four bytes of a float32 more.
    """
    from scanner_sim.config import load_scenario
    from scanner_sim.instrument.memory import memory

    config = repo_root / "configs" / "plane.yaml"
    arguments = [str(tmp_path), str(repo_root / "docs"), str(config)]
    done = subprocess.run(
        [sys.executable, "-c", FOLLOWED, *arguments], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    scenario = load_scenario(config)
    assert float(done.stdout) - memory(scenario) / scenario.raster.shots == pytest.approx(4.0, abs=1e-6)


def test_an_image_has_the_channels_of_the_rangefinders_that_make_it() -> None:
    """Claim: of a rangefinder those that need no other, of both all but what is only asked for; four bytes each."""
    rows = channels.CHANNEL.values()
    both = ("triangulation", "tof")
    for some in (("triangulation",), ("tof",), both):
        wanted = [row for row in rows if all(one in some for one in row.rangefinders) and not row.asked]
        assert list(channels.channels_by(some)) == wanted
        assert channels.layer_bytes(some) == 4 * len(wanted)
    assert 0 < len(channels.channels_by(both[:1])) < len(channels.channels_by(both))
    asked = {row.asked for row in rows if row.asked}
    assert asked
    for one in asked:
        more = set(channels.channels_by(both, [one])) - set(channels.channels_by(both))
        assert more == {row for row in rows if row.asked == one}
