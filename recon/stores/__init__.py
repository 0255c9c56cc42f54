"""Files in object stores as paths: read whole or by ranges of bytes, written by one put, told by URL.

Code that reads takes a ``Path``; ``located`` makes of ``s3://bucket/key`` an object with those few methods
that reading needs. Only then fsspec is imported, and of a store no more is asked than what is named: no
bucket is ever listed as a whole. Credentials are the affair of the environment: none is taken from a URL, and
none is written.

What is read whole is kept in a cache on disk with a bound; its name holds what the store says of the content,
so that an object that was written again is read again.
"""

from recon.stores.objects import RemotePath, StoreError, beside, located, name_from, refuse_no_bucket, remote

__all__ = ["RemotePath", "StoreError", "beside", "located", "name_from", "refuse_no_bucket", "remote"]
