"""Identification: experiments to models, and models to honest verdicts.

Inputs and outputs come as an `Experiment`. Every model offers ``simulate(experiment)`` (free run from the initial
state), ``predict(experiment, horizon)`` (restarted at every sample), ``to_dict()`` for JSON, ``findings`` and
``training`` (names of the records it was fitted to); `validate` judges it on records it has not seen.
"""

from sysid.closed_loop import ClosedLoopModel, fit_closed_loop
from sysid.experiment import Experiment, ExperimentError
from sysid.order import OrderScan, scan_orders
from sysid.pem import fit_transfer_functions
from sysid.thrust import ThrustModel, fit_thrust
from sysid.thrust_regression import ThrustCoefficient
from sysid.transfer_function import FitReport, TransferFunction, TransferFunctionModel
from sysid.validation import Model, Validation, validate

__all__ = [
    "ClosedLoopModel",
    "Experiment",
    "ExperimentError",
    "FitReport",
    "Model",
    "OrderScan",
    "ThrustCoefficient",
    "ThrustModel",
    "TransferFunction",
    "TransferFunctionModel",
    "Validation",
    "fit_closed_loop",
    "fit_thrust",
    "fit_transfer_functions",
    "scan_orders",
    "validate",
]
