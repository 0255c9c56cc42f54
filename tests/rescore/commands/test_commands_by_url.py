"""Commands on tables in parts, on this machine and in an object store that is slow and fails now and then."""

import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

import rescore.defaults
from recon.stores.objects import SCHEMES
from rescore.formats.parts.table import PARTS
from rescore.library.bundles import write_bundle
from tests.object_store import BUCKET, SECRET, Store, serving
from tests.rescore import shipped
from tests.rescore.spoiling import Done, Run


@pytest.fixture
def street(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, Path]:
    """A data set of one frame with one car, and its detections, for what comes with the package."""
    folder = tmp_path / "defaults"
    folder.mkdir()
    monkeypatch.setattr(rescore.defaults, "FOLDER", folder)
    write_bundle(folder / f"car{rescore.defaults.SUFFIX}", shipped.bundle())
    data, found = shipped.write_street(tmp_path / "street")
    content = json.loads((data / "annotations.json").read_text())
    box = json.loads(found.read_text())[1]["bbox"]
    content["annotations"] = [{"id": 7, "image_id": 1, "category_id": 1, "bbox": box}]
    # a second frame, whose picture is damaged
    content["images"].append(content["images"][0] | {"id": 2, "file_name": "damaged.png"})
    (data / "damaged.png").write_bytes((data / "left.png").read_bytes()[:-40])
    (data / "annotations.json").write_text(json.dumps(content))
    rows = json.loads(found.read_text())
    found.write_text(json.dumps([*rows, rows[0] | {"image_id": 2}]))
    return data, found


@pytest.fixture(params=SCHEMES)
def store(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Store]:
    with serving(monkeypatch, tmp_path / "cache", request.param) as running:
        yield running


def test_a_frame_that_fails_is_a_row(street: tuple[Path, Path], tmp_path: Path, run: Run) -> None:
    data, found = street
    out, made = tmp_path / "rescored", tmp_path / "run"
    code, _, err = run("apply", data, found, "--out", out, "--jobs", 1)
    assert code == 0, err
    assert "4 candidates, 3 with depth evidence (1 frame_failed)" in err, err[-400:]
    assert "1 frame failed: `rescore inspect" in err
    code, text, _ = run("inspect", out, "--failed")
    assert (code, text.split("\t")[0]) == (0, "2")
    assert "damaged.png: expected a picture" in text
    assert len(list((out / PARTS).iterdir())) == 1
    code, _, err = run("apply", data, found, "--out", out, "--jobs", 1)
    assert "kept from before: 1 part\n" in err
    code, _, err = run("evaluate", data, out, "--out", made, "--no-report")
    assert code == 0, err
    assert json.loads((made / "metrics.json").read_text())["n_images"] == 2
    refused(run("inspect", made, "--failed"), "got a run folder; name the folder that `rescore apply` or ")
    assert str(out) in run("inspect", made, "--failed")[2]
    content = json.loads((data / "annotations.json").read_text())
    content["images"][1]["split"] = "train"
    other = shutil.copytree(data, tmp_path / "other")
    (other / "annotations.json").write_text(json.dumps(content))
    for each in (found, out):
        refused(run("evaluate", other, each, "--out", tmp_path / "none"), "name theirs by --split")
    # the sample is a run of its own, which all that shows runs takes; its page says what its figures are
    assert run("report", made)[0] == 0
    page = (made / "sample" / "report.html").read_text()
    assert "The figures are those of a sample: 1 of 2 frames, chosen" in page
    code, text, err = run("inspect", made, "--frame", 1)
    assert "is a run in parts" in err
    assert text.count("\n") == 5
    code, _, err = run("apply", data, found, "--out", out, "--jobs", 1, "--adapt-share")
    assert (code, err.count("\n")) == (1, 1)


def refused(done: Done, message: str) -> None:
    code, out, err = done
    last = err.splitlines()[-1]
    assert (code, out, last[:9]) == (1, "", "rescore: "), err
    assert message in last


def test_nothing_that_is_there_is_written_over(street: tuple[Path, Path], tmp_path: Path, run: Run) -> None:
    data, found = street
    frames, out, full = tmp_path / "frames", tmp_path / "rescored", tmp_path / "full"
    assert run("import", data, "--out", frames, "--parts")[0] == 0
    assert run("apply", frames, found, "--out", out, "--jobs", 1)[0] == 0
    full.mkdir()
    (full / "hog.npz").write_bytes(b"a detector")
    link = tmp_path / "link"
    link.symlink_to(out)
    before = {p: p.read_bytes() for p in sorted(tmp_path.rglob("*")) if p.is_file()}
    told = "expected a new folder, or rescored in parts to go on with, got"
    same = "expected another place than what is read, got that of"
    refused(run("apply", data, found, "--out", frames), f"{told} frames in parts")
    refused(run("apply", frames, found, "--out", frames.as_uri()), same)
    refused(run("apply", frames, out, "--out", link), same)
    refused(run("apply", frames, found, "--out", full), f"{told} one that holds 'hog.npz'")
    refused(run("apply", frames, found, "--out", frames / "parts"), f"{told} one that holds '000000.parquet'")
    refused(run("apply", data, found, "--out", found), same)
    refused(run("apply", data, found, "--out", data / "annotations.json"), same)
    refused(run("detect", data, "--detector", full / "hog.npz", "--out", out), "got rescored in parts")
    refused(run("detect", data, "--detector", "no.npz", "--out", data / "annotations.json"), same)
    refused(run("import", data, "--out", frames), "expected no data set here yet")
    refused(run("import", data, "--out", data, "--parts"), "expected no data set here yet")
    assert {p: p.read_bytes() for p in sorted(tmp_path.rglob("*")) if p.is_file()} == before
    # a run that was stopped goes on in its own folder
    (out / "parts.json").unlink()
    assert "kept from before: 1 part\n" in run("apply", frames, found, "--out", out, "--jobs", 1)[2]


def test_questions_in_sql(street: tuple[Path, Path], tmp_path: Path, run: Run) -> None:
    pytest.importorskip("duckdb", reason="needs the extra query")
    data, found = street
    table, one, made = tmp_path / "rescored", tmp_path / "one.json", tmp_path / "run"
    assert run("apply", data, found, "--out", table, "--jobs", 1)[0] == 0
    assert run("query", table, "SELECT count(*) FROM frames WHERE status = 'frame_failed'")[1].split() == [
        "count_star()",
        "1",
    ]
    (data / "damaged.png").write_bytes((data / "left.png").read_bytes())
    assert run("apply", data, found, "--out", one, "--jobs", 1)[0] == 0
    for detections, place in ((table, made), (one, tmp_path / "file")):
        assert run("evaluate", data, detections, "--out", place, "--no-report")[0] == 0
        cars = "SELECT annotation_id FROM found WHERE mode = 'instance' AND accepted"
        assert run("query", place, cars)[1].split() == ["annotation_id", "7"]
        joined = "SELECT c.annotation_id, f.left_file FROM cars c JOIN frames f USING (image_id)"
        assert run("query", place, joined)[1].splitlines()[1].startswith("7\t")
        near = "SELECT 10 * floor(box3d_z / 10) AS z, avg(difference_instance) AS d FROM candidates "
        rows = json.loads(run("query", place, near + "WHERE box3d_z IS NOT NULL GROUP BY z", "--json")[1])
        assert all(0 < r["d"] < 1 for r in rows)
    for wrong in ("SELEC 1", "SELECT * FROM nothing", "COPY results TO 'x.csv'", "SELECT 1; SELECT 2"):
        code, _, err = run("query", made, wrong)
        assert (code, err.count("\n")) == (1, 1), err
    assert "tables are" in run("query", made, "SELECT nothing FROM candidates")[2]
    assert "Permission" in run("query", made, f"SELECT * FROM read_csv('{found}')")[2]
    assert run("query", tmp_path, "SELECT 1")[0] == 1


def test_everything_in_a_store_that_fails_now_and_then(
    street: tuple[Path, Path], run: Run, store: Store
) -> None:
    pytest.importorskip("duckdb", reason="needs the extra query")
    data, found = street
    for file in data.iterdir():
        store.at(f"data/{file.name}").write_bytes(file.read_bytes())
    store.asked.clear()
    # every ninth request fails, the others take a while
    store.every, store.delay_s = 9, 0.001
    told = []
    url = f"{store.scheme}://{BUCKET}"
    for arguments in (
        ("import", f"{url}/data", "--out", f"{url}/frames", "--parts"),
        ("apply", f"{url}/frames", f"{url}/data/{found.name}", "--out", f"{url}/rescored", "--jobs", 1),
        ("evaluate", f"{url}/frames", f"{url}/rescored", "--out", f"{url}/run", "--no-report"),
        ("query", f"{url}/run", "SELECT annotation_id FROM cars"),
        ("inspect", f"{url}/rescored", "--failed"),
    ):
        code, text, err = run(*arguments)
        assert code == 0, err
        told += [text, err]
    assert told[6].split() == ["annotation_id", "7"]
    assert told[8].startswith("2\t")
    assert store.lists()
    assert not store.whole_lists
    store.every = 0
    written = store.at("run")
    parts = list((written / "candidates" / PARTS).iterdir())
    small = [written / "config.json", written / "metrics.json", store.at("rescored.config.json")]
    for path in (*parts, *small):
        told.append(path.read_bytes().decode(errors="replace"))
    assert not [t for t in told if SECRET in t or "key-of-the-test" in t]
    store.fail(1000)
    code, _, err = run("evaluate", f"{url}/frames", f"{url}/rescored", "--out", f"{url}/other", "--no-report")
    assert (code, err.count("\n")) == (1, 1)
    assert "at each of 5 tries" in err
