"""The rooms of CONTRIBUTING.md: who imports whom, and how much stands in one file."""

import ast
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ROOMS = ("dbc", "targets", "bench", "campaigns", "bench.cli", "bench.pytest_plugin")
"""From the ground floor up: each imports from those before it."""
OF_TARGETS = ("targets.ecu", "targets.errors", "targets.frame_bits", "targets.jit")
"""What the bench may know of an ECU, and the CAN frame both ends are made of."""
LONGEST = 400
"""Lines of a file; more want two."""


def name_of(path):
    """The module's name."""
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def sources():
    """Module -> its file, of everything that is shipped."""
    return {name_of(path): path for room in ("dbc", "targets", "bench", "campaigns") for path in files(room)}


def files(folder):
    return sorted((ROOT / folder).rglob("*.py"))


def imports(tree):
    """The names of the modules and of what is taken from them."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def at_start(body):
    """The statements that are executed when a module is imported."""
    for node in body:
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            continue
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield node


def room_of(name):
    """The room a module lies in, None for other people's."""
    return next((room for room in reversed(ROOMS) if f"{name}.".startswith(f"{room}.")), None)


@pytest.mark.parametrize("name", sources())
def test_imports_point_down(name):
    """No module imports from a room above its own, and the bench only the ECU's protocol from the targets."""
    own = room_of(name)
    for other in imports(ast.parse(sources()[name].read_text(encoding="utf-8"))):
        room = room_of(other)
        if room is not None:
            assert ROOMS.index(room) <= ROOMS.index(own), other
            if (own, room) == ("bench", "targets"):
                assert other.startswith(OF_TARGETS), other


def test_no_cycles():
    """Modules do not import each other in a circle while they are being imported."""
    known = sources()
    graph = {}
    for name, path in known.items():
        tree = ast.Module(list(at_start(ast.parse(path.read_text(encoding="utf-8")).body)), [])
        # a name that is no module is something in one
        graph[name] = {other if other in known else other.rpartition(".")[0] for other in imports(tree)}
        graph[name] &= set(known) - {name}
    order = list(TopologicalSorter(graph).static_order())
    assert order.index("targets.errors") < order.index("bench.cli.main")


@pytest.mark.parametrize("folder", ["dbc", "targets", "bench", "campaigns", "tests"])
def test_a_file_reads_in_one_sitting(folder):
    """No file is longer than LONGEST lines."""
    lengths = {name_of(path): len(path.read_text(encoding="utf-8").splitlines()) for path in files(folder)}
    assert {name: length for name, length in lengths.items() if length > LONGEST} == {}
