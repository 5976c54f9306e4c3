"""Where a log was flown and what the world is like there."""

from dataclasses import dataclass
from datetime import datetime

import numpy as np

from core.units import STANDARD_GRAVITY
from estimation.filter import World
from estimation.observations import find_origin, is_stuck
from estimation.place.local_frame import LocalFrame, is_simulated
from estimation.place.magnetic_field import MagneticField, world_field
from logparse import Geodetic, Tables


@dataclass(frozen=True, slots=True)
class Surroundings:
    """Where the log was flown, as far as it is known, and whether its compass is of any use."""

    origin: Geodetic | None
    frame: LocalFrame | None
    field: MagneticField | None
    world: World
    compass_useless: bool  #: Nor is then the heading that the autopilot took from it.

    @classmethod
    def of(cls, tables: Tables, date: datetime | None) -> "Surroundings":
        """Find the origin and what gravity, Earth's rotation and magnetic field are there."""
        origin = find_origin(tables)
        stuck = is_stuck(tables.mag, tables.imu)
        if origin is None:
            return cls(None, None, None, World(STANDARD_GRAVITY, np.zeros(3)), stuck)
        simulated = is_simulated(tables.parameters)
        frame = LocalFrame.at(origin, spherical=simulated)
        field = world_field(origin, tables.parameters, date)
        # The world of the firmware's simulator does not turn and has one gravity everywhere (GRAVITY_MSS).
        world = World(STANDARD_GRAVITY, np.zeros(3)) if simulated else World(frame.gravity, frame.earth_rate)
        return cls(origin, frame, field, world, stuck)
