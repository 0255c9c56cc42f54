import re
from pathlib import Path

from recon.errors import Reason
from rescore.evidence.candidates import OK
from rescore.results.words import STATUS_TEXT, status_text, view_text

GLOSSARY = Path(__file__).parents[3] / "docs" / "glossary.md"


def test_every_status_has_words_of_its_own() -> None:
    assert set(STATUS_TEXT) == {OK, *Reason}
    assert len(set(STATUS_TEXT.values())) == len(STATUS_TEXT)


def test_the_glossary_explains_every_reason() -> None:
    section = GLOSSARY.read_text().split("### Status reasons")[1].split("\n#")[0]
    assert set(re.findall(r"^\| `(\w+)` \|", section, re.M)) == set(Reason)


def test_words_of_a_status() -> None:
    assert status_text("no_stereo") == "too little measured depth"
    assert status_text("of_tomorrow") == "of tomorrow"
    assert status_text("") == "not rescored"


def test_words_of_a_view() -> None:
    assert view_text("left front", 0.814, "rear") == "seen from its left front (81 %), else from its rear"
    assert view_text("", float("nan"), "") == ""
