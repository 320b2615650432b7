"""What the simulator can compute on: the LLVM library and the GPU of this machine, found without loading Mitsuba.

Dr.Jit compiles kernels for the processor through the LLVM shared library. Version 14 it refuses;
versions 15 and 16 **abort the process** on kernels with ``min`` or ``max``, which no smoke test shows
(``benchmarks/llvm.py`` runs the simulator's own kernels on any library). So the library is chosen here, and an old one
is never handed to Dr.Jit.

Run as ``python -m scanner_sim.render.libraries`` it says what was found and exits 0, or 1 where LLVM
is missing. With ``--oldest`` it prints the oldest version that will do, and nothing else.
"""

from __future__ import annotations

import ctypes
import functools
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict

from scanner_sim.foundation.errors import InputError

OLDEST_LLVM = 19
"""The oldest major version known to work. 15 and 16 abort; 17 and 18, which Debian does not offer, are untried."""
LLVM_VARIABLE = "DRJIT_LIBLLVM_PATH"
LLVM_REMEDY = (
    f"Install LLVM {OLDEST_LLVM} or newer (`apt-get install libllvm{OLDEST_LLVM}` on Debian or Ubuntu, "
    "`brew install llvm` on macOS, the LLVM installer on Windows), "
    f"or set {LLVM_VARIABLE} to its shared library."
)

DeviceChoice = Literal["auto", "cpu", "cuda"]
"""What to compute on: ``auto`` takes a GPU where there is one."""
Version = tuple[int, int, int]


class LlvmLibrary(BaseModel):
    """An LLVM shared library that Dr.Jit can use.

    Attributes
    ----------
    path : Path
        The file to load.
    version : tuple of int
        Major, minor and patch number, as the library itself reports them.
    """

    model_config = ConfigDict(frozen=True)

    path: Path
    version: Version


def find_llvm() -> LlvmLibrary | None:
    """Find the newest LLVM library that Dr.Jit can use.

    A library named by the environment variable ``DRJIT_LIBLLVM_PATH`` is the user's will: it is
    taken or refused, never passed over in silence.

    Returns
    -------
    LlvmLibrary or None
        The newest library of version ``OLDEST_LLVM`` or later, or None if there is none.

    Raises
    ------
    InputError
        If ``DRJIT_LIBLLVM_PATH`` names something that is not an LLVM library of version ``OLDEST_LLVM`` or later.
    """
    wish = os.environ.get(LLVM_VARIABLE)
    if wish:
        return _named_by_user(Path(wish))
    return _newest(_candidates())


def need_system_libraries() -> None:
    """Stop if a library that Dr.Jit is linked against is not there: its import would end in a NameError of its own."""
    if sys.platform == "linux":
        try:
            ctypes.CDLL("libatomic.so.1")
        except OSError:
            raise InputError(
                "The library libatomic.so.1, which Dr.Jit needs, was not found.",
                remedy="Install it (`apt-get install libatomic1` on Debian, `dnf install libatomic` on Fedora).",
            ) from None


def _named_by_user(path: Path) -> LlvmLibrary:
    """Verify the library that ``DRJIT_LIBLLVM_PATH`` names."""
    remedy = f"{LLVM_REMEDY} Unset the variable to have the newest one found."
    if not path.is_file():
        raise InputError(f"{LLVM_VARIABLE} names {path}, which is not a file.", remedy=remedy)
    named = _version_from_name(path)
    version = None if named is not None and named[0] < OLDEST_LLVM else _verified_version(path)
    if version is None:
        age = "" if named is None else f" but LLVM {named[0]}"
        raise InputError(
            f"{LLVM_VARIABLE} names {path}, which is not LLVM {OLDEST_LLVM} or newer{age}.", remedy=remedy
        )
    return LlvmLibrary(path=path, version=version)


def _newest(paths: Iterable[Path]) -> LlvmLibrary | None:
    """Pick the newest usable library; files of unknown age are tried last."""
    ages = {path: _version_from_name(path) for path in paths}
    usable = [path for path, age in ages.items() if age is None or age[0] >= OLDEST_LLVM]
    for path in sorted(usable, key=lambda path: ages[path] or (0, 0, 0), reverse=True):
        version = _verified_version(path)
        if version is not None:
            return LlvmLibrary(path=path, version=version)
    return None


@functools.cache
def _version_from_name(path: Path) -> Version | None:
    """Read the version from the name of a library or of its folder, without loading it."""
    resolved = path.resolve()
    match = (
        re.match(r"libLLVM[-.](\d+(?:\.\d+)*)", resolved.name)
        or re.match(r"libLLVM\.so\.(\d+(?:\.\d+)*)", resolved.name)
        or re.match(r"libLLVM[-.](\d+(?:\.\d+)*)", path.name)
        or re.search(r"llvm[-@]?(\d+(?:\.\d+)*)[/\\]", str(resolved), re.IGNORECASE)
    )
    if match is None:
        return None
    numbers = [int(part) for part in match[1].split(".")][:3]
    major, minor, patch = numbers + [0] * (3 - len(numbers))
    return major, minor, patch


@functools.cache
def _verified_version(path: Path) -> Version | None:
    """Ask the library itself; None if it cannot be loaded or is too old.

    ``LLVMGetVersion`` exists since LLVM 16, so its absence proves an older library.
    """
    numbers = (ctypes.c_uint(), ctypes.c_uint(), ctypes.c_uint())
    try:
        ctypes.CDLL(str(path)).LLVMGetVersion(*(ctypes.byref(number) for number in numbers))
    except (OSError, AttributeError):
        return None
    major, minor, patch = (number.value for number in numbers)
    return (major, minor, patch) if major >= OLDEST_LLVM else None


@functools.cache
def _candidates() -> tuple[Path, ...]:
    """Return what looked like an LLVM shared library when it was first asked for: looking takes 20 ms."""
    return tuple(_shared_libraries())


def _shared_libraries() -> Iterator[Path]:
    """Every file on this machine that looks like an LLVM shared library."""
    if sys.platform == "win32":
        folders = [Path(os.environ.get("PROGRAMFILES", "C:/Program Files"), "LLVM", "bin")]
        folders += [Path(entry) for entry in os.environ.get("PATH", "").split(os.pathsep) if entry]
        yield from (folder / "LLVM-C.dll" for folder in folders if (folder / "LLVM-C.dll").is_file())
        return
    shared = re.compile(r"libLLVM(-\d[\d.]*)?\.(so|dylib)(\.\d[\d.]*)?|libLLVM\.\d[\d.]*\.dylib")
    if sys.platform == "darwin":
        roots = [Path("/opt/homebrew/opt"), Path("/usr/local/opt")]
        folders = [folder for root in roots for folder in root.glob("llvm*/lib")]
    else:
        yield from (path for path in _known_to_linker() if shared.fullmatch(path.name))
        folders = [Path("/usr/lib"), Path("/usr/lib64"), Path("/usr/local/lib"), *Path("/usr/lib").glob("*/")]
        folders += [*Path("/usr/lib").glob("llvm-*/lib"), *Path("/usr/lib64").glob("llvm*/lib")]
    folders.append(Path(sys.prefix, "lib"))
    for folder in folders:
        yield from (path for path in folder.glob("libLLVM*") if shared.fullmatch(path.name))


def _known_to_linker() -> Iterator[Path]:
    """Libraries in the cache of the dynamic linker."""
    # Debian keeps ldconfig out of an ordinary user's PATH.
    ldconfig = shutil.which("ldconfig") or shutil.which("ldconfig", path="/sbin:/usr/sbin")
    if ldconfig is None:
        return
    listing = subprocess.run([ldconfig, "-p"], capture_output=True, text=True, check=False).stdout
    yield from (Path(target) for target in re.findall(r"=> (\S*libLLVM\S*)", listing))


@functools.cache
def gpu_name() -> str | None:
    """Name of the first GPU that can both compute (CUDA) and trace rays (OptiX), or None."""
    windows = sys.platform == "win32"
    try:
        cuda = ctypes.CDLL("nvcuda.dll" if windows else "libcuda.so.1")
        if not windows:
            # Containers often pass CUDA through without OptiX; Mitsuba would fail on the first scene.
            # On Windows OptiX lies in the driver store, where only the driver itself finds it.
            ctypes.CDLL("libnvoptix.so.1")
        name = ctypes.create_string_buffer(256)
        gpu = ctypes.c_int()
        if cuda.cuInit(0) or cuda.cuDeviceGet(ctypes.byref(gpu), 0):
            return None
        if cuda.cuDeviceGetName(name, len(name), gpu):
            return None
    except (OSError, AttributeError):
        return None
    return name.value.decode(errors="replace")


@functools.cache
def visible_gpus() -> tuple[str, ...]:
    """Names of the GPUs that this process may use, as ``CUDA_VISIBLE_DEVICES`` spells them; none without a driver."""
    if gpu_name() is None:
        return ()
    if (chosen := os.environ.get("CUDA_VISIBLE_DEVICES")) is not None:
        return tuple(name.strip() for name in chosen.split(",") if name.strip())
    cuda, count = ctypes.CDLL("nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1"), ctypes.c_int()
    if cuda.cuDeviceGetCount(ctypes.byref(count)):
        return ()
    return tuple(str(number) for number in range(count.value))


def main() -> int:
    """Print what the simulator can compute on.

    Returns
    -------
    int
        0 if the processor can be used, 1 if LLVM is missing (a GPU does not replace it: the tests and
        the reference results are computed on the processor).
    """
    if sys.argv[1:] == ["--oldest"]:
        sys.stdout.write(f"{OLDEST_LLVM}\n")
        return 0
    try:
        need_system_libraries()
        llvm = find_llvm()
    except InputError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    if llvm is None:
        sys.stderr.write(f"No LLVM library of version {OLDEST_LLVM} or newer was found. {LLVM_REMEDY}\n")
        return 1
    version = ".".join(map(str, llvm.version))
    sys.stdout.write(f"LLVM {version}: {llvm.path}\nGPU: {gpu_name() or 'none'}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
