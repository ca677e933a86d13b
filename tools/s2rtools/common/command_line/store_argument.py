"""The arguments that name the store of a command."""

from __future__ import annotations

import argparse
from pathlib import Path

from s2rstore.errors import RequestError
from s2rstore.remote.open_files import store_path
from s2rstore.remote.store_url import StoreUrl, is_url, parse_url


def add_readable(parser: argparse.ArgumentParser) -> None:
    """Add the argument of a command that only reads: a folder, or a URL."""
    parser.add_argument(
        "store", type=_readable_store,
        help="store folder, or the URL of a store (s3://, https:// or http://)",
    )  # fmt: skip


def _readable_store(text: str) -> Path:
    try:
        return store_path(text)
    except RequestError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def folder(text: str) -> Path:
    """The folder of a store, for argparse; commands that write, or load models, take no URL."""
    if is_url(text):
        message = f"{text}: a store on a server is only read; give a store in a folder"
        raise argparse.ArgumentTypeError(message)
    return Path(text)


def url(text: str) -> StoreUrl:
    """The URL of a store, for argparse."""
    try:
        return parse_url(text)
    except RequestError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
