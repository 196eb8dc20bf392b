"""Pictures as functions of JAX's arrays: `import wrt.jax`, which needs the extra `wrt[jax]`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from wrt.gradients.renderers import Differentiable
from wrt.rendering.renderer import Renderer

try:
    import jax
except ImportError as error:
    raise ImportError('wrt.jax needs JAX: pip install "wrt[jax]"') from error


def render(
    renderer: Renderer,
    values: Mapping[str, jax.Array],
    *,
    spp: int = 16,
    seed: int | None = None,
    gradient_spp: int | None = None,
) -> jax.Array:
    """Return a picture, (H, W, 3), that `jax.grad` differentiates by parameters of the scene, also within `jax.jit`.

    `values` are set as by `Renderer.set_parameters`. Gradients are those of `Renderer.gradients` with other random
    numbers than the picture's, as most losses square its noise.

    Args:
        renderer: the renderer; its film then holds the picture. Pictures and gradients go by way of the host.
        values: arrays by the names of parameters, of their shapes.
        spp: samples per pixel of the picture.
        seed: 0 to 2³² − 1, from then on the renderer's; a constant within `jax.jit`.
        gradient_spp: samples per pixel of the gradients; by default `spp`.

    Raises:
        InputError: for unknown names and wrong shapes. What `Renderer.set_parameters` refuses of the values themselves
            JAX raises as an error of its own, with that message.
    """
    function = Differentiable(renderer, values, spp, gradient_spp, seed)

    def image_of(values: Mapping[str, Any]) -> Any:
        function.render({name: np.asarray(value) for name, value in values.items()})
        return renderer.image()[..., :3]

    def gradients_of(values: Mapping[str, Any], d_image: Any) -> Any:
        found = function.gradients({name: np.asarray(value) for name, value in values.items()}, values, d_image)
        return {name: gradient.astype(values[name].dtype) for name, gradient in found.items()}

    @jax.custom_vjp  # type: ignore[untyped-decorator]
    def picture(values: Mapping[str, Any]) -> Any:
        return jax.pure_callback(image_of, jax.ShapeDtypeStruct(function.shape, np.float32), values)

    def backward(values: Mapping[str, Any], d_image: Any) -> tuple[Any]:
        kinds = {name: jax.ShapeDtypeStruct(value.shape, value.dtype) for name, value in values.items()}
        return (jax.pure_callback(gradients_of, kinds, values, d_image),)

    picture.defvjp(lambda values: (picture(values), values), backward)
    found: jax.Array = picture(dict(values))
    return found
