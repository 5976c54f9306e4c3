"""Motors that give less than they are asked for: lost, weak, for moments or since when (`find_motor_faults`)."""

from sysid.rotors.motor_faults.faults import MotorFault, find_motor_faults
from sysid.rotors.motor_faults.moments import too_slow

__all__ = ["MotorFault", "find_motor_faults", "too_slow"]
