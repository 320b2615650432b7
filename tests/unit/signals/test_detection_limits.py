"""Where the search for echoes begins and ends: the shortest record, and the level of a leading edge."""

from __future__ import annotations

import pytest
from prototype import Digitiser, Photodiode, Pulse

from scanner_sim.detector.photodiode.photodiode import PhotodiodeNoise
from scanner_sim.foundation.errors import InputError
from scanner_sim.signals.waveform.detection import PulseDetector
from scanner_sim.signals.waveform.settings import PulseDetection

pytestmark = pytest.mark.usefixtures("device")

PULSE = Pulse(shape="t2_exponential")
SILENT = Photodiode(
    noise=PhotodiodeNoise(**dict.fromkeys(PhotodiodeNoise.model_fields, False) | {"saturation": True})
)


CLOCK = Digitiser(rate=0.8e9, jitter=0.0, gate=(1.0, 40.0))


@pytest.mark.parametrize("timing", ["matched_filter", "leading_edge"])
def test_a_record_has_room_for_a_pulse_and_four_places_of_it(
    timing: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: the shortest record that is searched has 2h + 4 samples for a pulse that takes h to each side."""
    settings = PulseDetection(timing=timing)
    half = PulseDetector(PULSE, Photodiode(), CLOCK, settings).half
    # A gate has samples in fours only: what is asked is how many are enough.
    monkeypatch.setattr(type(CLOCK), "samples", property(lambda _: 2 * half + 4))
    PulseDetector(PULSE, Photodiode(), CLOCK, settings)
    monkeypatch.setattr(type(CLOCK), "samples", property(lambda _: 2 * half + 3))
    with pytest.raises(InputError, match=f"record of {2 * half + 3} samples .* pulse of {2 * half + 1}"):
        PulseDetector(PULSE, Photodiode(), CLOCK, settings)


def test_the_level_is_what_is_given_or_a_ten_thousandth_of_the_saturation() -> None:
    """Without noise nothing else says how high an edge must be; a level that is given is below the saturation."""
    full = SILENT.saturation

    def level(**given: float) -> float:
        made = PulseDetector(PULSE, SILENT, CLOCK, PulseDetection(timing="leading_edge", **given))
        return made.level * made.step

    assert level() == pytest.approx(1e-4 * full, rel=1e-9)
    assert level(level=0.37 * full) == pytest.approx(0.37 * full, rel=1e-9)
    assert level(level=0.999 * full) == pytest.approx(0.999 * full, rel=1e-9)
    with pytest.raises(InputError, match="is not below the saturation"):
        level(level=1.001 * full)
