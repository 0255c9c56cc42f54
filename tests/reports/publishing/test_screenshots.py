from pathlib import Path

import pytest
from PIL import Image

from reports.publishing import screenshots
from reports.publishing.browser import CHROMIUM
from reports.publishing.screenshots import SHOTS, write_screenshots
from rescore.results.run_folder import Run


@pytest.mark.skipif(
    CHROMIUM is None, reason="needs a browser: apt-get install --no-install-recommends chromium"
)
def test_every_picture_shows_something_in_its_theme(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    chosen = tuple(s for s in SHOTS if s.name in ("desktop_light", "candidate", "phone_dark"))
    monkeypatch.setattr(screenshots, "SHOTS", chosen)
    page = write_screenshots(run.root, tmp_path / "out", "a command")
    text = page.read_text(encoding="utf-8")
    assert "`a command`" in text
    for shot in chosen:
        assert f"]({shot.name}.webp)" in text
        picture = Image.open(tmp_path / "out" / f"{shot.name}.webp").convert("L")
        darkest, lightest = picture.getextrema()
        assert lightest - darkest > 150
        middle = sorted(picture.resize((64, 64)).tobytes())[64 * 32]
        assert (middle < 100) == shot.dark
    # a page of its own: the run folder keeps no report of the pictures
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == sorted(
        ["README.md", *(f"{s.name}.webp" for s in chosen)]
    )
