"""Places of archives: of each kind that is tested."""

import os
from unittest import mock
from uuid import uuid4

import fsspec
import pytest
from moto.server import ThreadedMotoServer

from stepdiag_ros.archive.place import Place


@pytest.fixture
def folder(tmp_path):
    """Return an archive in a folder."""
    return Place(str(tmp_path / "an archive"))


@pytest.fixture(params=["local", "memory", "s3"])
def place(request, tmp_path):
    """Return an archive of each kind, empty."""
    if request.param == "local":
        yield Place(str(tmp_path / "it's"))
    elif request.param == "memory":
        yield Place(f"memory://{tmp_path.name}")
    else:
        yield request.getfixturevalue("store")


@pytest.fixture
def store():
    """Return an archive in a store that speaks S3, on loopback."""
    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    address = "http://{}:{}".format(*server.get_host_and_port())
    told = {
        "AWS_ACCESS_KEY_ID": "test",
        "AWS_SECRET_ACCESS_KEY": "test",
        "AWS_DEFAULT_REGION": "us-east-1",
        "AWS_ENDPOINT_URL": address,
        "NO_PROXY": "127.0.0.1",
    }
    with mock.patch.dict(os.environ, told):
        # All servers of a process have the same buckets.
        bucket = f"plant-{uuid4().hex}"
        fsspec.filesystem("s3", skip_instance_cache=True).mkdir(bucket)
        fsspec.get_filesystem_class("s3").clear_instance_cache()
        yield Place(f"s3://{bucket}/machines")
    fsspec.get_filesystem_class("s3").clear_instance_cache()
    server.stop()
