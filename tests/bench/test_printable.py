"""Names from outside as something that may be shown."""

from hypothesis import given
from hypothesis import strategies as st

from bench.printable import printable


def test_what_steers_a_terminal():
    """Control characters and bytes that were no text become escapes; letters of any alphabet stand."""
    assert printable("a\x1b[31mü\n\udcff") == r"a\x1b[31mü\n\udcff"


@given(st.text(st.characters()))
def test_any_name_can_be_shown(name):
    """Whatever a file is called becomes one line of printable text."""
    shown = printable(name)
    assert shown.isprintable()
    assert shown.encode().decode() == shown
