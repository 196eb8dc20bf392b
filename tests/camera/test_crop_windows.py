"""A part of a picture has the bits of the whole, for every camera and sampler, and goes on from its checkpoint."""

import functools

import numpy as np
import pytest
from support.small_scenes import finish, image_of

import wrt
from wrt.scene.scene import SAMPLERS

SIZE = {"width": 48, "height": 30}
LENS = {"aperture_radius": 0.2, "aperture": "polygon", "aperture_blades": 5, "shutter_close": 0.1}
CAMERAS = {
    "perspective": wrt.PerspectiveCamera((0, 1, 5), **LENS, motion=wrt.Motion.translation((0.5, 0, 0), (0, 0.1))),
    "orthographic": wrt.OrthographicCamera((0, 1, 5), view_height=4.0),
    "panorama": wrt.PanoramaCamera((0, 1, 2)),
    "fisheye": wrt.FisheyeCamera((0, 1, 2)),
}


def stage(name):
    scene = wrt.Scene(camera=CAMERAS[name], environment=wrt.ImageEnvironment(np.float32([[[0.4, 0.5, 0.6]]])))
    scene.add(wrt.box((-4, -4, -4), (4, -1.2, 4)), material=wrt.Diffuse((0.6, 0.3, 0.2)))
    scene.add(wrt.sphere((0, 0, 0), 0.9, subdivisions=3), material=wrt.Diffuse(0.7))
    scene.add(wrt.quad((-1, 3, -1), (2, 0, 0), (0, 0, 2)), emission=6.0)
    return scene


@functools.cache
def whole(name, device, sampler="sobol"):
    return wrt.render(stage(name), **SIZE, spp=3, device=device, sampler=sampler)


@pytest.mark.parametrize("crop", [(0, 0, 1, 1), (7, 11, 40, 12), (20, 3, 48, 30)], ids=str)
@pytest.mark.parametrize(
    ("name", "sampler"),
    [
        *((name, "sobol") for name in CAMERAS),
        *(pytest.param("perspective", s, marks=pytest.mark.slow) for s in SAMPLERS),
    ],
)
def test_a_part_has_the_bits_of_the_whole(name, sampler, crop, device):
    picture = whole(name, device, sampler)
    x0, y0, x1, y1 = crop
    part = wrt.render(stage(name), **SIZE, spp=3, device=device, sampler=sampler, crop=crop)
    np.testing.assert_array_equal(part, picture[y0:y1, x0:x1])
    assert picture.any()


def test_a_part_goes_on_from_its_checkpoint(tmp_path):
    scene = stage("perspective")
    scene.settings = wrt.RenderSettings(**SIZE, crop=(5, 6, 30, 20))
    renderer = finish(wrt.Renderer(scene), 2)
    assert (renderer.width, renderer.height, renderer.crop) == (48, 30, (5, 6, 30, 20))
    assert renderer.image().shape == renderer.variance().shape == (14, 25, 3)
    assert renderer.paths == 2 * 14 * 25
    renderer.save_checkpoint(tmp_path / "part")
    scene.settings = wrt.RenderSettings()
    resumed = wrt.Renderer.resume(tmp_path / "part", scene)
    np.testing.assert_array_equal(image_of(resumed, 5), image_of(renderer, 5))
