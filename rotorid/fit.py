"""Fits by their short names: each takes one experiment or a list of them, and returns a model.

=======================  =============================================
``transfer_functions``   `sysid.fit_transfer_functions`
``closed_loop``          `sysid.fit_closed_loop`
``arx``                  `sysid.fit_arx`
``rigid_body``           `sysid.fit_rigid_body`
``six_dof``              `sysid.fit_six_dof`
``thrust``               `sysid.fit_thrust`
``kim2017``              `sysid.fit_kim2017`
``refinement2020``       `sysid.fit_refinement2020`
=======================  =============================================
"""

from sysid.rigid_body.body_fit import fit_rigid_body as rigid_body
from sysid.rigid_body.six_dof.fit import fit_six_dof as six_dof
from sysid.rotors.kim2017 import fit_kim2017 as kim2017
from sysid.rotors.refinement2020 import fit_refinement2020 as refinement2020
from sysid.rotors.thrust import fit_thrust as thrust
from sysid.transfer_functions.arx import fit_arx as arx
from sysid.transfer_functions.closed_loop import fit_closed_loop as closed_loop
from sysid.transfer_functions.pem import fit_transfer_functions as transfer_functions

__all__ = [
    "arx",
    "closed_loop",
    "kim2017",
    "refinement2020",
    "rigid_body",
    "six_dof",
    "thrust",
    "transfer_functions",
]
