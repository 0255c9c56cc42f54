"""Objects of stores as paths, against servers on the loopback address with faults."""

import pickle
from collections.abc import Iterator
from pathlib import Path

import pytest

from recon.errors import RescoreError
from recon.files import atomic_path
from recon.stores import StoreError, cache, located, refuse_no_bucket
from recon.stores import objects as stores
from tests.object_store import SECRET, Store, serving


@pytest.fixture(params=stores.SCHEMES)
def store(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Store]:
    with serving(monkeypatch, tmp_path / "cache", request.param) as running:
        yield running


def test_urls_and_paths_made_of_them() -> None:
    path = located("s3://fleet/a/b.json")
    assert located(Path("s3://fleet/a/b.json")) == path
    assert str(path) == "s3://fleet/a/b.json"
    assert str(path.with_name("c.png")) == "s3://fleet/a/c.png"
    assert str(path.parent / "d") == "s3://fleet/a/d"
    assert pickle.loads(pickle.dumps(path)) == path
    assert located("file:///tmp/x") == Path("/tmp/x")
    assert located("street/left.png") == Path("street/left.png")
    assert located("C:/street") == Path("C:/street")


@pytest.mark.parametrize(
    ("url", "told"),
    [
        *(
            ("s3://", "no plain name"),
            ("s3://key:word@fleet/x", "got credentials"),
            ("ftp://h/x", "got another"),
        ),
        *((Path("s4://word/x"), r"^s4://: expected s3://, gs:// or file://"), ("S3://word/x", "got another")),
    ],
)
def test_other_urls_are_refused_and_not_repeated(url: str | Path, told: str) -> None:
    with pytest.raises(RescoreError, match=told) as error:
        located(url)
    assert "word" not in str(error.value)


def test_a_folder_with_a_colon_is_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "day:").mkdir()
    assert located("day:/x") == Path("day:/x")


@pytest.mark.parametrize("word", ["s3:///x", "gs://", "--out=s3:///x/y"])
def test_a_url_without_a_bucket_is_refused(word: str) -> None:
    # a path would have its first folder for the bucket
    assert str(located(Path("s3:///x"))) == "s3://x"
    with pytest.raises(RescoreError, match=r"expected (s3|gs)://BUCKET/KEY, got no bucket"):
        refuse_no_bucket(word)
    refuse_no_bucket("s3://x/y")


def test_written_once_and_read_by_ranges(store: Store) -> None:
    path = store.at("a/b.bin")
    written, read = {
        "s3": ("PUT /fleet/a/b.bin", "GET /fleet/a/b.bin"),
        "gs": ("POST /upload/storage/v1/b/fleet/o", "GET /download/storage/v1/b/fleet/o/a%2Fb.bin"),
    }[store.scheme]
    assert not path.is_file()
    with atomic_path(located(path)) as beside:
        beside.write_bytes(bytes(range(256)) * 4000)
    assert store.writes == [written]
    assert path.is_file()
    assert path.parent.is_dir()
    with path.open() as file:
        file.seek(512_000 + 3)
        assert file.read(2) == bytes([3, 4])
        assert file.seek(-1, 2) == 1_023_999
        assert file.read() == bytes([255])
    store.asked.clear()
    assert path.read_bytes() == bytes(range(256)) * 4000
    assert path.read_bytes()[:1] == b"\0"
    # the second time comes from the cache, and the size was known
    assert [a.split("?")[0] for a in store.asked] == [read]
    path.write_bytes(b"new")
    assert path.read_bytes() == b"new"


def test_a_large_object_is_written_by_one_put_too(store: Store) -> None:
    """Clients make pieces of what is larger than 50 or 100 MB."""
    size = 101 * 2**20
    store.at("large.bin").write_bytes(bytes(size))
    assert len(store.asked) == len(store.writes) == 1
    assert store.at("large.bin").stat().st_size == size


def test_a_folder_is_listed_and_never_the_bucket(store: Store) -> None:
    for name in ("x/1", "x/2", "x/deep/3", "y/4"):
        store.at(name).write_bytes(b"1")
    store.asked.clear()
    assert [p.name for p in store.at("x").iterdir()] == ["1", "2", "deep"]
    assert list(store.at("none").iterdir()) == []
    assert store.lists()
    assert store.lists("x", "none") == store.lists()


def test_faults_that_pass_are_waited_for(store: Store) -> None:
    path = store.at("a")
    for status in ("503 Slow Down", "500 Internal Server Error"):
        store.fail(stores.TRIES - 1, status)
        path.write_bytes(b"whole")
        store.fail(stores.TRIES - 1, status)
        stores._state.cache_clear()
        assert path.read_bytes() == b"whole"


def test_the_end_of_tries_is_one_line(store: Store) -> None:
    store.fail(1000)
    with pytest.raises(
        StoreError,
        match=rf"^{store.scheme}://fleet/a: expected to write it, got .* at each of 5 tries; check",
    ) as error:
        store.at("a").write_bytes(b"1")
    assert "\n" not in str(error.value)
    assert len(store.asked) == stores.TRIES
    store.failing = 0
    with pytest.raises(StoreError, match="no such bucket"):
        located(f"{store.scheme}://other-fleet/a").write_bytes(b"1")


def test_no_error_tells_a_secret(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(f"signature of {SECRET} does not match")

    monkeypatch.setattr(stores._filesystem(store.scheme), "pipe_file", refuse)
    with pytest.raises(StoreError, match=r"signature of \.\.\. does not match") as error:
        store.at("a").write_bytes(b"1")
    assert SECRET not in str(error.value)


def test_the_cache_has_a_bound(store: Store, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(cache.CACHE_VARIABLE, "1")
    for k in range(15):
        store.at(f"{k}").write_bytes(bytes(100_000))
        store.at(f"{k}").read_bytes()
    kept = list(cache.cache_folder().iterdir())
    assert cache.cache_folder().is_relative_to(tmp_path)
    assert 5 <= len(kept) <= 10
    store.at("large").write_bytes(bytes(200_000))
    store.at("large").read_bytes()
    assert len(list(cache.cache_folder().iterdir())) == len(kept)
