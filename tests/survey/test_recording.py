"""The survey format: what is written is read back, and whatever is wrong with a file is said in one
line."""

import os
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import soundfile
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.io import wavfile

from echolearn.acoustics.geometry import circular_array, outline
from echolearn.acoustics.signals import noise_probe
from echolearn.acoustics.types import Array, Pose, Room
from echolearn.checks import BadValue
from echolearn.survey import audio, reader
from echolearn.survey.description import description_bytes
from echolearn.survey.poses import poses_csv
from echolearn.survey.direct_path import delayed

PROBE = noise_probe(burst=100, length=400)
ARRAY = circular_array(microphones=3)
ROOM = Room((5.0, 4.0, 3.0), 0.25)
POSES = (Pose(np.array([1.0, 2.0, 1.5]), 0.1), Pose(np.array([1.1, 1 / 3, 1.5]), -3.0))
FILES = ("observations/0.wav", "observations/1.wav")
SAMPLES = np.random.default_rng(0).standard_normal((2, 3, 400)).astype(np.float32)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Write a small survey by hand."""
    (tmp_path / "observations").mkdir()
    conditions = {"snr_db": 3.0, "noise": "white"}
    about = description_bytes(
        ARRAY, PROBE, speed_of_sound=340.0, walls=outline(ROOM), conditions=conditions
    )
    (tmp_path / "survey.yaml").write_bytes(about)
    (tmp_path / "probe.wav").write_bytes(audio.wav_bytes(np.pad(PROBE.samples, (0, 300)), 22050.0))
    (tmp_path / "poses.csv").write_bytes(poses_csv(POSES, FILES))
    for name, samples in zip(FILES, SAMPLES, strict=True):
        (tmp_path / name).write_bytes(audio.wav_bytes(samples, 22050.0))
    return tmp_path


def edit(folder: Path, **changes: Any) -> None:
    """Change keys of `survey.yaml`."""
    path = folder / "survey.yaml"
    path.write_text(yaml.safe_dump({**yaml.safe_load(path.read_text()), **changes}))


def refusal(folder: Path) -> str:
    """Return the one line with which the survey is refused."""
    with pytest.raises(BadValue) as refused:
        reader.read_survey(folder).observe([0, 1])
    assert "\n" not in str(refused.value)
    return str(refused.value)


# ---------------------------------------------------------------- round trips


def test_what_is_written_is_read_back(folder: Path) -> None:
    survey = reader.read_survey(folder)
    assert np.array_equal(survey.probe.samples, PROBE.samples)
    assert (survey.probe.sample_rate, survey.probe.length) == (22050.0, 400)
    assert np.array_equal(survey.array.positions, ARRAY.positions)
    assert survey.speed_of_sound == 340.0
    assert survey.files == FILES
    assert survey.numbers == (0, 1)
    assert [(*pose.position, pose.heading) for pose in survey.poses] == [
        (*p.position, p.heading) for p in POSES
    ]
    assert np.array_equal(survey.walls, outline(ROOM))
    assert survey.conditions == {"snr_db": 3.0, "noise": "white"}
    observation = survey.observe([1, 0])
    assert observation.samples.dtype == np.float64
    assert np.array_equal(observation.samples, SAMPLES[[1, 0]])
    assert observation.speed_of_sound == 340.0


def test_poses_are_called_what_the_table_calls_them(folder: Path) -> None:
    """As nanoseconds since 1970, not in order."""
    text = HEAD + f"{2**60},1,2,1.5,0,{FILES[1]}\n7,1,2,1.5,0,{FILES[0]}\n"
    (folder / "poses.csv").write_text(text)
    survey = reader.read_survey(folder)
    assert survey.numbers == (2**60, 7)
    assert np.array_equal(survey.observe([1]).samples[0], SAMPLES[0])


def test_recordings_may_be_flac(folder: Path) -> None:
    """The same walk, one recording packed without loss; what was float32 has then 24 bits."""
    quiet = SAMPLES / 8
    soundfile.write(folder / "observations" / "1.flac", quiet[1].T, 22050, subtype="PCM_24")
    path = folder / "poses.csv"
    path.write_text(path.read_text().replace("1.wav", "1.flac"))
    heard = reader.read_survey(folder).observe([0, 1]).samples
    assert np.array_equal(heard[0], SAMPLES[0])
    assert np.abs(heard[1] - quiet[1]).max() <= 2**-23


def test_walls_and_conditions_may_be_left_out(folder: Path) -> None:
    edit(folder, walls=None, conditions=None)
    survey = reader.read_survey(folder)
    assert survey.walls is None
    assert survey.conditions == {}


def test_levels_that_are_not_known_may_be_null(folder: Path) -> None:
    known = {"snr_db": None, "sdnr_db": -3, "pings": 4, "weather": "rain"}
    edit(folder, conditions=known)
    assert reader.read_survey(folder).conditions == known


def test_a_loudspeaker_elsewhere_moves_the_microphones(folder: Path) -> None:
    """An array is told relative to its loudspeaker."""
    edit(folder, loudspeaker=[0.1, -0.2, 0.3])
    assert np.allclose(reader.read_survey(folder).array.positions, ARRAY.positions - [0.1, -0.2, 0.3])


# ---------------------------------------------------------------- recordings


def test_a_recording_with_a_channel_too_few_is_refused(folder: Path) -> None:
    (folder / FILES[1]).write_bytes(audio.wav_bytes(SAMPLES[0, :2], 22050.0))
    assert refusal(folder).endswith("observations/1.wav=(2, 400): 3 channels of 400 samples")


def test_a_recording_of_another_length_is_refused(folder: Path) -> None:
    (folder / FILES[0]).write_bytes(audio.wav_bytes(SAMPLES[0, :, :399], 22050.0))
    assert refusal(folder).endswith("observations/0.wav=(3, 399): 3 channels of 400 samples")


def test_a_recording_at_another_rate_is_refused(folder: Path) -> None:
    (folder / FILES[0]).write_bytes(audio.wav_bytes(SAMPLES[0], 44100.0))
    assert refusal(folder).endswith("0.wav sample_rate=44100 Hz: 22050 Hz; resample the recording")


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("name", ["observations/1.wav", "probe.wav"])
def test_a_recording_that_is_not_numbers_is_refused(folder: Path, name: str, value: float) -> None:
    broken = SAMPLES[1].copy() if name != "probe.wav" else np.pad(PROBE.samples, (0, 300))
    broken[..., 7] = value
    (folder / name).write_bytes(audio.wav_bytes(broken, 22050.0))
    assert refusal(folder).endswith(f"{name}=NaN or infinity: finite samples")


@pytest.mark.parametrize("name", ["survey.yaml", "probe.wav", "poses.csv", "observations/0.wav"])
def test_a_missing_file_is_named(folder: Path, name: str) -> None:
    (folder / name).unlink()
    assert refusal(folder).startswith(f"{folder / name}: cannot be read")


def test_silence_is_no_probe(folder: Path) -> None:
    (folder / "probe.wav").write_bytes(audio.wav_bytes(np.zeros(400), 22050.0))
    assert refusal(folder).endswith("probe.wav=silence: the burst that was emitted")


@given(
    st.lists(st.tuples(st.integers(0, 80), st.integers(0, 255)), min_size=1, max_size=4),
    st.integers(0, 4000),
)
@settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_a_damaged_header_is_an_error_or_a_recording(
    folder: Path, bytes_: list[tuple[int, int]], cut: int
) -> None:
    """Whatever stands in the first bytes, and wherever the file ends, there is no traceback of a
    parser."""
    content = bytearray(audio.wav_bytes(SAMPLES[0], 22050.0))
    for place, value in bytes_:
        content[place] = value
    (folder / FILES[0]).write_bytes(bytes(content[: len(content) - cut if cut % 2 else None]))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", wavfile.WavFileWarning)
        try:
            assert reader.read_survey(folder).observe([0]).samples.shape == (1, 3, 400)
        except BadValue as refused:
            assert "\n" not in str(refused)


def test_noise_alone_may_be_longer_than_a_recording_and_may_be_absent(folder: Path) -> None:
    assert reader.read_survey(folder).noise() is None
    noise = np.random.default_rng(1).standard_normal((3, 1000)).astype(np.float32)
    (folder / "noise.wav").write_bytes(audio.wav_bytes(noise, 22050.0))
    assert np.array_equal(reader.read_survey(folder).noise(), noise)


@pytest.mark.parametrize(
    ("samples", "rate", "message"),
    [
        (np.ones((2, 1000)), 22050.0, "noise.wav=(2, 1000): 3 channels of at least 400 samples"),
        (np.ones((3, 399)), 22050.0, "noise.wav=(3, 399): 3 channels of at least 400 samples"),
        (
            np.ones((3, 1000)),
            44100.0,
            "noise.wav sample_rate=44100 Hz: 22050 Hz; resample the recording",
        ),
        (np.full((3, 1000), np.nan), 22050.0, "noise.wav=NaN or infinity: finite samples"),
    ],
)
def test_noise_that_does_not_fit_is_refused(
    folder: Path, samples: np.ndarray, rate: float, message: str
) -> None:
    (folder / "noise.wav").write_bytes(audio.wav_bytes(samples, rate))
    with pytest.raises(BadValue) as refused:
        reader.read_survey(folder).noise()
    assert str(refused.value).endswith(message)


# ---------------------------------------------------------------- the direct path


def coloured() -> Array:
    """Return the direct path of a loudspeaker that rings, shape (3, 400)."""
    arrived = delayed(PROBE, ARRAY, speed_of_sound=340.0)
    rung = np.apply_along_axis(np.convolve, 1, arrived, 0.8 ** np.arange(30))[:, :200]
    return np.pad(rung, ((0, 0), (0, 200)))


@pytest.mark.parametrize("length", [200, 400, 900])
def test_a_direct_path_that_was_recorded_is_removed_whatever_the_loudspeaker(
    folder: Path, length: int
) -> None:
    """Recorded louder and through other gains than on the walk, and cut or padded; geometry alone
    would leave half."""
    gains, path = np.array([[3.0], [0.5], [-2.0]]), coloured()
    for name, samples in zip(FILES, SAMPLES, strict=True):
        (folder / name).write_bytes(audio.wav_bytes(gains * path + 1e-3 * samples, 22050.0))
    edit(folder, direct_path="present")
    fitted = reader.read_survey(folder).observe([0, 1]).samples
    alone = np.pad(0.25 * path, ((0, 0), (0, 500)))[:, :length]
    (folder / "calibration.wav").write_bytes(audio.wav_bytes(alone, 22050.0))
    left = reader.read_survey(folder).observe([0, 1]).samples
    assert np.mean((left - 1e-3 * SAMPLES) ** 2) < 0.01 * np.mean((1e-3 * SAMPLES) ** 2)
    assert np.mean(fitted**2) > 1e4 * np.mean(left**2)


@pytest.mark.parametrize(
    ("samples", "rate", "message"),
    [
        (np.ones((2, 400)), 22050.0, "calibration.wav=(2, 400): 3 channels"),
        (np.ones((3, 400)), 44100.0, "calibration.wav sample_rate=44100 Hz: 22050 Hz; resample the recording"),
        (np.full((3, 400), np.inf), 22050.0, "calibration.wav=NaN or infinity: finite samples"),
        (np.ones((3, 400)) * [[1], [0], [0]], 22050.0,
         "calibration.wav channels=[2, 3]: the direct path in each; a deaf microphone?"),
    ],
)  # fmt: skip
def test_a_calibration_that_does_not_fit_is_refused(
    folder: Path, samples: np.ndarray, rate: float, message: str
) -> None:
    edit(folder, direct_path="present")
    (folder / "calibration.wav").write_bytes(audio.wav_bytes(samples, rate))
    assert refusal(folder).endswith(message)


def test_a_calibration_where_there_is_no_direct_path_is_refused(folder: Path) -> None:
    (folder / "calibration.wav").write_bytes(audio.wav_bytes(coloured(), 22050.0))
    assert refusal(folder).endswith(
        "calibration.wav direct_path=removed: present; there is none to remove"
    )


@pytest.mark.parametrize("name", ["noise.wav", "calibration.wav"])
def test_what_may_be_beside_the_recordings_is_no_link(folder: Path, name: str) -> None:
    (folder / name).symlink_to("/dev/zero")
    assert refusal(folder).endswith(f"{name}=a link: a path inside the survey's folder")


# ---------------------------------------------------------------- survey.yaml


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sample_rate": "fast"}, "sample_rate=fast Hz: must be a number from 1000 to 400000 Hz"),
        ({"sample_rate": None}, "sample_rate=None Hz"),
        ({"sample_rate": 22.05}, "sample_rate=22.05 Hz"),
        (
            {"speed_of_sound": 0.343},
            "speed_of_sound=0.343 m/s: must be a number from 100 to 2000 m/s; air is 343 m/s",
        ),
        ({"speed_of_sound": "quick"}, "speed_of_sound=quick m/s"),
        ({"microphones": "six"}, "microphones=six: many x 3 finite numbers in m"),
        ({"microphones": None}, "microphones=None"),
        ({"microphones": []}, "microphones=[]"),
        ({"microphones": [[0.1, 0.2], [0.3]]}, "microphones=[[0.1, 0.2], [0.3]]"),
        ({"microphones": [[0.1, 0.2, float("nan")]]}, "microphones=[[0.1, 0.2, nan]]"),
        ({"loudspeaker": [0.0, 0.0]}, "loudspeaker=[0.0, 0.0]: 3 finite numbers in m"),
        ({"walls": [[0, 0, 0], [1, 0, 0]]}, "walls=[[0, 0, 0], [1, 0, 0]]: many x 2"),
        ({"walls": "brick"}, "walls=brick"),
        ({"walls": []}, "walls=[]: many x 2"),
        (
            {"walls": [[0, 0], [4, 0]]},
            "walls=2 corners: null, or 3 to 1000 distinct corners in order around an area",
        ),
        (
            {"walls": [[0, 0], [4, 0], [4, 3], [0, 0]]},
            "walls=1 corners twice: null, or 3 to 1000 distinct corners",
        ),
        (
            {"walls": [[0, 0], [4, 0], [8, 0]]},
            "walls=an area of 0 m^2: null, or 3 to 1000 distinct corners",
        ),
        ({"walls": [[0, 0], [4, 3], [4, 0], [0, 3]]}, "walls=an area of 0 m^2: null, or"),
        (
            {"walls": [[k % 99, k // 99] for k in range(1001)]},
            "walls=1001 corners: null, or 3 to 1000",
        ),
        (
            {"walls": [[0, 0], [8000, 0], [8000, 12000]]},
            "walls=12000 m: coordinates from -10000 to 10000 m; are",
        ),
        (
            {"microphones": [[200, 0, k] for k in range(3)]},
            "microphones=200 m: coordinates from -100 to 100 m; are",
        ),
        ({"loudspeaker": [0, 0, -1e9]}, "loudspeaker=1e+09 m: coordinates from -100 to 100 m"),
        ({"conditions": "windy"}, "conditions=windy: a mapping"),
        (
            {"conditions": {"snr_db": "loud"}},
            "conditions.snr_db=loud dB: must be a number from -200 to 200 dB; null, or",
        ),
        ({"conditions": {"sdnr_db": [1.0]}}, "conditions.sdnr_db=[1.0] dB: a number"),
        ({"conditions": {"snr_db": float("nan")}}, "conditions.snr_db=nan dB: a number"),
        ({"conditions": {"snr_db": 1e308}}, "conditions.snr_db=1e+308 dB: a number"),
        ({"conditions": {"pings": 0}}, "conditions.pings=0: must be a whole number from 1 to 1000000000"),
        ({"conditions": {"pings": 2.5}}, "conditions.pings=2.5: must be a whole number"),
        ({"direct_path": "perhaps"}, "direct_path=perhaps: removed or present"),
        ({"direct_path": True}, "direct_path=True: removed or present"),
    ],
)
def test_bad_keys_are_refused(folder: Path, change: dict[str, Any], message: str) -> None:
    edit(folder, **change)
    assert refusal(folder).startswith(f"{folder}/survey.yaml {message}")


@pytest.mark.parametrize(
    ("key", "message"),
    [
        ("micorphones", "key=micorphones: sample_rate, speed_of_sound, microphones, loudspeaker, direct_path, walls, "
         "conditions; did you mean microphones?"),
        ("Walls", "key=Walls: sample_rate, speed_of_sound, microphones, loudspeaker, direct_path, walls, "
         "conditions; did you mean walls?"),
        ("robot", "key=robot: sample_rate, speed_of_sound, microphones, loudspeaker, direct_path, walls, "
         "conditions; what else is known of a recording goes into conditions"),
        (5, "key=5: sample_rate"),
        (None, "key=None: sample_rate"),
        ("", "key=: sample_rate"),
        ("a\nb", "key='a\\nb': sample_rate"),
        ("x" * 9999, f"key={'x' * 100}: sample_rate"),
    ],
)  # fmt: skip
def test_keys_that_mean_nothing_are_refused(folder: Path, key: Any, message: str) -> None:
    path = folder / "survey.yaml"
    path.write_text(
        yaml.safe_dump(yaml.safe_load(path.read_text()) | {key: [[0.0, 0.0]]}, width=99999)
    )
    assert refusal(folder).startswith(f"{folder}/survey.yaml {message}")


def test_a_key_that_must_be_there_may_be_misspelt(folder: Path) -> None:
    path = folder / "survey.yaml"
    path.write_text(path.read_text().replace("speed_of_sound", "sped_of_sound"))
    assert refusal(folder).endswith("did you mean speed_of_sound?")


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("sample_rate: 44100.0\n", "key='sample_rate', 2 times: each key once"),
        ("  snr_db: 5\n  noise: rotor\n", "key='snr_db', 2 times: each key once"),
        ('"a\\n": 1\n"a\\n": 2\n', "key='a\\n', 2 times: each key once"),
    ],
)
def test_a_key_that_is_twice_is_refused(folder: Path, more: str, said: str) -> None:
    path = folder / "survey.yaml"
    path.write_text(path.read_text() + more)
    assert refusal(folder) == f"{path} {said}"


@pytest.mark.parametrize(
    "key", ["sample_rate", "speed_of_sound", "microphones", "loudspeaker", "direct_path"]
)
def test_a_missing_key_is_named(folder: Path, key: str) -> None:
    content = yaml.safe_load((folder / "survey.yaml").read_text())
    del content[key]
    (folder / "survey.yaml").write_text(yaml.safe_dump(content))
    assert refusal(folder).startswith(
        f"{folder}/survey.yaml=without {key}: a mapping with sample_rate"
    )


@pytest.mark.parametrize(
    "text",
    ["", "5", "words", "[]", "{}", "- sample_rate", "a: [", "\x00", "!!python/name:os.system"],
)
def test_text_that_is_no_survey_is_refused(folder: Path, text: str) -> None:
    (folder / "survey.yaml").write_text(text)
    assert refusal(folder).startswith(f"{folder}/survey.yaml")


# ---------------------------------------------------------------- poses.csv

HEAD = "index,x_m,y_m,z_m,heading_rad,file\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no rows"),
        (HEAD, "no rows"),
        (
            "index,x_m\n0,1\n",
            "=without y_m, z_m, heading_rad, file: the columns index,x_m,y_m,z_m,heading_rad,file; ",
        ),
        (
            HEAD.replace(",", ";") + "0;1;1;1;0;a\n",
            "=without index, x_m, y_m, z_m, heading_rad, file: the columns index,",
        ),
        (HEAD.replace(",", "\t") + "0\t1\t1\t1\t0\ta\n", "file; is it separated by commas?"),
        (
            HEAD + "0,here,1,1,0,a\n",
            " row 2 x_m='here': must be a number from -10000 to 10000 m; are decimals set off",
        ),
        (HEAD + "0,1,1,1,0,a\n\n1,1,1,,0,b\n", " row 4 z_m='': a number"),
        (HEAD + "0,1,1\n", " row 2 z_m=None: a number"),
        (
            HEAD + "0,1,5,2,5,1,0,a\n",
            " row 2=8 cells: 6; are decimals set off by a point, cells by commas?",
        ),
        (HEAD + "0,1,1,1,0\n", " row 2 file=None: the name of a recording, which can be printed"),
        (HEAD + "0,1,1,1,0,\n", " row 2 file='': the name"),
        (HEAD + "0,1,1,1,0,a\x07\n", " row 2 file='a\\x07': the name"),
        (HEAD + "0,nan,1,1,0,observations/0.wav\n", " row 2 x_m='nan': a number"),
        (
            HEAD + "0,1,1,1,inf,observations/0.wav\n",
            " row 2 heading_rad='inf': must be a number from -100 to 100 rad",
        ),
        (
            HEAD + "0,1,1,1,180,a\n",
            " row 2 heading_rad='180': must be a number from -100 to 100 rad; is it in degrees?",
        ),
        (
            HEAD + "0,1,1,1,0,a\n1,1,12000,1,0,b\n",
            " row 3 y_m='12000': must be a number from -10000 to 10000 m; are they in mm?",
        ),
        (
            HEAD.replace("index,", "") + "1,1,1,0,observations/0.wav\n",
            "=without index: the columns",
        ),
        (
            HEAD + ",1,1,1,0,a\n",
            " row 2 index='': whole numbers of at most 19 digits; they name the poses in map.csv",
        ),
        (HEAD + "1.0,1,1,1,0,a\n", "index='1.0': whole"),
        (HEAD + "-1,1,1,1,0,a\n", "index='-1': whole"),
        (HEAD + "1_0,1,1,1,0,a\n", "index='1_0': whole"),
        (HEAD + "\u0663,1,1,1,0,a\n", "index='\\u0663': whole"),
        (HEAD + "9" * 20 + ",1,1,1,0,a\n", "index='99999999999999999999': whole"),
        (HEAD + "3,1,1,1,0,a\n4,1,1,1,0,b\n03,1,1,1,0,c\n", "index=3, 2 times: each number once"),
        ("\x00\x01" + HEAD, "/poses.csv"),
    ],
)
def test_bad_poses_are_refused(folder: Path, text: str, message: str) -> None:
    (folder / "poses.csv").write_text(text)
    line = refusal(folder)
    assert line.startswith(f"{folder}/poses.csv")
    assert message in line


def test_spreadsheets_may_begin_with_a_mark_and_set_blanks(folder: Path) -> None:
    text = (
        f"\ufeffindex, x_m , y_m, z_m, heading_rad, file\r\n7, 1.0, 2, 1.5, -3e-1, {FILES[0]},\r\n"
    )
    (folder / "poses.csv").write_text(text, encoding="utf-8", newline="")
    survey = reader.read_survey(folder)
    assert (survey.numbers, survey.files, survey.poses[0].heading) == ((7,), (FILES[0],), -0.3)
    assert survey.poses[0].position.tolist() == [1.0, 2.0, 1.5]


def test_headings_and_positions_are_written_to_the_last_digit() -> None:
    line = (
        poses_csv([Pose(np.array([1 / 3, 0.1 + 0.2, 1e-9]), np.pi)], ["a.wav"])
        .decode()
        .splitlines()[1]
    )
    assert line == "0,0.3333333333333333,0.30000000000000004,1e-09,3.141592653589793,a.wav"


# ---------------------------------------------------------------- from a stranger


def aliases(folder: Path) -> None:
    """Write a few lines that stand for a thousand million numbers."""
    levels = [f"l{k}: &l{k} [{', '.join([f'*l{k - 1}'] * 10)}]" for k in range(1, 9)]
    text = (folder / "survey.yaml").read_text()
    (folder / "survey.yaml").write_text(
        "\n".join(["l0: &l0 [0, 0, 0]", *levels, text, "walls: *l8", ""])
    )


HOSTILE: dict[str, tuple[Callable[[Path], object], str]] = {
    "aliases": (aliases, "survey.yaml: cannot be read (it holds an alias"),
    "an object": (
        lambda f: (f / "survey.yaml").write_text("!!python/object/apply:os.system ['true']"),
        "survey.yaml: cannot be read",
    ),
    "nested": (
        lambda f: (f / "survey.yaml").write_text("[" * 100_000),
        "survey.yaml: cannot be read",
    ),
    "nested lists": (
        lambda f: (f / "survey.yaml").write_text("- " * 30_000),
        "survey.yaml: cannot be read",
    ),
    "nested keys": (
        lambda f: (f / "survey.yaml").write_text("? " * 20_000),
        "survey.yaml: cannot be read",
    ),
    "binary": (
        lambda f: (f / "survey.yaml").write_bytes(bytes(range(256))),
        "survey.yaml: cannot be read",
    ),
    "a terabyte of yaml": (
        lambda f: os.truncate(f / "survey.yaml", 1 << 40),
        "1099511627776 bytes: at most",
    ),
    "a terabyte of poses": (
        lambda f: os.truncate(f / "poses.csv", 1 << 40),
        "1099511627776 bytes: at most",
    ),
    "a terabyte of probe": (
        lambda f: os.truncate(f / "probe.wav", 1 << 40),
        "1099511627776 bytes: at most",
    ),
    "a terabyte recorded": (
        lambda f: os.truncate(f / FILES[1], 1 << 40),
        "1099511627776 bytes: at most",
    ),
    "half a recording": (lambda f: os.truncate(f / FILES[1], 2500), FILES[1]),
    "a pipe": (lambda f: ((f / FILES[0]).unlink(), os.mkfifo(f / FILES[0])), "no plain file"),
    "a device": (
        lambda f: ((f / FILES[0]).unlink(), (f / FILES[0]).symlink_to("/dev/zero")),
        "inside the survey",
    ),
    "giant chunk": (
        lambda f: (f / FILES[0]).write_bytes((f / FILES[0]).read_bytes()[:40].ljust(3000, b"\xff")),
        FILES[0],
    ),
    "NaN pose": (
        lambda f: (f / "poses.csv").write_text((f / "poses.csv").read_text().replace("1.1", "nan")),
        "poses.csv row 3 x_m='nan'",
    ),
    "infinite pose": (
        lambda f: (f / "poses.csv").write_text(
            (f / "poses.csv").read_text().replace("1.1", "1e999")
        ),
        "poses.csv row 3 x_m='1e999'",
    ),
    "path up": (
        lambda f: (f / "poses.csv").write_text(
            (f / "poses.csv").read_text().replace(FILES[0], "../../etc/passwd")
        ),
        "a path inside the survey's folder",
    ),
    "path with a zero": (
        lambda f: (f / "poses.csv").write_text(
            (f / "poses.csv").read_text().replace(FILES[0], "a\0b")
        ),
        "poses.csv",
    ),
}


@pytest.mark.parametrize("kind", HOSTILE)
def test_a_hostile_survey_is_refused_at_once(kind: str, folder: Path) -> None:
    attack, said = HOSTILE[kind]
    attack(folder)
    began = time.process_time()
    assert said in refusal(folder)
    assert time.process_time() - began < 2.0
