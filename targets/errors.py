"""Errors of the target side. Each message is one line that names the value at fault."""


class TargetError(Exception):
    """Something on the ECU's side of the bus is wrong; `side` opens the message shown to the user."""

    side = "ecu"


class CalibrationError(TargetError):
    """The calibration data cannot be used."""

    side = "calibration"


class FirmwareError(TargetError):
    """The firmware image cannot be loaded (not an ELF, another machine, outside memory)."""

    side = "firmware"


class FirmwareFault(TargetError):
    """The running firmware did something fatal; the message holds the program counter."""

    side = "firmware fault"


class TrainingError(TargetError):
    """The training data or its settings cannot give a network."""

    side = "training"
