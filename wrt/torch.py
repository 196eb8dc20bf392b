"""Pictures as functions of PyTorch's tensors: `import wrt.torch`, which needs the extra `wrt[torch]`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from wrt.errors import InputError
from wrt.gradients.renderers import Differentiable
from wrt.rendering.renderer import Renderer

try:
    import torch
except ImportError as error:
    raise ImportError('wrt.torch needs PyTorch: pip install "wrt[torch]"') from error


def render(
    renderer: Renderer,
    values: Mapping[str, torch.Tensor],
    *,
    spp: int = 16,
    seed: int | None = None,
    gradient_spp: int | None = None,
) -> torch.Tensor:
    """Return a picture, (H, W, 3), through which gradients flow back to parameters of the scene.

    `values` are set as by `Renderer.set_parameters`. Gradients are those of `Renderer.gradients` with other random
    numbers than the picture's, as most losses square its noise.

    Args:
        renderer: the renderer; its film then holds the picture, which a tensor on the same GPU shares. Values and
            gradients go by way of the host.
        values: tensors by the names of parameters, of their shapes, on any device.
        spp: samples per pixel of the picture.
        seed: 0 to 2³² − 1, from then on the renderer's: another one in each step gives it other noise.
        gradient_spp: samples per pixel of the gradients; by default `spp`.

    Raises:
        InputError: as `Renderer.set_parameters` and `Renderer.gradients` do.
    """
    for name, value in values.items() if isinstance(values, Mapping) else ():
        if not isinstance(value, torch.Tensor):
            raise InputError(f"{name} must be a torch Tensor, not a {type(value).__name__}")
    function = Differentiable(renderer, values, spp, gradient_spp, seed)
    picture: torch.Tensor = _Picture.apply(renderer, function, tuple(values), *values.values())
    return picture


def _numbers(tensor: torch.Tensor) -> Any:
    """Return a copy for NumPy, which has no bfloat16."""
    tensor = tensor.detach().cpu()
    return (tensor.float() if tensor.dtype == torch.bfloat16 else tensor).numpy().copy()


class _Picture(torch.autograd.Function):  # type: ignore[misc]
    """The picture of a renderer, differentiable by the parameters whose values follow their names."""

    @staticmethod
    def forward(
        ctx: Any, renderer: Renderer, function: Differentiable, names: tuple[str, ...], *tensors: torch.Tensor
    ) -> torch.Tensor:
        """Set the parameters, and render."""
        ctx.values = {name: _numbers(tensor) for name, tensor in zip(names, tensors, strict=True)}
        ctx.function, ctx.kinds = function, [(tensor.dtype, tensor.device) for tensor in tensors]
        function.render(ctx.values)
        if renderer.device.is_cpu:
            picture = torch.from_numpy(renderer.image()[..., :3].copy())
        else:
            picture = torch.from_dlpack(renderer.device_image())
        return picture.to(tensors[0].device) if tensors else picture

    @staticmethod
    @torch.autograd.function.once_differentiable  # type: ignore[untyped-decorator]
    def backward(ctx: Any, d_picture: torch.Tensor) -> tuple[Any, ...]:
        """Return the gradients by the tensors that need them."""
        names = [name for name, needed in zip(ctx.values, ctx.needs_input_grad[3:], strict=True) if needed]
        found = ctx.function.gradients(ctx.values, names, d_picture.detach().cpu().numpy())
        by_tensors = (
            torch.as_tensor(found[name]).to(device=device, dtype=dtype) if name in found else None
            for name, (dtype, device) in zip(ctx.values, ctx.kinds, strict=True)
        )
        return (None, None, None, *by_tensors)
