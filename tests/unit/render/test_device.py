"""The choice of device and LLVM library, on file trees and libraries made for the purpose."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from pydantic_core import _pydantic_core

from scanner_sim.foundation.errors import InputError
from scanner_sim.render import device, libraries
from scanner_sim.render.device import Device, activate
from scanner_sim.render.libraries import LLVM_VARIABLE, OLDEST_LLVM, LlvmLibrary, find_llvm


@pytest.fixture
def no_wish(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(LLVM_VARIABLE, raising=False)


@pytest.fixture
def candidates(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, no_wish: None) -> list[Path]:
    """Libraries on this machine: a list for the test to fill; each verifies as what its name says."""
    found: list[Path] = []
    monkeypatch.setattr(libraries, "_candidates", lambda: iter(found))
    monkeypatch.setattr(libraries, "_verified_version", lambda path: libraries._version_from_name(path))
    return found


@pytest.mark.parametrize(
    ("name", "version"),
    [
        ("/nowhere/libLLVM.so.19.1", (19, 1, 0)),
        ("/nowhere/libLLVM-15.so.1", (15, 0, 0)),
        ("/nowhere/libLLVM-14.0.6.so.1", (14, 0, 6)),
        ("/nowhere/libLLVM-18.1.so", (18, 1, 0)),
        ("/nowhere/llvm-17/lib/libLLVM.so", (17, 0, 0)),
        ("/nowhere/opt/llvm@18/lib/libLLVM.dylib", (18, 0, 0)),
        ("/nowhere/lib/libLLVM.dylib", None),
    ],
)
def test_version_is_read_from_the_name(name: str, version: tuple[int, int, int] | None) -> None:
    """``libLLVM-15.so.1`` is version 15, not 1; a file without a number is of unknown age."""
    assert libraries._version_from_name(Path(name)) == version


def test_a_link_is_as_old_as_what_it_points_to(tmp_path: Path) -> None:
    (tmp_path / "libLLVM-15.so.1").touch()
    link = tmp_path / "libLLVM.so"
    link.symlink_to("libLLVM-15.so.1")
    assert libraries._version_from_name(link) == (15, 0, 0)


def test_the_newest_library_wins_and_old_ones_never(candidates: list[Path]) -> None:
    """As numbers, not as text: 9 is older than 19, 19.1 newer than 19.0."""
    names = ["libLLVM-9.so", "libLLVM-15.so.1", "libLLVM.so.19.1", "libLLVM-17.so.1", "libLLVM-19.0.so"]
    candidates.extend(Path("/nowhere", name) for name in names)
    found = find_llvm()
    assert found == LlvmLibrary(path=Path("/nowhere/libLLVM.so.19.1"), version=(19, 1, 0))


@pytest.mark.parametrize(
    ("others", "taken"),
    [
        (("libLLVM-15.so.1",), "libLLVM.so"),
        (("libLLVM-15.so.1", "libLLVM-19.so.1"), "libLLVM-19.so.1"),
        (("libLLVM-20.so.1",), "libLLVM.so"),
    ],
)
def test_a_library_of_unknown_age_is_taken_where_no_other_will_do(
    monkeypatch: pytest.MonkeyPatch, candidates: list[Path], others: tuple[str, ...], taken: str
) -> None:
    """Claim: one whose name tells no version is asked for it last, behind those that are new enough by their names."""
    told = {"libLLVM.so": (22, 1, 3), "libLLVM-15.so.1": (15, 0, 0), "libLLVM-19.so.1": (19, 1, 0)}
    monkeypatch.setattr(libraries, "_verified_version", lambda path: told.get(path.name))
    candidates.extend(Path("/nowhere", name) for name in ("libLLVM.so", *others))
    assert find_llvm() == LlvmLibrary(path=Path("/nowhere", taken), version=told[taken])


def test_an_old_library_is_not_even_loaded(monkeypatch: pytest.MonkeyPatch, candidates: list[Path]) -> None:
    loaded: list[Path] = []
    monkeypatch.setattr(libraries, "_verified_version", loaded.append)
    candidates.extend(Path(f"/nowhere/libLLVM-{age}.so.1") for age in (OLDEST_LLVM - 1, OLDEST_LLVM))
    assert find_llvm() is None
    assert loaded == [Path(f"/nowhere/libLLVM-{OLDEST_LLVM}.so.1")]


def test_a_name_that_lies_about_its_age_is_found_out(tmp_path: Path) -> None:
    """A library without ``LLVMGetVersion`` is older than 16, whatever it is called."""
    impostor = tmp_path / "libLLVM-19.so"
    shutil.copy(_pydantic_core.__file__, impostor)
    assert libraries._verified_version(impostor) is None


def test_the_machine_of_the_tests_has_a_usable_library(no_wish: None) -> None:
    found = find_llvm()
    assert found is not None
    assert found.version[0] >= OLDEST_LLVM
    assert found.path.is_file()


def test_the_users_library_is_taken(monkeypatch: pytest.MonkeyPatch, no_wish: None) -> None:
    found = find_llvm()
    assert found is not None
    monkeypatch.setenv(LLVM_VARIABLE, str(found.path))
    monkeypatch.setattr(libraries, "_candidates", lambda: pytest.fail("the user has libraries already"))
    assert find_llvm() == found


@pytest.mark.parametrize("name", ["libLLVM-16.so.1", "libLLVM-14.0.6.so.1", "libLLVM.so", "missing.so"])
def test_the_users_unusable_library_is_refused_with_the_remedy(
    name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Never passed over in silence: he would believe that his library is in use."""
    path = tmp_path / name
    if "LLVM" in name:
        path.write_bytes(b"not a library")
    monkeypatch.setenv(LLVM_VARIABLE, str(path))
    with pytest.raises(InputError, match=LLVM_VARIABLE) as caught:
        find_llvm()
    assert str(path) in str(caught.value)
    assert "apt-get install libllvm" in caught.value.remedy


def test_no_library_and_no_gpu_stops_with_one_remedy(
    monkeypatch: pytest.MonkeyPatch, candidates: list[Path]
) -> None:
    monkeypatch.setattr(device, "gpu_name", lambda: None)
    for choice in ("auto", "cpu"):
        with pytest.raises(InputError, match="LLVM") as caught:
            activate(choice)
        assert caught.value.exit_status == 2
        assert "apt-get install libllvm" in caught.value.remedy


def test_a_missing_library_of_the_system_is_named_with_its_package(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without libatomic the import of Dr.Jit ends in a NameError of its own."""

    def missing(name: str) -> None:
        raise OSError(f"{name}: cannot open shared object file")

    monkeypatch.setattr(libraries.sys, "platform", "linux")
    monkeypatch.setattr(libraries.ctypes, "CDLL", missing)
    with pytest.raises(InputError, match=r"libatomic\.so\.1.*apt-get install libatomic1"):
        activate("cpu")


def test_a_gpu_that_is_not_there_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(device, "gpu_name", lambda: None)
    with pytest.raises(InputError, match="GPU") as caught:
        activate("cuda")
    assert "cpu" in caught.value.remedy


@pytest.mark.parametrize("threads", [0, -1])
def test_a_number_of_threads_that_cannot_be_is_refused(threads: int) -> None:
    with pytest.raises(InputError, match="threads"):
        activate("cpu", threads=threads)


def test_an_unknown_device_is_refused() -> None:
    with pytest.raises(InputError, match="tpu"):
        activate("tpu")  # type: ignore[arg-type]


def test_activate_sets_the_variant_and_may_be_repeated(device: Device) -> None:
    import mitsuba as mi

    assert device.variant == mi.variant() == "llvm_ad_mono"
    assert device.llvm is not None
    assert os.environ[LLVM_VARIABLE] == str(device.llvm.path)
    assert device.gpu is None
    assert activate("cpu").model_dump(exclude={"threads"}) == device.model_dump(exclude={"threads"})


@pytest.fixture
def thread_count(device: Device) -> Iterator[None]:
    """Give later tests their threads back."""
    import drjit as dr

    before = dr.thread_count()
    yield
    dr.set_thread_count(before)


def test_the_number_of_threads_is_honoured_and_kept(thread_count: None) -> None:
    assert activate("cpu", threads=1).threads == 1
    assert activate("cpu").threads == 1
    assert activate("cpu", threads=2).threads == 2


def test_kernels_with_minimum_and_maximum_compile(device: Device) -> None:
    """LLVM 15 and 16 abort the process on exactly these."""
    import drjit as dr
    import mitsuba as mi

    x = dr.arange(mi.Float, 5) - 2
    clipped = dr.minimum(dr.maximum(x, -1), 1)
    assert clipped.numpy().tolist() == [-1, -1, 0, 1, 1]


def test_the_module_is_importable_without_the_renderer() -> None:
    code = "import sys, scanner_sim.render.libraries; sys.exit('mitsuba' in sys.modules or 'drjit' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_documents_name_the_oldest_version_that_the_program_takes(repo_root: Path) -> None:
    """Claim: wherever a page or a message says how old LLVM may be, it says what the program refuses below."""
    pages = [repo_root / "README.md", *(repo_root / "docs").rglob("*.md")]
    said = {
        page.name: set(re.findall(r"LLVM (\d+) or newer", page.read_text(encoding="utf-8"))) for page in pages
    }
    assert {"README.md", "start.md"} <= {name for name, ages in said.items() if ages}
    assert set().union(*said.values()) == {str(OLDEST_LLVM)}
    told = subprocess.run(
        [sys.executable, "-m", "scanner_sim.render.libraries", "--oldest"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert told.stdout.split() == [str(OLDEST_LLVM)]


def test_the_module_says_what_was_found() -> None:
    command = [sys.executable, "-m", "scanner_sim.render.libraries"]
    environment = {key: value for key, value in os.environ.items() if key != LLVM_VARIABLE}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert done.stdout.startswith("LLVM ")
    refused = subprocess.run(
        command, env=environment | {LLVM_VARIABLE: "/nowhere.so"}, capture_output=True, text=True, check=False
    )
    assert refused.returncode == 1
    assert "/nowhere.so" in refused.stderr
    assert "Traceback" not in refused.stderr


@pytest.mark.parametrize(("major", "usable"), [(OLDEST_LLVM - 1, False), (OLDEST_LLVM, True)])
def test_the_oldest_library_is_usable_and_what_is_older_is_not(
    monkeypatch: pytest.MonkeyPatch, major: int, usable: bool
) -> None:
    """Claim: by the version that the library itself tells, wherever it lies."""

    def told(*numbers: Any) -> None:
        for number, value in zip(numbers, (major, 2, 3), strict=True):
            number._obj.value = value

    monkeypatch.setattr(libraries.ctypes, "CDLL", lambda _: SimpleNamespace(LLVMGetVersion=told))
    found = libraries._verified_version(Path(f"/made/up/{major}"))
    assert found == ((major, 2, 3) if usable else None)


def test_a_guest_gives_back_the_backend_that_it_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: a host's default backend is set again where it is another by then, and else left alone; so are variant
    and threads."""
    from scanner_sim.render import guest

    asked: list[Any] = []
    now = guest._settings()
    monkeypatch.setattr(guest.dr, "set_backend", asked.append)
    guest._restore(now)
    guest._restore(now._replace(backend="another"))
    guest._restore(now._replace(backend=None))
    assert asked == ["another"]
    variants: list[Any] = []
    threads: list[Any] = []
    monkeypatch.setattr(guest.mi, "set_variant", variants.append)
    monkeypatch.setattr(guest.dr, "set_thread_count", threads.append)
    for before in (now, now._replace(variant=None), now._replace(variant="other"), now._replace(threads=97)):
        guest._restore(before)
    assert (variants, threads) == (["other"], [97])
