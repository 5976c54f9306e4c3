"""A QuadPlane's log, made of a simulated copter's: its names, motors on outputs 5 to 8, a part on wings."""

import struct

from logparse.dataflash.format import HEADER

#: Bytes of the copter's log and of the QuadPlane's, of the same length.
NAMES = {
    b"ArduCopter V": b"ArduPlane  V",
    b"LOG_DISARMED\0\0\0\0": b"Q_ENABLE\0\0\0\0\0\0\0\0",  # both are 1
    b"FRAME_CLASS\0\0\0\0\0": b"Q_FRAME_CLASS\0\0\0",
    b"FRAME_TYPE\0\0\0\0\0\0": b"Q_FRAME_TYPE\0\0\0\0",
    b"ATC_": b"Q_A_",
    b"MOT_": b"Q_M_",
    b"PIDR": b"PIQR",
    b"PIDP": b"PIQP",
    b"PIDY": b"PIQY",
    b"CTUN": b"QTUN",
}


def quadplane(copter: bytes, on_wings: tuple[float, float] | None = None) -> bytes:
    """Return a copter's log as a QuadPlane's, whose motors stand between two times [s] in which wings carry it."""
    outputs = {b"SERVO%d_FUNCTION" % k: b"servo%d_FUNCTION" % (k + 4) for k in range(1, 5)}
    for own, new in (NAMES | outputs).items():
        copter = copter.replace(own, new)
    for k in range(5, 9):  # outputs change places with those of the motors
        copter = copter.replace(b"SERVO%d_FUNCTION" % k, b"SERVO%d_FUNCTION" % (k - 4))
    copter = copter.replace(b"servo", b"SERVO").replace(b"C1,C2,C3,C4,C5,C6,C7,C8", b"C5,C6,C7,C8,C1,C2,C3,C4")
    changed = bytearray(copter)
    if on_wings is not None:
        defined = copter.index(b"RCOU")  # within its FMT: header, type 128, id, length, name
        row, length = HEADER + copter[defined - 2 : defined - 1], copter[defined - 1]
        at = copter.find(row)
        while at >= 0:
            time, *pulses = struct.unpack_from("<Q4H", copter, at + 3)
            if on_wings[0] <= time * 1e-6 <= on_wings[1] and 1000 < pulses[0] < 2000:
                struct.pack_into("<4H", changed, at + 11, 1000, 1000, 1000, 1000)
            at = copter.find(row, at + length)
    return bytes(changed)
