"""Identification: experiments to models, and models to honest verdicts.

Inputs and outputs come as an `Experiment`. Every model offers ``simulate(experiment)`` (free run from the initial
state), ``predict(experiment, horizon)`` (restarted at every sample), ``findings`` and ``training`` (names of the
records it was fitted to); `validate` judges it on records it has not seen. Names are imported when they are first used.
"""

from typing import TYPE_CHECKING

from core.lazy import exports

if TYPE_CHECKING:
    from sysid.bench.pendulum import bifilar, check_thread
    from sysid.bench.stand import Bench, analyse_bench
    from sysid.bench.table import BenchError, read_bench
    from sysid.records.experiment import Experiment, ExperimentError
    from sysid.records.table_export import write_table
    from sysid.rigid_body.body_fit import fit_rigid_body
    from sysid.rigid_body.craft_export import FrameExport, frame_json, write_craft
    from sysid.rigid_body.hover import HoverModel, hover_from_speeds, hover_model
    from sysid.rigid_body.model import RigidBodyModel
    from sysid.rigid_body.model_record import BodyParameter, FlightTrim
    from sysid.rigid_body.physical import PhysicalParameters, physical_parameters
    from sysid.rigid_body.six_dof.air import WindTrack, estimate_trim, estimate_wind
    from sysid.rigid_body.six_dof.fit import fit_six_dof
    from sysid.rigid_body.six_dof.learning import choose_observer, learn_correction
    from sysid.rigid_body.six_dof.model import SixDofModel
    from sysid.rotors.kim2017 import Kim2017Model, fit_kim2017
    from sysid.rotors.refinement2020 import Refinement2020Model, fit_refinement2020
    from sysid.rotors.thrust import fit_thrust
    from sysid.rotors.thrust_record import ThrustCoefficient, ThrustModel
    from sysid.transfer_functions.arx import ArxModel, fit_arx
    from sysid.transfer_functions.closed_loop import ClosedLoopModel, fit_closed_loop
    from sysid.transfer_functions.frequency_response import ModelResponse, frequency_response
    from sysid.transfer_functions.model_record import FitReport
    from sysid.transfer_functions.pem import fit_transfer_functions
    from sysid.transfer_functions.transfer_function import (
        TransferFunction,
        TransferFunctionModel,
        poles,
        zeros,
    )
    from sysid.validation.assessment import Model, Predictor, Validation, validate
    from sysid.validation.order import scan_orders
    from sysid.validation.report import OrderScan
    from sysid.validation.states import StateValidation, validate_states

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
    "ModelResponse",
    "OrderScan",
    "PhysicalParameters",
    "Predictor",
    "Refinement2020Model",
    "RigidBodyModel",
    "SixDofModel",
    "StateValidation",
    "ThrustCoefficient",
    "ThrustModel",
    "TransferFunction",
    "TransferFunctionModel",
    "Validation",
    "WindTrack",
    "analyse_bench",
    "bifilar",
    "check_thread",
    "choose_observer",
    "estimate_trim",
    "estimate_wind",
    "fit_arx",
    "fit_closed_loop",
    "fit_kim2017",
    "fit_refinement2020",
    "fit_rigid_body",
    "fit_six_dof",
    "fit_thrust",
    "fit_transfer_functions",
    "frame_json",
    "frequency_response",
    "hover_from_speeds",
    "hover_model",
    "learn_correction",
    "physical_parameters",
    "poles",
    "read_bench",
    "scan_orders",
    "validate",
    "validate_states",
    "write_craft",
    "write_table",
    "zeros",
]

__getattr__, __dir__ = exports(__name__, __file__)
