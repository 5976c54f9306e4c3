"""QuadPlanes as the multirotors that they are in hover: their lifting controllers under the names that a copter's have.

ArduPlane runs the copter's libraries for the motors that lift: parameters Q_A_... are the copter's ATC_..., and so on;
its rate controllers log PIQR, PIQP and PIQY, its vertical control QTUN. Its PIDR, PIDP, PIDY and CTUN are those of the
fixed wing, which become FW_PIDR and so on.
"""

import re
from collections.abc import Collection, Iterable, Mapping
from types import MappingProxyType

import pandas as pd

from core.findings import Finding
from logparse.source import Boot, MessageSource

#: Beginnings of parameters' names, and those of the copter.
_PREFIXES: Mapping[str, str] = MappingProxyType(
    {"Q_A_": "ATC_", "Q_M_": "MOT_", "Q_P_": "PSC_", "Q_LOIT_": "LOIT_", "Q_WP_": "WPNAV_", "Q_FRAME_": "FRAME_"}
)
_OWN: Mapping[str, str] = MappingProxyType({new: own for own, new in _PREFIXES.items()})
_COPTER_NAME = re.compile(rf"\b(?:{'|'.join(_OWN)})(?=[A-Z])")

#: How ArduPlane flies chirps with the motors that lift.
CHIRP_SWITCH = "System ID (RCn_OPTION 184, in QHOVER or QLOITER)"

#: Messages of the motors that lift, and the copter's.
_LIFTING: Mapping[str, str] = MappingProxyType(
    {"PIQR": "PIDR", "PIQP": "PIDP", "PIQY": "PIDY", "PIQA": "PIDA", "QTUN": "CTUN"}
)
#: Messages with names of parameters, and the column that holds them.
_PARAMETERS: Mapping[str, str] = MappingProxyType({"PARM": "Name", "PARAM_VALUE": "param_id"})


def copter_name(parameter: str) -> str:
    """Name that a copter has for a parameter of a QuadPlane's lifting motors; any other as it is."""
    return next(
        (new + parameter.removeprefix(own) for own, new in _PREFIXES.items() if parameter.startswith(own)), parameter
    )


def own_names(text: str, firmware: str | None) -> str:
    """Return a name, or sentences with names, of a copter's parameters as the firmware itself knows them.

    Of a QuadPlane the inverse of `copter_name`; it has no mode SYSTEMID, but chirps in its Q modes.
    """
    if firmware != "ArduPlane":
        return text
    return _COPTER_NAME.sub(lambda found: _OWN[found[0]], text).replace("mode SYSTEMID", CHIRP_SWITCH)


def lifted_by_motors(firmware: str | None, parameters: Mapping[str, float]) -> bool:
    """Return whether a craft is a QuadPlane that hovers level: no tailsitter, which hovers on its tail."""
    return firmware == "ArduPlane" and parameters.get("Q_ENABLE", 0.0) > 0.0 and not parameters.get("Q_TAILSIT_ENABLE")


class HoveringSource(MessageSource):
    """A log of ArduPilot in which a QuadPlane is a copter; any other log is as it is."""

    def __init__(self, source: MessageSource):
        self._source = source
        self.format, self.prelude = source.format, source.prelude

    @property
    def boots(self) -> tuple[Boot, ...]:
        """At least one."""
        return self._source.boots

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What the scan and the decoding so far had to say."""
        return self._source.findings

    def counts(self, boot: Boot) -> Mapping[str, int]:
        """Return the messages of each type in this boot, by the copter's names."""
        logged = self._source.counts(boot)
        return {shown: logged[name] for shown, name in self._logged(boot).items()}

    def decode_many(
        self, names: Iterable[str], boot: Boot, fields: Collection[str] | None = None
    ) -> dict[str, pd.DataFrame]:
        """Return several message types by the copter's names."""
        logged = self._logged(boot)
        wanted = {logged[name]: name for name in names}
        found = {wanted[name]: rows for name, rows in self._source.decode_many(wanted, boot, fields).items()}
        for message, column in _PARAMETERS.items():
            if message in found and column in found[message]:
                rows = found[message]
                own = {name: copter_name(name) for name in rows[column].unique() if str(name).startswith("Q_")}
                if own:
                    found[message] = rows.assign(**{column: rows[column].replace(own)})
                    found[message].attrs = rows.attrs
        return found

    def parameters(self, boot: Boot) -> Mapping[str, float] | None:
        """Return the autopilot's parameters where the format keeps them outside its messages."""
        kept = self._source.parameters(boot)
        return None if kept is None else {copter_name(name): value for name, value in kept.items()}

    def _logged(self, boot: Boot) -> dict[str, str]:
        """Names as logged by those that are shown."""
        names = self._source.counts(boot)
        if not any(name in names for name in _LIFTING):
            return {name: name for name in names}
        wing = {name: f"FW_{name}" for name in _LIFTING.values()}
        return {_LIFTING.get(name, wing.get(name, name)): name for name in names}
