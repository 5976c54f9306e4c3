"""Wire layout of MAVLink messages, from pymavlink's ArduPilot dialect.

The dialect ``ardupilotmega`` contains ``common``; both the reader (`tlog`) and the writer (`writer`) work from it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import Any

import numpy as np

from core.lazy import lazy

#: pymavlink's generated module, which takes 0.3 s to import.
pymavlink_dialect = lazy("pymavlink.dialects.v20.ardupilotmega")

_NUMPY_CODES = MappingProxyType(
    {
        "b": "i1",
        "B": "u1",
        "h": "<i2",
        "H": "<u2",
        "i": "<i4",
        "I": "<u4",
        "q": "<i8",
        "Q": "<u8",
        "f": "<f4",
        "d": "<f8",
    }
)


@dataclass(frozen=True, slots=True)
class MessageDefinition:
    """One message of the dialect."""

    name: str  #: MAVLink name, such as ``"ATTITUDE"``.
    id: int  #: Message id.
    crc_extra: int  #: CRC_EXTRA: the seed that the definition adds to each frame's checksum.
    #: Packed structured dtype of a payload that is not truncated, fields in wire order. Arrays are subarrays; ``char``
    #: arrays are byte strings (``S``).
    wire: np.dtype[Any]
    fields: tuple[str, ...]  #: Field names in the order of the definition.
    units: Mapping[str, str]  #: Unit of each field that has one, as the definition writes it.

    def dtype_and_offset(self, field: str) -> tuple[np.dtype[Any], int]:
        """Return the dtype of a field and its byte offset in the payload."""
        fields: Any = self.wire.fields
        dtype, offset = fields[field][:2]
        return dtype, offset


@cache
def definitions() -> Mapping[str, MessageDefinition]:
    """Return all messages of the dialect by name."""
    messages = pymavlink_dialect.mavlink_map.values()
    return MappingProxyType({message.msgname: _definition(message) for message in messages})


def _definition(message: Any) -> MessageDefinition:
    wire: list[Any] = []
    # `native_format` has one code per field in wire order; `array_lengths` has 0 for scalars.
    codes = bytes(message.native_format).decode().lstrip("<")
    for name, code, length in zip(message.ordered_fieldnames, codes, message.array_lengths, strict=True):
        if code == "c":
            wire.append((name, f"S{max(length, 1)}"))
        elif length:
            wire.append((name, _NUMPY_CODES[code], (length,)))
        else:
            wire.append((name, _NUMPY_CODES[code]))
    return MessageDefinition(
        name=message.msgname,
        id=message.id,
        crc_extra=message.crc_extra,
        wire=np.dtype(wire),
        fields=tuple(message.fieldnames),
        units=MappingProxyType(dict(message.fieldunits_by_name)),
    )
