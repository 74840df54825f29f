"""Runners that take seconds to begin, once for all tests here; a server of S3 on this machine."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from kinid.batch.runners import Runner, runner


@pytest.fixture(scope="package")
def processes() -> Iterator[Runner]:
    with runner("processes", 2) as made:
        yield made


@pytest.fixture(scope="package")
def cluster() -> Iterator[Runner]:
    with runner("dask", 2) as made:
        yield made


@pytest.fixture
def bucket(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """The address of an empty bucket; whoever asks for s3:// asks the server of this test."""
    import boto3
    from moto.server import ThreadedMotoServer
    from s3fs import S3FileSystem

    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        monkeypatch.setenv(name, "testing")
    monkeypatch.setenv("AWS_DEFAULT_REGION", "us-east-1")
    monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://{host}:{port}")
    boto3.client("s3").create_bucket(Bucket="lab")
    S3FileSystem.clear_instance_cache()
    yield "s3://lab"
    S3FileSystem.clear_instance_cache()
    server.stop()
