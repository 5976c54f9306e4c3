"""The compiled loops of an ordinary analysis, compiled side by side before it where a machine has none yet.

Each would else be compiled when it is first called, one after the other, by every process that calls it.
"""

import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

import core._spline_kernels as splines
import estimation._kernels as filter_and_smoother
import estimation._splines as imu_splines
import logparse.dataflash._decode as dataflash
import logparse.timebase as timebase
import sysid.frequency.spectra as windows
import sysid.records.filtering as filters
import sysid.records.resampling as resampling
import sysid.rigid_body._filter_kernels as body_filters
import sysid.rigid_body._rigid_kernels as rigid_body
import sysid.transfer_functions._kernels as transfer_functions
from core.compiled import can_be_kept, compile_ahead, is_kept
from pipeline.execution import executors
from pipeline.execution.stages import Progress, silent

#: What takes longest comes first, so that two processes end at about the same time.
KERNELS: tuple[Callable[..., Any], ...] = (
    filter_and_smoother.forward,
    filter_and_smoother.backward,
    dataflash.follow_chain,
    dataflash.gather,
    rigid_body.accelerations,
    body_filters.carry,
    transfer_functions.multiply_out,
    splines.interpolated,
    imu_splines.along_spline,
    rigid_body.ahead,
    windows.products,
    resampling.filtered_at,
    transfer_functions.recur,
    transfer_functions.recur_few,
    body_filters.whiten,
    filters.filtered,
    timebase.is_orderly,
    dataflash.index_messages,
)


def compile_missing(progress: Progress = silent, kernels: Sequence[Callable[..., Any]] = KERNELS) -> None:
    """Compile what is not on the disk yet, half of it in a copy of this process where there is a second processor."""
    missing = [kernel for kernel in kernels if can_be_kept(kernel) and not is_kept(kernel)]
    if not all(can_be_kept(kernel) for kernel in kernels):
        progress("compiling in every run: set NUMBA_CACHE_DIR to a folder that can be written", 0.0)
    if not missing:
        return
    progress("compiling the numerical loops, once on this computer", 0.0)
    taking, giving = os.pipe()
    os.write(giving, bytes(range(len(missing))))
    os.close(giving)

    def work() -> None:
        # Whoever reads a byte, this process or its copy, has the kernel of that number to compile.
        while byte := os.read(taking, 1):
            with suppress(Exception):  # it is compiled when it is called, and what is wrong is said there
                compile_ahead(missing[byte[0]])

    aside = executors.begin(work)
    work()
    aside()
    os.close(taking)
