"""Warnings: scenarios that are possible but probably not meant."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

from scanner_sim.config.calibration import believed_instrument
from scanner_sim.config.scanner import RangefinderName
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.errors import printable
from scanner_sim.optics.filter import filter_warnings
from scanner_sim.pose.identify_dots import FEWEST as FEWEST_DOTS
from scanner_sim.scene.light.lighting import lighting_warnings
from scanner_sim.scene.materials import MATERIALS
from scanner_sim.scene.motion import ConstantTwist
from scanner_sim.scene.moves import Moves
from scanner_sim.scene.objects import Posed, materials_of
from scanner_sim.scene.relative_orbit import RelativeOrbit
from scanner_sim.scene.retroreflectors import RetroLobe
from scanner_sim.scene.surfaces import Retroreflector
from scanner_sim.scene.targets import target_positions
from scanner_sim.signals.processing import MARGIN
from scanner_sim.tracking.warnings import track_warnings

_NARROWEST = 0.35
"""Standard deviation of a spot [pixel] below which its light is in one pixel nearly everywhere."""
_WIDEST_MASS = 1.3
"""That from which the seven pixels of the centre of mass cut the spot: they do not reach 2.7 of it."""
_WIDEST_FIT = 8.0
"""That from which 24 pixels to each side do not reach three of it."""
_FEW_GRAINS = 1.5
"""Standard deviation of the beam's image, in grains λN, below which it has few of them."""
_FAR_OFF, _LOOKED_AT = 100.0, 65
"""Farthest range at which the speckle is looked at, over the nearest, and number of ranges."""

_MOTION_INSTANTS = 257
"""Instants of a scan at which motions are looked at."""
_LARGEST_BLUR = 0.3
"""Motion during a dwell, in radii of the beam, beyond which it could be seen in the spot."""
_LARGEST_SWEEP = 8.0
"""Spot diameters that a sweep may cover in a dwell before the mean over it says little of any one position."""
_LARGEST_SHADOW_ERROR = 3.0
"""Error of a shadow's position in pixels that could be seen in the background."""
_LARGEST_SHADOW_SHARE = 0.5
"""The same for a photodiode, in fields of view."""
_EDGE_ON = 0.2
"""Share of its area that an array shows, below which nothing of its discs is measured, however large their plates."""


def _scene(scenario: Scenario) -> Iterator[str]:
    scene = scenario.scene
    if scene.file is None and not scene.objects:
        yield "scene: it is empty, so no voxel will have a return"
    for index, item in enumerate(scene.objects):
        if scene.file is not None and item.name == printable(scene.file.stem):
            yield (
                f"scene.objects[{index}].name: '{item.name}' is the name of scene.file, too: to results both are one "
                "object; give it another name"
            )
        x, y, z = item.pose_at(0.0)[0, :3, 3]
        if (x, y, z) == (0.0, 0.0, 0.0):
            yield f"scene.objects[{index}]: '{item.name}' stands at the scanner; give it a position"
        elif z <= 0.0:
            yield f"scene.objects[{index}]: '{item.name}' has its origin behind the scanner (z = {z:g} m)"


def _nearer(scenario: Scenario) -> Iterator[str]:
    nearest = scenario.scanner.nearest_range
    for index, item in enumerate(scenario.scene.objects):
        x, y, z = item.pose_at(0.0)[0, :3, 3]
        if z > 0.0 and math.hypot(x, y, z) < nearest:
            yield (
                f"scene.objects[{index}]: '{item.name}' has its origin at {math.hypot(x, y, z):.3g} m, nearer than "
                f"the {nearest:.3g} m that the array sees"
            )


def _motions(scenario: Scenario) -> Iterator[str]:
    """Warn of motions that do not take place in the time of the scan, or are too fast for its dwell."""
    scanner, scan = scenario.scanner, scenario.scan
    duration = scan.scan_time(scenario.scan_setup)
    time, lit = np.linspace(0.0, duration, _MOTION_INSTANTS), not scenario.lighting.sky().dark
    for index, item in enumerate(scenario.scene.objects):
        if not item.moves:
            continue
        location = f"scene.objects[{index}].motion: '{item.name}'"
        poses = item.pose_at(time)
        if unused := _unused(item):
            yield f"{location} {unused}"
        if np.ptp(poses, axis=0).max() == 0.0:
            yield f"{location} does not move in the {duration:.3g} s of the scan"
            continue
        origin = poses[:, :3, 3]
        way = np.linalg.norm(np.diff(origin, axis=0), axis=1) * scanner.dwell / (time[1] - time[0])
        far = np.linalg.norm(origin[1:], axis=1)
        blur = way / np.array([scanner.laser.radius(float(distance)) for distance in far])
        if "triangulation" in scenario.rangefinders and blur.max() > _LARGEST_BLUR:
            yield (
                f"{location} moves by up to {1e3 * way.max():.2g} mm during a dwell, {blur.max():.2g} of the beam's "
                "radius: this blur is left out"
            )
        if (
            scan.layout == "image"
            and lit
            and (way * scan.columns > 2.0 * _largest_shadow_error(scenario) * far).any()
        ):
            yield (
                f"{location} moves by up to {1e3 * way.max() * scan.columns:.2g} mm during a row: the background is "
                "that of the row's middle, and lags or leads by half of it at the ends"
            )


def _unused(item: Posed) -> str:
    """Return in words what of an object's own pose its motion does not ask for; empty where that is nothing."""
    motion, away = item.motion, item.position != (0.0, 0.0, 0.0)
    first = motion.before or motion if isinstance(motion, Moves) else motion
    if first is None or isinstance(first, ConstantTwist):
        return ""
    if isinstance(first, RelativeOrbit):
        return f"is placed by its {first.type}: its position is not used" if away else ""
    return (
        f"is placed by its {first.type}: its position and rotation are not used"
        if away or item.rotation
        else ""
    )


def _largest_shadow_error(scenario: Scenario) -> float:
    """Return the error of a shadow's direction that could be seen in the background [rad]."""
    scanner = scenario.scanner
    if "triangulation" in scenario.rangefinders:
        return _LARGEST_SHADOW_ERROR * scanner.position_sensor.pitch / scanner.receiver.focal_length
    return _LARGEST_SHADOW_SHARE * scanner.lidar.photodiode.field_of_view


def _sweep(scenario: Scenario) -> Iterator[str]:
    """Warn of a scan so coarse that each voxel is the mean over a long stripe of the surface."""
    scan, laser = scenario.scan, scenario.scanner.laser
    if scan.layout == "visits":
        return
    sweep = scan.sweep(scenario.scan_setup)
    duty_cycle = sweep.angle * scenario.scanner.exposure / scenario.scanner.dwell
    widest, name, far = 0.0, "", 0.0
    for item in scenario.scene.objects:
        distance = math.hypot(*item.pose_at(0.0)[0, :3, 3])
        diameters = duty_cycle * distance / (2.0 * laser.radius(distance))
        if diameters > widest:
            widest, name, far = diameters, item.name, distance
    if widest > _LARGEST_SWEEP:
        yield (
            f"{sweep.key}: at the {far:.3g} m of '{name}' the spot sweeps {widest:.2g} of its diameters while a voxel "
            f"is measured; edges and texture finer than that stay unseen and move ranges; {sweep.remedy}"
        )


def _array_gate(scenario: Scenario) -> Iterator[str]:
    yield from _gate_beyond(scenario, "triangulation", "that the array sees")


def _record_gate(scenario: Scenario) -> Iterator[str]:
    yield from _gate_beyond(scenario, "tof", "that scanner.lidar.digitiser.gate records")


def _gate_beyond(scenario: Scenario, rangefinder: RangefinderName, seen: str) -> Iterator[str]:
    gate, (nearest, farthest) = scenario.processing.range_gate, scenario.scanner.seen_by(rangefinder)
    if gate is not None and (gate[0] < nearest or gate[1] > farthest):
        yield f"processing.range_gate: it reaches beyond the ranges {seen}, {nearest:.4g} m to {farthest:.4g} m"


def _record(scenario: Scenario) -> Iterator[str]:
    """Warn of objects outside of the record, and of those among them whose echoes come with those of other pulses."""
    lidar = scenario.scanner.lidar
    nearest, farthest = lidar.digitiser.gate
    for index, item in enumerate(scenario.scene.objects):
        distance = math.hypot(*item.pose_at(0.0)[0, :3, 3])
        if nearest <= distance <= farthest:
            continue
        apparent = lidar.apparent_range(distance)
        taken = (
            f"; its echoes are taken for those of a surface at {apparent:.4g} m, as the pulses repeat every "
            f"{lidar.pulse.ambiguity_range:.4g} m: lower scanner.lidar.pulse.repetition_rate"
        )
        yield (
            f"scene.objects[{index}]: '{item.name}' has its origin at {distance:.3g} m, outside of what "
            f"scanner.lidar.digitiser.gate records, {nearest:.4g} m to {farthest:.4g} m"
            + (taken if nearest <= apparent <= farthest else "")
        )


def _pointing(scenario: Scenario) -> Iterator[str]:
    scan, scanner = scenario.scan, scenario.scanner
    if scan.layout == "visits":
        limit = scanner.mirrors.max_deflection
        yield from track_warnings(scan, scenario.targets, scanner.galvanometers, scanner.dwell, limit)
        believed = believed_instrument(scenario)
        if believed is not None and believed.vibration is not None:
            yield (
                "processing.calibration: it has a vibration, which the σ of tracked visits and poses does not hold; "
                "they err by more than they state"
            )
    else:
        yield from scan.warnings(scenario.scan_setup)


def _plates(scenario: Scenario) -> Iterator[str]:
    """Warn of plates that a search runs out of, over what lies behind, which may be as dark as a disc.

    A pattern's corners reach furthest: they are looked at as an array hangs, and at any roll where it moves.
    """
    scan, laser = scenario.scan, scenario.scanner.laser
    if scan.layout != "visits":
        return
    far = {target.object: float(target.expected[2]) for target in scenario.targets}
    for item in scenario.arrays_followed:
        index, pattern, distance = scenario.scene.objects.index(item), item.array, far[item.name]
        corner = 0.5 * pattern.diameter * scan.tracker.search_amplitude * np.array([1.0, scan.pattern.aspect])
        across = float(np.hypot(*corner))
        if not item.moves:
            seen = item.pose_at(0.0)[0, :2, :2]
            if abs(np.linalg.det(seen)) < _EDGE_ON:
                continue
            across = float(np.abs(np.linalg.inv(seen) @ (corner * [[1.0, 1.0], [1.0, -1.0]]).T).max())
        needed = 2.0 * (across + laser.radius(distance))
        if pattern.plate < needed:
            yield (
                f"scene.objects[{index}].array.plate: patterns that search for discs of '{item.name}' reach over the "
                f"edge of plates of {pattern.plate:.4g} m, and what is behind may be taken for a disc: nothing is "
                f"found then; enlarge the plates to {math.ceil(1e3 * needed):d} mm, or make the discs smaller"
            )


def _estimator(scenario: Scenario) -> Iterator[str]:
    """Yield what detection makes of noise, and a peak estimator of spots too narrow or too wide for it."""
    if scenario.processing.threshold < 3.0:
        yield f"processing.threshold: at {scenario.processing.threshold:g} noise alone will be taken for returns"
    scanner, peak = scenario.scanner, scenario.processing.peak
    sensor, receiver = scanner.position_sensor, scanner.receiver
    farthest = min(scanner.farthest_range, scanner.nearest_range * sensor.pixels)
    half = 0.5 * receiver.focal_length / sensor.pitch

    def width(distance: float) -> float:
        """Return the standard deviation of the spot [pixel] at a range on the axis."""
        image, seen = scanner.laser.radius(distance) * half / distance, scanner.seen_at(distance)
        spread = (scanner.point_spread / sensor.pitch) ** 2
        return math.hypot(
            seen.along * image,
            math.sqrt(seen.spread(spread, (receiver.aberration / sensor.pitch) ** 2)),
        )

    for distance in (scanner.nearest_range, farthest):
        if width(distance) < _NARROWEST:
            yield (
                f"scanner.position_sensor.diffusion: at {distance:.3g} m the spot is narrower than a pixel, its "
                f"standard deviation {width(distance):.2g}; below {_NARROWEST:g} no estimator interpolates, "
                f"not {peak} either"
            )
            break
    window = MARGIN["centre_of_mass"]
    if peak == "centre_of_mass" and scenario.processing.bias_correction == "none":
        widest = max((scanner.nearest_range, farthest), key=width)
        if width(widest) > _WIDEST_MASS:
            yield (
                f"processing.peak: centre_of_mass reads {2 * window + 1} pixels and cuts the spot of "
                f"{width(widest):.2g} pixel (standard deviation) at {widest:.3g} m, which moves it by 0.03 pixel or "
                "more; set processing.bias_correction: computed, or choose maximum_likelihood"
            )
    ends = scanner.nearest_range, farthest
    widest = max(ends, key=width)
    if (widest_spot := width(widest)) > _WIDEST_FIT:
        blurred = abs(scanner.seen_at(widest).defocus) > 0.5 * widest_spot
        key = "receiver.focus_distance" if blurred else "laser.waist_radius"
        yield (
            f"scanner.{key}: at {widest:.3g} m the spot is {widest_spot:.2g} pixel wide "
            f"(standard deviation), and {peak} and the test of shape see its core only"
        )


def _speckle(scenario: Scenario) -> Iterator[str]:
    """Yield where σ by speckle is not good: few packets and a lens that blurs more than they are wide."""
    scanner = scenario.scanner
    if not scanner.laser.speckle:
        return
    cell = scanner.laser.wavelength * scanner.receiver.focal_length / scanner.receiver.aperture
    pitch, farthest = (
        scanner.position_sensor.pitch,
        min(scanner.farthest_range, _FAR_OFF * scanner.nearest_range),
    )
    found = []
    for step in range(_LOOKED_AT):
        distance = scanner.nearest_range * (farthest / scanner.nearest_range) ** (step / (_LOOKED_AT - 1))
        image = 0.5 * scanner.laser.radius(distance) * scanner.receiver.focal_length / distance
        seen = scanner.seen_at(distance)
        blur = math.hypot(seen.defocus * pitch / seen.across, scanner.receiver.aberration)
        if image < _FEW_GRAINS * cell and blur > image:
            found.append(distance)
    if found:
        yield (
            f"scanner.receiver.aperture: from {found[0]:.3g} m to {found[-1]:.3g} m the beam's image has few grains of "
            "speckle and the lens, by aberration or out of focus, blurs it by more than its width; σ by speckle is up "
            "to a quarter off there, and compare's speckle_limit tells it"
        )


def _lighting(scenario: Scenario) -> Iterator[str]:
    yield from lighting_warnings(scenario.lighting)


def _line_filter(scenario: Scenario) -> Iterator[str]:
    scanner, sensor = scenario.scanner, scenario.scanner.position_sensor
    steepest = math.atan(scanner.receiver.line_image.tangent(sensor.offset + sensor.length))
    yield from filter_warnings(scanner.filter, scanner.laser, sensor.response, steepest)


def _photodiode_filter(scenario: Scenario) -> Iterator[str]:
    scanner, response = scenario.scanner, scenario.scanner.lidar.photodiode.response
    yield from filter_warnings(scanner.filter, scanner.laser, response, detector="lidar.photodiode")


def _retro_reflectors(scenario: Scenario) -> Iterator[str]:
    """Warn of a limit on brightness that refuses what the scene holds; materials of Mitsuba's files are not known."""
    limit = scenario.processing.validation.max_reflectance
    for index, item in enumerate(scenario.scene.objects):
        for choice in materials_of(item):
            lobe, reflectance = _lobe(choice)
            # Along the normal, at no angle between laser and lens: D/4 of the lobe over 1/π.
            brightest = 0.0 if lobe is None else reflectance * lobe.retro_share / (2.0 * lobe.alpha) ** 2
            if limit is not None and brightest > limit:
                yield (
                    f"scene.objects[{index}]: '{item.name}' is a retro-reflector of up to {brightest:.3g} times white; "
                    f"where it is above processing.validation.max_reflectance, {limit:g}, it is refused"
                )


def _camera_sight(scenario: Scenario) -> Iterator[str]:
    """Look where the dots of arrays that are followed stand before the video camera when the run begins."""
    if scenario.scan.layout != "visits" or not scenario.photographed:
        return
    interior, mount = scenario.camera.interior, scenario.camera.scanner_from_camera
    for item in scenario.arrays_followed:
        pose = np.linalg.inv(mount) @ item.pose_at(0.0)[0]
        layout = item.array
        dots = target_positions(layout.rows, layout.columns, *layout.spacing) @ pose[:3, :3].T + pose[:3, 3]
        pixels = interior.project(dots) + 0.5
        seen = (pixels > 0.0) & (pixels < [interior.columns, interior.rows])
        # Discs face −z of their array.
        count = np.count_nonzero(seen.all(axis=1) & (dots @ pose[:3, 2] > 0.0))
        if count < FEWEST_DOTS:
            yield (
                f"camera: {count} of {len(dots)} dots of '{item.name}' stand in its frame and face it when the run "
                f"begins, and by fewer than {FEWEST_DOTS} it has no pose; see camera.mount"
            )


def _lobe(choice: object) -> tuple[RetroLobe | None, float]:
    if isinstance(choice, Retroreflector):
        return choice, choice.reflectance
    known = MATERIALS.get(choice) if isinstance(choice, str) else None
    return (None, 0.0) if known is None else (known.retro, known.reflectance)


_WARNINGS: dict[str, tuple[Callable[[Scenario], Iterator[str]], ...]] = {
    "triangulation": (_nearer, _sweep, _array_gate, _estimator, _speckle, _line_filter, _retro_reflectors),
    "tof": (_record, _record_gate, _photodiode_filter),
}
"""What is looked at for each rangefinder."""


def scenario_warnings(scenario: Scenario) -> tuple[str, ...]:
    """Return a sentence for everything that is possible but makes little sense."""
    own = (warnings for rangefinder in scenario.rangefinders for warnings in _WARNINGS[rangefinder])
    every = (_scene, _motions, _lighting, _pointing, _plates, _camera_sight, *own)
    # A filter that misses the laser misses it for all.
    return tuple(dict.fromkeys(words for warnings in every for words in warnings(scenario)))
