"""What many tests share: a small network, its calibration, laps, and the ECUs on both hosts."""

import os
import shutil
import signal
import tempfile
from importlib.metadata import entry_points
from pathlib import Path

import hypothesis
import numpy as np
import pytest

import bench
from bench.laps.files import write_lap
from bench.laps.lap import Lap
from bench.plant.motorcycle import load_motorcycle
from bench.plant.ride import ride
from bench.plant.route import load_route
from targets.calibration import Calibration, Detector
from targets.emulated import EmulatedEcu
from targets.firmware import ELF
from targets.host import HostEcu, library
from targets.mcu.image import load
from targets.narx.network import Narx

PLUGIN = "bench.pytest_plugin"
INSTALLED = any(point.value == PLUGIN for point in entry_points(group="pytest11"))
"""Whether pytest has found the bench's plugin by itself; a checkout may be older than its installation."""

pytest_plugins = ["pytester"] if INSTALLED else ["pytester", PLUGIN]

# No test is about how fast this machine is at the moment, and the first example of many waits for a compiler.
hypothesis.settings.register_profile(
    "unhurried", deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow]
)
hypothesis.settings.load_profile("unhurried")

ROOT = Path(__file__).resolve().parents[1]
SHARED = ROOT.parent / "shared"

INPUTS = ("fork_stroke_mm", "pitch_rate_dps", "speed_kmh")
SPANS = ((0.0, 150.0), (-80.0, 80.0), (0.0, 200.0))


@pytest.fixture(scope="session", autouse=True)
def own_sockets():
    """Sockets of replays and hubs lie in a folder of this run; its name is short, a socket's must be."""
    folder = tempfile.mkdtemp(prefix="sb")
    before = os.environ.get("XDG_RUNTIME_DIR")
    os.environ["XDG_RUNTIME_DIR"] = folder
    yield
    os.environ.pop("XDG_RUNTIME_DIR")
    if before:
        os.environ["XDG_RUNTIME_DIR"] = before
    shutil.rmtree(folder)


@pytest.fixture(scope="session", autouse=True)
def same_packages():
    """Processes that tests start import the packages that are tested here, whatever their working directory.

    A checkout beside its installation would be another copy, whose kernels are compiled anew: minutes of a
    user-mode kernel, and nothing about what is installed.
    """
    places = [str(Path(bench.__file__).parents[1]), str(ROOT), os.environ.get("PYTHONPATH", "")]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", os.pathsep.join(filter(None, places)))
        patch.setenv("PYTHONSAFEPATH", "1")
        yield


@pytest.fixture(scope="session", autouse=True)
def interruptible():
    """Ctrl-C interrupts, as at a terminal: a shell's background job starts with it ignored."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def network(neurons: int = 15, delays: int = 10, seed: int = 1, shift: int = 0) -> Narx:
    """A contracting network of random single-precision weights."""
    rng = np.random.default_rng(seed)
    return Narx(
        inputs=INPUTS,
        output="rear_stroke_mm",
        delays=delays,
        shift=shift,
        input_ranges=SPANS,
        output_range=(0.0, 110.0),
        W1=rng.normal(size=(neurons, 4 * delays)) * 0.1,
        b1=rng.normal(size=neurons) * 0.3,
        w2=rng.normal(size=neurons) * 0.3,
        b2=0.05,
        initial_mm=55.0,
    ).rounded()


def wavy_lap(seconds: float = 3.0, names: tuple[str, ...] = (), seed: int = 5) -> Lap:
    """A lap at 1 kHz of smooth, lively channels within their sensors' spans; all seven, or `names`."""
    t_ns = np.arange(round(seconds * 1000)) * 1_000_000
    t = t_ns / 1e9
    rng = np.random.default_rng(seed)

    def wave(middle: float, swing: float) -> np.ndarray:
        phase, speed = rng.uniform(0, 6, 3), rng.uniform(2, 20, 3)
        return middle + swing / 3 * sum(np.sin(s * t + p) for s, p in zip(speed, phase, strict=True))

    channels = {
        "fork_stroke_mm": wave(50, 35),
        "rear_stroke_mm": wave(57, 25),
        "pitch_rate_dps": wave(0, 30),
        "speed_kmh": wave(60, 20),
        "acc_front_ms2": wave(0, 40),
        "acc_rear_ms2": wave(0, 40),
        "acc_body_ms2": wave(0, 10),
    }
    return Lap(t_ns, {name: channels[name] for name in names or channels})


def simulated_laps(folder: Path, route: str, seconds: float, seeds: tuple[int, ...] = (1, 2)) -> Path:
    """Laps of the default motorcycle as files of a folder, SEED.parquet each."""
    for seed in seeds:
        write_lap(ride(load_route(route), load_motorcycle(), seed, seconds), folder / f"{seed}.parquet")
    return folder


@pytest.fixture(scope="session")
def calibration() -> Calibration:
    return Calibration(network(), Detector())


@pytest.fixture(scope="session")
def image():
    return load(ELF["ifd"])


@pytest.fixture
def mcu_ecu(image, calibration):
    return EmulatedEcu(image, calibration)


@pytest.fixture
def host_ecu(calibration):
    if library() is None:
        pytest.skip("the host core is not built: no C compiler was found at installation")
    return HostEcu(calibration)


@pytest.fixture
def arm_gcc():
    if shutil.which("arm-none-eabi-gcc") is None:
        pytest.skip("no arm-none-eabi-gcc on this machine")
