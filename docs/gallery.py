"""Pictures of the gallery: ``python docs/gallery.py [NAME …]`` runs their scenarios and writes ``docs/pictures``."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PICTURES = ROOT / "docs" / "pictures"
MADE = {
    "node_512_range": ("node_512", "range.png", ()),
    "node_512_shaded": ("node_512", "shaded.png", ()),
    "own_mesh": ("own_mesh", "range.png", ()),
    "sunlight": ("lighting_partial_shadow", "camera.png", ()),
    "background": ("lighting_normal", "background.png", ()),
    "retro_signal": ("retro_targets", "signal.png", ()),
    "moving": ("moving_plate", "range.png", ()),
    "time_of_flight": ("tof_node", "tof.png", ("scan.rows=256", "scan.columns=256")),
    "docking_pose": ("track_moving", "pose.png", ()),
    "docking_track": ("track_moving", "track.png", ()),
    "camera_frame": ("camera_and_scanner", "frames.png", ("output.frames=true",)),
    "camera_pose": ("camera_and_scanner", "pose.png", ("output.frames=true",)),
}
"""For each picture: scenario, file of the run, and changes."""

APPROACHES = {"approach": ("v_bar", "approach.png"), "conditions": ("lights", "conditions.png")}
"""Pictures of approaches, and the file of each."""

GUIDE = ROOT / "docs" / "guides" / "mesh.md"
SHOWN = {"guide_mesh_range": "range.png", "guide_mesh_camera": "camera.png"}
"""Pictures of the guide to own meshes, made by its own examples."""


def guide_pictures() -> None:
    """Follow the guide up to the mesh in sunlight, and keep three of its pictures."""
    blocks = re.findall(
        r"^```(\w+)(?: title=\"([^\"]+)\")?\n(.*?)^```", GUIDE.read_text(encoding="utf-8"), re.M | re.S
    )
    with tempfile.TemporaryDirectory() as folder:
        for language, title, text in blocks:
            if title:
                Path(folder, title).write_text(text, encoding="utf-8")
            elif language == "python" and "export" in text:
                subprocess.run([sys.executable, "-c", text], cwd=folder, check=True)
        program = [sys.executable, "-m", "scanner_sim"]
        run = ["run", "my_part_lit.yaml", "-o", "lit", "-q"]
        scene = ["scene", "my_part.yaml", "-o", str(PICTURES / "guide_mesh_scene.png"), "--overwrite", "-q"]
        for command in (run, scene):
            subprocess.run(program + command, cwd=folder, check=True)
        for name, picture in SHOWN.items():
            shutil.copy(Path(folder, "lit", picture), PICTURES / f"{name}.png")


def line_picture() -> None:
    """Draw a line of a wall in weak light before and after noise, for the guide to kept lines."""
    program = [sys.executable, "-m", "scanner_sim"]
    with tempfile.TemporaryDirectory() as folder:
        run = [
            "run",
            "configs/plane.yaml",
            "-o",
            f"{folder}/run",
            "-q",
            "--set",
            "scanner.laser.power=0.7 mW",
        ]
        subprocess.run(program + run, cwd=ROOT, check=True)
        show = ["show", f"{folder}/run", "--voxel", "30", "30", "-o", folder]
        subprocess.run(program + show, cwd=ROOT, check=True)
        shutil.copy(Path(folder, "voxel_30_30.png"), PICTURES / "line.png")


def approach_picture(name: str) -> None:
    """Fly a shipped approach, and keep its picture."""
    approach, picture = APPROACHES[name]
    with tempfile.TemporaryDirectory() as folder:
        fly = ["approach", f"configs/approach/{approach}.yaml", "-o", folder, "-q"]
        subprocess.run([sys.executable, "-m", "scanner_sim", *fly], cwd=ROOT, check=True)
        shutil.copy(Path(folder, picture), PICTURES / f"{name}.png")


def main(names: list[str]) -> None:
    approaches = [name for name in APPROACHES if not names or name in names]
    pictures([name for name in names or MADE if name not in APPROACHES])
    for name in approaches:
        approach_picture(name)
    if not names:
        guide_pictures()
        line_picture()


def pictures(names: list[str]) -> None:
    """Run the scenarios of some pictures."""
    done: dict[tuple[str, tuple[str, ...]], Path] = {}
    with tempfile.TemporaryDirectory() as folder:
        for name in names:
            config, picture, changes = MADE[name]
            if (config, changes) not in done:
                output = Path(folder, name)
                command = [
                    sys.executable,
                    "-m",
                    "scanner_sim",
                    "run",
                    f"configs/{config}.yaml",
                    "-o",
                    str(output),
                    "-q",
                ]
                for change in changes:
                    command += ["--set", change]
                subprocess.run(command, cwd=ROOT, check=True)
                done[config, changes] = output
            shutil.copy(done[config, changes] / picture, PICTURES / f"{name}.png")


if __name__ == "__main__":
    main(sys.argv[1:])
