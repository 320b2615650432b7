"""The output folder: whole or not at all, and nobody else's files."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import shutil
import stat
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scanner_sim.foundation.errors import InputError, RunError
from scanner_sim.products.files import run_folder as room
from scanner_sim.products.files.contents import FILES, RUN, planned_files
from scanner_sim.products.files.folder import check_target
from scanner_sim.products.files.run_folder import write_run
from scanner_sim.products.image import RangeImage
from scanner_sim.products.settings import Output

BARE = Output(pictures=False)


def make_image(seed: int = 0) -> RangeImage:
    ranges = np.full((3, 4), 9.0 + seed, np.float32)
    layers = dict.fromkeys(("range_m", "P.X", "P.Y", "P.Z", "Y", "truth.range_m"), ranges)
    return RangeImage(
        channels={**layers, "status": np.zeros((3, 4), np.float32)},
        theta=np.linspace(-0.1, 0.1, 4),
        phi=np.linspace(-0.1, 0.1, 3),
        seed=seed,
        scenario_yaml=f"schema: 1\nseed: {seed}\n",
    )


def content(folder: Path) -> dict[str, bytes]:
    """Every file below ``folder``, hidden ones too."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def fail_with(error: BaseException) -> Any:
    def fail(*_: object, **__: object) -> None:
        raise error

    return fail


def test_a_run_writes_what_the_settings_name(tmp_path: Path) -> None:
    for number, output in enumerate((Output(), BARE, Output(points=False))):
        files = write_run(make_image(), tmp_path / str(number), output)
        assert [path.name for path in files] == list(planned_files(output))
        assert set(content(tmp_path / str(number))) == set(planned_files(output))
    assert planned_files(Output()) == FILES
    assert (tmp_path / "0" / "scenario.yaml").read_text() == "schema: 1\nseed: 0\n"


@pytest.mark.parametrize(
    ("kept", "points"), [(("P.X", "P.Y", "P.Z"), True), (("P.X", "P.Z"), False), ((), False)]
)
def test_points_are_written_of_whole_places(tmp_path: Path, kept: tuple[str, ...], points: bool) -> None:
    """Claim: an image that keeps depths alone is written like any other, without a file of points."""
    image = make_image().keeping(["range_m", *kept])
    files = {path.name for path in write_run(image, tmp_path, BARE)}
    assert files == set(planned_files(BARE)) - (set() if points else {"points.ply"})


def test_the_same_image_gives_the_same_bytes_in_every_file(tmp_path: Path) -> None:
    for name in "ab":
        write_run(make_image(), tmp_path / name)
    assert content(tmp_path / "a") == content(tmp_path / "b")


def test_parents_are_made_and_the_folder_is_readable_like_any_other(tmp_path: Path) -> None:
    write_run(make_image(), tmp_path / "a" / "b" / "c", BARE)
    (tmp_path / "ordinary").mkdir()
    modes = {stat.S_IMODE(path.stat().st_mode) for path in (tmp_path / "a/b/c", tmp_path / "ordinary")}
    assert len(modes) == 1


def test_a_result_stays_unless_told_otherwise(tmp_path: Path) -> None:
    write_run(make_image(1), tmp_path / "out")
    before = content(tmp_path)
    for attempt in (
        lambda: check_target(tmp_path / "out", False, RUN),
        lambda: write_run(make_image(2), tmp_path / "out"),
    ):
        with pytest.raises(InputError, match="already holds a result") as error:
            attempt()
        assert "--overwrite" in error.value.remedy
    assert content(tmp_path) == before


def test_overwriting_replaces_all_of_ours_and_nothing_else(tmp_path: Path) -> None:
    """Pictures of the earlier run would contradict the new one; the user's notes are the user's."""
    write_run(make_image(1), tmp_path / "out")
    (tmp_path / "out" / "notes.txt").write_text("mine")
    write_run(make_image(2), tmp_path / "out", BARE, overwrite=True)
    write_run(make_image(2), tmp_path / "fresh", BARE)
    assert content(tmp_path / "out") == {**content(tmp_path / "fresh"), "notes.txt": b"mine"}
    assert sorted(path.name for path in tmp_path.iterdir()) == ["fresh", "out"]


def test_what_was_drawn_of_a_result_goes_with_it(tmp_path: Path) -> None:
    write_run(make_image(1), tmp_path, BARE)
    stale, kept = ("view.html", "voxel_1_2.png", "waveform_10_0.png"), ("voxel_1.png", "my_voxel_1_2.png")
    for name in (*stale, *kept):
        (tmp_path / name).write_text("of seed 1")
    write_run(make_image(2), tmp_path, BARE, overwrite=True)
    assert set(content(tmp_path)) == {*planned_files(BARE), *kept}


def test_an_empty_folder_and_one_with_other_files_are_fine(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    write_run(make_image(), tmp_path, BARE)
    assert content(tmp_path)["notes.txt"] == b"mine"


@pytest.mark.parametrize("overwrite", [False, True])
def test_a_scenario_of_the_user_is_never_overwritten(tmp_path: Path, overwrite: bool) -> None:
    """``scanner-sim run scenario.yaml -o .`` must not replace the very file it reads."""
    (tmp_path / "scenario.yaml").write_text("# my comments\nschema: 1\n")
    with pytest.raises(InputError, match=r"scenario\.yaml but no range\.exr"):
        write_run(make_image(), tmp_path, BARE, overwrite=overwrite)
    assert content(tmp_path) == {"scenario.yaml": b"# my comments\nschema: 1\n"}


def test_a_place_that_cannot_be_written_to_is_bad_input_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "nowhere").symlink_to(tmp_path / "missing")
    (tmp_path / "out" / "range.exr").mkdir(parents=True)
    for place in ("file", "file/below", "nowhere", "out"):
        with pytest.raises(InputError, match="folder") as error:
            check_target(tmp_path / place, True, RUN)
        assert "-o" in error.value.remedy
    denied = PermissionError(errno.EACCES, "Permission denied")
    monkeypatch.setattr(tempfile, "TemporaryFile", fail_with(denied))
    with pytest.raises(InputError, match="cannot be written to: Permission denied"):
        check_target(tmp_path / "new" / "folder", False, RUN)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "nowhere", "out"]


def test_the_check_leaves_no_trace(tmp_path: Path) -> None:
    check_target(tmp_path / "a" / "b", False, RUN)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("error", "raised"),
    [
        (OSError(errno.ENOSPC, "No space left on device"), RunError),
        (OSError(errno.EIO, "Input/output error"), RunError),
        (KeyboardInterrupt(), KeyboardInterrupt),
    ],
)
@pytest.mark.parametrize("existing", [False, True])
def test_a_failure_while_writing_changes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException, raised: type, existing: bool
) -> None:
    target = tmp_path / "deep" / "out"
    if existing:
        write_run(make_image(1), target, BARE)
    before, folders = content(tmp_path), sorted(tmp_path.rglob("*"))
    monkeypatch.setattr(room, "write_ply", fail_with(error))
    with pytest.raises(raised) as caught:
        write_run(make_image(2), target, BARE, overwrite=True)
    if isinstance(error, OSError):
        assert str(target) in str(caught.value)
        assert (caught.value.exit_status, error.errno == errno.ENOSPC) == (1, "is full" in str(caught.value))
    assert content(tmp_path) == before
    assert sorted(tmp_path.rglob("*")) == folders


@pytest.mark.parametrize("error", [OSError(errno.EIO, "Input/output error"), KeyboardInterrupt()])
@pytest.mark.parametrize("call", ["rename", "unlink", "mkdir", "fsync"])
def test_a_failure_while_exchanging_leaves_one_result_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str, error: BaseException
) -> None:
    """Claim: whichever step fails, afterwards there is the old result or the new one, and no other file."""
    write_run(make_image(2), tmp_path / "new", BARE)
    new, true = content(tmp_path / "new"), getattr(os, call)
    fallen, step = True, 0
    while fallen:
        write_run(make_image(1), tmp_path / "out", BARE, overwrite=True)
        (tmp_path / "out" / "range.png").write_text("of the old one")
        old, count, fallen = content(tmp_path / "out"), iter(range(1000)), False

        def fails_once(*arguments: Any, **options: Any) -> Any:
            nonlocal fallen
            if next(count) == step:  # noqa: B023 (called in this turn of the loop only)
                fallen = True
                raise error
            return true(*arguments, **options)

        with monkeypatch.context() as patched:
            patched.setattr(os, call, fails_once)
            with contextlib.suppress(RunError, InputError, KeyboardInterrupt):
                write_run(make_image(2), tmp_path / "out", BARE, overwrite=True)
        # Where deleting is what failed, something hidden may stay until the next start.
        check_target(tmp_path / "out", True, RUN)
        (tmp_path / "out" / ".scanner-sim.lock").unlink(missing_ok=True)
        assert content(tmp_path / "out") in (old, new)
        assert sorted(path.name for path in tmp_path.iterdir()) == ["new", "out"]
        step += 1
    assert step > 1 + (call == "rename") * len(planned_files(BARE))


def test_new_files_that_cannot_be_put_in_place_are_not_thrown_away(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_run(make_image(2), tmp_path / "new", BARE)
    write_run(make_image(1), tmp_path / "out")
    rename, calls = os.rename, iter(range(1000))

    def disk_dies(source: Path, target: Path) -> None:
        if next(calls) >= 2:
            raise OSError(errno.EIO, "Input/output error")
        rename(source, target)

    with monkeypatch.context() as patched:
        patched.setattr(os, "rename", disk_dies)
        with pytest.raises(RunError, match="cannot be put in their place") as caught:
            write_run(make_image(2), tmp_path / "out", BARE, overwrite=True)
        assert "next start" in caught.value.remedy
    check_target(tmp_path / "out", True, RUN)
    assert content(tmp_path / "out") == content(tmp_path / "new")


def test_a_folder_that_was_sent_cannot_cost_a_file(tmp_path: Path) -> None:
    """Claim: leftovers that somebody else has made neither delete nor replace nor fetch a file of the user."""
    mine, out = tmp_path / "mine.txt", tmp_path / "out"
    waiting = out / ".scanner-sim.complete"
    for new, old in (
        (["notes.txt"], {"notes.txt": [0, 0]}),
        ([], {"notes.txt": [4, 1]}),
        (["../mine.txt"], {}),
        ([], {"../mine.txt": [4, mine.stat().st_mtime_ns if mine.exists() else 0]}),
        (["notes.txt"], []),
        (5, None),
    ):
        waiting.mkdir(parents=True, exist_ok=True)
        mine.write_text("mine")
        (out / "notes.txt").write_text("mine")
        (waiting / "notes.txt").write_text("theirs")
        (waiting / "plan.json").write_text(json.dumps({"new": new, "old": old}))
        with contextlib.suppress(InputError):
            check_target(out, True, RUN)
        assert mine.read_text() == (out / "notes.txt").read_text() == "mine"
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "plan.json").write_text(json.dumps({"new": ["thesis.tex"], "old": {}}))
    (elsewhere / "thesis.tex").write_text("mine")
    shutil.rmtree(waiting)
    waiting.symlink_to(elsewhere)
    (out / ".scanner-sim.partial").symlink_to(elsewhere)
    check_target(out, True, RUN)
    assert sorted(path.name for path in elsewhere.iterdir()) == ["plan.json", "thesis.tex"]
    assert sorted(path.name for path in out.iterdir()) == ["notes.txt"]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes with names")
@pytest.mark.parametrize("state", ["partial", "complete"])
def test_a_pipe_in_the_place_of_leftovers_is_not_waited_for(tmp_path: Path, state: str) -> None:
    os.mkfifo(tmp_path / f".scanner-sim.{state}")
    check_target(tmp_path, True, RUN)
    assert not list(tmp_path.iterdir())


def test_an_endless_list_of_leftovers_is_not_read(tmp_path: Path) -> None:
    waiting = tmp_path / ".scanner-sim.complete"
    waiting.mkdir()
    (waiting / "plan.json").touch()
    os.truncate(waiting / "plan.json", 1 << 40)
    with pytest.raises(InputError, match="at most 1 MB"):
        check_target(tmp_path, True, RUN)
