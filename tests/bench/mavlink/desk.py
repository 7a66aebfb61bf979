"""A ground station's packets, and a lap with its fault panel at whose other end they arrive."""

from pymavlink.dialects.v20 import common

from bench.codec import Codec
from bench.faults.spec import parse_fault
from bench.mavlink.injector import Injector
from bench.mavlink.link import Link, Rights
from bench.mavlink.telemetry import Telemetry
from bench.panel import Panel
from bench.script import Script
from bench.sensors.codes import acquire
from bench.watch import Watch
from targets.ecu import Frame
from tests.conftest import wavy_lap

MS = 1_000_000
CODEC = Codec()
HOME = ("127.0.0.1", 14550)
INJECT = common.MAV_CMD_INJECT_FAILURE
GYRO, ACCEL, DISTANCE = 0, 1, 7
OK, OFF, STUCK, GARBAGE, WRONG, SLOW, DELAYED, INTERMITTENT = range(8)
ACCEPTED, REJECTED, DENIED, UNSUPPORTED, FAILED, IN_PROGRESS = range(6)


class Station:
    """Packs commands and reads what comes back, with pymavlink."""

    def __init__(self, system=255, component=190):
        self.link = common.MAVLink(None, system, component)
        self.parser = common.MAVLink(None)

    def long(self, unit, kind, instance, confirmation=0, command=INJECT, to=(1, 1), version_1=False):
        words = (command, confirmation, unit, kind, instance, 0, 0, 0, 0)
        return common.MAVLink_command_long_message(*to, *words).pack(self.link, version_1)

    def int(self, unit, kind, instance, command=INJECT, to=(1, 1)):
        words = (0, command, 0, 0, unit, kind, instance, 0, 0, 0, 0)
        return common.MAVLink_command_int_message(*to, *words).pack(self.link)

    def read(self, data):
        return self.parser.parse_buffer(data) or []


class Lap:
    """A lap of `seconds` under way, its panel and its link; time passes when it is told to."""

    def __init__(self, seconds=3.0, names=(), rights=None, watch=True, speed=1.0, executor=None, planned=()):
        self.script = Script(acquire(wavy_lap(seconds, names)), CODEC, map(parse_fault, planned))
        self.panel = Panel(self.script, executor)
        self.watch = Watch(CODEC) if watch else None
        self.injector = Injector(self.panel, round(1e9 * speed))
        self.load = 12.5
        telemetry = Telemetry(self.watch, self.panel, speed, lambda _: self.load)
        self.link = Link(telemetry, self.injector, rights or Rights(True), 10**15, speed)
        self.station = Station()
        self.alive = 0

    def to(self, t_ms):
        """What the link says at `t_ms`, when all that is due by then has been taken: (message, to whom)."""
        while self.script.take(t_ms * MS):
            pass
        self.panel.settle(t_ms * MS)
        return self.read(self.link.turn(t_ms * MS))

    def read(self, datagrams):
        return [(message, to) for data, to in datagrams for message in self.station.read(data)]

    def acks(self, t_ms):
        return results(self.to(t_ms))

    def ask(self, t_ms, packet, source=HOME):
        """The results at `t_ms`, when `packet` has come."""
        self.link.hear(packet, source)
        return self.acks(t_ms)

    def answer(self, t_ms, alarm=0, kind=0, predicted=400, residual=250):
        """The ECU says so."""
        self.alive = (self.alive + 1) & 15
        raw = {"predicted_mm": predicted, "residual_pct": residual, "alarm": alarm, "kind": kind}
        raw |= {"ready": 1, "alive": self.alive, "step": 0}
        self.watch.heard(Frame(0x200, CODEC.pack("IFD_STATUS", raw)[0].tobytes()), t_ms * MS)


def results(said):
    return [message.result for message, _ in said if message.get_type() == "COMMAND_ACK"]


def texts(said):
    return [(m.severity, m.text) for m, _ in said if m.get_type() == "STATUSTEXT"]
