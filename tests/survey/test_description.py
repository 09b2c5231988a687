"""What a stranger writes into `survey.yaml` and `poses.csv`: whatever is wrong is one line."""

import re

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from by_hand import FILES, edit
from echolearn.acoustics.types import Pose
from echolearn.checks import BadValue
from echolearn.survey import floor_plan, reader
from echolearn.survey.poses import poses_csv, read_poses

CORNERS = "must be null, or 3 to 1000 distinct corners in order around an area"
LINE = "must be lines of at least two corners, each apart from the one before it"
KEYS = (
    "sample_rate, speed_of_sound, microphones, loudspeaker, direct_path, map, walls, "
    "heading_bias_sd_rad, conditions"
)


def refusal(folder, name):
    """Return what is said of a file of the survey."""
    with pytest.raises(BadValue) as refused:
        reader.read_survey(folder)
    assert str(refused.value).startswith(f"{folder}/{name}") and str(refused.value).isprintable()
    return str(refused.value).removeprefix(f"{folder}/{name}")


# ---------------------------------------------------------------- survey.yaml


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("sample_rate", "fast", "=fast Hz: must be a number from 1000 to 400000 Hz"),
        ("sample_rate", None, "=None Hz"),
        ("sample_rate", 22.05, "=22.05 Hz"),
        ("sample_rate", True, "=True Hz"),
        (
            "speed_of_sound",
            0.343,
            "=0.343 m/s: must be m/s, from 260 to 400 in air or from 1400 to 1600 in water; is it",
        ),
        ("speed_of_sound", float("nan"), "=nan m/s"),
        ("microphones", "six", "=words: must be many x 3 finite numbers in m"),
        ("microphones", None, "=rows of several lengths"),
        ("microphones", [], "=shape (0,)"),
        ("microphones", [["0.1", "0", "0"]], "=words"),
        ("microphones", [[0.1, 0.2], [0.3]], "=rows of several lengths"),
        ("microphones", [[0.1, 0.2, float("nan")]], "=NaN or infinity"),
        (
            "microphones",
            [[200, 0, 0]],
            "=200 m: must be coordinates from -100 to 100 m; are they in",
        ),
        ("loudspeaker", [0.0, 0.0], "=shape (2,): must be 3 finite numbers in m"),
        ("loudspeaker", [0, 0, -1e9], "=1e+09 m: must be coordinates from -100 to 100 m"),
        ("walls", "brick", "=words"),
        ("walls", [[0, 0, 0], [1, 0, 0]], "=shape (2, 3): must be many x 2 finite numbers"),
        ("walls", [[0, 0], [4, 0]], f"=2 corners: {CORNERS}"),
        ("walls", [[0, 0], [4, 0], [4, 3], [0, 0]], f"=1 corners twice: {CORNERS}; it closes by"),
        ("walls", [[0, 0], [4, 0], [8, 0]], f"=an area of 0 m^2: {CORNERS}"),
        ("walls", [[0, 0], [4, 3], [4, 0], [0, 3]], f"=an area of 0 m^2: {CORNERS}; do its sides"),
        ("walls", [[k % 99, k // 99] for k in range(1001)], f"=1001 corners: {CORNERS}"),
        ("walls", [[[0, 0]]], f".0=1 corners: {LINE}"),
        (
            "walls",
            [[[0, 0], [1, 0]], [[0, 0], [0, 0], [1, 1]]],
            ".1=a corner twice in a row: must",
        ),
        ("walls", [[[0, 0], [4, 0], [8, 0], [0, 0]]], f".0=an area of 0 m^2: {CORNERS}"),
        (
            "walls",
            [[[0, 0], [1, 0]], 3],
            "=rows of several lengths, or no numbers: must be many x 2 finite numbers in m",
        ),
        ("walls", [[[0, 0], [1, 0]], [[0, 0, 1]]], ".1=shape (1, 3): must be many x 2 finite"),
        ("walls", [[[k, 0] for k in range(501)]] * 2, "=1002 corners: must have at most 1000"),
        ("walls", [[0, 0], [8000, 0], [8000, 12000]], "=12000 m: must be coordinates from -10000"),
        ("heading_bias_sd_rad", 5, "=5 rad: must be a number from 0 to 3.14159 rad; is it in deg"),
        ("heading_bias_sd_rad", -0.1, "=-0.1 rad"),
        ("conditions", "windy", "=windy: must be a mapping"),
        ("conditions", {"snr_db": "loud"}, ".snr_db=loud dB: must be a number from -200 to 200 dB"),
        ("conditions", {"sdnr_db": [1.0]}, ".sdnr_db=[1.0] dB"),
        ("conditions", {"snr_db": 1e308}, ".snr_db=1e+308 dB"),
        ("conditions", {"pings": 0}, ".pings=0: must be a whole number from 1"),
        ("conditions", {"pings": 2.5}, ".pings=2.5: must be a whole number"),
        ("direct_path", "perhaps", "=perhaps: must be removed or present"),
        ("direct_path", True, "=True: must be removed or present"),
        ("speed_of_sound", ..., "=missing: must be there: in m/s, 343"),
        ("microphones", ..., "=missing: must be there: their positions in the robot's frame in m"),
        ("direct_path", ..., "=missing"),
    ],
)
def test_bad_values_are_refused(folder, key, value, message):
    edit(folder, **{key: value})
    assert refusal(folder, "survey.yaml").startswith(f" {key}{message}")


@pytest.mark.parametrize(
    ("key", "message"),
    [
        ("micorphones", f"micorphones: must be one of {KEYS}; did you mean microphones?"),
        ("robot", f"robot: must be one of {KEYS}; what else is known of a recording goes into con"),
        (5, "5: must"),
        (None, "None: must"),
        ("", ": must"),
        ("a\nb", "a\\nb: must"),
        ("x" * 9999, f"{'x' * 100}: must"),
    ],
)
def test_keys_that_mean_nothing_are_refused(folder, key, message):
    path = folder / "survey.yaml"
    path.write_text(path.read_text() + yaml.safe_dump({key: 1}, width=99999))
    assert refusal(folder, "survey.yaml").startswith(f" key={message}")


def test_a_floor_plan_may_have_pillars_and_doors(folder):
    """A line that ends where it begins is closed; what is read is what is written."""
    pillar = [[2, 2], [3, 2], [3, 3], [2, 2]]
    edit(folder, walls=[[[1, 0], [6, 0], [6, 5], [0, 5], [0, 0]], pillar])
    walls = reader.read_survey(folder).walls
    assert walls.shape == (7, 2, 2)
    assert walls[3].tolist() == [[0, 5], [0, 0]] and walls[6].tolist() == [[3, 3], [2, 2]]
    lines = floor_plan.plain_walls(walls)
    assert np.array_equal(floor_plan.sides(lines), walls)
    # The same lines again, and a single outline as it always was.
    assert lines[1] == pillar
    assert floor_plan.plain_walls(floor_plan.sides([[0, 0], [4, 0], [4, 3]])) == [
        [0, 0],
        [4, 0],
        [4, 3],
    ]
    assert floor_plan.sides([[0, 0], [4, 0], [4, 3]])[2].tolist() == [[4, 3], [0, 0]]


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=6,
)


@given(st.sampled_from([*KEYS.split(", "), "other"]), VALUES)
@settings(max_examples=150)
def test_any_value_is_taken_or_refused_in_one_line(folder, key, value):
    before = (folder / "survey.yaml").read_text()
    edit(folder, **{key: value})
    try:
        reader.read_survey(folder)
    except BadValue as refused:
        assert str(refused).startswith(f"{folder}/") and str(refused).isprintable()
        assert len(str(refused)) < 1000
    (folder / "survey.yaml").write_text(before)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ("sample_rate: 44100.0\n", " key='sample_rate', 2 times: must have each key once"),
        ("  snr_db: 5\n  noise: rotor\n", " key='snr_db', 2 times: must"),
        ('"a\\n": 1\n"a\\n": 2\n', " key='a\\n', 2 times: must"),
        ("a: &a [1]\nb: *a\n", ": cannot be read (it holds an alias"),
        ("\t\twalls: 1\n", ": cannot be read"),
        ("walls: 'abc\n", ": cannot be read"),
        ("? [1]\n: 1\n", ": cannot be read"),
    ],
)
def test_text_that_misleads_is_refused(folder, more, message):
    path = folder / "survey.yaml"
    path.write_text(path.read_text() + more)
    assert refusal(folder, "survey.yaml").startswith(message)


NO_YAML = {
    "\tloudspeaker: [0, 0, 0]\n": "; indent by blanks, not by tabs",
    "direct_path:removed\nmap: true\n": "; is a blank missing behind a colon, or a line indented "
    "otherwise?",
}


@pytest.mark.parametrize("text", NO_YAML)
def test_each_mistake_in_yaml_has_a_hint_of_its_own(folder, text):
    (folder / "survey.yaml").write_text(text)
    assert refusal(folder, "survey.yaml").endswith(NO_YAML[text])


def test_yaml_in_another_encoding_or_of_another_name_is_told(folder):
    path = folder / "survey.yaml"
    path.write_text(f"# Flur S\u00fcd\n{path.read_text()}", encoding="latin-1")
    assert refusal(folder, "survey.yaml").endswith("; save it as UTF-8")
    path.rename(folder / "survey.yml")
    assert refusal(folder, "survey.yaml").endswith(f"; is it {folder}/survey.yml?")


@pytest.mark.parametrize(
    "text",
    [
        "",
        "5",
        "words",
        "[]",
        "{}",
        "- sample_rate",
        "a: [",
        "\0",
        "!!python/name:os.system",
        "!x {}",
    ],
)
def test_text_that_is_no_survey_is_refused(folder, text):
    (folder / "survey.yaml").write_text(text)
    assert refusal(folder, "survey.yaml")


# ---------------------------------------------------------------- poses.csv

HEAD = "index,x_m,y_m,z_m,heading_rad,file\n"
HEAD_ERRORS = HEAD.replace("\n", ",pose_sd_m,heading_sd_rad\n")
COLUMNS = "the columns index,x_m,y_m,z_m,heading_rad,file"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "=no rows"),
        (HEAD, "=no rows"),
        (
            "index,x_m\n0,1\n",
            f"=without y_m, z_m, heading_rad, file: must have {COLUMNS}; is it sep",
        ),
        (HEAD.replace(",", ";") + "0;1;1;1;0;a\n", "=without index, x_m, y_m, z_m"),
        (HEAD.replace("index,", "") + "1,1,1,0,a\n", "=without index"),
        (
            HEAD + "0,here,1,1,0,a\n",
            " row 2 x_m='here': must be a number from -10000 to 10000 m; write",
        ),
        (HEAD + "0,1,1,1,0,a\n\n1,1,1,,0,b\n", " row 4 z_m='': must be a number"),
        (HEAD + "0,1,1\n", " row 2 z_m=None: must be a number"),
        (HEAD + "0,1,5,2,5,1,0,a\n", " row 2=8 cells: must be 6 cells; are decimals set off by a"),
        (HEAD + "0,1,1,1,0\n", " row 2 file=None: must be the name of a recording, which can be"),
        (HEAD + "0,1,1,1,0,\n", " row 2 file='': must"),
        (HEAD + "0,1,1,1,0,a\x07\n", " row 2 file='a\\x07': must"),
        (
            HEAD + "0,1,1,1,inf,a\n",
            " row 2 heading_rad='inf': must be a number from -100 to 100 rad",
        ),
        (
            HEAD + "0,1,1,1,180,a\n",
            " row 2 heading_rad='180': must be a number from -100 to 100 rad; is ",
        ),
        (
            HEAD + "0,1,12000,1,0,b\n",
            " row 2 y_m='12000': must be a number from -10000 to 10000 m; are",
        ),
        (
            HEAD + ",1,1,1,0,a\n",
            " row 2 index='': must be whole numbers of at most 19 digits; they ",
        ),
        (HEAD + "1.0,1,1,1,0,a\n", " row 2 index='1.0': must"),
        (HEAD + "-1,1,1,1,0,a\n", " row 2 index='-1': must"),
        (HEAD + "1_0,1,1,1,0,a\n", " row 2 index='1_0': must"),
        (HEAD + "\u0663,1,1,1,0,a\n", " row 2 index='\\u0663': must"),
        (HEAD + "9" * 20 + ",1,1,1,0,a\n", f" row 2 index='{'9' * 20}': must"),
        (HEAD + "3,1,1,1,0,a\n03,1,1,1,0,c\n", " index=3, 2 times: must have each number once"),
        (HEAD + f"0,1,1,1,0,{'a' * 200_000}\n", ": cannot be read"),
        (HEAD_ERRORS + "0,1,1,1,0,a,0.01,2\n1,1,1,1,0,b,30,2\n", " row 3 pose_sd_m='30': must be"),
        (
            HEAD_ERRORS + "0,1,1,1,0,a,0.01,5\n",
            " row 2 heading_sd_rad='5': must be a number from 0 to 3.14159 rad; is it in degrees?",
        ),
        (
            HEAD_ERRORS + "0,1,1,1,0,a,-0.01,0\n",
            " row 2 pose_sd_m='-0.01': must be a number",
        ),
        (HEAD_ERRORS + "0,1,1,1,0,a,,0\n", " row 2 pose_sd_m='': must be a number"),
        ("\x00\x01" + HEAD, ""),
    ],
)
def test_bad_poses_are_refused(folder, text, message):
    (folder / "poses.csv").write_text(text)
    assert refusal(folder, "poses.csv").startswith(message)


LIMITS = "must be a number from -10000 to 10000 m; "
MISTAKES = {
    "nan": LIMITS + "remove the row of a pose that is not known",
    "": LIMITS + "remove the row of a pose that is not known",
    "#N/A": LIMITS + "remove the row of a pose that is not known",
    "-inf": LIMITS + "remove the row of a pose that is not known",
    "1.5m": LIMITS + "write the number alone, decimals set off by a point",
    '"1,5"': LIMITS + "are decimals set off by a point, cells by commas?",
    "\u22121.5": LIMITS + "is its sign a dash? A minus is written -",
    "12500": LIMITS + "are they in mm?",
    "691608.4": LIMITS + "are they UTM, or in mm? Count metres from a corner of the room",
}


@pytest.mark.parametrize("cell", MISTAKES)
def test_each_mistake_in_a_cell_has_a_hint_of_its_own(folder, cell):
    (folder / "poses.csv").write_text(HEAD + f"0,1,1,1,0,a\n1,1,{cell},1,0,b\n")
    shown = ascii(cell.strip('"'))
    assert refusal(folder, "poses.csv") == f" row 3 y_m={shown}: {MISTAKES[cell]}"
    (folder / "poses.csv").write_text(HEAD + "0,1,1,1,90\u00b0,a\n", encoding="utf-8")
    assert refusal(folder, "poses.csv").endswith("; is it in degrees?")


FIRST_ROWS = {
    HEAD.replace(",", ";"): "is it separated by commas? There are semicolons",
    HEAD.replace(",", "\t"): "is it separated by commas? There are tabs",
    HEAD.replace(",", " "): "is it separated by commas?",
    "# monday\n" + HEAD: "is it separated by commas? There are comments before it",
    "sep=;\n" + HEAD.replace(",", ";"): "is it separated by commas? There are semicolons",
    HEAD.upper(): "write them in small letters",
    "0,1.5,-2,1,0.5,a.wav\n": "does the first row name the columns?",
    HEAD.replace("_m", ""): "are they named otherwise?",
    HEAD.replace("heading_rad", "yaw"): "headings are in rad, counter-clockwise from x; write it "
    "so, and name it heading_rad",
    HEAD.replace("_rad", "_deg"): "headings are in rad, counter-clockwise from x; write it so, and "
    "name it heading_rad",
}


@pytest.mark.parametrize("first", FIRST_ROWS)
def test_each_mistake_in_the_first_row_has_a_hint_of_its_own(folder, first):
    (folder / "poses.csv").write_text(first + "0,1,1,1,0,a\n1,1,2,1,0,b\n")
    said = refusal(folder, "poses.csv")
    assert said.startswith("=without ") and said.endswith(f"{COLUMNS}; {FIRST_ROWS[first]}")


def test_a_column_that_is_there_twice_is_refused(folder):
    """Of which the last would be taken."""
    text = HEAD.replace("\n", ",x_m\n") + "0,1,1,1,0,a,7\n"
    (folder / "poses.csv").write_text(text)
    assert refusal(folder, "poses.csv") == "=column 'x_m', 2 times: must have each column once"


def test_the_line_by_which_spreadsheets_name_their_mark_is_no_row(folder):
    path = folder / "poses.csv"
    usual = reader.read_survey(folder)
    text = path.read_text()
    for begin in ("sep=,\n", "\ufeffSEP=,\r\n"):
        path.write_text(begin + text, encoding="utf-8")
        found = reader.read_survey(folder)
        assert found.files == usual.files and found.numbers == usual.numbers
    path.write_text("sep=,\n" + HEAD + "0,1,1,1,0,a\n1,1,x,1,0,b\n")
    assert refusal(folder, "poses.csv").startswith(" row 4 y_m='x'")


def walked(headings, places, *, files=()):
    """Return a table of poses at those headings and places (P, 2)."""
    rows = zip(headings, places, files or [f"{k}.wav" for k in range(len(headings))], strict=True)
    lines = [f"{k},{x},{y},1,{angle},{file}\n" for k, (angle, (x, y), file) in enumerate(rows)]
    return HEAD + "".join(lines)


STEPS = np.arange(20)
STILL = np.tile([2.0, 3.0], (20, 1))
STRAIGHT = np.stack([STEPS * 0.3, 0 * STEPS], axis=1)
BEND = 3 * np.stack([np.sin(STEPS / 14), 1 - np.cos(STEPS / 14)], axis=1)
ANY = np.random.default_rng(0).uniform(0, 90, 20)
TANGENT = STEPS / 14 + 1 / 28
NOISE = 0.02 * np.random.default_rng(1).standard_normal(20)

DEGREES = {
    "any up to 90": (ANY, STILL),
    "any from -45 to 45": (ANY - 45, STRAIGHT),
    "typed whole": (STEPS, STILL),
    "typed in halves": (STEPS / 2, STRAIGHT),
    "always 45": (0 * STEPS + 45, STRAIGHT),
    "around one corner": (np.where(STEPS < 12, 0.3, 89.8) + NOISE, STRAIGHT),
    "along a bend": (np.rad2deg(TANGENT + NOISE), BEND),
    "to the right of a bend": (np.rad2deg(TANGENT + NOISE) - 90, BEND),
}


@pytest.mark.parametrize("name", DEGREES)
def test_headings_in_degrees_are_refused_below_100_too(folder, name):
    headings, places = DEGREES[name]
    (folder / "poses.csv").write_text(walked(headings, places))
    said = refusal(folder, "poses.csv")
    assert said.startswith(f" heading_rad=values up to {np.abs(headings).max():g}: must be rad; ")


RADIANS = {
    "within pi": (np.random.default_rng(2).uniform(-np.pi, np.pi, 20), STRAIGHT),
    "within two pi": (np.random.default_rng(2).uniform(0, 2 * np.pi, 20), STRAIGHT),
    "to and fro across pi": (np.where(STEPS % 2, 3.1416, -3.1416), STILL),
    "typed whole within a turn": (STEPS % 7, STILL),
    "turning on the spot": (STEPS * 0.7, STILL),
    "turning fast": (STEPS * 2.4, STILL),
    "turning along a line": (STEPS * 0.7 + NOISE, STRAIGHT),
    "turning along a bend": (STEPS * 0.7 + NOISE, BEND),
    "two turns before the bend": (TANGENT + 4 * np.pi + NOISE, BEND),
}


@pytest.mark.parametrize("name", RADIANS)
@pytest.mark.parametrize("shuffled", [False, True])
def test_headings_in_rad_are_taken_as_they_are(folder, name, shuffled):
    """In whatever order the rows stand."""
    headings, places = RADIANS[name]
    head, *rows = walked(headings, places).splitlines(keepends=True)
    if shuffled:
        rows = [rows[k] for k in np.random.default_rng(3).permutation(20)]
    (folder / "poses.csv").write_text(head + "".join(rows))
    found = [pose.heading for pose in read_poses(folder / "poses.csv")[1]]
    assert sorted(found) == sorted(headings)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (walked(0 * STEPS, 1000 * BEND), " x_m, y_m=steps of 214.24: must be m, most poses"),
        (walked(0 * STEPS, 100 * STRAIGHT), " x_m, y_m=steps of 30: must be m, most poses within"),
        (walked(TANGENT, BEND, files=["a"] * 20), " file=a, 20 times: must name a recording for"),
        (walked([0.0, 0.1], STILL[:2], files=["a", "a"]), " file=a, 2 times: must name"),
    ],
)
def test_what_no_robot_walks_is_refused(folder, text, message):
    (folder / "poses.csv").write_text(text)
    assert refusal(folder, "poses.csv").startswith(message)


@pytest.mark.parametrize("empty", [",,,,,", ", ,,\t,, ", ",,,,,,,", "\r"])
def test_rows_without_a_cell_are_no_poses(folder, empty):
    path = folder / "poses.csv"
    head, *rows = path.read_text().splitlines()
    path.write_text("\r\n".join([head, empty, rows[0], empty, rows[1], empty, empty]), newline="")
    assert reader.read_survey(folder).numbers == (0, 1)


@pytest.mark.parametrize(
    "text", ["3.43e2", "3.43E+2", "343e0", "+3430e-1", ".343e3", "343.e0", "0343"]
)
def test_exponents_and_leading_zeros_are_numbers(folder, text):
    path = folder / "survey.yaml"
    path.write_text(re.sub("(?<=speed_of_sound: ).*", text, path.read_text()))
    path.write_text(path.read_text().replace("- - 0.2\n", "- - 2e-1\n"))
    survey = reader.read_survey(folder)
    assert survey.speed_of_sound == 343.0
    assert survey.array.positions[0].tolist() == [0.2, 0.0, 0.0]


def test_spreadsheets_may_begin_with_a_mark_and_set_blanks(folder):
    text = (
        f"\ufeffindex, x_m , y_m, z_m, heading_rad, file\r\n7, 1.0, 2, 1.5, -3e-1, {FILES[0]},\r\n"
    )
    (folder / "poses.csv").write_text(text, encoding="utf-8", newline="")
    survey = reader.read_survey(folder)
    assert (survey.numbers, survey.files, survey.poses[0].heading) == ((7,), (FILES[0],), -0.3)
    assert survey.poses[0].position.tolist() == [1.0, 2.0, 1.5]


def test_how_far_poses_may_be_off_can_be_told(folder):
    """Each by a column of its own, in any order; unless told, not at all."""
    survey = reader.read_survey(folder)
    assert survey.heading_bias_sd == survey.poses[0].heading_sd == survey.poses[0].position_sd == 0
    edit(folder, heading_bias_sd_rad=0.03)
    (folder / "poses.csv").write_text("heading_sd_rad," + HEAD + f"0.1,7,1,2,1.5,0,{FILES[0]}\n")
    survey = reader.read_survey(folder)
    assert survey.heading_bias_sd == 0.03
    assert (survey.poses[0].position_sd, survey.poses[0].heading_sd) == (0.0, 0.1)


def test_headings_and_positions_are_written_to_the_last_digit():
    text = poses_csv([Pose(np.array([1 / 3, 0.1 + 0.2, 1e-9]), np.pi)], ["a.wav"]).decode()
    expected = "0,0.3333333333333333,0.30000000000000004,1e-09,3.141592653589793,a.wav"
    assert text.splitlines()[1] == expected
