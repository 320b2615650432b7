"""Data sets of kept runs: what is in a row is what the run measured, and nothing stands in two splits."""

from __future__ import annotations

import csv
import itertools
import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow.parquet
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from scanner_sim import read_range_image, read_shots
from scanner_sim.campaign.dataset import pack
from scanner_sim.campaign.dataset.licences import NOT_STATED
from scanner_sim.campaign.dataset.pack import Dataset, DatasetChoices, write_dataset
from scanner_sim.campaign.dataset.splits import SPLITS, Splits, split_views
from scanner_sim.campaign.dataset.views import View, ViewedObject, _view
from scanner_sim.campaign.reading import read_campaign
from scanner_sim.campaign.serial import run_serially
from scanner_sim.campaign.store import opened
from scanner_sim.campaign.work import Settings
from scanner_sim.config import load_scenario
from scanner_sim.foundation.errors import InputError
from scanner_sim.render.device import Device

PLAN = """\
schema: 1
base: small.yaml
seed: 3
set:
  output: {pictures: false, points: false}
  scene.objects:
    - {name: wall, shape: rectangle, size: [8 m, 8 m], position: [0 m, 0 m, 9 m], material: grey_reference}
    - {name: part, mesh: part0.ply, position: [0 m, 0 m, 8 m], material: grey_reference}
vary:
  - keys:
      scene.objects.part.mesh: [part0.ply, part0.ply, part1.ply, part1.ply, part2.ply, part2.ply, part2.ply, part3.ply]
      scene.objects.part.position[0]: {uniform: [-10 cm, 10 cm]}
    count: 8
keep: {runs: all}
measure: [valid_share]
"""
MESH = """\
ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
-{size} -{size} 0
0 {size} 0
{size} -{size} 0
3 0 1 2
"""


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory, small_scenario: str, device: Device) -> Path:
    """Four shapes, eight poses, kept; two meshes say their licence."""
    folder = tmp_path_factory.mktemp("views")
    (folder / "small.yaml").write_text(small_scenario, encoding="utf-8")
    (folder / "plan.yaml").write_text(PLAN, encoding="utf-8")
    for number in range(4):
        (folder / f"part{number}.ply").write_text(MESH.format(size=0.1 + 0.05 * number), encoding="ascii")
    (folder / "part0.ply.license").write_text(
        "SPDX-FileCopyrightText: 2024 A. Maker\nSPDX-License-Identifier: CC-BY-4.0\n", encoding="utf-8"
    )
    run(folder / "plan.yaml", folder / "out")
    return folder / "out"


def run(plan: Path, folder: Path) -> None:
    whole = read_campaign(plan)
    with opened(folder, whole, whole.plan.measure) as store:
        run_serially(store, Settings(folder, device="cpu"), lambda *_: None)
        assert not store.failed


@pytest.fixture(scope="module")
def made(campaign: Path) -> Dataset:
    choices = DatasetChoices(shares=(2.0, 1.0, 1.0), licence="CC-BY-4.0", shard_bytes=1)
    told: list[tuple[int, int]] = []
    found = write_dataset(
        campaign, campaign.parent / "set", choices, progress=lambda *done: told.append(done)
    )
    shards = sum(path.suffix == ".parquet" for path in found.files)
    assert told == [(number + 1, shards) for number in range(shards)]
    return found


def rows_of(made: Dataset) -> list[dict[str, Any]]:
    shards = [path for path in made.files if path.suffix == ".parquet"]
    return [row for path in shards for row in pyarrow.parquet.read_table(path).to_pylist()]


class TestRows:
    def test_a_row_is_what_the_run_measured(self, campaign: Path, made: Dataset) -> None:
        """Every layer to the bit, with NaN where there is none; the mask and the pose of each object."""
        rows = rows_of(made)
        assert sorted(row["run"] for row in rows) == list(range(8))
        for row in rows:
            image = read_range_image(campaign / "runs" / f"{row['run']:06d}" / "range.exr")
            for name, layer in image.channels.items():
                np.testing.assert_array_equal(
                    np.array(row[name], dtype=np.float32), layer.ravel(), err_msg=name
                )
            np.testing.assert_array_equal(row["theta_rad"], image.theta)
            assert (row["seed"], row["scenario"]) == (image.seed, image.scenario_yaml)
            assert image.objects == ("wall", "part")
            assert (row["object_names"], row["object_numbers"]) == (["wall", "part"], [1, 2])
            part = load_scenario(row_scenario(row)).scene.objects[1]
            assert row["object_files"] == ["", part.mesh.name]  # type: ignore[union-attr]
            poses = np.array(row["object_poses"]).reshape(-1, 2, 4, 4)
            np.testing.assert_array_equal(poses[1, 0], part.pose_at(0.0)[0])

    def test_the_mask_shows_the_part_where_its_pose_puts_it(self, made: Dataset) -> None:
        """The middle of the voxels with the part's number lies within a voxel of the part's centre."""
        for row in rows_of(made):
            shape = (len(row["phi_rad"]), len(row["theta_rad"]))
            mask = np.array(row["truth.object"]).reshape(shape) == 2
            assert mask.any()
            across = np.array(row["theta_rad"])[np.nonzero(mask)[1]].mean()
            x, z = np.array(row["object_poses"]).reshape(-1, 2, 4, 4)[1, 0, (0, 2), 3]
            step = row["theta_rad"][1] - row["theta_rad"][0]
            assert abs(across - np.arctan2(x, z)) < step

    def test_every_column_says_what_it_is(self, made: Dataset) -> None:
        schema = pyarrow.parquet.read_schema(made.files[0])
        about = {field.name: field.metadata for field in schema}
        assert about["sigma_range_m"][b"unit"] == b"m"
        assert about["range_m"][b"shape"] == b"6,8"
        assert all(one[b"meaning"] for one in about.values())
        # A shape, -1 being the number of objects, two here, holds what a row has; what has none is one of a view.
        for row in rows_of(made):
            assert row.keys() == about.keys()
            for name, value in row.items():
                shape = [int(size) for size in about[name][b"shape"].decode().split(",") if size]
                assert (len(value) if isinstance(value, list) else 0) == (
                    np.prod([2 if size < 0 else size for size in shape]) if shape else 0
                ), name

    def test_objects_of_a_view_are_those_of_its_file_and_its_scenario(self, tmp_path: Path) -> None:
        """Claim: a scene's file comes first, under its name without ending, and stands still in the origin; others
        follow in their order, each where it is when the scan begins and when it ends."""

        def pose_at(speed: float) -> Any:
            def poses(times: Any) -> Any:
                return np.array([[[speed * time]] for time in times])

            return poses

        objects = [
            SimpleNamespace(name=name, pose_at=pose_at(speed)) for name, speed in (("u", 2.0), ("v", 3.0))
        ]
        scenario = SimpleNamespace(
            scan=SimpleNamespace(layout="shots"), scan_setup="s", scene=SimpleNamespace(objects=objects),
            open_scan=SimpleNamespace(scan_time={"s": 7.0}.get),
        )  # fmt: skip
        store: Any = SimpleNamespace(folder=tmp_path, campaign=SimpleNamespace(scenario=lambda _: scenario))
        shapes: Any = SimpleNamespace(
            of=lambda item: (f"of {item.name}", None), of_file=lambda file: f"of {file}"
        )
        folder = tmp_path / "runs" / "000012"
        for file in (None, Path("a.b/hall.xml")):
            scenario.scene.file = file
            folder.mkdir(parents=True, exist_ok=True)
            (folder / "shots.parquet").unlink(missing_ok=True)
            with pytest.raises(InputError, match="run 12 was not kept"):
                _view(store, 12, shapes)
            (folder / "shots.parquet").touch()
            found = _view(store, 12, shapes)
            assert (found.run, found.folder, found.scenario) == (12, folder, scenario)
            first = [("hall", "of a.b/hall.xml", file)] if file else []
            moved = [("u", "of u", None), ("v", "of v", None)]
            assert [(one.name, one.shape, one.file) for one in found.objects] == first + moved
            assert [one.poses.ravel().tolist() for one in found.objects[-2:]] == [[0.0, 14.0], [0.0, 21.0]]
        np.testing.assert_array_equal(found.objects[0].poses, [np.eye(4), np.eye(4)])

    def test_poses_are_the_same_to_a_nanometre(self) -> None:
        """Claim: half of 1 nm more is the same pose, 2 nm more another; no sign of zero counts, the end does."""
        poses = np.tile(np.eye(4), (2, 1, 1))
        poses[:, 0, 3] = 0.3
        for at, more, same in ((0, 4e-10, True), (0, 2e-9, False), (1, 2e-9, False)):
            other = poses.copy()
            other[at, 0, 3] += more
            other[:, 1, 3] = -0.0
            assert (
                ViewedObject("a", "", None, poses).pose == ViewedObject("b", "x", None, other).pose
            ) is same

    def test_shots_of_a_scan_without_rows_are_rows_too(self, campaign: Path, tmp_path: Path) -> None:
        """Each layer to the bit, shot by shot, with the aim and the time of each."""
        beside = campaign.parent
        plan = PLAN.replace("set:", "set:\n  scan: {type: lissajous, patterns: 1}", 1)
        (beside / "shots.yaml").write_text(plan, encoding="utf-8")
        run(beside / "shots.yaml", tmp_path / "out")
        found = write_dataset(tmp_path / "out", tmp_path / "set", DatasetChoices(shares=(2.0, 1.0, 1.0)))
        page = next(path for path in found.files if path.name == "README.md").read_text(encoding="utf-8")
        assert "Simulated shots" in page
        for row in rows_of(found):
            shots = read_shots(tmp_path / "out" / "runs" / f"{row['run']:06d}")
            for name, layer in shots.channels.items():
                np.testing.assert_array_equal(np.array(row[name], dtype=np.float32), layer, err_msg=name)
            aims = {"time_s": shots.time, "theta_rad": shots.theta, "phi_rad": shots.phi}
            for name, values in aims.items():
                np.testing.assert_array_equal(row[name], values)


def row_scenario(row: dict[str, Any]) -> dict[str, Any]:
    return dict(yaml.safe_load(row["scenario"]))


class TestSplits:
    def test_no_shape_and_no_pose_stands_in_two(self, made: Dataset) -> None:
        """Told by the columns alone, as a user would: the wall, alike in every view, is the only thing in common."""
        seen: dict[str, set[str]] = {name: set() for name in SPLITS}
        for row in rows_of(made):
            poses = np.array(row["object_poses"]).reshape(-1, 2, 4, 4)
            for name, shape, pose in zip(row["object_names"], row["object_shapes"], poses, strict=True):
                if name != "wall":
                    seen[row["split"]] |= {shape, pose.tobytes().hex()}
        assert all(seen.values())
        assert not any(one & other for one, other in itertools.combinations(seen.values(), 2))
        assert (made.left_out, made.failed, made.backdrop) == (0, 0, frozenset({"wall"}))

    def test_runs_without_a_view_are_told_as_failed(
        self, campaign: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        true = pack.views_of
        monkeypatch.setattr(pack, "views_of", lambda store: true(store)[2:])
        found = write_dataset(campaign, tmp_path / "set", DatasetChoices(shares=(2.0, 1.0, 1.0)))
        assert (found.failed, sum(found.counts.values())) == (2, 6)
        for name in (pack.PAGE, pack.DESCRIPTION):
            assert "failed 2" in (tmp_path / "set" / name).read_text(encoding="utf-8")

    def test_each_split_has_about_its_share(self, made: Dataset) -> None:
        assert sum(made.counts.values()) == 8
        assert made.counts["train"] >= 3
        assert min(made.counts.values()) >= 1

    @pytest.mark.parametrize("seed", range(3))
    def test_single_views_are_divided_to_the_view(self, seed: int) -> None:
        views = [view(run, [(f"shape{run}", float(run))]) for run in range(60)]
        found = split_views(views, (80.0, 10.0, 10.0), ("object", "pose"), seed)
        assert [found.count(name) for name in SPLITS] == [48, 6, 6]

    def test_another_seed_divides_otherwise(self) -> None:
        """Claim: 60 views are divided in 60!/(40! 20!) = 4e15 ways, each as likely: eight seeds give eight of them."""
        views = [view(run, [(f"shape{run}", float(run))]) for run in range(60)]
        for apart in (("object",), ("pose",)):
            found = {split_views(views, (2.0, 0.0, 1.0), apart, seed).of_view for seed in range(8)}
            assert len(found) == 8

    @given(
        shapes=st.integers(3, 12),
        poses=st.integers(3, 12),
        crossed=st.booleans(),
        seed=st.integers(0, 2**32),
        apart=st.sampled_from([("object",), ("pose",), ("object", "pose")]),
    )
    def test_whatever_the_plan_nothing_is_shared(
        self, shapes: int, poses: int, crossed: bool, seed: int, apart: Sequence[str]
    ) -> None:
        views = made_up(shapes, poses, crossed)
        found = split_views(views, (70.0, 15.0, 15.0), apart, seed)
        for kind in apart:
            for one, other in itertools.combinations(SPLITS, 2):
                assert not keys_of(views, found, one, kind) & keys_of(views, found, other, kind)
        assert all(found.count(name) for name in SPLITS)
        if not crossed or len(apart) == 1:
            assert not found.count("")
        assert found == split_views(views, (70.0, 15.0, 15.0), apart, seed)

    @pytest.mark.parametrize("seed", range(10))
    def test_shapes_that_are_seen_together_stay_together(self, seed: int) -> None:
        pairs = [("a", "b"), ("b", "c"), ("d",), ("e",), ("d", "e"), ("f",)]
        views = [view(run, [(name, float(run)) for name in names]) for run, names in enumerate(pairs)]
        found = split_views(views, (1.0, 1.0, 1.0), ("object",), seed)
        assert not found.count("")
        assert found.of_view[0] == found.of_view[1]
        assert found.of_view[2] == found.of_view[3] == found.of_view[4]

    def test_each_split_has_its_share_of_views_however_unlike_the_shapes_numbers_are(self) -> None:
        """Claim: neither of two halves is off by more than half the views of the shape that has most.

        Set-up: 40 shapes of 1 to 40 views. Halves that count shapes instead are off by 37 views, one standard
        deviation, in each of twelve orders.
        """
        shapes = [name for number in range(1, 41) for name in [f"shape{number}"] * number]
        views = [view(run, [(name, float(run))]) for run, name in enumerate(shapes)]
        for seed in range(12):
            found = split_views(views, (1.0, 0.0, 1.0), ("object",), seed)
            assert abs(found.count("train") - 410) <= 20

    def test_too_few_shapes_or_poses_are_refused(self) -> None:
        same = [view(run, [("part", float(run))]) for run in range(6)]
        with pytest.raises(InputError, match=r"no object varies|1 object") as fault:
            split_views(same, (80.0, 10.0, 10.0), ("object", "pose"), 0)
        assert "--apart pose" in fault.value.remedy
        assert split_views(same, (80.0, 10.0, 10.0), ("pose",), 0).count("train") == 4
        still = [view(run, [(f"part{run}", 0.0)]) for run in range(6)]
        with pytest.raises(InputError) as fault:
            split_views(still, (80.0, 10.0, 10.0), ("object", "pose"), 0)
        assert "--apart object" in fault.value.remedy
        assert split_views(still, (1.0, 0.0, 1.0), ("object",), 0).of_view.count("validation") == 0

    @pytest.mark.parametrize("apart", [("object", "pose"), ("object",), ("pose",)])
    def test_a_split_that_is_alone_has_all_views(self, apart: tuple[str, ...]) -> None:
        """Claim: whatever varies, and also where a view shows nothing but what all others show, or nothing at all."""
        alike = [view(run, [("wall", 0.0)]) for run in range(3)]
        varied = [view(0, []), view(1, [("wall", 0.0)]), view(2, [("wall", 0.0), ("part", 1.0)])]
        for views in (alike, varied, varied[:1], varied[2:]):
            found = split_views(views, (0.0, 2.0, 0.0), apart, 4)
            assert found.of_view == ("validation",) * len(views)
        assert split_views(alike, (1.0, 0.0, 0.0), apart, 4).backdrop == {alike[0].objects[0].name}


def view(run: int, objects: Sequence[tuple[str, float]]) -> View:
    """A view of made-up shapes, each moved along x by so much."""
    poses = np.tile(np.eye(4), (len(objects), 2, 1, 1))
    poses[:, :, 0, 3] = np.array([x for _, x in objects])[:, None]
    found = tuple(
        ViewedObject("part", shape, None, pose) for (shape, _), pose in zip(objects, poses, strict=True)
    )
    return View(run, Path(), None, found)  # type: ignore[arg-type]


def made_up(shapes: int, poses: int, crossed: bool) -> list[View]:
    if crossed:
        pairs = list(itertools.product(range(shapes), range(poses)))
    else:
        pairs = [(shape, shape * poses + pose) for shape in range(shapes) for pose in range(poses)]
    return [view(run, [(f"shape{shape}", float(pose))]) for run, (shape, pose) in enumerate(pairs)]


def keys_of(views: Sequence[View], found: Splits, split: str, kind: str) -> set[str]:
    return {
        one.shape if kind == "object" else one.pose
        for view, name in zip(views, found.of_view, strict=True)
        if name == split
        for one in view.objects
    }


class TestFolder:
    def test_licences_are_recorded(self, made: Dataset) -> None:
        assert {one.name: one.licence for one in made.licences} == {
            "part0.ply": "CC-BY-4.0",
            **dict.fromkeys(("part1.ply", "part2.ply", "part3.ply"), NOT_STATED),
        }
        page = next(path for path in made.files if path.name == "README.md").read_text(encoding="utf-8")
        assert "| part0.ply | CC-BY-4.0 | 2024 A. Maker |" in page
        with next(path for path in made.files if path.name == "views.csv").open(encoding="utf-8") as stream:
            assert [row["run"] for row in csv.DictReader(stream)] == [str(number) for number in range(8)]

    @pytest.mark.slow
    def test_mlcroissant_validates_the_description_and_reads_by_it(self, made: Dataset) -> None:
        """In a process of its own: it changes the logging of all that it runs beside."""
        pytest.importorskip("mlcroissant", reason="it comes with the extra dev")
        code = (
            "import json, sys, mlcroissant\n"
            "data = mlcroissant.Dataset(jsonld=sys.argv[1])\n"
            "issues = data.metadata.ctx.issues\n"
            "rows = list(data.records('views'))\n"
            "print(json.dumps([sorted(issues.errors), sorted(issues.warnings), "
            "sorted(int(row['views/run']) for row in rows), len(rows[0]['views/range_m'])]))\n"
        )
        path = next(path for path in made.files if path.name == "croissant.json")
        done = subprocess.run(
            [sys.executable, "-c", code, str(path)],
            capture_output=True,
            text=True,
            check=False,
            cwd=path.parent,
        )
        assert done.returncode == 0, done.stderr
        errors, warnings, runs, voxels = json.loads(done.stdout.splitlines()[-1])
        assert not errors
        # What only who publishes it can say.
        assert all(any(word in one for word in ("citeAs", "datePublished", "version")) for one in warnings), (
            warnings
        )
        assert (runs, voxels) == (list(range(8)), 48)

    def test_the_same_runs_give_the_same_bytes(self, campaign: Path, made: Dataset, tmp_path: Path) -> None:
        again = tmp_path / "again"
        run(campaign.parent / "plan.yaml", again)
        choices = DatasetChoices(shares=(2.0, 1.0, 1.0), licence="CC-BY-4.0", shard_bytes=1)
        other = write_dataset(again, tmp_path / "set", choices)
        assert [path.name for path in other.files] == [path.name for path in made.files]
        for one, two in zip(other.files, made.files, strict=True):
            assert one.read_bytes() == two.read_bytes(), one.name

    def test_larger_shards_hold_the_same_views(self, campaign: Path, tmp_path: Path) -> None:
        choices = DatasetChoices(shares=(1.0, 0.0, 1.0), layers=("range_m",))
        found = write_dataset(campaign, tmp_path / "set", choices)
        names = {path.name for path in found.files if path.suffix == ".parquet"}
        assert names == {"train-00000-of-00001.parquet", "test-00000-of-00001.parquet"}
        rows = rows_of(found)
        assert sorted(row["run"] for row in rows) == list(range(8))
        assert {"range_m", "status", "truth.object"} <= set(rows[0])
        assert "sigma_range_m" not in rows[0]

    def test_only_ours_is_replaced(self, campaign: Path, tmp_path: Path) -> None:
        folder, choices = tmp_path / "set", DatasetChoices(shares=(1.0, 1.0, 0.0), shard_bytes=1)
        write_dataset(campaign, folder, choices)
        (folder / "notes.txt").write_text("mine", encoding="utf-8")
        with pytest.raises(InputError, match="already holds a data set"):
            write_dataset(campaign, folder, choices)
        found = write_dataset(campaign, folder, DatasetChoices(shares=(1.0, 1.0, 0.0)), overwrite=True)
        assert {path.name for path in folder.iterdir()} == {path.name for path in found.files} | {"notes.txt"}
        (folder / "croissant.json").unlink()
        with pytest.raises(InputError, match="not ours"):
            write_dataset(campaign, folder, choices, overwrite=True)

    @pytest.mark.parametrize(
        ("choices", "words"),
        [
            (DatasetChoices(shares=(0.0, 0.0, 0.0)), "nor all 0"),
            (DatasetChoices(shares=(-1.0, 1.0, 1.0)), "must not be negative"),
            (DatasetChoices(apart=("poses",)), "'poses' is nothing"),
            (DatasetChoices(layers=("rang_m",)), "no layer 'rang_m'"),
        ],
    )
    def test_bad_choices_are_refused(
        self, campaign: Path, tmp_path: Path, choices: DatasetChoices, words: str
    ) -> None:
        with pytest.raises(InputError, match=words):
            write_dataset(campaign, tmp_path / "set", choices)
        assert not (tmp_path / "set").exists()

    def test_runs_that_were_not_kept_are_refused(self, campaign: Path, tmp_path: Path) -> None:
        moved = campaign / "runs" / "000005" / "range.exr"
        aside = moved.rename(tmp_path / "aside")
        try:
            with pytest.raises(InputError, match="run 5 was not kept") as fault:
                write_dataset(campaign, tmp_path / "set")
        finally:
            aside.rename(moved)
        assert "keep: {runs: all}" in fault.value.remedy

    def test_a_licence_that_names_none_is_refused(self, campaign: Path, tmp_path: Path) -> None:
        beside = campaign.parent / "part1.ply.license"
        beside.write_text("all mine", encoding="utf-8")
        try:
            with pytest.raises(InputError, match="names no licence"):
                write_dataset(campaign, tmp_path / "set", DatasetChoices(shares=(1.0, 1.0, 0.0)))
        finally:
            beside.unlink()
