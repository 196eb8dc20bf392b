"""A small scene for tests of films, and pictures of renderers."""

import dataclasses

import numpy as np

import wrt

LAMP = wrt.Shape(wrt.quad((-1.0, 3.0, -1.0), (2.0, 0.0, 0.0), (0.0, 0.0, 2.0)), emission=2.0)


def block_scene(**changes):
    """Return a block under a lamp, with a sun and an image around them: tests that share it share its kernels."""
    result = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 1.0, 4.0), (0.0, 0.0, 0.0)))
    result.environment = wrt.ImageEnvironment(np.random.default_rng(1).random((4, 8, 3)).astype(np.float32))
    result.shapes = [wrt.Shape(wrt.box(), wrt.Diffuse(0.5)), LAMP]
    result.add_light(wrt.PointLight((1.0, 2.0, 3.0), intensity=4.0))
    return dataclasses.replace(result, **changes)


def finish(renderer, *targets, **limits):
    """Render to each number of samples in turn, or to other limits, and return the renderer."""
    for target in targets or (None,):
        for _ in renderer.passes(spp=target, **limits):
            pass
    return renderer


def image_of(renderer, *targets, **limits):
    return finish(renderer, *targets, **limits).image()


def rendered(scene, spp, **options):
    """Return a renderer that has rendered independent samples, all of them finite."""
    renderer = wrt.Renderer(scene, **{"sampler": "independent", "width": 48, "height": 36, "max_depth": 5, **options})
    finish(renderer, spp)
    assert not renderer.film.rejected
    return renderer


def assert_same_arrays(a, b):
    assert a.keys() == b.keys()
    for name, array in a.items():
        np.testing.assert_array_equal(array, b[name], err_msg=name)
