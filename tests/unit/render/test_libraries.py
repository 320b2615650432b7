"""Which libraries of a driver and of LLVM are asked for on which system."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from scanner_sim.render import libraries


class Driver:
    """A CUDA driver with two GPUs."""

    def __init__(self, fails: str = "") -> None:
        self.fails = fails

    def cuInit(self, _: int) -> int:
        return int(self.fails == "init")

    def cuDeviceGet(self, device: object, number: int) -> int:
        ctypes.cast(device, ctypes.POINTER(ctypes.c_int))[0] = 40 + number
        return int(self.fails == "device")

    def cuDeviceGetName(self, name: ctypes.Array[ctypes.c_char], size: int, device: ctypes.c_int) -> int:
        name.value = f"GPU {device.value}"[: size - 1].encode()
        return int(self.fails == "name")

    def cuDeviceGetCount(self, count: object) -> int:
        ctypes.cast(count, ctypes.POINTER(ctypes.c_int))[0] = 2
        return int(self.fails == "count")


@pytest.fixture
def loaded(monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[str]]:
    """Let the system be another, with some libraries, and note which are asked for."""

    def on(system: str, *there: str, fails: str = "") -> list[str]:
        asked: list[str] = []

        def load(name: str) -> Driver:
            asked.append(name)
            if name not in there:
                raise OSError(name)
            return Driver(fails)

        monkeypatch.setattr(libraries.sys, "platform", system)
        monkeypatch.setattr(libraries.ctypes, "CDLL", load)
        monkeypatch.delenv("CUDA_VISIBLE_DEVICES", raising=False)
        return asked

    return on


def test_a_gpu_needs_driver_and_ray_tracing_by_their_names(loaded: Callable[..., list[str]]) -> None:
    """Claim: on Linux CUDA's and OptiX's libraries are loaded, on Windows CUDA's alone; without one of them, or where
    the driver refuses, there is no GPU."""
    name = libraries.gpu_name.__wrapped__
    cuda, optix, dll = "libcuda.so.1", "libnvoptix.so.1", "nvcuda.dll"
    asked = loaded("linux", cuda, optix)
    assert (name(), asked) == ("GPU 40", [cuda, optix])
    asked = loaded("win32", dll)
    assert (name(), asked) == ("GPU 40", [dll])
    for system, there in (("linux", (cuda,)), ("linux", (optix, dll)), ("win32", (cuda, optix))):
        loaded(system, *there)
        assert name() is None
    for fails in ("init", "device", "name"):
        loaded("linux", cuda, optix, fails=fails)
        assert name() is None


@pytest.mark.parametrize(("system", "library"), [("linux", "libcuda.so.1"), ("win32", "nvcuda.dll")])
def test_gpus_are_counted_by_the_systems_driver(
    loaded: Callable[..., list[str]], monkeypatch: pytest.MonkeyPatch, system: str, library: str
) -> None:
    """Claim: the driver of the system counts them, from 0; one that cannot has none."""
    monkeypatch.setattr(libraries, "gpu_name", lambda: "GPU")
    asked = loaded(system, library)
    assert (libraries.visible_gpus.__wrapped__(), asked) == (("0", "1"), [library])
    loaded(system, library, fails="count")
    assert libraries.visible_gpus.__wrapped__() == ()


def test_on_windows_llvm_is_looked_for_in_its_folder_and_on_the_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: LLVM-C.dll in the folder of programs first, then in those of PATH; empty entries are none."""
    places = [tmp_path / "programs" / "LLVM" / "bin", tmp_path / "one", tmp_path / "two", tmp_path / "three"]
    for place in places:
        place.mkdir(parents=True)
    for place in (places[0], places[1], places[3]):
        (place / "LLVM-C.dll").touch()
    (places[2] / "libLLVM-19.so").touch()
    monkeypatch.setattr(libraries.sys, "platform", "win32")
    monkeypatch.setenv("PROGRAMFILES", str(tmp_path / "programs"))
    monkeypatch.setenv("PATH", os.pathsep.join(["", *map(str, places[1:])]))
    monkeypatch.chdir(places[1])
    found = [place / "LLVM-C.dll" for place in (places[0], places[1], places[3])]
    assert list(libraries._shared_libraries()) == found


def test_elsewhere_llvm_is_what_bears_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: of the linker's libraries and of those in the environment's folder those are taken that are LLVM's, with a
    version or without; on macOS the linker is not asked."""
    names = ["libLLVM.so", "libLLVM-19.so.1", "libLLVM.so.20.1", "libLLVM-17.so"]
    others = ["libLLVMCore.so", "libLLVM-19.a", "libLLVM.so.txt", "LLVM-C.dll"]
    (tmp_path / "lib").mkdir()
    for name in (*names, *others):
        (tmp_path / "lib" / name).touch()
    known = [Path("/far/libLLVM-18.so.1"), Path("/far/libLLVMIRReader.so")]
    monkeypatch.setattr(libraries, "_known_to_linker", lambda: iter(known))
    monkeypatch.setattr(libraries.sys, "prefix", str(tmp_path))
    for system, told in (("linux", known[:1]), ("darwin", [])):
        monkeypatch.setattr(libraries.sys, "platform", system)
        found = list(libraries._shared_libraries())
        assert [path for path in found if path.parent == Path("/far")] == told
        own = {path.name for path in found if path.parent == tmp_path / "lib"}
        assert own == set(names)


@pytest.mark.parametrize("on_path", [True, False])
def test_the_linkers_list_tells_llvm_by_any_of_its_names(
    on_path: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: of a list as Debian's ldconfig prints it, LLVM's files are found with the version before or behind the
    ending, also where ldconfig is out of the PATH; without ldconfig none are."""
    listing = (
        "3 libs found in cache `/etc/ld.so.cache'\n"
        "\tlibLTO.so.18.1 (libc6,x86-64) => /lib/x86_64-linux-gnu/libLTO.so.18.1\n"
        "\tlibLLVM.so.18.1 (libc6,x86-64) => /lib/x86_64-linux-gnu/libLLVM.so.18.1\n"
        "\tlibLLVM-15.so.1 (libc6,x86-64) => /opt/llvm/libLLVM-15.so.1\n"
    )
    asked = []

    def which(name: str, path: str = "") -> str | None:
        return f"/sbin/{name}" if on_path or "/sbin" in path.split(":") else None

    def run(command: list[str], **_: object) -> SimpleNamespace:
        asked.append(command)
        return SimpleNamespace(stdout=listing)

    monkeypatch.setattr(libraries.shutil, "which", which)
    monkeypatch.setattr(libraries.subprocess, "run", run)
    found = [str(path) for path in libraries._known_to_linker()]
    assert found == ["/lib/x86_64-linux-gnu/libLLVM.so.18.1", "/opt/llvm/libLLVM-15.so.1"]
    assert asked == [["/sbin/ldconfig", "-p"]]
    monkeypatch.setattr(libraries.shutil, "which", lambda *_, **__: None)
    assert not list(libraries._known_to_linker())
