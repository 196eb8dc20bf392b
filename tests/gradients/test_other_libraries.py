"""PyTorch and JAX differentiate pictures, where they are installed: the gradients are those of `Renderer.gradients`."""

import importlib

import numpy as np
import pytest

import wrt

NAMES = ("wall.reflectance", "environment.radiance")


@pytest.fixture(scope="module")
def renderer():
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 0.0, 3.0), (0.0, 0.0, 0.0)))
    scene.add(wrt.quad((-1.0, -1.0, 0.0), (2.0, 0.0, 0.0), (0.0, 2.0, 0.0)), material=(0.3, 0.5, 0.7), name="wall")
    scene.environment = wrt.ConstantEnvironment((0.2, 0.3, 0.4))
    return wrt.Renderer(scene, width=16, height=12, sampler="independent", max_depth=4)


def values():
    return {"wall.reflectance": np.float32((0.2, 0.4, 0.6)), "environment.radiance": np.float32((1.0, 2.0, 3.0))}


def expected(renderer, d_image_of):
    """Return the picture of the values, and the gradients with the random numbers of another seed."""
    renderer.set_parameters(values())
    renderer.seed = 9
    image = renderer.render(spp=3)
    return image, renderer.gradients(d_image_of(image), NAMES, spp=2, seed=9 + 2**31)


def test_torch(renderer):
    torch = pytest.importorskip("torch")
    importlib.import_module("wrt.torch")
    image, gradients = expected(renderer, lambda image: 2.0 * image)
    tensors = {name: torch.tensor(value, requires_grad=True) for name, value in values().items()}
    tensors["wall.reflectance"].requires_grad_(False)
    picture = wrt.torch.render(renderer, tensors, spp=3, seed=9, gradient_spp=2)
    np.testing.assert_array_equal(picture.detach().numpy(), image)
    renderer.set_parameters({"wall.reflectance": (0.9, 0.9, 0.9)})  # as another picture between the two would
    (picture**2).sum().backward()
    assert tensors["wall.reflectance"].grad is None
    np.testing.assert_array_equal(tensors["environment.radiance"].grad.numpy(), gradients["environment.radiance"])


def test_jax(renderer):
    jax = pytest.importorskip("jax")
    importlib.import_module("wrt.jax")
    image, gradients = expected(renderer, lambda image: 2.0 * image)

    def loss(arrays):
        picture = wrt.jax.render(renderer, arrays, spp=3, seed=9, gradient_spp=2)
        return (picture**2).sum(), picture

    for function in (loss, jax.jit(loss)):
        found, picture = jax.grad(function, has_aux=True)(values())
        np.testing.assert_array_equal(picture, image)
        for name in NAMES:
            np.testing.assert_array_equal(found[name], gradients[name])


TORCH, JAX = "torch", "jax"


@pytest.mark.parametrize("library", [TORCH, JAX])
@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda a: {"wall.reflectence": a(3)}, "there is no parameter 'wall.reflectence' (did you mean 'wall.refl"),
        (lambda a: {"wall.reflectance": a(2)}, "wall.reflectance must have the shape (3,), not (2,)"),
        (lambda a: [a(3)], "values must be a dictionary by the names of parameters, not a list"),
    ],
)
def test_wrong_values(renderer, library, make, message):
    numbers = pytest.importorskip("torch" if library == TORCH else "jax.numpy")
    render = importlib.import_module(f"wrt.{library}").render
    with pytest.raises(wrt.InputError) as error:
        render(renderer, make(numbers.ones))
    assert str(error.value).startswith(message)
    with pytest.raises(wrt.InputError, match="gradient_spp must be between 1"):
        render(renderer, {}, gradient_spp=0)
    with pytest.raises(wrt.InputError, match=r"must be a wrt\.Renderer, not Scene"):
        render(renderer.scene, {})


def test_torch_takes_bfloat16_and_nothing_but_tensors(renderer):
    torch = pytest.importorskip("torch")
    value = torch.full((3,), 0.5, dtype=torch.bfloat16, requires_grad=True)
    importlib.import_module("wrt.torch").render(renderer, {"wall.reflectance": value}, spp=1).sum().backward()
    assert value.grad.dtype == torch.bfloat16
    assert (value.grad > 0.0).all()
    with pytest.raises(wrt.InputError, match="must be a torch Tensor, not a tuple"):
        wrt.torch.render(renderer, {"wall.reflectance": (0.1, 0.2, 0.3)})
    with pytest.raises(wrt.InputError, match="d_image cannot be an array of NumPy: Can't call numpy"):
        renderer.gradients(torch.ones(12, 16, 3, requires_grad=True))
