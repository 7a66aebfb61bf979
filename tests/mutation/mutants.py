"""Mutants of C text: what a slip of the hand could have made of it, one change at a time.

Belongs here: which changes there are. Never: whether one is noticed. A tokenizer is enough: a change that is
no C any more does not compile, and is not counted.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from typing import NamedTuple

RELATIONAL = ("<", "<=", ">", ">=", "==", "!=")
ARITHMETIC = ("+", "-", "*", "/")

EXCHANGED = {
    **{op: tuple(other for other in RELATIONAL if other != op) for op in RELATIONAL},
    **{op: tuple(other for other in ARITHMETIC if other != op) for op in ARITHMETIC},
    "+=": ("-=", "="),
    "-=": ("+=", "="),
    "&&": ("||",),
    "||": ("&&",),
    "++": ("--",),
    "--": ("++",),
}
"""What an operator between two operands, or one that counts, may turn into."""

OPPOSITES = (
    ("predicted", "measured"),
    ("top", "bottom"),
    ("high", "low"),
    ("least", "most"),
    ("squares", "sum"),
    ("loss", "hold"),
    ("OPEN", "SHORT"),
    ("HOLD", "UNCALIBRATION"),
    ("CHECKS", "RESIDUAL"),
)
"""Words in names that are mistaken for each other."""

TOKEN = re.compile(
    r"""(?P<skip>\s+|/\*.*?\*/|//[^\n]*|^\#\ *(?!define)[^\n]*|^\#\ *define\ \w+)
    |(?P<number>0x[0-9a-fA-F.]+(?:p[+-]?\d+)?[fFuU]*|(?:\d+\.\d*|\.\d+|\d+)(?:[eE][+-]?\d+)?[fFuU]*)
    |(?P<word>[A-Za-z_]\w*)
    |(?P<operator>->|\+\+|--|<<=|>>=|<=|>=|==|!=|&&|\|\||[-+*/%&|^]=|<<|>>|.)""",
    re.VERBOSE | re.DOTALL | re.MULTILINE,
)


class Token(NamedTuple):
    """A word of C: its kind (number, word, operator), its text and where it begins."""

    kind: str
    text: str
    at: int

    @property
    def end(self) -> int:
        """Where it ends."""
        return self.at + len(self.text)


@dataclass(frozen=True)
class Mutant:
    """`file` with the characters from `begin` to `end` replaced by `text`; `operator`: the kind of change."""

    file: str
    source: str
    begin: int
    end: int
    text: str
    operator: str

    @property
    def mutated(self) -> str:
        """The whole file after the change."""
        return self.source[: self.begin] + self.text + self.source[self.end :]

    @property
    def line(self) -> int:
        """The number of the line where the change begins."""
        return self.source.count("\n", 0, self.begin) + 1

    @cached_property
    def change(self) -> str:
        """The code before and after, as a reader sees it: `before  =>  after`."""
        head, tail = self.source.rfind("\n", 0, self.begin) + 1, self.source.find("\n", self.end)
        old = self.source[head:tail]
        new = self.source[head : self.begin] + self.text + self.source[self.end : tail]
        return "  =>  ".join(" ".join(re.sub(r"/\*.*?\*/", "", text).split()) for text in (old, new))

    @property
    def name(self) -> str:
        """What it is called by; changes of other lines leave it alone."""
        head, tail = self.source.rfind("\n", 0, self.begin) + 1, self.source.find("\n", self.begin)
        same_before = self.source.count(self.source[head : tail + 1], 0, head)
        return sha256(f"{self.file} {same_before}: {self.change}".encode()).hexdigest()[:8]


def tokens(source: str) -> list[Token]:
    """The words of C in the text, without comments and directives; the value of a #define is there."""
    found = []
    for match in TOKEN.finditer(source):
        if match.lastgroup != "skip" and match.lastgroup is not None:
            found.append(Token(match.lastgroup, match.group(), match.start()))
    return found


def mutants(file: str, source: str) -> list[Mutant]:
    """Every mutant of the text of `file`, in the order of the text, none twice."""
    words = tokens(source)
    changes = [
        *_operators(words),
        *_numbers(words),
        *_opposites(words),
        *_conditions(words, source),
        *_statements(words),
        *_returns(words),
    ]
    found = {(begin, end, text): operator for begin, end, text, operator in changes}
    return [Mutant(file, source, *where, operator) for where, operator in sorted(found.items())]


Change = tuple[int, int, str, str]


def _operators(words: list[Token]) -> Iterator[Change]:
    for before, token in zip([Token("operator", ";", 0), *words], words, strict=False):
        operand = before.kind in ("number", "word") or before.text in (")", "]")
        if token.text in ("-", "!") and (not operand or before.text == "return"):
            yield token.at, token.end, "", "sign and negation"
        elif token.text in ARITHMETIC and not operand:
            continue  # a dereference
        elif token.kind == "operator":
            kind = (
                "relation"
                if token.text in RELATIONAL
                else "logic"
                if token.text in ("&&", "||")
                else "arithmetic"
            )
            for other in EXCHANGED.get(token.text, ()):
                yield token.at, token.end, other, kind


def _numbers(words: list[Token]) -> Iterator[Change]:
    for token in words:
        if token.kind != "number":
            continue
        digits = token.text.rstrip("uUfF")
        suffix = token.text[len(digits) :]
        value = float(digits) if "f" in suffix else int(digits, 0)
        for other in dict.fromkeys((value + 1, value - 1, 0 * value)):
            if other != value and (other >= 0 or "f" in suffix):
                yield token.at, token.end, f"{other!r}{suffix}", "constant"


def _opposites(words: list[Token]) -> Iterator[Change]:
    for token in words:
        for pair in OPPOSITES if token.kind == "word" else ():
            for one, other in (pair, pair[::-1]):
                if one in token.text.split("_"):
                    text = "_".join(other if part == one else part for part in token.text.split("_"))
                    yield token.at, token.end, text, "name"


def _conditions(words: list[Token], source: str) -> Iterator[Change]:
    for k, token in enumerate(words):
        if token.text in ("if", "while") and token.kind == "word":
            last = _closing(words, k + 1)
            inner = source[words[k + 1].at : words[last].end]
            for text in (f"(!{inner})", "(0)", "(1)"):
                yield words[k + 1].at, words[last].end, text, "condition"


def _statements(words: list[Token]) -> Iterator[Change]:
    begin, inside = 0, 0
    for k, token in enumerate(words):
        if token.text in ("(", ")"):
            inside += 1 if token.text == "(" else -1
        elif token.text == "{" and words[k + 1].text == ".":
            inside += 1  # an initialiser
        elif token.text == "}" and inside:
            inside -= 1
        elif token.text in ("{", "}", ";") and not inside:
            if token.text == ";" and k > begin and words[begin].text not in ("return", "typedef"):
                yield words[begin].at, token.at, "", "statement"
            begin = k + 1


def _returns(words: list[Token]) -> Iterator[Change]:
    for k, token in enumerate(words):
        if token.text == "return":
            end = next(word for word in words[k:] if word.text == ";")
            for text in (" 0", " 1"):
                yield token.end, end.at, text, "return value"


def _closing(words: list[Token], opening: int) -> int:
    depth = 0
    for k in range(opening, len(words)):
        depth += (words[k].text == "(") - (words[k].text == ")")
        if depth == 0:
            return k
    raise ValueError(f"no closing parenthesis for the one at {words[opening].at}")
