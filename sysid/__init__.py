"""Identification: experiments to models, and models to honest verdicts.

Inputs and outputs come as an `Experiment`. Every model offers ``simulate(experiment)`` (free run from the initial
state), ``predict(experiment, horizon)`` (restarted at every sample), ``to_dict()`` for JSON, ``findings`` and
``training`` (names of the records it was fitted to); `validate` judges it on records it has not seen.
"""

from sysid.arx import ArxModel, fit_arx
from sysid.bench import Bench, analyse_bench
from sysid.bench_table import BenchError, read_bench
from sysid.bifilar import bifilar, check_thread
from sysid.body_fit import fit_rigid_body
from sysid.closed_loop import ClosedLoopModel, fit_closed_loop
from sysid.craft_export import write_craft
from sysid.experiment import Experiment, ExperimentError
from sysid.frame_json import FrameExport, frame_json
from sysid.hover import HoverModel, hover_from_speeds, hover_model
from sysid.kim2017 import Kim2017Model, fit_kim2017
from sysid.order import OrderScan, scan_orders
from sysid.pem import fit_transfer_functions
from sysid.physical import PhysicalParameters, physical_parameters
from sysid.refinement2020 import Refinement2020Model, fit_refinement2020
from sysid.rigid_body import BodyParameter, RigidBodyModel
from sysid.rotor import RotorModel, fit_rotor
from sysid.thrust import ThrustModel, fit_thrust
from sysid.thrust_regression import ThrustCoefficient
from sysid.transfer_function import FitReport, TransferFunction, TransferFunctionModel
from sysid.validation import Model, Validation, validate
from sysid.wind import FlightTrim

__all__ = [
    "ArxModel",
    "Bench",
    "BenchError",
    "BodyParameter",
    "ClosedLoopModel",
    "Experiment",
    "ExperimentError",
    "FitReport",
    "FlightTrim",
    "FrameExport",
    "HoverModel",
    "Kim2017Model",
    "Model",
    "OrderScan",
    "PhysicalParameters",
    "Refinement2020Model",
    "RigidBodyModel",
    "RotorModel",
    "ThrustCoefficient",
    "ThrustModel",
    "TransferFunction",
    "TransferFunctionModel",
    "Validation",
    "analyse_bench",
    "bifilar",
    "check_thread",
    "fit_arx",
    "fit_closed_loop",
    "fit_kim2017",
    "fit_refinement2020",
    "fit_rigid_body",
    "fit_rotor",
    "fit_thrust",
    "fit_transfer_functions",
    "frame_json",
    "hover_from_speeds",
    "hover_model",
    "physical_parameters",
    "read_bench",
    "scan_orders",
    "validate",
    "write_craft",
]
