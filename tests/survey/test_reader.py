"""The survey format: what is written is read back, and a recording is what it should be."""

from dataclasses import replace

import numpy as np
import pytest
import soundfile
from hypothesis import given, settings
from hypothesis import strategies as st

from by_hand import ARRAY, CONDITIONS, FILES, POSES, PROBE, ROOM, SAMPLES, edit
from echolearn.acoustics.rooms import outline
from echolearn.checks import BadValue
from echolearn.survey.audio import wav_bytes
from echolearn.survey.direct_path import delayed
from echolearn.survey.reader import read_survey


def refusal(folder):
    """Return the one line with which the survey is refused."""
    with pytest.raises(BadValue) as refused:
        read_survey(folder).observe([0, 1])
    assert str(refused.value).isprintable()
    return str(refused.value)


def test_what_is_written_is_read_back(folder):
    survey = read_survey(folder)
    assert np.array_equal(survey.probe.samples, PROBE.samples)
    assert (survey.probe.sample_rate, survey.probe.length) == (22050.0, 400)
    assert np.array_equal(survey.array.positions, ARRAY.positions)
    assert (survey.files, survey.numbers) == (FILES, (0, 1))
    for found, pose in zip(survey.poses, POSES, strict=True):
        assert (*found.position, found.heading) == (*pose.position, pose.heading)
    assert np.array_equal(survey.walls, outline(ROOM))
    assert survey.conditions == CONDITIONS
    observation = survey.observe([1, 0])
    assert observation.samples.dtype == np.float64
    assert np.array_equal(observation.samples, SAMPLES[[1, 0]])
    assert observation.speed_of_sound == survey.speed_of_sound == 340.0


def test_poses_are_called_what_the_table_calls_them(folder):
    """As nanoseconds since 1970, not in order."""
    rows = f"{2**60},1,2,1.5,0,{FILES[1]}\n7,1,2,1.5,0,{FILES[0]}\n"
    (folder / "poses.csv").write_text(f"index,x_m,y_m,z_m,heading_rad,file\n{rows}")
    survey = read_survey(folder)
    assert survey.numbers == (2**60, 7)
    assert np.array_equal(survey.observe([1]).samples[0], SAMPLES[0])


def test_recordings_may_be_flac(folder):
    """The same walk, one recording packed without loss; what was float32 has then 24 bits."""
    quiet = SAMPLES[1] / 8
    soundfile.write(folder / "observations" / "1.flac", quiet.T, 22050, subtype="PCM_24")
    path = folder / "poses.csv"
    path.write_text(path.read_text().replace("1.wav", "1.flac"))
    found = read_survey(folder).observe([0, 1]).samples
    assert np.array_equal(found[0], SAMPLES[0])
    assert np.abs(found[1] - quiet).max() <= 2**-23


@pytest.mark.parametrize(
    "conditions", [None, {"snr_db": None, "sdnr_db": -3, "pings": 4, "a": "b"}]
)
def test_what_is_not_known_may_be_null(folder, conditions):
    edit(folder, walls=None, conditions=conditions)
    survey = read_survey(folder)
    assert survey.walls is None and survey.conditions == (conditions or {})


def test_a_loudspeaker_elsewhere_moves_the_microphones(folder):
    """An array is told relative to its loudspeaker."""
    edit(folder, loudspeaker=[0.1, -0.2, 0.3])
    assert np.allclose(read_survey(folder).array.positions, ARRAY.positions - [0.1, -0.2, 0.3])


# ---------------------------------------------------------------- recordings


@pytest.mark.parametrize(
    ("name", "samples", "message"),
    [
        (FILES[1], SAMPLES[0, :2], "=(2, 400): must be 3 channels of 400 samples"),
        (FILES[0], SAMPLES[0, :, :399], "=(3, 399): must be 3 channels of 400 samples"),
        (FILES[0], 0 * SAMPLES[0], "=silence: must be a recording; was the recorder running?"),
        (FILES[1], SAMPLES[0] * [[np.inf], [1], [1]], "=NaN or infinity: must be finite samples"),
        ("probe.wav", np.full(400, np.nan), "=NaN or infinity: must be finite samples"),
        ("probe.wav", np.zeros(400), "=silence: must be the burst that was emitted"),
        ("probe.wav", np.ones((2, 400)), "=2 channels: must be the one channel that the loudspeak"),
        ("probe.wav", np.ones(2**20 + 1), "=1048577 samples: must be at most 1048576"),
        ("noise.wav", np.ones((2, 1000)), "=(2, 1000): must be 3 channels of at least 400 samples"),
        ("noise.wav", np.ones((3, 399)), "=(3, 399): must be 3 channels of at least 400 samples"),
        ("noise.wav", np.full((3, 1000), np.nan), "=NaN or infinity: must be finite samples"),
    ],
)
def test_samples_that_do_not_fit_are_refused(folder, name, samples, message):
    (folder / name).write_bytes(wav_bytes(samples, 22050.0))
    assert refusal(folder).startswith(f"{folder / name}{message}")


@pytest.mark.parametrize("name", [FILES[0], "noise.wav"])
def test_a_recording_at_another_rate_is_refused(folder, name):
    (folder / name).write_bytes(wav_bytes(SAMPLES[0], 44100.0))
    message = " sample_rate=44100 Hz: must be 22050 Hz; resample the recording, unless "
    assert refusal(folder) == f"{folder / name}{message}survey.yaml is wrong"


@pytest.mark.parametrize("name", ["survey.yaml", "probe.wav", "poses.csv", FILES[0]])
def test_a_missing_file_is_named(folder, name):
    (folder / name).unlink()
    assert refusal(folder).startswith(f"{folder / name}: cannot be read")


@given(
    st.lists(st.tuples(st.integers(0, 80), st.integers(0, 255)), min_size=1, max_size=4),
    st.integers(0, 4000),
)
@settings(max_examples=150)
def test_a_damaged_header_is_an_error_or_a_recording(folder, bytes_, cut):
    """Whatever the first bytes are, and wherever the file ends, no parser's traceback is seen."""
    content = bytearray(wav_bytes(SAMPLES[0], 22050.0))
    for place, value in bytes_:
        content[place] = value
    (folder / FILES[0]).write_bytes(bytes(content[: len(content) - cut if cut % 2 else None]))
    try:
        assert read_survey(folder).observe([0]).samples.shape == (1, 3, 400)
    except BadValue as refused:
        assert str(refused).startswith(f"{folder / FILES[0]}") and str(refused).isprintable()


def test_noise_alone_may_be_longer_than_a_recording_and_may_be_absent(folder):
    assert list(read_survey(folder).noise()) == []
    noise = np.random.default_rng(1).standard_normal((3, 1000)).astype(np.float32)
    (folder / "noise.wav").write_bytes(wav_bytes(noise, 22050.0))
    [read] = read_survey(folder).noise()
    assert np.array_equal(read, noise)


def test_noise_in_pieces_is_all_of_it_and_measured_as_a_whole(folder, monkeypatch):
    noise = np.random.default_rng(2).standard_normal((3, 100_000)).astype(np.float32)
    (folder / "noise.wav").write_bytes(wav_bytes(noise, 22050.0))
    psd, covariance = read_survey(folder).noise_statistics
    monkeypatch.setattr("echolearn.survey.survey.SAMPLES", 90_000)
    pieces = [*read_survey(folder).noise()]
    assert [piece.shape[1] for piece in pieces] == [33333, 33333, 33334]
    assert np.array_equal(np.concatenate(pieces, axis=1), noise)
    found = read_survey(folder).noise_statistics
    # Frames begin elsewhere, so that single bins differ by chance.
    assert np.allclose(found[0].mean(axis=1), psd.mean(axis=1), rtol=0.01)
    assert np.allclose(found[0], psd, rtol=0.3) and np.allclose(found[1], covariance, atol=0.3)
    assert np.allclose(np.einsum("fmm->mf", found[1]), found[0])


# ---------------------------------------------------------------- the direct path


def coloured():
    """Return the direct path of a loudspeaker that rings, shape (3, 400)."""
    arrived = delayed(PROBE, ARRAY, speed_of_sound=340.0)
    rung = np.apply_along_axis(np.convolve, 1, arrived, 0.8 ** np.arange(30))[:, :200]
    return np.pad(rung, ((0, 0), (0, 200)))


@pytest.mark.parametrize("length", [200, 400, 900])
def test_a_direct_path_that_was_recorded_is_removed_whatever_the_loudspeaker(folder, length):
    """Recorded through other gains than on the walk, cut or padded; geometry would leave half."""
    gains, path = np.array([[3.0], [0.5], [-2.0]]), coloured()
    for name, samples in zip(FILES, SAMPLES, strict=True):
        (folder / name).write_bytes(wav_bytes(gains * path + 1e-3 * samples, 22050.0))
    edit(folder, direct_path="present")
    fitted = replace(read_survey(folder), direct="fitted").observe([0, 1]).samples
    alone = np.pad(0.25 * path, ((0, 0), (0, 500)))[:, :length]
    (folder / "calibration.wav").write_bytes(wav_bytes(alone, 22050.0))
    left = read_survey(folder).observe([0, 1]).samples
    assert np.mean((left - 1e-3 * SAMPLES) ** 2) < 0.01 * np.mean((1e-3 * SAMPLES) ** 2)
    assert np.mean(fitted**2) > 1e4 * np.mean(left**2)


@pytest.mark.parametrize(
    ("samples", "direct_path", "message"),
    [
        (np.ones((2, 400)), "present", "=(2, 400): must be 3 channels of at least 1 samples"),
        (np.full((3, 400), np.inf), "present", "=NaN or infinity: must be finite samples"),
        (
            np.eye(3, 400)[:, ::-1] * [[1], [0], [0]],
            "present",
            " channels=[2, 3]: must hold the di",
        ),
        (np.ones((3, 400)), "removed", " direct_path=removed: must be present; there is none to"),
    ],
)
def test_a_calibration_that_does_not_fit_is_refused(folder, samples, direct_path, message):
    edit(folder, direct_path=direct_path)
    (folder / "calibration.wav").write_bytes(wav_bytes(samples, 22050.0))
    assert refusal(folder).startswith(f"{folder}/calibration.wav{message}")


@pytest.mark.parametrize("name", ["noise.wav", "calibration.wav"])
def test_what_may_be_beside_the_recordings_is_no_link(folder, name):
    (folder / name).symlink_to("/dev/zero")
    assert refusal(folder) == f"{folder / name}=a link: must be a path inside the survey's folder"


def test_the_path_of_another_machine_is_answered_by_what_lies_here(folder):
    path = folder / "poses.csv"
    text = path.read_text()
    allowed = "must be a path inside the survey's folder"
    for name, hint in (("0.wav", "; is it observations/0.wav?"), ("9.wav", "")):
        path.write_text(text.replace(FILES[0], f"/home/pi/walk/{name}"))
        named = f"{path} file=/home/pi/walk/{name}"
        assert refusal(folder) == f"{named}: {allowed}{hint}"
