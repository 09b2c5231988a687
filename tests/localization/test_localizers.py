"""Every localizer keeps one contract: whatever has a module in `methods` and a YAML is tested."""

import warnings
from dataclasses import fields, replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import yaml

import echolearn.localization.methods
from echolearn.acoustics import signals
from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.types import Echoes, MicArray, Observation
from echolearn.checks import BadValue
from echolearn.localization.localize import localize
from echolearn.localization.matched_filter import MatchedFilter
from echolearn.localization.silence import SilentMicrophone
from echolearn.robot.choices import OF_THE_FIRST
from reference import FIRST, LAST, RATE, RING, observed, turn, wave, white
from refusals import refused

CONFIGS = sorted((Path(__file__).parents[2] / "conf" / "localizer").glob("*.yaml"))
PROBE = signals.noise_probe(burst=400, length=6000)
LONG = signals.noise_probe(length=6000)
LAG = 180
FIELDS = [field.name for field in fields(Echoes)]


def build(name, **changed):
    """Call what a localizer's YAML names with what it says, in the default window."""
    [config] = [path for path in CONFIGS if path.stem == name]
    arguments = yaml.safe_load(config.read_text())
    module, _, kind = arguments.pop("_target_").rpartition(".")
    return getattr(import_module(module), kind)(**arguments | {"window": SearchWindow()} | changed)


NAMES = [path.stem for path in CONFIGS]
WAYS = {name: {} for name in NAMES} | {"gated, mpdr": {"beam": "mpdr"}}
SEVERAL = [name for name in NAMES if "echoes" in vars(build(name))]


@pytest.fixture(params=WAYS)
def localizer(request):
    return build(request.param.partition(",")[0], **WAYS[request.param])


def noisy(azimuth, lag=LAG, *, noise=0.02, gain=0.1):
    return wave(PROBE, azimuth, lag, gain) + white(PROBE, noise)


def same(found, expected, rows=slice(None), **within):
    """Tell whether echoes are those rows of others, bit by bit unless there is a tolerance."""
    equal = np.allclose if within else np.array_equal
    return all(equal(getattr(found, f), getattr(expected, f)[rows], **within) for f in FIELDS)


def test_each_module_has_a_configuration():
    folder = Path(echolearn.localization.methods.__path__[0])
    modules = {path.stem for path in folder.glob("[!_]*.py")}
    assert modules == {type(build(name)).__module__.rpartition(".")[2] for name in NAMES}


# ---------------------------------------------------------------- estimates


def test_fields_have_a_row_per_observation_and_stay_in_their_ranges(localizer):
    silence = np.zeros((6, 6000))
    chance = [white(PROBE, 1.0, seed) for seed in range(8)]
    echoes = localizer(observed(PROBE, noisy(0.5), silence, *chance))
    for field in FIELDS:
        values = getattr(echoes, field)
        assert values.shape == (10, 1)
        assert values.dtype == np.float64
        assert np.isfinite(values).all()
    lag = echoes.toa * RATE
    assert (lag >= FIRST - 1e-9).all() and (lag <= LAST + 1e-9).all()
    assert (np.abs(echoes.score) <= 1.0 + 1e-9).all()
    assert (np.abs(echoes.azimuth) <= np.pi + 1e-12).all()
    assert ((echoes.elevation >= 0) & (echoes.elevation <= np.pi)).all()
    assert (echoes.power >= 0).all()
    assert echoes.gain[1, 0] == echoes.score[1, 0] == 0.0


def test_a_batch_is_its_observations_one_by_one_and_stays_as_it_was(localizer):
    batch = observed(PROBE, noisy(0.5), white(PROBE, 1.0, 1), noisy(-2.0, 130))
    before = batch.samples.copy()
    together = localizer(batch)
    assert same(localizer(batch), together)
    assert np.array_equal(batch.samples, before)
    for row, samples in enumerate(before):
        assert same(localizer(observed(PROBE, samples)), together, [row], rtol=1e-3)


def test_a_view_that_somebody_made_gives_the_same(localizer):
    batch = observed(PROBE, noisy(0.5), white(PROBE, 1.0, 1))
    for azimuths in (180, 36):
        assert same(
            localizer(batch, MatchedFilter(batch, SearchWindow(), azimuths)), localizer(batch)
        )


def test_time_direction_and_gain_are_those_of_the_wave(localizer):
    waves = np.array([[-3.1, 120], [-1.3, 150], [0, 201], [0.8, 260], [2.2, 180]])
    echoes = localizer(observed(PROBE, *(noisy(*one) for one in waves)))
    assert np.allclose(echoes.toa * RATE, waves[:, 1:], atol=0.5)
    assert (np.abs(turn(echoes.azimuth - waves[:, :1])) < np.radians(2.0)).all()
    assert np.allclose(echoes.gain, 0.1, rtol=0.06)


def test_gain_changes_only_what_has_its_unit(localizer):
    echoes = localizer(observed(PROBE, noisy(1.1), 8.0 * noisy(1.1)))
    assert echoes.toa[0] == echoes.toa[1]
    assert echoes.azimuth[0] == echoes.azimuth[1]
    assert echoes.score[0] == pytest.approx(echoes.score[1])
    assert echoes.gain[1] == pytest.approx(8.0 * echoes.gain[0])
    # The power is in the localizer's own unit: that of the recording squared, or none.
    ratio = echoes.power[1] / echoes.power[0]
    assert ratio == pytest.approx(64.0, rel=1e-3) or ratio == pytest.approx(1.0, rel=1e-3)


def test_the_score_says_how_much_is_probe(localizer):
    """Echo and noise of equal power under the probe correlate at sqrt(1/2); a direction off by 1
    degree costs 3 %."""
    clean, even = (wave(LONG, 0.5, LAG) + white(LONG, level) for level in (1e-4, 0.1))
    score = localizer(observed(LONG, clean, even)).score[:, 0]
    assert score[0] == pytest.approx(1.0, abs=0.03)
    assert score[1] == pytest.approx(np.sqrt(0.5), abs=0.06)


def test_another_speed_of_sound_is_another_geometry(localizer):
    """Air scaled with the ring: the same recordings, the same directions."""
    usual = observed(PROBE, noisy(0.7))
    scaled = replace(usual, array=MicArray(2 * RING.positions), speed_of_sound=686.0)
    assert localizer(scaled).azimuth[0, 0] == pytest.approx(
        localizer(usual).azimuth[0, 0], abs=np.radians(0.2)
    )


@pytest.mark.parametrize("dtype", [np.int16, np.uint16, np.float16, np.float32, np.longdouble])
def test_any_real_dtype_gives_the_same_echoes(localizer, dtype):
    """Louder than the root of what an int16 holds, so that its squares would wrap around; uint16
    has an offset."""
    samples = (np.rint(8000 * noisy(0.5)) + 12_000 * (dtype is np.uint16)).astype(dtype)
    expected = localizer(observed(PROBE, samples.astype(float)))
    assert same(localizer(observed(PROBE, samples)), expected)
    assert expected.toa[0, 0] * RATE == pytest.approx(LAG, abs=0.51)


# ---------------------------------------------------------------- several echoes


def pair(*echoes, noise=0.02):
    return sum((wave(PROBE, *one) for one in echoes), white(PROBE, noise))


@pytest.mark.parametrize("kind", SEVERAL)
def test_both_echoes_are_found_the_strongest_first(kind):
    rows = [
        pair((0.5, 180.3, 0.1), (-2.0, 221.6, 0.07)),
        pair((-1.0, 150.8, 0.05), (2.4, 170.2, 0.08)),
    ]
    localizer = build(kind, echoes=2)
    echoes = localizer(observed(PROBE, *rows))
    assert all(getattr(echoes, field).shape == (2, 2) for field in FIELDS)
    assert np.allclose(echoes.toa * RATE, [[180.3, 221.6], [170.2, 150.8]], atol=0.51)
    assert (np.diff(echoes.gain, axis=-1) <= 0).all()
    off = np.abs(turn(echoes.azimuth - [[0.5, -2.0], [2.4, -1.0]])) < np.radians(3)
    assert off[0].all() and off[1, 0]
    # The second peak of a whole recording's beam need not be the second echo.
    assert off[1, 1] or kind not in ("joint", "em", "gated")
    for row, samples in enumerate(rows):
        assert same(localizer(observed(PROBE, samples)), echoes, [row], rtol=1e-3)


@pytest.mark.parametrize("kind", SEVERAL)
def test_more_echoes_than_the_window_holds_are_refused(kind):
    allowed = "must be a whole number from 1 to 31; at most 31 fit into a window of 156"
    with refused(f"localizer.echoes=32: {allowed}"):
        build(kind, echoes=32)(observed(PROBE, noisy(0.5)))


# ---------------------------------------------------------------- what is refused


SOUND = noisy(0.5)
INFINITE = np.where(np.arange(6000) == 5999, np.inf, SOUND)
CLIPPED = np.clip(SOUND, -0.15, np.where(np.arange(6) == 2, 0.15, 9.0)[:, None])
REFUSED = [
    ({"samples": INFINITE[None]}, "samples=NaN or infinity: samples must be finite; is a"),
    ({"samples": CLIPPED[None]}, "samples=microphone 3 of observation 0 clipped at 0.15: samples"),
    ({"samples": SOUND[None, :5]}, "samples=shape (1, 5, 6000): must be (B, 6, N)"),
    ({"samples": SOUND}, "samples=shape (6, 6000): must be (B, 6, N)"),
    ({"sample_rate": 44100.0}, "sample_rate=44100.0 Hz: must be 22050 Hz"),
]


def test_recordings_that_no_estimator_can_use(localizer):
    for changed, message in REFUSED:
        with refused(f"observation.{message}"):
            localizer(replace(observed(PROBE, SOUND), **changed))
    far = replace(localizer, window=SearchWindow(farthest=60.0))
    allowed = "echoes must arrive within the recording of 6000 samples"
    with refused(f"window.farthest=60.0 m: {allowed}"):
        far(observed(PROBE, SOUND))


BAD = {
    "azimuths": ("many", 3, 180.5),
    "echoes": ("many", 0),
    "sign": ("negative",),
    "whiten": ("loud", None, 1),
    "gamma": (2.0,),
    "beam": ("mvdr",),
    "elevations": (0,),
    "iterations": (0,),
    "loading": (-1.0,),
    "false_alarm": (0.0,),
}


@pytest.mark.parametrize("kind", NAMES)
def test_bad_arguments(kind):
    for argument in BAD.keys() & vars(build(kind)):
        for value in BAD[argument]:
            with refused(f"localizer.{argument}={value}"):
                build(kind, **{argument: value})


def test_what_only_the_joint_search_and_the_first_echo_can():
    for changed, message in (
        ({"whiten": "spatial"}, "whiten=spatial: must be true, false; spatial is"),
        ({"elevations": 2, "echoes": 2}, "elevations=2: must be 1 with several echoes"),
        ({"elevations": 3, "azimuths": 3600}, "azimuths=3600: azimuths * elevations must be at"),
    ):
        with refused(f"localizer.{message}"):
            build("snls", **changed)


@pytest.mark.parametrize("kind", ["gated", "joint", "em", "mclam"])
def test_an_array_too_wide_to_be_steered_is_refused(kind):
    wide = observed(PROBE, noisy(0.5), array=MicArray(4 * RING.positions))
    with refused("array.positions=1.60 m: microphones must be within 1.00 m"):
        build(kind)(wide)


# ---------------------------------------------------------------- silent microphones


def needs_first(localizer, batch):
    """Tell whether times come from microphone 1 alone: of ours by name, of yours by what it does
    with a batch in which that one is silent."""
    kind = type(localizer).__name__
    if kind in ("Em", "Gated", "Joint", "Mclam", "Peaks", "Snls"):
        return kind.lower() in OF_THE_FIRST
    try:
        localizer(batch)
    except BadValue:
        return True
    return False


@pytest.mark.filterwarnings("ignore::echolearn.localization.silence.SilentMicrophone")
@pytest.mark.parametrize("microphone", [1, 4])
@pytest.mark.parametrize("fault", ["silent", "stuck", "faint"])
def test_a_silent_microphone_is_told_and_left_out(localizer, fault, microphone):
    samples = np.stack([noisy(0.5), noisy(-2.0)])
    faint = white(PROBE, 1e-4, 5)[0]
    samples[0, microphone - 1] = {"silent": 0.0, "stuck": 0.7, "faint": faint}[fault]
    batch = Observation(samples, PROBE, RING)
    if microphone == 1 and needs_first(localizer, batch):
        with refused("observation.samples=silence at microphone 1: "):
            localizer(batch)
        return
    message = f"microphone {microphone} is silent in 1 of 2 observations and is left out there"
    with pytest.warns(SilentMicrophone, match=message) as warned:
        echoes = localizer(batch)
    assert warned[0].filename == __file__
    assert np.allclose(echoes.toa[:, 0] * RATE, LAG, atol=0.51)
    assert np.allclose(echoes.azimuth[:, 0], [0.5, -2.0], atol=np.radians(4))
    assert np.allclose(echoes.gain[:, 0], 0.1, rtol=0.1)


def test_sound_recordings_are_not_complained_of(localizer):
    """PCM of 16 bits with few levels in use repeats its extremes, and is not clipped."""
    coarse = np.round(noisy(0.5) * 100) / 100
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        localizer(observed(PROBE, noisy(0.5), coarse, 1e-9 * noisy(0.5)))


# ---------------------------------------------------------------- sign


def test_echoes_of_either_sign_are_found_where_they_are_sought(localizer):
    """What is turned comes out as if it were not, beside what is upright."""
    upright = observed(PROBE, noisy(0.5), noisy(-2.0, 201))
    turned = replace(upright, samples=upright.samples * np.array([1.0, -1.0])[:, None, None])
    either = replace(localizer, sign="either")
    assert same(either(turned), localizer(upright))
    assert not same(localizer(turned), localizer(upright))
    expected = localize(upright, localizer)[1]
    columns = localize(turned, either)[1]
    assert all(np.array_equal(columns[name], expected[name]) for name in expected)


# ---------------------------------------------------------------- whitening


def test_whitening_without_a_density_is_refused(localizer):
    white_one = replace(localizer, whiten=True)
    with refused("localizer.whiten=True: needs observation.noise_psd"):
        white_one(observed(PROBE, noisy(0.5)))


def test_a_flat_density_changes_no_estimate(localizer):
    """But that whitened times lie between samples, where the crests of ringing echoes are, and
    gains with them."""
    batch = observed(PROBE, noisy(0.5), noisy(-2.0, 201), noise_psd=np.full(442, 0.02**2))
    plain, flat = localizer(batch), replace(localizer, whiten=True)(batch)
    assert np.allclose(flat.toa, plain.toa, atol=0.51 / RATE)
    assert np.allclose(flat.azimuth, plain.azimuth, atol=np.radians(2.01))
    assert (flat.gain >= 0.98 * plain.gain).all()
    assert (flat.gain <= plain.gain / np.sinc(0.5)).all()


@pytest.mark.parametrize("fault", [0.0, 0.7])
def test_whitening_does_not_wake_a_silent_microphone(localizer, fault):
    samples = noisy(0.5)
    samples[3] = fault
    batch = observed(PROBE, samples, noise_psd=np.linspace(1, 2, 65))
    with pytest.warns(SilentMicrophone, match="microphone 4 is silent"):
        echoes = replace(localizer, whiten=True)(batch)
    assert echoes.toa[0, 0] * RATE == pytest.approx(LAG, abs=0.51)
    assert echoes.azimuth[0, 0] == pytest.approx(0.5, abs=np.radians(4))
