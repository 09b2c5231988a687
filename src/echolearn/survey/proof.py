"""Is a survey still what it was when it was made?

One that `echolearn survey` wrote has a manifest, and is proved byte for byte before a map is made
of it. One that a
robot left has none: its recordings can be read or not, but a flipped bit in a sample cannot be told
    from noise. Whoever
wants to know can write a manifest with `seal`.
"""

from pathlib import Path

from echolearn.checks import BadValue, check
from echolearn.storage import files as disk
from echolearn.storage import manifests
from echolearn.survey import audio, reader
from echolearn.survey.reader import LIMITS, Survey

OTHER = 1 << 20
"""Bytes that a file of a survey may have which no map depends on."""

CHANGED = f"if you changed the survey on purpose, remove its {manifests.MANIFEST}"


def used(survey: Survey) -> list[str]:
    """Return the names of the files that a map depends on."""
    extras = [
        name for name in (reader.NOISE, reader.CALIBRATION) if (survey.folder / name).exists()
    ]
    return ["survey.yaml", "probe.wav", "poses.csv", *extras, *dict.fromkeys(survey.files)]


def read(folder: Path) -> tuple[Survey, int]:
    """Read a survey, proved by its manifest first, and return it with the number of files that were
    proved.

    Raises:
        BadValue: as `prove_manifest` and `recording.read`, or a file in use that the manifest does
            not name.
    """
    entries = prove_manifest(folder)
    survey = reader.read(folder)
    for name in used(survey) if entries else ():
        check(
            name in entries,
            f"{folder / name}",
            "unknown",
            allowed=f"files that {manifests.MANIFEST} names",
            hint=CHANGED,
        )
    return survey, len(entries)


def prove_manifest(folder: Path) -> frozenset[str]:
    """Prove a survey by its manifest, and return the files that it names; none if there is no
    manifest.

    Raises:
        BadValue: a file that is not as the manifest says; names the file.
    """
    place = folder / manifests.MANIFEST
    if not place.exists():
        return frozenset()
    try:
        manifest = manifests.load_manifest(folder, largest=manifests.FOREIGN)
    except BadValue as error:
        raise BadValue(f"{error}; {CHANGED}") from None
    entries, mend = manifest["files"], f"{CHANGED}; else {manifests.repair_hint(manifest)}"
    check(
        manifest.get("kind") == "survey",
        f"{place} kind",
        manifest.get("kind"),
        allowed="survey",
        hint=CHANGED,
    )
    check(
        "survey.yaml" in entries,
        f"{folder / 'survey.yaml'}",
        "unknown",
        allowed=f"files that {manifests.MANIFEST} names",
    )
    for name, entry in entries.items():
        limit = _limit(name)
        check(
            entry["bytes"] <= limit,
            f"{place} {name}",
            f"{entry['bytes']} bytes",
            allowed=f"at most {limit}",
        )
        disk.check_file(folder / name, size=entry["bytes"], expected=entry["sha256"], mend=mend)
    return frozenset(entries)


def seal(folder: Path) -> int:
    """Write the manifest of a survey that has none, all of which is read first; return how many
    files it names.

    Raises:
        BadValue: there is one, or the survey cannot be read, or not once it has a manifest.
    """
    check(
        not (folder / manifests.MANIFEST).exists(),
        "survey",
        folder,
        allowed=f"one without {manifests.MANIFEST}",
    )
    survey = reader.read(folder)
    _hear(survey)
    names = used(survey)
    for name in names:
        audio.check_size(folder / name, _limit(name))
    manifests.finish(folder, {"kind": "survey"}, names, largest=manifests.FOREIGN)
    return len(names)


def verify(folder: Path) -> str:
    """Prove a survey by its manifest, read every recording of it, and say what there is.

    Raises:
        BadValue: as `read` and `Survey.observe`.
    """
    survey, files = read(folder)
    _hear(survey)
    told = f"readable, {len(survey.poses)} recordings"
    return (
        f"whole, {files} files; {told}"
        if files
        else f"{told}; there is no {manifests.MANIFEST} to prove them by"
    )


def _hear(survey: Survey) -> None:
    """Read every recording of a survey, one at a time, and what is beside them."""
    for pose in range(len(survey.poses)):
        survey.observe([pose])
    survey.noise()


def _limit(name: str) -> int:
    """Return the bytes that a file of this name may have."""
    return LIMITS.get(name, LIMITS.get(Path(name).suffix.lower(), OTHER))
