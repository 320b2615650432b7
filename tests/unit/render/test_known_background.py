"""The background of a scan that is rendered once, and known to the next run."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scanner_sim import load_scenario
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.render.background import panorama
from scanner_sim.render.background.panorama import Panorama
from scanner_sim.render.background.view import PanoramaView
from scanner_sim.render.device import Device
from scanner_sim.render.settings import Transport, slot_halvings, times_finer
from scanner_sim.scene.light.lighting import Sky

BASE = [
    "lighting={sun: {direction: [-0.5, -0.6, -0.6]}, earth: {direction: [0, 1, 0.3]}}",
    "transport.background_samples=2",
    "transport.background_bounces=1",
    "scan.rows=2",
    "scan.columns=4",
]
OWN_SEED = "transport.background_seed=3"
OTHER_SUN = "lighting={sun: {direction: [-0.4, -0.6, -0.6]}, earth: {direction: [0, 1, 0.3]}}"


def background(root: Path, *changes: str) -> Panorama:
    scenario = load_scenario(root / "configs" / "plane.yaml", [*BASE, *changes])
    found = Instrument(scenario, device="cpu").triangulation.panorama
    assert found is not None
    return found


@pytest.mark.parametrize(
    "change", ["seed=8", "scanner.laser.power=7 mW", "processing.range_gate=[2 m, 30 m]"]
)
def test_what_the_light_does_not_depend_on_leaves_it_known(
    device: Device, repo_root: Path, change: str
) -> None:
    assert background(repo_root, OWN_SEED, change) is background(repo_root, OWN_SEED)


@pytest.mark.parametrize(
    "changes",
    [
        ["seed=8"],
        [OWN_SEED],
        [OTHER_SUN],
        ["transport.background_samples=4"],
        ["transport.background_bounces=2"],
        ["scan.rows=3"],
        ["scan.horizontal=[-3 deg, 4 deg]"],
        ["scan.vertical=[-3 deg, 4 deg]"],
        ["scanner.receiver.baseline=210 mm"],
        ["scanner.receiver.aberration=20 um"],
        ["scanner.as_built={axis_skew: 5 mrad}"],
        ["scanner.as_built={axis_offset: 5 mm}"],
    ],
)
def test_other_light_is_rendered_anew(device: Device, repo_root: Path, changes: list[str]) -> None:
    known = background(repo_root)
    assert background(repo_root, *changes) is not known


def test_all_light_of_a_background_is_drawn_by_its_seed(
    device: Device, repo_root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: slow and sharp light have the seed that a scenario gives the background, whatever that of its noise."""
    asked: list[tuple[str, int]] = []
    own = {name: getattr(panorama, name) for name in ("_trace_rows", "_sharp_by_contrast")}

    def spied(name: str, *given: Any) -> Any:
        asked.append((name, given[-1]))
        return own[name](*given)

    for name in own:
        monkeypatch.setattr(panorama, name, partial(spied, name))
    background(repo_root, "transport.background_seed=771", "seed=5")
    assert set(asked) == {("_trace_rows", 771), ("_sharp_by_contrast", 771)}


def test_another_scene_is_rendered_anew(device: Device, repo_root: Path) -> None:
    known = background(repo_root)
    other = load_scenario(repo_root / "configs" / "tilted_plane.yaml", BASE)
    found = Instrument(other, device="cpu").triangulation.panorama
    assert found is not known
    assert background(repo_root) is not known


def test_two_are_kept(device: Device, repo_root: Path) -> None:
    known = [background(repo_root, f"transport.background_seed={seed}") for seed in range(3)]
    again = [background(repo_root, f"transport.background_seed={seed}") for seed in (2, 1, 0)]
    assert again[0] is known[2]
    assert again[1] is known[1]
    assert again[2] is not known[0]


def test_a_seed_of_its_own_gives_the_same_light_to_all_seeds(device: Device, repo_root: Path) -> None:
    first = background(repo_root, OWN_SEED, "seed=1").in_band.numpy().tobytes()
    background(repo_root, "seed=4")
    background(repo_root, "seed=5")
    assert background(repo_root, OWN_SEED, "seed=2").in_band.numpy().tobytes() == first
    assert background(repo_root, "seed=3").in_band.numpy().tobytes() == first


def asked(rows: int, ratio: float = 1.0, dark: bool = False, **changes: Any) -> tuple[Any, ...]:
    """Return scene, optics, sky, view, settings and seed of a panorama, with numbers changed by their names."""
    loaded = SimpleNamespace(
        bodies=(),
        kept={},
        out_of_band_ratio=SimpleNamespace(numpy=lambda: np.array([1.0, ratio])),
        dark_in_band=SimpleNamespace(numpy=lambda: np.array([False, dark])),
    )
    receiver = {"baseline": 0.2, "focal_length": 0.1}
    layout = {"axis_separation": 0.05, "axes": None, "pitch": 5e-5, "height": 2e-4, "point_spread": 1e-5}
    view = {"first": 0.0, "step": 1e-3, "bins": 13, "rows": rows, "between": True, "phi": np.zeros(rows)}
    settings = {"background_bounces": 2, "background_samples": 4}
    sky = {"sun_direction": np.array([0.0, 0.0, -1.0]), "sun_angular_radius": 4.65e-3}
    given = [
        {name: changes.get(name, value) for name, value in part.items()}
        for part in (receiver, layout, sky, view, settings)
    ]
    return (
        loaded,
        SimpleNamespace(receiver=SimpleNamespace(**given[0]), **given[1]),
        Sky(**given[2]),
        SimpleNamespace(**given[3]),
        Transport(**given[4]),
        changes.get("seed", 1),
    )


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("axis_separation", 0.06), ("axes", (0.0, 1e-3)), ("axes", (1e-3, 0.0)), ("baseline", 0.21),
        ("focal_length", 0.11), ("pitch", 4e-5), ("height", 1e-4), ("point_spread", 2e-5), ("first", 1e-4),
        ("step", 2e-3), ("bins", 12), ("between", False), ("phi", np.array([0.0, 1e-3, 0.0])),
        ("background_bounces", 1), ("background_samples", 2), ("seed", 2), ("ratio", 0.9), ("dark", True),
        ("sun_direction", np.array([0.0, 0.6, -0.8])), ("sun_angular_radius", 5e-3),
    ],
)  # fmt: skip
def test_light_is_known_only_where_all_that_forms_it_is_alike(
    monkeypatch: pytest.MonkeyPatch, name: str, value: Any
) -> None:
    """Claim: whatever of optics, pixels, bins, settings, materials and sky is another, its light is rendered anew, and
    the light of the first is known beside it."""
    monkeypatch.setattr(panorama, "render_panorama", lambda *_, **__: object())
    monkeypatch.setattr(panorama, "light_of", lambda sky: sky)
    first, other = asked(3), asked(3, **{name: value})
    other[0].kept = first[0].kept
    found, changed = panorama.known_panorama(*first), panorama.known_panorama(*other)
    assert changed is not found
    assert panorama.known_panorama(*first) is found
    assert panorama.known_panorama(*other) is changed


@pytest.mark.parametrize(("rows", "kept"), [(7, True), (8, False)])
def test_panoramas_of_so_many_bins_are_kept(
    device: Device, monkeypatch: pytest.MonkeyPatch, rows: int, kept: bool
) -> None:
    """Claim: one of as many bins as are kept at most, rows times bins, stays with its scene, and a larger one not."""
    monkeypatch.setattr(panorama, "_MOST_KEPT", 7 * 13)
    monkeypatch.setattr(panorama, "render_panorama", lambda *_, **__: object())
    given = asked(rows)
    found = [panorama.known_panorama(*given) for _ in range(2)]
    assert (found[0] is found[1]) == kept
    assert len(given[0].kept) == kept


@pytest.mark.parametrize(
    ("light", "background_of", "seeds"),
    [(None, None, (5, 5)), (7, None, (7, 7)), (None, 3, (5, 3)), (7, 0, (7, 0)), (0, None, (0, 0))],
)
def test_the_seed_of_light_is_the_backgrounds_too_unless_it_has_its_own(
    light: int | None, background_of: int | None, seeds: tuple[int, int]
) -> None:
    own = Transport(light_seed=light, background_seed=background_of)
    assert (own.seed_of_light(5), own.seed_of_background(5)) == seeds


def test_a_shot_beyond_the_rows_sees_the_last_of_them(device: Device) -> None:
    """Claim: between rows a shot lies where its φ does, and beyond them at the first or the last; a raster's shots
    stand in the rows of their numbers."""
    import mitsuba as mi

    phi = np.array([-0.2, -0.17, -0.14, -0.11])
    shots: Any = SimpleNamespace(
        phi=mi.Float([-0.3, -0.2, -0.185, -0.12, -0.11, 0.4]), number=mi.UInt32([0, 6, 7, 13, 14, 27])
    )
    index = mi.UInt32([5, 4, 3, 2, 1, 0])
    between = PanoramaView(phi, 0.0, 1e-3, 9, between=True).row(shots, index, 7)
    np.testing.assert_allclose(between.numpy(), [3.0, 3.0, 8.0 / 3.0, 0.5, 0.0, 0.0], atol=1e-5)
    assert PanoramaView(phi, 0.0, 1e-3, 9).row(shots, index, 7).numpy().tolist() == [3, 2, 1, 1, 0, 0]


def test_slots_are_halved_until_nothing_moves_by_more_than_a_bin() -> None:
    """Claim: in a slot of 2⁻ʰ s nothing moves by more than a bin, and in twice the slot it would; six halvings at most.
    Rows that lie farther apart than two bins get as many more samples, 64 times at most."""
    for speed in (1e-4, 2.9e-3, 3.1e-3, 0.02, 0.1, 0.19, 5.0):
        halvings = slot_halvings(speed, 3e-3)
        assert 0 <= halvings <= 6
        assert speed * 0.5**halvings <= 3e-3 or halvings == 6
        assert halvings == 0 or speed * 0.5 ** (halvings - 1) > 3e-3
    assert [times_finer(step, 1e-3) for step in (5e-4, 2e-3, 6.1e-3, 0.02, 0.127, 0.3)] == [
        1,
        1,
        3,
        10,
        64,
        64,
    ]
