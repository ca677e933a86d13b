"""Make a renderer program of a Python function."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, BinaryIO, NoReturn

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rtools.renderer.protocol import (
    PROTOCOL,
    Answer,
    CameraPose,
    Failed,
    Hello,
    Parameter,
    Ready,
    Rendered,
    RenderRequest,
    decode_message,
    encode,
)

Depth = NDArray[np.float32]
Render = Callable[
    [CameraPose, Hello, dict[str, float]], tuple[NDArray[np.uint8], NDArray[Any] | None]
]
"""A function of a pose, a camera and parameter values.

It returns RGB (height, width, 3) uint8, and depth (height, width) in metres along the optical axis,
0 where there is none, or None in place of depth. An exception means that this frame cannot be
rendered; its text is reported.
"""


def serve(
    render: Render,
    name: str,
    version: str = "1",
    parameters: Sequence[Parameter] = (),
    depth: bool = True,
) -> None:
    """Answer the messages of s2r on standard input with the frames of a function, until its end.

    `version` is part of the key of each frame: change it when the images change. `depth` False
    declares that the function returns None in place of depth. What the function prints goes to
    standard error, because standard output carries the protocol.
    """
    ready = Ready(name, version, tuple(parameters), depth)
    output = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)
    with output:
        for answer in _answers(render, ready, sys.stdin.buffer):
            output.write(encode(answer))


def _answers(render: Render, ready: Ready, lines: Iterable[bytes] | BinaryIO) -> Iterable[Answer]:
    camera: Hello | None = None
    for line in lines:
        message = decode_message(line)
        if message.hello is not None:
            camera = message.hello
            if camera.protocol != PROTOCOL:
                _refuse(f"protocol {camera.protocol} is not {PROTOCOL}")
            yield Answer(ready=ready)
        elif message.render is not None:
            if camera is None:
                _refuse("the first message is not hello")
            yield _answer(render, ready, camera, message.render)
        elif message.bye is not None:
            return


def _refuse(reason: str) -> NoReturn:
    sys.exit(f"renderer: {reason}")


def _answer(render: Render, ready: Ready, camera: Hello, request: RenderRequest) -> Answer:
    values = {each.name: each.default for each in ready.parameters} | request.parameters
    try:
        rgb, depth = render(request, camera, values)
        _write(rgb, depth if ready.depth else None, camera, request)
    except Exception as error:
        text = f"{type(error).__name__}: {error}"
        return Answer(failed=Failed(request.id, text[:2000]))
    return Answer(rendered=Rendered(request.id))


def _write(
    rgb: NDArray[np.uint8], depth: NDArray[Any] | None, camera: Hello, request: RenderRequest
) -> None:
    """Raises ValueError unless the images have the type and size of the camera's frames."""
    shape = camera.height, camera.width
    if rgb.dtype != np.uint8 or rgb.shape != (*shape, 3):
        raise ValueError(f"rgb is {rgb.dtype} {rgb.shape}, not uint8 {(*shape, 3)}")
    folder = Path(camera.folder)
    bgr = np.ascontiguousarray(rgb[..., ::-1])
    _, png = cv2.imencode(".png", bgr, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    (folder / request.rgb).write_bytes(png.tobytes())
    if depth is not None:
        if depth.shape != shape:
            raise ValueError(f"depth is {depth.shape}, not {shape}")
        np.save(folder / request.depth, np.ascontiguousarray(depth, dtype=np.float32))
