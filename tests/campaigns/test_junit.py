"""JUnit XML: a suite a condition, a case a trial, valid against Jenkins' schema."""

from pathlib import Path
from xml.etree import ElementTree as Xml

import pytest

from campaigns.errors import CampaignError
from campaigns.junit import junit, plain, write_junit
from tests.campaigns.synthetic import row

SCHEMA = Path(__file__).with_name("junit-10.xsd")
ROWS = [
    row("hold", "CD", 1, 0.43, "hold", ridden_s=300.25),
    row("hold", "MD", 2, ridden_s=300.0),
    row("hold", "ID", 3, named="open", ridden_s=300.0),
    row("hold", "INVALID", 4, ridden_s=300.0, reason='lost <3> & "more"\x00\x1b[31m\ud800'),
    row("fault-free", "FA", 5),
    row("fault-free", "OK", 6),
]


def cases(rows=ROWS):
    return {
        case.find("system-out").text.split()[0]: case
        for case in Xml.fromstring(junit("road", rows)).iter("testcase")
    }


def test_suites():
    """Each condition is a suite with its counts and the virtual time ridden."""
    root = Xml.fromstring(junit("road", ROWS))
    assert [dict(suite.attrib) for suite in root] == [
        {"name": "fault-free", "tests": "2", "failures": "1", "errors": "0", "time": "720.000"},
        {"name": "hold", "tests": "4", "failures": "2", "errors": "1", "time": "1200.250"},
    ]
    assert (root.attrib["tests"], root.attrib["failures"], root.attrib["errors"]) == ("6", "3", "1")


def test_order():
    """Suites stand in the order told."""
    root = Xml.fromstring(junit("road", ROWS, ["hold", "fault-free", "open"]))
    assert [suite.attrib["name"] for suite in root] == ["hold", "fault-free"]


@pytest.mark.parametrize(
    ("outcome", "tag"),
    [
        ("CD", None),
        ("OK", None),
        ("MD", "failure"),
        ("FA", "failure"),
        ("ID", "failure"),
        ("INVALID", "error"),
    ],
)
def test_verdicts(outcome, tag):
    """A wrong verdict is a failure with its reason, a run that proves nothing an error."""
    case = cases()[f"outcome={outcome}"]
    assert [child.tag for child in case if child.tag != "system-out"] == ([tag] if tag else [])
    if tag == "failure":
        assert dict(case.find(tag).attrib) == {"type": outcome, "message": "why"}


def test_case():
    """A case names fault and lap, and tells its instants and seed."""
    case = cases()["outcome=CD"]
    assert case.attrib == {
        "name": f"rear_stroke:hold@60 seed 1, mixed_5km, gsxr1000 ({ROWS[0].id})",
        "classname": "road.hold",
        "time": "300.250",
    }
    assert case.find("system-out").text.split() == [
        "outcome=CD", "td_s=0.43", "t_cmd_s=60.0", "t_active_s=60.0", "t_obs_s=60.02", "t_alarm_s=60.43",
        "named=hold", "lap.seed=1", "sensors_seed=1",
    ]  # fmt: skip


def test_names_are_unique():
    """Two trials that differ in a parameter alone are two cases."""
    rows = [row("hold", "CD", 1, 0.5, parameters={"gain": gain}) for gain in (1.1, 1.2)]
    names = [case.attrib["name"] for case in Xml.fromstring(junit("road", rows)).iter("testcase")]
    assert len(set(names)) == 2
    assert sum("gain=1.2" in name for name in names) == 1


def test_escapes():
    """Markup in a reason is text, and what XML has no way to hold is written out."""
    message = cases()["outcome=INVALID"].find("error").attrib["message"]
    assert message == r'lost <3> & "more"\x00\x1b[31m\ud800'
    assert plain("tab\tstays, \uffff and \x7f") == "tab\tstays, \\uffff and \x7f"


def test_schema():
    """The file is valid against the schema of Jenkins' xunit plugin."""
    etree = pytest.importorskip("lxml.etree", reason="lxml is not installed: pip install lxml")
    schema = etree.XMLSchema(etree.parse(SCHEMA))
    schema.assertValid(etree.fromstring(junit("road", ROWS).encode()))
    schema.assertValid(etree.fromstring(junit("road", []).encode()))


def test_written(tmp_path):
    """The file is what `junit` makes, in whatever order the rows come; a missing folder is one line."""
    write_junit(tmp_path / "out.xml", "road", ROWS[::-1])
    assert (tmp_path / "out.xml").read_text(encoding="utf-8") == junit("road", ROWS)
    with pytest.raises(CampaignError, match="cannot be written"):
        write_junit(tmp_path / "nowhere" / "out.xml", "road", ROWS)
