"""What wrt raises when it is given something it cannot use."""


class InputError(ValueError):
    """A file, a value or a scene cannot be used; the message is one line that says which and why."""
