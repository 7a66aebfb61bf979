"""The link: what a ground station is told, what is recorded, and packets that are damaged or hostile."""

import struct
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common

from bench.errors import MavlinkError
from bench.laps.mavlink.framing import find
from bench.mavlink import link as link_room
from bench.mavlink import packets
from bench.mavlink.link import MOST_A_TURN
from bench.mavlink.packets import split, unpack
from tests.bench.mavlink.desk import ACCEPTED, DISTANCE, HOME, IN_PROGRESS, MS, OFF, OK, Lap, Station, texts


def kinds(said):
    return [message.get_type() for message, _ in said]


def values(said):
    return {m.name: m.value for m, _ in said if m.get_type() == "NAMED_VALUE_FLOAT"}


def test_heartbeat_and_values():
    """In two seconds, turned every 10 ms: a heartbeat each second and each value ten times a second."""
    lap = Lap()
    said = []
    for k in range(200):
        lap.answer(10 * k)
        said += lap.to(10 * k)
    assert kinds(said).count("HEARTBEAT") == 2
    names = [m.name for m, _ in said if m.get_type() == "NAMED_VALUE_FLOAT"]
    assert {name: names.count(name) for name in names} == {"busload": 20, "residual": 20, "predicted": 20}
    assert all(to is None for _, to in said)


@pytest.mark.parametrize("speed", [0.1, 4.0])
def test_rates_keep_to_the_walls_time(speed):
    """Faster or slower than the wall's, the ground station hears as much a second of its own."""
    lap = Lap(2.0, speed=speed)
    said = [one for t_ms in range(0, 2000, 5) for one in lap.to(t_ms)]
    assert kinds(said).count("HEARTBEAT") == max(1, round(2 / speed))
    assert kinds(said).count("NAMED_VALUE_FLOAT") == round(20 / speed)


def test_values_are_the_watchs():
    """Residual, prediction, step and load are the last that were heard, under the bench's time."""
    lap = Lap()
    lap.answer(90, predicted=401, residual=123)
    lap.watch.step_cycles.append(5678)
    said = lap.to(100)
    answer = lap.watch.answers[-1]
    expected = {"residual": answer.residual_pct, "predicted": answer.predicted_mm}
    expected |= {"step_cyc": 5678, "busload": 12.5}
    assert values(said) == pytest.approx(expected)
    assert {m.time_boot_ms for m, _ in said if m.get_type() == "NAMED_VALUE_FLOAT"} == {100}
    assert all(len(name) <= 10 for name in expected)


def test_nothing_new_nothing_said():
    """What has not been heard again is not told again, and what is no number not at all."""
    lap = Lap()
    lap.answer(90)
    lap.to(100)
    lap.load = None
    assert values(lap.to(200)) == {}
    lap.watch.answers.append(lap.watch.answers[-1]._replace(residual_pct=float("nan")))
    assert set(values(lap.to(300))) == {"predicted"}


def test_without_an_ecu():
    """Where no ECU is expected the bench still says that it is there, and how full the bus is."""
    assert kinds(Lap(watch=False).to(100)) == ["HEARTBEAT", "NAMED_VALUE_FLOAT"]


def test_alarm_with_its_time_to_detect():
    """An alarm is an ALERT with the fault's time to detect, its end a NOTICE; the heartbeat shows it."""
    lap = Lap()
    lap.to(100)
    lap.ask(100, lap.station.long(DISTANCE, OFF, 2))
    acted_ns = lap.panel.entries(100 * MS)[0].insertion.t_active_ns
    lap.answer(150)
    assert texts(lap.to(150)) == []
    lap.answer(160, alarm=1, kind=1)
    kind = lap.watch.alarms[0].kind
    td_s = (160 * MS - acted_ns) / 1e9
    assert texts(lap.to(160)) == [(common.MAV_SEVERITY_ALERT, f"alarm {kind}, TD {td_s:.3f} s")]
    lap.answer(170, alarm=1, kind=1)
    said = lap.to(1000)
    assert texts(said) == []
    assert said[0][0].system_status == common.MAV_STATE_CRITICAL
    lap.answer(1200)
    assert texts(lap.to(1200)) == [(common.MAV_SEVERITY_NOTICE, f"alarm {kind} taken back after 1.040 s")]
    assert lap.to(2000)[0][0].system_status == common.MAV_STATE_ACTIVE


def test_alarm_without_a_fault():
    """An alarm while no fault is active says so; one that came and went between two turns is told whole."""
    lap = Lap()
    lap.answer(100, alarm=1)
    lap.answer(110)
    lap.answer(120, alarm=1)
    said = [text for _, text in texts(lap.to(130))]
    assert said == ["alarm, no fault active", "alarm taken back after 0.010 s", "alarm, no fault active"]


def test_alarm_after_the_fault():
    """A fault that has ended is none that an alarm could have detected."""
    lap = Lap(planned=("rear_stroke:open@0.05+0.1",))
    lap.answer(150, alarm=1)
    assert texts(lap.to(160)) == [(common.MAV_SEVERITY_ALERT, "alarm, no fault active")]


def test_record():
    """The .tlog holds every packet, sent and heard, under its microsecond since 1970, and nothing else."""
    lap = Lap(speed=2.0)
    heard = lap.station.long(DISTANCE, OFF, 2)
    lap.link.hear(heard, HOME)
    sent = [len(data) for data, _ in lap.link.turn(1_000_000_000)]
    found = find(np.frombuffer(lap.link.records, np.uint8))
    assert (found.start[0], found.end[-1]) == (0, len(lap.link.records))
    assert (found.end[:-1] == found.start[1:]).all()
    assert (found.end - found.start - 8).tolist() == [len(heard), *sent]
    stamps = {struct.unpack_from(">Q", lap.link.records, at)[0] for at in found.start}
    assert stamps == {10**15 + 500_000}


def test_record_has_an_end(monkeypatch):
    """A .tlog that is full takes no more; what it lacks is counted."""
    monkeypatch.setattr(link_room, "MOST_RECORDED", 50)
    lap = Lap()
    lap.to(0)
    lap.to(100)
    assert len(lap.link.records) < 200
    assert lap.link.left_out > 0


def test_flood_is_read_bit_by_bit():
    """However many packets come at once, so many are looked at in a turn, and the others wait."""
    lap = Lap()
    packet = lap.station.long(DISTANCE, 99, 2)
    lap.link.hear(packet * 20, HOME)
    assert not lap.link.hungry
    assert [len(lap.acks(t_ms)) for t_ms in (10, 20, 30, 40)] == [MOST_A_TURN, MOST_A_TURN, 4, 0]
    assert lap.link.hungry


def test_signed():
    """A signed packet is read as an unsigned one: the bench has no keys."""
    lap, station = Lap(), Station()
    station.link.signing.secret_key, station.link.signing.sign_outgoing = bytes(32), True
    assert lap.ask(100, station.long(DISTANCE, OFF, 2)) == [IN_PROGRESS]


# --- damaged and hostile ------------------------------------------------------------------------------------

LAP = Lap(1.0)
"""One for all that must not act."""


def refused(datagram, source=HOME):
    """How many packets of `datagram` were refused; nothing may have been injected."""
    before = LAP.link.refused
    LAP.link.hear(datagram, source)
    while not LAP.link.hungry:
        LAP.link.turn(100 * MS)
    LAP.link.turn(100 * MS)
    assert LAP.panel.entries(100 * MS) == []
    return LAP.link.refused - before


@settings(max_examples=300)
@given(st.binary(max_size=400) | st.binary(max_size=300).map(lambda data: b"\xfd" + data))
def test_random_bytes(data):
    """Bytes that are no packets are refused, whatever they are; nothing is raised and nothing injected."""
    assert refused(data) >= (len(data) > 0)


@settings(max_examples=300)
@given(st.data(), st.booleans(), st.booleans())
def test_flipped_bits(data, version_1, as_int):
    """A command with up to three bits flipped is never carried out."""
    station = Station()
    good = station.int(DISTANCE, OFF, 2) if as_int else station.long(DISTANCE, OFF, 2, version_1=version_1)
    packet = bytearray(good)
    for bit in data.draw(st.sets(st.integers(0, 8 * len(packet) - 1), min_size=1, max_size=3)):
        packet[bit >> 3] ^= 1 << (bit & 7)
    assert refused(bytes(packet)) >= 1


@settings(max_examples=100)
@given(st.data(), st.binary(max_size=30))
def test_cut_and_followed(data, rest):
    """A command cut short, whatever follows it, is refused."""
    good = Station().long(DISTANCE, OFF, 2)
    cut = good[: data.draw(st.integers(1, len(good) - 1))]
    assert refused(cut) == 1
    if rest != good[len(cut) : len(cut) + len(rest)]:
        assert refused(cut + rest) >= 1


def seal(head, payload, extra):
    """A packet whose checksum is right, whatever is in it."""
    crc = common.x25crc(head[1:] + payload)
    crc.accumulate(bytes((extra,)))
    return head + payload + struct.pack("<H", crc.crc)


@settings(max_examples=300)
@given(
    st.integers(0, 255), st.sampled_from(sorted(common.mavlink_map)), st.binary(max_size=255), st.booleans()
)
def test_right_checksum_around_anything(sequence, kind, payload, version_1):
    """A packet of any type around any payload does no harm: commands are chosen by all their fields."""
    if version_1:
        head = bytes((0xFE, len(payload), sequence, 255, 190, kind & 0xFF))
        kind &= 0xFF
    else:
        head = bytes((0xFD, len(payload), 0, 0, sequence, 255, 190)) + kind.to_bytes(3, "little")
    message = common.mavlink_map.get(kind)
    count = refused(seal(head, payload, message.crc_extra if message else 0))
    assert count <= 1 if message else count >= 1


@pytest.mark.parametrize(
    "head",
    [
        pytest.param(lambda p: b"\xfc" + p[1:], id="start"),
        pytest.param(lambda p: p[:2] + b"\x02" + p[3:], id="flag"),
        pytest.param(lambda p: p[:-2] + bytes((p[-2] ^ 1, p[-1])), id="checksum"),
        pytest.param(lambda p: p[:1] + b"\xff" + p[2:], id="length"),
        pytest.param(lambda p: b"\xfe" + p[1:], id="version"),
        pytest.param(lambda p: p[:7] + b"\xff\xff\xff" + p[10:], id="type"),
    ],
)
def test_malformed(head):
    """Each way to be wrong is refused."""
    assert refused(head(Station().long(DISTANCE, OFF, 2))) >= 1


def test_flag_that_is_not_known():
    """A packet that says it cannot be read without knowing more is not read, though its checksum is right."""
    good = Station().long(DISTANCE, OFF, 2)
    head = good[:2] + b"\x02" + good[3:10]
    assert refused(seal(head, good[10:-2], common.MAVLink_command_long_message.crc_extra)) == 1


def test_shortened_in_version_1():
    """Version 1 leaves nothing out: a shorter command is none, though its checksum is right."""
    payload = bytes(32)
    head = bytes((0xFE, len(payload), 0, 255, 190, 76))
    assert refused(seal(head, payload, common.MAVLink_command_long_message.crc_extra)) == 1


def test_checksum_whatever_the_environment(monkeypatch):
    """pymavlink's switch that lets damaged packets through has no say here."""
    monkeypatch.setattr(common, "MAVLINK_IGNORE_CRC", 1)
    packet = Station().long(DISTANCE, OFF, 2)
    assert unpack(packet[:-1] + bytes((packet[-1] ^ 1,))) is None


def test_longer_than_known():
    """A command with fields of a newer dialect at its end is read as far as it is known."""
    good = Station().long(DISTANCE, OFF, 2, 1)
    payload = good[10 : 10 + good[1]].ljust(33, b"\0") + b"\x01\x02"
    head = bytes((0xFD, len(payload))) + good[2:10]
    lap = Lap(1.0)
    assert lap.ask(100, seal(head, payload, common.MAVLink_command_long_message.crc_extra)) == [IN_PROGRESS]


def test_several_in_a_datagram():
    """Packets that come together are all read, in order; what follows them is refused."""
    lap = Lap()
    station = Station()
    assert split(b"") == ([], 0)
    lap.link.hear(station.long(DISTANCE, OFF, 2) + station.long(DISTANCE, OK, 1) + b"?", HOME)
    assert lap.acks(100) == [IN_PROGRESS, ACCEPTED]
    assert lap.link.refused == 1


def test_without_pymavlink(monkeypatch):
    """Where pymavlink is missing the command that installs it is told."""
    packets.common.cache_clear()
    monkeypatch.setitem(sys.modules, "pymavlink.dialects.v20", None)
    with pytest.raises(MavlinkError, match=r"pip install 'strokebench\[mavlink\]'"):
        packets.common()
