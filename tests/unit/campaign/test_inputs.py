"""The files of a campaign: which there are, what their digests notice, and where git has them."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import pytest

from scanner_sim.campaign.inputs import commits_of, digests_of
from scanner_sim.campaign.reading import read_campaign
from scanner_sim.campaign.store import opened
from scanner_sim.foundation.errors import InputError

SCENE = """\
<scene version="3.0.0">
    <default name="mesh" value="part.ply"/>
    <include filename="more.xml"/>
    <emitter type="envmap"><string name="filename" value="sky.exr"/></emitter>
</scene>
"""
MORE = '<scene version="3.0.0"><shape type="ply"><string name="filename" value="$mesh"/></shape></scene>'


@pytest.fixture
def plan(tmp_path: Path, small_scenario: str, repo_root: Path) -> Path:
    """A plan whose scenes are an XML file, which includes another that names a mesh, and a mesh of every second run."""
    for name in ("part.ply", "first.ply", "other.ply"):
        shutil.copy(repo_root / "tests" / "triangle.ply", tmp_path / name)
    (tmp_path / "scene.xml").write_text(SCENE, encoding="utf-8")
    (tmp_path / "more.xml").write_text(MORE, encoding="utf-8")
    part = "{name: part, mesh: first.ply, material: z93_white, position: [0 m, 0 m, 7 m]}"
    small = small_scenario.replace("  objects:", f"  file: scene.xml\n  objects:\n    - {part}")
    (tmp_path / "small.yaml").write_text(small, encoding="utf-8")
    (tmp_path / "plan.yaml").write_text(
        "schema: 1\nbase: small.yaml\nvary:\n"
        "  - keys: {scene.objects.part.mesh: [first.ply, other.ply]}\n"
        "  - keys: {scanner.laser.power: [5 mW, 15 mW]}\n",
        encoding="utf-8",
    )
    return tmp_path / "plan.yaml"


@pytest.mark.parametrize("scene", ["scene.xml", "SCENE.XML"])
def test_files_within_scenes_and_those_of_single_runs_count(plan: Path, scene: str) -> None:
    """Claim: however the ending of the scene's file is written."""
    (plan.parent / "scene.xml").rename(plan.parent / scene)
    small = plan.parent / "small.yaml"
    small.write_text(small.read_text(encoding="utf-8").replace("scene.xml", scene), encoding="utf-8")
    names = {Path(path).name for path in digests_of(read_campaign(plan))}
    assert names == {scene, "more.xml", "part.ply", "first.ply", "other.ply"}


def test_files_of_whole_lists_of_objects_count(plan: Path) -> None:
    """Claim: where a plan gives all objects at once, the meshes of each of its lists are files of the campaign."""
    part = "{name: part, mesh: NAME, material: z93_white, position: [0 m, 0 m, 7 m]}"
    lists = ", ".join(f"[{part.replace('NAME', name)}]" for name in ("first.ply", "other.ply"))
    plan.write_text(
        f"schema: 1\nbase: small.yaml\nvary: [{{keys: {{scene.objects: [{lists}]}}}}]\n", encoding="utf-8"
    )
    assert "other.ply" in {Path(path).name for path in digests_of(read_campaign(plan))}


@pytest.mark.parametrize("name", ["more.xml", "part.ply", "other.ply"])
def test_a_campaign_does_not_go_on_with_another_file(plan: Path, tmp_path: Path, name: str) -> None:
    """Claim: a byte more in any of them, and the folder is refused; with the old one it goes on."""
    folder, before = tmp_path / "out", (tmp_path / name).read_bytes()
    with opened(folder, read_campaign(plan), ("valid_share",)):
        pass
    (tmp_path / name).write_bytes(before + b"\n")
    with (
        pytest.raises(InputError, match="another content of its files"),
        opened(folder, read_campaign(plan), ("valid_share",)),
    ):
        pass
    (tmp_path / name).write_bytes(before)
    with opened(folder, read_campaign(plan), ("valid_share",)):
        pass


def git(folder: Path, *words: str) -> str:
    own = ["-c", "user.name=x", "-c", "user.email=x@example.org", "-c", "commit.gpgsign=false"]
    return subprocess.run(
        ["git", "-C", str(folder), *own, *words], capture_output=True, text=True, check=True
    ).stdout.strip()


def test_the_commit_of_a_checkout_is_told_and_nothing_of_it_is_run(plan: Path, tmp_path: Path) -> None:
    """Claim: folder and commit stand in the manifest; a monitor that the checkout names is not started."""
    git(tmp_path, "init", "--quiet")
    git(tmp_path, "add", "small.yaml", "plan.yaml")
    git(tmp_path, "commit", "--quiet", "-m", "x")
    monitor = tmp_path / "monitor"
    monitor.write_text(f"#!/bin/sh\ntouch '{tmp_path}/started'\n", encoding="utf-8")
    monitor.chmod(0o755)
    git(tmp_path, "config", "core.fsmonitor", str(monitor))
    with opened(tmp_path / "out", read_campaign(plan), ("valid_share",)):
        pass
    said = json.loads((tmp_path / "out" / "campaign.json").read_text(encoding="utf-8"))
    assert not (tmp_path / "started").exists()
    assert said["commits"] == {str(tmp_path.resolve()): git(tmp_path, "rev-parse", "HEAD")}


@pytest.mark.parametrize("name", ["GIT_DIR", "GIT_WORK_TREE"])
def test_within_a_hook_of_another_checkout_the_commit_is_that_of_the_plan(
    plan: Path,
    tmp_path: Path,
    tmp_path_factory: pytest.TempPathFactory,
    monkeypatch: pytest.MonkeyPatch,
    name: str,
) -> None:
    """Claim: git tells its hooks where their own checkout is; the plan's files stand in theirs."""
    other = tmp_path_factory.mktemp("other")
    for folder, file in ((tmp_path, "plan.yaml"), (other, "hook")):
        (folder / "hook").write_text("x", encoding="utf-8")
        git(folder, "init", "--quiet")
        git(folder, "add", file)
        git(folder, "commit", "--quiet", "-m", folder.name)
    commit = git(tmp_path, "rev-parse", "HEAD")
    assert commit != git(other, "rev-parse", "HEAD")
    monkeypatch.setenv(name, str(other / ".git" if name == "GIT_DIR" else other))
    assert commits_of(read_campaign(plan), ()) == {str(tmp_path.resolve()): commit}


def test_plan_scenario_and_files_may_stand_in_checkouts_of_their_own(
    plan: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: the commit of each is told by its folder; of what stands in none there is none."""
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    commits = {}
    files = [path for path in tmp_path.iterdir() if path.is_file()]
    for name in ("plans", "bases", "meshes"):
        (folder := tmp_path / name).mkdir()
        for file in files:
            shutil.copy(file, folder)
        git(folder, "init", "--quiet")
        git(folder, "add", "plan.yaml")
        git(folder, "commit", "--quiet", "-m", name)
        commits[str(folder.resolve())] = git(folder, "rev-parse", "HEAD")
    assert len(set(commits.values())) == 3
    own = tmp_path / "plans" / plan.name
    text = plan.read_text(encoding="utf-8").replace("small.yaml", "../bases/small.yaml")
    own.write_text(text, encoding="utf-8")
    campaign = read_campaign(own)
    told = commits_of(campaign, [str(tmp_path / "meshes" / "first.ply"), str(tmp_path / "other.ply")])
    assert told == commits
    assert list(told) == sorted(commits)
    del commits[str((tmp_path / "meshes").resolve())]
    assert commits_of(campaign, [str(tmp_path / "other.ply")]) == commits


def test_without_git_or_a_checkout_there_is_none(
    plan: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    campaign = read_campaign(plan)
    assert commits_of(campaign, ()) == {}
    monkeypatch.setenv("PATH", "")
    assert commits_of(campaign, ()) == {}
