"""Google's object store as one that is asked once each time, so that tries are counted in one place."""

from typing import Any

from aiohttp import ClientError, ClientTimeout
from gcsfs.core import GCSFileSystem
from gcsfs.retry import HttpError
from google.auth.exceptions import GoogleAuthError
from requests import RequestException

_TIMEOUT = ClientTimeout(total=None, sock_connect=10, sock_read=60)


class AskedOnce(GCSFileSystem):  # type: ignore[misc] # which has no types
    """The client without its own six tries, which take half a minute, and as many around each of a write.

    It is the client of Google's JSON interface, which does not reach zonal buckets.
    """

    async def _request(self, *arguments: Any, **named: Any) -> Any:
        once = GCSFileSystem._request.__wrapped__
        try:
            return await once(self, *arguments, **named)
        except (HttpError, ClientError, RequestException, GoogleAuthError) as error:
            # of another kind than those that the client would try again
            raise OSError(f"{type(error).__name__}: {error}") from error


def google_store() -> AskedOnce:
    """The store of the environment's account, or of ``STORAGE_EMULATOR_HOST``; listings are not kept."""
    # who asks for it keeps it, so that another address is another store
    return AskedOnce(use_listings_cache=False, requests_timeout=_TIMEOUT, skip_instance_cache=True)
