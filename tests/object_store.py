"""Object stores on the loopback address that are slow or fail when they are told to.

That of ``s3://`` is moto's server, that of ``gs://`` the gcp-storage-emulator.
"""

import json
import re
import sys
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from http.server import ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

from recon.stores import RemotePath, located, objects, remote

SECRET = "the-secret-of-the-test"
BUCKET = "fleet"


_LIST = {"s3": "list-type", "gs": "GET /storage/v1/b/fleet/o?"}


@dataclass
class Store:
    """The store with what it was asked, and what it is to do next."""

    scheme: str = "s3"
    asked: list[str] = field(default_factory=list)
    """Method, path and query of each request."""
    failing: int = 0
    """Number of requests to come that get ``status``."""
    status: str = "503 Slow Down"
    delay_s: float = 0.0
    every: int = 0
    """Where above 0, each so many-th request fails."""

    def fails(self, request: str) -> bool:
        """Whether this request is to fail; it is counted."""
        self.asked.append(request)
        time.sleep(self.delay_s)
        self.failing -= self.failing > 0
        return self.failing > 0 or bool(self.every and len(self.asked) % self.every == 0)

    def at(self, key: str) -> RemotePath:
        """The path of an object in it."""
        path = remote(located(f"{self.scheme}://{BUCKET}/{key}"))
        assert path is not None
        return path

    @property
    def writes(self) -> list[str]:
        """Requests that wrote, without their queries."""
        return [a.split("?")[0] for a in self.asked if a.startswith(("PUT", "POST"))]

    def lists(self, *prefixes: str) -> list[str]:
        """Requests that listed names, of those with one of the prefixes; of all where there are none."""
        found = [a for a in self.asked if _LIST[self.scheme] in a]
        return [a for a in found if not prefixes or any(f"prefix={p}" in a for p in prefixes)]

    @property
    def whole_lists(self) -> list[str]:
        """Requests that listed the whole bucket."""
        return [a for a in self.lists() if not re.search("prefix=[^&]", a)]

    def fail(self, requests: int, status: str = "503 Slow Down") -> None:
        """Let so many requests fail from now on."""
        self.failing, self.status = requests + 1, status


@contextmanager
def serving(monkeypatch: pytest.MonkeyPatch, cache: Path, scheme: str = "s3") -> Iterator[Store]:
    """Inside, ``SCHEME://fleet`` is a bucket of a server on the loopback address, with a secret to reach it.

    What is read is kept in the folder ``cache``, and nothing waits between two tries.
    """
    store = Store(scheme)
    http = {"s3": _moto, "gs": _emulator}[scheme](store)
    threading.Thread(target=http.serve_forever, daemon=True).start()
    address = f"http://127.0.0.1:{http.server_port}"
    settings = {
        "AWS_ACCESS_KEY_ID": "key-of-the-test",
        "AWS_SECRET_ACCESS_KEY": SECRET,
        "AWS_DEFAULT_REGION": "us-east-1",
        "AWS_ENDPOINT_URL": address,
        "STORAGE_EMULATOR_HOST": address,
        "XDG_CACHE_HOME": str(cache),
    }
    for name, value in settings.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(objects, "pause", lambda _seconds: None)
    _forget()
    try:
        if scheme == "s3":
            import boto3  # noqa: PLC0415

            boto3.client("s3").create_bucket(Bucket=BUCKET)
        store.asked.clear()
        yield store
    finally:
        http.shutdown()
        http.server_close()
        _forget()


def _moto(store: Store) -> Any:
    pytest.importorskip("s3fs", reason="needs the extra s3")
    server = pytest.importorskip("moto.server", reason="needs moto's server")
    werkzeug = pytest.importorskip("werkzeug.serving", reason="needs moto's server")
    app = server.DomainDispatcherApplication(server.create_backend_app)

    def faulty(environ: dict[str, Any], start: Any) -> Iterable[bytes]:
        if store.fails(f"{environ['REQUEST_METHOD']} {environ['PATH_INFO']}?{environ['QUERY_STRING']}"):
            environ["wsgi.input"].read(int(environ.get("CONTENT_LENGTH") or 0))
            start(store.status, [("Content-Length", "0")])
            return [b""]
        answer: Iterable[bytes] = app(environ, start)
        return answer

    return werkzeug.make_server("127.0.0.1", 0, faulty, threaded=True)


def _emulator(store: Store) -> Any:
    pytest.importorskip("gcsfs", reason="needs the extra gcs")
    server = pytest.importorskip("gcp_storage_emulator.server", reason="needs gcp-storage-emulator")
    storage = server.Storage(use_memory_fs=True)
    server.buckets.create_bucket(BUCKET, storage)

    class Faulty(server.RequestHandler):  # type: ignore[misc, name-defined] # which has no types
        """The emulator's handler, with faults."""

        def parse_request(self) -> bool:
            if not super().parse_request():
                return False
            fails = store.fails(f"{self.command} {self.path}")
            if fails:
                self.rfile.read(int(self.headers.get("Content-Length") or 0))
                code, _, word = store.status.partition(" ")
                answer = json.dumps({"error": {"code": int(code), "message": word}}).encode()
                self.send_response(int(code))
                self.send_header("Content-Length", str(len(answer)))
                self.end_headers()
                self.wfile.write(answer)
            return not fails

    return _Quiet(("127.0.0.1", 0), partial(Faulty, storage))


class _Quiet(ThreadingHTTPServer):
    """A server that is silent where its client hangs up, as that of Google does on one of two questions."""

    def handle_error(self, *_: object) -> None:
        """Nothing."""


def _forget() -> None:
    """No file system and no state of another store is kept."""
    objects._filesystem.cache_clear()
    objects._state.cache_clear()
    if "s3fs" in sys.modules:
        sys.modules["s3fs"].S3FileSystem.clear_instance_cache()
