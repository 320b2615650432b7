"""Late light against mitransient, an independent time-resolved path tracer for Mitsuba (Royo et al., 2025)."""

from __future__ import annotations

import numpy as np
import pytest
from prototype import Laser

from scanner_sim.config.scanner import Scanner
from scanner_sim.scene.objects import Scene

pytestmark = pytest.mark.usefixtures("device")

CONE = np.deg2rad(3.0)
HALF_FIELD = 1.0
START, WIDTH, BINS = 8.2, 0.2, 10


def by_mitransient(samples: int, seed: int) -> np.ndarray:
    """Return the share per lens area [1/m²] in each bin of the way, for light over two surfaces of a corner."""
    import mitransient  # noqa: F401 (it registers its plugins)
    import mitsuba as mi

    grey = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": 0.5}}
    back = mi.ScalarTransform4f().translate([0, 0, 4]).rotate([0, 1, 0], 180).scale(200)
    side = mi.ScalarTransform4f().translate([0.6, 0, 4]).rotate([0, 1, 0], -90).scale(200)
    size, edge = 128, np.tan(np.deg2rad(60.0))
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "transient_path", "max_depth": 3, "rr_depth": 99, "camera_unwarp": False},
            "sensor": {
                "type": "perspective",
                "fov": 120.0,
                "near_clip": 1e-3,
                "to_world": mi.ScalarTransform4f().look_at([0, 0, 0], [0, 0, 1], [0, 1, 0]),
                "film": {
                    "type": "transient_hdr_film",
                    "width": size,
                    "height": size,
                    "temporal_bins": BINS,
                    "start_opl": START,
                    "bin_width_opl": WIDTH,
                    "rfilter": {"type": "box"},
                },
                "sampler": {"type": "independent", "sample_count": samples},
            },
            "laser": {
                "type": "spot",
                "to_world": mi.ScalarTransform4f().look_at([0, 0, 0], [0, 0, 1], [0, 1, 0]),
                "cutoff_angle": float(np.rad2deg(CONE)),
                "beam_width": float(np.rad2deg(CONE)) * 0.9999,
                "intensity": 1.0,
            },
            "back": {"type": "rectangle", "to_world": back, "bsdf": grey},
            "side": {"type": "rectangle", "to_world": side, "bsdf": grey},
        }
    )
    _, transient = mi.render(scene, seed=seed, spp=samples)
    radiance = np.array(transient, dtype=np.float64).reshape(size, size, BINS, -1)[..., 0]
    place = (np.arange(size) + 0.5) / size * 2 * edge - edge
    squared = place[:, None] ** 2 + place[None, :] ** 2
    weight = (2.0 * edge / size) ** 2 / (1.0 + squared) ** 2 * (squared <= np.tan(HALF_FIELD) ** 2)
    power = 2.0 * np.pi * (1.0 - np.cos(CONE))
    return np.asarray((radiance * weight[:, :, None]).sum(axis=(0, 1)) / power)


def by_beamlets(shots: int, paths: int) -> np.ndarray:
    """Return the same by the simulator, shape (shots, bins): thin beams over the same cone."""
    import drjit as dr
    import mitsuba as mi

    from scanner_sim.render.beam.beamlets import edge_beamlets
    from scanner_sim.render.beam.bounces import trace_bounces
    from scanner_sim.render.beam.path_projection import PathProjection
    from scanner_sim.render.shots import Shots
    from scanner_sim.render.transport import OpticalLayout
    from scanner_sim.scene.files.loader import load_scene

    scanner = Scanner()
    sensor, receiver = scanner.position_sensor, scanner.receiver
    # No distance between the axes: all beams leave one point, as the other program's spot light does.
    laser = Laser(waist_radius=0.2e-3, wavelength=0.3e-6)
    bench = OpticalLayout(
        laser, receiver, 0.0, 1.0, sensor.pitch, sensor.height, sensor.offset, sensor.diffusion
    )
    common = {"shape": "rectangle", "size": (400.0, 400.0), "material": {"reflectance": 0.5}}
    turned = {"axis": "y", "angle": -0.5 * np.pi}
    walls = (
        {"name": "back", "position": (0.0, 0.0, 4.0), **common},
        {"name": "side", "position": (0.6, 0.0, 4.0), "rotation": turned, **common},
    )
    random = np.random.default_rng(4)
    cosine, around = random.uniform(np.cos(CONE), 1.0, shots), random.uniform(0.0, 2.0 * np.pi, shots)
    sine = np.sqrt(1.0 - cosine**2)
    x, y = sine * np.cos(around), sine * np.sin(around)
    angles = np.arcsin(x), np.arctan2(y, cosine)
    fired = Shots(dr.arange(mi.UInt32, shots), *(mi.Float(angle.astype(np.float32)) for angle in angles))
    beamlets, projection = edge_beamlets(paths), PathProjection(bench, False, 2.0 * HALF_FIELD)
    loaded = load_scene(Scene(objects=walls))
    late = trace_bounces(loaded, projection, beamlets, 2, fired, 0, dr.full(mi.Float, 8.0, shots))
    area = receiver.aperture_area * receiver.transmission
    share, way = (values.numpy().reshape(shots, paths) for values in (late.power, late.position))
    edges = START + WIDTH * np.arange(BINS + 1)
    return np.array(
        [np.histogram(w + 8.0, edges, weights=s / area)[0] for w, s in zip(way, share, strict=True)]
    )


@pytest.mark.slow
def test_late_light_agrees_with_mitransient() -> None:
    """Claim: the waveform of light over two surfaces of a corner is that of an independent transient path tracer.

    Set-up: a cone of 3° onto a wall at 4 m with a side wall at x = 0.6 m, seen from the light's place within ±1 rad;
    20 000 thin beams of 128 paths, against 8 renderings. Expected: equal power per bin of the way, ten bins of 0.2 m
    from 8.2 m on, behind the direct light. Tolerance: |z| < 4.5 in each bin, errors (1 % in the fullest) from the
    scatter of beams and of renderings; 3 % of the sum, which is known to 0.7 %.
    """
    renderings = np.array([by_mitransient(1024, seed) for seed in range(8)])
    beams = by_beamlets(20_000, 128)
    other, own = renderings.mean(axis=0), beams.mean(axis=0)
    error = np.hypot(
        renderings.std(axis=0, ddof=1) / np.sqrt(8.0), beams.std(axis=0, ddof=1) / np.sqrt(len(beams))
    )
    assert np.abs((own - other) / error).max() < 4.5
    assert own.sum() == pytest.approx(other.sum(), rel=0.03)
