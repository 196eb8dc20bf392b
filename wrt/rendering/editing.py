"""A picture whose scene changes between passes: its camera, vertices of its meshes, values of its materials."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from wrt import _above
from wrt.backend.device import Device
from wrt.errors import InputError
from wrt.rendering.noise import NoiseEstimate
from wrt.rendering.picture import Picture
from wrt.rendering.reading import Reading, crop_of
from wrt.scene.camera import Camera, require_camera
from wrt.scene.scene import Scene, Shape
from wrt.upload.camera import CropWindow, build_camera, outside_cameras
from wrt.upload.vertex_updates import shape_number

if TYPE_CHECKING:
    from wrt.rendering.catchers import Catchers
    from wrt.rendering.guides import Guides
    from wrt.rendering.photons import Photons
    from wrt.upload.scene_data import BuiltScene


class EditablePicture(Picture):
    """The picture of a scene on a device, which restarts when the scene changes; nothing is built again.

    Attributes:
        scene: the scene, with its camera.
        device: where the scene is.
    """

    scene: Scene
    has_updated_vertices: bool
    device: Device
    _built: BuiltScene
    _shared_inputs: list[Any]
    _catchers: Catchers | None
    _photons: Photons | None
    _guides: Guides | None
    _reading: Reading

    @property
    def camera(self) -> Camera:
        """The camera in use; `set_camera` changes it."""
        assert self.scene.camera is not None
        return self.scene.camera

    @property
    def width(self) -> int:
        """Width of the whole picture, pixels."""
        return self.settings.width

    @property
    def height(self) -> int:
        """Height of the whole picture, pixels."""
        return self.settings.height

    @property
    def crop(self) -> CropWindow:
        """The rendered part of the picture: first column and row, and those after the last."""
        return crop_of(self.settings)

    @property
    def window(self) -> CropWindow:
        """The pixels of the film: the rendered part of the picture, and those beside it that the filter reads."""
        (x0, y0, x1, y1), (left, top, right, bottom) = self.crop, self._reading.margins
        return x0 - left, y0 - top, x1 + right, y1 + bottom

    def set_camera(self, camera: Camera) -> None:
        """Restart the picture with another camera; nothing is built again.

        Args:
            camera: one with the same shutter times; a class of your own cannot replace another class.

        Raises:
            InputError: if the kernel or the trees do not fit this camera.
        """
        require_camera(camera)
        old = self.camera
        if outside_cameras(camera) != outside_cameras(old):
            names = f"from {type(old).__name__} ({old.model}) to {type(camera).__name__} ({camera.model})"
            raise InputError(f"the camera cannot change {names}, which need different kernels; make a new Renderer")
        if (camera.shutter_open, camera.shutter_close) != (old.shutter_open, old.shutter_close):
            raise InputError("the camera must have the same shutter times as before; make a new Renderer")
        self.scene.camera = camera
        self._built.look_from(camera)
        if self._photons is not None:
            self._photons.look_from(camera)
        self._shared_inputs[0] = self._device_camera()
        if self._catchers is not None:
            self._catchers.look_from(camera)
        self._clear()

    def update_vertices(self, shape: Shape | int, vertices: Any, normals: Any = None) -> None:
        """Move a shape's vertices and restart the picture, for the next frame of a simulation.

        The ray tree is refitted, which takes a fraction of the time of a build; tracing is fastest near the positions
        of the build. Nothing else in the scene changes.

        Args:
            shape: one of the scene's shapes, or its number; it must not emit, and the scene must have no instances and
                no motion.
            vertices: (N, 3) NumPy array, or Warp array of vec3 on the device; metres, in world space, as many as the
                mesh has.
            normals: shading normals, likewise; by default they are recomputed if the mesh has any.

        Raises:
            InputError: when the shape cannot be updated, on arrays of other sizes, or on values that are not finite or
                beyond 10^12.
        """
        number = shape_number(self.scene, shape)
        if self.scene.shapes[number].shadow_catcher:
            raise InputError("the vertices of a shadow catcher cannot be updated; make a new Renderer")
        if self.scene.shapes[number].emits:
            name = self.scene.shapes[number].name
            raise InputError(f"{name}: vertices of an emitting shape cannot be updated; make a new Renderer")
        self._move(number, self.scene.shapes[number], vertices, normals)
        self.has_updated_vertices = True
        self._clear()

    def _move(self, number: int, shape: Shape, vertices: Any, normals: Any) -> None:
        self._built.world.update(number, shape, vertices, normals)
        if self._built.casters is not None:
            self._built.casters.enclose(self.device.backend.fetch(self._built.data.points))

    def set_parameters(self, values: Mapping[str, Any]) -> None:
        """Restart the picture with other values of the scene's parameters; nothing is built again.

        The picture then has the same bits as a new Renderer's of the changed scene, which is `scene` from then on;
        `wrt.save_scene` writes it.

        Args:
            values: arrays by name, of the shapes that `wrt.parameters` returns; others keep their values.

        Raises:
            InputError: when there is no such parameter, a value has another shape, is not finite or out of range, or
                the values need another kernel; then nothing has changed.
        """
        self._change_values(_above.gradients().edited(self.scene, values))
        self._clear()

    def gradients(
        self, d_image: Any, names: Iterable[str] | None = None, *, spp: int = 16, seed: int | None = None
    ) -> dict[str, NDArray[np.float32]]:
        """Return the derivatives of a loss by parameters of the scene, from its derivative by the picture.

        They are estimates, as the picture is, and without bias for a given `d_image`. A loss that squares the noise of
        the picture needs other random numbers than the picture's (docs/gradients.md). The picture stays as it is.

        Args:
            d_image: (H, W, 3), derivative of the loss by the mean radiance of each pixel; see `image`.
            names: parameters, as `wrt.parameters` names them; by default all but vertices, normals and indices
                of smooth glass.
            spp: samples per pixel.
            seed: 0 to 2³² − 1; by default the picture's, whose first `spp` samples are then differentiated.

        Returns:
            An array for each parameter, of its shape.

        Raises:
            InputError: on an array of another shape or with values that are not finite, unknown names, or what has no
                derivatives: an integrator, caustics; for vertices and smooth glass also some surfaces and lights.
        """
        found: dict[str, NDArray[np.float32]] = _above.gradients().gradients(self, d_image, names, spp, seed)
        return found

    def make_texels_editable(self) -> None:
        """Store the texels of all images as numbers of their own, where they are not yet; the picture stays."""
        if not self._built.values.materials.is_editable:
            self._change_values(self.scene)

    def _change_values(self, scene: Scene) -> None:
        """Upload the values of a scene that differs from this one in values of its parameters alone."""
        has_environment = scene.environment is not self.scene.environment
        is_first = not self._built.values.materials.is_editable
        changes = list(enumerate(zip(scene.shapes, self.scene.shapes, strict=True)))
        moved = [(number, new) for number, (new, old) in changes if new.mesh is not old.mesh]
        for number, shape in moved:
            self._built.world.require(number, shape)
        if moved and self.has_updated_vertices:
            raise InputError("vertices were updated, so that the scene lacks them; make a new Renderer")
        self._built.values.change(scene)
        for number, shape in moved:
            self._move(number, shape, shape.mesh.vertices, shape.mesh.normals)
        if moved:
            self._built.look_from(self.camera)
        for name in ("shapes", "lights", "environment", "medium"):  # of all renderers that share the scene
            setattr(self.scene, name, getattr(scene, name))
        if is_first or (has_environment and self.integrator == "whitted"):
            self._start_kernel()  # larger arrays, or another ambient light
        if self._catchers is not None:
            self._catchers.forget()

    def _clear(self) -> None:
        self.film.clear()
        self.noise_estimate = NoiseEstimate(self.film)
        if self._photons is not None:
            self._photons.forget()
        if self._guides is not None:
            self._guides.clear()

    def _device_camera(self) -> Any:
        return build_camera(self.camera, self.width, self.height, self.window, device=self.device.name)

    @abstractmethod
    def _start_kernel(self) -> None:
        """Give the kernel its arguments, for arrays of the scene that are new."""
