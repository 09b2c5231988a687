"""Surveys as an enemy or a bad disk would leave them: `SURVEYS`, what is done to a copy and what
the refusal says."""

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.io import wavfile

from bundle_mutants import Mutate, cut, flip, huge, swap
from echolearn.storage import manifests
from echolearn.storage.files import json_bytes
from echolearn.survey import proof, reader

FIRST, SECOND = "observations/0000.wav", "observations/0001.wav"
FILES = ("survey.yaml", "probe.wav", "poses.csv", "simulated.json", SECOND, "manifest.json")
SURVEYS: dict[str, tuple[Mutate, str]] = {}
"""What is done to a copy of a survey of three poses, and what the refusal of a map says."""


def bare(change: Callable[[Path], object], *, sealed: bool = False) -> Mutate:
    """Return the mutation of a survey without a manifest, as a robot leaves it, or with one that
    fits the change."""

    def mutate(folder: Path) -> None:
        (folder / "manifest.json").unlink()
        change(folder)
        if sealed:
            manifests.finish(folder, {"kind": "survey"}, proof.used(reader.read_survey(folder)))

    return mutate


class Plain(yaml.SafeDumper):
    """Writes equal lists out instead of naming the first."""

    def ignore_aliases(self, data: object) -> bool:
        return True


def told(said: str, **changes: Any) -> tuple[Mutate, str]:
    """Return the mutation that changes keys of `survey.yaml`; ... removes one."""

    def change(folder: Path) -> None:
        path = folder / "survey.yaml"
        about = yaml.safe_load(path.read_text()) | changes
        path.write_text(
            yaml.dump(
                {key: value for key, value in about.items() if value is not ...}, Dumper=Plain
            )
        )

    return bare(change), said


def text(said: str, content: str | bytes) -> tuple[Mutate, str]:
    """Return the mutation that writes another `survey.yaml`."""
    data = content if isinstance(content, bytes) else content.encode()
    return bare(lambda folder: (folder / "survey.yaml").write_bytes(data)), said


def added(said: str, more: str) -> tuple[Mutate, str]:
    """Return the mutation that adds lines to `survey.yaml`."""
    return bare(
        lambda folder: (folder / "survey.yaml").write_text(
            (folder / "survey.yaml").read_text() + more
        )
    ), said


def poses(said: str, old: str, new: str) -> tuple[Mutate, str]:
    """Return the mutation that replaces a text in `poses.csv`."""

    def change(folder: Path) -> None:
        before = (folder / "poses.csv").read_text()
        assert old in before
        (folder / "poses.csv").write_bytes(before.replace(old, new, 1).encode())

    return bare(change), said


def header(name: str, place: int, value: int, size: int) -> Mutate:
    """Return the mutation that overwrites a number in the header of a WAV file."""

    def change(folder: Path) -> None:
        data = (folder / name).read_bytes()
        (folder / name).write_bytes(
            data[:place] + value.to_bytes(size, "little") + data[place + size :]
        )

    return bare(change)


def samples(name: str, change: Callable[[Any], Any], rate: int = 22050) -> Mutate:
    """Return the mutation that changes the samples (N, M) of a WAV file."""
    return bare(
        lambda folder: wavfile.write(folder / name, rate, change(wavfile.read(folder / name)[1]))
    )


def spoilt(value: float) -> Callable[[Any], Any]:
    """Return a function that puts a value among samples."""

    def change(held: Any) -> Any:
        held = held.copy()
        held.flat[7] = value
        return held

    return change


def data(name: str, make: Callable[[bytes], bytes]) -> Mutate:
    """Return the mutation that rewrites the bytes of a file."""
    return bare(lambda folder: (folder / name).write_bytes(make((folder / name).read_bytes())))


def replaced(name: str, put: Callable[[Path], object]) -> Mutate:
    """Return the mutation that puts something else in a file's place."""

    def change(folder: Path) -> None:
        (folder / name).rename(folder.parent / "outside")
        put(folder / name)

    return bare(change)


def manifest(change: Callable[[dict[str, Any]], object]) -> Mutate:
    """Return the mutation that changes the manifest, whose own checksum is made right again."""

    def mutate(folder: Path) -> None:
        about = json.loads((folder / "manifest.json").read_text())
        change(about)
        (folder / "manifest.json").write_bytes(json_bytes(manifests.with_checksum(about)))

    return mutate


def entry(name: str, **changes: Any) -> Mutate:
    """Return the mutation that changes or adds an entry of the manifest."""
    whole = {"bytes": 0, "sha256": "0" * 64}
    return manifest(
        lambda about: about["files"].update({name: about["files"].get(name, whole) | changes})
    )


def listed(name: str, put: Callable[[Path], object]) -> Mutate:
    """Return the mutation that adds something to the folder, and to the manifest as an empty file."""

    def mutate(folder: Path) -> None:
        put(folder / name)
        entry(name)(folder)

    return mutate


def many_rows(folder: Path) -> None:
    """Write a walk of millions of poses at one recording."""
    (folder / "poses.csv").write_text(
        "index,x_m,y_m,z_m,heading_rad,file\n" + f"0,2,2,1,0,{FIRST}\n" * 300_000
    )


for file_ in FILES:
    for place, bit in ((0.0, 0), (0.2, 7), (0.5, 1), (0.77, 4), (1.0, 2)):
        SURVEYS[f"bit {bit} at {place} of {file_}"] = flip(file_, place, bit), ""
    for share in (0.0, 0.5, 0.99):
        SURVEYS[f"{share} of {file_}"] = cut(file_, share), file_
    SURVEYS[f"{file_} a terabyte"] = huge(file_), file_
for file_ in FILES[:-1]:
    SURVEYS[f"{file_} absent"] = (lambda folder, name=file_: (folder / name).unlink()), file_  # type: ignore[misc]
for file_ in (*FILES[:3], SECOND):
    up = "../" * (1 + file_.count("/"))
    SURVEYS[f"{file_} a link out"] = (
        replaced(file_, lambda path, up=up: path.symlink_to(f"{up}outside")), "a path inside the survey's folder"  # type: ignore[misc]
    )  # fmt: skip
    SURVEYS[f"{file_} a device"] = (
        replaced(file_, lambda path: path.symlink_to("/dev/zero")),
        "inside the survey's",
    )
    SURVEYS[f"{file_} a pipe"] = replaced(file_, os.mkfifo), "no plain file"
    SURVEYS[f"{file_} a folder"] = replaced(file_, Path.mkdir), "no plain file"
SURVEYS |= {
    "recordings exchanged": (
        swap(FIRST, SECOND, sealed=False),
        "its SHA-256 differs; if you changed",
    ),
    "probe for recording": (swap(FIRST, "probe.wav", sealed=False), ""),
    "probe for recording, bare": (bare(swap(FIRST, "probe.wav", sealed=False)), ""),
    "poses for description": (bare(swap("poses.csv", "survey.yaml", sealed=False)), "survey.yaml"),
}
for file_ in (SECOND, "probe.wav"):
    for name, (place, value, size) in {
        "no channels": (22, 0, 2),
        "many channels": (22, 65535, 2),
        "another rate": (24, 44100, 4),
        "endless rate": (24, 2**32 - 1, 4),
        "unknown format": (20, 0xFFFF, 2),
        "packed format": (20, 2, 2),
        "no bits": (34, 0, 2),
        "odd bits": (34, 7, 2),
        "many bits": (34, 65535, 2),
        "no frames": (32, 0, 2),
        "giant format": (16, 2**32 - 1, 4),
        "no magic": (0, 0, 4),
        "another order": (3, ord("X"), 1),
    }.items():
        SURVEYS[f"{name} in {file_}"] = header(file_, place, value, size), file_
    for name, change in {
        "NaN": spoilt(np.nan),
        "infinity": spoilt(np.inf),
        "silence": np.zeros_like,
    }.items():
        SURVEYS[f"{name} in {file_}"] = samples(file_, change), file_
    SURVEYS[f"nothing but a header in {file_}"] = data(file_, lambda d: d[:58]), file_
    SURVEYS[f"text in {file_}"] = data(file_, lambda d: b"import os\n" * 40), file_
    SURVEYS[f"64-bit sizes in {file_}"] = (
        data(file_, lambda d: b"RF64" + b"\xff" * 4 + d[8:]),
        file_,
    )
SURVEYS |= {
    "a channel fewer": (samples(SECOND, lambda x: x[:, :5]), f"{SECOND}=(5, 6000): 6 channels of 6000"),
    "a channel more": (samples(SECOND, lambda x: np.pad(x, ((0, 0), (0, 1)))), f"{SECOND}=(7, 6000)"),
    "a sample fewer": (samples(SECOND, lambda x: x[:-1]), f"{SECOND}=(6, 5999)"),
    "a sample more": (samples(SECOND, lambda x: np.pad(x, ((0, 1), (0, 0)))), f"{SECOND}=(6, 6001)"),
    "samples for channels": (samples(SECOND, lambda x: np.ascontiguousarray(x.T)), SECOND),
    "another rate told": (samples(SECOND, lambda x: x, rate=44100), "sample_rate=44100 Hz: 22050 Hz"),
    "a recording of a minute": (samples(SECOND, lambda x: np.tile(x, (220, 1))), "bytes: at most"),
    "a probe of a minute": (samples("probe.wav", lambda x: np.tile(x, 220)), "samples: at most"),
    "another probe": (samples("probe.wav", lambda x: x[::-1].copy()), "probe=correlates"),
    "a probe of two channels": (samples("probe.wav", lambda x: np.stack([0 * x, x], axis=1)), "probe.wav=silence"),
    "no rows": (bare(lambda f: (f / "poses.csv").write_text("index,x_m,y_m,z_m,heading_rad,file\n")), "no rows"),
    "empty poses": (bare(lambda f: (f / "poses.csv").write_text("")), "no rows"),
    "no poses but bytes": (data("poses.csv", lambda d: bytes(range(256)) * 9), "poses.csv"),
    "millions of poses": (bare(many_rows), "poses.csv="),
    "poses without heading": poses("poses.csv=without heading_rad: the columns", "heading_rad", "heading_deg"),
    "poses without file": poses("poses.csv=without file: the columns", ",file", ",path"),
    "a pose of text": poses("poses.csv row 2 x_m='zero': a number", "\n0,", "\n0,zero,1,1,0,a\n0,"),
    "a pose of NaN": poses("poses.csv row 2 x_m='nan': a number", "\n0,", "\n0,nan,1,1,0,a\n0,"),
    "a pose at infinity": poses("poses.csv row 2 x_m='1e999': a number", "\n0,", "\n0,1e999,1,1,0,a\n0,"),
    "a pose in degrees": poses("poses.csv row 2 heading_rad='270'", "\n0,", "\n9,0,1,1,270,a\n0,"),
    "a pose on the moon": poses("poses.csv row 2 x_m='4e8': must be a number from -1", "\n0,", "\n9,4e8,1,1,0,a\n0,"),
    "a short row": poses("poses.csv row 2 z_m=None: a number", "\n0,", "\n0,1,1\n0,"),
    "an endless field": poses("poses.csv: cannot be read", FIRST, "a" * 200_000),
    "a pose without index": poses("index='': whole numbers", "\n0,", "\n,"),
    "a pose called twice": poses("index=1, 2 times: each number once", "\n0,", "\n1,"),
    "a pose called by a fraction": poses("index='0.5': whole numbers", "\n0,", "\n0.5,"),
    "a pose called by a million digits": poses("index='", "\n0,", f"\n{'9' * 10**5},"),
    "no recording": poses("poses.csv row 2 file='': the name", FIRST, ""),
    "a recording that is absent": poses("observations/9.wav: cannot be read as WAV", FIRST, "observations/9.wav"),
    "a recording elsewhere": poses("a path inside the survey's folder", FIRST, "/etc/passwd"),
    "a recording above": poses("a path inside the survey's folder", FIRST, "../../etc/passwd"),
    "a recording around": poses("a path inside the survey's folder", FIRST, "observations/../../outside"),
    "a recording with a zero": poses("poses.csv", FIRST, "a\0b"),
    "a folder for a recording": poses("no plain file", FIRST, "observations"),
    "a description for a recording": poses("survey.yaml", FIRST, "survey.yaml"),
    "no list but a scalar": text("survey.yaml=without", "5"),
    "a list": text("survey.yaml=without", "[1, 2]"),
    "nothing": text("survey.yaml=without", ""),
    "bytes": text("survey.yaml: cannot be read", bytes(range(256))),
    "an object": text("survey.yaml: cannot be read", "!!python/object/apply:os.system ['true']"),
    "a tag": text("survey.yaml: cannot be read", "!evil {a: 1}"),
    "nested brackets": text("survey.yaml: cannot be read", "[" * 100_000),
    "nested lists": text("survey.yaml: cannot be read", "- " * 30_000),
    "an alias": added("survey.yaml: cannot be read (it holds an alias", "a: &a [1]\nb: *a\n"),
    "laughter": added("alias", "l: &l [1,1]\n" + "".join(f"m{k}: &m{k} [*l, *l]\n" for k in range(9))),
    "a number of a thousand digits": added("survey.yaml", f"sample_rate: {'9' * 10**4}\n"),
    "an unfinished text": added("survey.yaml: cannot be read", "walls: 'abc\n"),
    "tabs": added("survey.yaml: cannot be read", "\t\twalls: 1\n"),
    "microphones misspelt": told("key=micorphones: sample_rate", micorphones=[[0.2, 0.0, 0.0]] * 6),
    "a key of a kilobyte": told("key=kkkk", **{"k" * 1000: 1}),
    "a key of another alphabet": added("key='\\x07': sample_rate", '"\\a": 1\n'),
    "a list for a key": added("survey.yaml", "? [1]\n: 1\n"),
    "ten thousand keys": added("key=k0: sample_rate", "".join(f"k{k}: {k}\n" for k in range(9999))),
    "conditions as a list": told("conditions=[1]", conditions=[1]),
    "direct path perhaps": told("direct_path=perhaps: removed or present", direct_path="perhaps"),
    "direct path true": told("direct_path=True", direct_path=True),
    "direct path a list": told("direct_path=[]", direct_path=[]),
    "rate as text": told("sample_rate=fast", sample_rate="fast"),
    "rate 0": told("sample_rate=0", sample_rate=0),
    "rate NaN": told("sample_rate=nan", sample_rate=float("nan")),
    "rate true": told("sample_rate=True", sample_rate=True),
    "rate as a list": told("sample_rate=[22050]", sample_rate=[22050]),
    "rate of another recorder": told("probe.wav sample_rate=22050 Hz: 44100 Hz", sample_rate=44100),
    "speed of light": told("speed_of_sound=300000000.0 m/s", speed_of_sound=3e8),
    "speed of text": told("speed_of_sound=mach", speed_of_sound="mach"),
    "speed in feet per nothing": told("speed_of_sound=-343", speed_of_sound=-343),
    "microphones of text": told("microphones=round", microphones="round"),
    "no microphones": told("microphones=[]", microphones=[]),
    "flat microphones": told("microphones=", microphones=[[0.2, 0.0]] * 6),
    "ragged microphones": told("microphones=", microphones=[[0.2, 0.0, 0.0], [0.1]]),
    "microphones of NaN": told("microphones=", microphones=[[float("nan"), 0.0, 0.0]] * 6),
    "five microphones": told("microphones=5: 6, the bundle's", microphones=[[0.2, 0.0, 0.0]] * 5),
    "ten thousand microphones": told("survey.yaml=", microphones=[[0, 0, 0]] * 9999),
    "microphones elsewhere": told("microphones=one is off by", microphones=[[0.2, k / 50, 0.0] for k in range(6)]),
    "microphones of a mapping": told("microphones=", microphones={"left": [0, 0, 0]}),
    "a flat loudspeaker": told("loudspeaker=[0.0, 0.0]", loudspeaker=[0.0, 0.0]),
    "a loudspeaker of text": told("loudspeaker=here", loudspeaker="here"),
    "a loudspeaker elsewhere": told("microphones=one is off", loudspeaker=[0.1, 0.0, 0.0]),
    "walls of text": told("walls=white", walls="white"),
    "walls of three": told("walls=", walls=[[0.0, 0.0, 0.0]] * 4),
    "walls of two corners": told("walls=2 corners: null, or", walls=[[0.0, 0.0], [1.0, 0.0]]),
    "walls around nothing": told("walls=an area of 0 m^2", walls=[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]),
    "walls around the world": told("walls=4e+07 m", walls=[[0.0, 0.0], [4e7, 0.0], [4e7, 4e7]]),
    "five thousand walls": told("walls=5000 corners", walls=[[k % 99, k // 99] for k in range(5000)]),
    "microphones a kilometre apart": told("microphones=1000 m", microphones=[[k * 200, 0, 0] for k in range(6)]),
    "speed of sound twice": added("key='speed_of_sound', 2 times", "speed_of_sound: 150\n"),
    "walls of infinity": told("walls=", walls=[[0.0, float("inf")]] * 4),
}  # fmt: skip
for key in ("sample_rate", "speed_of_sound", "microphones", "loudspeaker", "direct_path"):
    SURVEYS[f"no {key}"] = told(f"survey.yaml=without {key}", **{key: ...})
SURVEYS |= {
    "manifest of a set": (manifest(lambda about: about.update(kind="set")), "kind=set: survey"),
    "manifest without files": (manifest(lambda about: about.pop("files")), "manifest.json"),
    "manifest of no files": (manifest(lambda about: about["files"].clear()), "survey.yaml=unknown: files that"),
    "manifest of a list": (manifest(lambda about: about.update(files=["survey.yaml"])), "manifest.json files"),
    "manifest without a recording": (manifest(lambda about: about["files"].pop(FIRST)), f"{FIRST}=unknown"),
    "manifest of text": (lambda f: (f / "manifest.json").write_text("whole"), "manifest.json: cannot be read"),  # type: ignore[dict-item,return-value]
    "manifest nested": (lambda f: (f / "manifest.json").write_text("[" * 10**5), "manifest.json: cannot be read"),  # type: ignore[dict-item,return-value]
    "manifest nested, a little": (lambda f: (f / "manifest.json").write_text("[" * 900 + "]" * 900), "manifest.json"),  # type: ignore[dict-item,return-value]
    "manifest of NaN": (lambda f: (f / "manifest.json").write_text('{"files": NaN}'), "manifest.json"),  # type: ignore[dict-item,return-value]
    "manifest of ten megabytes": (manifest(lambda about: about.update(more="x" * 10**7)), "bytes: at most 8388608"),
    "entry elsewhere": (entry("/etc/passwd"), "manifest.json files: must be bytes and sha256 of files inside"),
    "entry above": (entry("../outside"), "manifest.json files"),
    "entry around": (entry("observations/../../outside"), "manifest.json files"),
    "entry with a zero": (entry("a\0b"), "manifest.json files"),
    "entry without a name": (entry(""), "manifest.json files"),
    "entry that is absent": (entry("walls.csv"), "walls.csv: cannot be read"),
    "entry of text": (entry(FIRST, bytes="many"), "manifest.json files"),
    "entry of true": (entry(FIRST, bytes=True), "manifest.json files"),
    "entry of no text": (entry(FIRST, sha256=0), "manifest.json files"),
    "entry of more": (entry(FIRST, code="import os"), "manifest.json files"),
    "entry of a terabyte": (entry(FIRST, bytes=1 << 40), "1099511627776 bytes: at most"),
    "entry of fewer bytes": (entry(FIRST, bytes=1), "damaged, 144058 bytes instead of 1"),
    "entry of another sum": (entry(FIRST, sha256="0" * 64), "its SHA-256 differs"),
    "a listed pipe": (listed("a.wav", os.mkfifo), "no plain file"),
    "a listed device": (listed("a.wav", lambda path: path.symlink_to("/dev/zero")), "no plain file"),
    "a listed folder": (listed("a.wav", Path.mkdir), "no plain file"),
    "NaN, sealed": (bare(lambda f: samples(SECOND, spoilt(np.nan))(_again(f)), sealed=True), f"{SECOND}=NaN"),
    "another recording, sealed": (bare(lambda f: (f / FIRST).unlink(), sealed=False), FIRST),
}  # fmt: skip


def _again(folder: Path) -> Path:
    """Put an empty manifest there for a mutation to take away."""
    (folder / "manifest.json").touch()
    return folder
