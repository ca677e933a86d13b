"""`s2r ros`: translate camera images between ROS topics, or those of a bag."""

from __future__ import annotations

import argparse
import re
import shlex
import sys
from collections.abc import Generator, Iterable, Iterator
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

from s2rstore.errors import RequestError
from s2rtools.common.command_line import store_argument
from s2rtools.common.command_line.progress import reporter

if TYPE_CHECKING:
    from s2rtools.translation.apply_bag import BagImage
    from s2rtools.translation.translator_file import StoredTranslator

EXAMPLE = (
    "s2r ros proxy --translator real2sim.safetensors --in /camera/image_raw/compressed "
    "--out /translated/image_raw/compressed --max-age 100ms"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(metavar="ACTION", title="actions", required=True)
    proxy = actions.add_parser("proxy", help="run a node that translates the images of a topic")
    _add_translator(proxy)
    _add_quality(proxy)
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
    _add_quality(replay)
    add = replay.add_argument_group("bag").add_argument
    add("--in", dest="input", metavar="TOPIC",
        help="topic of the images (default: the only one with images)")  # fmt: skip
    add("--out", dest="output", type=Path, required=True, metavar="BAG",
        help="bag to write: .bag for ROS 1, else a ROS 2 folder")  # fmt: skip
    add("--result", type=Path, metavar="STORE",
        help="make a store of the images and their translations, without poses")  # fmt: skip
    replay.set_defaults(action=_replay)
    package = actions.add_parser(
        "package", help="print the folder of the ROS package with the launch file"
    )
    package.set_defaults(action=_package)


def _add_translator(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument_group("translation").add_argument
    add("--translator", required=True, metavar="T",
        help="translator file (.safetensors), or its name in --store")  # fmt: skip
    add("--store", type=store_argument.folder, help="store that holds the translator")
    add("--strength", type=float, default=1.0, metavar="S",
        help="share of the translation, 0 to 1 (default 1)")  # fmt: skip


def _add_quality(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--jpeg-quality", type=int, metavar="Q",
                        help="quality of JPEG images (default: that of the input)")  # fmt: skip


def execute(options: argparse.Namespace) -> int:
    if options.action is not _package:
        _check(options)
    options.action(options)
    return 0


def _check(options: argparse.Namespace) -> None:
    from s2rtools.ros.proxy_settings import checked_strength

    checked_strength(options.strength, "--strength")
    quality = getattr(options, "jpeg_quality", None)
    if quality is not None and not 1 <= quality <= 100:
        raise RequestError(f"--jpeg-quality {quality}: must be 1 to 100")


def _proxy(options: argparse.Namespace) -> None:
    from s2rtools.ros import ros_environment
    from s2rtools.ros.proxy_node import check_topics
    from s2rtools.ros.proxy_settings import ProxyRequest, ProxySettings, parse_age
    from s2rtools.translation.translator_file import load_translator

    unknown = [text for text in options.arguments if ":=" not in text]
    if unknown:
        raise RequestError(f"{unknown[0]}: unknown argument; remappings are FROM:=TO")
    max_age = None if options.max_age is None else parse_age(options.max_age)
    check_topics(options.input, options.output)

    def load(name: str) -> StoredTranslator:
        stored = load_translator(name, options.store)
        _use_one_thread()
        return stored

    translator = load(options.translator)
    version = ros_environment.find_ros(options.ros)
    settings = ProxySettings(
        options.translator, translator, options.strength, max_age, options.jpeg_quality
    )
    request = ProxyRequest(
        options.input, options.output, settings, load, options.name, tuple(options.arguments)
    )
    if version == 1:
        from s2rtools.ros import ros1_node

        ros1_node.run(request)
    else:
        from s2rtools.ros import ros2_node

        ros2_node.run(request)


def _use_one_thread() -> None:
    """Compute in the calling thread only, for even latencies beside the robot's other programs.

    A translator may have loaded torch, which then has to be limited, too.
    """
    import cv2

    cv2.setNumThreads(1)
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(1)


def _replay(options: argparse.Namespace) -> None:
    if options.result is None:
        for _ in _translated_images(options):
            pass
    elif options.result.exists():
        raise RequestError(f"--result {options.result}: exists; choose another name, or remove it")
    else:
        _translate_to_store(options)


def _translated_images(options: argparse.Namespace) -> Generator[BagImage, None, None]:
    """Write the bag and yield every decoded image with its translation."""
    from s2rtools.translation.apply_bag import BagRequest, translated_images
    from s2rtools.translation.translator_file import load_translator

    translator = load_translator(options.translator, options.store).translator
    request = BagRequest(options.input, options.jpeg_quality)
    with reporter() as progress:
        result = yield from translated_images(
            translator, options.strength, options.bag, options.output, progress, request
        )
    print(f"{options.output}: {result.summary()}")


def _translate_to_store(options: argparse.Namespace) -> None:
    """Write the bag and make a store of it while its images are translated.

    The images of the bag are domain `camera` of the store, their translations `translated`.
    """
    from s2rtools.datasets.writing.image_instances import ImageInstance, build_from_images

    recording = re.sub(r"[^A-Za-z0-9_.+-]", "_", options.bag.stem)[:80].lstrip("_.+-") or "bag"
    count = 0

    def instances(images: Iterable[BagImage]) -> Iterator[ImageInstance]:
        nonlocal count
        for stamp, image, result in images:
            count += 1
            pair = {"camera": image, "translated": result}
            yield ImageInstance(recording, pair, stamp / 1e9, str(stamp))
        if not count:
            raise RequestError(f"{options.bag}: no image could be decoded; no store was made")

    with closing(_translated_images(options)) as images:
        build_from_images(
            instances(images), {"camera": "real", "translated": "sim"}, options.result, recording,
            shlex.join(["s2r", *sys.argv[1:]]),
        )  # fmt: skip
    print(f"{options.result}: {count} images and their translations")


def _package(options: argparse.Namespace) -> None:
    from s2rtools.ros.ros_environment import ROS1_PACKAGE

    print(ROS1_PACKAGE)
