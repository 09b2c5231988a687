"""Is a survey still what it was when it was made?

One that `echolearn survey` wrote has a manifest, and is proved byte for byte before a map is made
of it. One that a robot left has none: its recordings can be read or not, but a flipped bit in a
sample cannot be told from noise.
"""

from pathlib import Path

from echolearn.checks import BadValue, check
from echolearn.storage import manifests
from echolearn.storage.advice import repair_hint
from echolearn.storage.files import check_file
from echolearn.storage.kinds import check_kind
from echolearn.survey.audio import LARGEST
from echolearn.survey.description import LARGEST_YAML
from echolearn.survey.poses import LARGEST_CSV
from echolearn.survey.reader import FORMAT, read_survey
from echolearn.survey.survey import CALIBRATION, NOISE, Survey
from echolearn.survey.truth import LARGEST_TRUTH, TRUTH

LIMITS = {
    "survey.yaml": LARGEST_YAML,
    "poses.csv": LARGEST_CSV,
    TRUTH: LARGEST_TRUTH,
    "simulated.json": 16 << 20,
    "imported.json": 16 << 20,
    ".wav": LARGEST,
    ".flac": LARGEST,
}
"""Bytes that a file of a survey may have, by its name or the ending of it."""

OTHER = 1 << 20
"""Bytes that a file of a survey may have which no map depends on."""

CHANGED = f"if you changed the survey on purpose, remove its {manifests.MANIFEST}"
NAMED = f"must be among the files that {manifests.MANIFEST} names"


def used(survey: Survey) -> list[str]:
    """Return the names of the files that a map depends on."""
    beside = [name for name in (NOISE, CALIBRATION, TRUTH) if (survey.folder / name).exists()]
    return ["survey.yaml", "probe.wav", "poses.csv", *beside, *dict.fromkeys(survey.files)]


def read_proved(folder: Path) -> tuple[Survey, int]:
    """Return a survey, proved by its manifest first, and the number of files that were proved.

    Raises:
        BadValue: as `prove_manifest` and `read_survey`, or a file in use that the manifest does not
            name.
    """
    check_kind("survey", Path(folder), wanted="survey", allowed=FORMAT)
    entries = prove_manifest(folder)
    survey = read_survey(folder)
    for name in used(survey) if entries else ():
        check(name in entries, f"{folder / name}", "unknown", allowed=NAMED, hint=CHANGED)
    return survey, len(entries)


def prove_manifest(folder: Path) -> frozenset[str]:
    """Prove a survey by its manifest, and return the files that it names; none without one.

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
    kind = manifest.get("kind")
    check(kind == "survey", f"{place} kind", kind, allowed="must be survey", hint=CHANGED)
    # A manifest of nothing would prove any folder.
    entries = manifest["files"]
    check("survey.yaml" in entries, f"{folder / 'survey.yaml'}", "unknown", allowed=NAMED)

    mend = f"{CHANGED}; else {repair_hint(manifest, folder)}"
    for name, entry in entries.items():
        size = entry["bytes"]
        # Limited before it is hashed, which would take for ever with a terabyte.
        limit = LIMITS.get(name, LIMITS.get(Path(name).suffix.lower(), OTHER))
        check(size <= limit, f"{place} {name}", f"{size} bytes", allowed=f"must be at most {limit}")
        check_file(folder / name, size=size, expected=entry["sha256"], mend=mend)
    return frozenset(entries)


def verify_survey(folder: Path) -> str:
    """Prove a survey by its manifest, read every recording of it, and say what there is.

    Raises:
        BadValue: as `read_proved` and `Survey.observe`.
    """
    survey, files = read_proved(folder)
    for pose in range(len(survey.poses)):
        survey.observe([pose])
    for _ in survey.noise():
        pass
    readable = f"readable, {len(survey.poses)} recordings"
    if files:
        return f"whole, {files} files; {readable}"
    return f"{readable}; there is no {manifests.MANIFEST} to prove them by"
