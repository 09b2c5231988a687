"""From the matched filters to echoes: the steps that localizers share.

Times of several echoes come from RELAX, on one microphone or on all; directions from the search
itself, or from the highest peaks of the whole-recording MPDR power. A localizer is made of these
steps and of what is its own.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from echolearn.acoustics.bistatic import upright_elevation
from echolearn.acoustics.geometry import direction
from echolearn.acoustics.types import Array, Echoes
from echolearn.localization import correlations
from echolearn.localization.beamforming import Mpdr, azimuth_grid
from echolearn.localization.matched_filter import MatchedFilter
from echolearn.localization.relax import relax
from echolearn.localization.search import Peak, Search, reference_search
from echolearn.localization.wall_echoes import on_no_axis


def joint_echoes(search: Search, peaks: Sequence[Peak]) -> Echoes:
    """Return R peaks of J as echoes, fields (B, R), the strongest first.

    The score is that of all microphones together, E_m the energy under the aligned probe:
    score = J / (||s|| sqrt(sum_m w_m) sqrt(sum_m w_m E_m)). The power is J^2.
    """
    matched = search.view
    rows = []
    for peak in peaks:
        delays = np.rint(search.delays(peak[:3])).astype(int)
        index = np.clip(delays, 0, matched.last - matched.first)
        energy = np.take_along_axis(matched.energy, index[..., None], axis=-1)[..., 0]
        # The largest J that a recording of that energy could have: Cauchy-Schwarz.
        share = search.share(peak.azimuth, peak.elevation)
        largest = share * (search.weights * energy).sum(axis=-1) * matched.probe_energy
        score = peak.height / np.sqrt(np.where(largest > 0, largest, np.inf))
        rows.append([*peak, np.clip(score, -1.0, 1.0)])
    lag, azimuth, elevation, gain, height, score = _strongest_first(np.stack(rows, axis=-1))
    found = Echoes(matched.toa(lag), score, gain, azimuth, elevation, height**2)
    # An elevation that was sought is left as it was found.
    level = on_no_axis(found) & (search.elevations == 1)
    return from_upright_walls(matched, found, level=level)


def from_upright_walls(matched: MatchedFilter, echoes: Echoes, *, level: Array) -> Echoes:
    """Return echoes with the elevation that upright walls give them.

    An array higher or lower than its loudspeaker sees their mirror sources a little below or above.

    Args:
        matched: recordings.
        echoes: fields (B, R).
        level: which were sought in the level plane alone, shape (B, R), bool.
    """
    array = matched.observation.array
    if array.centre[2] == 0.0:
        return echoes
    speed = matched.observation.speed_of_sound
    seen = upright_elevation(echoes.toa, echoes.azimuth, array=array, speed_of_sound=speed)
    return replace(echoes, elevation=np.where(level, seen, echoes.elevation))


def _strongest_first(columns: Array) -> Array:
    """Return columns of echoes (K, B, R), of which number 3 is the gain, by falling gain."""
    order = np.argsort(-columns[3], axis=-1, kind="stable")
    return np.take_along_axis(columns, order[None], axis=-1)


def echoes_at(matched: MatchedFilter, index: Array) -> Echoes:
    """Return echoes at lag indices (B, R) of microphone 1 (Eq. 11), directions unknown."""
    height = np.take_along_axis(matched.correlation[:, 0], index, axis=-1)
    energy = np.take_along_axis(matched.energy[:, 0], index, axis=-1)
    score = height / np.sqrt(np.maximum(energy * matched.probe_energy, 1e-30))
    return _without_directions(matched.toa(index), score, gain=height / matched.probe_energy)


def _without_directions(toa: Array, score: Array, *, gain: Array) -> Echoes:
    unknown = np.zeros(toa.shape)
    return Echoes(toa, score, gain, unknown, unknown, unknown)


def reference_echoes(matched: MatchedFilter, echoes: int) -> Echoes:
    """Return times, scores and gains of R echoes at microphone 1, directions unknown, (B, R).

    S-NLS on whole samples; with R > 1, or for whitened recordings, RELAX between them.
    """
    if echoes == 1 and not matched.white:
        return echoes_at(matched, matched.strongest[:, None])
    peaks = relax(reference_search(matched), echoes)
    lag, _, _, gain, _ = _strongest_first(np.stack(peaks, axis=-1))
    under = np.take_along_axis(matched.energy[:, 0], np.rint(lag).astype(int), axis=-1)
    score = gain * np.sqrt(matched.probe_energy / np.where(under > 0, under, np.inf))
    return _without_directions(matched.toa(lag), np.clip(score, -1.0, 1.0), gain=gain)


def mpdr_echoes(matched: MatchedFilter, times: Echoes, *, mpdr: Mpdr) -> Echoes:
    """Return echoes (B, R) with the directions of the highest peaks of the whole-recording MPDR.

    Several echoes share the R highest peaks, each direction once.

    Args:
        matched: recordings.
        times: the echoes, directions unknown, fields (B, R).
        mpdr: the beamformer.
    """
    power = mpdr.without(matched.observation, matched.silent)
    best = power.argmax(axis=-1)[:, None]
    echoes = times.toa.shape[-1]
    if echoes > 1:
        best = assign(matched, times.toa, summits=summits(power, echoes))
    azimuth, elevation = mpdr.directions
    found = replace(
        times,
        azimuth=azimuth[best],
        elevation=elevation[best],
        power=np.take_along_axis(power, best, axis=-1).astype(float),
    )
    return from_upright_walls(matched, found, level=found.elevation == np.pi / 2)


def summits(power: Array, count: int) -> Array:
    """Return the indices of the highest local maxima over a circle, from (B, A) to (B, count).

    Where there are fewer, the highest is repeated.
    """
    # A plateau counts once, at its beginning.
    local = (power > np.roll(power, 1, axis=-1)) & (power >= np.roll(power, -1, axis=-1))
    height = np.where(local, power, -np.inf)
    order = np.argsort(-height, axis=-1, kind="stable")[:, :count]
    best = power.argmax(axis=-1)[:, None]
    return np.where(np.isfinite(np.take_along_axis(height, order, axis=-1)), order, best)


def assign(matched: MatchedFilter, toa: Array, *, summits: Array) -> Array:
    """Return which direction each time has, each direction once, indices (B, R).

    The pair with the largest J(tau, phi) is made first, then that of the rest.

    Args:
        matched: recordings.
        toa: times of arrival, shape (B, R), in s.
        summits: directions to choose from, indices of the azimuth grid, shape (B, R).
    """
    azimuth = azimuth_grid(matched.azimuths)[summits]
    eta = matched.eta(direction(azimuth, np.pi / 2))
    steered = correlations.advance(matched.padded, eta).sum(axis=-2)
    index = matched.index(toa)[:, None, :] + correlations.PAD
    alike = np.swapaxes(np.take_along_axis(steered, index, axis=-1), 1, 2)

    rows = np.arange(len(toa))
    chosen = np.zeros(toa.shape, dtype=int)
    for _ in range(toa.shape[-1]):
        best = alike.reshape(len(toa), -1).argmax(axis=-1)
        time, way = np.unravel_index(best, alike.shape[1:])
        chosen[rows, time] = summits[rows, way]
        alike[rows, time, :] = -np.inf
        alike[rows, :, way] = -np.inf
    return chosen
