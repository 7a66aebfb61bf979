"""What the doctor sees on machines of every kind, put together as files and stand-ins."""

import json
from types import SimpleNamespace

import pytest

from bench.bus.live import RECEIVE_BUFFER
from bench.cli import doctor
from bench.cli import doctor_probes as probes

ADMIN, USER = "CapEff:\t0000000000001000\n", "CapEff:\t0000000000000000\n"


@pytest.fixture
def machine(tmp_path):
    """A root folder with the given files: path -> text."""

    def make(**files):
        for name, text in files.items():
            path = tmp_path / name.replace("__", "/")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        return tmp_path

    return make


def test_kernel_can():
    """A kernel with CAN opens such a socket; one without refuses the family."""

    def refuse(*_):
        raise OSError(97, "Address family not supported by protocol")

    closed = []
    there = SimpleNamespace(close=lambda: closed.append(1))
    assert probes.kernel_can(lambda *_: there) == "CAN_RAW sockets"
    assert closed == [1]
    assert probes.kernel_can(refuse) == ""


@pytest.mark.parametrize(
    ("files", "found"),
    [
        ({"sys__module__vcan__x": ""}, "loaded"),
        ({"lib__modules__6.1__modules.builtin": "kernel/drivers/net/can/vcan.ko\n"}, "built in"),
        (
            {"lib__modules__6.1__modules.dep": "kernel/drivers/net/can/vcan.ko.xz: kernel/can-dev.ko\n"},
            "can be loaded",
        ),
        ({"lib__modules__6.1__modules.dep": "kernel/drivers/net/can/vxcan.ko:\n"}, ""),
        ({"lib__modules__5.0__modules.dep": "kernel/drivers/net/can/vcan.ko:\n"}, ""),
        ({}, ""),
    ],
    ids=["loaded", "builtin", "module", "another", "other-kernel", "none"],
)
def test_vcan_module(machine, files, found):
    """The driver is loaded, built in, can be loaded, or is not there for this kernel."""
    assert probes.vcan_module(machine(**files), "6.1") == found


def test_interfaces(machine):
    """Interfaces that are up are named; all down is a lack that names them; other networks are none."""
    root = machine(sys__class__net__eth0__flags="0x1003\n")
    assert probes.interfaces(root) == ""
    root = machine(sys__class__net__can0__flags="0x40080\n")
    with pytest.raises(probes.LackError, match="can0 down: ip link set up can0"):
        probes.interfaces(root)
    assert probes.interfaces(machine(sys__class__net__vcan0__flags="0x400c1\n")) == "vcan0"


@pytest.mark.parametrize(("status", "found"), [(ADMIN, "CAP_NET_ADMIN"), (USER, ""), ("", "")])
def test_rights(machine, status, found):
    """The capability counts, not the user's name; a system without that file gives none."""
    assert probes.rights(machine(proc__self__status=status) if status else machine()) == found


def test_receive_buffer(machine):
    """The queue the bench asks for, in frames; a limit below it is a lack unless one may pass it."""
    small = {"proc__sys__net__core__rmem_max": "212992\n", "proc__sys__net__core__rmem_default": "212992\n"}
    with pytest.raises(probes.LackError, match="rmem_max is 212992: 555 frames"):
        probes.receive_buffer(RECEIVE_BUFFER, machine(proc__self__status=USER, **small))
    found = "5462 frames (278 in a queue of the default size)"
    assert probes.receive_buffer(RECEIVE_BUFFER, machine(proc__self__status=ADMIN, **small)) == found
    large = small | {"proc__sys__net__core__rmem_max": "4194304\n"}
    assert probes.receive_buffer(RECEIVE_BUFFER, machine(proc__self__status=USER, **large)) == found


@pytest.mark.parametrize(("late_us", "good"), [(60, True), (999, True), (1000, False)])
def test_clock(late_us, good):
    """By how much sleeps are too long is said; a millisecond or more is a lack."""
    now = [0]
    slept = []

    def sleep(seconds):
        slept.append(seconds)
        now[0] += round(seconds * 1e9) + late_us * 1000

    if good:
        found = probes.clock(lambda: now[0], sleep, 1e-9)
        assert found == f"resolution 1 ns; a sleep of 1 ms is {late_us / 1000:.3f} ms too long (p99)"
    else:
        with pytest.raises(probes.LackError, match=r"1\.000 ms too long"):
            probes.clock(lambda: now[0], sleep, 1e-9)
    assert slept == [0.001] * 50


def test_gpu(machine):
    """Without a device torch is not even loaded; with one it says its name, or that torch cannot use it."""

    def torch(usable):
        cuda = SimpleNamespace(is_available=lambda: usable, get_device_name=lambda k: f"NVIDIA {k}")
        return lambda: SimpleNamespace(cuda=cuda)

    def never():
        raise AssertionError("torch was loaded")

    assert probes.gpu(machine(dev__nvidiactl=""), never) == ""
    root = machine(dev__nvidia0="")
    assert probes.gpu(root, torch(True)) == "NVIDIA 0"
    with pytest.raises(probes.LackError, match="this torch cannot use it"):
        probes.gpu(root, torch(False))


def test_gpu_without_torch(machine, monkeypatch):
    """A GPU without torch is a lack of torch."""
    monkeypatch.setattr(probes, "find_spec", lambda name: None)
    with pytest.raises(probes.LackError, match="torch is not"):
        probes.gpu(machine(dev__nvidia0=""))


def test_tools():
    """The first program that is there."""
    paths = {"gcc": "/usr/bin/gcc"}
    assert probes.tool("cc", "gcc", which=paths.get) == "/usr/bin/gcc"
    assert probes.tool("clang", which=paths.get) == ""


def test_can_interfaces():
    """python-can's interfaces, in order."""
    assert probes.can_interfaces({"virtual", "socketcan"}) == "socketcan, virtual"
    assert "virtual" in probes.can_interfaces()


def lacking():
    raise probes.LackError("rmem_max is 7")


def test_document(bench, monkeypatch, tmp_path):
    """--json holds each check with what was found, or what mends it; the screen says the same."""
    checks = (("good", lambda: "all of it", "buy one"), ("bad", lambda: "", "apt-get install bad"))
    monkeypatch.setattr(doctor, "CHECKS", (*checks, ("little", lacking, "sysctl -w x=[8]")))
    ended = bench("doctor", "--json", tmp_path / "a.json")
    assert (ended.code, ended.err) == (0, "")
    assert [line.split()[:2] for line in ended.out.splitlines()] == [
        ["yes", "good"],
        ["no", "bad"],
        ["no", "little"],
    ]
    assert "to mend: sysctl -w x=[8] (rmem_max is 7)" in ended.out
    assert json.loads((tmp_path / "a.json").read_text()) == [
        {"what": "good", "ok": True, "found": "all of it", "to_mend": None},
        {"what": "bad", "ok": False, "found": None, "to_mend": "apt-get install bad"},
        {"what": "little", "ok": False, "found": None, "to_mend": "sysctl -w x=[8] (rmem_max is 7)"},
    ]


def test_every_check_has_a_remedy():
    """Whatever is missing is mended by a command."""
    for what, _, remedy in doctor.CHECKS:
        assert what
        assert remedy
    assert (
        f"rmem_max={RECEIVE_BUFFER}"
        in dict((what, remedy) for what, _, remedy in doctor.CHECKS)["receive queue"]
    )


def test_json_refused(refused):
    """A document that could not be written is refused before anything is looked at."""
    assert "record: none/a.json: no folder none" in refused("doctor", "--json", "none/a.json")
