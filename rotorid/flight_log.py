"""A flight log with its trajectory and experiments at hand."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from pathlib import Path

import estimation
import logparse
from logparse import inspection
from logparse.inspection import Inspection
from pipeline.flight.account import account_of_log
from sysid.records.experiment import Experiment


class FlightLog(logparse.FlightLog):
    """One boot of a flight log, from which experiments are cut.

    Beside the attributes of `logparse.FlightLog` (``format messages tables parameters vehicle flights findings``) it
    has the `trajectory`, which is estimated when it is first asked for.
    """

    @cached_property
    def trajectory(self) -> estimation.Trajectory:
        """Smoothed position, velocity and attitude with their standard deviations."""
        return estimation.estimate(self.tables, date=self.start_utc)

    def experiment(
        self, rate: float = 10.0, inputs: str = "motors", outputs: str = "position", frame: str = "earth"
    ) -> Experiment:
        """Cut the longest usable piece of the longest flight and bring it to one clock.

        Parameters
        ----------
        rate : float
            Samples per second; 50 for physical models, 10 for transfer functions from motor PWM.
        inputs, outputs, frame : str
            As `sysid.Experiment.from_flight` takes them.

        Returns
        -------
        Experiment

        Raises
        ------
        MissingDataError
            Without these inputs, without a flight, or when the trajectory does not cover it.
        """
        name = self.path.name
        cut = Experiment.from_flight(self, self.trajectory, rate, inputs, outputs, frame, name=name)
        return replace(cut, log=self)


def inspect(path: str | Path) -> Inspection:
    """Return what happened in a log and what is in it: craft, flights, tables with their rates and gaps, findings.

    Parameters
    ----------
    path : path-like
        A log of any format.

    Returns
    -------
    Inspection

    Raises
    ------
    LogError
        As `load` raises it.
    """
    log = logparse.read_log(path)
    flights = logparse.read_flights(path) if len(log.flights) > 1 or len(log.boots) > 1 else (log,)
    happened = tuple(account_of_log(flown).headline for flown in flights)
    return replace(inspection.inspect(log), happened=happened)


def load(path: str | Path, boot: int | None = None) -> FlightLog:
    """Read a flight log of any format: DataFlash, telemetry or PX4.

    Parameters
    ----------
    path : path-like
    boot : int, optional
        Which power-up of the autopilot to show; default the one with the longest flight.

    Returns
    -------
    FlightLog

    Raises
    ------
    LogError
        The file is missing, empty, of an unknown format, or holds no intact message.
    """
    return logparse.read_log(path, boot, kind=FlightLog)
