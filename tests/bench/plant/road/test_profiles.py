import warnings

import numpy as np
import pytest

from bench.errors import RouteError
from bench.plant.road.grid import STEP_M
from bench.plant.road.iso8608 import synthesise
from bench.plant.road.profiles import LARGEST_BYTES, Profile, load_profile, on_grid, read_columns


def wave(length=20.0, step=0.05):
    x = np.arange(0.0, length + step / 2, step)
    return x, 0.01 * np.cos(2 * np.pi * x / 2.5)  # whole waves: no trend


def written(tmp_path, text, name="road.csv"):
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def table(separator=",", heading=""):
    x, z = wave()
    return heading + "\n".join(f"{a:.3f}{separator}{b:.6f}" for a, b in zip(x, z, strict=True)) + "\n"


@pytest.mark.parametrize("name", ["road.csv", "road.txt", "road.dat", "ROAD.CSV"])
@pytest.mark.parametrize("separator", [",", ";", " ", "\t", " , "])
def test_two_columns_are_a_profile(tmp_path, name, separator):
    """Text of two columns is read whatever separates them, under any of three suffixes."""
    profile = load_profile(written(tmp_path, table(separator), name))
    assert profile.name == name
    assert len(profile.height_m) == 1001
    assert profile.height_m[0] == 0.0
    assert np.ptp(profile.height_m) == pytest.approx(0.02, rel=0.02)


@pytest.mark.parametrize("heading", ["x_m,z_m\n", "# a road\n\n% of 20 m\n// and\n x [m], z [m]\n", "\ufeff"])
def test_headings_and_comments_are_passed_over(heading):
    """Comments, blank lines, a byte order mark and one line of headings change nothing."""
    plain, other = (read_columns(table(heading=text).encode()) for text in ("", heading))
    assert np.array_equal(plain, other)


def test_a_crg_file_is_a_profile(tmp_path, crg):
    """The line asked for of an OpenCRG file becomes the profile, on the road's grid."""
    x, z = wave(step=0.02)
    path = written(tmp_path, crg(np.column_stack([0 * z, z, 2 * z]), "KRBI", step=0.02), "road.crg")
    one, two = (load_profile(path, v).height_m for v in (0.0, 1.0))
    assert len(one) == len(x)
    assert two == pytest.approx(2 * one, abs=1e-6)


def test_heights_come_out_where_they_were_measured():
    """On the grid a profile has the heights it had, between its points those of the line through them."""
    x, z = wave(step=0.25)
    found = on_grid(x, z - z.mean())
    there = found[np.round(x / STEP_M).astype(int)][1:-1] - found.mean()
    assert there == pytest.approx((z - z.mean())[1:-1], abs=6e-4)


def test_finer_profiles_are_averaged():
    """What alternates within a step of the grid, as between millimetres, is averaged away."""
    x = np.arange(0.0, 5.0, 0.0025)
    ripple = 0.01 * (-1.0) ** np.arange(len(x))
    assert np.abs(np.diff(on_grid(x, ripple))[1:]).max() < 1e-3


def test_uneven_spacing_is_no_matter():
    """A profile surveyed at uneven places is the one at even places."""
    x, z = wave(step=0.01)
    keep = np.sort(np.random.default_rng(0).choice(len(x) - 2, len(x) // 2, replace=False) + 1)
    keep = np.concatenate([[0], keep, [len(x) - 1]])
    assert on_grid(x[keep], z[keep]) == pytest.approx(on_grid(x, z), abs=4e-4)


def test_hills_are_taken_out():
    """Height above the sea, slope and waves of 300 m go, waves of 10 m stay."""
    x = np.arange(0.0, 600.0, 0.1)
    short = 0.01 * np.sin(2 * np.pi * x / 10.0)
    found = on_grid(x, 500.0 + 0.03 * x + 2.0 * np.cos(2 * np.pi * x / 300.0) + short)
    inner = slice(5000, 25000)
    plain = on_grid(x, short)
    assert np.std((found - plain)[inner]) < 1e-3


def test_a_profile_fills_any_length():
    """There and back again, a profile of five samples fills twelve."""
    profile = Profile("short", np.arange(5.0))
    assert profile.filled(12).tolist() == [0, 1, 2, 3, 4, 3, 2, 1, 0, 1, 2, 3]


def test_a_real_survey_is_read(measured_roads):
    """A measured road of 544 m at 583 m above the sea becomes a profile of some centimetres about zero."""
    profile = load_profile(measured_roads / "sorel_profile_1.txt")
    assert len(profile.height_m) == 27_201
    assert np.std(profile.height_m) < 0.05


def test_a_measured_block_is_a_road(measured_roads):
    """The Belgian block becomes ten metres of road, rougher than class C."""
    profile = load_profile(measured_roads / "belgian_block.crg", 0.3)
    assert len(profile.height_m) == 501
    assert np.std(np.diff(profile.height_m)) / STEP_M > 0.05


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "holds 0 points; a profile takes two"),
        ("0,0\n", "holds 1 points"),
        ("x,z\nx,z\n0,0\n", "line 2: 'x,z' is not two numbers"),
        ("0,0\n1,0,3\n", "line 2: '1,0,3' is not two numbers"),
        ("0,0\n1\n", "line 2: '1' is not two numbers"),
        ("0,0\n1,nan\n", "line 2: '1,nan' is not two numbers"),
        ("0,0\n1_0,1\n", "line 2: '1_0,1' is not two numbers"),
        ("0,0\n1,0\n1,0\n", "line 3: place 1 m is not beyond 1 m"),
        ("0,0\n1,1e30\n", "line 2: '1,1e30' is no place and height on earth"),
        ("0,0\n1e300,1\n", "line 2: '1e300,1' is no place and height on earth"),
        ("0,0\n1," + "1" * 5000, "line 2: '1,1+...' is not two numbers"),
        ("0,0\n0.5,0\n", "the profile's length in metres is 0.5, not a number from 1 to 20000"),
        ("0,0\n20001,0\n", "the profile's length in metres is 20001.0, not a number from 1 to 20000"),
        (b"0,0\n1,\xff\n", "byte 6: not text"),
        (b"\x00\x01\x02\n" * 9, "line 2"),
    ],
)
def test_refuses_what_is_no_profile(tmp_path, text, says):
    """Text that is no profile is refused with the file and the line."""
    with pytest.raises(RouteError, match=f"road\\.csv: {says}") as refusal:
        load_profile(written(tmp_path, text))
    assert "\n" not in str(refusal.value)


def test_refuses_unknown_suffixes(tmp_path):
    """A file of another kind is refused with the known ones."""
    with pytest.raises(RouteError, match=r"unknown kind of profile; the known ones are \.crg, \.csv"):
        load_profile(tmp_path / "road.xlsx")


@pytest.mark.parametrize("make", [lambda path: None, lambda path: path.mkdir()])
def test_refuses_what_is_no_file(tmp_path, make):
    """A missing file and a folder are refused by name."""
    path = tmp_path / "road.csv"
    make(path)
    with pytest.raises(RouteError, match=r"road\.csv: no such file"):
        load_profile(path)


def test_refuses_giant_files(tmp_path, monkeypatch):
    """A file beyond the limit is refused before it is parsed."""
    monkeypatch.setitem(LARGEST_BYTES, ".csv", 1 << 20)
    with pytest.raises(RouteError, match="is larger than 1 MiB"):
        load_profile(written(tmp_path, b"0" * ((1 << 20) + 1)))


@pytest.mark.parametrize("v_m", ["left", float("nan"), True, 1e9])
def test_refuses_lines_that_are_none(tmp_path, v_m):
    """A lateral place that is no number of metres is refused by value."""
    with pytest.raises(RouteError, match=r"profile_v_m is .*, not a number from -100 to 100"):
        load_profile(written(tmp_path, table()), v_m)


def spoilt(content, rng, kind):
    """The content cut short somewhere, or with one to eight bits of it turned over."""
    if kind == "cut":
        return content[: rng.integers(len(content))]
    damaged = bytearray(content)
    for place in rng.integers(0, 8 * len(content), rng.integers(1, 9)):
        damaged[place // 8] ^= 1 << (place % 8)
    return bytes(damaged)


@pytest.mark.parametrize("kind", ["cut", "turned"])
@pytest.mark.parametrize("form", ["KRBI", "KDBI", "LRFI", "LDFI", "csv"])
def test_damaged_files_are_refused_or_read(tmp_path, crg, form, kind):
    """A file cut short or with bits turned over, 150 times each, gives a sound profile or a RouteError."""
    rng = np.random.default_rng(20)
    z = synthesise(64e-6, 2.0, 60, 0.1, rng)
    if form == "csv":
        content, suffix = "".join(f"{0.1 * k:.1f},{h:.6f}\n" for k, h in enumerate(z)).encode(), ".csv"
    else:
        slope = np.full(60, 0.01)
        heights = np.column_stack([z, z, z])
        content, suffix = crg(heights, form, step=0.1, slope=slope, mods={"GRID_NAN_MODE": 2}), ".crg"
    refusals = []
    for k in range(150):
        path = written(tmp_path, spoilt(content, rng, kind), f"{k}{suffix}")
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            try:
                profile = load_profile(path)
            except RouteError as error:
                refusals.append(str(error))
                continue
        assert np.all(np.isfinite(profile.height_m))
        assert profile.height_m[0] == 0.0
        assert len(profile.height_m) * STEP_M >= 1.0 - STEP_M
    assert refusals
    assert all("\n" not in refusal and f"{suffix}: " in refusal for refusal in refusals)


@pytest.mark.parametrize("kind", ["cut", "turned"])
def test_a_damaged_measured_road_is_refused_or_read(tmp_path, measured_roads, kind):
    """The real file, cut short or with bits turned over in header or data, ends in nothing else."""
    content = (measured_roads / "belgian_block.crg").read_bytes()
    rng = np.random.default_rng(7)
    for k in range(30):
        head = spoilt(content[:9900], rng, kind if k % 2 else "turned") + content[9900:]
        damaged = head if k % 3 else spoilt(content, rng, kind)
        try:
            profile = load_profile(written(tmp_path, damaged, "road.crg"))
        except RouteError:
            continue
        assert np.all(np.isfinite(profile.height_m))
