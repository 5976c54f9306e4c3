"""Identification: experiments to models, and models to honest verdicts.

Inputs and outputs come as an `Experiment`. Every model offers ``simulate(experiment)`` (free run from the initial
state), ``predict(experiment, horizon)`` (restarted at every sample), ``to_dict()`` for JSON, ``findings`` and
``training`` (names of the records it was fitted to); `validate` judges it on records it has not seen.
"""

from sysid.arx import ArxModel, fit_arx
from sysid.body_fit import fit_rigid_body
from sysid.closed_loop import ClosedLoopModel, fit_closed_loop
from sysid.experiment import Experiment, ExperimentError
from sysid.order import OrderScan, scan_orders
from sysid.pem import fit_transfer_functions
from sysid.rigid_body import BodyParameter, RigidBodyModel
from sysid.thrust import ThrustModel, fit_thrust
from sysid.thrust_regression import ThrustCoefficient
from sysid.transfer_function import FitReport, TransferFunction, TransferFunctionModel
from sysid.validation import Model, Validation, validate
from sysid.wind import FlightTrim

__all__ = [
    "ArxModel",
    "BodyParameter",
    "ClosedLoopModel",
    "Experiment",
    "ExperimentError",
    "FitReport",
    "FlightTrim",
    "Model",
    "OrderScan",
    "RigidBodyModel",
    "ThrustCoefficient",
    "ThrustModel",
    "TransferFunction",
    "TransferFunctionModel",
    "Validation",
    "fit_arx",
    "fit_closed_loop",
    "fit_rigid_body",
    "fit_thrust",
    "fit_transfer_functions",
    "scan_orders",
    "validate",
]
