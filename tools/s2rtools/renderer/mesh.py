"""A textured mesh as a renderer program: `python -m s2rtools.renderer.mesh FILE.glb`.

Reads glTF 2.0 (.glb, .gltf) and Wavefront (.obj) by VTK, which renders without a screen. Textures
are drawn as they are, without lights: a scan has its light in its textures.

`--points FILE.csv` places the mesh on the map: rows `mesh_x,mesh_y,x_m,y_m` name places on the
mesh's floor and on the map. Without it, the mesh's origin and axes are those of the map.
"""

from __future__ import annotations

import argparse
import hashlib
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rtools.common.tables.csv_rows import missing_column, parse_float, read_rows
from s2rtools.motion_logs.motion_log import fit_transform
from s2rtools.renderer import CameraPose, Hello, Parameter, serve
from s2rtools.renderer.serving import Render

VERSION = "1"
"""Changes whenever the frames do."""
PARAMETERS = (
    Parameter("brightness", 1.0, 0.1, 4.0),
    Parameter("contrast", 1.0, 0.2, 3.0),
    Parameter("camera_height", 0.0, -1.0, 2.0, "m"),
    Parameter("camera_pitch", 0.0, -45.0, 45.0, "deg"),
    Parameter("zoom", 1.0, 0.5, 2.0),
)
"""Factors of the image and of the focal length; metres and degrees up that the camera moves."""
_COLUMNS = ("mesh_x", "mesh_y", "x_m", "y_m")
_NEAR = 0.02
_GREY = 127.5
_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""Turns axes whose y points up, as those of glTF, into axes whose z does."""


class MeshScene:
    """A mesh in the world of the protocol, in a window that is never shown.

    `placement` (4, 4) maps the mesh, whose z points up, to that world.
    """

    def __init__(self, path: Path, placement: NDArray[np.float64]) -> None:
        """Raises RequestError where the file holds no surface."""
        from vtkmodules import vtkRenderingOpenGL2  # noqa: F401
        from vtkmodules.vtkCommonCore import vtkLogger
        from vtkmodules.vtkRenderingCore import vtkRenderer, vtkRenderWindow

        vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)  # it warns that there is no screen
        self._renderer, self._window = vtkRenderer(), vtkRenderWindow()
        self._window.SetOffScreenRendering(True)
        self._window.SetMultiSamples(0)
        self._window.AddRenderer(self._renderer)
        importer = _importer(path)
        importer.SetRenderWindow(self._window)
        importer.Update()
        actors = list(self._renderer.GetActors())
        if not actors:
            raise RequestError(f"{path}: holds no surface that VTK reads")
        matrix = placement.copy()
        if path.suffix.lower() != ".obj":
            matrix[:3, :3] = matrix[:3, :3] @ _Y_UP
        for actor in actors:
            _place(actor, matrix)
            _show_texture_alone(actor)
        self._renderer.RemoveAllLights()
        self._renderer.AutomaticLightCreationOff()
        self._renderer.SetBackground(0, 0, 0)
        bounds = np.array(self._renderer.ComputeVisiblePropBounds()).reshape(3, 2)
        self._corners = np.array(np.meshgrid(*bounds)).reshape(3, -1).T

    def render(
        self, rotation: NDArray[np.float64], position: NDArray[np.float64], lens: Hello
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """RGB (h, w, 3) and depth (h, w) in metres, 0 where there is no surface.

        The columns of `rotation` are the directions to the right, down and forward.
        """
        far = float(np.linalg.norm(self._corners - position, axis=1).max()) + 2 * _NEAR
        camera = self._renderer.GetActiveCamera()
        camera.SetPosition(*position)
        camera.SetFocalPoint(*(position + rotation[:, 2]))
        camera.SetViewUp(*-rotation[:, 1])
        camera.SetUseExplicitProjectionTransformMatrix(True)
        camera.SetExplicitProjectionTransformMatrix(_vtk_matrix(_projection(lens, far)))
        camera.SetClippingRange(_NEAR, far)
        self._window.SetSize(lens.width, lens.height)
        self._window.Render()
        rgb = self._pixels("RGB")
        z = self._pixels("ZBuffer")[..., 0].astype(np.float64)
        metres = _NEAR * far / (far - z * (far - _NEAR))
        return rgb, np.where(z < 1, metres, 0.0).astype(np.float32)

    def _pixels(self, kind: str) -> NDArray[Any]:
        """(h, w, channels), the first row at the top."""
        from vtkmodules.util.numpy_support import vtk_to_numpy
        from vtkmodules.vtkRenderingCore import vtkWindowToImageFilter

        reader = vtkWindowToImageFilter()
        reader.SetInput(self._window)
        getattr(reader, f"SetInputBufferTypeTo{kind}")()
        reader.ReadFrontBufferOff()
        reader.ShouldRerenderOff()
        reader.Update()
        image = reader.GetOutput()
        width, height, _ = image.GetDimensions()
        values = vtk_to_numpy(image.GetPointData().GetScalars())
        return values.reshape(height, width, -1)[::-1]


def _importer(path: Path) -> Any:
    from vtkmodules.vtkIOImport import vtkGLTFImporter, vtkOBJImporter

    if not path.is_file():
        raise RequestError(f"{path}: no such file")
    if path.suffix.lower() in (".glb", ".gltf"):
        importer = vtkGLTFImporter()
        importer.SetFileName(str(path))
        return importer
    if path.suffix.lower() == ".obj":
        importer = vtkOBJImporter()
        importer.SetFileName(str(path))
        importer.SetTexturePath(str(path.parent))
        if path.with_suffix(".mtl").is_file():
            importer.SetFileNameMTL(str(path.with_suffix(".mtl")))
        return importer
    raise RequestError(f"{path}: must be .glb, .gltf or .obj")


def _place(actor: Any, matrix: NDArray[np.float64]) -> None:
    """Put what an actor already does to its mesh below `matrix`."""
    own = actor.GetMatrix()
    before = np.array([[own.GetElement(i, j) for j in range(4)] for i in range(4)])
    actor.SetPosition(0, 0, 0)
    actor.SetOrientation(0, 0, 0)
    actor.SetScale(1, 1, 1)
    actor.SetUserMatrix(_vtk_matrix(matrix @ before))


def _show_texture_alone(actor: Any) -> None:
    """Draw the colours of a surface as they are, whatever its material says about light."""
    surface = actor.GetProperty()
    texture = surface.GetTexture("albedoTex")
    if texture is not None:
        texture.UseSRGBColorSpaceOff()
        actor.SetTexture(texture)
        surface.RemoveAllTextures()
    surface.SetInterpolationToGouraud()
    surface.LightingOff()
    surface.BackfaceCullingOff()


def _projection(lens: Hello, far: float) -> NDArray[np.float64]:
    """The matrix of OpenGL for a pinhole whose pixel i covers [i, i + 1)."""
    width, height = lens.width, lens.height
    return np.array(
        [
            [2 * lens.fx / width, 0, 1 - 2 * lens.cx / width, 0],
            [0, 2 * lens.fy / height, 2 * lens.cy / height - 1, 0],
            [0, 0, -(far + _NEAR) / (far - _NEAR), -2 * far * _NEAR / (far - _NEAR)],
            [0, 0, -1, 0],
        ]
    )


def _vtk_matrix(values: NDArray[np.float64]) -> Any:
    from vtkmodules.vtkCommonMath import vtkMatrix4x4

    matrix = vtkMatrix4x4()
    matrix.DeepCopy(values.ravel().tolist())
    return matrix


def placement_of(path: Path, y_down: bool) -> NDArray[np.float64]:
    """(4, 4): the similarity that maps a mesh to the world by a file of points.

    Raises RequestError for fewer than two points, and for what is no number.
    """
    rows = [
        [parse_float(row[name]) for name in _COLUMNS]
        for _, row in read_rows(path, _COLUMNS, lambda names: _check_columns(path, names))
    ]
    points = np.array(rows, dtype=np.float64).reshape(-1, 4)
    if len(points) < 2 or not np.isfinite(points).all():
        raise RequestError(f"{path}: needs numbers in two rows or more: {', '.join(_COLUMNS)}")
    if y_down:
        points[:, 3] *= -1
    found = fit_transform((points[:, 0], points[:, 1]), (points[:, 2], points[:, 3]), scale=True)
    cos, sin = found.scale * math.cos(found.angle), found.scale * math.sin(found.angle)
    matrix = np.eye(4)
    matrix[:2, :2] = [[cos, -sin], [sin, cos]]
    matrix[2, 2] = found.scale
    matrix[:2, 3] = found.x, found.y
    return matrix


def _check_columns(path: Path, names: Any) -> None:
    for name in _COLUMNS:
        if name not in names:
            raise missing_column(path, name, names, ", ".join(_COLUMNS))


def mesh_renderer(path: Path, points: Path | None) -> Render:
    """The function that renders a mesh for `serve`."""
    scenes: dict[bool, MeshScene] = {}

    def render(
        pose: CameraPose, camera: Hello, values: dict[str, float]
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        if camera.y_down not in scenes:
            placement = np.eye(4) if points is None else placement_of(points, camera.y_down)
            scenes[camera.y_down] = MeshScene(path, placement)
        rotation, position = _moved(pose, values)
        zoom = values["zoom"]
        lens = Hello(
            width=camera.width, height=camera.height, fx=zoom * camera.fx, fy=zoom * camera.fy,
            cx=camera.cx, cy=camera.cy, y_down=camera.y_down, folder="",
        )  # fmt: skip
        rgb, depth = scenes[camera.y_down].render(rotation, position, lens)
        return _adjusted(rgb, values["brightness"], values["contrast"]), depth

    return render


def _moved(
    pose: CameraPose, values: dict[str, float]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rotation and position of the camera with `camera_height` and `camera_pitch`."""
    angle = math.radians(values["camera_pitch"])
    cos, sin = math.cos(angle), math.sin(angle)
    pitched = pose.rotation @ np.array([[1, 0, 0], [0, cos, -sin], [0, sin, cos]])
    position = np.array(pose.position)
    position[2] += values["camera_height"]
    return pitched, position


def _adjusted(rgb: NDArray[np.uint8], brightness: float, contrast: float) -> NDArray[np.uint8]:
    if brightness == contrast == 1:
        return rgb
    levels = brightness * (_GREY + contrast * (np.arange(256) - _GREY))
    return np.clip(np.rint(levels), 0, 255).astype(np.uint8)[rgb]


def _content_hash(*paths: Path | None) -> str:
    """Text that changes with the content of the files."""
    digest = hashlib.sha256()
    for path in paths:
        digest.update(b"" if path is None else path.read_bytes())
    return digest.hexdigest()[:12]


def main() -> None:
    parser = argparse.ArgumentParser(description="Render a textured mesh for s2r render.")
    parser.add_argument("file", type=Path, help=".glb, .gltf or .obj")
    parser.add_argument("--points", type=Path, metavar="FILE.csv",
                        help="places on the mesh's floor and on the map: mesh_x, mesh_y, x_m, "
                        "y_m")  # fmt: skip
    options = parser.parse_args()
    for path in filter(None, (options.file, options.points)):
        if not path.is_file():
            parser.error(f"{path}: no such file")
    try:
        import vtkmodules  # noqa: F401
    except ImportError:
        sys.exit("renderer mesh: needs VTK; install s2rtui[mesh]")
    render = mesh_renderer(options.file, options.points)
    version = f"{VERSION} {_content_hash(options.file, options.points)}"
    serve(render, f"mesh {options.file.name}", version, PARAMETERS)


if __name__ == "__main__":
    main()
