"""Published measurements as surveys: true times are where the sound is, and a broken copy is
refused in one line."""

import re
import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from by_hand import edit
from echolearn.acoustics.signals import matched_filter, noise_probe
from echolearn.acoustics.types import MicArray, Pose, Truth
from echolearn.checks import BadValue
from echolearn.storage import manifests
from echolearn.survey import audio, imported
from echolearn.survey.examining import examine
from echolearn.survey.measured import Measurements, Response
from echolearn.survey.proof import verify_survey
from echolearn.survey.protocols import Take, moved, recorded_take, takes
from echolearn.survey.reader import read_survey
from echolearn.survey.sources import r3vival
from echolearn.survey.sources.dechorate import INSIDE, Dechorate
from echolearn.survey.sources.r3vival import R3vival, slice_folder
from refusals import refused

RATE = 22050.0
SPEED = 343.0
PROBE = noise_probe(length=3000, burst=400)
SQUARE = np.array([[0.03, 0.0, 0.0], [0.0, 0.04, 0.0], [-0.05, 0.0, 0.0]])
LOUDSPEAKER = np.array([1.2, -1.6, 0.0])
"""2 m away."""

LATE = 0.004
"""s into its file at which the sound of `Points` leaves the loudspeaker."""


def pulses(paths, gains):
    """Return responses (M, K) of echoes with these paths (M, W) in m, band-limited."""
    times = (LATE + paths / SPEED) * RATE
    n = np.arange(1200)
    return np.einsum("w,mwn->mn", gains, np.sinc(n - times[..., None]))


@dataclass(frozen=True)
class Points:
    """A source whose room has two walls, known exactly; it counts how often it is read."""

    budget: int = 10**9

    def read(self, folder):
        """Return one response by images 3.1 and 5.3 m away, beside the direct sound."""
        images = np.array([[3.1, 0.0, 0.0], [0.0, -5.3, 0.0]])
        sources = np.vstack([LOUDSPEAKER, images])
        paths = np.linalg.norm(sources - SQUARE[:, None], axis=-1)
        truth = Truth(paths[0, 1:] / SPEED, np.array([0.0, -np.pi / 2]), np.full(2, np.pi / 2))
        response = Response(
            place="here",
            condition="bare",
            samples=pulses(paths, np.array([1.0, 0.4, 0.3])),
            emitted=LATE,
            loudspeaker=LOUDSPEAKER,
            truth=truth,
            pose=Pose(np.array([1.0, 2.0, 0.5]), 0.3),
        )
        credits = {"title": "points", "licence": "none", "attribution": "a test"}
        return Measurements("points", [response], MicArray(SQUARE), RATE, SPEED, credits)


def imported_points(runs, **changes):
    """Import the two walls."""
    usual = {"name": "points", "source": Points(), "folder": None, "probe": PROBE, "runs": runs}
    return imported.import_survey(**usual | changes)


def contents(folder):
    """Return every file by name."""
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def test_true_echoes_stand_where_the_matched_filter_has_its_crests(tmp_path):
    """In all three recordings, whatever is moved and amplified; the direct sound is gone."""
    survey = read_survey(imported_points(tmp_path, snr_db=None))
    assert not survey.mapped and survey.direct is None and survey.walls is None
    assert survey.further == {
        "place": ("here",) * 3,
        "condition": ("bare",) * 3,
        "start_m": ("0.0", "2.0", "4.0"),
    }
    energy = []
    for pose, (start, truth) in enumerate(zip((0.0, 2.0, 4.0), survey.truth, strict=True)):
        samples = survey.observe([pose]).samples[0, 0]
        crest = np.abs(matched_filter(samples, PROBE, first=0, last=1000)) / PROBE.energy
        assert len(truth.toa) == (1 if start == 4.0 else 2)
        for toa in truth.toa:
            near = slice(round(toa * RATE) - 1, round(toa * RATE) + 2)
            assert crest[near].max() > 0.2
        # The direct sound, 2 m of path after the emission, would be the strongest of all.
        assert crest[: round(2.5 / SPEED * RATE)].max() < 0.2 or start > 0
        energy.append(np.sum(samples**2))
    # Both echoes come after 2 m of path.
    assert energy[1] / energy[0] == pytest.approx((5 / 3) ** 2, rel=0.01)


def test_noise_has_its_level_against_the_direct_sound_at_a_fifth_of_a_metre(tmp_path):
    quiet = read_survey(imported_points(tmp_path, name="quiet", snr_db=None))
    noisy = read_survey(imported_points(tmp_path, name="noisy", snr_db=6.0))
    noise = noisy.observe([1]).samples - quiet.observe([1]).samples
    # One pulse of 1 at each microphone: the burst itself, over all samples, 10 times louder.
    direct = PROBE.energy / PROBE.length * (2.0 / 0.2) ** 2
    assert 10 * np.log10(direct / np.mean(noise**2)) == pytest.approx(6.0, abs=0.3)
    other = read_survey(imported_points(tmp_path, name="other", snr_db=6.0, draw=1))
    another = other.observe([1]).samples - quiet.observe([1]).samples
    assert abs(np.corrcoef(noise.ravel(), another.ravel())[0, 1]) < 0.05


def test_without_a_protocol_the_response_is_as_it_was_and_its_direct_path_can_be_removed(tmp_path):
    survey = read_survey(imported_points(tmp_path, protocol="none", snr_db=None))
    assert survey.direct == "fir" and len(survey.poses) == 1
    assert np.allclose(survey.loudspeakers, [LOUDSPEAKER])
    whole = survey.recording(0)
    rest = survey.observe([0]).samples[0]
    at = round(np.linalg.norm(LOUDSPEAKER - SQUARE[0]) / SPEED * RATE)
    before, after = (
        np.abs(matched_filter(each[0], PROBE, first=at, last=at)).max() / PROBE.energy
        for each in (whole, rest)
    )
    assert before > 0.7 and after < 0.1
    assert len(survey.truth[0].toa) == 2


@pytest.mark.parametrize(("samples", "mapped"), [(0.7, False), (0.7, True), (1.4, False)])
def test_a_microphone_off_by_less_than_a_sample_is_told_where_there_is_no_map(
    tmp_path, samples, mapped
):
    """Its place in the table is wrong by so much, towards the loudspeaker."""
    folder = imported_points(tmp_path, protocol="none", snr_db=None)
    wrong = SQUARE.copy()
    wrong[2] += samples * SPEED / RATE * np.array([0.6, -0.8, 0.0])
    edit(folder, microphones=wrong.tolist(), map=mapped)
    health = examine(read_survey(folder))
    [line] = [each for each in (*health.noticed, *health.refused) if "microphone 3" in each]
    assert re.search(r"microphone 3=-?\d\.\d samples .* off in recording 0: must be within", line)
    told = samples < 1 and not mapped
    assert (line in health.noticed) == told == line.endswith("for times and directions alone")


@given(lag=st.floats(-40.0, 40.0))
def test_what_is_moved_is_what_a_later_pulse_would_have_been(lag):
    n = np.arange(400)
    found = moved(np.sinc(n - 200.0)[None], lag)[0, :360]
    assert np.abs(found - np.sinc(n[:360] - 200.0 - lag)).max() < 0.01


def test_a_take_begins_after_the_echoes_that_it_has_not():
    [response] = Points().read(None).responses
    truth = Take(response, 4.0, gated=True).truth(SPEED)
    assert truth.toa == pytest.approx([(np.linalg.norm([0.03, 5.3]) - 4.0) / SPEED])


def test_poses_without_an_echo_in_the_window_are_left_out_where_a_source_says_so():
    measured = Points().read(None)
    some = replace(measured, within=(2.5, 3.2))
    assert [take.start for take in takes(measured, "pose")] == [0.0, 2.0, 4.0]
    assert [take.start for take in takes(some, "pose")] == [0.0]


# ---------------------------------------------------------------- promises


def test_importing_again_gives_the_same_bytes_and_leaves_them_alone(tmp_path):
    first = imported_points(tmp_path / "a")
    before = {path: path.stat().st_mtime_ns for path in first.rglob("*")}
    assert imported_points(tmp_path / "a") == first
    assert {path: path.stat().st_mtime_ns for path in first.rglob("*")} == before
    assert contents(imported_points(tmp_path / "b")) == contents(first)
    assert verify_survey(first) == "whole, 8 files; readable, 3 recordings"
    for change in ({"snr_db": 9.0}, {"draw": 1}, {"protocol": "none"}):
        with refused("name=points: must be a new name, or that of a survey made with the same"):
            imported_points(tmp_path / "a", **change)
    credits = manifests.load_manifest(first)["made_from"]["credits"]
    assert credits["attribution"] == read_survey(first).conditions["attribution"] == "a test"


def test_an_import_that_was_killed_goes_on(tmp_path, monkeypatch):
    whole = contents(imported_points(tmp_path / "whole"))
    made = []

    def mortal(take, *arguments, **more):
        made.append(take.start)
        if len(made) == 3:
            raise KeyboardInterrupt
        return recorded_take(take, *arguments, **more)

    monkeypatch.setattr(imported, "recorded_take", mortal)
    with pytest.raises(KeyboardInterrupt):
        imported_points(tmp_path / "killed")
    assert not (tmp_path / "killed/survey/points/manifest.json").exists()
    assert contents(imported_points(tmp_path / "killed")) == whole
    assert made == [0.0, 2.0, 4.0, 4.0]


def test_recordings_of_another_origin_are_never_overwritten(tmp_path):
    folder = tmp_path / "survey" / "points"
    folder.mkdir(parents=True)
    (folder / "poses.csv").write_bytes(b"a real robot")
    with refused("name=points: must be a new name, or that of an imported survey"):
        imported_points(tmp_path)


# ---------------------------------------------------------------- R3VIVAL


def test_the_slice_is_a_set_of_thirty_places_three_takes_each():
    measured = R3vival().read(None)
    assert (len(measured.responses), len(measured.array)) == (30, 6)
    assert {response.condition for response in measured.responses} == {"000"}
    assert len(takes(measured, "pose")) == 90
    for response in measured.responses:
        # The direct sound is where the distance says, at each microphone.
        paths = np.linalg.norm(response.loudspeaker - measured.array.positions, axis=1)
        lag = (response.emitted + paths / SPEED) * measured.sample_rate
        peak = np.abs(response.samples).argmax(axis=1)
        assert np.abs(peak - lag).max() < 3.0


def test_true_echoes_of_the_room_obey_the_law_of_reflection():
    """A ray that leaves as it came, by its two legs instead of an image."""
    loudspeaker = r3vival.position("S060-200")
    assert loudspeaker == pytest.approx([1.0, -np.sqrt(3), 0.0])
    truth = r3vival.panel_echoes(loudspeaker)
    microphone = np.array(r3vival.POSITIONS[0])
    wall = r3vival.FACES[2]
    # On the left wall, y = 2.56: the point that divides x as the distances from the wall.
    near, far = wall - microphone[1], wall - loudspeaker[1]
    share = near / (near + far)
    point = microphone + share * (loudspeaker - microphone)
    point[1] = wall
    path = np.linalg.norm(point - microphone) + np.linalg.norm(point - loudspeaker)
    assert truth.toa[2] * SPEED == pytest.approx(path)
    assert len(truth.toa) == 11


@pytest.fixture
def checkout(tmp_path):
    """Return a copy of the slice, as a checkout."""
    return Path(shutil.copytree(slice_folder(), tmp_path / "checkout"))


ONE = "RIRs/FRL_array/RLRVarAcLab_Absorptive_000_S030-150_R1_FRL10cm.wav"


def shifted(path):
    """Return a file with a millisecond of silence before it."""
    samples = audio.read_wav(path, RATE)
    return audio.wav_bytes(np.pad(samples, ((0, 0), (22, 0))), RATE)


def silent(path):
    """Return a file whose second channel is dead."""
    samples = audio.read_wav(path, RATE)
    samples[1] = 0.0
    return audio.wav_bytes(samples, RATE)


BROKEN = {
    "cut": (lambda path: path.read_bytes()[:9000], "cannot be read as WAV"),
    "empty": (lambda path: b"", "cannot be read as WAV"),
    "pointer": (
        lambda path: b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n",
        "=a pointer of Git LFS: must be the file; run git lfs pull",
    ),
    "mono": (
        lambda path: audio.wav_bytes(audio.read_wav(path, RATE)[:1], RATE),
        "=1 channels: must be 6 channels, or 7 with the centre",
    ),
    "shifted": (shifted, "=direct sound at 11.0"),
    "dead": (silent, "=NaN, infinity or silence"),
    "other rate": (
        lambda path: audio.wav_bytes(audio.read_wav(path, RATE).repeat(2, axis=1), 2 * RATE),
        " sample_rate=[22050.0, 44100.0]: must be one for all",
    ),
}


@pytest.mark.parametrize("fault", BROKEN)
def test_a_broken_copy_is_refused_in_one_line(checkout, fault):
    make, message = BROKEN[fault]
    (checkout / ONE).write_bytes(make(checkout / ONE))
    with pytest.raises(BadValue) as caught:
        R3vival(["000"]).read(checkout)
    assert message in str(caught.value) and str(caught.value).isprintable()


def test_what_is_no_checkout_is_told_from_what_is_incomplete(checkout):
    for folder, message in (
        (checkout / "nowhere", "there is no such folder"),
        (checkout.parent, "it has no RIRs/FRL_array"),
    ):
        with pytest.raises(BadValue, match=f"^folder=.* facebookresearch/R3VIVAL; {message}"):
            R3vival().read(folder)
    # A checkout has both conditions, of which the slice has one.
    with pytest.raises(BadValue, match=r"_100_S000-150_.*=missing: must be a file; a partial"):
        R3vival().read(checkout)
    with refused("source.conditions=['100']: must be among those of the slice"):
        R3vival(["100"]).read(None)
    with refused("source.conditions=['../000']: must be states of the panels"):
        R3vival(["../000"])


def test_some_places_of_the_loudspeaker_are_those_that_are_named():
    wanted = ["S030-150", "S210-300"]
    found = R3vival(["000"], places=wanted).read(None).responses
    assert [response.place for response in found] == wanted
    for wrong in ([], ["S031-150"], "S030-150"):
        with refused("source.places="):
            R3vival(places=wrong)


# ---------------------------------------------------------------- dEchorate


def annotated(rng):
    """Return the arrays of a small file like that of the set, its walls at known distances."""
    middles = rng.uniform([1.0, 1.0, 1.0], [4.0, 4.0, 1.5], (6, 3))
    angles = rng.uniform(-np.pi, np.pi, 6)
    half = 0.02 * np.stack([np.cos(angles), np.sin(angles), np.zeros(6)], axis=-1)
    mics = np.concatenate([middles + half, middles - half]).T
    src = np.array([[2.0], [4.5], [1.4]])
    images = np.repeat(src.T, 6, axis=0)
    for wall, (axis, place) in enumerate([(0, 0), (0, 5.7), (1, 0), (1, 6), (2, 0), (2, 2.4)]):
        images[wall, axis] = 2 * place - images[wall, axis]
    return {
        "rirs": rng.standard_normal((2000, 12, 1)),
        "fs": np.array([[48000]]),
        "c": np.array([[345.0]]),
        "mics": mics,
        "src": src,
        "T_direct": np.linalg.norm(mics - src, axis=0)[None] / 345.0,
        "T_reflct": np.linalg.norm(images[:, :, None] - mics, axis=1) / 345.0,
    }


@pytest.fixture
def annotations(tmp_path):
    """Return a checkout with such a file."""
    path = tmp_path / INSIDE
    path.parent.mkdir(parents=True)
    savemat(path, annotated(np.random.default_rng(0)), do_compression=True)
    return tmp_path


def test_pairs_of_microphones_stand_where_they_stood(annotations):
    measured = Dechorate().read(annotations)
    arrays = annotated(np.random.default_rng(0))
    assert len(measured.responses) == 6 and measured.sample_rate == 48000.0
    for pair, response in enumerate(measured.responses):
        cos, sin = np.cos(response.pose.heading), np.sin(response.pose.heading)
        turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
        places = response.pose.position + measured.array.positions @ turn.T
        assert np.allclose(places.T, arrays["mics"][:, [pair, pair + 6]])
        there = response.pose.position + turn @ response.loudspeaker
        assert np.allclose(there, arrays["src"][:, 0])
        assert np.isnan(response.truth.azimuth).all() and len(response.truth.toa) == 6


def test_unknown_directions_are_empty_cells(annotations, tmp_path):
    source = Dechorate()
    folder = imported_points(tmp_path, name="pairs", source=source, folder=annotations)
    survey = read_survey(folder)
    assert all(np.isnan(truth.azimuth).all() for truth in survey.truth)
    assert (folder / "truth.csv").read_text().splitlines()[1].endswith(",,")


@settings(max_examples=40)
@given(share=st.floats(0.0, 0.999), bit=st.integers(0, 7), cut=st.booleans())
def test_a_damaged_file_of_annotations_is_read_or_refused_in_one_line(annotations, share, bit, cut):
    whole = (annotations / INSIDE).read_bytes()
    place = int(share * len(whole))
    broken = bytearray(whole[:place] if cut else whole)
    if not cut:
        broken[place] ^= 1 << bit
    try:
        (annotations / INSIDE).write_bytes(bytes(broken))
        Dechorate().read(annotations)
    except BadValue as error:
        assert str(error).isprintable()
    finally:
        (annotations / INSIDE).write_bytes(whole)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"T_reflct": np.zeros((7, 12))}, r"T_reflct=shape \(7, 12\): must be numbers of shape"),
        ({"c": np.array([["fast"]])}, r"c=shape .*: must be numbers"),
        ({"rirs": np.full((2000, 12, 1), np.nan)}, "rirs=NaN or infinity"),
        ({"T_direct": np.full((1, 12), 0.1)}, "T_direct=.* ms off: must fit the positions"),
    ],
)
def test_annotations_of_another_shape_are_refused(annotations, change, message):
    savemat(annotations / INSIDE, annotated(np.random.default_rng(0)) | change)
    with pytest.raises(BadValue, match=message):
        Dechorate().read(annotations)
    with refused("folder=None: nothing of this source comes with echolearn"):
        Dechorate().read(None)


@dataclass(frozen=True)
class Some:
    """A few places of the slice, two of the microphones exchanged if asked."""

    order: tuple[int, ...] = (0, 1, 2, 3, 4, 5)

    def read(self, folder):
        """Return ten places of the slice."""
        measured = R3vival().read(folder)
        few = [
            replace(each, samples=each.samples[list(self.order)])
            for each in measured.responses[:10]
        ]
        return replace(measured, responses=few)


@pytest.mark.parametrize("order", [(0, 1, 2, 3, 4, 5), (3, 1, 2, 0, 4, 5)])
def test_microphones_at_several_heights_are_told_from_exchanged_ones(order, tmp_path):
    """Echoes of floor and ceiling come slanting to an octahedron, and together."""
    probe = noise_probe(length=4000)
    folder = imported_points(tmp_path, source=Some(order), probe=probe, snr_db=40.0)
    refusals = examine(read_survey(folder)).refused
    assert [line.startswith("changed places=microphones") for line in refusals] == (
        [] if order[0] == 0 else [True]
    )
