"""What the road's tests share: a writer of OpenCRG files, and the measured roads beside the checkout."""

from pathlib import Path

import numpy as np
import pytest

MEASURED = Path(__file__).resolve().parents[5] / "shared" / "data" / "road-profiles"


@pytest.fixture
def measured_roads():
    """The folder of measured roads; they are not ours to ship."""
    if not MEASURED.is_dir():
        pytest.skip(f"no measured roads in {MEASURED}")
    return MEASURED


@pytest.fixture
def crg():
    return write_crg


def write_crg(
    height, layout="LRFI", step=0.5, v=(-1.0, 0.0, 1.0), promise=True, lines=(), mods=None, slope=None
):
    """The bytes of an OpenCRG file of `height` (rows, columns); `lines` replace lines of the header."""
    rows = len(height)
    road = {
        "REFERENCE_LINE_START_U": 100.0,
        "REFERENCE_LINE_INCREMENT": step,
        **({"REFERENCE_LINE_END_U": 100.0 + (rows - 1) * step} if promise else {}),
        **dict(lines),
    }
    out = ["$CT", "written by a test, with = and D: in it", "$!***", "$ROAD_CRG ! parameters"]
    out += [f"{key} = {value!r}   ! a comment" for key, value in road.items()]
    out += ["$"]
    if mods is not None:
        out += ["$ROAD_CRG_MODS", *(f"{key} = {value!r}" for key, value in mods.items()), "$"]
    out += ["* a block comment", "$KD_Definition", f"#:{layout}", "U:reference line u,m,100,0.5"]
    out += ["D:reference line phi,rad"]
    table = np.column_stack([np.zeros(rows), height]).astype(float)
    if slope is not None:
        out += ["D:reference line slope,m/m"]
        table = np.column_stack([table[:, :1], slope, table[:, 1:]])
    out += [f"D:long section at v = {place:.3f},m" for place in v]
    out += ["$", "$" * 72]
    head = ("\n".join(out) + "\n").encode("latin-1")
    table[0, 0] = np.nan  # the first heading is unused
    if layout in ("KRBI", "KDBI"):
        data = table.astype(">f4" if layout == "KRBI" else ">f8").tobytes()
        size = 4 if layout == "KRBI" else 8
        return head + data + np.full(-len(data) % 80 // size, np.nan, f">f{size}").tobytes()
    wide = 10 if layout == "LRFI" else 20
    text = ""
    for row in table:
        words = ["*missing".ljust(wide, "*") if np.isnan(z) else f"{z:{wide}.{wide - 3}f}" for z in row]
        for first in range(0, len(words), 80 // wide):
            text += "".join(words[first : first + 80 // wide]) + "\n"
    return head + text.encode()
