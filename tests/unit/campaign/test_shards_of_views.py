"""How views are laid into shards, which choices are none, and whose files are replaced."""

from __future__ import annotations

import hashlib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scanner_sim.campaign.dataset import pack, shards, splits, views
from scanner_sim.campaign.dataset.pack import DESCRIPTION, INDEX, PAGE
from scanner_sim.config import load_scenario
from scanner_sim.foundation.errors import InputError


@pytest.mark.parametrize(
    ("most", "names"),
    [
        (9, ["train-00000-of-00001", "test-00000-of-00001"]),
        (3, ["train-00000-of-00002", "train-00001-of-00002", "test-00000-of-00001"]),
        (1, [*(f"train-{n:05d}-of-00004" for n in range(4)), "test-00000-of-00001"]),
    ],
)  # fmt: skip
def test_shards_hold_at_most_so_many_views_in_their_order(most: int, names: list[str]) -> None:
    """Claim: split after split, each view once, in the order of runs; views of no split in none."""
    of_view = ("train", "", "train", "test", "train", "train")
    given: Any = [f"view {number}" for number in range(6)]
    found = pack._shards(given, SimpleNamespace(of_view=of_view), most)  # type: ignore[arg-type]
    assert list(found) == [f"{name}.parquet" for name in names]
    for name, (split, part) in found.items():
        assert name.startswith(split)
        assert 1 <= len(part) <= most
    for split in ("train", "test"):
        own = [view for of, part in found.values() if of == split for view in part]
        assert own == [view for view, of in zip(given, of_view, strict=True) if of == split]


@pytest.mark.parametrize(
    ("shares", "apart", "words"),
    [
        ((8.0, 1.0, 1.0), ("object", "pose"), None), ((1.0, 0.0, 0.0), ("pose",), None),
        ((0.0, 0.0, 0.0), ("pose",), "nor all 0"), ((2.0, -1e-9, 1.0), ("pose",), "must not be negative"),
        ((float("inf"), 1.0, 1.0), ("pose",), "nor all 0"), ((1.0, 1.0, 1.0), (), "there is nothing that keeps"),
        ((1.0, 1.0, 1.0), ("pose", "light"), "'light' is nothing that keeps"),
    ],
)  # fmt: skip
def test_shares_and_what_keeps_splits_apart(shares: Any, apart: tuple[str, ...], words: str | None) -> None:
    choices: Any = SimpleNamespace(shares=shares, apart=apart)
    if words is None:
        pack._check(choices)
        return
    with pytest.raises(InputError, match=words):
        pack._check(choices)


@pytest.mark.parametrize(
    ("there", "overwrite", "words"),
    [
        ((), False, None), (("notes.txt",), False, None), ((DESCRIPTION, INDEX), True, None),
        ((DESCRIPTION,), False, "already holds a data set"), ((INDEX,), True, "not ours to replace"),
        ((PAGE, "train-00000-of-00001.parquet"), True, "not ours to replace"), (("other.parquet",), True, None),
    ],
)  # fmt: skip
def test_only_a_data_set_of_ours_is_replaced(
    tmp_path: Path, there: tuple[str, ...], overwrite: bool, words: str | None
) -> None:
    """Claim: where its description is, and it was said; names like ours without one are somebody's."""
    for name in there:
        (tmp_path / name).write_text("old")
    writers = {name: (lambda path: path.write_text("new") and None) for name in ("a.parquet", DESCRIPTION)}
    if words is None:
        pack._exchanged(tmp_path, writers, overwrite)  # type: ignore[arg-type]
        assert (tmp_path / DESCRIPTION).read_text() == (tmp_path / "a.parquet").read_text() == "new"
        assert (tmp_path / INDEX).exists() is False
        return
    with pytest.raises(InputError, match=words):
        pack._exchanged(tmp_path, writers, overwrite)  # type: ignore[arg-type]
    assert {path.name for path in tmp_path.iterdir() if not path.name.startswith(".")} == set(there)


class Store(SimpleNamespace):
    """A campaign of four runs whose second failed."""

    def rows(self) -> list[dict[str, Any]]:
        return self.tables


def store(**more: Any) -> Any:
    base = SimpleNamespace(scan=SimpleNamespace(layout="image"))
    told: dict[str, Any] = {
        "done": np.ones(4, bool), "folder": "f", "campaign": SimpleNamespace(base=base),
        "tables": [{"run": np.array([3, 1]), "fault": np.array(["", "it fell"])},
                   {"run": np.array([0, 2]), "fault": np.array(["", ""])}],
    }  # fmt: skip
    return Store(**told | more)


def test_views_are_the_runs_that_did_not_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: in the order of runs; all must be done, and one at least must have a result."""
    monkeypatch.setattr(views, "_view", lambda of, run, shapes: run)
    assert views.views_of(store()) == (0, 2, 3)
    with pytest.raises(InputError, match="1 of 4 runs in f are not done"):
        views.views_of(store(done=np.array([True, True, False, True])))
    failed = [{"run": np.arange(4), "fault": np.array(["a", "b", "c", "d"])}]
    with pytest.raises(InputError, match="every run in f has failed"):
        views.views_of(store(tables=failed))


def test_a_run_that_follows_targets_is_no_view_whatever_the_base_does() -> None:
    """Claim: where a plan varies the scan, a run that a tracker made is told of by its number."""
    scenario = SimpleNamespace(scan=SimpleNamespace(layout="visits"))
    campaign = SimpleNamespace(scenario=lambda run: scenario)
    given: Any = SimpleNamespace(folder=Path("f"), campaign=campaign)
    with pytest.raises(InputError, match="run 5 in f is neither a range image nor shots"):
        views._view(given, 5, views._Shapes())


def test_parts_with_numbers_of_their_own_are_told_after_their_object() -> None:
    """Claim: those that the mask shows, by the numbers that it has for them; those of another object, of one whose name
    begins alike or of one that is not labelled by parts are not its own."""
    mask = np.array([[0.0, 5.0], [1.0, 2.0], [6.0, 4.0]], dtype=np.float32)
    names = ("wall", "craft.wing", "craft.tail", "crafty.wing", "craft.hull", "box.lid")
    result: Any = type("Result", (dict,), {"objects": names})({"truth.object": mask})
    poses = np.stack([np.eye(4)] * 2)
    own = [
        views.ViewedObject(name, name, None, poses, in_parts)
        for name, in_parts in (("wall", False), ("craft", True), ("box", False))
    ]
    found = list(shards._named(SimpleNamespace(objects=tuple(own)), result))  # type: ignore[arg-type]
    assert [name for name, _ in found] == ["wall", "craft", "craft.wing", "craft.hull", "box"]
    assert [one.shape for _, one in found] == ["wall", "craft", "craft", "craft", "box"]


@pytest.mark.parametrize(("moved", "same"), [(0.0, True), (-0.0, True), (-4e-10, True), (6e-10, False)])
def test_poses_are_told_apart_by_their_nanometres(moved: float, same: bool) -> None:
    """Claim: sixteen digits of the SHA-256 of numbers to nine decimals, as data sets state them; zero has one sign."""
    poses = np.stack([np.eye(4)] * 2)
    stated = hashlib.sha256(poses.tobytes()).hexdigest()[:16]
    poses[1, 0, 3] = moved
    assert (views.ViewedObject("craft", "", None, poses).pose == stated) is same


def test_a_shape_is_told_by_its_form_and_not_by_its_paint_place_or_name(tmp_path: Path) -> None:
    """Claim: what differs in material, name, position, rotation or motion alone is one shape; another size is another.
    A mesh is told by the content of its file, wherever that lies."""
    vertices = (
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    )
    vertices += (
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 {} 0\n3 0 1 2\n"
    )
    for name, high in (("one", 1), ("same", 1), ("other", 2)):
        (tmp_path / f"{name}.ply").write_text(vertices.format(high), encoding="ascii")
    box = {
        "name": "a",
        "shape": "box",
        "size": (1.0, 2.0, 3.0),
        "material": "z93_white",
        "position": (0.0, 0.0, 5.0),
    }
    array = {"name": "t", "array": {"diameter": 0.1, "plate": 0.3}, "position": (0.0, 0.0, 5.0)}
    mesh = {"name": "m", "material": "z93_white", "position": (0.0, 0.0, 5.0)}
    turned = {"rotation": {"axis": "y", "angle": 0.3}, "position": (1.0, 0.0, 6.0)}
    given = [
        box, box | {"name": "b", "material": "black_paint"} | turned, box | {"size": (1.0, 2.0, 3.1)},
        array, array | {"name": "u", "disc": "retro_sheet"}, array | {"name": "v", "material": "black_paint"},
        *({**mesh, "name": f"m{name}", "mesh": str(tmp_path / f"{name}.ply")} for name in ("one", "same", "other")),
    ]  # fmt: skip
    for number, item in enumerate(given):
        item["name"] = f"{item['name']}{number}"
    scan = {"rows": 2, "columns": 2, "horizontal": (-0.1, 0.1), "vertical": (-0.1, 0.1)}
    scenario = load_scenario({"schema": 1, "scan": scan, "scene": {"objects": given}})
    shapes = views._Shapes()
    found = [shapes.of(item) for item in scenario.scene.objects]
    digests = [digest for digest, _ in found]
    assert digests[0] == digests[1] != digests[2]
    assert digests[3] == digests[4] == digests[5]
    assert digests[6] == digests[7] != digests[8]
    assert len(set(digests)) == 5
    assert [file if file is None else file.name for _, file in found] == [None] * 6 + [
        "one.ply",
        "same.ply",
        "other.ply",
    ]


def test_a_file_of_shapes_is_told_by_its_content_wherever_it_lies(tmp_path: Path) -> None:
    """Claim: a copy in another folder and at another pose is the same shape; another content under the same name is
    not."""
    scene = '<scene version="3.0.0"><shape type="{}"/></scene>'
    for folder, shape in (("a", "sphere"), ("b", "sphere"), ("c", "cube")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "part.xml").write_text(scene.format(shape), encoding="utf-8")
    objects = [
        {"name": f"part{n}", "file": str(tmp_path / folder / "part.xml"), "position": (0.0, 0.0, 5.0 + n)}
        for n, folder in enumerate("abc")
    ]
    scan = {"rows": 2, "columns": 2, "horizontal": (-0.1, 0.1), "vertical": (-0.1, 0.1)}
    scenario = load_scenario({"schema": 1, "scan": scan, "scene": {"objects": objects}})
    shapes = views._Shapes()
    (one, first), (copied, second), (other, _) = [shapes.of(item) for item in scenario.scene.objects]
    assert one == copied != other
    assert (first, second) == (tmp_path / "a" / "part.xml", tmp_path / "b" / "part.xml")


def viewed(*objects: tuple[str, str, float]) -> Any:
    """Return a view of objects of a name and a shape, each so far along x."""
    poses = np.stack([np.eye(4)] * 2)
    found = []
    for name, shape, x in objects:
        own = poses.copy()
        own[:, 0, 3] = x
        found.append(views.ViewedObject(name, shape, None, own))
    return SimpleNamespace(objects=tuple(found))


def test_the_backdrop_is_what_no_view_of_several_changes() -> None:
    """Claim: of two views already; an object that is missing, moved or of another shape in one of them is none, and a
    single view has none, so that its objects are what it shows."""
    wall, part = ("wall", "a", 0.0), ("part", "b", 0.0)
    assert views.backdrop_of([viewed(wall, part)]) == set()
    assert views.backdrop_of([viewed(wall, part), viewed(part, wall)]) == {"wall", "part"}
    for other in (
        (wall,),
        (wall, ("part", "b", 1e-3)),
        (wall, ("part", "c", 0.0)),
        (wall, ("else", "b", 0.0)),
    ):
        for order in ((viewed(wall, part), viewed(*other)), (viewed(*other), viewed(wall, part))):
            assert views.backdrop_of([*order]) == {"wall"}
            assert views.backdrop_of([*order, viewed(wall, part)]) == {"wall"}


@pytest.mark.parametrize("views_of_a_group", [1, 3, 4, 7, 8])
def test_each_view_is_in_one_group(monkeypatch: pytest.MonkeyPatch, views_of_a_group: int) -> None:
    """Claim: of seven views each is a row once, in their order, in groups of as many as are read together."""
    field = shards.Field("range_m", "m", "range", "float32", (40, 25))
    monkeypatch.setattr(shards, "GROUP_BYTES", 4 * 40 * 25 * views_of_a_group)
    monkeypatch.setattr(shards, "_row", lambda one, split, fields: {"run": one, "split": split})
    given: Any = range(7)
    groups = [[row["run"] for row in group] for group in shards._groups(given, "test", (field,))]
    assert [run for group in groups for run in group] == list(range(7))
    assert {len(group) for group in groups[:-1]} <= {views_of_a_group}
    assert 1 <= len(groups[-1]) <= views_of_a_group


@pytest.mark.parametrize(
    ("groups", "kind", "problem", "other"),
    [
        ([], "pose", "no pose varies", "object"),
        ([{"a", "b"}], "object", "the views show 1 object that are not always together", "pose"),
        ([{"a", "b"}, {"c"}], "pose", "the views show 2 poses that are not always together", "object"),
    ],
)
def test_too_little_variety_is_told_with_what_there_is(
    groups: list[set[str]], kind: str, problem: str, other: str
) -> None:
    """Claim: three splits need three groups; what varies is counted, and the other thing to divide by is named."""
    rng, wanted = np.random.default_rng(1), {"train": 0.5, "validation": 0.3, "test": 0.2}
    with pytest.raises(InputError) as fault:
        splits._divided(groups, [["a", "b"], ["c"]], wanted, rng, kind)
    assert fault.value.message == f"{problem}, and 3 splits without a common {kind} need as many."
    assert fault.value.remedy.startswith(f"Vary more {kind}s in the plan")
    assert fault.value.remedy.endswith(f"--apart {other}.")
