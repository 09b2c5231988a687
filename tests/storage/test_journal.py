"""Folders that were killed in the middle: what was cut short goes, what is finished stays."""

import pytest

from echolearn.storage import journal

CONTENTS = {"first.txt": b"1", "parts/0000.wav": b"22", "parts/0001.wav": b"333"}


@pytest.mark.parametrize("finished", [0, 2])
def test_what_a_kill_cut_short_goes_also_where_nothing_was_finished(tmp_path, finished):
    def contents():
        for count, (name, content) in enumerate(CONTENTS.items()):
            if count == killed:
                raise KeyboardInterrupt
            yield name, lambda content=content: content

    def make():
        return journal.make_missing(tmp_path, {"a": 1}, contents=contents(), begun="begun.json")

    killed = max(finished, 1)
    with pytest.raises(KeyboardInterrupt):
        make()
    if finished == 0:
        (tmp_path / journal.JOURNAL).unlink()
    (tmp_path / "parts").mkdir(exist_ok=True)
    (tmp_path / "parts/.0001.wav.0123456789ab.tmp").write_bytes(b"torn")

    killed = None
    assert make() == ["begun.json", *CONTENTS]
    journal.end(tmp_path)
    there = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file()}
    assert there == {"begun.json", *CONTENTS}
    for name, content in CONTENTS.items():
        assert (tmp_path / name).read_bytes() == content
