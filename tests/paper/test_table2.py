"""Table 2: acquisition times of raster images at 20 000 voxels/s."""

from __future__ import annotations

import pytest

from scanner_sim.config.scanner import Scanner
from scanner_sim.scan.raster import RasterScan


@pytest.mark.parametrize(("size", "printed_s"), [(128, 0.8), (256, 3.3), (512, 13.1)])
def test_raster_times(size: int, printed_s: float) -> None:
    """Claim: the time of a raster image is its number of voxels over the rate.

    Set-up: square rasters on the preset nrc_2000. Expected: the printed 0.8, 3.3 and 13.1 s. Tolerance: half
    of the last printed digit.
    """
    scan = RasterScan(rows=size, columns=size, horizontal=(-0.25, 0.25), vertical=(-0.25, 0.25))
    assert scan.shots * Scanner().dwell == pytest.approx(printed_s, abs=0.05)


def test_rate_is_the_papers() -> None:
    """Claim: the preset measures 20 000 voxels per second. Expected: dwell 50 µs. Tolerance: rounding."""
    assert Scanner().dwell == pytest.approx(50e-6, rel=1e-12)
