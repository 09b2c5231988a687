"""What recordings say of themselves: sound walks are left alone, each kind of fault is mended or
refused, with its number."""

import re
from dataclasses import replace

import numpy as np
import pytest

from by_hand import edit
from echolearn.acoustics.types import Pose
from echolearn.checks import BadValue
from echolearn.simulation.walk import trajectory
from echolearn.survey import audio
from echolearn.survey.examining import examine
from echolearn.survey.health import mended
from echolearn.survey.mending import taken_off
from echolearn.survey.reader import read_survey
from recorded_walks import ARRAY, PROBE, ROOM, SCENE, TIME, walk, write
from sound_walks import examined


def late(*samples):
    """Return the change that delays recordings by so many samples, one after the other."""

    def change(walk):
        lags = np.resize(samples, len(walk))
        return np.stack([taken_off(each, -lag) for each, lag in zip(walk, lags, strict=True)])

    return change


def at(microphone, change, *, recordings=slice(None)):
    """Return the change of one microphone's samples (P, N), in some recordings."""

    def changed(walk):
        walk = walk.copy()
        walk[recordings, microphone - 1] = change(walk[recordings, microphone - 1])
        return walk

    return changed


def swapped(first, second, recordings):
    """Return the change that exchanges two microphones in some recordings."""

    def change(walk):
        walk = walk.copy()
        pair = [first - 1, second - 1]
        walk[recordings, pair] = walk[recordings, pair[::-1]]
        return walk

    return change


def leaking(gain, *, alone=False):
    """Return the change that lets microphone 2 leak into microphone 3, or be all it has."""
    mixing = np.eye(6)
    mixing[2, 1] = gain
    mixing[2, 2] = 0.0 if alone else 1.0
    return lambda walk: mixing @ walk


def stretch(walk, recording, *, start, put):
    """Return recordings with 256 samples of one of them replaced."""
    walk = walk.copy()
    walk[recording, :, start : start + 256] = put
    return walk


def dropped(count, at, recordings):
    """Return the change that loses so many samples from some recordings, silence at their end."""

    def change(walk):
        rest = walk[recordings, :, at + count :]
        walk = walk.copy()
        walk[recordings, :, at:] = np.pad(rest, ((0, 0), (0, 0), (0, count)))
        return walk

    return change


def hum(level, *hertz):
    """Return tones of so many times the walk's rms, the second and others softer, shape (N,)."""
    rms = walk(direct=False).std()
    heights = np.array([1.0, 0.3, 0.1])[: len(hertz)]
    tones = np.sin(2 * np.pi * np.outer(hertz, TIME) + 1.0)
    return level * np.sqrt(2) * rms * (heights @ tones)


def clipped(walk):
    limit = walk[..., :1500].std()
    return np.clip(walk, -limit, limit)


def burst(lag):
    return taken_off(np.pad(PROBE.samples, (0, PROBE.length - len(PROBE.samples))), -lag)


def hiss(walk):
    return walk.std() * np.random.default_rng(9).standard_normal(walk.shape)


MENDED = {
    "one sample late": (True, late(1), "arrives 1.0 samples .* later than geometry says; taken"),
    "3200 samples late": (True, late(3200), "arrives 3200.0 samples .145 ms. later"),
    "late by a part of a sample": (True, late(0.5), "arrives 0.5 samples"),
    "ever differently late": (True, late(0, 31, 7, 220), "arrives .* to 220.0 samples .9.98 ms"),
    "a buffer lost before it": (True, late(700, 700, 444), "arrives 444.0 samples .* to 700.0"),
    "the burst's beginning lost": (True, late(0, 0, -256), "arrives -256.0 samples"),
    "all turned": (True, lambda x: -x, "all 6 microphones wired the other way; turned"),
    "all turned on the way": (
        True,
        lambda x: x * np.where(np.arange(8) < 5, 1, -1)[:, None, None],
        "all 6 microphones wired the other way in recordings 5, 6, 7; turned",
    ),
    "one turned on the way": (
        True,
        at(2, lambda x: -x, recordings=slice(4, None)),
        "microphone 2 wired the other way in recordings 4, 5, 6, 7; turned",
    ),
    "three of six, removed": (
        False,
        lambda x: x * np.array([1, 1, -1, -1, 1, -1])[:, None],
        "microphones 3, 4, 6 wired the other way; turned",
    ),
    "one turned": (True, at(3, lambda x: -x), "microphone 3 wired the other way; turned"),
    "one turned, removed": (False, at(3, lambda x: -x), "microphone 3 wired the other way"),
    "offset": (False, lambda x: x + 0.3, "offset up to 0.3 at all 6 microphones in all 8 rec"),
    "offset of one": (False, at(2, lambda x: x - 0.1), "offset up to 0.1.* at microphone 2 in"),
    "small offset": (False, lambda x: x + 0.4 * x.std(), "offset up to .* at all 6 microphones"),
    "hum": (False, lambda x: x + hum(1.0, 50.0), r"hum of the mains \+0 dB over the rest in all"),
    "loud hum": (True, lambda x: x + hum(3.0, 60, 180, 300), "hum of the mains"),
    "hum near 50 Hz": (False, lambda x: x + hum(5.0, 49.9, 99.8), r"hum of the mains \+1. dB"),
    "hum of one": (False, at(5, lambda x: x + hum(3.0, 50.0)), "hum of the mains"),
}
"""Faults that are mended: whether the direct path is present, what is done, and what is said."""

REFUSED = {
    "one channel late": (
        True,
        at(4, late(1)),
        "direct path at microphone 4=1.0 samples .0.0455 ms. off in all 8 recordings",
    ),
    "one channel slips": (
        True,
        at(4, late(64), recordings=slice(4, None)),
        "direct path at microphone 4=64.0 samples .2.9 ms. off in recordings 4, 5, 6, 7: must be",
    ),
    "no direct path": (
        True,
        lambda x: x - SCENE.direct,
        "direct path at .*=none where geometry puts it in recordings .*is it removed already",
    ),
    "no direct path once": (
        True,
        lambda x: x - SCENE.direct * (np.arange(8) == 6)[:, None, None],
        "direct path missing in recording 6: must be there",
    ),
    "zeros": (
        False,
        lambda x: stretch(x, 3, start=700, put=0.0),
        "lost samples=256 equal ones in a row at all 6 microphones in recording 3: must be sound",
    ),
    "zeros without their mean": (
        False,
        lambda x: stretch(x, 3, start=700, put=0.0) - 0.01,
        "lost samples=256 equal ones in a row at all 6 microphones in recording 3: must be sound",
    ),
    "a buffer of one twice": (
        True,
        at(2, lambda x: stretch(x[:, None], 7, start=512, put=x[7, 256:512])[:, 0]),
        "repeated samples=256 in recording 7: must be sound",
    ),
    "a buffer twice": (
        True,
        lambda x: stretch(x, 7, start=512, put=x[7, :, 256:512]),
        "repeated samples=256 in recording 7: must be sound",
    ),
    "lost within the direct path": (
        True,
        dropped(128, 700, slice(5, 6)),
        "lost within the direct path=128 samples in recording 5: the burst must arrive as a whole",
    ),
    "lost near its end, always": (
        True,
        dropped(1024, 1300, slice(None)),
        "lost within the direct path=parts of the burst in all 8 recordings",
    ),
    "overflowed": (
        True,
        lambda x: (1.3 / np.abs(x).max() * x + 1) % 2 - 1,
        "overflowed=.* samples at .* in .*recordings.*: must stay within the range",
    ),
    "a recording copied": (
        False,
        lambda x: x[[0, 1, 2, 3, 4, 2, 6, 7]],
        r"equal samples at all 6 microphones=recordings 2, 5 .observations/2.wav, observations/5.w",
    ),
    "a channel copied": (
        True,
        lambda x: np.where(np.eye(8, 6, -3, dtype=bool)[..., None], x[6, 0], x),
        "equal samples at microphone 1=recordings 3, 6 .observations/3.wav, observations/6.wav.: m",
    ),
    "dead": (
        False,
        at(3, lambda x: 0 * x),
        r"dead channels=microphone 3 in all 8 recordings: must hear .* without=\[3\] maps",
    ),
    "dead but for hum": (False, at(3, lambda x: 0 * x + hum(2, 50)), "dead channels=microphone 3"),
    "nothing but its own noise": (True, at(3, hiss), "dead channels=microphone 3"),
    "dead ones change": (
        False,
        lambda x: x * (np.arange(6) != np.arange(8)[:, None] % 2)[..., None],
        "dead channels=microphones 1, 2 in all 8 recordings, .*do channels change places",
    ),
    "clipped": (False, clipped, "clipped=.* % of a burst at all 6 microphones in all 8 rec.*gain"),
    "clipped once": (
        True,
        lambda x: np.where(np.arange(8)[:, None, None] == 4, clipped(x[4]), x),
        "clipped=.* at all 6 microphones in recording 4: must be at most 1 %",
    ),
    "too soft": (
        False,
        lambda x: np.round(x / x.std() * 0.6) * 2.0**-15,
        "too soft=[2-6] steps of the converter .* at .* in .*: must be 16 or more; record with mor",
    ),
    "doubled": (
        True,
        lambda x: x[:, [0, 1, 1, 3, 4, 5]],
        "doubled channels=microphones 2, 3 correlate 1.000 in all 8 recordings: must be different",
    ),
    "doubled, softer": (
        False,
        lambda x: x[:, [0, 1, 1, 3, 4, 5]] * np.array([1, 1, 0.5, 1, 1, 1])[:, None],
        "doubled channels=microphones 2, 3",
    ),
    "crosstalk": (
        False,
        leaking(0.3),
        "crosstalk=-1. dB between microphones 2, 3 in the median recording: must be below -24 dB",
    ),
    "crosstalk alone": (False, leaking(0.02, alone=True), "doubled channels=microphones 2, 3"),
    "loopback": (
        False,
        at(6, lambda x: np.tile(burst(0), (len(x), 1))),
        r"loopback=microphone 6 holds the burst as it was emitted.* without=\[6\] maps",
    ),
    "loopback, present": (
        True,
        at(6, lambda x: np.tile(0.5 * burst(40), (len(x), 1))),
        "loopback=microphone 6 holds the burst",
    ),
}
"""Faults that are refused, likewise."""


@pytest.mark.parametrize("direct", [True, False])
@pytest.mark.parametrize("snr_db", [40.0, 20.0, 0.0, -10.0, -20.0])
def test_sound_walks_are_left_alone(direct, snr_db, tmp_path):
    """However noisy they are."""
    survey = write(tmp_path / "walk", walk(direct=direct, snr_db=snr_db), direct=direct)
    health = examine(survey)
    assert (health.refused, health.mended, health.noticed) == ((), (), ())
    assert health.mending is None and set(health.verdicts) == {"fine"}
    assert mended(survey, health).observe([0]).samples.tobytes() == (
        survey.observe([0]).samples.tobytes()
    )
    if direct and snr_db >= -10:
        assert np.abs(health.latency_samples).max() < 0.3
        assert "in time" in health.time_zero
    elif not direct:
        assert "on trust" in health.time_zero and np.isnan(health.latency_samples).all()


@pytest.mark.parametrize("fault", MENDED)
def test_what_is_mended_is_as_if_it_had_never_been(fault, tmp_path):
    direct, change, said = MENDED[fault]
    healthy = walk(direct=direct)
    survey = write(tmp_path / "faulty", change(healthy), direct=direct)
    health = examine(survey)
    assert not health.refused
    [line] = health.mended
    assert re.search(said, line), line
    wanted = write(tmp_path / "sound", healthy, direct=direct).observe(range(8)).samples
    found = mended(survey, health).observe(range(8)).samples
    # What was lost at either end is nobody's echo.
    error = (found - wanted)[..., 300:4000].std()
    assert error < 0.2 * wanted[..., 300:4000].std()


@pytest.mark.parametrize("fault", REFUSED)
def test_what_cannot_be_mended_is_refused_with_its_number(fault, tmp_path):
    direct, change, said = REFUSED[fault]
    survey = write(tmp_path / "faulty", change(walk(direct=direct)), direct=direct)
    health = examine(survey)
    with pytest.raises(BadValue, match=f"^{survey.folder}: {said}"):
        mended(survey, health)


@pytest.mark.parametrize(
    ("pair", "recordings", "direct", "snr_db"),
    [
        ((2, 3), slice(12, None), False, 20),
        ((1, 4), slice(24), True, 20),
        ((5, 6), slice(24), False, 10),
    ],
)
def test_exchanged_microphones_are_found_along_a_walk(pair, recordings, direct, snr_db, tmp_path):
    """Also neighbours, and those that were exchanged on the way."""
    poses = trajectory(ROOM, poses=24)
    plain = walk(direct=direct, snr_db=snr_db, poses=24)
    survey = write(tmp_path, swapped(*pair, recordings)(plain), direct=direct, poses=poses)
    [line] = examine(survey).refused
    named = "changed places=microphones {}, {} in recordings ".format(*pair)
    assert line.startswith(named) and "were plugs exchanged?" in line


@pytest.mark.parametrize(
    ("direct", "change", "keys", "said"),
    [
        (
            True,
            late(3),
            {"direct_path": "removed"},
            "would, 3.0 samples late, in all 8 recordings:",
        ),
        (
            False,
            at(3, lambda x: 0.1 * x, recordings=slice(4, None)),
            {},
            "the level of microphone 3 changes by -20 dB against the others on the way: was a gain",
        ),
        (
            False,
            lambda x: x * np.where(np.arange(8) == 3, 100, 1)[:, None, None],
            {},
            "the level of recording 3 is 40 dB above the others': is it stored in another way",
        ),
        (
            True,
            lambda x: x * np.where(np.arange(8) == 3, 0.01, 1)[:, None, None],
            {},
            "the level of recording 3 is 40 dB below the others': was the probe played",
        ),
        (True, lambda x: x, {"microphones": (100 * ARRAY.positions).tolist()}, "=40 m apart: must"),
        (
            False,
            lambda x: x,
            {"walls": [[0, 0], [800, 0], [800, 600], [0, 600]]},
            "walls=800 m apar",
        ),
    ],
)
def test_what_seems_wrong_is_noticed(direct, change, keys, said, tmp_path):
    survey = write(tmp_path / "walk", change(walk(direct=direct)), direct=direct)
    edit(survey.folder, **keys)
    assert said in "".join(examine(read_survey(survey.folder)).noticed)


def test_poses_that_stand_still_while_echoes_move_are_noticed(tmp_path):
    """Degrees of latitude, say; whoever stands still hears the same walls again."""
    for name, sound in (
        ("moves", walk(direct=False, poses=24)),
        ("still", np.repeat(walk(direct=False)[:1], 24, 0)),
    ):
        noise = sound.std() / 10 * np.random.default_rng(3).standard_normal(sound.shape)
        poses = [Pose(np.array([48.1, 11.5 + 1e-6 * step, 1.2])) for step in range(24)]
        survey = write(tmp_path / name, sound + noise, direct=False, poses=poses)
        said = "".join(examine(survey).noticed)
        assert ("are x_m and y_m filled in" in said) == (name == "moves")
    edit(tmp_path / "moves", map=False)
    assert examine(read_survey(tmp_path / "moves")).noticed == ()


def test_a_gain_that_follows_the_sound_hides_no_direct_path(tmp_path):
    """Softer by 30 dB than in the others, it is where it always is."""
    gains = 10 ** (np.array([0, 0, -30, 0, -20, 0, -6, 0]) / 20)
    survey = write(tmp_path / "walk", gains[:, None, None] * walk(direct=True), direct=True)
    assert examine(survey).refused == ()


def test_where_noise_hides_the_direct_path_nothing_is_refused(tmp_path):
    survey = write(tmp_path / "walk", walk(direct=True, snr_db=-40), direct=True)
    health = examine(survey)
    assert "not measurable at this SNR" in health.time_zero
    assert not health.refused and np.isnan(health.latency_samples).mean() > 0.9


def test_echoes_that_are_mostly_negative_are_told(tmp_path):
    """Without a direct path it may be walls that turn them."""
    health = examine(write(tmp_path / "walk", -walk(direct=False), direct=False))
    [line] = health.noticed
    assert line.startswith("the strongest echo is negative in 100 % of 8 recordings; localizer.sig")
    assert health.negative_echoes == 1.0 and not health.refused and not health.mended


@pytest.mark.parametrize("moved", [[0.05, 0.02, 0.0], [-0.03, 0.0, 0.0]])
def test_a_loudspeaker_that_is_elsewhere_is_not_called_a_microphone(moved, tmp_path):
    """Where one loudspeaker explains all microphones; one microphone alone no loudspeaker does."""
    survey = write(tmp_path / "walk", walk(direct=True), direct=True)
    edit(survey.folder, loudspeaker=moved)
    [line] = examine(read_survey(survey.folder)).refused
    found = re.search(
        r"fit with loudspeaker moved by \[(.*)\] m; is it where survey.yaml has", line
    )
    assert [float(each) for each in found[1].split(", ")] == pytest.approx(
        -np.array(moved), abs=0.005
    )
    positions = ARRAY.positions.copy()
    positions[2, 0] += 0.05
    edit(survey.folder, loudspeaker=[0.0, 0.0, 0.0], microphones=positions.tolist())
    [line] = examine(read_survey(survey.folder)).refused
    assert line.startswith("direct path at microphone 3=") and "or a position wrong?" in line


def test_how_to_map_without_microphone_1_is_said(tmp_path):
    survey = write(tmp_path / "walk", at(1, lambda x: 0 * x)(walk(direct=True)), direct=True)
    [line] = examine(survey).refused
    assert line.endswith("maps with the others, by a bundle whose localizer is joint or em")


def test_a_sign_that_changes_from_recording_to_recording_is_told(tmp_path):
    sign = np.where(np.arange(24) % 3 == 0, -1, 1)[:, None, None]
    poses = trajectory(ROOM, poses=24)
    sound = sign * walk(direct=False, poses=24)
    [line] = examine(write(tmp_path / "walk", sound, direct=False, poses=poses)).noticed
    assert line.startswith("the strongest echo is negative in 33 % of 24 recordings; localizer.si")


@pytest.mark.parametrize(("direct", "below"), [(False, 38), (False, 45), (True, 40), (True, 50)])
def test_a_soft_microphone_is_told_and_mended_by_gains_only(direct, below, tmp_path):
    """From recording to recording its level goes up and down about 40 dB, where others are dead."""
    softer = np.where(np.arange(6) == 2, 10 ** (-below / 20), 1.0)[:, None]
    survey = write(tmp_path / "walk", softer * walk(direct=direct), direct=direct)
    health = examine(survey)
    [line] = health.noticed
    assert re.match(rf"microphone 3 is {below}(\.\d)? dB below the others; gains=\[1,1,", line)
    assert not health.refused and health.mending is None
    gains = np.array([1, 1, 10 ** (below / 20), 1, 1, 1])
    assert examine(replace(survey, gains=gains)).noticed == ()


def test_a_soft_microphone_with_a_loose_plug_is_dead_at_times(tmp_path):
    samples = walk(direct=False) * np.where(np.arange(6) == 2, 0.01, 1.0)[:, None]
    samples[2, 2] *= 1e-3
    health = examine(write(tmp_path / "walk", samples, direct=False))
    assert health.refused[0].startswith("dead channels=microphone 3 in recording 2, not in the oth")


def test_a_microphone_that_is_left_out_is_not_judged(tmp_path):
    survey = write(tmp_path / "walk", at(3, lambda x: 0 * x)(walk(direct=True)), direct=True)
    without = replace(survey, gains=np.array([1.0, 1, 0, 1, 1, 1]))
    health = examine(without)
    assert not health.refused and health.verdicts[2] == "left out"


def calibrated(survey, lag):
    """Return a survey with a calibration that is twice as late as its recordings."""
    recorded = audio.wav_bytes(taken_off(SCENE.direct, -2 * lag), PROBE.sample_rate)
    (survey.folder / "calibration.wav").write_bytes(recorded)
    return read_survey(survey.folder)


def test_the_calibration_may_be_late_by_itself(tmp_path):
    wanted, survey = (
        calibrated(write(tmp_path / str(lag), late(lag)(walk(direct=True)), direct=True), lag)
        for lag in (0, 5)
    )
    health = examine(survey)
    assert [line.split(" samples")[0] for line in health.mended] == [
        "the direct path arrives 5.0",
        "calibration.wav begins 10.0",
    ]
    found = mended(survey, health).observe([0]).samples
    assert np.allclose(found[..., :4000], wanted.observe([0]).samples[..., :4000], atol=1e-4)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda y: np.random.default_rng(1).standard_normal(y.shape), "calibration.wav=not seen"),
        (lambda y: y[:, ::-1], "calibration.wav=not seen"),
        (lambda y: np.where(np.arange(6)[:, None] == 2, np.roll(y, 9), y), "microphone 3=9.0 samp"),
    ],
)
def test_a_calibration_without_the_direct_path_is_refused(change, said, tmp_path):
    survey = calibrated(write(tmp_path / "walk", walk(direct=True), direct=True), 0)
    recorded = audio.wav_bytes(change(SCENE.direct), PROBE.sample_rate)
    (survey.folder / "calibration.wav").write_bytes(recorded)
    health = examine(read_survey(survey.folder))
    [line] = health.refused
    assert said in line


def beside(folder, recorded):
    """Return a sound survey with this calibration, (M, K)."""
    survey = write(folder, walk(direct=True), direct=True)
    content = audio.wav_bytes(recorded, PROBE.sample_rate)
    (survey.folder / "calibration.wav").write_bytes(content)
    return read_survey(survey.folder)


def test_offset_and_hum_of_a_calibration_are_mended(tmp_path):
    """The walk itself does not hum: a calibration is made outdoors, and by other means."""
    wanted = beside(tmp_path / "sound", SCENE.direct)
    loud = 2 * SCENE.direct.std() * np.sin(2 * np.pi * 50 * TIME)
    shifted = 0.3 * SCENE.direct.std() * np.eye(6)[1][:, None]
    survey = beside(tmp_path / "hums", SCENE.direct + loud + shifted)
    assert not examine(wanted).mended
    health = examine(survey)
    assert [line.split(" ")[:2] for line in health.mended] == [
        ["calibration.wav:", "offset"],
        ["calibration.wav:", "hum"],
    ]
    wrong, found, sound = (
        each.observe([0]).samples for each in (survey, mended(survey, health), wanted)
    )
    assert np.std(wrong - sound) > sound.std()
    # What is fitted takes a little of the burst itself.
    assert np.std(found - sound) < 0.05 * np.std(wrong - sound)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (clipped, "calibration.wav clipped="),
        (lambda _: walk(direct=True)[3], "calibration.wav=recording 3: must be a recording of its"),
    ],
)
def test_a_calibration_that_is_clipped_or_a_recording_of_the_walk_is_refused(
    change, said, tmp_path
):
    [line] = examine(beside(tmp_path / "walk", change(SCENE.direct))).refused
    assert line.startswith(said)


def test_a_calibration_may_lack_the_microphone_that_is_left_out(tmp_path):
    deaf = (np.arange(6) != 2)[:, None]
    survey = beside(tmp_path / "walk", SCENE.direct * deaf)
    with pytest.raises(BadValue, match=r"calibration.wav channels=\[3\]: must hold"):
        examine(survey)
    without = replace(survey, gains=deaf[:, 0].astype(float))
    assert not examine(without).refused
    assert np.isfinite(without.observe([0]).samples).all()


def test_clocks_that_drift_are_measured(tmp_path):
    """A player that is one in a thousand faster is heard so."""
    places = np.arange(PROBE.length) * (1 + 1e-3)
    played = [[np.interp(places, np.arange(PROBE.length), x) for x in y] for y in walk(direct=True)]
    health = examine(write(tmp_path / "walk", np.array(played), direct=True))
    assert health.clock_drift_ppm == pytest.approx(-1000, abs=150)
    assert not health.refused


def test_levels_are_those_of_the_probe(tmp_path):
    """Offset and hum are 20 dB louder, and change neither level nor noise."""
    quiet = walk(direct=False)
    plain = examine(write(tmp_path / "plain", quiet, direct=False))
    loud = examine(write(tmp_path / "loud", quiet + hum(10.0, 50) + 0.2, direct=False))
    assert np.allclose(loud.level_db, plain.level_db, atol=0.2)
    assert np.allclose(loud.noise_db, plain.noise_db, atol=0.5)
    assert loud.hum_hz == pytest.approx(50, abs=0.1) and loud.hum_db.max() == pytest.approx(
        20, abs=1
    )


def test_the_burst_as_the_loudspeaker_plays_it_is_told(tmp_path):
    survey = write(tmp_path / "walk", walk(direct=True), direct=True)
    [line] = examine(replace(survey, played="walk")).mended
    assert line.startswith("played=walk: echoes are sought by the burst as the loudspeaker plays")
    assert re.search(r"of 8 recordings; .* holds (9\d|100) % of the energy", line)
    assert not examine(survey).mended


@pytest.mark.parametrize("seed", [6000, 6001])
def test_under_rotors_that_drown_the_burst_nothing_is_called_lost(seed):
    """Noise that is not white disturbs some pieces of the direct path more than others."""
    assert examined(seed, snr_db=-20.0, rotors=True, direct=True).refused == ()
