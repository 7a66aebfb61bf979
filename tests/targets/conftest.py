"""The core under the sanitizers: built once, a process for each test that asks for one."""

import shutil
import subprocess

import pytest

from tests.targets.firmware import sanitized as build


@pytest.fixture(scope="session")
def program(tmp_path_factory):
    """The core's driver, built with the sanitizers."""
    if shutil.which("gcc") is None:
        pytest.skip("no gcc on this machine")
    folder = tmp_path_factory.mktemp("sanitized")
    probe = [*build.SANITIZED, "-x", "c", "-", "-o", str(folder / "probe")]
    text = b"int main(void) { return 0; }\n"
    if subprocess.run(["gcc", *probe], input=text, capture_output=True, check=False).returncode:
        pytest.skip("this gcc has no sanitizers: its libasan or libubsan is not installed")
    return build.build(folder, *build.SANITIZED)


@pytest.fixture
def core(program):
    """A process of it, which no sanitizer may have ended when the test is over."""
    process = program.start()
    yield process
    process.close()


@pytest.fixture
def sanitized(program):
    """Switches on an ECU whose core the sanitizers watch: sanitized(calibration, role)."""
    cores = []

    def power_on(calibration, role="ifd"):
        cores.append(program.start())
        return build.SanitizedEcu(cores[-1], calibration, role)

    yield power_on
    for process in cores:
        process.close()
