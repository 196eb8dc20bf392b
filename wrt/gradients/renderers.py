"""What a Renderer does with parameters: set them, and differentiate by them."""

from wrt.gradients.parameters import edited as edited
