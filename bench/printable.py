"""Names from outside, of files and laps, as something that may be shown."""


def printable(text: str) -> str:
    """The text with what would steer a terminal, and what is no text, written as in a Python string."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
