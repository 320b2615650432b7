"""Order of the shots: the first axis is the shot, rows are φ from the top, columns are Θ from the left."""

from __future__ import annotations

import numpy as np

from scanner_sim.ranging.coordinates import coordinates
from scanner_sim.scan.raster import RasterScan, raster_aim, tiled_order

SCAN = RasterScan(rows=3, columns=4, horizontal=(-0.2, 0.1), vertical=(-0.3, 0.3))


def test_shot_is_row_times_columns_plus_column() -> None:
    aim = raster_aim(SCAN, np.arange(12, dtype=np.uint32), 50e-6)
    theta, phi = SCAN.angles()
    for row in range(3):
        for column in range(4):
            assert aim.theta[row * 4 + column] == theta[column]
            assert aim.phi[row * 4 + column] == phi[row]


def test_first_column_is_the_left() -> None:
    theta, _ = SCAN.angles()
    assert theta[0] == -0.2
    assert theta[-1] == 0.1
    assert (np.diff(theta) > 0.0).all()


def test_first_row_is_the_top() -> None:
    """The smallest φ comes first, and with y down the smallest y is the top of the picture."""
    _, phi = SCAN.angles()
    assert (np.diff(phi) > 0.0).all()
    _, y, _ = coordinates(5.0, 0.0, phi, 0.05)
    assert y[0] < y[-1]


def test_single_shot_points_to_the_middle() -> None:
    one = RasterScan(rows=1, columns=1, horizontal=(-0.2, 0.1), vertical=(0.0, 0.3))
    aim = raster_aim(one, np.zeros(1, dtype=np.uint32), 50e-6)
    np.testing.assert_allclose((aim.theta[0], aim.phi[0]), (-0.05, 0.15), atol=1e-15)


def test_tiles_visit_every_shot_once() -> None:
    scan = RasterScan(rows=19, columns=13, horizontal=(-0.2, 0.1), vertical=(-0.3, 0.3))
    np.testing.assert_array_equal(np.sort(tiled_order(scan)), np.arange(19 * 13))


def test_aim_keeps_the_number_of_its_shot() -> None:
    shots = np.array([7, 2, 11], dtype=np.uint32)
    aim = raster_aim(SCAN, shots, 50e-6)
    np.testing.assert_array_equal(aim.shot, shots)
    theta, phi = SCAN.angles()
    np.testing.assert_array_equal(aim.theta, theta[[3, 2, 3]])
    np.testing.assert_array_equal(aim.phi, phi[[1, 0, 2]])


def test_a_sweep_goes_from_the_middle_of_one_column_to_the_next() -> None:
    """Travel is positive where Θ grows, and the time is the middle of the dwell; a lone column or a step stays."""
    aim = raster_aim(SCAN, np.array([0, 5], dtype=np.uint32), 50e-6)
    np.testing.assert_allclose(aim.travel_theta, 0.1)
    np.testing.assert_array_equal(aim.travel_phi, 0.0)
    np.testing.assert_allclose(aim.time, (25e-6, 275e-6))
    stepped = SCAN.model_copy(update={"motion": "stepped"})
    lone = RasterScan(rows=2, columns=1, horizontal=(0.1, 0.1), vertical=(0.0, 0.3))
    for scan in (stepped, lone):
        assert not raster_aim(scan, np.array([0, 1], dtype=np.uint32), 50e-6).travel_theta.any()
