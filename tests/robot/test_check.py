"""What `check` says of a survey: a screen of text, and a page that holds everything itself."""

import re
import subprocess
import sys
from base64 import b64decode
from functools import partial
from html.parser import HTMLParser
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from by_hand import edit
from echolearn.acoustics.geometry import SearchWindow, circular_array, microphone_positions
from echolearn.acoustics.rooms import outline, true_echoes
from echolearn.acoustics.sides import closed, first_echoes
from echolearn.acoustics.signals import noise_probe
from echolearn.acoustics.types import Pose, Room
from echolearn.checks import BadValue
from echolearn.cli.main import main
from echolearn.robot.check import check_survey
from echolearn.robot.png import LEVELS, palette, png_bytes
from echolearn.robot.shipped import FOLDER
from echolearn.robot.waterfall import waterfall
from echolearn.simulation.noise.white import White
from echolearn.simulation.rir.images import Images
from echolearn.simulation.scene import Scene
from echolearn.survey.audio import wav_bytes
from echolearn.survey.description import description_bytes
from echolearn.survey.examining import examine
from echolearn.survey.poses import poses_csv
from echolearn.survey.reader import read_survey

ROOM = Room((6.0, 5.0, 4.0), 0.2)
SCENE = Scene(circular_array(), noise_probe(length=4000), Images(), White())
WALK = [Pose(np.array([1.2 + 0.2 * step, 1.3, 2.0]), 0.1 * step) for step in range(9)]
FIRST, LAST = SearchWindow().lags(SCENE.array, SCENE.probe.sample_rate)
MICROPHONE_2 = np.eye(6)[1][:, None]
FAULTS = {
    "sound": (lambda x: x, 0, "map would take it as it is", "  1     fine  "),
    "late": (lambda x: np.roll(x, 64, axis=-1), 0, "64.0 samples", "+64.0  +2.90  "),
    "inverted": (lambda x: -x, 0, "wired the other way", "mended: sign  "),
    "offset": (lambda x: x + 0.1 * MICROPHONE_2, 0, "offset", "mended: offset  "),
    "dead": (lambda x: x * (1 - 0.9999 * MICROPHONE_2), 1, "without=[2]", "  2     dead  "),
    "clipped": (lambda x: np.clip(x, -0.05, 0.05), 1, "record with less gain", "clipped  "),
}
"""What is done to recordings (P, M, N), the status, what is said of it, and a part of a row."""

VOID = {"img", "input", "meta"}


@pytest.fixture(scope="module")
def recordings():
    """Return what the walk hears, the direct path among it, at 15 dB: shape (P, M, N)."""
    heard = np.array([SCENE.received(ROOM, pose) for pose in WALK])
    noise = np.random.default_rng(0).standard_normal(heard.shape)
    return 0.05 * (heard / heard.std() + 10 ** (-15 / 20) * noise)


@pytest.fixture
def folder(recordings, tmp_path):
    """Return the walk as a survey whose direct path is present."""
    rate = SCENE.probe.sample_rate
    place = tmp_path / "walk"
    (place / "observations").mkdir(parents=True)
    text = description_bytes(
        SCENE.array, SCENE.probe, speed_of_sound=343.0, walls=outline(ROOM), conditions={}
    )
    (place / "survey.yaml").write_bytes(text)
    edit(place, direct_path="present")
    silence = SCENE.probe.length - len(SCENE.probe.samples)
    (place / "probe.wav").write_bytes(wav_bytes(np.pad(SCENE.probe.samples, (0, silence)), rate))
    names = [f"observations/{number}.wav" for number in range(len(WALK))]
    (place / "poses.csv").write_bytes(poses_csv(WALK, names))
    record(place, recordings)
    return place


def record(folder, recordings):
    """Write the recordings of the walk, samples (P, M, N)."""
    for number, samples in enumerate(recordings):
        content = wav_bytes(samples, SCENE.probe.sample_rate)
        (folder / f"observations/{number}.wav").write_bytes(content)


@pytest.fixture
def checked(folder, tmp_path):
    """Return `check_survey` of the walk."""
    return partial(check_survey, survey=folder, runs=tmp_path / "runs")


@pytest.mark.parametrize("name", FAULTS)
def test_sound_recordings_and_faulty_ones(name, folder, recordings, tmp_path, capsys):
    fault, status, line, row = FAULTS[name]
    record(folder, fault(recordings))
    assert main(["check", f"survey={folder}", f"runs={tmp_path}"]) == status
    said = capsys.readouterr()
    assert line in said.out and row in said.out
    assert ("would refuse it" in said.err) == bool(status)
    text = (tmp_path / "check" / "walk" / "check.html").read_text()
    assert line in text and ("wired the other way" in text) == (name == "inverted")


def test_a_sign_that_comes_and_goes_is_shown_as_both(folder, recordings, capsys):
    """And the level is that of all recordings, not their sum's."""
    turned = recordings.copy()
    turned[::2] *= -1
    record(folder, turned)
    assert main(["check", f"survey={folder}", f"runs={folder.parent}"]) == 0
    rows = re.findall(r"mended: sign .* (\S+) +([+-]\d\.\d) +-\d+ ", capsys.readouterr().out)
    assert len(rows) == 6
    assert all(sign == "+/-" and abs(float(level)) < 1 for sign, level in rows)


def test_recordings_without_a_pose_are_counted(folder, recordings, capsys):
    extra = folder / "observations/99.wav"
    for said in ("9 recordings\n", "9 recordings; 1 more without a pose, as '99.wav'\n"):
        assert main(["check", f"survey={folder}", f"runs={folder.parent}"]) == 0
        assert said in capsys.readouterr().out
        extra.write_bytes((folder / "observations/0.wav").read_bytes())


def test_noise_alone_is_told_to_hold_no_echo(folder, recordings, capsys):
    edit(folder, direct_path="removed")
    noise = np.random.default_rng(5).standard_normal(recordings.shape)
    record(folder, 0.01 * noise)
    assert main(["check", f"survey={folder}", f"runs={folder.parent}"]) == 0
    assert "no echo stands out of the noise: was the probe played?" in capsys.readouterr().out


class Balance(HTMLParser):
    """Elements that are open; every one must be closed by its own end."""

    def __init__(self):
        super().__init__()
        self.open = []

    def handle_starttag(self, tag, attrs):
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        """It ends where it begins."""

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_the_page_needs_nothing_else_and_every_element_is_closed(checked):
    made = checked()
    text = made.read_text()
    names = sorted(path.name for path in made.parent.iterdir())
    assert made.parent.name == "walk" and names == ["check.html", "manifest.json"]
    assert not re.search(r'(src|href)="(?!data:)|url\(|@import|<script', text)
    balance = Balance()
    balance.feed(text)
    assert balance.open == []
    # Twelve leave no gap in two, three or four columns; on a phone cells carry their names.
    assert text.count("<dt>") == 12
    assert text.count('<td data-name="level, dB">') == len(SCENE.array)
    assert all('alt="' in image for image in re.findall("<img [^>]*>", text))
    assert main(["verify", str(made.parent)]) == 0


def test_its_images_are_the_waterfall_of_array_and_microphones(checked, folder):
    text = checked().read_text()
    images = [
        np.asarray(Image.open(BytesIO(b64decode(found))))
        for found in re.findall(r"data:image/png;base64,([\w+/=]+)", text)
    ]
    survey = read_survey(folder)
    fall = waterfall(survey, examine(survey), window=SearchWindow())
    assert len(images) == 1 + len(SCENE.array)
    for image, drawn in zip(images, fall.images, strict=True):
        assert np.array_equal(image, drawn)


def test_the_waterfall_is_brightest_where_the_direct_path_and_the_echoes_are(folder):
    survey = read_survey(folder)
    fall = waterfall(survey, examine(survey), window=SearchWindow())
    array, *alone = fall.images
    for drawn, microphone in [(array, 0), *zip(alone, range(6), strict=True)]:
        lag = np.arange(drawn.shape[1]) * fall.lags / drawn.shape[1]
        before = drawn[:, lag < FIRST].argmax(axis=1)
        assert np.abs(lag[before] - fall.direct[microphone]).max() <= 3
        # The wall at y = 0 is the nearest at every pose.
        echo = fall.echoes[:, microphone, 0]
        near = np.abs(lag - echo[:, None]) <= 3
        within = np.where(near, drawn, 0).max(axis=1)
        assert np.all(within >= np.quantile(drawn[:, lag >= FIRST], 0.9, axis=1))
        assert within.mean() > 2.0 * drawn[:, lag >= FIRST].mean() + 5


def test_more_poses_than_pixels_lose_no_line(folder, monkeypatch):
    survey = read_survey(folder)
    whole = waterfall(survey, examine(survey), window=SearchWindow()).images[0]
    monkeypatch.setattr("echolearn.robot.waterfall.SIZE", (3, 50))
    small = waterfall(survey, examine(survey), window=SearchWindow()).images[0]
    assert small.shape == (3, 50)
    starts = np.arange(50) * whole.shape[1] // 50
    columns = np.maximum.reduceat(whole, starts, axis=1)
    assert np.array_equal(small, columns.reshape(3, 3, 50).max(axis=1))


def test_without_walls_and_direct_path_nothing_is_drawn_of_them(checked, folder):
    drawn = ['class="direct"', 'class="echo"']
    assert [kind in checked().read_text() for kind in drawn] == [True, True]
    edit(folder, walls=None, direct_path="removed")
    assert [kind in checked().read_text() for kind in drawn] == [False, False]


@pytest.mark.parametrize("heading", [0.0, 2.0])
def test_first_echoes_are_those_of_mirror_sources(heading):
    pose = Pose(np.array([2.0, 1.5, 1.2]), heading)
    microphones = microphone_positions(SCENE.array, pose)
    ways = first_echoes(outline(ROOM), pose.position, microphones=microphones)
    truth = true_echoes(ROOM, pose, array=SCENE.array)
    # Walls go round the outline; the truth has x = 0, x = max, y = 0, y = max.
    assert ways[0, [3, 1, 0, 2]] == pytest.approx(truth.toa[:4] * 343.0)
    assert ways.shape == (6, 4)


def test_a_wall_that_ends_before_the_sound_meets_it_sends_none_back():
    corner = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [2.0, 2.0], [2.0, 4.0], [0.0, 4.0]])
    place = np.array([1.0, 3.0, 1.0])
    heard = np.isfinite(first_echoes(closed(corner), place, microphones=place[None])[0])
    assert heard.tolist() == [True, False, False, True, True, True]


def test_a_png_is_what_others_read():
    levels = np.arange(LEVELS * 3).reshape(3, LEVELS) % LEVELS
    image = Image.open(BytesIO(png_bytes(levels)))
    assert image.size == (LEVELS, 3)
    assert np.array_equal(np.asarray(image.convert("RGB")), palette()[levels])
    # Read in grey, more is lighter.
    assert np.all(np.diff(np.asarray(image.convert("L"))[0].astype(int)) > 0)


def test_what_is_in_the_way_is_kept(checked, tmp_path):
    place = tmp_path / "runs" / "check" / "walk"
    place.mkdir(parents=True)
    (place / "thesis.tex").write_text("mine")
    with pytest.raises(BadValue, match="name=walk: must be a new name, or that of a check"):
        checked()
    assert [path.name for path in place.iterdir()] == ["thesis.tex"]


def test_a_folder_whose_name_names_no_page_is_told_how_to_name_it(checked, folder):
    hidden = folder.rename(folder.parent / ".walk")
    with pytest.raises(BadValue, match="name=.walk: .*; it is that of the survey's folder; name="):
        checked(survey=hidden)
    assert checked(survey=hidden, name="walk").is_file()


def test_a_survey_s_name_is_no_markup(checked, folder):
    odd = folder.rename(folder.parent / "<b>&walk")
    text = checked(survey=odd, name="odd").read_text()
    assert "<b>&walk" not in text and "&lt;b&gt;&amp;walk" in text


def test_it_ends_with_1_where_map_would_refuse(folder, packed, tmp_path, capsys):
    words = [f"survey={folder}", f"runs={tmp_path}", f"bundle={packed}"]
    edit(folder, microphones=(0.9 * SCENE.array.positions).tolist())
    assert main(["map", *words]) == 1
    refusal = capsys.readouterr().err.strip().removeprefix("error: ")
    assert main(["check", *words]) == 1
    said = capsys.readouterr()
    assert f"refused: {refusal}" in said.out and "would refuse it" in said.err
    assert said.err.count("\n") == said.err.count(str(folder)) == 1
    assert "must be at most 1 mm" in (tmp_path / "check" / "walk" / "check.html").read_text()


def test_it_asks_for_the_bundle_that_map_would_take_or_for_none(folder, tmp_path, capsys):
    edit(folder, microphones=(0.9 * SCENE.array.positions).tolist())
    words = [f"survey={folder}", f"runs={tmp_path}"]
    assert main(["map", *words]) == 1
    refusal = capsys.readouterr().err.strip().removeprefix("error: ")
    assert main(["check", *words]) == 1
    said = capsys.readouterr()
    assert f"refused: {refusal}" in said.out and "point was made for 6 microphones" in refusal
    assert said.err.endswith("; bundle=null asks about the recordings alone\n")
    # What recordings say of another array is another matter.
    assert main(["check", *words, "bundle=null"]) == 0
    assert capsys.readouterr().out.startswith("map would take it, mended\n")


def test_reverberation_until_the_end_is_told_to_count_as_noise(folder, recordings, capsys):
    """Without any noise, in recordings that end while the room rings."""
    heard = np.array([SCENE.received(Room(ROOM.size, 1.5), pose) for pose in WALK])
    record(folder, 0.05 * heard / heard.std())
    main(["check", f"survey={folder}", f"runs={folder.parent}"])
    said = capsys.readouterr().out
    [level] = re.findall(
        r"SNR, at least +(-?\d+) dB  over the quietest eighth of a recording", said
    )
    assert int(level) < 10 and "of a recording, reverberation and all;" in said


ALONE = """
import sys
gone = "hydra omegaconf onnxruntime torch sklearn onnx matplotlib jinja2 soundfile rich rosbags"
sys.modules.update(dict.fromkeys(gone.split()))
from echolearn.cli.main import main
sys.exit(main(sys.argv[1:]))
"""


def test_it_runs_where_only_numpy_scipy_and_yaml_are(folder, checked, tmp_path):
    words = ["check", f"survey={folder}", "runs=alone"]
    run = subprocess.run(
        [sys.executable, "-c", ALONE, *words], capture_output=True, text=True, cwd=tmp_path
    )
    assert (run.returncode, run.stderr) == (0, "")
    assert run.stdout.endswith("alone/check/walk/check.html\n")
    alone = tmp_path / "alone" / "check" / "walk" / "check.html"
    assert alone.read_bytes() == checked(bundle=FOLDER / "point").read_bytes()
