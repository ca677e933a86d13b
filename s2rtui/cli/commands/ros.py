"""`s2r ros`: translate camera images between ROS topics, or those of a bag."""

from __future__ import annotations

import argparse
from pathlib import Path

from s2rstore.errors import RequestError
from s2rtui.cli.formatting.progress import reporter

EXAMPLE = (
    "s2r ros proxy --translator real2sim.safetensors --in /camera/image_raw/compressed "
    "--out /translated/image_raw/compressed --max-age 100ms"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(metavar="ACTION", title="actions", required=True)
    proxy = actions.add_parser("proxy", help="run a node that translates the images of a topic")
    _add_translator(proxy)
    add = proxy.add_argument_group("topics").add_argument
    add("--in", dest="input", required=True, metavar="TOPIC",
        help="topic of the images: sensor_msgs/CompressedImage or sensor_msgs/Image")  # fmt: skip
    add("--out", dest="output", required=True, metavar="TOPIC",
        help="topic of the translated images, of the same type")  # fmt: skip
    add = proxy.add_argument_group("node").add_argument
    add("--max-age", metavar="DURATION",
        help="drop images older than this, such as 100ms (default: no limit)")  # fmt: skip
    add("--name", default="translation_proxy", help="name of the node (default translation_proxy)")
    add("--ros", choices=("auto", "1", "2"), default="auto",
        help="version of ROS (default: ROS_VERSION, else the installed one)")  # fmt: skip
    add("arguments", nargs="*", metavar="FROM:=TO", help="remappings, as given by roslaunch")
    proxy.set_defaults(action=_proxy)
    replay = actions.add_parser("replay", help="write a bag whose images are translated")
    replay.add_argument("bag", type=Path, help="ROS 1 bag, or ROS 2 folder or file")
    _add_translator(replay)
    add = replay.add_argument_group("bag").add_argument
    add("--in", dest="input", metavar="TOPIC",
        help="topic of the images (default: the only one with images)")  # fmt: skip
    add("--out", dest="output", type=Path, required=True, metavar="BAG",
        help="bag to write: .bag for ROS 1, else a ROS 2 folder")  # fmt: skip
    add("--segments", type=Path, metavar="FILE",
        help="write the line segments of the translated images to this CSV file")  # fmt: skip
    replay.set_defaults(action=_replay)
    package = actions.add_parser(
        "package", help="print the folder of the ROS package with the launch file"
    )
    package.set_defaults(action=_package)


def _add_translator(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument_group("translation").add_argument
    add("--translator", required=True, metavar="T",
        help="translator file (.safetensors), or its name in --store")  # fmt: skip
    add("--store", type=Path, help="store that holds the translator")
    add("--strength", type=float, default=1.0, metavar="S",
        help="share of the translation, 0 to 1 (default 1)")  # fmt: skip
    add("--jpeg-quality", type=int, metavar="Q",
        help="quality of JPEG images, 1 to 100 (default: that of the input)")  # fmt: skip


def execute(options: argparse.Namespace) -> int:
    if options.action is not _package:
        _check(options)
    options.action(options)
    return 0


def _check(options: argparse.Namespace) -> None:
    from s2rtools.ros.proxy_settings import checked_strength

    checked_strength(options.strength, "--strength")
    quality = options.jpeg_quality
    if quality is not None and not 1 <= quality <= 100:
        raise RequestError(f"--jpeg-quality {quality}: must be 1 to 100")


def _proxy(options: argparse.Namespace) -> None:
    from s2rtools.ros import ros_environment
    from s2rtools.ros.image_topics import check_topics
    from s2rtools.ros.proxy_settings import ProxyRequest, ProxySettings, parse_age
    from s2rtools.ros.run_proxy import run_proxy
    from s2rtools.translation.load_translator import load_translator

    unknown = [text for text in options.arguments if ":=" not in text]
    if unknown:
        raise RequestError(f"{unknown[0]}: unknown argument; remappings are FROM:=TO")
    max_age = None if options.max_age is None else parse_age(options.max_age)
    check_topics(options.input, options.output)
    translator = load_translator(options.translator, options.store)
    version = ros_environment.find_ros(options.ros)
    settings = ProxySettings(
        options.translator, translator, options.strength, max_age, options.jpeg_quality
    )
    request = ProxyRequest(
        options.input, options.output, settings,
        lambda name: load_translator(name, options.store), options.name, tuple(options.arguments),
    )  # fmt: skip
    run_proxy(request, version)


def _replay(options: argparse.Namespace) -> None:
    from s2rtools.common.result_files import check_writable
    from s2rtools.ros.segment_table import SegmentTable
    from s2rtools.translation.apply_bag import BagRequest, apply_to_bag
    from s2rtools.translation.load_translator import load_translator

    check_writable({"--segments": options.segments}, {"BAG": options.bag})
    translator = load_translator(options.translator, options.store).translator
    table = None if options.segments is None else SegmentTable()
    request = BagRequest(options.input, options.jpeg_quality, None if table is None else table.add)
    with reporter() as progress:
        result = apply_to_bag(
            translator, options.strength, options.bag, options.output, progress, request
        )
    print(f"{options.output}: {result.summary()}")
    if table is not None:
        table.write(options.segments)
        print(f"{options.segments}: {table.segments} segments in {table.images} images")


def _package(options: argparse.Namespace) -> None:
    from s2rtools.ros.ros_environment import ROS1_PACKAGE

    print(ROS1_PACKAGE)
