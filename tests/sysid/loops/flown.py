"""A simulated craft flown with a chirp, as loop records; and its true loop."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from simulation.copter_loop import CraftAxis, LoopFlight, LoopGains
from simulation.copter_loop.axis import GYRO_HZ
from sysid.frequency.records import AxisRecord
from sysid.loops.controller import AngleController, RateController
from sysid.loops.loop import RateLoop, loop_of_records
from sysid.loops.settings import GyroPath, LoopSettings
from sysid.loops.signals import LoopRecord


def settings_of(gains: LoopGains) -> LoopSettings:
    return LoopSettings(
        axis="roll",
        controller=RateController(
            P=gains.P,
            I=gains.I,
            D=gains.D,
            FF=gains.FF,
            FLTT=gains.FLTT,
            FLTE=gains.FLTE,
            FLTD=gains.FLTD,
            IMAX=gains.IMAX,
        ),
        angle=AngleController(P=gains.angle_P),
        gyro=GyroPath(gains.gyro_filter, GYRO_HZ),
    )


def loop_of_flight(flight: LoopFlight, gains: LoopGains, name: str = "simulated") -> RateLoop:
    def record(output: NDArray[np.float64]) -> AxisRecord:
        return AxisRecord(
            name=name,
            start=0.0,
            dt=float(flight.t[1] - flight.t[0]),
            inputs=flight.output[:, None],
            output=output,
            instruments=flight.chirp[:, None],
            usable=np.ones(len(flight.t), dtype=bool),
            band=(0.5, 40.0),
            instrument="chirp",
        )

    records = (LoopRecord(record(flight.measured), record(flight.feedback)),)
    return loop_of_records(name, records, settings_of(gains))


def true_loop(axis: CraftAxis, gains: LoopGains, hz: NDArray[np.float64]) -> NDArray[np.complex128]:
    settings = settings_of(gains)
    return axis.response(hz) * settings.gyro.response(hz) * settings.feedback(hz)
