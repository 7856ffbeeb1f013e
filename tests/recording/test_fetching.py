"""Datasets are fetched from a server of our own, which breaks off, lies, and is gone."""

import hashlib
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import SimpleNamespace

import pytest

from vrbench.errors import ConfigError, DataError
from vrbench.recording import datasets, fetching
from vrbench.recording.datasets import VARIABLE, Dataset
from vrbench.recording.fetching import fetch

CONTENT = {"a/one.txt": b"one\n" * 50_000, "two.bag": b"two" * 1000}


@pytest.fixture
def server(monkeypatch, tmp_path):
    """Serves `CONTENT`; `breaks` bytes after which it breaks off, `asked` what was asked of it."""
    told = SimpleNamespace(breaks=None, times=0, asked=[], content=dict(CONTENT), ranges=True)

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            prefix = "/raw/abc1234/"
            path = self.path.removeprefix(prefix)
            wanted = self.headers.get("Range")
            told.asked.append((path, wanted))
            if not self.path.startswith(prefix) or path not in told.content:
                self.send_error(404)
                return
            body = told.content[path]
            start = int(wanted[6:-1]) if wanted and told.ranges else 0
            self.send_response(206 if start else 200)
            self.send_header("Content-Length", str(len(body) - start))
            self.end_headers()
            end = len(body)
            if told.times:
                told.times -= 1
                end = start + told.breaks
            self.wfile.write(body[start:end])

        def log_message(self, *_):
            pass

    running = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=running.serve_forever, kwargs={"poll_interval": 0.02})
    thread.start()
    told.stop = running.shutdown
    tiny = Dataset(
        name="tiny2000",
        title="Two files",
        licence="MIT",
        doi="10.0/none",
        upstream=f"http://127.0.0.1:{running.server_address[1]}",
        commit="abc1234",
        files={path: hashlib.sha256(body).hexdigest() for path, body in CONTENT.items()},
    )
    monkeypatch.setattr(datasets, "DATASETS", {"tiny2000": tiny})
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    yield told
    running.shutdown()
    thread.join()
    running.server_close()


def quiet(*_):
    pass


def test_all_files_come_to_the_folder_that_the_variable_names(server, tmp_path):
    told = []
    folder = fetch("tiny2000", lambda *what: told.append(what))
    assert folder == tmp_path / "tiny2000"
    assert told == [("a/one.txt", "is fetched"), ("two.bag", "is fetched")]
    for path, body in CONTENT.items():
        assert (folder / path).read_bytes() == body
    assert sorted(x.name for x in folder.rglob("*") if x.is_file()) == ["one.txt", "two.bag"]


def test_what_is_there_is_not_asked_for(server, tmp_path):
    path = tmp_path / "tiny2000" / "two.bag"
    path.parent.mkdir()
    path.write_bytes(CONTENT["two.bag"])
    fetch("tiny2000", quiet)
    assert [x for x, _ in server.asked] == ["a/one.txt"]
    server.asked.clear()
    fetch("tiny2000", quiet)
    assert server.asked == []


def test_without_the_variable_they_come_to_the_cache_and_are_found_there(
    server, tmp_path, monkeypatch
):
    monkeypatch.delenv(VARIABLE)
    monkeypatch.setattr(datasets, "cache", lambda: tmp_path / "cache")
    assert fetch("tiny2000", quiet) == tmp_path / "cache" / "tiny2000"
    found = datasets.find_file("tiny2000", "two.bag")
    assert found == tmp_path / "cache" / "tiny2000" / "two.bag"


def test_a_download_that_breaks_off_goes_on_from_there(server, tmp_path):
    server.breaks, server.times = 70_000, 1
    fetch("tiny2000", quiet)
    first, second = [wanted for path, wanted in server.asked if path == "a/one.txt"]
    assert first is None
    assert 0 < int(second.removeprefix("bytes=")[:-1]) <= 70_000
    assert (tmp_path / "tiny2000/a/one.txt").read_bytes() == CONTENT["a/one.txt"]


def test_what_came_before_it_gave_up_is_kept_for_the_next_time(server, tmp_path):
    server.breaks, server.times = 30_000, fetching.TRIES
    with pytest.raises(DataError, match=r"one\.txt broke off after \d+ bytes \(.*goes on from"):
        fetch("tiny2000", quiet)
    came = (tmp_path / "tiny2000/a/one.txt.part").stat().st_size
    assert came > 0
    assert not (tmp_path / "tiny2000/a/one.txt").exists()
    server.asked.clear()
    fetch("tiny2000", quiet)
    assert server.asked[0] == ("a/one.txt", f"bytes={came}-")
    assert (tmp_path / "tiny2000/a/one.txt").read_bytes() == CONTENT["a/one.txt"]


def test_a_server_that_knows_no_ranges_sends_all_of_it_again(server, tmp_path):
    server.breaks, server.times, server.ranges = 70_000, 1, False
    fetch("tiny2000", quiet)
    assert (tmp_path / "tiny2000/a/one.txt").read_bytes() == CONTENT["a/one.txt"]


def test_another_file_than_was_published_is_refused_by_name_and_not_kept(server, tmp_path):
    server.content["two.bag"] = b"too" * 1000
    with pytest.raises(DataError, match=r"two\.bag.*not the published file: its sha256 differs"):
        fetch("tiny2000", quiet)
    assert not list((tmp_path / "tiny2000").glob("two.bag*"))
    server.content["two.bag"] = CONTENT["two.bag"]
    fetch("tiny2000", quiet)


def test_an_altered_file_is_fetched_anew_and_that_is_told(server, tmp_path):
    path = tmp_path / "tiny2000" / "two.bag"
    path.parent.mkdir()
    path.write_bytes(b"mine")
    told = []
    fetch("tiny2000", lambda *what: told.append(what))
    assert ("two.bag", "altered: is fetched anew") in told
    assert path.read_bytes() == CONTENT["two.bag"]


def test_what_the_server_does_not_have_is_named(server):
    del server.content["a/one.txt"]
    with pytest.raises(DataError, match=r"says 404 to http.*one\.txt"):
        fetch("tiny2000", quiet)


def test_offline_is_told(monkeypatch, tmp_path):
    gone = Dataset("gone2000", "Gone", "MIT", "10.0/n", "http://127.0.0.1:9", "a", {"x": "0" * 64})
    monkeypatch.setattr(datasets, "DATASETS", {"gone2000": gone})
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    with pytest.raises(DataError, match=r"is not reached \(ConnectionError\) \(are you online"):
        fetch("gone2000", quiet)


def test_unknown_names_are_refused():
    with pytest.raises(ConfigError, match="no dataset is called 'nothing'"):
        fetch("nothing", quiet)


def test_the_papers_files_have_an_address_at_their_commit():
    paper = datasets.known("banaszczyk2024")
    assert paper.files_url == ("https://github.com/AdamBanaszczyk/head_trajectory/raw/c28d77a/")
