"""A C compiler for tests that look into the core; what it makes lies in the test's folder alone."""

import shutil
import subprocess

import pytest

from tests.targets.firmware.maker import Maker
from tests.targets.firmware.sanitized import CORE, STRICT, TESTS


@pytest.fixture(scope="session")
def compiled(tmp_path_factory):
    """compiled(name, source, *more): the path of what the host's compiler makes of C text and more words."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler on this machine")

    def compile_it(name, source, *more):
        folder = tmp_path_factory.mktemp("c")
        (folder / f"{name}.c").write_text(source)
        command = [compiler, *STRICT, str(folder / f"{name}.c"), *map(str, more), "-o", str(folder / name)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return folder / name

    return compile_it


@pytest.fixture(scope="session")
def maker(compiled):
    """The decision maker in a library, optimised."""
    parts = [CORE / f"{name}.c" for name in ("residual", "checks", "ifd")]
    more = (*parts, f"-I{TESTS}", "-O2", "-shared", "-fPIC")
    return Maker(compiled("maker.so", '#include "decide.c"\n', *more))


@pytest.fixture(params=["optimised", "sanitized"])
def decide(request):
    """decide(image, predicted, measured): the verdicts of the decision maker on a ride."""
    return request.getfixturevalue("maker" if request.param == "optimised" else "core").decide
