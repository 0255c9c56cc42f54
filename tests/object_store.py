"""An object store on the loopback address (moto's server) that is slow or fails when it is told to."""

import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from recon.stores import objects

SECRET = "the-secret-of-the-test"
BUCKET = "fleet"


@dataclass
class Store:
    """The store with what it was asked, and what it is to do next."""

    asked: list[str] = field(default_factory=list)
    """Method, path and query of each request."""
    failing: int = 0
    """Number of requests to come that get ``status``."""
    status: str = "503 Slow Down"
    delay_s: float = 0.0
    every: int = 0
    """Where above 0, each so many-th request fails."""

    def wrap(self, app: Any) -> Any:
        """The application, with faults."""

        def faulty(environ: dict[str, Any], start: Any) -> Iterable[bytes]:
            self.asked.append(f"{environ['REQUEST_METHOD']} {environ['PATH_INFO']}?{environ['QUERY_STRING']}")
            time.sleep(self.delay_s)
            self.failing -= self.failing > 0
            if self.failing > 0 or (self.every and len(self.asked) % self.every == 0):
                environ["wsgi.input"].read(int(environ.get("CONTENT_LENGTH") or 0))
                start(self.status, [("Content-Length", "0")])
                return [b""]
            answer: Iterable[bytes] = app(environ, start)
            return answer

        return faulty

    def fail(self, requests: int, status: str = "503 Slow Down") -> None:
        """Let so many requests fail from now on."""
        self.failing, self.status = requests + 1, status


@contextmanager
def serving(monkeypatch: pytest.MonkeyPatch, cache: Path) -> Iterator[Store]:
    """Inside, ``s3://fleet`` is a bucket of a server on the loopback address, with a secret to reach it.

    What is read is kept in the folder ``cache``, and nothing waits between two tries.
    """
    pytest.importorskip("s3fs", reason="needs the extra s3")
    server = pytest.importorskip("moto.server", reason="needs moto's server")
    serving = pytest.importorskip("werkzeug.serving", reason="needs moto's server")

    store = Store()
    app = server.DomainDispatcherApplication(server.create_backend_app)
    http = serving.make_server("127.0.0.1", 0, store.wrap(app), threaded=True)
    threading.Thread(target=http.serve_forever, daemon=True).start()
    settings = {
        "AWS_ACCESS_KEY_ID": "key-of-the-test",
        "AWS_SECRET_ACCESS_KEY": SECRET,
        "AWS_DEFAULT_REGION": "us-east-1",
        "AWS_ENDPOINT_URL": f"http://127.0.0.1:{http.server_port}",
        "XDG_CACHE_HOME": str(cache),
    }
    for name, value in settings.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(objects, "pause", lambda _seconds: None)
    _forget()
    try:
        import boto3  # noqa: PLC0415

        boto3.client("s3").create_bucket(Bucket=BUCKET)
        store.asked.clear()
        yield store
    finally:
        http.shutdown()
        http.server_close()
        _forget()


def _forget() -> None:
    """No file system and no state of another store is kept."""
    import s3fs  # noqa: PLC0415

    objects._filesystem.cache_clear()
    objects._state.cache_clear()
    s3fs.S3FileSystem.clear_instance_cache()
