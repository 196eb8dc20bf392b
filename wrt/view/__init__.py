"""The live view: a render in a thread, shown in the browser or a notebook while it converges."""
