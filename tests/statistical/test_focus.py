"""Tilted and defocused arrays in the light: the spot on the array, and σ of rastered planes at close range."""

from __future__ import annotations

import numpy as np
import pytest
from claims import mean_square

from scanner_sim import Scenario, simulate
from scanner_sim.analytic.speckle import pixel_shares
from scanner_sim.analytic.wave_optics import Lens, defocus, images, on_pixels
from scanner_sim.products.image import RangeImage
from scanner_sim.render.device import Device
from scanner_sim.validation.compare.run import compare

DEFOCUSED = {"array_tilt": 0.0, "focus_distance": 0.45, "aperture": 3e-3}
TILTED = {"array_tilt": 0.35, "focus_distance": 0.45, "aperture": 6e-3}


def scenario(distance: float, tilt: float = 0.0, side: int = 48, **scanner: object) -> Scenario:
    """Return a plane that is turned by an angle [rad], before the close-range scanner at rest on each voxel."""
    reach = 0.1
    board = {
        "name": "board",
        "shape": "rectangle",
        "size": [2.0, 2.0],
        "position": [0.0, 0.0, distance],
        "rotation": [{"axis": "y", "angle": tilt}],
        "material": {"reflectance": 0.5},
    }
    scan = {"rows": side, "columns": side, "horizontal": (-reach, reach), "vertical": (-reach, reach)}
    return Scenario.model_validate(
        {
            "schema": 1,
            "seed": 11,
            "scanner": {"preset": "close_range_scanner", **scanner},
            "scene": {"objects": [board]},
            "scan": {"type": "raster", "motion": "stepped", **scan},
            # The misfit of a wide, faint spot makes σ cautious, whatever the array.
            "processing": {"validation": {"misfit": 0.0}},
        }
    )


def pulls(image: RangeImage) -> np.ndarray:
    return np.asarray((image["range_m"] - image["truth.range_m"]) / image["sigma_range_m"])[image.valid]


@pytest.mark.parametrize(("distance", "tilt"), [(0.4, 0.0), (0.5, 0.6), (0.7, 0.0)])
def test_sigma_is_that_of_the_errors_at_close_range(device: Device, distance: float, tilt: float) -> None:
    """Claim: rms(error/σ) is 1 on planes before, in and behind the focus of the beam; the array is Scheimpflug's.

    The slack is what the packets leave of σ by speckle, 4 %, of the variance twice as much; on the tilted plane, whose
    σ is that of one that faces the scanner, 12 % (24 seeds: 0.876 ± 0.005).
    """
    image = simulate(scenario(distance, tilt), device="cpu")
    assert image.valid.mean() > 0.9
    claim = mean_square(pulls(image), slack=0.12 if tilt else 0.08)
    assert claim
    assert claim.finds < 0.35


@pytest.mark.parametrize("tilt", [-0.9, 0.6, 0.9])
def test_a_sweep_over_a_focused_tilted_plane_is_no_bad_shape(device: Device, tilt: float) -> None:
    """Claim: where the beam sweeps over a slope in its focus every voxel has a range, and a σ that holds.

    Set-up: the shipped relief's step, 0.8 mrad a dwell: on a plane tilted by 52° the image moves by 0.9 pixel, and the
    spot, 0.43 pixel wide, is half as wide again. Before the width knew of the sweep, 0 to 30 % of such voxels were
    left. Expected: all of them; a mean square of z of 1. Slack: σ by speckle is that of a surface which faces the
    scanner; the beam's image on these is 0.7 to 1.3 times as wide, and its speckle errs by up to a tenth less. Planes
    of 24 seeds scatter like 2300 to 3100 independent voxels, of 2304.
    """
    made = scenario(0.4, tilt).changed(
        scan={"motion": "continuous", "horizontal": (-0.0196, 0.0196), "vertical": (-0.0196, 0.0196)}
    )
    image = simulate(made, device="cpu")
    assert image.valid.mean() > 0.99
    z = (image["range_m"] - image["truth.range_m"]) / image["sigma_range_m"]
    claim = mean_square(z[image.valid], slack=0.2)
    assert claim, claim
    assert claim.finds < 0.5


@pytest.mark.parametrize("receiver", [DEFOCUSED, TILTED], ids=["out of focus", "tilted"])
def test_spots_are_where_and_as_wide_as_the_judge_says(device: Device, receiver: dict[str, float]) -> None:
    """Claim: place and width of spots over the field are those of the judge's collineation and rays; no range errs.

    It can fail: without the blur the spot at 0.29 m is 1.6 instead of 3.2 pixels wide.
    """
    made = scenario(0.55, receiver=receiver, laser={"power": 1e-4})
    found = compare(made, only=("spot_position", "spot_width", "points"), quick=True, device="cpu")
    assert not found.broken
    assert max(check.detects_99 for finding in found.findings for check in finding.checks) < 0.005


@pytest.mark.slow
def test_the_close_range_scanner_keeps_every_law(device: Device) -> None:
    """Claim: no law of ``compare`` is broken in the midst and near both ends of the shipped instrument's ranges."""
    made = scenario(0.55).changed(processing={"validation": {}})
    found = compare(made, target="20 % at 0.34 m, 0.55 m, 0.8 m", quick=True, device="cpu")
    assert not found.broken


def test_a_gaussian_stands_for_the_disc_of_a_lens_out_of_focus() -> None:
    """Claim: of the same variance, it is 4 % too high in the middle where the blur is as wide as the beam's image.

    Mean of 100 surfaces of wave optics; contrast 0.7/√M of each, 0.7 % of the height together, of which four are
    allowed.
    """
    pitch, beam, blur, diffusion = 20e-6, 20e-6, 20e-6, 7e-6
    bare = Lens(632.8e-9, 6.5)
    lens = Lens(632.8e-9, 6.5, defocus(bare, blur))
    seen = images(lens, (beam, beam), 100, 1, polarisations=2, blur=blur)
    lines = np.array([on_pixels(one, pitch, 31, 15.0, diffusion)[0] for one in seen])
    told = pixel_shares(pitch, 15.0 * pitch, float(np.sqrt(beam**2 + blur**2 + diffusion**2)), 31)
    assert lines.mean(axis=0)[15] / told[15] == pytest.approx(0.96, abs=0.028)
    assert np.abs(lines.mean(axis=0) - told).max() < 0.06 * told.max()
