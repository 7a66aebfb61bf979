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
    """The running firmware did something fatal; the message is one line with the program counter.

    kind: what it was, one of a few words. pc, function, line: where, as far as it is known. registers:
    name -> value, the core's and those of fault status, as the fault found them; empty if it is another's.
    """

    side = "firmware fault"

    def __init__(
        self,
        message: str,
        kind: str = "",
        pc: int = 0,
        function: str = "",
        line: str = "",
        registers: dict[str, int] | None = None,
    ) -> None:
        super().__init__(message)
        self.kind = kind
        self.pc = pc
        self.function = function
        self.line = line
        self.registers = registers or {}

    def report(self) -> str:
        """The message, and below it the registers, four to a line."""
        cells = [f"{name:>5} {value:08x}" for name, value in self.registers.items()]
        rows = ["  ".join(cells[k : k + 4]) for k in range(0, len(cells), 4)]
        return "\n".join([str(self), *rows])


class TrainingError(TargetError):
    """The training data or its settings cannot give a network."""

    side = "training"
