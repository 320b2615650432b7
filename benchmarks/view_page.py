"""What a frame of the page of a result costs: JavaScript, calls of WebGL, the whole frame of this machine's Chromium.

    pip install playwright
    scanner-sim run configs/quickstart.yaml --set scan.rows=512 --set scan.columns=512 -o output/large
    scanner-sim view output/large
    python benchmarks/view_page.py output/large/view.html

Playwright drives the Chromium that is installed; it is no dependency of the program. Without a graphics card Chromium
draws on the processor, and the time of a whole frame is that of this.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

MEASURE = """async () => {
  const { space, shading, cloud, choose } = await page, gl = space.renderer.getContext();
  const ends = [];
  for (const until = performance.now() + 4000; performance.now() < until; ) {
    ends.push(await new Promise(requestAnimationFrame));
    space.turn(0.03, 0);
  }
  const turning = (1000 * (ends.length - 1)) / (ends.at(-1) - ends[0]), thinned = space.pace.share;
  space.card = true; // what follows is at full resolution
  let calls = 0;
  for (const name of Object.getOwnPropertyNames(Object.getPrototypeOf(gl))) {
    const about = Object.getOwnPropertyDescriptor(Object.getPrototypeOf(gl), name);
    if (typeof about.value !== "function") continue;
    const call = gl[name].bind(gl);
    gl[name] = (...values) => { calls++; return call(...values); };
  }
  const each = (count, work) => {
    const start = performance.now();
    for (let i = 0; i < count; i++) work(i);
    return (performance.now() - start) / count;
  };
  const frame = () => { space.turn(0.01, 0); space.moving = false; space.render(); };
  const dot = new Uint8Array(4), finish = () => gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, dot);
  frame();
  finish();
  calls = 0;
  const script = each(60, frame), perFrame = calls / 60;
  finish();
  return {
    "frames a second while turning": turning,
    "share of the points then": thinned,
    "points": space.renderer.info.render.points,
    "JavaScript of a frame [ms]": script,
    "calls of WebGL in a frame": perFrame,
    "whole frame, all points drawn [ms]": each(10, () => { frame(); finish(); }),
    "new colours [ms]": each(10, () => shading.fill(cloud.colours, cloud.positions)),
    "point under the pointer [ms]": each(10, (i) => space.under(cloud, 400 + i, 400)),
    "panel of a voxel [ms]": each(10, (i) => choose(1000 + i)),
  };
}"""


def main(path: Path) -> None:
    """Measure a page and print what was found."""
    from playwright.sync_api import sync_playwright

    browser = shutil.which("chromium") or shutil.which("google-chrome")
    options = ["--no-sandbox", "--enable-unsafe-swiftshader"]
    with sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=browser, args=options)
        tab = chromium.new_page(viewport={"width": 1300, "height": 850})
        tab.goto(path.resolve().as_uri())
        tab.wait_for_function("document.documentElement.dataset.state === 'ready'", timeout=120_000)
        for name, value in tab.evaluate(MEASURE).items():
            print(f"{name:36}{value:,.3g}" if name != "points" else f"{name:36}{value:,}")
        chromium.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
