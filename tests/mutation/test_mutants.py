"""The mutator: what it changes, what it leaves alone, and that names stay."""

import pytest

from tests.mutation.mutants import mutants
from tests.mutation.trial import all_mutants


def made(source):
    """What becomes of the text, one mutant after another."""
    return {mutant.mutated for mutant in mutants("x.c", source)}


@pytest.mark.parametrize(
    ("source", "some"),
    [
        ("a < b", {"a <= b", "a > b", "a >= b", "a == b", "a != b"}),
        ("a + b", {"a - b", "a * b", "a / b"}),
        ("a += b", {"a -= b", "a = b"}),
        ("a && b || c", {"a || b || c", "a && b && c"}),
        ("a++", {"a--"}),
        ("f(-a, !b)", {"f(a, !b)", "f(-a, b)"}),
        ("return -a;", {"return a;", "return 0;", "return 1;"}),
        ("x = 2u", {"x = 3u", "x = 1u", "x = 0u"}),
        ("x = 0u", {"x = 1u"}),
        ("x = 0.5f", {"x = 1.5f", "x = -0.5f", "x = 0.0f"}),
        ("x = 0x10u", {"x = 17u", "x = 15u", "x = 0u"}),
        ("at_top = 0;", {"at_bottom = 0;", "at_top = 1;", ";"}),
        ("if (a) { b(); c(); }", {"if (0) { b(); c(); }", "if (a) { ; c(); }", "if (a) { b(); ; }"}),
        ("for (i = a; b; c) { d(); }", {"for (i = a; b; c) { ; }"}),
        ("{ *s = (t){.n = a}; }", {"{ ; }"}),
        ("#define ONE 4\n", {"#define ONE 5\n", "#define ONE 3\n", "#define ONE 0\n"}),
    ],
)
def test_changes(source, some):
    """Each kind of slip is made."""
    assert some <= made(source)


@pytest.mark.parametrize("source", ["/* a < b */", "// a + 1\n", '#include "a.h"\n', "p->x", "*p"])
def test_what_is_left_alone(source):
    """Comments, directives, members and dereferences are not changed."""
    assert made(source) == set()


def test_each_differs_from_the_source_and_from_the_others():
    """No mutant is the original, and no two of a file are the same text or have the same name."""
    found = all_mutants()
    assert all(mutant.mutated != mutant.source for mutant in found)
    assert len({(mutant.file, mutant.mutated) for mutant in found}) == len(found)
    assert len({mutant.name for mutant in found}) == len(found)


def test_name_stays_when_other_lines_change():
    """A mutant is called the same after lines before it were added, or a comment on its own."""
    before = mutants("x.c", "int f(void) {\n    return a + b;\n}\n")
    after = mutants("x.c", "/* new */\n\nint f(void) {\n    return a + b; /* a sum */\n}\n")
    assert [mutant.name for mutant in before] == [mutant.name for mutant in after]


def test_same_line_twice_has_two_names():
    """The same change of two equal lines is two mutants."""
    found = mutants("x.c", "void f(void) {\n    a = b + c;\n    a = b + c;\n}\n")
    assert len({mutant.name for mutant in found}) == len(found)


def test_says_what_it_is():
    """A mutant tells its line, its kind, and the code before and after."""
    mutant = next(mutant for mutant in mutants("x.c", "\nx = a <  b;\n") if mutant.text == ">=")
    assert (mutant.line, mutant.operator, mutant.change) == (2, "relation", "x = a < b;  =>  x = a >= b;")
