"""Where the simulator computes: the one place that chooses a Mitsuba variant."""

from __future__ import annotations

import os
from typing import Literal

import drjit as dr
import mitsuba as mi
from pydantic import BaseModel, ConfigDict, PositiveInt

from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.host_memory import keep_freed_memory
from scanner_sim.render.libraries import (
    LLVM_REMEDY,
    LLVM_VARIABLE,
    OLDEST_LLVM,
    DeviceChoice,
    LlvmLibrary,
    find_llvm,
    gpu_name,
    need_system_libraries,
)
from scanner_sim.render.plugins.retroreflector import register_retroreflector


class Device(BaseModel):
    """What the simulator computes on.

    Attributes
    ----------
    variant : str
        The Mitsuba variant in force.
    llvm : LlvmLibrary or None
        The library behind the processor kernels; None where only the GPU is usable.
    threads : int
        Number of worker threads.
    gpu : str or None
        Name of the GPU in use; None on the processor.
    """

    model_config = ConfigDict(frozen=True)

    variant: Literal["llvm_ad_mono", "cuda_ad_mono"]
    llvm: LlvmLibrary | None
    threads: PositiveInt
    gpu: str | None


def activate(device: DeviceChoice = "auto", threads: int | None = None) -> Device:
    """Choose the Mitsuba variant; call it before anything else sets one.

    May be called again: the same choice changes nothing, another one switches the variant.

    Parameters
    ----------
    device : {"auto", "cpu", "cuda"}
        ``auto`` takes the GPU if there is a usable one, else the processor.
    threads : int, optional
        Number of worker threads; by default all cores, or what an earlier call set.

    Returns
    -------
    Device
        What was chosen.

    Raises
    ------
    InputError
        If the device is not there, LLVM or another library is missing or too old, or ``threads`` is not positive.
    """
    need_system_libraries()
    keep_freed_memory()
    if device not in ("auto", "cpu", "cuda"):
        raise InputError(f"There is no device {device!r}.", remedy="Choose auto, cpu or cuda.")
    if threads is not None and threads < 1:
        raise InputError(f"{threads} threads cannot compute anything.", remedy="Ask for 1 or more threads.")
    gpu = None if device == "cpu" else gpu_name()
    if device == "cuda" and gpu is None:
        raise InputError(
            "No usable NVIDIA GPU was found (CUDA and OptiX are needed).",
            remedy="Install a current NVIDIA driver, or choose the device cpu.",
        )
    llvm = find_llvm()
    if gpu is None and llvm is None:
        raise InputError(f"No LLVM library of version {OLDEST_LLVM} or newer was found.", remedy=LLVM_REMEDY)
    if llvm is not None:
        # Set for the GPU too: Dr.Jit would otherwise settle on any old library it comes across.
        os.environ[LLVM_VARIABLE] = str(llvm.path)

    variant: Literal["llvm_ad_mono", "cuda_ad_mono"] = "llvm_ad_mono" if gpu is None else "cuda_ad_mono"
    if mi.variant() != variant:
        mi.set_variant(variant)
    # Here, because scenes are loaded in a room that may not import this one, and name the plugin.
    register_retroreflector()
    dr.set_backend("llvm" if gpu is None else "cuda")  # what ``drjit.auto`` stands for
    if gpu is None:
        _refuse_old_llvm_in_use(dr.detail.llvm_version())
    if threads is not None and threads != dr.thread_count():
        dr.set_thread_count(threads)
    return Device(variant=variant, llvm=llvm, threads=dr.thread_count(), gpu=gpu)


def _refuse_old_llvm_in_use(version: tuple[int, ...]) -> None:
    """Stop if Dr.Jit had loaded an old library before this module could choose one."""
    if version[0] < OLDEST_LLVM:
        raise InputError(
            f"Dr.Jit already loaded LLVM {version[0]}, which cannot compile the simulator's kernels.",
            remedy="Activate the device of scanner_sim before Mitsuba sets a variant.",
        )
