"""Campaigns in object stores: in memory, and on a server of S3 whose requests fail or arrive twice.

The server is that of moto, on this machine; without moto and s3fs these tests skip.
"""

import http.client
import itertools
import uuid
from collections import Counter
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Lock, Thread

import pytest
from campaign_tables import completed

from npend_gym.cli import main
from npend_gym.experiments import Campaign, CampaignPlan, DiskError, SweepPlan, analyse
from npend_gym.experiments.campaign.folder import open_folder
from npend_gym.experiments.campaign.merge import merge, read_status

fsspec = pytest.importorskip("fsspec")
PLAN = CampaignPlan(n=[2, 3], amplitude=[0.3, 0.7], trials=20, batch=8)
THREADS = {"backend": "threading", "count": 2}


@pytest.fixture(scope="module")
def on_disk(tmp_path_factory):
    """The parts of an undisturbed campaign on the disk, by their names."""
    out = tmp_path_factory.mktemp("disk")
    completed(PLAN, out)
    merge(*read_status(out))
    return {path.relative_to(out).as_posix(): path.read_bytes() for path in out.rglob("*.parquet")}


@pytest.fixture
def memory():
    url = f"memory://{uuid.uuid4().hex}"
    yield url
    fs, root = fsspec.core.url_to_fs(url)
    if fs.exists(root):
        fs.rm(root, recursive=True)


def content(url):
    """Return the bytes of all Parquet files by their names."""
    folder = open_folder(url)
    folder.fs.invalidate_cache()
    found = folder.fs.find(folder.root)
    names = [each[len(folder.root) + 1 :] for each in found if each.endswith(".parquet")]
    return {name: folder.read(name) for name in names}


def test_a_campaign_in_memory_has_the_files_of_one_on_the_disk(memory, on_disk, tmp_path, capsys):
    completed(PLAN, memory, **THREADS)
    merge(*read_status(memory))
    assert content(memory) == on_disk
    assert analyse(memory).statistics.releases.tolist() == [20] * 4
    assert main(["campaign", "--status", memory]) == 0
    assert f"80 of 80 releases done: {memory}" in capsys.readouterr().out
    assert main(["analyse", memory, "-o", str(tmp_path)]) == 0
    with pytest.raises(SystemExit):
        main(["analyse", memory])
    assert "--out must be given" in capsys.readouterr().err


def test_a_campaign_in_a_store_resumes_and_repairs_what_is_damaged(memory, on_disk):
    with Campaign(PLAN, memory) as campaign:
        running = campaign.run("threading", 1)
        for _ in range(3):
            next(running)
        running.close()
    folder = open_folder(memory)
    damaged = folder.names("bobs/0000/")[1]
    folder.write(damaged, folder.read(damaged)[:-1])
    with Campaign(None, memory) as campaign:
        assert campaign.status.named == [damaged]
        assert campaign.status.count == 2
        assert not any(error for _, error in campaign.run("threading", 1))
    assert content(memory).items() <= on_disk.items()
    assert Campaign(None, memory).plan == PLAN
    with pytest.raises(ValueError, match="another plan, with trials = 20 where 21"):
        Campaign(CampaignPlan(**(PLAN.as_dict() | {"trials": 21})), memory)


def test_workers_that_do_not_share_the_memory_are_refused(memory):
    with Campaign(PLAN, memory) as campaign, pytest.raises(ValueError, match="must be threading"):
        next(campaign.run("loky", 2))


def test_a_key_is_written_once_and_other_bytes_are_an_error(memory):
    folder = open_folder(memory)
    folder.create("a", b"one")
    folder.create("a", b"one")  # the same request again
    with pytest.raises(FileExistsError, match="exists with other bytes") as raised:
        folder.create("a", b"two")
    assert raised.value.filename == f"{memory}/a"
    assert folder.read("a") == b"one"


def test_what_is_half_written_when_a_merge_fails_does_not_appear(memory):
    folder = open_folder(memory)

    def fail():
        with folder.writing("a") as file:
            file.write(b"half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    assert folder.read("a") is None


def test_a_url_without_its_library_is_an_error_that_names_the_command():
    for url in ("nothing://a/b", "dropbox://a/b"):
        with pytest.raises(ValueError, match=r"out must be a folder or the URL .*npend-gym\[cloud"):
            Campaign(PLAN, url)


# A server of S3


class Faults:
    """What happens to requests: some fail, of some the reply is lost, some come twice.

    Kinds take turns, whatever the threads do. A client tries twice, and others may ask for the same
    file in between: after a fault the next few requests for a file have none.
    """

    PUTS = "fine", "refused", "fine", "twice", "fine", "fine", "reply lost", "fine", "fine"
    OTHERS = (*["fine"] * 6, "refused", *["fine"] * 6)
    SPARED = 3

    def __init__(self):
        self.turns = {"PUT": itertools.cycle(self.PUTS), "": itertools.cycle(self.OTHERS)}
        self.spared = Counter()
        self.counts = dict.fromkeys(self.PUTS, 0)
        self.forever, self.lock = False, Lock()

    def draw(self, method, path):
        if self.forever:
            return "refused"
        with self.lock:
            kind = "fine"
            if self.spared[path] > 0:
                self.spared[path] -= 1
            else:
                kind = next(self.turns[method if method == "PUT" else ""])
                self.spared[path] = self.SPARED * (kind in ("refused", "reply lost"))
            self.counts[kind] += 1
        return kind


def forwarding(port, faults):
    """Return the handler of a proxy in front of the server at a port."""

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def forward(self):
            if self.headers.get("Expect") == "100-continue":
                del self.headers["Expect"]
            body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
            kind = faults.draw(self.command, self.path)
            for _ in range({"refused": 0, "twice": 2}.get(kind, 1)):
                server = http.client.HTTPConnection("127.0.0.1", port)
                server.request(self.command, self.path, body, dict(self.headers))
                reply = server.getresponse()
                data, status = reply.read(), reply.status
                headers = reply.getheaders()
                server.close()
            if kind in ("refused", "reply lost"):
                status, headers = 503, []
                data = b"<Error><Code>SlowDown</Code><Message>later</Message></Error>"
            self.send_response(status)
            for name, value in headers:
                if name.lower() not in ("connection", "content-length", "transfer-encoding"):
                    self.send_header(name, value)
            length = {k.lower(): v for k, v in headers}.get("content-length", len(data))
            self.send_header("Content-Length", length if self.command == "HEAD" else len(data))
            self.end_headers()
            if self.command != "HEAD":
                self.wfile.write(data)

        do_GET = do_PUT = do_POST = do_HEAD = do_DELETE = forward  # noqa: N815

        def log_message(self, *_):
            pass

    return Handler


@pytest.fixture(scope="module")
def server():
    moto = pytest.importorskip("moto.server")
    pytest.importorskip("s3fs")
    server = moto.ThreadedMotoServer("127.0.0.1", port=0, verbose=False)
    server.start()
    yield server.get_host_and_port()[1]
    server.stop()


@pytest.fixture
def bucket(server, monkeypatch):
    """The URL of a folder in a new bucket, and the faults of its server."""
    faults = Faults()
    proxy = ThreadingHTTPServer(("127.0.0.1", 0), forwarding(server, faults))
    Thread(target=proxy.serve_forever, daemon=True).start()
    for name, value in {
        "AWS_ACCESS_KEY_ID": "a", "AWS_SECRET_ACCESS_KEY": "b", "AWS_DEFAULT_REGION": "us-east-1",
        "AWS_MAX_ATTEMPTS": "2", "AWS_ENDPOINT_URL": f"http://127.0.0.1:{proxy.server_port}",
    }.items():  # fmt: skip
        monkeypatch.setenv(name, value)
    name = f"b{uuid.uuid4().hex}"
    fs = fsspec.filesystem("s3", skip_instance_cache=True)
    fsspec.get_filesystem_class("s3").clear_instance_cache()
    fs.mkdir(name)
    yield f"s3://{name}/results", faults
    proxy.shutdown()
    proxy.server_close()


@pytest.mark.long
def test_on_s3_whose_requests_fail_or_arrive_twice_the_bytes_are_those_of_the_disk(bucket, on_disk):
    url, faults = bucket
    for shard in ("1/2", "2/2", "2/2"):  # the last was started twice
        with Campaign(PLAN, url, shard=shard) as campaign:
            assert not any(error for _, error in campaign.run(**THREADS))
    plan, folder, status = read_status(url)
    assert status.done.all()
    merge(plan, folder, status)
    assert content(url) == on_disk
    assert min(faults.counts.values()) > 2, faults.counts


@pytest.mark.long
@pytest.mark.usefixtures("bucket")
def test_a_bucket_that_does_not_exist_is_an_error_with_its_name():
    with pytest.raises(DiskError, match=r"s3://nowhere/out cannot be written to: .*bucket"):
        Campaign(PLAN, "s3://nowhere/out").__enter__()


@pytest.mark.long
def test_two_drivers_of_one_share_on_s3_at_the_same_time_write_the_bytes_of_one(bucket, on_disk):
    url, _ = bucket
    errors = []

    def drive():
        with Campaign(PLAN, url, shard="1/1") as campaign:
            errors.extend(error for _, error in campaign.run("threading", 1))

    drivers = [Thread(target=drive) for _ in range(2)]
    for driver in drivers:
        driver.start()
    for driver in drivers:
        driver.join()
    assert set(errors) == {""}
    assert content(url).items() <= on_disk.items()
    assert read_status(url)[2].done.all()


@pytest.mark.long
def test_a_store_that_stops_answering_ends_the_campaign_with_what_is_done(bucket):
    url, faults = bucket
    with Campaign(SweepPlan("lyapunov", {"theta": [1.0, 2.0], "duration": 12.0}), url) as campaign:
        running = campaign.run("threading", 1)
        next(running)
        faults.forever = True
        with pytest.raises(DiskError, match=r"what is done is kept.*|s3://"):
            list(running)
    faults.forever = False
    assert read_status(url)[2].count >= 1
