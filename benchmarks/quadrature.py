"""How far the light of a raster errs, by kind of ground: against 2048 beamlets with a moment of their own each.

Run as ``python benchmarks/quadrature.py [--shots N] [--config FILE] [--edge K ...] [--uneven K ...]``. Shots are drawn
from the raster of a scenario in the dark; both times they have the same noise, so that peaks differ by the quadrature
alone. Errors are in units of the σ that the instrument states for the peak before it knows the neighbours; power and
width are medians and 90 %, the last column is the share of shots whose status differs. The table of
docs/theory/light.md.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from scanner_sim import load_scenario
from scanner_sim.foundation.status import Status
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.render.settings import Transport
from scanner_sim.scan.raster import raster_aim

ROOT = Path(__file__).parents[1]
NODE = ROOT / "configs" / "node_512.yaml"
REFERENCE = 2048
KINDS = ("smooth", "uneven", "edge")


class Ground:
    """Shots of a raster, sorted by what their beams meet, and what the line reads of them."""

    def __init__(self, instrument: Instrument, shots: int) -> None:
        from scanner_sim.render.beam import splitter

        self.instrument, scenario = instrument, instrument.scenario
        scan, random = scenario.raster, np.random.default_rng(1)
        chosen = np.sort(random.choice(scan.shots, min(shots, scan.shots), replace=False))
        self.aim = raster_aim(scan, chosen.astype(np.uint32), scenario.scanner.dwell)
        self.kind = np.zeros(len(chosen), dtype=np.uint32)
        classify = splitter._classify_footprints

        def noted(*given: Any) -> Any:
            found = classify(*given)
            # Edges that part a beam in two have a code of their own above.
            self.kind = np.minimum(found.numpy(), KINDS.index("edge"))
            return found

        splitter._classify_footprints = noted
        self.usual = self.read(Transport())
        splitter._classify_footprints = classify

    def read(self, transport: Transport) -> dict[str, Any]:
        """Return power, centroid and width of the light, and the peaks, of all shots."""
        from scanner_sim.render.beam.line_projection import LineProjection
        from scanner_sim.render.beam.splitter import render_light

        bench, seed = self.instrument, self.instrument.scenario.seed
        shots = bench.fire(self.aim)[0]
        truth, lights = render_light(bench.loaded, LineProjection(bench.optics), transport, shots, seed)
        names = ("power", "centroid", "width", "peak", "sigma", "status")
        found = {name: np.zeros(len(self.aim.shot)) for name in names}
        for light in lights:
            index = light.index.numpy()
            theta = self.aim.theta[index].astype(np.float32)
            own, met = shots.take(light.index), truth.take(light.index)
            peaks = bench.triangulation.sense(light, own, met, type(own.theta)(theta), None)[2]
            amount, place, sigma = (
                part.numpy().reshape(light.count, -1).astype(np.float64)
                for part in (light.amount, light.position, light.sigma)
            )
            with np.errstate(invalid="ignore"):
                power = amount.sum(axis=0)
                mean = (amount * place).sum(axis=0) / power
                width = np.sqrt((amount * (sigma**2 + (place - mean) ** 2)).sum(axis=0) / power)
            values = (power, mean, width, peaks.position.numpy(), peaks.sigma.numpy())
            for name, column in zip(names, (*values, peaks.status.numpy()), strict=True):
                found[name][index] = column
        return found

    def reference(self) -> dict[str, Any]:
        """Return the same by many beamlets on every ground, each with one moment."""
        import drjit as dr
        import mitsuba as mi

        from scanner_sim.render.beam import splitter
        from scanner_sim.render.beam.swept_beamlets import SweptTables

        kept = splitter._classify_footprints, SweptTables.averaged

        def edge(*given: Any) -> Any:
            return dr.full(mi.UInt32, splitter._EDGE, dr.width(given[-1]))

        splitter._classify_footprints, SweptTables.averaged = edge, SweptTables.of
        found = self.read(Transport(edge_beamlets=REFERENCE))
        splitter._classify_footprints, SweptTables.averaged = kept
        return found


def rows(ground: Ground, found: dict[str, Any], right: dict[str, Any], counts: dict[str, int]) -> None:
    """Print a row of the table for each kind of ground."""
    for number, kind in enumerate(KINDS):
        lit = (ground.kind == number) & (right["power"] > 0.0)
        ours, theirs = ({name: values[lit] for name, values in one.items()} for one in (found, right))
        both = (ours["status"] == Status.VALID) & (theirs["status"] == Status.VALID)
        cells = [f"{100.0 * np.mean(ground.kind == number):.1f} %", str(counts[kind])]
        for name in ("centroid", "peak"):
            error = np.abs(ours[name] - theirs[name])[both] / theirs["sigma"][both]
            middle, most, last = np.percentile(error, (50, 90, 99))
            rms = np.sqrt(np.mean(np.minimum(error, 10.0) ** 2))
            cells.append(f"{middle:.3f}, {most:.2f}, {last:.2f}; {rms:.2f}")
        for name in ("power", "width"):
            error = np.abs(ours[name] / theirs[name] - 1.0)[both]
            cells.append(f"{100.0 * np.median(error):.2f} %, {100.0 * np.percentile(error, 90):.1f} %")
        cells.append(f"{100.0 * np.mean(ours['status'] != theirs['status']):.2f} %")
        print(f"| {kind} | " + " | ".join(cells) + " |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--shots", type=int, default=8192)
    parser.add_argument("--config", type=Path, default=NODE)
    parser.add_argument("--edge", type=int, nargs="*", default=[])
    parser.add_argument("--uneven", type=int, nargs="*", default=[])
    given = parser.parse_args()
    ground = Ground(Instrument(load_scenario(given.config), device="cpu"), given.shots)
    right = ground.reference()
    about = "centroid: median, 90 %, 99 %; rms [σ] | peak, the same | power | width | status"
    print(f"| ground | share | beamlets | {about} |")
    print("|---|---|---|---|---|---|---|---|")
    usual = Transport()
    counts = {"smooth": 7, "uneven": usual.uneven_beamlets, "edge": usual.edge_beamlets}
    rows(ground, ground.usual, right, counts)
    for edge, uneven in zip(given.edge, given.uneven, strict=True):
        other = ground.read(Transport(edge_beamlets=edge, uneven_beamlets=uneven))
        rows(ground, other, right, {"smooth": 7, "uneven": uneven, "edge": edge})


if __name__ == "__main__":
    main()
