"""URLs of stores: what is taken, what is refused, and that no function of the system opens one."""

import pickle
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.index.transaction import edit
from s2rstore.remote.open_files import store_path
from s2rstore.remote.store_url import StoreUrl, parse_url
from s2rtui.cli import main

SECRET = "s3cr3tpassw0rd"
SEGMENTS = st.text("abcXYZ019-_.@+~", min_size=1, max_size=8).filter(lambda s: s.strip("."))


@given(
    scheme=st.sampled_from(["s3", "http", "https"]),
    host=st.text("abcxyz019", min_size=2, max_size=10),
    segments=st.lists(SEGMENTS, max_size=4),
)
def test_a_url_is_its_own_text(scheme, host, segments):
    text = "/".join([f"{scheme}://{host}", *segments])
    url = parse_url(text)
    assert str(url) == text
    assert parse_url(str(url / "a" / "b")) == parse_url(f"{text}/a/b")
    assert (url.scheme, url.host, url.key) == (scheme, host, "/".join(segments))
    assert url.name == (segments[-1] if segments else host)
    assert pickle.loads(pickle.dumps(url)) == url
    assert (url.absolute(), url.resolve()) == (url, url)
    assert parse_url(f"{text}/") == url


@pytest.mark.parametrize(
    "text",
    [
        "gs://bucket/lab.s2r", "file:///etc", "s3://", "s3:///lab.s2r", "https:///x", "http://h:x/s",
        "https://h/a/../b", "https://h/a//b", "https://h/a b", "https://h/a\\b", "https://h/\x1b[2J",
        "https://h/lab.s2r?version=1", "https://h/lab.s2r#top", "s3://bu?cket/x",
        f"https://user:{SECRET}@h/lab.s2r", f"s3://{SECRET}@bucket/lab.s2r",
    ],
)  # fmt: skip
def test_other_urls_are_refused_in_one_line(text, capsys):
    with pytest.raises(RequestError) as error:
        s2rstore.open(text)
    with pytest.raises(SystemExit) as ended:
        main(["runs", text])
    assert ended.value.code == 2
    for message in (str(error.value), capsys.readouterr().err.strip()):
        assert len(message.splitlines()) == 1
        assert "\x1b" not in message or "\\x1b" in message
        assert SECRET not in message


def test_a_folder_with_a_colon_is_a_folder(tmp_path):
    assert not isinstance(store_path(str(tmp_path / "a:b")), StoreUrl)
    assert not isinstance(store_path("s3:lab.s2r"), StoreUrl)


def test_a_url_is_no_path_of_the_system():
    url = parse_url("https://h/lab.s2r")
    for use in (open, Path.exists, Path.mkdir, Path.read_bytes, Path.iterdir, Path.unlink):
        with pytest.raises(RequestError, match=r"https://h/lab\.s2r: a store on a server is only"):
            list(use(url))
    with pytest.raises(RequestError, match="is only read"), edit(url):
        pass


@pytest.mark.parametrize(
    "words",
    [
        ("precompute", "{url}"), ("prune", "{url}"), ("gap", "{url}"), ("rooms", "{url}"),
        ("model", "pretrained", "--store", "{url}"), ("serve", "{url}"),
        ("run", "add", "x", "--model", "m", "--store", "{url}"),
    ],
)  # fmt: skip
def test_commands_that_write_take_no_url(words, capsys):
    with pytest.raises(SystemExit) as ended:
        main([word.format(url="https://127.0.0.1:9/lab.s2r") for word in words])
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "https://127.0.0.1:9/lab.s2r: a store on a server is only read" in line


def test_a_missing_package_is_named(monkeypatch, s2r):
    monkeypatch.setitem(sys.modules, "obstore.store", None)
    s2r("runs", "s3://bucket/lab.s2r").assert_refused("pip install 's2rtui[remote]'")


@pytest.mark.parametrize("seconds", ["soon", "0", "-1", "nan"])
def test_the_time_limit_must_be_seconds(seconds, monkeypatch, s2r):
    monkeypatch.setenv("S2R_REMOTE_TIMEOUT", seconds)
    s2r("runs", "http://127.0.0.1:9/lab.s2r").assert_refused(
        f"S2R_REMOTE_TIMEOUT={seconds}: must be seconds"
    )


@pytest.mark.parametrize(
    ("name", "value", "shown"),
    [
        ("AWS_ENDPOINT_URL", "garbage", "AWS_ENDPOINT_URL=garbage: not the URL of a server"),
        ("AWS_ENDPOINT_URL_S3", "http://", "AWS_ENDPOINT_URL_S3=http://: not the URL"),
        ("AWS_ENDPOINT", "http://h:99999", "AWS_ENDPOINT=http://h:99999: not the URL"),
        ("AWS_ENDPOINT_URL", "http://a b", "AWS_ENDPOINT_URL=http://a b: not the URL"),
        ("AWS_ENDPOINT_URL", f"http://me:{SECRET}@h", "AWS_ENDPOINT_URL=...: not the URL"),
        ("AWS_REGION", "eu central", "AWS_REGION: has a blank"),
        ("AWS_SECRET_ACCESS_KEY", f"{SECRET}\n", "AWS_SECRET_ACCESS_KEY: has a blank"),
    ],
)
def test_variables_that_no_request_can_have_are_named(name, value, shown, monkeypatch, s2r):
    monkeypatch.setenv(name, value)
    (line,) = s2r("runs", "s3://bucket/lab.s2r").checked(2).err.splitlines()
    assert line.startswith(f"s2r: {shown}")
    assert SECRET not in line


def test_a_panic_of_obstore_is_one_line(monkeypatch, s2r):
    panic = type("PanicException", (BaseException,), {"__module__": "pyo3_runtime"})

    def get(*words: object, **options: object) -> None:
        raise panic("called `Result::unwrap()` on an `Err` value")

    monkeypatch.setattr("obstore.get", get)
    s2r("runs", "s3://bucket/lab.s2r").assert_refused(
        "lab.s2r/CURRENT.json: cannot be read (obstore failed; check"
    )
